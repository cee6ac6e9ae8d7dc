"""Emulated devices in a state that tests of several modules need."""

from __future__ import annotations

from phasewire import Emulator
from phasewire.protocol.codes import DfuRequest
from phasewire.protocol.requests import Setup

__all__ = ["in_dfu_mode"]


def in_dfu_mode(serial: str) -> Emulator:
    """A device that was asked to detach, and has come back two seconds later."""
    emulator = Emulator(serial=serial)
    emulator.usb.reset()
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0), b"")  # SET_CONFIGURATION
    emulator.usb.control(Setup(0x21, DfuRequest.DETACH, 1000, 3, 0), b"")
    emulator.scheduler.run_until(emulator.scheduler.now + 800_000_000)
    return emulator
