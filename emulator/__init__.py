"""What the boards do: an emulated device, from USB packets to square waves, in integer time.

Its rooms, from the pins up: `ports` (what is played and how it is seen), `boards` (processors, links, sync line),
`control` (the controller), `firmware` (flash, loader, DFU), `interfaces` (what lines see of it), `doors` (ways in for
other programs). `machine` puts them together. It speaks the protocol and meets the host only through a USB backend
found by URL; it knows nothing of fields or shapes.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
