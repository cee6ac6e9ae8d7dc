"""The score against a period-by-period reading of chapter BLK, and what a stage makes of acknowledgements."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import nullcontext

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.running import Options, open_bench
from phasewire.hil.conformance.sight.waveforms import expected_words, modulated, only
from phasewire.hil.conformance.tools.stage import Score, Stage, block_periods, check_in_time, in_time, is_fast, soon
from phasewire.protocol.blocks import Modulation, Output, Samples, Update
from phasewire.protocol.codes import AckFlag, Action, Reason, State
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import Ack
from phasewire.protocol.wiring import Wiring

WIRING = Wiring.strips()
SILENT = Pulses.silent(320)
A, B, C = only(1), only(2), only(3)


def played(score: Score, first: int, last: int) -> list[tuple[Pulses, int]]:
    return [score.at(period)[:2] for period in range(first, last)]


def test_nothing_plays_at_first() -> None:
    assert played(Score(WIRING), 0, 3) == [(SILENT, 255)] * 3


def test_an_update_plays_until_the_next() -> None:
    score = Score(WIRING)
    score.update(5, A)
    score.update(7, B)
    assert [pulses for pulses, _ in played(score, 4, 9)] == [SILENT, A, A, B, B]


@pytest.mark.parametrize(("repeats", "story"), [(0, "AABBBCAABBBCAAB"), (1, "AABBBC........."), (2, "AABBBCAABBBC...")])
def test_a_sequence_plays_its_entries_so_many_times(repeats: int, story: str) -> None:
    score = Score(WIRING)
    score.play(10, [(A, 2), (B, 3), (C, 1)], repeats)
    names = {"A": A, "B": B, "C": C, ".": SILENT}
    assert [pulses for pulses, _ in played(score, 10, 25)] == [names[name] for name in story]


def test_a_modulation_counts_its_own_periods() -> None:
    score = Score(WIRING)
    score.modulate(10, [1, 2], 2)
    score.update(13, A)
    score.end_modulation(18)
    score.silence(20)
    assert [sample for _, sample in played(score, 9, 19)] == [255, 1, 1, 2, 2, 1, 1, 2, 2, 255]
    assert played(score, 19, 21) == [(A, 255), (SILENT, 255)]


def test_silence_ends_the_modulation_too() -> None:
    score = Score(WIRING)
    score.modulate(1, [7], 1)
    score.silence(5)
    score.update(8, A)
    assert played(score, 4, 5) == [(SILENT, 7)]
    assert played(score, 8, 9) == [(A, 255)]


def test_steps_are_where_something_changes() -> None:
    rng = random.Random(1)
    score = Score(WIRING)
    score.play(3, [(rng.choice((A, B, C)), rng.randrange(1, 5)) for _ in range(7)], 3)
    score.modulate(8, [10, 200, 255], 4)
    score.update(50, B)
    steps = dict(score.steps(0, 90))
    now = steps[0]
    for period in range(90):
        now = steps.get(period, now)
        pulses, sample, _ = score.at(period)
        assert (now == expected_words(modulated(pulses, sample), WIRING)).all()
    assert list(steps) == sorted(steps)
    assert score.steps(17, 18)[0][0] == 17


def ack(commit: int, arrived: int, *, late: bool = False) -> Ack:
    return Ack(Reason.ACCEPTED, 1, commit, 50 * arrived + 49, AckFlag.LATE if late else AckFlag(0), 5, State.READY)


@pytest.mark.parametrize(("acknowledged", "named"), [(ack(105, 100), 105), (ack(103, 100), 0), (ack(101, 100), 101)])
def test_what_is_in_time_passes(acknowledged: Ack, named: int) -> None:
    check_in_time(acknowledged, named)


@pytest.mark.parametrize(
    ("acknowledged", "named", "words"),
    [
        (ack(106, 100), 105, "takes effect at period 106"),
        (ack(106, 100, late=True), 105, "said to be late"),
        (ack(103, 100, late=True), 0, "said to be late"),
        (ack(100, 100), 0, "had arrived in period 100"),
    ],
)
def test_what_is_not_in_time_fails(acknowledged: Ack, named: int, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_in_time(acknowledged, named)


def test_what_came_too_late_is_not_judged() -> None:
    with pytest.raises(Inconclusive, match="slow line"):
        check_in_time(ack(106, 101, late=True), 105)


@pytest.fixture(name="bench")
def fixture() -> Iterator[Bench]:
    with open_bench(Options("emulator:")) as bench:
        bench.begin_case("a case")
        yield bench


def test_a_stage_knows_what_was_stored(bench: Bench) -> None:
    stage = Stage(bench)
    stage.send_all([Update(only(5)), Samples(bytes([255, 0]), 20)])
    begin = stage.soon(2)
    stage.send_all([Modulation(20, 2, 3, begin), Output(Action.SILENCE, begin + 20)])
    assert [sample for _, sample in played(stage.score, begin - 1, begin + 7)] == [255, 255, 255, 255, 0, 0, 0, 255]
    stage.judge(begin - 5, begin + 40)
    (look,) = bench.looks
    look()  # raises if the outputs are others


def test_a_score_that_is_wrong_fails(bench: Bench) -> None:
    stage = Stage(bench)
    begin = stage.send(Update(only(5))).commit_period
    stage.score.update(begin + 4, only(6))
    stage.judge(begin, begin + 6)
    (look,) = bench.looks
    with pytest.raises(AssertionError, match=f"period {begin + 4}"):
        look()


def test_a_refused_block_fails(bench: Bench) -> None:
    stage = Stage(bench)
    with pytest.raises(AssertionError, match="UPDATE is refused with HORIZON"):
        stage.send(Update(only(5), 2**64 - 1))


def test_a_slow_line_gets_more_time() -> None:
    with open_bench(Options("emulator:?door=serial")) as bench:
        assert not is_fast(bench)
        assert block_periods(bench) > 521 * 10 * 40_000 / 115_200
        now = bench.period()
        assert soon(bench, 10) > now + 10 * block_periods(bench)


@pytest.mark.parametrize(
    ("raised", "told_late"),
    [(None, Inconclusive), (AssertionError, Inconclusive), (KeyboardInterrupt, KeyboardInterrupt)],
)
def test_what_is_over_too_late_is_inconclusive_unless_a_signal_ended_it(
    bench: Bench, raised: type[BaseException] | None, told_late: type[BaseException]
) -> None:
    def end() -> None:
        if raised is not None:
            raise raised

    with nullcontext() if raised is None else pytest.raises(raised), in_time(bench, bench.period() + 1000):
        end()
    with pytest.raises(told_late), in_time(bench, 0):
        end()
