from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from phasewire.emulator.boards.processor import Processor
from phasewire.emulator.ports.capture import Capture, Track
from phasewire.emulator.ports.clock import BoardClock, Timebase
from phasewire.emulator.ports.history import History
from phasewire.emulator.scheduler import Scheduler
from phasewire.emulator.trace import Tracer
from phasewire.protocol import Pulses
from phasewire.protocol.blocks import Entry, pack_entries, pack_pulses
from phasewire.protocol.chain import Collect, Commit, Load, Number, Program, Report, Slice
from phasewire.protocol.codes import ChannelEnd, Fault, Memory
from phasewire.protocol.timing import RASTERISE_CYCLES
from phasewire.protocol.wiring import Wiring

from tests.strategies import pulses

PERIOD = 10_000


def played(track: Track, period: int) -> list[int]:
    """The port's words in a period."""
    capture = Capture(Wiring.strips(), (period + 1) * 50, (track,) * 10)
    return list(capture.bits(period * 50, period * 50 + 50)[:, 0].tolist())


def literally(made: Pulses) -> list[int]:
    """Clause PUL-004 as a loop."""
    words = [0] * 50
    for bit, (phase, width) in enumerate(zip(made.phase.tolist(), made.width.tolist(), strict=True)):
        begin = (phase - width) // 2
        for tick in range(begin, begin + width):
            words[tick % 50] |= 1 << bit
    return words


@given(pulses(32))
def test_the_rasteriser_agrees_with_the_specification(made: Pulses) -> None:
    history = History()
    history.play(np.array([0]), np.frombuffer(pack_pulses(made), np.uint8)[None])
    assert played(Track(history.segments(), BoardClock()), 0) == literally(made)


SLICE = Slice(0, pack_pulses(Pulses(np.full(32, 25), np.full(32, 25))))
SILENCE = Slice(0, bytes(48))


def processor(offset_ticks: int = 0) -> tuple[Scheduler, Processor]:
    scheduler = Scheduler()
    made = Processor(scheduler, 0, BoardClock(offset_ticks), (1, 2, 3), 7, lambda _: None, Tracer())
    made.receive(Number(0).encode())
    made.start(Timebase(0))
    return scheduler, made


def starts(tested: Processor) -> list[int]:
    return list(tested.track().segments.starts[1:].tolist())


def report(tested: Processor) -> Report:
    answer = tested.receive(Collect(0, ChannelEnd.REPORT).encode())
    assert isinstance(answer, Report)
    return answer


@pytest.mark.parametrize(("late", "carried_out"), [(0, [3]), (1, [])])
def test_a_commit_that_leaves_no_time_to_rasterise_is_missed(late: int, carried_out: list[int]) -> None:
    scheduler, tested = processor()
    tested.receive(SLICE.encode())
    scheduler.run_until(3 * PERIOD - RASTERISE_CYCLES + late)
    tested.receive(Commit.of(3, SLICE).encode())
    scheduler.run_until(5 * PERIOD)
    assert (tested.missed_commits, starts(tested)) == (late, carried_out)


def test_a_commit_while_another_table_waits_is_missed() -> None:
    scheduler, tested = processor()
    for piece, period in ((SLICE, 3), (SILENCE, 4)):
        tested.receive(piece.encode())
        tested.receive(Commit.of(period, piece).encode())
    scheduler.run_until(6 * PERIOD)
    assert (tested.missed_commits, starts(tested)) == (1, [3])
    assert any(played(tested.track(), 5))


def test_a_message_for_another_processor_is_damaged_and_reported_once() -> None:
    _, tested = processor()
    tested.receive(Slice(1, SLICE.packed).encode())
    assert (report(tested).damaged_messages, Fault(report(tested).faults)) == (1, Fault(0))
    tested.receive(b"")
    first = report(tested)
    assert (first.damaged_messages, Fault(first.faults)) == (2, Fault.CHAIN)


def test_the_sync_pulse_is_compared_across_the_wrap_of_the_counter() -> None:
    """204 800 ticks between two pulses, 8192 modulo 65 536."""
    _, tested = processor(offset_ticks=3)
    for pulse in range(1, 20):
        tested.feel_pulse(204_800 * pulse)
    assert (tested.drift, tested.faults) == (0, Fault(0))
    tested.feel_pulse(204_800 * 20 + 1)
    assert (tested.drift, tested.faults) == (1, Fault(0))
    tested.feel_pulse(204_800 * 21 - 2)
    assert (tested.drift, tested.faults) == (-2, Fault.SYNC)


ENTRIES = Load(0, Memory.ENTRIES, 0, pack_entries([Entry(0, 1)]))


def with_slot() -> tuple[Scheduler, Processor]:
    """A processor with slot 0 and an entry that plays it for a period."""
    scheduler, tested = processor()
    tested.receive(Load(0, Memory.SLOTS, 0, SLICE.packed).encode())
    tested.receive(ENTRIES.encode())
    return scheduler, tested


def test_a_program_while_another_for_the_same_memory_waits_is_missed() -> None:
    """Clause CHN-014; one for each memory may wait, beside a table."""
    scheduler, tested = with_slot()
    tested.receive(Load(0, Memory.SAMPLES, 0, b"\0").encode())
    tested.receive(Program(0, Memory.ENTRIES, 3, first=0, count=1, repeats=1).encode())
    tested.receive(Program(0, Memory.SAMPLES, 5, first=0, count=1, hold=1).encode())
    assert tested.missed_commits == 0
    tested.receive(Program(0, Memory.ENTRIES, 6, first=0, count=1).encode())
    assert tested.missed_commits == 1
    scheduler.run_until(9 * PERIOD)
    assert [any(played(tested.track(), period)) for period in range(2, 9)] == [False, True] + [False] * 5


def test_a_table_takes_longer_to_make_while_a_modulation_plays() -> None:
    """Clause BUD-006: 5424 cycles instead of 4400, until the modulation ends."""
    scheduler, tested = processor()
    tested.receive(Load(0, Memory.SAMPLES, 0, b"\xff").encode())
    tested.receive(Program(0, Memory.SAMPLES, 1, first=0, count=1, hold=1).encode())
    scheduler.run_until(3 * PERIOD - 5423)
    tested.receive(SLICE.encode())
    tested.receive(Commit.of(3, SLICE).encode())
    assert tested.missed_commits == 1
    scheduler.run_until(4 * PERIOD - 5424)
    tested.receive(SLICE.encode())
    tested.receive(Commit.of(4, SLICE).encode())
    tested.receive(Program(0, Memory.SAMPLES, 4, first=0, count=0).encode())
    scheduler.run_until(5 * PERIOD - 4400)
    tested.receive(SLICE.encode())
    tested.receive(Commit.of(5, SLICE).encode())
    assert tested.missed_commits == 1


def test_silence_drops_what_waits_and_what_modulates() -> None:
    """Clause CHN-018: a table, programs and a modulation; later updates play unmodulated."""
    scheduler, tested = with_slot()
    tested.receive(Load(0, Memory.SAMPLES, 0, b"\0").encode())
    tested.receive(Program(0, Memory.SAMPLES, 2, first=0, count=1, hold=1).encode())
    scheduler.run_until(3 * PERIOD)
    tested.listen(scheduler.now - 50 * 400_000 + PERIOD // 2)
    tested.receive(SLICE.encode())
    tested.receive(Commit.of(6, SLICE).encode())
    tested.receive(Program(0, Memory.ENTRIES, 7, first=0, count=1).encode())
    scheduler.run_until(8 * PERIOD)
    assert starts(tested) == [4]
    tested.receive(SLICE.encode())
    tested.receive(Commit.of(10, SLICE).encode())
    scheduler.run_until(11 * PERIOD)
    assert starts(tested) == [4, 10]
    assert played(tested.track(), 10) == [0xFFFFFFFF] * 25 + [0] * 25
