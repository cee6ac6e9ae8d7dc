"""phasewire: mid-air haptics on an ultrasonic phased array, from shape to skin.

The way of one update::

    Sphere().sample()      ControlPoints   where it should be felt
    solve(array, points)   Solution.drive  what each of 320 transducers should emit
    Pulses.from_drive(…)   Pulses          phase and width of a square wave
    device.show(pulses)    512 bytes       over USB, the controller and the chain of boards
    emulator.capture()     Capture         the bits that the outputs played
    capture.drive(period)  drive           what was emitted
    pressure(array, …)     pascals         what arrives
"""

from __future__ import annotations

from .emulator import Capture, Emulator
from .errors import DeviceError, PhasewireError
from .host import Device, open_device
from .protocol import Pulses, Wiring
from .solver import (
    Circle,
    ControlPoints,
    Medium,
    Solution,
    Solver,
    Sphere,
    Transducer,
    TransducerArray,
    focus_report,
    parse_shape,
    pressure,
    sample_plane,
    solve,
    two_sided,
)

__all__ = [
    "Capture",
    "Circle",
    "ControlPoints",
    "Device",
    "DeviceError",
    "Emulator",
    "Medium",
    "PhasewireError",
    "Pulses",
    "Solution",
    "Solver",
    "Sphere",
    "Transducer",
    "TransducerArray",
    "Wiring",
    "focus_report",
    "open_device",
    "parse_shape",
    "pressure",
    "sample_plane",
    "solve",
    "two_sided",
]
