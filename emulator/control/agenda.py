"""The controller's agenda: what was accepted and has not taken effect, planned to the core cycle.

It says when each change goes onto the chain and at which period it takes effect, when the queue has room, and when the
stores that wait can have gone. It sends nothing itself.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import CYCLES_PER_MS, PROCESSORS
from ...protocol.chain import Collect, Load, Program
from ...protocol.codes import Memory
from ...protocol.timing import (
    HOP_CYCLES,
    MODULATE_CYCLES,
    RASTERISE_CYCLES,
    Link,
    slices_cycles,
    update_cycles,
)
from ..ports.clock import Timebase
from .planning import Cost, is_late, plan

__all__ = ["QUEUE_BLOCKS", "Agenda", "Change", "Effect", "Tail", "UpdateBatch"]

Effect = Callable[[int], None]
"""Takes the period at which it happens."""

QUEUE_BLOCKS = 32


class Tail(NamedTuple):
    """Where what is planned ends."""

    sent: int = 0
    """Core cycle at which the last change has left the controller."""
    period: int = 0
    """At which the last change takes effect."""
    table: int = 0
    """Of the last change with pulses: until then no other table has room in the processors (clause CHN-007)."""
    programs: tuple[int, int] = (0, 0)
    """At which the last program takes effect, of the sequence and of the modulation."""
    modulated: bool = False
    """Whether there is a modulation then."""


@dataclass(eq=False)
class Change:
    """One change, planned."""

    start: int
    """Core cycle at which it goes onto the chain."""
    period: int
    """At which it takes effect."""
    packed: bytes | None
    """Pulses in the order of the channels, 480 bytes; None if it is programs alone."""
    programs: tuple[Program, ...]
    """For processor 0; the others get the same."""
    effect: Effect | None
    """What it means to the device when it takes effect, None if nothing any more."""
    tail: Tail
    """Where the plan ends with it."""
    folded: bool
    """Whether its way along the chain is taken for granted."""

    is_update: bool = False
    """Whether it is an UPDATE, and no other change."""
    late: bool = False
    """Whether it takes effect after the period that it names, as its acknowledgement says (clause BLK-005)."""


@dataclass(eq=False)
class UpdateBatch:
    """Updates that were accepted one after another, planned together; those before `next` have taken effect."""

    starts: NDArray[np.int64]
    periods: NDArray[np.int64]
    packed: NDArray[np.uint8]
    cost: Cost
    before: Tail
    effect: Effect | None
    next: int = 0

    @property
    def tail(self) -> Tail:
        """Where the plan ends with them."""
        return self.tail_of(len(self.starts))

    def tail_of(self, count: int) -> Tail:
        """Where it ends with the first few of them."""
        if not count:
            return self.before
        sent, period = int(self.starts[count - 1]) + self.cost.occupies, int(self.periods[count - 1])
        return self.before._replace(sent=sent, period=period, table=period)

    def keep(self, count: int) -> None:
        """Drop all but the first few."""
        self.starts, self.periods, self.packed = self.starts[:count], self.periods[:count], self.packed[:count]


class Agenda:
    """What is planned."""

    def __init__(self, time: Timebase, link: Link) -> None:
        self._time = time
        self._link = link
        self._changes: deque[Change | UpdateBatch] = deque()
        self._settled = Tail(sent=time.origin)
        self.tail = self._settled
        self.recent = np.full(QUEUE_BLOCKS, time.origin, np.int64)
        """When the last changes left or leave the queue, oldest first."""

    def __len__(self) -> int:
        return len(self._changes)

    def __iter__(self) -> Iterator[Change | UpdateBatch]:
        return iter(self._changes)

    def queued(self, now: int) -> int:
        """Changes that have not gone onto the chain."""
        return int((self.recent > now).sum())

    @property
    def room_at(self) -> int:
        """Core cycle from which on the queue has room."""
        return int(self.recent[0])

    def cost(self, updates: bool, programs: int, modulated: bool) -> Cost:
        """What a change costs: an update or none, and how many programs for each processor."""
        token = self._link.cycles_per_token
        occupies = updates * update_cycles(self._link) + programs * PROCESSORS * Program.TOKENS * token
        rasterise = RASTERISE_CYCLES + modulated * MODULATE_CYCLES
        return Cost(occupies, occupies + PROCESSORS * HOP_CYCLES + rasterise, slices_cycles(self._link))

    @property
    def update_cost(self) -> Cost:
        """What an update costs after all that is planned."""
        return self.cost(updates=True, programs=0, modulated=self.tail.modulated)

    def add(
        self,
        ready: int,
        requested: int,
        packed: bytes | None,
        programs: tuple[Program, ...],
        effect: Effect | None,
        *,
        folded: bool,
        asked: bool = True,
        is_update: bool = False,
    ) -> Change:
        """Plan a change after all others (chapters BLK and BUD).

        Parameters
        ----------
        ready : int
            Core cycle from which on it can be sent.
        requested : int
            Period that it names, 0 for as soon as possible.
        packed, programs, effect, folded, is_update
            See `Change`; the period of the programs is set.
        asked : bool
            Whether a host asked for it, so that it takes a place in the queue.
        """
        tail, starts = self.tail, {program.memory: bool(program.count) for program in programs}
        modulated = starts.get(Memory.SAMPLES, tail.modulated)
        # What is rasterised under a modulation takes longer: one that ends with this change, or begins with it.
        cost = self.cost(packed is not None, len(programs), modulated or tail.modulated)
        waits = tail.table if packed is not None else 0
        for program in programs:
            # Programs for one memory wait one at a time; after an update they leave later by all of it.
            begun = self._time.boundary(tail.programs[program.memory - Memory.ENTRIES])
            ready = max(ready, begun - (update_cycles(self._link) if packed is not None else 0))
        lead = cost.lead if packed is not None else 0
        start, period = plan(self._time.origin, ready, tail.sent, waits, tail.period, requested, cost.forward, lead)
        programs = tuple(
            Program(0, program.memory, period, program.first, program.count, program.hold, program.repeats)
            for program in programs
        )
        self.tail = Tail(
            start + cost.occupies,
            period,
            period if packed is not None else tail.table,
            (
                period if Memory.ENTRIES in starts else tail.programs[0],
                period if Memory.SAMPLES in starts else tail.programs[1],
            ),
            modulated,
        )
        change = Change(
            start, period, packed, programs, effect, self.tail, folded, is_update, is_late(requested, period)
        )
        self._changes.append(change)
        if asked:
            self.recent = np.append(self.recent[1:], start)
        return change

    def add_batch(self, batch: UpdateBatch) -> None:
        """Take updates that were planned by `batch_kernels.plan_updates`, which has written `recent`."""
        self.tail = batch.tail
        self._changes.append(batch)

    def due(self, now: int) -> Iterator[Change | tuple[UpdateBatch, int]]:
        """What has taken effect meanwhile, in order: changes, and of batches how many more updates."""
        while self._changes:
            first = self._changes[0]
            if isinstance(first, Change):
                if self._time.boundary(first.period) > now:
                    return
                self._changes.popleft()
                self._settled = first.tail
                yield first
                continue
            reached = int(np.searchsorted(first.periods, self._time.period(now), side="right"))
            if reached == len(first.periods):
                self._changes.popleft()
            if reached > first.next:
                begun, first.next = first.next, reached
                self._settled = first.tail_of(reached)
                yield first, begun
            if reached < len(first.periods):
                return

    def drop_queued(self, now: int) -> None:
        """Forget what has not gone onto the chain."""
        kept: deque[Change | UpdateBatch] = deque()
        self.tail = self._settled
        for item in self._changes:
            if isinstance(item, Change):
                if item.start > now:
                    break
                self.tail = item.tail
            else:
                count = int(np.searchsorted(item.starts, now, side="right"))
                item.keep(count)
                self.tail = item.tail_of(count)
                if count == item.next:  # what is left of it has taken effect
                    break
            kept.append(item)
        self._changes = kept
        self.recent[:] = np.minimum(self.recent, now)

    def mute(self) -> None:
        """What is planned means nothing to the device any more; it takes effect all the same."""
        for item in self._changes:
            item.effect = None

    @property
    def only_updates(self) -> bool:
        """Whether nothing but updates is planned."""
        return all(isinstance(item, UpdateBatch) or item.is_update for item in self._changes)

    @property
    def first_period(self) -> int:
        """At which the first of what is planned takes effect; the period of the tail if nothing is."""
        if not self._changes:
            return self.tail.period
        first = self._changes[0]
        return first.period if isinstance(first, Change) else int(first.periods[first.next])

    def unfold(self, now: int) -> list[Change]:
        """Take apart what has not gone onto the chain; these changes, which are folded no more."""
        queued: list[Change] = []
        changes: deque[Change | UpdateBatch] = deque()
        for item in self._changes:
            if isinstance(item, Change):
                if item.start > now:
                    item = replace(item, folded=False)
                    queued.append(item)
                changes.append(item)
                continue
            count = int(np.searchsorted(item.starts, now, side="right"))
            apart = [
                Change(
                    int(item.starts[index]),
                    int(item.periods[index]),
                    item.packed[index].tobytes(),
                    (),
                    item.effect,
                    item.tail_of(index + 1),
                    folded=False,
                    is_update=True,
                )
                for index in range(count, len(item.starts))
            ]
            item.keep(count)
            changes.extend([item, *apart] if count > item.next else apart)
            queued += apart
        self._changes = changes
        return queued

    # Loads fit in between

    @property
    def load_cycles(self) -> int:
        """How long the first link is busy with a load."""
        return Load.TOKENS * self._link.cycles_per_token

    @property
    def question_cycles(self) -> int:
        """How long the first link is busy with a question."""
        return Collect.TOKENS * self._link.cycles_per_token

    def gap(self, begin: int, cycles: int) -> int:
        """The earliest core cycle, from a given one on, at which a message that delays no change can begin."""
        for start, sent in self._busy():
            if sent > begin and start < begin + cycles:
                begin = sent
        return begin

    def _busy(self) -> Iterator[tuple[int, int]]:
        for item in self._changes:
            if isinstance(item, Change):
                yield item.start, item.tail.sent
            else:
                for start in item.starts[item.next :].tolist():
                    yield start, start + item.cost.occupies

    def loads_gone(self, begin: int, loads: int) -> int:
        """Core cycle by which so many loads have left at the latest, if they begin at another and fit in between.

        Questions to the processors go in between too: one a millisecond, after a load that had begun.
        """
        at, left = begin, loads
        for start, sent in self._busy():
            fitting = max(start - at, 0) // self.load_cycles
            if fitting >= left:
                break
            left -= fitting
            at = max(at, sent)
        at += left * self.load_cycles
        questions = 1 + (at - begin) // CYCLES_PER_MS
        return at + questions * (self.load_cycles + self.question_cycles)
