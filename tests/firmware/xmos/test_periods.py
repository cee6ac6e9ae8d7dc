"""The executed processor beside the Python model: words, answers, faults and silence, for random programs of messages.

Times keep clear of the moments at which the two may differ, because a message is dealt with a little after it has come:
the firmware takes what it has dealt with before it decides on a period; the model takes what has come a fixed time
before the boundary.
"""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.protocol.board import CYCLES_PER_PERIOD
from phasewire.protocol.chain import Collect, Commit, Load, Message, Program, Slice, loads
from phasewire.protocol.codes import SYNC_PERIODS, ChannelEnd, Fault, Memory

from .harness import Bench, tokens_of
from .made import literal_words, random_slice
from .pair import Pair

END = 0x101
AMPLE = 9000
"""Cycles before a boundary by which whatever begins there has come."""
KINDS = (
    *4 * ["commit"], "two commits", "commit and sequence", "sequence", "stop", "modulation", "stop modulation",
    "damage", "wrong commit", "late", "playing", "report", "temperature", "supply",
)  # fmt: skip


class Storm:
    """Random messages and events for a pair."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.pair = Pair()
        self.period = 12
        for slot in range(8):
            self.pair.bring(Load(3, Memory.SLOTS, 31 * slot, random_slice(self.rng)), 0)
        entries = np.stack([self.rng.integers(0, 8, 40) * 31, self.rng.integers(0, 4, 40)], axis=1).astype("<u2")
        samples = self.rng.integers(0, 256, 97).astype(np.uint8)
        for load in (
            *loads(3, Memory.ENTRIES, 100, entries.tobytes()),
            *loads(3, Memory.SAMPLES, 1001, samples.tobytes()),
        ):
            self.pair.bring(load, 0)
        self.pair.run_to(10)

    def _number(self, low: int, high: int) -> int:
        return int(self.rng.integers(low, high))

    def _time(self, gap: int = 0) -> int:
        """A time some while after a boundary, when everything that came before has been dealt with."""
        at = self.pair.boundary(self.period) + self._number(500, 3000)
        free = max(self.pair.bench.free_at, self.pair.bench.core.cycle) + gap
        while at < free:
            self.period += 1
            at += CYCLES_PER_PERIOD
        return at

    def step(self) -> None:
        kind = KINDS[self._number(0, len(KINDS))]
        self.period += self._number(1, 4)
        pair, at = self.pair, self._time(1500)
        due = -(-(at + AMPLE - pair.origin) // CYCLES_PER_PERIOD) + self._number(0, 4)
        if kind in ("playing", "report"):
            self.period += 1
            at = self._time(3000)
            pair.run_to(self.period)
            given, wanted = (pair.ask_playing if kind == "playing" else pair.ask)(at)
            assert given == wanted
            self.period = pair.period + 1
        elif kind == "temperature":
            pair.set_temperature(self._number(-40, 128), at)
            pair.bench.free_at = at
        elif kind == "supply":
            pair.set_supply(self._number(9000, 21000), at)
            pair.bench.free_at = at
        elif kind == "damage":
            tokens = tokens_of(Slice(3, random_slice(self.rng)))[: self._number(1, 49)].copy()
            tokens[-1] = END
            pair.damage(self._number(1, 7), tokens, at)
        else:
            for message in self._messages(kind, due):
                pair.bring(message, at)

    def _messages(self, kind: str, due: int) -> list[Message]:
        piece = Slice(3, random_slice(self.rng))
        both: list[Message] = [piece, Commit.of(due, piece)]
        first = self._number(0, 20)
        sequence = Program(3, Memory.ENTRIES, due, 100 + first, self._number(1, 20), 0, self._number(0, 3))
        if kind == "commit":
            return both
        if kind == "two commits":
            other = Slice(3, random_slice(self.rng))
            return [*both, other, Commit.of(due + 1, other)]
        if kind == "commit and sequence":
            both.insert(self._number(0, 3), sequence)
            return both
        if kind == "sequence":
            return [sequence]
        if kind == "stop":
            return [Program(3, Memory.ENTRIES, due, 0, 0)]
        if kind == "modulation":
            return [Program(3, Memory.SAMPLES, due, 1001 + first, self._number(1, 77), self._number(1, 5))]
        if kind == "stop modulation":
            return [Program(3, Memory.SAMPLES, due, 0, 0)]
        if kind == "late":
            return [piece, Commit.of(max(self.period - self._number(0, 3), 0), piece)]
        return [piece, Commit(3, due, self._number(0, 2**32))]

    def cool(self) -> None:
        """All is well again."""
        at = self._time(1500)
        self.pair.set_temperature(25, at)
        self.pair.set_supply(15_000, at)
        self.pair.bench.free_at = at

    def finish(self) -> None:
        pair, last = self.pair, self.period + 30
        pair.run_to(last + 1)
        given, wanted = pair.words(0, last)
        assert not (wrong := np.flatnonzero((given != wanted).any(axis=1))).size, f"periods {wrong[:10]} differ"
        given_report, wanted_report = pair.ask(pair.boundary(last + 2) + 1000)
        assert given_report == wanted_report


@pytest.mark.parametrize("seed", range(12))
def test_it_plays_and_tells_what_the_model_does(seed: int) -> None:
    storm = Storm(seed)
    for number in range(120):
        storm.step()
        if number % 10 == 9:
            storm.cool()
    storm.finish()


@pytest.mark.parametrize("asked", [100_000, 7_000_000])
def test_a_processor_that_is_alone_falls_silent_as_the_model(asked: int) -> None:
    """CHN-018: 50 ms after the last question, and again each 50 ms; a commit plays again."""
    rng = np.random.default_rng(asked)
    pair = Pair()
    pair.run_to(5)
    pair.bring(Collect(3, ChannelEnd.REPORT), pair.origin + asked)
    for period in (720, 5200):
        piece = Slice(3, random_slice(rng))
        pair.bring(piece, pair.boundary(period - 3) + 500)
        pair.bring(Commit.of(period, piece), pair.boundary(period - 3) + 2000)
    pair.bring(Program(3, Memory.SAMPLES, 5000, 0, 0), pair.boundary(4000))
    pair.run_to(6000)
    given, wanted = pair.words(0, 5999)
    assert not (wrong := np.flatnonzero((given != wanted).any(axis=1))).size, f"periods {wrong[:10]} differ"
    assert given[5300].any()
    pair.bench.answers()
    given_report, wanted_report = pair.ask(pair.boundary(6001) + 1000)
    assert given_report == wanted_report


def test_the_boundary_after_50_ms_is_the_first_that_can_be_silent() -> None:
    """Alone since the beginning: due at the boundary of period 2000, silent from the next one on."""
    bench = Bench()
    bench.begin()
    bench.run_to(3)
    packed = random_slice(np.random.default_rng(1))
    bench.commit(6, packed)
    bench.run_to(2010)
    assert bench.words(2000, 2001).any()
    assert not bench.words(2001, 2009).any()


# Faults


@pytest.mark.parametrize("offset", [500, 3000, 5000, 6500, 8000, 8500])
@pytest.mark.parametrize("what", ["temperature", "supply"])
def test_a_fault_silences_at_the_next_boundary_even_after_the_decision(offset: int, what: str) -> None:
    """SAF-007: whatever is being made ready is not played; with a commit for that boundary, and steps of a sequence."""
    rng = np.random.default_rng(offset)
    for stepping in (False, True):
        pair = Pair()
        pair.bring(Load(3, Memory.SLOTS, 0, random_slice(rng)), 0)
        pair.bring(Load(3, Memory.ENTRIES, 0, np.array([0, 1], "<u2").tobytes()), 0)
        pair.run_to(6)
        piece = Slice(3, random_slice(rng))
        if stepping:
            pair.bring(Program(3, Memory.ENTRIES, 9, 0, 1), 0)
        pair.bring(piece, 0)
        pair.bring(Commit.of(13, piece), 0)
        at = pair.boundary(12) + offset
        if what == "temperature":
            pair.set_temperature(86, at)
        else:
            pair.set_supply(11_999, at)
        pair.run_to(20)
        given, wanted = pair.words(0, 19)
        assert np.array_equal(given, wanted)
        assert wanted[12].any() == stepping
        assert not wanted[13].any()
        given_report, wanted_report = pair.ask(pair.boundary(21) + 1000)
        assert given_report == wanted_report
        assert (given_report.missed_commits, given_report.carried_out) == (1, 0)


def test_it_is_too_hot_above_85_degrees() -> None:
    """SAF-008."""
    bench = Bench()
    bench.begin()
    bench.run_to(4)
    for celsius, faults in ((85, 0), (86, Fault.TEMPERATURE), (127, Fault.TEMPERATURE), (85, 0), (-40, 0)):
        bench.set_temperature(celsius, bench.core.cycle + 100)
        bench.run(bench.core.cycle + 3000)
        report = bench.report()
        assert (report.temperature_c, report.faults) == (celsius, faults)


def test_pins_at_the_start_count() -> None:
    bench = Bench(temperature=90, supply=0)
    bench.begin()
    assert bench.report().faults == Fault.TEMPERATURE | Fault.SUPPLY


# The sync line


def asked_until(bench: Bench, period: int) -> None:
    """Ask often enough up to a period."""
    while bench.period < period:
        bench.run_to(min(bench.period + 1000, period))
        bench.report()


def test_a_pulse_in_time_is_no_fault() -> None:
    bench = Bench()
    bench.begin()
    bench.run_to(4)
    packed = random_slice(np.random.default_rng(2))
    bench.commit(8, packed)
    asked_until(bench, 3 * SYNC_PERIODS + 20)
    report = bench.report()
    assert (report.faults, report.drift) == (0, 0)
    assert (bench.words(3 * SYNC_PERIODS, 3 * SYNC_PERIODS + 5) == literal_words(packed)).all()


@pytest.mark.parametrize(
    ("ticks", "drift", "fault"),
    [
        (1, 1, 0),
        (-1, -1, 0),
        (2, 2, Fault.SYNC),
        (-2, -2, Fault.SYNC),
        (300, 127, Fault.SYNC),
        (-300, -128, Fault.SYNC),
    ],
)
def test_a_pulse_off_by_more_than_a_tick_is_a_fault(ticks: int, drift: int, fault: int) -> None:
    """CHN-027; the fault stays, and silences."""
    bench = Bench()
    bench.sync_due = False
    bench.begin()
    bench.run_to(4)
    bench.commit(8, random_slice(np.random.default_rng(3)))
    asked_until(bench, SYNC_PERIODS - 50)
    bench.pulse(bench.boundary(SYNC_PERIODS) + 200 * ticks)
    asked_until(bench, SYNC_PERIODS + 60)
    report = bench.report()
    assert (report.faults, report.drift) == (fault, drift)
    assert bench.words(SYNC_PERIODS + 20, SYNC_PERIODS + 21).any() == (not fault)
    asked_until(bench, SYNC_PERIODS + 1000)
    assert bench.report().faults == fault


def test_offsets_add_up_since_the_start() -> None:
    """A tick late, and another: two together."""
    bench = Bench()
    bench.sync_due = False
    bench.begin()
    for pulse in (1, 2):
        asked_until(bench, pulse * SYNC_PERIODS - 50)
        bench.pulse(bench.boundary(pulse * SYNC_PERIODS) + 200 * pulse)
        asked_until(bench, pulse * SYNC_PERIODS + 60)
        report = bench.report()
        assert (report.drift, report.faults) == (pulse, Fault.SYNC if pulse == 2 else 0)


def test_no_pulse_when_one_is_due_is_a_fault() -> None:
    """CHN-027: silent from the next boundary on."""
    bench = Bench()
    bench.sync_due = False
    bench.begin()
    bench.run_to(4)
    bench.commit(8, random_slice(np.random.default_rng(4)))
    asked_until(bench, SYNC_PERIODS - 10)
    bench.run_to(SYNC_PERIODS + 10)
    assert bench.words(SYNC_PERIODS, SYNC_PERIODS + 1).any()
    assert not bench.words(SYNC_PERIODS + 1, SYNC_PERIODS + 9).any()
    assert bench.report().faults == Fault.SYNC


def test_a_question_before_the_first_pulse_is_a_fault_that_stays() -> None:
    """Who asks has begun its time with a pulse that was not seen; a later pulse would begin another time."""
    bench = Bench()
    bench.take_number(3)
    assert bench.report().faults == Fault.SYNC
    bench.sync()
    bench.run_to(4)
    bench.commit(8, random_slice(np.random.default_rng(5)))
    bench.run_to(20)
    assert not bench.words(0, 19).any()
    assert bench.report().faults == Fault.SYNC


def test_what_is_silenced_carries_commits_out_and_programs_not() -> None:
    """A commit plays silence and counts, a program has no effect, as the model does."""
    rng = np.random.default_rng(6)
    pair = Pair()
    pair.bring(Load(3, Memory.SLOTS, 0, random_slice(rng)), 0)
    pair.bring(Load(3, Memory.ENTRIES, 0, np.array([0, 9], "<u2").tobytes()), 0)
    pair.run_to(5)
    pair.set_supply(19_000, pair.boundary(6) + 500)
    pair.bench.free_at = pair.boundary(6) + 3000
    piece = Slice(3, random_slice(rng))
    for message in (piece, Commit.of(10, piece), Program(3, Memory.ENTRIES, 11, 0, 1)):
        pair.bring(message, 0)
    pair.set_supply(15_000, pair.boundary(13) + 500)
    pair.run_to(20)
    given, wanted = pair.words(0, 19)
    assert np.array_equal(given, wanted)
    assert not given.any()
    given_report, wanted_report = pair.ask(pair.boundary(21) + 1000)
    assert given_report == wanted_report
    assert given_report.carried_out == 1
