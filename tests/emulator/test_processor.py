from __future__ import annotations

import numpy as np
from hypothesis import given
from phasewire.emulator.processor import Processor, rasterise
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol import Pulses
from phasewire.protocol.blocks import pack_pulses
from phasewire.protocol.chain import Commit, Slice
from phasewire.protocol.timing import RASTERISE_CYCLES

from tests.strategies import pulses

PERIOD = 10_000


def literally(made: Pulses) -> list[int]:
    """Clause PUL-004 as a loop."""
    words = [0] * 50
    for bit, (phase, width) in enumerate(zip(made.phase.tolist(), made.width.tolist(), strict=True)):
        begin = (phase - width) // 2
        for tick in range(begin, begin + width):
            words[tick % 50] |= 1 << bit
    return words


@given(pulses(32))
def test_the_rasteriser_is_the_specification_s_sentence(made: Pulses) -> None:
    assert rasterise(made).tolist() == literally(made)


def processor() -> tuple[Scheduler, Processor]:
    scheduler = Scheduler()
    return scheduler, Processor(scheduler, 0, lambda line: None)


SLICE = Slice(0, pack_pulses(Pulses(np.full(32, 25), np.full(32, 25))))
SILENCE = Slice(0, bytes(48))


def test_a_committed_slice_plays_from_its_period() -> None:
    scheduler, tested = processor()
    tested.receive(SLICE.encode())
    tested.receive(Commit.of(3, SLICE).encode())
    scheduler.run_until(3 * PERIOD - 1)
    assert tested.starts == [0]
    scheduler.run_until(3 * PERIOD)
    assert tested.starts == [0, 150]
    assert tested.tables[1].tolist() == [0xFFFFFFFF] * 25 + [0] * 25


def test_a_commit_for_another_slice_is_missed() -> None:
    scheduler, tested = processor()
    tested.receive(SLICE.encode())
    tested.receive(Commit.of(3, SILENCE).encode())
    scheduler.run_until(5 * PERIOD)
    assert (tested.missed_commits, tested.starts) == (1, [0])


def test_a_commit_that_leaves_just_enough_time_is_carried_out() -> None:
    scheduler, tested = processor()
    tested.receive(SLICE.encode())
    scheduler.run_until(3 * PERIOD - RASTERISE_CYCLES)
    tested.receive(Commit.of(3, SLICE).encode())
    scheduler.run_until(5 * PERIOD)
    assert (tested.missed_commits, tested.starts) == (0, [0, 150])


def test_a_commit_that_leaves_no_time_to_rasterise_is_missed() -> None:
    scheduler, tested = processor()
    tested.receive(SLICE.encode())
    scheduler.run_until(3 * PERIOD - RASTERISE_CYCLES + 1)
    tested.receive(Commit.of(3, SLICE).encode())
    scheduler.run_until(5 * PERIOD)
    assert (tested.missed_commits, tested.starts) == (1, [0])


def test_a_commit_while_another_table_waits_is_missed() -> None:
    scheduler, tested = processor()
    for piece, period in ((SLICE, 3), (SILENCE, 4)):
        tested.receive(piece.encode())
        tested.receive(Commit.of(period, piece).encode())
    scheduler.run_until(6 * PERIOD)
    assert (tested.missed_commits, tested.starts) == (1, [0, 150])
    assert tested.tables[1].any()
