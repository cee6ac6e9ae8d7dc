"""Skin and ears: the feeling, the sound and the exposure that waves over time cause where people are.

Its functions take the waves that transducers emit, a row for each carrier period, or a field at points. They know the
solver's array and air, and nothing of ticks, packets or devices: `hil` brings them the waves that the bits of a device
make.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
