"""Levers: what a bench can do to a device besides speaking to it, where it can.

Behind an emulated device in this process all of them are there. A real device has none, unless somebody builds them:
cases that need one are inconclusive then.
"""

from __future__ import annotations

from typing import Protocol

from ...emulator import Emulator
from ...emulator.faults import InjectedFault
from ...protocol.board import CYCLES_PER_MS
from ...protocol.codes import StandardRequest
from ...protocol.requests import Setup
from .cases import Need

__all__ = ["EmulatorLevers", "Levers", "NoLevers"]

SET_CONFIGURATION = Setup(0x00, StandardRequest.SET_CONFIGURATION, 1, 0, 0)


class Levers(Protocol):
    """What can be done to a device; each only where `can` says so."""

    can: frozenset[Need]

    def power_down(self) -> None:
        """Take the power away."""

    def power_up(self) -> None:
        """Give the power back; the device needs some time to come up."""

    def suspend(self) -> None:
        """Suspend the bus."""

    def resume(self) -> None:
        """Resume the bus."""

    def unplug(self) -> None:
        """Pull the USB cable."""

    def plug(self) -> None:
        """Plug it in again."""

    def configure(self) -> None:
        """Let a host at the bus reset and configure the device, if blocks go by another line."""

    def cause(self, fault: InjectedFault) -> None:
        """Let something go wrong, as `emulator.faults` names it."""


class NoLevers:
    """Of a device of which nothing is known but its line."""

    can: frozenset[Need] = frozenset()

    def _cannot(self, *_what: InjectedFault) -> None:
        raise RuntimeError("this bench has no levers; a case that needs one says so in its decorator")

    power_down = power_up = suspend = resume = unplug = plug = configure = cause = _cannot


class EmulatorLevers:
    """Of an emulated device in this process.

    Parameters
    ----------
    emulator : Emulator
    """

    can = frozenset({Need.POWER, Need.SUSPEND, Need.PLUG, Need.FAULTS})

    def __init__(self, emulator: Emulator) -> None:
        self._emulator = emulator

    def power_down(self) -> None:
        """Take the power away."""
        self._emulator.power_down()

    def power_up(self) -> None:
        """Give the power back."""
        self._emulator.power_up()

    def suspend(self) -> None:
        """Leave the bus idle, so that the device notices after 3 ms."""
        self._pass(3)
        self._emulator.usb.suspend()

    def resume(self) -> None:
        """Let the bus be driven again for 20 ms."""
        self._emulator.usb.resume()
        self._pass(20)

    def unplug(self) -> None:
        """Pull the USB cable."""
        self._emulator.usb.unplug()

    def plug(self) -> None:
        """Plug it in again."""
        self._emulator.usb.plug()

    def configure(self) -> None:
        """Let a host at the bus reset and configure the device."""
        self._emulator.usb.reset()
        self._emulator.usb.control(SET_CONFIGURATION)

    def cause(self, fault: InjectedFault) -> None:
        """Let something go wrong."""
        self._emulator.inject(fault)

    def _pass(self, milliseconds: int) -> None:
        scheduler = self._emulator.scheduler
        scheduler.run_until(scheduler.now + milliseconds * CYCLES_PER_MS)
