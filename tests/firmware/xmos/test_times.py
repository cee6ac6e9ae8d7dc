"""How long everything takes at worst, with and without no-ops for want of instructions, and what that leaves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from phasewire.firmware.xmos.build import load_processor
from phasewire.protocol.board import CYCLES_PER_MS, CYCLES_PER_PERIOD
from phasewire.protocol.chain import Collect, Commit, Load, Message, Program, Slice, loads
from phasewire.protocol.codes import ChannelEnd, Fault, Memory

from .harness import Bench
from .made import literal_words, random_slice

READY_CYCLES = 4400
"""A commit or a sequence that has wholly arrived by then before a boundary plays at it."""
READY_MODULATED_CYCLES = 5424
"""The same while a modulation plays, and for the program that begins the first one."""
BEHIND_CYCLES = 340
"""So much more if the message before it ended just before it begins."""
FETCHES = ("off", "pessimistic")
ISSUE_CYCLES = 4


def told(bench: Bench, field: int) -> int:
    at = load_processor().symbols["told"] - 0x10000 + 4 * field
    return int.from_bytes(bench.core.memory[at : at + 4].tobytes(), "little")


def counts(bench: Bench) -> tuple[int, int]:
    """Missed commits and overruns."""
    return told(bench, 9), told(bench, 12)


def loaded(fetch: str, *, modulated: bool) -> Bench:
    """With slots 0 to 7, entries 0 to 5 of one period each, and 48 samples; under a modulation or not."""
    rng = np.random.default_rng(1)
    bench = Bench(fetch=fetch)
    bench.begin()
    for slot in range(8):
        bench.bring(Load(3, Memory.SLOTS, slot, random_slice(rng)))
    entries = np.array([[0, 1], [1, 1], [2, 1], [3, 1], [4, 1], [5, 1]], "<u2")
    bench.bring(Load(3, Memory.ENTRIES, 0, entries.tobytes()))
    bench.load(loads(3, Memory.SAMPLES, 0, bytes(range(100, 148))))
    bench.run_to(8)
    if modulated:
        bench.bring(Program(3, Memory.SAMPLES, 12, 0, 48, 1))
    bench.run_to(13)
    return bench


def sequence(period: int) -> Program:
    return Program(3, Memory.ENTRIES, period, 1, 3, 0, 0)


def settle(bench: Bench, *, modulated: bool) -> None:
    """Nothing waits, and the modulation is as it should be."""
    bench.run_to(bench.period + 1, 100)
    if not modulated:
        bench.bring(Program(3, Memory.SAMPLES, bench.period + 3, 0, 0))
    bench.run_to(bench.period + 4, 100)


# Ready in time


@pytest.mark.parametrize("fetch", FETCHES)
@pytest.mark.parametrize("modulated", [False, True])
def test_what_arrives_in_time_plays(fetch: str, modulated: bool) -> None:
    """CHN-004: with the chain's order of messages, over all times that count."""
    limit = READY_MODULATED_CYCLES if modulated else READY_CYCLES
    bench = loaded(fetch, modulated=modulated)
    rng = np.random.default_rng(2)
    kinds: dict[str, tuple[Callable[[int, Slice], list[Message]], int, int]] = {
        "commit": (lambda due, piece: [piece, Commit.of(due, piece)], limit, 1280),
        "commit just after its slice": (lambda due, piece: [piece, Commit.of(due, piece)], limit + BEHIND_CYCLES, 0),
        "sequence": (lambda due, _: [sequence(due)], limit, 0),
        "first modulation": (lambda due, _: [Program(3, Memory.SAMPLES, due, 1, 3, 5)], READY_MODULATED_CYCLES, 0),
    }
    for name, (make, least, gap) in kinds.items():
        for before in [*range(least, least + 120, 8), *range(least + 120, least + 900, 61)]:
            due = bench.period + 4
            *first, last = make(due, Slice(3, random_slice(rng)))
            ends = bench.boundary(due) - before
            missed, overruns = counts(bench)
            bench.run(ends - gap - 1200)
            for message in first:
                tokens = 49 if gap else 49 + 3 + 13
                bench.bring(message, ends - gap - 8 * (tokens - 1))
            bench.free_at = 0 if gap else bench.free_at
            bench.bring_by(last, ends)
            bench.run_to(due, 300)
            assert counts(bench) == (missed, overruns), f"{name}, {before} cycles before its boundary"
            settle(bench, modulated=modulated)


@pytest.mark.parametrize("fetch", FETCHES)
@pytest.mark.parametrize("modulated", [False, True])
def test_nothing_makes_a_table_late(fetch: str, modulated: bool) -> None:
    """Whatever begins and whatever comes just before the decision: it is ready in time, or missed, and no overrun."""
    bench = loaded(fetch, modulated=modulated)
    rng = np.random.default_rng(3)

    def modulation(period: int) -> Program:
        return Program(3, Memory.SAMPLES, period, 1, 40, 1)

    for begins in ("commit", "sequence", "sequence, commit", "commit, sequence", "sequence, modulation", "all"):
        for disturbs in ("slice", "program", "modulation", "stop", "wrong commit", "slice, program", "supply"):
            begins_modulated = modulated or begins in ("sequence, modulation", "all")
            decided = 5336 if begins_modulated else 4296
            for before in range(decided - 150, decided + 800, 43):
                due = bench.period + 4
                piece = Slice(3, random_slice(rng))
                parts: dict[str, list[Message]] = {
                    "commit": [piece, Commit.of(due, piece)],
                    "sequence": [sequence(due)],
                    "modulation": [modulation(due)],
                }
                wanted = ["commit", "sequence", "modulation"] if begins == "all" else begins.split(", ")
                overruns = counts(bench)[1]
                bench.free_at = 0
                for message in [message for part in wanted for message in parts[part]]:
                    bench.bring(message)
                others: dict[str, list[Message]] = {
                    "slice": [Slice(3, random_slice(rng))],
                    "program": [sequence(due + 1)],
                    "modulation": [modulation(due + 1)],
                    "stop": [Program(3, Memory.SAMPLES, due + 1, 0, 0)],
                    "wrong commit": [Commit(3, due + 1, 5)],
                    "slice, program": [Slice(3, random_slice(rng)), sequence(due + 1)],
                    "supply": [],
                }
                at = bench.boundary(due) - before
                bench.run(at - 700)
                if disturbs == "supply":
                    bench.set_supply(0, at)
                    bench.set_supply(1, at + 40)
                for message in others[disturbs]:
                    bench.bring(message, at - 52 * 8)
                bench.run_to(due + 1, 300)
                assert counts(bench)[1] == overruns, f"{begins}; {disturbs} {before} cycles before the boundary"
                settle(bench, modulated=modulated)


@pytest.mark.parametrize("fetch", FETCHES)
def test_updates_each_period_hold(fetch: str) -> None:
    """BUD-004: 40 000 updates a second, each with its commit as late as the links allow, under a modulation."""
    bench = loaded(fetch, modulated=True)
    rng = np.random.default_rng(4)
    first = bench.period + 3
    slices = [random_slice(rng) for _ in range(60)]
    for number, packed in enumerate(slices):
        due = first + number
        piece = Slice(3, packed)
        bench.run_to(due - 1, -4000)
        bench.bring(piece, bench.boundary(due - 1) - 2000)
        bench.bring_by(Commit.of(due, piece), bench.boundary(due) - READY_MODULATED_CYCLES)
        for slot in range(3):
            bench.bring(Load(3, Memory.SLOTS, 100 + slot, packed))
        if number % 10 == 5:
            bench.bring(Collect(3, ChannelEnd.PLAYING))
    bench.run_to(first + 61)
    words = bench.words(first, first + 60)
    for number, packed in enumerate(slices):
        sample = 100 + (first + number - 12) % 48
        assert np.array_equal(words[number], literal_words(packed, sample)), f"update {number}"
    assert counts(bench) == (0, 0)
    assert bench.core.held_up == 0


# Tokens


@pytest.mark.parametrize("fetch", FETCHES)
@pytest.mark.parametrize(
    "memory", [Memory.SLOTS, Memory.ENTRIES, Memory.SAMPLES], ids=lambda memory: memory.name.lower()
)
def test_loads_back_to_back_hold_up_no_link(fetch: str, memory: Memory) -> None:
    """CHN-020: ten loads for one processor, a token every 8 cycles, while it rasterises under a modulation."""
    bench = loaded(fetch, modulated=True)
    bench.bring(sequence(bench.period + 3))
    bench.run_to(bench.period + 5)
    for _ in range(4):
        bench.run(bench.core.cycle + 43_000)
        for number in range(10):
            first = (
                20 + number
                if memory is Memory.SLOTS
                else 101 + 48 * number
                if memory is Memory.SAMPLES
                else 12 * number + 10
            )
            bench.bring(Load(3, memory, first, bytes(range(1, 49))))
    bench.run(bench.free_at + 20_000)
    assert bench.core.held_up == 0
    assert bench.report().faults == 0


@pytest.mark.parametrize("fetch", FETCHES)
def test_an_update_and_loads_hold_up_no_link(fetch: str) -> None:
    """A slice and its commit without a gap, and nine loads (BUD-007)."""
    bench = loaded(fetch, modulated=False)
    piece = Slice(3, random_slice(np.random.default_rng(5)))
    due = bench.period + 5
    for message in (piece, Commit.of(due, piece), *(Load(3, Memory.SLOTS, slot, bytes(48)) for slot in range(20, 29))):
        bench.bring(message)
    bench.run(bench.free_at + 20_000)
    assert bench.core.held_up == 0


PAIRS: dict[str, list[Message]] = {
    "question, load": [Collect(3, ChannelEnd.REPORT), Load(3, Memory.SLOTS, 20, bytes(48))],
    "load, program": [Load(3, Memory.SLOTS, 20, bytes(48)), sequence(10**6)],
    "program, program": [sequence(10**6), Program(3, Memory.SAMPLES, 10**6, 0, 0)],
    "program, question": [sequence(10**6), Collect(3, ChannelEnd.REPORT)],
}


@pytest.mark.parametrize("fetch", FETCHES)
@pytest.mark.parametrize("name", PAIRS)
def test_short_messages_back_to_back_hold_up_a_few_tokens(fetch: str, name: str) -> None:
    """Two for the same processor without a gap, which the chain's order of messages hardly brings."""
    bench = loaded(fetch, modulated=False)
    for message in PAIRS[name]:
        bench.bring(message)
    bench.run(bench.free_at + 20_000)
    assert bench.core.held_up <= 6


def test_a_ring_that_is_full_holds_up_links_and_loses_nothing() -> None:
    """More loads than a controller sends in a row: all are kept."""
    bench = loaded("off", modulated=False)
    data = np.random.default_rng(6).integers(1, 256, (40, 47)).astype(np.uint8)
    for number, part in enumerate(data):
        bench.bring(Load(3, Memory.SAMPLES, 1001 + 47 * number, part.tobytes()))
    bench.run(bench.free_at + 60_000)
    at = load_processor().symbols["samples"] - 0x10000 + 1001
    assert bench.core.memory[at : at + data.size].tobytes() == data.tobytes()
    assert bench.core.held_up > 0


# Answers


@pytest.mark.parametrize("fetch", FETCHES)
@pytest.mark.parametrize("what", [ChannelEnd.REPORT, ChannelEnd.PLAYING])
def test_an_answer_is_sent_within_half_a_millisecond(fetch: str, what: ChannelEnd) -> None:
    """CHN-016: after ten loads whose samples must be copied byte by byte, which is the longest way."""
    bench = loaded(fetch, modulated=True)
    for number in range(10):
        bench.bring(Load(3, Memory.SAMPLES, 1001 + 48 * number, bytes(range(1, 49))))
    asked = bench.bring(Collect(3, what))
    bench.run(asked + CYCLES_PER_MS // 2)
    ((sent, _),) = bench.sent
    assert sent.ends - asked < 25_000, "cycles; 0.5 ms are 200 000"


# Too slow


@pytest.mark.parametrize("slowness", [2, 8])
def test_a_slow_processor_misses_and_plays_on(slowness: int) -> None:
    """CHN-004, CHN-014, SAF-008: what it cannot make in time is missed, with OVERRUN; it recovers."""
    bench = loaded("off", modulated=False)
    rng = np.random.default_rng(7)
    plays = random_slice(rng)
    bench.commit(bench.period + 4, plays)
    bench.run_to(bench.period + 8)
    assert bench.report().faults == 0
    bench.core.set_issue_cycles(ISSUE_CYCLES * slowness)
    first = bench.period + 12
    bench.bring(sequence(first))
    bench.run_to(first + 10)
    bench.commit(first + 30, random_slice(rng))
    bench.run_to(first + 40)
    report = bench.report()
    assert (report.missed_commits, report.faults) == (2, Fault.CHAIN | Fault.OVERRUN)
    assert (bench.words(first - 10, first + 40) == literal_words(plays)).all()
    playing = bench.playing()
    assert playing.packed == plays
    bench.core.set_issue_cycles(ISSUE_CYCLES)
    bench.run_to(bench.period + 3)
    then, due = random_slice(rng), bench.period + 5
    bench.commit(due, then)
    bench.run_to(due + 3)
    assert (bench.words(due, due + 3) == literal_words(then)).all()
    report = bench.report()
    assert (report.missed_commits, report.faults) == (2, 0)


@pytest.mark.parametrize("modulated", [False, True])
def test_a_table_plays_from_its_boundary_on_or_never(modulated: bool) -> None:
    """At speeds at which it is just ready in time, or just not: TIM-003 holds."""
    outcomes = set()
    for issue_cycles in range(4, 9):
        bench = loaded("off", modulated=modulated)
        bench.core.set_issue_cycles(issue_cycles)
        for delay in range(0, 700, 31):
            missed, _ = counts(bench)
            due, packed = bench.period + 4, random_slice(np.random.default_rng(delay))
            bench.commit(due, packed)
            # Something to deal with just before the decision makes that a little later.
            bench.run_to(due, -7000)
            bench.bring(Slice(3, bytes(48)), bench.boundary(due) - (5336 if modulated else 4296) - 390 - delay)
            bench.run_to(due + 3)
            in_time = counts(bench)[0] == missed
            sample = [100 + (due + later - 12) % 48 for later in range(2)] if modulated else [255, 255]
            words = bench.words(due, due + 2)
            played = [np.array_equal(words[later], literal_words(packed, sample[later])) for later in range(2)]
            assert played == [in_time, in_time], f"{issue_cycles} cycles an instruction, {delay}"
            outcomes.add(in_time)
    assert outcomes == {False, True}


def test_steps_of_a_slow_processor_come_late() -> None:
    """CHN-015: a step that is not ready plays later; which step it is follows from the period."""
    bench = loaded("off", modulated=False)
    bench.bring(Load(3, Memory.ENTRIES, 500, np.array([[0, 40], [1, 40]], "<u2").tobytes()))
    bench.bring(Program(3, Memory.ENTRIES, begins := bench.period + 5, 500, 2))
    bench.run_to(begins + 10)
    bench.core.set_issue_cycles(ISSUE_CYCLES * 8)
    bench.run_to(begins + 100)
    words = bench.words(begins, begins + 100)
    changes = [period for period in range(1, 100) if not np.array_equal(words[period], words[period - 1])]
    assert [change // 40 for change in changes] == [1, 2]
    assert all(0 < change % 40 <= 5 for change in changes)
    assert CYCLES_PER_PERIOD == 10_000
    assert bench.report().faults & Fault.OVERRUN
