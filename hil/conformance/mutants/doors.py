"""Broken doors: a rule of safety that does not hold for what comes by a serial line (chapter SAF, clause SER-016)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from ....base.errors import BlockError
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.execution import Execution
from ....emulator.control.requests import Requests
from ....emulator.control.state_machine import StateMachine
from ....emulator.interfaces.serial_line import SerialLine
from ....protocol.blocks import PlaySequence
from ....protocol.board import CHANNELS
from ....protocol.codes import Reason, Request
from ....protocol.states import StateEvent
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


# Hosts that hang up, and blocks that wait


@mutant("SER-010")
def a_hang_up_disables_what_its_line_enabled(patch: Patch) -> None:
    """A hang-up acts as DISABLE if that line has enabled the outputs: its host has gone."""

    @patch.around(Requests, "_enable")
    def enable(original: Any, self: Any, door: Any) -> None:
        original(self, door)
        vars(self._machine)["enabled_by"] = door

    @patch.around(SerialLine, "hang_up")
    def hang_up(original: Any, self: Any) -> None:
        original(self)
        machine = self._controller._machine
        self._controller.settle()
        if vars(machine).get("enabled_by") is self:
            machine.happen(StateEvent.DISABLE, self._controller._dispatch.now)


@mutant("SER-010", "NUM-004", wraps=(SerialLine, "hang_up"))
def a_hang_up_begins_the_numbering_anew(original: Any, self: Any) -> None:
    """After a hang-up any number is accepted: another host has come."""
    original(self)
    self._controller._device.last_sequence = None


@mutant("SER-011", "SER-016", wraps=(SerialLine, "_admit"))
def lines_share_the_place_for_a_block_that_waits(original: Any, self: Any, block: bytes) -> None:
    """A block by one line is dropped while one by another line waits: there is one place for all lines."""
    if any(line._waiting for line in self._controller._machine._doors if isinstance(line, SerialLine)):
        self._controller.drop_frames(1)
    else:
        original(self, block)


@mutant("SER-011", "USB-003")
def a_bus_reset_drops_the_block_that_waits_on_the_uart(patch: Patch) -> None:
    """A bus reset empties the UART's place for a block that waits along with the queue: it is never answered."""

    @patch.around(StateMachine, "new_session")
    def new_session(original: Any, self: Any, door: Any) -> None:
        for line in self._doors:
            if came_by(line, "the-uart"):
                line._waiting = None
        original(self, door)

    @patch.around(SerialLine, "_try_again")
    def again(original: Any, self: Any, waiting: Any) -> None:
        if self._waiting is waiting:
            original(self, waiting)


@mutant("REQ-003", "SER-006")
def dropped_frames_are_those_of_the_line_that_asks(patch: Patch) -> None:
    """Each line counts its own dropped frames, and tells only those; USB tells them all."""

    @patch.around(SerialLine, "receive")
    def receive(original: Any, self: Any, data: bytes) -> None:
        before = self._controller._device.dropped_frames
        original(self, data)
        vars(self)["own"] = vars(self).get("own", 0) + self._controller._device.dropped_frames - before

    @patch.around(Requests, "request")
    def request(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
        total = self._device.dropped_frames
        if isinstance(door, SerialLine):
            self._device.dropped_frames = vars(door).get("own", 0)
        try:
            return original(self, setup, data, door)
        finally:
            self._device.dropped_frames = total


@mutant("SER-010", "SAF-003", wraps=(SerialLine, "hang_up"))
def a_hang_up_stops_the_watchdog(original: Any, self: Any) -> None:
    """A hang-up stops the watchdog: there is no host any more whom it could wait for."""
    original(self)
    self._controller.settle()
    self._controller._machine.watchdog.rest()


@mutant("SER-010", "SAF-003", wraps=(SerialLine, "hang_up"))
def a_hang_up_is_a_sign_of_life(original: Any, self: Any) -> None:
    """A hang-up feeds the watchdog, as everything that the line says."""
    original(self)
    self._controller._machine.watchdog.feed()


@mutant("SER-010", "SER-016", wraps=(SerialLine, "hang_up"))
def a_hang_up_concerns_all_lines(original: Any, self: Any) -> None:
    """A hang-up of one line returns all lines to the console."""
    for line in self._controller._machine._doors:
        if isinstance(line, SerialLine):
            original(line)
