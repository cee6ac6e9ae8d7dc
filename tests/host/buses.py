"""Emulated devices in a state that tests of several modules need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from phasewire import Emulator
from phasewire.protocol.codes import DfuRequest
from phasewire.protocol.requests import Setup

__all__ = ["in_dfu_mode", "raising"]


def in_dfu_mode(serial: str) -> Emulator:
    """A device that was asked to detach, and has come back two seconds later."""
    emulator = Emulator(serial=serial)
    emulator.usb.reset()
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0), b"")  # SET_CONFIGURATION
    emulator.usb.control(Setup(0x21, DfuRequest.DETACH, 1000, 3, 0), b"")
    emulator.scheduler.run_until(emulator.scheduler.now + 800_000_000)
    return emulator


def raising(error: BaseException) -> Callable[..., Any]:
    """A function that raises an error, whatever it is called with."""

    def call(*arguments: object, **options: object) -> Any:
        raise error

    return call
