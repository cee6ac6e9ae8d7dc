"""How a program talks to a device.

This room finds a device by its URL, opens a line to it and offers it as a `Device`: playing, streaming, asking, and
flashing. It finds hands by their URL, too, and gives them as they come. It knows the protocol and the solver's drives
and hands; it reaches the emulator only as it reaches any other device, and never imports it.
"""

from lazy_loader import attach_stub

# Lazy: who only needs a transport loads no solver.
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
