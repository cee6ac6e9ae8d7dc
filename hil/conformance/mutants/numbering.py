"""Broken numbering of blocks: order, losses and new beginnings (chapter NUM)."""

from __future__ import annotations

from typing import Any

from ....base.errors import BlockError
from ....emulator.control import admission, device_state
from ....emulator.control.admission import Admission
from ....emulator.control.device_state import DeviceState
from ....emulator.control.state_machine import StateMachine
from ....protocol.codes import Reason
from .patching import Patch, mutant
from .seams import one_by_one

NUMBERS, AHEAD = 2**32, 2**31


@mutant("NUM-002", "NUM-001")
def numbers_are_compared_without_wrap(patch: Patch) -> None:
    """Block 0 after block 2³² − 1 is refused: the numbers are compared without wrapping."""
    patch.replace(admission, "follows", lambda number, last: number > last)
    one_by_one(patch)


@mutant("NUM-002")
def same_number_follows(patch: Patch) -> None:
    """A repeated block is carried out twice: a difference of 0 passes."""
    patch.replace(admission, "follows", lambda number, last: (number - last) % NUMBERS < AHEAD)
    patch.replace(device_state, "missing", lambda number, last: max((number - last) % NUMBERS - 1, 0))


@mutant("NUM-002")
def half_the_range_follows(patch: Patch) -> None:
    """A number exactly 2³¹ ahead is accepted: the bound is off by one, as if a signed difference were negated."""
    patch.replace(admission, "follows", lambda number, last: 0 < (number - last) % NUMBERS <= AHEAD)


@mutant("NUM-002")
def old_numbers_follow(patch: Patch) -> None:
    """Any number except the last one is accepted, even an older one: only repetitions are detected."""
    patch.replace(admission, "follows", lambda number, last: number != last)
    patch.replace(device_state, "missing", lambda number, last: ((number - last) % NUMBERS - 1) % AHEAD)


@mutant("NUM-003", wraps=(DeviceState, "count"), also=one_by_one)
def gap_is_never_said(original: Any, self: Any, block: Any) -> int:
    """Lost blocks are counted, but no acknowledgement has GAP: the flag is not passed on."""
    original(self, block)
    return 0


@mutant("NUM-003")
def lost_counts_one_too_many(patch: Patch) -> None:
    """A gap of n blocks counts as n + 1: the difference of the numbers is added unchanged."""
    _count_gaps_as(patch, lambda gap: gap + 1)


@mutant("NUM-003")
def lost_counts_gaps(patch: Patch) -> None:
    """A gap counts as one lost block, however many numbers are missing."""
    _count_gaps_as(patch, lambda _: 1)


def _count_gaps_as(patch: Patch, counted: Any) -> None:
    @patch.around(DeviceState, "count")
    def count(original: Any, self: Any, block: Any) -> Any:
        gap = original(self, block)
        if gap:
            self.lost += counted(gap) - gap
        return gap

    one_by_one(patch)


@mutant("NUM-004")
def restart_is_ignored(patch: Patch) -> None:
    """The flag RESTART is accepted but has no effect: a number that does not follow is refused all the same."""

    def judge(original: Any) -> Any:
        return lambda self, block, *rest: original(self, block._replace(restart=False), *rest)

    patch.wrap(Admission, "judge", judge)
    patch.wrap(DeviceState, "count", judge)


@mutant("NUM-004", "NUM-003", wraps=(DeviceState, "count"))
def restart_counts_as_a_gap(original: Any, self: Any, block: Any) -> Any:
    """The numbers between the last block and one with RESTART count as lost: the last number is not reset first."""
    return original(self, block._replace(restart=False))


@mutant("NUM-004", "USB-026", wraps=(StateMachine, "new_session"))
def number_survives_a_new_session(original: Any, self: Any, door: Any) -> None:
    """The last number survives a bus reset, SET_CONFIGURATION and SET_INTERFACE: only power-up resets it."""
    last = self._device.last_sequence
    original(self, door)
    self._device.last_sequence = last


@mutant("NUM-002", "NUM-003", wraps=(Admission, "judge"))
def refused_number_is_the_last(original: Any, self: Any, block: Any, *rest: Any) -> None:
    """A block that is refused for its contents sets the last number: the number is stored before the judgement."""
    try:
        original(self, block, *rest)
    except BlockError as error:
        if error.reason != Reason.SEQUENCE:
            self._device.last_sequence = block.sequence
        raise


@mutant("NUM-002", wraps=(Admission, "judge"))
def refused_sequence_is_the_last(original: Any, self: Any, block: Any, *rest: Any) -> None:
    """A block that is refused with SEQUENCE moves the last number back."""
    try:
        original(self, block, *rest)
    except BlockError as error:
        if error.reason == Reason.SEQUENCE:
            self._device.last_sequence = block.sequence
        raise
