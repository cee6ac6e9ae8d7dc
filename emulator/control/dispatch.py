"""Dispatch: plans changes, lets them and the stores go onto the chain in time, and lets what is due take effect.

It owns all that waits: the `Agenda` of changes, the loads of stores (`Loading`), and whoever waits for room. A change
carries with it what it means to the device, as a function that is called when it takes effect; what that is, this
module does not know. It judges no block and changes neither the state nor a fault.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from ...protocol.board import CORE_HZ, PROCESSORS
from ...protocol.chain import SLICE_BYTES, Load, Program
from ...protocol.codes import Memory, State
from ...protocol.timing import SORT_CYCLES, Budget
from ..ports.clock import Timebase
from ..scheduler import Scheduler
from .agenda import QUEUE_BLOCKS, Agenda, Change, Effect
from .chain import Chain
from .device_state import DeviceState
from .store_loading import Loading
from .stores import Stores

__all__ = ["SILENCE", "STOP_MODULATION", "Dispatch"]

QUEUE_BITS = QUEUE_BLOCKS.bit_length()
STORES = 16
"""Stores that may wait to go onto the chain before the device answers NAK."""
WAKE_CYCLES = CORE_HZ
SILENCE = bytes(PROCESSORS * SLICE_BYTES)
STOP_MODULATION = Program(0, Memory.SAMPLES, 0, 0, 0)


class Dispatch:
    """What waits for the chain, and for its period."""

    def __init__(
        self,
        scheduler: Scheduler,
        time: Timebase,
        chain: Chain,
        device: DeviceState,
        *,
        log: Callable[[str], None],
        on_wake: Callable[[], None],
    ) -> None:
        self.scheduler = scheduler
        self.time = time
        self.chain = chain
        self.agenda = Agenda(time, chain.link)
        self.stores = Stores()
        self.loading = Loading(scheduler, time, chain, self.agenda, self.settle, self.announce_room)
        self.periods_per_update = Budget.of(chain.link).periods_per_update
        self.commits_due = 0
        """Commits that must have taken effect, or been missed, at each processor."""
        self.disabled_from: int | None = None
        """Period from which on the outputs are disabled by a block that was accepted."""
        self._device = device
        self._log = log
        self._on_wake = on_wake
        self._wakes_at: int | None = None
        self._turn = 0  # advanced with each time that it is to wake; earlier ones count no more
        self._room_waiters: list[Callable[[], None]] = []

    # Time

    @property
    def now(self) -> int:
        """Core cycle."""
        return self.scheduler.now

    @property
    def now_tick(self) -> int:
        """Ticks since period 0."""
        return self.time.tick(self.scheduler.now)

    @property
    def period(self) -> int:
        """The period that it is."""
        return self.time.period(self.scheduler.now)

    def settle(self) -> None:
        """Let everything that is planned up to now have taken effect."""
        for item in self.agenda.due(self.now):
            if isinstance(item, Change):
                if item.folded:
                    self.chain.apply(item)
                self.commits_due += item.packed is not None
                if item.effect is not None:
                    item.effect(item.period)
            else:
                batch, begun = item
                self.chain.apply(batch, begun)
                self.commits_due += batch.next - begun
                if batch.effect is not None:
                    batch.effect(int(batch.periods[batch.next - 1]))

    def plan_to_wake(self) -> None:
        """Come back when the next thing takes effect that somebody could notice.

        A far one is approached in steps, as plans change: nothing that was planned once is left behind for years.
        """
        effect = self._next_effect
        if effect is None:
            return
        at = max(self.now, min(effect, self.now + WAKE_CYCLES))
        if self._wakes_at is None or at < self._wakes_at:
            self._wakes_at = at
            self._turn += 1
            self.scheduler.at(at, partial(self._wake, self._turn))

    @property
    def _next_effect(self) -> int | None:
        """Core cycle; None if nothing is planned, or only that another update takes the place of one that plays."""
        effects, run = [], self._device.runs
        more_of_the_same = self._device.state is State.PLAYING and run is None and self.agenda.only_updates
        if self.agenda and not more_of_the_same:
            effects.append(self.time.boundary(self.agenda.first_period))
        if run is not None and run.ends is not None:
            effects.append(self.time.boundary(run.ends))
        return min(effects, default=None)

    def _wake(self, turn: int) -> None:
        if turn != self._turn:
            return
        self._wakes_at = None
        self.settle()
        self._on_wake()
        self.plan_to_wake()

    # Room

    @property
    def has_room(self) -> bool:
        """Whether there is room for another block (clause BLK-009)."""
        return self.agenda.room_at <= self.now and self.loading.blocks < STORES

    @property
    def free(self) -> int:
        """Changes that can still be queued."""
        return QUEUE_BLOCKS - self.agenda.queued(self.now) if self.loading.blocks < STORES else 0

    def await_room(self, waiter: Callable[[], None]) -> None:
        """Call somebody once, as soon as there is room for another block."""
        self._room_waiters.append(waiter)
        if self.agenda.room_at > self.now:
            self.scheduler.at(self.agenda.room_at, self.announce_room)

    def announce_room(self) -> None:
        """Call those who wait, if there is room."""
        if self.has_room:
            waiters, self._room_waiters = self._room_waiters, []
            for waiter in waiters:
                waiter()

    def trace_queue(self) -> None:
        """Tell the tracer how much is queued."""
        self.chain.tracer.value(self.now, "controller.queue", QUEUE_BITS, self.agenda.queued(self.now))

    # Onto the chain

    def plan(
        self,
        requested: int,
        packed: bytes | None,
        programs: tuple[Program, ...],
        effect: Effect,
        *,
        sequences: bool = False,
        modulations: bool = False,
        is_update: bool = False,
    ) -> Change:
        """Plan a change, which ends what plays of these sorts; for the others see `Agenda.add`."""
        ready = self.now + SORT_CYCLES
        if self.loading and any(program.count for program in programs):
            ready = max(ready, self.agenda.loads_gone(ready, len(self.loading)))
        if self.disabled_from is not None:  # what is accepted after that is dropped by then (clause BLK-018)
            ready = max(ready, self.time.boundary(self.disabled_from) + 1)
        change = self.agenda.add(
            ready, requested, packed, programs, effect, folded=self.chain.folded, is_update=is_update
        )
        self.stores.end(change.period, sequences=sequences, modulations=modulations)
        self._schedule(change)
        self._log(f"sorted, planned for period {change.period}")
        return change

    def send_silence(self, stops: tuple[Program, ...]) -> None:
        """Silence all outputs as soon as the chain can."""
        # A load or a question may just have begun.
        ready = max(self.now, self.loading.leaves) + self.agenda.question_cycles
        change = self.agenda.add(ready, 0, SILENCE, stops, None, folded=self.chain.folded, asked=False)
        self.stores.end(change.period, sequences=True, modulations=True)
        self._schedule(change)

    def store(self, loads: Sequence[Load]) -> None:
        """Let the loads of a block go to the processors between changes, once they are sorted."""
        self.loading.add(loads, self.now + SORT_CYCLES)

    def drop(self) -> None:
        """Drop what is queued; what is under way means nothing any more (clause SAF-004)."""
        self.agenda.drop_queued(self.now)
        self.agenda.mute()
        self.loading.wake()
        self.disabled_from = None

    def _schedule(self, change: Change) -> None:
        if not change.folded:
            self.scheduler.at(change.start, lambda: self._send(change))
        self.plan_to_wake()

    def _send(self, change: Change) -> None:
        self.trace_queue()
        if any(item is change for item in self.agenda):
            self.chain.send(change)

    def unfold(self) -> None:
        """From now on let every message travel."""
        self.chain.folded = False
        for item in self.agenda:  # what is under way arrives as it would have
            self.scheduler.at(self.time.boundary(item.tail.period), self.settle)
        for change in self.agenda.unfold(self.now):
            self._schedule(change)

    # Questions in between

    def question_time(self) -> int:
        """When a question to a processor can go without holding up a change; loads make way for it."""
        asking = self._gap_for_question()
        self.loading.make_way(asking)
        return asking

    def reading_time(self) -> int:
        """The earliest time for a question about what a processor plays.

        The question delays no change, and no load that a planned program needs.
        """
        asking = self._gap_for_question()
        return max(asking, self.agenda.loads_gone(self.now, len(self.loading))) if self.loading else asking

    def _gap_for_question(self) -> int:
        self.settle()
        return self.agenda.gap(max(self.now, self.chain.free_at), self.agenda.question_cycles)
