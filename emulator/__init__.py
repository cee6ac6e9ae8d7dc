"""What the boards do: an emulated device, from USB packets to square waves.

This room models the controller, the chain, the processors and their ports in integer time, and offers the result as a
capture of every output bit. It speaks the protocol and meets the host only through a USB backend found by URL; it knows
nothing of fields or shapes.
"""

from __future__ import annotations

from .machine import Emulator, Event
from .ports.capture import Capture
from .scenario import read_scenario

__all__ = ["Capture", "Emulator", "Event", "read_scenario"]
