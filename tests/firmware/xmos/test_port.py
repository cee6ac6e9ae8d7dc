"""The words on the executed processor's pins: which, and in which tick."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.protocol.board import CYCLES_PER_PERIOD
from phasewire.protocol.chain import Load, Program, loads
from phasewire.protocol.codes import Memory

from .harness import Bench
from .made import literal_words, pack, random_slice

MODULATES_AT = 40


def test_random_slices_play_word_for_word() -> None:
    """PUL-004, TIM-003: another update each period, and each word in its tick."""
    rng = np.random.default_rng(1)
    bench = Bench()
    bench.begin()
    slices = {}
    bench.run_to(10)
    for period in range(12, 150):
        slices[period] = random_slice(rng)
        bench.run_to(period - 1, 600)
        bench.commit(period, slices[period])
    bench.run_to(151)
    words = bench.words(12, 150)
    for period, packed in slices.items():
        assert np.array_equal(words[period - 12], literal_words(packed)), f"period {period}"
    assert not bench.words(0, 12).any()


def test_every_pulse_plays() -> None:
    """All 100 phases and 26 widths, each on some output."""
    bench = Bench()
    bench.begin()
    bench.run_to(4)
    codes = np.stack(np.meshgrid(np.arange(100), np.arange(26)), axis=-1).reshape(-1, 2)
    codes = np.concatenate([codes, codes[: -len(codes) % 32]])
    slices = {}
    for number, part in enumerate(codes.reshape(-1, 32, 2)):
        period = 6 + number
        slices[period] = pack(part[:, 0], part[:, 1])
        bench.run_to(period - 1, 600)
        bench.commit(period, slices[period])
    bench.run_to(max(slices) + 2)
    words = bench.words(6, max(slices) + 1)
    for period, packed in slices.items():
        assert np.array_equal(words[period - 6], literal_words(packed)), f"period {period}"


def test_every_sample_applies_to_every_width() -> None:
    """PUL-006, over two slices which have all widths between them."""
    rng = np.random.default_rng(2)
    bench = Bench()
    bench.begin()
    samples = np.arange(256).astype(np.uint8)
    bench.load(loads(3, Memory.SAMPLES, 3000, samples.tobytes()))
    slices = [pack(rng.integers(0, 100, 32), np.arange(32) % 13 + 13 * half) for half in range(2)]
    bench.run_to(35)
    bench.bring(Program(3, Memory.SAMPLES, MODULATES_AT, 3000, 256, 1))
    bench.commit(MODULATES_AT, slices[0])
    bench.run_to(MODULATES_AT + 254)
    bench.commit(MODULATES_AT + 256, slices[1])
    bench.run_to(MODULATES_AT + 513)
    words = bench.words(MODULATES_AT, MODULATES_AT + 512)
    for number in range(512):
        expected = literal_words(slices[number // 256], int(samples[number % 256]))
        assert np.array_equal(words[number], expected), f"sample {number % 256}"
    assert bench.report().faults == 0


def test_a_sequence_steps_by_itself() -> None:
    """CHN-014, CHN-015: entries for their periods, twice, then silence; under a modulation that holds on."""
    rng = np.random.default_rng(3)
    bench = Bench()
    bench.begin()
    slots = [random_slice(rng) for _ in range(3)]
    bench.load([Load(3, Memory.SLOTS, 100 + number, packed) for number, packed in enumerate(slots)])
    bench.load(loads(3, Memory.ENTRIES, 1000, np.array([[102, 2], [100, 1], [101, 3]], "<u2").tobytes()))
    bench.load(loads(3, Memory.SAMPLES, 4091, bytes([255, 10, 128, 77, 200])))
    bench.run_to(20)
    bench.bring(Program(3, Memory.ENTRIES, 30, 1000, 3, 0, 2))
    bench.bring(Program(3, Memory.SAMPLES, 33, 4091, 5, 2))
    bench.run_to(60)
    bench.commit(63, slots[0])
    bench.run_to(80)
    played = [2, 2, 0, 1, 1, 1] * 2 + [None] * 21 + [0] * 10
    for place, (number, words) in enumerate(zip(played, bench.words(30, 73), strict=True)):
        sample = [255, 10, 128, 77, 200][(place - 3) // 2 % 5] if place >= 3 else 255
        expected = np.zeros(50) if number is None else literal_words(slots[number], sample)
        assert np.array_equal(words, expected), f"period {30 + place}"


def test_words_change_in_exact_ticks_over_the_wrap_of_the_counter() -> None:
    """TIM-004: 200 cycles a tick for 4000 periods, three wraps of the port's 16-bit counter; one delay for all."""
    rng = np.random.default_rng(4)
    bench = Bench()
    bench.begin()
    packed = random_slice(rng)
    bench.run_to(3)
    bench.commit(5, packed)
    for period in range(200, 4200, 200):  # a question, so that it is not alone (CHN-018)
        bench.run_to(period)
        bench.report()
    cycles, _ = bench.changes()
    (delay,) = set((cycles - bench.boundary(0)) % 200)
    assert 0 <= delay < 190
    assert (cycles[0] - delay - bench.boundary(5)) // 200 == np.flatnonzero(literal_words(packed))[0]
    words = bench.words(5, 4010)
    assert (words == literal_words(packed)).all()


@pytest.mark.parametrize("seed", range(2))
def test_bursts_and_lockstep_agree(seed: int) -> None:
    """What the core executes in bursts it does in lockstep too, to the cycle."""
    logs = []
    for lockstep in (False, True):
        rng = np.random.default_rng(seed)
        bench = Bench(lockstep=lockstep)
        bench.begin()
        bench.load([Load(3, Memory.SLOTS, number, random_slice(rng)) for number in range(3)])
        bench.load(loads(3, Memory.ENTRIES, 0, np.array([[0, 1], [1, 1], [2, 2]], "<u2").tobytes()))
        bench.load(loads(3, Memory.SAMPLES, 0, bytes(rng.integers(0, 256, 20).tolist())))
        bench.run_to(30)
        for period in range(32, 90, 3):
            bench.run_to(period - 2, int(rng.integers(500, 3000)))
            choice = rng.integers(0, 4)
            if choice < 2:
                bench.commit(period, random_slice(rng))
            elif choice == 2:
                bench.bring(Program(3, Memory.ENTRIES, period, 0, 3, 0, 0))
            else:
                bench.bring(Program(3, Memory.SAMPLES, period, 0, 20, 1))
        report = bench.report()
        bench.run_to(100 + (bench.core.cycle - bench.boundary(0)) // CYCLES_PER_PERIOD)
        logs.append((report, *(part.tolist() for part in bench.changes())))
    assert logs[0] == logs[1]
