"""A referee of the emulated device: its allowed answers and the times of its changes, written from SPEC.md alone.

It shares no code with the implementation and knows only what a host sees: the blocks and requests that were
sent, the core cycle (2.5 ns since period 0) at which each had arrived, and what came back. It holds every answer
against the clauses, and then what the outputs did against the oracle of ticks. If the specification leaves a device a
choice, such as the boundary at which it falls silent, the referee accepts all that is allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from typing import NamedTuple

import numpy as np

from tests import from_spec as spec
from tests.tick_oracle import Change, Item, Pulses, Words, modulating, period_words, playing

TICK, PERIOD, MS = 200, 10_000, 400_000
"""Core cycles (BUD-001)."""
SORT, HOPS, RASTERISE, MODULATE = 7000, 400, 4400, 5424
"""Core cycles of the stages of an update's way (BUD-003, BUD-006)."""
SLICES, COMMITS, PROGRAMS = 520, 160, 250
"""Tokens of a change's messages on the first link (CHN-006, CHN-019)."""
UPDATE = SLICES + COMMITS
END_MODULATION, SILENCE, DISABLE = 1, 2, 3
OFF, READY, PLAYING, UNATTENDED = range(4)
DISABLED, SEQUENCE, HORIZON, RATE, DRIVE, EMPTY, IN_USE = range(10, 17)
LATE, GAP = 1, 2
WATCHDOG_FIRED, SEQUENCE_PLAYS, MODULATION_PLAYS = 1, 2, 4
CHANGES = (spec.UPDATE, spec.SEQUENCE, spec.MODULATION, spec.OUTPUT)


class Silencing(NamedTuple):
    """DISABLE, or an event that acts like it."""

    cycle: int


class Window(NamedTuple):
    """The periods at which a change may take effect."""

    first: int
    last: int


def boundary_after(cycle: int) -> int:
    """The first period that does not begin before a core cycle."""
    return -(-cycle // PERIOD)


def replaces(later: Change, change: Change) -> bool:
    """Whether a change replaces the pulses or the modulation of another (BLK-012)."""
    return later.samples is not None if change.steps is None else later.steps is not None


class Referee:
    """Watches a device from its door, given its answers to INFO and WIRING.

    A device whose own times are longer than those of BUD-003 plans with them (BUD-001): it may be some periods later.
    """

    def __init__(self, info: spec.Fields, wiring: Sequence[int], slack_periods: int = 0) -> None:
        self.slack = slack_periods
        self.token = (4 if info["link_wires"] == 5 else 10) * info["cycles_per_symbol"]
        self.turn: int = info["periods_per_update"]
        self.capacity: int = info["queue_blocks"]
        self.limit = 1000 * info["drive_limit"]
        self.wiring = tuple(wiring)
        assert sorted(wiring) == list(range(320)), "REQ-004: each channel occurs once"
        self.enabled = self.fired = False
        self.changes: list[Change] = []
        """Accepted since the outputs were last enabled."""
        self.past: list[Change | Silencing] = []
        self.silenced_at = -(10**9)
        self.fading: frozenset[Item] = frozenset()
        """Items that DISABLE has yet to silence (BLK-022)."""
        self.slots: dict[int, Pulses] = {}
        self.entries: dict[int, tuple[int, int]] = {}
        self.samples: dict[int, int] = {}
        self.last_number: int | None = None
        self.last_named: int | None = None
        self.watchdog: int = info["watchdog_ms"] * MS
        self.watchdog_set = self.sign_of_life = 0
        self.loads_done = 0
        """The core cycle by which all stores have gone to the processors, at the latest (BUD-007)."""
        self.accepted = self.refused = self.late = self.lost = self.last_refusal = 0
        self.seen = 0
        """The core cycle up to which the ends of sequences have been reported."""

    # Events at the device

    def enable(self, cycle: int) -> None:
        """The request ENABLE arrives (REQ-005, STA-003)."""
        self.advance(cycle)
        self.sign_of_life = cycle
        if not self.enabled:
            self.enabled, self.fired, self.last_named = True, False, None

    def disable(self, cycle: int) -> None:
        """The request DISABLE arrives, or something acts like it (SAF-004)."""
        self.advance(cycle)
        if self.enabled:
            self.fading = self.guarded(cycle) | (self.fading if self.fades(cycle) else frozenset())
            self.past += [*self.changes, Silencing(cycle)]
            self.silenced_at = cycle
            self.changes = []
            self.enabled = False

    def advance(self, cycle: int) -> None:
        """Time has passed: an OUTPUT that disables may have taken effect (BLK-018)."""
        for place, change in enumerate(self.changes):
            if change.disables and change.period * PERIOD <= cycle:
                self.past += self.changes[: place + 1]
                self.changes = []
                self.enabled = False
                return

    def set_watchdog(self, cycle: int, ms: int) -> None:
        """The request WATCHDOG arrives (REQ-009)."""
        self.watchdog, self.watchdog_set = ms * MS, cycle

    def set_limit(self, cycle: int, transducers: int, stalled: bool) -> None:
        """The request LIMIT arrives (REQ-010)."""
        self.advance(cycle)
        assert stalled == self.enabled, "REQ-010: STALL while the outputs are enabled"
        if not stalled:
            self.limit = 1000 * transducers

    # The present state

    def state(self, cycle: int) -> int:
        """The state (STA-003)."""
        self.advance(cycle)
        if not self.enabled:
            return OFF
        change = playing(self.changes, cycle // PERIOD)
        if change is None:
            return READY
        return UNATTENDED if change.unattended else PLAYING

    def end_of(self, place: int) -> float:
        """The period at which the change in a place of `changes` ends, by itself or by a later one (BLK-012)."""
        change = self.changes[place]
        same = [later for later in self.changes[place + 1 :] if replaces(later, change)]
        return min([change.end, *(later.period for later in same)])

    def guarded(self, cycle: int) -> frozenset[Item]:
        """The items that an accepted sequence or modulation plays or will play (BLK-022)."""
        last = [change.guards for place, change in enumerate(self.changes) if cycle < self.end_of(place) * PERIOD]
        return frozenset[Item]().union(*last)

    def modulated(self, cycle: int) -> tuple[bool, bool]:
        """Whether there is a modulation for sure, and whether there may be one (BUD-006)."""
        on = modulating(self.changes, cycle // PERIOD) is not None
        pending = [change for change in self.changes if change.period * PERIOD > cycle and change.samples is not None]
        return on and not pending, on or self.fades(cycle) or any(change.samples for change in pending)

    def deadline(self, cycle: int) -> float:
        """The core cycle at which the watchdog's time is over, as far as is known at another (SAF-003, SAF-005)."""
        begins = self.sign_of_life
        for place, change in enumerate(self.changes):
            end = self.end_of(place) * PERIOD
            rests = change.unattended and change.period * PERIOD <= max(begins + self.watchdog, self.watchdog_set)
            if rests and end > cycle:
                return float("inf")
            if rests:
                begins = max(begins, int(end))
        return max(begins + self.watchdog, self.watchdog_set)

    # Judging blocks

    def reasons(self, cycle: int, data: bytes) -> set[int]:
        """The reasons that a device may give for a block (ACK-003)."""
        self.advance(cycle)
        reason = spec.judge_block(data)
        if reason:
            return {reason}
        block = spec.read_block(data)
        kind, named = block["kind"], block["period"]
        if kind in CHANGES and not self.enabled:
            return {DISABLED}
        fresh = block["flags"] & spec.RESTART or self.last_number is None
        if not fresh and not spec.follows(block["sequence"], self.last_number or 0):
            return {SEQUENCE}
        if kind in CHANGES and named > cycle // PERIOD + 2**32:
            return {HORIZON}
        if kind == spec.UPDATE and self.last_named is not None and 0 < named - self.last_named < self.turn:
            return {RATE}
        if any(spec.total_drive(pulses) > self.limit for pulses in self.pulses_of(block)):
            return {DRIVE}
        if any(not self.holds(item) for item in self.items_played(block)):
            return {EMPTY}
        overwritten = self.items_stored(block)
        if overwritten & self.guarded(cycle):
            return {IN_USE}
        return {IN_USE, 0} if overwritten & self.fading and self.fades(cycle) else {0}

    def holds(self, item: Item) -> bool:
        """Whether an item was stored (BLK-021)."""
        name, place = item
        stores: dict[str, Container[int]] = {"slot": self.slots, "entry": self.entries, "sample": self.samples}
        return place in stores[name]

    def pulses_of(self, block: spec.Fields) -> list[Pulses]:
        """The pulses that a block stores or would play (SAF-006)."""
        if "pulses" in block:
            return [tuple(block["pulses"])]
        return [self.slots[place] for name, place in self.items_played(block) if name == "slot" and place in self.slots]

    def items_stored(self, block: spec.Fields) -> frozenset[Item]:
        """Items that a store writes (BLK-013, BLK-014, BLK-016)."""
        first, count, kind = block["first"], block["count"], block["kind"]
        if kind == spec.SLOT:
            return frozenset({("slot", first)})
        name = {spec.ENTRIES: "entry", spec.SAMPLES: "sample"}.get(kind)
        return frozenset((name, first + place) for place in range(count)) if name else frozenset()

    def items_played(self, block: spec.Fields) -> frozenset[Item]:
        """Items that a sequence or a modulation plays (BLK-021)."""
        places = range(block["first"], block["first"] + block["count"])
        if block["kind"] == spec.SEQUENCE:
            slots = {self.entries[place][0] for place in places if place in self.entries}
            return frozenset([*(("entry", place) for place in places), *(("slot", slot) for slot in slots)])
        return frozenset(("sample", place) for place in places if block["kind"] == spec.MODULATION)

    def change(self, block: spec.Fields, period: int) -> Change:
        """The accepted change of a block."""
        kind, items = block["kind"], self.items_played(block)
        places = range(block["first"], block["first"] + block["count"])
        if kind == spec.UPDATE:
            return Change(period, ((tuple(block["pulses"]), 1),), tokens=UPDATE)
        if kind == spec.SEQUENCE:
            entries = [self.entries[place] for place in places]
            return Change(
                period,
                tuple((self.slots[slot], periods) for slot, periods in entries),
                block["repeats"],
                unattended=bool(block["flags"] & spec.UNATTENDED),
                sequence=True,
                tokens=PROGRAMS,
                guards=items,
            )
        if kind == spec.MODULATION:
            samples = bytes(self.samples[place] for place in places)
            return Change(period, samples=samples, hold=block["hold"], tokens=PROGRAMS, guards=items)
        if block["action"] == END_MODULATION:
            return Change(period, samples=b"", tokens=PROGRAMS)
        return Change(period, (), samples=b"", disables=block["action"] == DISABLE, tokens=UPDATE + PROGRAMS)

    def when(self, cycle: int, block: spec.Fields) -> Window:
        """The periods at which a change may take effect (BLK-005, BLK-007, BUD-003, BUD-006, CHN-007).

        For an update on an idle chain there is one. Of programs and silence the specification gives no time line: they
        take at least their time on the chain, and at most five periods if it is idle. An update after a change
        that has not taken effect may wait until it has, with its slices there before if their time suffices.
        """
        kind, named = block["kind"], block["period"]
        surely, maybe = self.modulated(cycle)
        last = self.changes[-1].period if self.changes else 0
        if kind == spec.UPDATE:
            tokens, work = UPDATE, SORT + (MODULATE if surely else RASTERISE)
        elif kind == spec.OUTPUT and block["action"] != END_MODULATION:
            tokens, work = UPDATE + PROGRAMS * surely, 0
        else:
            tokens, work = PROGRAMS, 0
        first = max(named, last + 1, boundary_after(cycle + tokens * self.token + HOPS + work))
        begins = max(last, self.settled())
        if kind != spec.UPDATE:
            waits = boundary_after(self.loads_done) if kind in (spec.SEQUENCE, spec.MODULATION) else 0
            return Window(first, max(named, max(cycle // PERIOD, begins, waits) + 5))
        make = MODULATE if maybe else RASTERISE
        after_update = last > self.settled() and self.changes[-1:] and self.changes[-1].tokens == UPDATE
        slices = max(cycle + SORT, begins * PERIOD - (HOPS + make if after_update else 0))
        commits = max(slices + SLICES * self.token, begins * PERIOD)
        soon = boundary_after(commits + COMMITS * self.token + HOPS + make) + self.slack
        return Window(first, max(named, last + 1, soon))

    def settled(self) -> int:
        """The period by which the last DISABLE has silenced everything (SAF-004)."""
        return self.silenced_at // PERIOD + 6

    def fades(self, cycle: int) -> bool:
        """Whether something that was disabled may still play."""
        return cycle < self.settled() * PERIOD

    def pending(self, cycle: int) -> tuple[int, int]:
        """Least and most changes that have not gone onto the chain (BLK-024, CHN-029)."""
        waiting = [change for change in self.changes if change.period * PERIOD > cycle]
        return sum(self.begins(change) > cycle for change in waiting), len(waiting)

    def begins(self, change: Change) -> int:
        """The first cycle at which a change's messages may begin, on an idle chain (CHN-029)."""
        return int((change.period - 1) * PERIOD - change.tokens * self.token - HOPS - MODULATE)

    def may_wait(self, cycle: int) -> tuple[bool, bool]:
        """Whether a block may be answered with NAK, and whether it must (BLK-009, BLK-024)."""
        self.advance(cycle)
        least, most = self.pending(cycle)
        return most >= self.capacity or self.loads_done > cycle, least >= self.capacity

    def block(self, cycle: int, data: bytes, record: bytes, unsure: int = 0) -> spec.Fields:
        """A block was acknowledged, which had arrived at a core cycle or a few, which are unsure, after it."""
        ack = spec.read_ack(record)
        reasons = self.reasons(cycle, data)
        assert ack["reason"] in reasons, f"at {cycle}: reason {ack['reason']}, not of {reasons}"
        assert ack["sequence"] == spec.number(data, 4, 4)
        assert ack["now"] == cycle // TICK
        assert ack["state"] == self.state(cycle), f"at {cycle}: state {ack['state']}, not {self.state(cycle)}"
        if ack["reason"]:
            assert ack["commit_period"] == ack["flags"] == 0
            self.refused += 1
            self.last_refusal = ack["reason"]
        else:
            self._accept(cycle, spec.read_block(data), ack, unsure)
        self._check_free(cycle, ack["free"], unsure)
        return ack

    def _check_free(self, cycle: int, free: int, unsure: int = 0) -> None:
        (least, _), (_, most) = self.pending(cycle + unsure), self.pending(cycle)
        full_of_stores = free == 0 and self.loads_done > cycle
        assert full_of_stores or self.capacity - most <= free <= self.capacity - least, f"free {free}, {most} wait"

    def _accept(self, cycle: int, block: spec.Fields, ack: spec.Fields, unsure: int) -> None:
        self.accepted += 1
        self.sign_of_life = cycle
        fresh = block["flags"] & spec.RESTART or self.last_number is None
        missing = 0 if fresh else spec.missing(block["sequence"], self.last_number or 0)
        self.lost += missing
        self.last_number = block["sequence"]
        late = False
        commit = ack["commit_period"]
        if block["kind"] in CHANGES:
            window = Window(self.when(cycle, block).first, self.when(cycle + unsure, block).last)
            assert window.first <= commit <= window.last, f"at {cycle}: period {commit}, not of {window} for {block}"
            late = 0 < block["period"] < commit
            self.late += late
            if block["kind"] == spec.UPDATE and block["period"]:
                self.last_named = block["period"]
            self.changes.append(self.change(block, commit))
        elif block["kind"] == spec.CLOCK:
            assert commit == cycle // PERIOD // 4096 * 4096, "BLK-019"
        else:
            assert commit == 0
        assert ack["flags"] == LATE * late + GAP * bool(missing), f"at {cycle}: flags {ack['flags']}"
        self._keep(cycle, block)

    def _keep(self, cycle: int, block: spec.Fields) -> None:
        """The items of a store go to the processors, in loads (BUD-007)."""
        first = block["first"]
        if block["kind"] == spec.SLOT:
            self.slots[first] = tuple(block["pulses"])
        self.entries |= dict(enumerate(block.get("entries", ()), first))
        self.samples |= dict(enumerate(block.get("samples", b""), first))
        per_load = {spec.SLOT: 1, spec.ENTRIES: 12, spec.SAMPLES: 48}.get(block["kind"])
        if per_load is not None:
            loads = 10 * -(-(block["count"] or 1) // per_load)
            beside_updates = self.turn * PERIOD // (9 if self.turn == 1 else 5)
            self.loads_done = max(self.loads_done, cycle) + loads * beside_updates

    # Status

    def status(self, cycle: int, record: bytes, *, asked: bool) -> spec.Fields:
        """A status record was made, by a request or of the device's own accord (REQ-003, ACK-006)."""
        status = spec.read_status(record)
        if not asked and status["flags"] & WATCHDOG_FIRED and not self.fired:
            self._watchdog(status["now"])
        period = cycle // PERIOD
        change = playing(self.changes, period) if self.enabled else None
        modulation = modulating(self.changes, period) if self.enabled else None
        state = self.state(cycle)
        fading = self.fades(cycle)
        expected = {
            "state": state,
            "faults": 0,
            "last_refusal": self.last_refusal,
            "since_period": change.period if change else 0,
            "accepted": self.accepted,
            "refused": self.refused,
            "late": self.late,
            "lost": self.lost % 2**32,
            "missed_commits": 0,
            "damaged_messages": 0,
            "drive_limit": self.limit // 1000,
            "watchdog_ms": self.watchdog // MS,
            "now": cycle // TICK,
        }
        if fading:
            del expected["since_period"]
        found = {name: status[name] for name in expected}
        wrong = {name: (found[name], expected[name]) for name in expected if found[name] != expected[name]}
        assert not wrong, f"at {cycle} a status has, and should have: {wrong}"
        fired = WATCHDOG_FIRED * self.fired
        sequence = SEQUENCE_PLAYS * bool(change and change.sequence)
        if not fading:
            assert status["flags"] == fired + sequence + MODULATION_PLAYS * bool(modulation), f"at {cycle}: {status}"
        self._check_free(cycle, status["free"])
        if asked:
            self.sign_of_life = cycle
        return status

    def _watchdog(self, tick: int) -> None:
        """The watchdog has fired, in a tick (SAF-003)."""
        cycle = tick * TICK
        deadline = self.deadline(cycle)
        assert cycle + TICK > deadline, f"the watchdog fired at {cycle}, before {deadline}"
        assert cycle <= deadline + PERIOD, f"the watchdog fired at {cycle}, more than a period after {deadline}"
        self.disable(cycle)
        self.fired = True

    def poll(self, cycle: int, records: Sequence[bytes]) -> None:
        """Unsolicited records have come up to now (ACK-006)."""
        for record in records:
            self.status(spec.read_status(record)["now"] * TICK, record, asked=False)
        self.advance(cycle)
        assert not self.enabled or cycle <= self.deadline(cycle) + PERIOD, f"at {cycle} the watchdog has not fired"
        told = max([spec.read_status(record)["now"] * TICK for record in records], default=-1)
        ends = [change.end * PERIOD for change in self.changes if change.repeats and self._plays_out(change)]
        ends = [end for end in ends if self.seen < end <= cycle]
        assert max(ends, default=-1) <= told, f"the end of a sequence at {ends} was not told"
        self.seen = cycle

    def _plays_out(self, change: Change) -> bool:
        """Whether a sequence is not replaced before or at the end of its last repeat."""
        end = int(change.end)
        replaced = any(other.period == end and other.steps is not None for other in self.changes)
        return playing(self.changes, end - 1) is change and not replaced

    # Bits

    def check_bits(self, bits: Callable[[int, int], Words], first: int, last: int) -> None:
        """Compare the bits of the ports in periods first to last - 1 with the expected ones."""
        actual = bits(first * 50, last * 50).reshape(-1, 50, 10)

        def differs(changes: Sequence[Change], begin: int, end: int) -> int | None:
            for period in range(max(begin, first), min(end, last)):
                if not np.array_equal(actual[period - first], period_words(changes, period, self.wiring)):
                    return period
            return None

        items = [*self.past, *self.changes]
        played: list[Change] = []
        done = first
        for place, item in enumerate(items):
            if isinstance(item, Change):
                played.append(item)
                continue
            arrived = item.cycle // PERIOD
            wrong = differs(played, done, arrived + 1)
            assert wrong is None, f"period {wrong} differs"
            played = self._silenced(played, item, items[place + 1 :], differs)
            done = arrived + 1
        wrong = differs(played, done, last)
        assert wrong is None, f"period {wrong} differs"

    def _silenced(
        self,
        accepted: list[Change],
        silencing: Silencing,
        then: Sequence[Change | Silencing],
        differs: Callable[[Sequence[Change], int, int], int | None],
    ) -> list[Change]:
        """The changes that played, ended by silence at one of the six boundaries that SAF-004 allows."""
        arrived = silencing.cycle // PERIOD
        following = min([change.period for change in then if isinstance(change, Change)], default=arrived + 7)
        # The changes accepted next may have been dropped, except those after the last DISABLE
        dropped = max([place for place, item in enumerate(then) if isinstance(item, Silencing)], default=0)
        kept = min([change.period for change in then[dropped:] if isinstance(change, Change)], default=arrived + 7)
        begun = [change for change in accepted if change.period * PERIOD <= silencing.cycle]
        on_chain = [change for change in accepted[len(begun) :] if self._may_be_on_chain(accepted, change, silencing)]
        for count in range(len(on_chain) + 1):
            for silent in range(arrived + 1, min(arrived + 7, kept)):
                heard = [*begun, *on_chain[:count]]
                if count and heard[-1].period >= silent:
                    continue
                ended = [*heard, Change(silent, (), samples=b"")]
                if differs(ended, arrived + 1, min(arrived + 7, following)) is None:
                    return ended
        raise AssertionError(f"not silenced as SAF-004 allows after {silencing.cycle}")

    def _may_be_on_chain(self, accepted: Sequence[Change], change: Change, silencing: Silencing) -> bool:
        """Whether a change's messages may have begun before (CHN-029); crowded ones may begin sooner."""
        crowd = [other for other in accepted if 0 < change.period - other.period <= 3]
        return self.begins(change) - len(crowd) * PERIOD <= silencing.cycle
