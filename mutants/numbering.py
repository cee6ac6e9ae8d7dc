"""Broken numbering of blocks: what follows, what was lost, what begins anew (chapter NUM)."""

from __future__ import annotations

from typing import Any

from ..emulator.control import controller
from ..errors import BlockError
from ..protocol.codes import Reason
from .patching import Patch, mutant
from .seams import one_by_one

NUMBERS, AHEAD = 2**32, 2**31


@mutant("NUM-002", "NUM-001")
def numbers_are_compared_without_wrap(patch: Patch) -> None:
    """Block 0 behind block 2³² − 1 is refused: the numbers are compared as they stand."""
    patch.replace(controller, "follows", lambda number, last: number > last)
    one_by_one(patch)


@mutant("NUM-002")
def same_number_follows(patch: Patch) -> None:
    """A block that was sent twice is carried out twice: a difference of 0 passes."""
    patch.replace(controller, "follows", lambda number, last: (number - last) % NUMBERS < AHEAD)
    patch.replace(controller, "missing", lambda number, last: max((number - last) % NUMBERS - 1, 0))


@mutant("NUM-002")
def half_the_range_follows(patch: Patch) -> None:
    """A number exactly 2³¹ ahead is accepted: the bound is off by one, as with a signed difference that is negated."""
    patch.replace(controller, "follows", lambda number, last: 0 < (number - last) % NUMBERS <= AHEAD)


@mutant("NUM-002")
def old_numbers_follow(patch: Patch) -> None:
    """Any number but the last one is accepted, older ones as well: only repetitions are looked for."""
    patch.replace(controller, "follows", lambda number, last: number != last)
    patch.replace(controller, "missing", lambda number, last: ((number - last) % NUMBERS - 1) % AHEAD)


@mutant("NUM-003", wraps=(controller.Controller, "_count"), also=one_by_one)
def gap_is_never_said(original: Any, self: Any, block: Any) -> int:
    """Lost blocks are counted, and no acknowledgement says GAP: the flag is not handed on."""
    original(self, block)
    return 0


@mutant("NUM-003")
def lost_counts_one_too_many(patch: Patch) -> None:
    """A gap of n blocks counts as n + 1: the difference of the numbers is added as it is."""
    _count_gaps_as(patch, lambda gap: gap + 1)


@mutant("NUM-003")
def lost_counts_gaps(patch: Patch) -> None:
    """A gap counts as one lost block, however many numbers were left out."""
    _count_gaps_as(patch, lambda _: 1)


def _count_gaps_as(patch: Patch, counted: Any) -> None:
    @patch.around(controller.Controller, "_count")
    def count(original: Any, self: Any, block: Any) -> Any:
        gap = original(self, block)
        if gap:
            self._lost += counted(gap) - gap
        return gap

    one_by_one(patch)


@mutant("NUM-004")
def restart_is_ignored(patch: Patch) -> None:
    """The flag RESTART is accepted and means nothing: a number that does not follow is refused all the same."""

    def judge(original: Any) -> Any:
        return lambda self, block, *rest: original(self, block._replace(restart=False), *rest)

    patch.wrap(controller.Controller, "_judge", judge)
    patch.wrap(controller.Controller, "_count", judge)


@mutant("NUM-004", "NUM-003", wraps=(controller.Controller, "_count"))
def restart_counts_as_a_gap(original: Any, self: Any, block: Any) -> Any:
    """The numbers between the last block and one with RESTART count as lost: what was last is not forgotten first."""
    return original(self, block._replace(restart=False))


@mutant("NUM-004", "USB-026", wraps=(controller.Controller, "new_session"))
def number_survives_a_new_session(original: Any, self: Any, door: Any) -> None:
    """The last number is kept over a bus reset, SET_CONFIGURATION and SET_INTERFACE: only power-up forgets it."""
    last = self._last_sequence
    original(self, door)
    self._last_sequence = last


@mutant("NUM-002", "NUM-003", wraps=(controller.Controller, "_judge"))
def refused_number_is_the_last(original: Any, self: Any, block: Any, *rest: Any) -> None:
    """The number of a block that is refused for its contents is taken for the last: it is kept before the judgement."""
    try:
        original(self, block, *rest)
    except BlockError as error:
        if error.reason != Reason.SEQUENCE:
            self._last_sequence = block.sequence
        raise


@mutant("NUM-002", wraps=(controller.Controller, "_judge"))
def refused_sequence_is_the_last(original: Any, self: Any, block: Any, *rest: Any) -> None:
    """A block that is refused with SEQUENCE moves the count back: the last number that was seen counts."""
    try:
        original(self, block, *rest)
    except BlockError as error:
        if error.reason == Reason.SEQUENCE:
            self._last_sequence = block.sequence
        raise
