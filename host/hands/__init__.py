"""Where hands come from: trackers, recordings and gestures, each found by the scheme of its URL.

This room gives hands with the time at which they were seen, in the array's coordinates. It knows no device, and nothing
of what hands touch.
"""

from lazy_loader import attach_stub

# Lazy: who only plays a solved file loads no tracker.
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
