"""phasewire: mid-air haptics on an ultrasonic phased array, from shape to skin.

The path of one update::

    Sphere().sample()      ControlPoints   where it should be felt
    solve(array, points)   Solution.drive  what each of 320 transducers should emit
    Pulses.from_drive(…)   Pulses          phase and width of a square wave
    device.show(pulses)    512 bytes       over USB, the controller and the chain of boards
    emulator.capture()     Capture         the bits that the outputs played
    capture.drive(period)  drive           what was emitted
    pressure(array, …)     pascals         what arrives
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .emulator import Capture, Emulator
    from .errors import DeviceError, PhasewireError
    from .host import Device, open_device, open_hands
    from .protocol import Pulses, Wiring
    from .solver import (
        Circle,
        ControlPoints,
        Hand,
        Medium,
        Mesh,
        Solution,
        Solver,
        Sphere,
        Toucher,
        Transducer,
        TransducerArray,
        focus_report,
        parse_shape,
        pressure,
        read_mesh,
        read_volume_mesh,
        sample_plane,
        solve,
        touch,
        two_sided,
    )

__all__ = [
    "Capture",
    "Circle",
    "ControlPoints",
    "Device",
    "DeviceError",
    "Emulator",
    "Hand",
    "Medium",
    "Mesh",
    "PhasewireError",
    "Pulses",
    "Solution",
    "Solver",
    "Sphere",
    "Toucher",
    "Transducer",
    "TransducerArray",
    "Wiring",
    "focus_report",
    "open_device",
    "open_hands",
    "parse_shape",
    "pressure",
    "read_mesh",
    "read_volume_mesh",
    "sample_plane",
    "solve",
    "touch",
    "two_sided",
]

_HOMES = {
    "Capture": "emulator",
    "Circle": "solver",
    "ControlPoints": "solver",
    "Device": "host",
    "DeviceError": "errors",
    "Emulator": "emulator",
    "Hand": "solver",
    "Medium": "solver",
    "Mesh": "solver",
    "PhasewireError": "errors",
    "Pulses": "protocol",
    "Solution": "solver",
    "Solver": "solver",
    "Sphere": "solver",
    "Toucher": "solver",
    "Transducer": "solver",
    "TransducerArray": "solver",
    "Wiring": "protocol",
    "focus_report": "solver",
    "open_device": "host",
    "open_hands": "host",
    "parse_shape": "solver",
    "pressure": "solver",
    "read_mesh": "solver",
    "read_volume_mesh": "solver",
    "sample_plane": "solver",
    "solve": "solver",
    "touch": "solver",
    "two_sided": "solver",
}
_MODULES = ("emulator", "errors", "hil", "host", "protocol", "solver")


def __getattr__(name: str) -> Any:
    """Load the module of a name at its first use, so that a program loads only the rooms that it needs."""
    if name in _MODULES:
        return import_module(f".{name}", __name__)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_MODULES})
