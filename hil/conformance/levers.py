"""Levers: what a bench can do to a device besides speaking to it.

An emulated device in this process has all of them. For a real one somebody plugs them in by the scheme of a text: a
function in the entry-point group ``phasewire.levers`` takes the rest of the text and returns `Levers`. A case that
needs a lever which no one has plugged in is inconclusive.
"""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from functools import wraps
from types import MappingProxyType
from typing import Any

from ...base.errors import BenchError
from ...emulator import Emulator
from ...emulator.boards.sync import SyncLine
from ...emulator.faults import InjectedFault
from ...protocol.board import CORE_HZ, CYCLES_PER_MS
from ...protocol.codes import StandardRequest
from ...protocol.requests import Setup
from .cases import Inconclusive, Need
from .plugs import named_emulator, opener

__all__ = ["GROUP", "METHODS", "EmulatorLevers", "LeverFailed", "Levers", "PluggedLevers", "open_levers"]

GROUP = "phasewire.levers"
SET_CONFIGURATION = Setup(0x00, StandardRequest.SET_CONFIGURATION, 1, 0, 0)
COMMAND_SECONDS = 60.0
"""For a command that switches something; hubs take seconds."""
COMMAND_FORM = "command:power=PROGRAM … {} or command:cable=PROGRAM … {}"
_SWITCHED = re.compile(r"\{(?:([^{}|]*)\|([^{}|]*))?\}")
METHODS: Mapping[Need, tuple[str, ...]] = MappingProxyType(
    {
        Need.POWER: ("power_down", "power_up"),
        Need.SUSPEND: ("suspend", "resume"),
        Need.PLUG: ("unplug", "plug"),
        Need.BUS: ("configure",),
        Need.FAULTS: ("cause",),
        Need.SYNC: ("share_sync", "drive_sync"),
    }
)
"""The methods that levers must have for a case's need."""


class LeverFailed(Inconclusive):
    """A lever did not do what it should, so that the device cannot be judged; the text has its output."""


class Levers:
    """The levers of a bench that can only speak to its device: none.

    A bench that can do more derives from this class and overrides the methods that it has; what cases may need (`can`)
    follows. A method returns when the thing is done, and may return a text for the evidence of the case. Whatever it
    raises makes the case inconclusive.
    """

    @property
    def can(self) -> frozenset[Need]:
        """The needs for which all methods are here (`METHODS`)."""
        own = type(self)
        return frozenset(
            need
            for need, names in METHODS.items()
            if all(getattr(own, name) is not getattr(Levers, name) for name in names)
        )

    def power_down(self) -> str | None:
        """Take the power away."""
        raise NotImplementedError

    def power_up(self) -> str | None:
        """Give the power back; the device needs some time to come up."""
        raise NotImplementedError

    def suspend(self) -> str | None:
        """Suspend the bus."""
        raise NotImplementedError

    def resume(self) -> str | None:
        """Resume the bus."""
        raise NotImplementedError

    def unplug(self) -> str | None:
        """Pull the USB cable."""
        raise NotImplementedError

    def plug(self) -> str | None:
        """Plug it in again."""
        raise NotImplementedError

    def configure(self) -> str | None:
        """Let a host on the bus reset and configure the device, if blocks use another line."""
        raise NotImplementedError

    def cause(self, fault: InjectedFault) -> str | None:
        """Cause a fault, by its name in `emulator.faults`."""
        raise NotImplementedError

    def share_sync(self, seconds: float | None) -> str | None:
        """Let the device listen on its sync line from its next restart on (clause CHN-026).

        Pulses of another device begin on the line so many seconds from now; with None there are none.
        """
        raise NotImplementedError

    def drive_sync(self) -> str | None:
        """Let the device drive its sync line again from its next restart on."""
        raise NotImplementedError

    def close(self) -> None:
        """Give back what the levers hold."""


class PluggedLevers(Levers):
    """Several levers as one: each method is that of the first which has it.

    What a lever raises becomes `LeverFailed`, except with the emulator, whose errors are those of the device.

    Parameters
    ----------
    parts : iterable of (str, Levers)
        The levers with their texts, for errors.

    Attributes
    ----------
    outside : dict of Need to str
        The texts of the levers that are not the emulator's, by what they do. These may fail without an error.
    done : callable
        Called after each action with its name and a text for the evidence.
    """

    can: frozenset[Need] = frozenset()

    def __init__(self, parts: Iterable[tuple[str, Levers]]) -> None:
        self.outside: dict[Need, str] = {}
        self.done: Callable[[str, str], None] = lambda _action, _said: None
        for text, levers in parts:
            for need in levers.can - self.can:
                if not isinstance(levers, EmulatorLevers):
                    self.outside[need] = text
                for name in METHODS[need]:
                    setattr(self, name, self._told(name, getattr(levers, name), self.outside.get(need)))
            self.can |= levers.can

    def _told(self, name: str, method: Callable[..., str | None], text: str | None) -> Callable[..., None]:
        @wraps(method)
        def told(*arguments: Any) -> None:
            try:
                said = method(*arguments)
            except Exception as error:
                if text is None:
                    raise
                raise LeverFailed(f"the lever {text!r} failed: {error}") from error
            self.done(name, " ".join(map(str, filter(None, (name, *arguments)))) + (f": {said}" if said else ""))

        return told


def open_levers(texts: Iterable[str], stack: ExitStack) -> PluggedLevers:
    """Open levers by texts such as ``command:power=usbrelay BITFT_1={}``; if two can do the same, the first does it.

    The stack closes them. Raises `ValueError` if a scheme is unknown, or the rest of a text is wrong.
    """
    parts = []
    for text in texts:
        opened, rest = opener(GROUP, OWN, text)
        levers: Levers = opened(rest)
        stack.callback(levers.close)
        parts.append((text, levers))
    return PluggedLevers(parts)


class EmulatorLevers(Levers):
    """The levers of an emulated device in this process."""

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
        """Let a host on the bus reset and configure the device."""
        self._emulator.usb.reset()
        self._emulator.usb.control(SET_CONFIGURATION)

    def cause(self, fault: InjectedFault) -> None:
        """Cause a fault."""
        self._emulator.inject(fault)

    def share_sync(self, seconds: float | None) -> None:
        """Let the device listen from its next restart on, to a line with or without pulses."""
        line = SyncLine()
        self._emulator.share_sync(line)
        if seconds is not None:
            line.drive(self._emulator.scheduler.now + round(seconds * CORE_HZ))

    def drive_sync(self) -> None:
        """Let the device drive its sync line again from its next restart on."""
        self._emulator.share_sync(None)

    def _pass(self, milliseconds: int) -> None:
        scheduler = self._emulator.scheduler
        scheduler.run_until(scheduler.now + milliseconds * CYCLES_PER_MS)


class _Command:
    """A program that switches something on and off.

    Parameters
    ----------
    template : str
        Its command line, split as by a shell, but no shell runs it. ``{}`` stands for ``on`` or ``off``, ``{1|0}`` for
        ``1`` or ``0``.
    """

    def __init__(self, template: str) -> None:
        self._template = template

    def switch(self, *, on: bool) -> str:
        """Run it; returns its command line and its output.

        Raises `BenchError` if it cannot be run, does not end, or ends with another code than 0; it tells its output.
        """
        line = _SWITCHED.sub(lambda found: (found[1] if on else found[2]) or ("on" if on else "off"), self._template)
        try:
            done = subprocess.run(
                shlex.split(line),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=COMMAND_SECONDS,
                check=False,
                text=True,
                errors="replace",
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise BenchError(f"`{line}` cannot be run: {error}") from error
        if done.returncode:
            raise BenchError(f"`{line}` ended with code {done.returncode}: {done.stdout.strip() or 'it said nothing'}")
        return f"`{line}` ended with code 0: {done.stdout.strip() or 'it said nothing'}"


class PowerCommand(Levers):
    """A program that switches the device's power, such as a relay's."""

    def __init__(self, template: str) -> None:
        self._command = _Command(template)

    def power_down(self) -> str:
        """Take the power away."""
        return self._command.switch(on=False)

    def power_up(self) -> str:
        """Give the power back."""
        return self._command.switch(on=True)


class CableCommand(Levers):
    """A program that switches the voltage of the USB cable of a device with a supply of its own, such as a hub's."""

    def __init__(self, template: str) -> None:
        self._command = _Command(template)

    def unplug(self) -> str:
        """Pull the USB cable."""
        return self._command.switch(on=False)

    def plug(self) -> str:
        """Plug it in again."""
        return self._command.switch(on=True)


def _open_command(rest: str) -> Levers:
    what, _, template = rest.partition("=")
    kinds = {"power": PowerCommand, "cable": CableCommand}
    if what not in kinds or not _SWITCHED.search(template):
        raise ValueError(
            f"'command:{rest}' must have the form {COMMAND_FORM}; {{}} becomes on or off, {{1|0}} becomes 1 or 0"
        )
    return kinds[what](template)


OWN: Mapping[str, Callable[[str], Levers]] = MappingProxyType(
    {"command": _open_command, "emulator": lambda serial: EmulatorLevers(named_emulator(serial))}
)
"""The schemes of this package."""
