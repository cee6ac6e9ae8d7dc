"""Broken doors: a rule of safety that does not hold for what comes by a serial line (chapter SAF, clause SER-016)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from ..emulator.control.admission import Admission
from ..emulator.control.controller import Controller
from ..emulator.control.execution import Execution
from ..emulator.control.requests import Requests
from ..emulator.control.state_machine import StateMachine
from ..emulator.interfaces.serial_line import SerialLine
from ..errors import BlockError
from ..protocol.blocks import PlaySequence
from ..protocol.board import CHANNELS
from ..protocol.codes import Reason, Request
from ..protocol.states import StateEvent
from .patching import Patch, mutant

LINES = {"the-uart": "the UART", "the-console": "the console's interface on USB"}
"""The serial lines of the emulated device, in words."""


def came_by(door: Any, line: str) -> bool:
    """Whether something came by this line."""
    return isinstance(door, SerialLine) and door._needs_dtr == (line == "the-console")


@contextmanager
def _lenient(device: Any, *, lenient: bool) -> Iterator[None]:
    """Have no drive limit for a while."""
    limit = device.drive_limit
    if lenient:
        device.drive_limit = 2 * CHANNELS
    try:
        yield
    finally:
        device.drive_limit = limit


@mutant("SAF-006", "SER-016", each=LINES)
def drive_limit_is_not_that_of_blocks_by(patch: Patch, line: str) -> None:
    """Blocks that come by {} have no drive limit: only the handler of bulk endpoints checks it."""

    @patch.around(Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, arrived: int | None = None) -> None:
        with _lenient(self._device, lenient=came_by(door, line)):
            original(self, packet, door, arrived)


@mutant("SAF-006", "CON-008", each=LINES)
def drive_limit_is_not_that_of_test_by(patch: Patch, line: str) -> None:
    """The command `test` by {} has no drive limit: one transducer alone seems harmless."""

    @patch.around(Controller, "test_transducer")
    def test(original: Any, self: Any, transducer: int, door: Any) -> None:
        with _lenient(self._device, lenient=came_by(door, line)):
            original(self, transducer, door)


@mutant("SAF-003", "SER-016", each=LINES)
def refused_blocks_feed_the_watchdog_by(patch: Patch, line: str) -> None:
    """Refused blocks by {} are signs of life: each whole frame feeds the watchdog."""

    @patch.around(Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, arrived: int | None = None) -> None:
        original(self, packet, door, arrived)
        if came_by(door, line):
            self._machine.watchdog.feed()


@mutant("SAF-003", "CON-008", each=LINES)
def refused_tests_feed_the_watchdog_by(patch: Patch, line: str) -> None:
    """The command `test` by {} is a sign of life even if it is refused: whatever is typed feeds the watchdog."""

    @patch.around(Controller, "test_transducer")
    def test(original: Any, self: Any, transducer: int, door: Any) -> None:
        if came_by(door, line):
            self._machine.watchdog.feed()
        original(self, transducer, door)


@mutant("SAF-003", "SER-016", each=LINES)
def signs_of_life_are_missed_by(patch: Patch, line: str) -> None:
    """STATUS by {} is no sign of life: the watchdog knows the host on the other door alone."""

    @patch.around(Requests, "request")
    def request(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
        watchdog = self._machine.watchdog
        fed = watchdog._fed
        answer = original(self, setup, data, door)
        if setup.request == Request.STATUS and came_by(door, line):
            watchdog._fed = fed
        return answer


@mutant("SAF-002", "SER-016", each=LINES)
def changes_are_taken_while_disabled_by(patch: Patch, line: str) -> None:
    """Changes by {} are accepted while the outputs are off: an update enables them."""
    _without(patch, line, Reason.DISABLED)


@mutant("SAF-007", "SER-016", each=LINES)
def blocks_are_taken_in_fault_by(patch: Patch, line: str) -> None:
    """Blocks by {} are accepted while a silencing fault is not cleared."""
    _without(patch, line, Reason.FAULT)


def _without(patch: Patch, line: str, reason: Reason) -> None:
    """Refuse nothing for a reason that comes by a line."""
    doors: list[Any] = [None]

    @patch.around(Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, arrived: int | None = None) -> None:
        doors.append(door)
        original(self, packet, door, arrived)
        doors.pop()

    @patch.around(Controller, "test_transducer")
    def test(original: Any, self: Any, transducer: int, door: Any) -> None:
        doors.append(door)
        try:
            original(self, transducer, door)
        finally:
            doors.pop()

    @patch.around(Admission, "_judge_state")
    def judge(original: Any, self: Any, body: Any) -> None:
        try:
            original(self, body)
        except BlockError as error:
            if error.reason != reason or not came_by(doors[-1], line):
                raise


@mutant("SAF-004", "SER-016", each=LINES)
def outputs_play_on_at_disable_by(patch: Patch, line: str) -> None:
    """DISABLE and `stop` by {} change the state alone: the outputs play on."""

    @patch.around(StateMachine, "happen")
    def happen(original: Any, self: Any, event: StateEvent, at: int, door: Any = None, *, silent: bool = False) -> None:
        deaf = event is StateEvent.DISABLE and came_by(door, line)
        original(self, event, at, door, silent=silent or deaf)


@mutant("SAF-005", "SER-016", each=LINES)
def unattended_is_ignored_by(patch: Patch, line: str) -> None:
    """A sequence by {} is never unattended: its flags are not read there."""

    @patch.around(Execution, "carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        if isinstance(body, PlaySequence) and came_by(door, line):
            body = replace(body, unattended=False)
        return original(self, body, door)


@mutant("USB-020", "SER-016", each=LINES)
def suspend_spares_what_is_enabled_by(patch: Patch, line: str) -> None:
    """Suspend leaves the outputs as they are if they were enabled by {}: that host is still there."""

    @patch.around(Requests, "_enable")
    def enable(original: Any, self: Any, door: Any) -> None:
        original(self, door)
        vars(self._machine)["enabled_by"] = door

    @patch.around(StateMachine, "suspend")
    def suspend(original: Any, self: Any) -> None:
        if not came_by(vars(self).get("enabled_by"), line):
            original(self)
