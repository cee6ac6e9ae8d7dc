"""Broken timing: when and on which boards changes take effect, and the clocks (chapters TIM and BLK)."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from ....emulator import machine
from ....emulator.boards.processor import Processor
from ....emulator.control import agenda, batches, dispatch
from ....emulator.control.controller import Controller
from ....emulator.control.dispatch import Dispatch
from ....emulator.control.execution import Execution
from ....emulator.control.state_machine import StateMachine
from ....emulator.control.supervisor import Supervisor
from ....emulator.ports.clock import COUNTER_TICKS, BoardClock
from ....protocol.blocks import Update
from ....protocol.board import CYCLES_PER_PERIOD, PROCESSORS_PER_BOARD, TICK_HZ, TICKS_PER_PERIOD
from ....protocol.codes import SYNC_PERIODS, AckFlag
from ....protocol.timing import SORT_CYCLES
from .patching import Patch, mutant
from .seams import Words, one_by_one, see_words

LATE_BOARD = 3


def _put_off(patch: Patch, updates: Any, programs: Any) -> None:
    """Delay changes on each processor by as many periods as these functions return for its place."""

    def play(original: Any) -> Any:
        return lambda self, periods, slices: original(self, periods + updates(self.place), slices)

    @patch.around(Processor, "carry_out")
    def carry_out(original: Any, self: Any, program: Any) -> None:
        original(self, replace(program, period=program.period + programs(self.place)))

    patch.wrap(Processor, "play", play)


@mutant("TIM-003", wraps=(machine.Emulator, "_processor"))
def one_board_is_a_tick_late(original: Any, self: Any, place: int, booted: Any) -> Processor:
    """The outputs of board 3 change a tick after those of the others: its ports were started a tick later."""
    made: Processor = original(self, place, booted)
    if place // PROCESSORS_PER_BOARD == LATE_BOARD:
        made.clock = BoardClock(1)
    return made


@mutant("TIM-003")
def half_of_the_processors_change_a_period_later(patch: Patch) -> None:
    """Updates begin a period later on processors 5 to 9: their commits come after the boundary of the others."""
    _put_off(patch, lambda place: place >= 5, lambda _: 0)


@mutant("TIM-003", "CHN-015")
def one_board_runs_programs_a_period_later(patch: Patch) -> None:
    """Sequences and modulations step a period later on board 2, which counts from when it handled the message."""
    _put_off(patch, lambda _: 0, lambda place: place // PROCESSORS_PER_BOARD == 2)


@mutant("BLK-005", "ACK-002")
def changes_begin_a_period_late(patch: Patch) -> None:
    """Every change begins one period after the one in its acknowledgement: the table is exchanged a period late."""
    _put_off(patch, lambda _: 1, lambda _: 1)


@mutant("BLK-005", "ACK-002")
def changes_begin_a_period_early(patch: Patch) -> None:
    """Every change begins one period before the one in its acknowledgement: periods are counted from 1."""
    _put_off(patch, lambda _: -1, lambda _: -1)


@mutant("BLK-005", "BLK-006", by=see_words)
def changes_begin_within_a_period(words: Any, start: int, stop: int) -> Words:
    """Outputs change to the next update ten ticks into its period: the table is exchanged while the port plays it."""
    ticks = np.arange(start, stop)
    earlier = words(start - TICKS_PER_PERIOD, stop)
    before, now = earlier[:-TICKS_PER_PERIOD], earlier[TICKS_PER_PERIOD:]
    mixed: Words = np.where((ticks % TICKS_PER_PERIOD < 10)[:, None], before, now)
    return mixed


@mutant("TIM-004", "TIM-002", by=see_words)
def place_in_the_period_is_that_of_the_counter(words: Any, start: int, stop: int) -> Words:
    """Outputs jump by 14 ticks each 32.768 ms: the port's place in its table follows from a 16-bit counter."""
    first = start // TICKS_PER_PERIOD * TICKS_PER_PERIOD
    last = -(-stop // TICKS_PER_PERIOD) * TICKS_PER_PERIOD
    ticks = np.arange(start, stop)
    played = ticks - ticks % TICKS_PER_PERIOD + ticks % COUNTER_TICKS % TICKS_PER_PERIOD
    jumped: Words = words(first, last)[played - first]
    return jumped


@mutant("TIM-002", wraps=(Dispatch, "now_tick"))
def ticks_are_lost_at_sync_pulses(original: Any, self: Any) -> int:
    """Reported ticks lose one on the outputs with each sync pulse, at which the timer stands still."""
    ticks: int = original(self)
    return ticks - ticks // (SYNC_PERIODS * TICKS_PER_PERIOD)


@mutant("TIM-002", wraps=(Dispatch, "now_tick"))
def wraps_of_the_counter_are_counted_in_a_byte(original: Any, self: Any) -> Any:
    """The tick in acknowledgements, STATUS and CLOCK wraps after 8.4 s: 16 bits of the port, 8 bits of wraps."""
    return original(self) % 2**24


@mutant("TIM-002", "USB-026")
def ticks_begin_anew_with_a_session(patch: Patch) -> None:
    """Ticks count from the last SET_CONFIGURATION or bus reset: a new session restarts the counter."""

    @patch.around(StateMachine, "new_session")
    def new_session(original: Any, self: Any, door: Any) -> None:
        original(self, door)
        vars(self._dispatch)["session_tick"] = 0
        vars(self._dispatch)["session_tick"] = self._dispatch.now_tick

    def now(original: Any) -> Any:
        return lambda self: original(self) - vars(self).get("session_tick", 0)

    patch.wrap(Dispatch, "now_tick", now)


@mutant("TIM-002", wraps=(Dispatch, "now_tick"))
def clock_is_read_in_two_halves(original: Any, self: Any) -> int:
    """For 50 µs in 32.768 ms the clock goes back by 2¹⁶ ticks: its upper half was read before the lower one wrapped."""
    tick: int = original(self)
    return tick - COUNTER_TICKS * (tick >= COUNTER_TICKS and tick % COUNTER_TICKS < 100)


@mutant("TIM-002", wraps=(Dispatch, "now_tick"))
def clock_wraps_at_32_bits(original: Any, self: Any) -> int:
    """After 36 minutes of play the clock begins again at 0: the ticks are counted in a word."""
    return int(original(self)) % 2**32


@mutant("TIM-002", wraps=(Dispatch, "now_tick"))
def clock_stands_still_after_a_while(original: Any, self: Any) -> int:
    """Ten seconds after the start the clock stands still: the counter saturates."""
    return min(int(original(self)), 10 * TICK_HZ)


@mutant("TIM-002")
def clock_is_set_by_a_question(patch: Patch) -> None:
    """PROCESSORS sets the clock back by 33 ms: asking the boards holds up the interrupt that counts its wraps."""
    lost = "lost_ticks"

    @patch.around(Supervisor, "reports")
    def reports(original: Any, self: Any) -> Any:
        vars(self._schedule)[lost] = vars(self._schedule).get(lost, 0) + COUNTER_TICKS
        return original(self)

    def now(original: Any) -> Any:
        return lambda self: max(original(self) - vars(self).get(lost, 0), 0)

    patch.wrap(Dispatch, "now_tick", now)


@mutant("BLK-005", "BLK-010", wraps=(Dispatch, "plan"), also=one_by_one)
def periods_are_compared_in_32_bits(original: Any, self: Any, requested: Any, *rest: Any, **more: Any) -> Any:
    """A change for a period beyond 2³² plays at once: after the judgement the upper half of the period is cut off."""
    return original(self, requested % 2**32, *rest, **more)


# Late changes


@mutant("BLK-005", wraps=(Dispatch, "plan"), also=one_by_one)
def late_changes_are_dropped(original: Any, self: Any, requested: int, *rest: Any, **more: Any) -> Any:
    """A late change is acknowledged, counted and never played."""
    change = original(self, requested, *rest, **more)
    if change.late:
        change.packed, change.programs, change.effect = None, (), None
    return change


@mutant("BLK-005", "ACK-004", wraps=(Controller, "_ack"), also=one_by_one)
def late_is_not_said(original: Any, *arguments: Any) -> Any:
    """Late changes are counted, and no acknowledgement says so."""
    said = original(*arguments)
    return replace(said, flags=said.flags & ~AckFlag.LATE)


@mutant("BLK-005", "REQ-003", wraps=(Controller, "accept"), also=one_by_one)
def late_is_not_counted(original: Any, self: Any, *arguments: Any) -> None:
    """Acknowledgements have the flag LATE, but STATUS counts no late changes."""
    late = self._device.late
    original(self, *arguments)
    self._device.late = late


@mutant("BLK-005", wraps=(Execution, "carry_out"))
def late_is_said_of_updates_alone(original: Any, self: Any, body: Any, door: Any) -> Any:
    """A late SEQUENCE, MODULATION or OUTPUT is played and counted without the flag LATE: only updates set it."""
    change = original(self, body, door)
    if change is not None and change.late and not isinstance(body, Update):
        change.late = False
        self._device.late += 1
    return change


@mutant("BLK-005", "ACK-004", wraps=(agenda, "is_late"), also=one_by_one)
def as_soon_as_possible_is_late(_: Any, requested: int, period: int) -> bool:
    """A change as soon as possible counts as late and is reported so: period 0 is compared like any other."""
    return requested < period


@mutant("BLK-005")
def fifth_period_is_not_met(patch: Patch) -> None:
    """A change needs eight periods after its arrival: the sorting loop runs every 125 µs."""
    for module in (batches, dispatch):
        patch.replace(module, "SORT_CYCLES", SORT_CYCLES + 5 * CYCLES_PER_PERIOD)


@mutant("BLK-007", wraps=(agenda.Agenda, "add"), also=one_by_one)
def change_for_an_earlier_period_overtakes(
    original: Any, self: Any, ready: int, requested: int, *rest: Any, **more: Any
) -> Any:
    """A change that names an earlier period than a queued one takes effect before it: the queue is sorted."""
    queued = list(self._changes)
    later = [item for item in queued if item.period > requested]
    if not requested or not later or requested in [item.period for item in queued]:
        return original(self, ready, requested, *rest, **more)
    tail, before = self.tail, [item for item in queued if item.period < requested]
    self.tail = before[-1].tail if before else self._settled
    change = original(self, ready, requested, *rest, **more)
    if change.period >= later[0].period:  # it cannot be met: after all others
        self._changes.pop()
        self.recent = np.insert(self.recent[:-1], 0, self.recent[0])
        self.tail = tail
        return original(self, ready, requested, *rest, **more)
    self._changes = deque([*before, change, *later])
    self.recent.sort()
    self.tail = tail
    return change


@mutant("BLK-007", wraps=(agenda.Agenda, "add"), also=one_by_one)
def change_for_the_same_period_takes_the_place_of_the_other(
    original: Any, self: Any, ready: int, requested: int, *rest: Any, **more: Any
) -> Any:
    """Of two changes for one period both begin then, and both are in time: the later one wins at the boundary."""
    tail = self.tail
    if requested and tail.period == requested and self._changes:
        self.tail = tail._replace(period=requested - 1, table=min(tail.table, requested - 1))
    return original(self, ready, requested, *rest, **more)
