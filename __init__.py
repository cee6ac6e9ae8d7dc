"""phasewire: mid-air haptics on an ultrasonic phased array, from shape to skin.

The path of one update::

    Sphere().sample()      ControlPoints   where it should be felt
    solve(array, points)   Solution.drive  what each of 320 transducers should emit
    Pulses.from_drive(…)   Pulses          phase and width of a square wave
    device.show(pulses)    512 bytes       over USB, the controller and the chain of boards
    emulator.capture()     Capture         the bits that the outputs played
    capture.drive(period)  drive           what was emitted
    pressure(array, …)     pascals         what arrives

Every length is in metres, every angle in degrees; ``80 * mm`` and its like make SI of other units. Files are named by
text or by a `Path`. The rooms ``solver``, ``host``, ``protocol``, ``emulator``, ``feel``, ``hil`` and ``view`` have
more names.
"""

import sys

from lazy_loader import attach_stub

_load, __dir__, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A public name, whose module is loaded at its first use: a program loads only the rooms that it needs."""
    if name in __all__:
        return _load(name)
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    from importlib.metadata import PackageNotFoundError, version  # slow to import

    try:
        return version(__name__)
    except PackageNotFoundError:
        return "0+unknown"  # sources that were never installed
