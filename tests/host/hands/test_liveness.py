"""What is news of a live source, and what a hang, a jump or a delay must not pass for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.hands.frames import HandFrame
from phasewire.host.hands.liveness import MOST_AGE_SECONDS, STEADY_SECONDS, Liveness, Stale

GAP, HANG, COUNT = 0.01, 50, 250
"""Seconds from frame to frame; the last frame before the source hangs; of all frames."""


def judged(frame: Callable[[int], tuple[int, float]]) -> list[Stale | None]:
    """What each frame is; one comes every 10 ms, and has a number and an age, in frames."""
    liveness, every = Liveness(), ((index, *frame(index)) for index in range(COUNT))
    return [liveness.stale(HandFrame((index - age) * GAP, number=number), index * GAP) for index, number, age in every]


def hung(index: int) -> int:
    """Frames since the source hangs."""
    return max(index - HANG, 0)


HUNG: dict[str, tuple[Callable[[int], tuple[int, float]], set[Stale]]] = {
    "repeats": (lambda index: (min(index, HANG), hung(index)), {Stale.REPEATED}),
    "freezes the time": (lambda index: (index, hung(index)), {Stale.TIME}),
    "freezes the number": (lambda index: (min(index, HANG), 0.0), {Stale.NUMBER}),
    "jumps back and forth": (lambda index: (index - 7 * (index % 2) * (index > HANG), 0.0), {Stale.BACK}),
    "jumps in time": (lambda index: (index, 15 * (index % 2) * (index > HANG)), {Stale.BACK}),
    "goes in circles": (lambda index: (index if index <= HANG else HANG - 20 + index % 20, 0.0), {Stale.BACK}),
    "is late": (lambda index: (index, 30 * (index > HANG)), {Stale.BACK, Stale.AGE}),
    "is ahead": (lambda index: (index, -30 * (index > HANG)), {Stale.AGE}),
    "has no time": (lambda index: (index, nan if index > HANG else 0.0), {Stale.TIME}),
}


@pytest.mark.parametrize(("frame", "why"), HUNG.values(), ids=HUNG)
def test_a_source_that_hangs_has_no_news(frame: Callable[[int], tuple[int, float]], why: set[Stale]) -> None:
    found = judged(frame)
    assert found[: HANG + 1] == [None] * (HANG + 1)
    assert set(found[HANG + 1 :]) == why


def test_a_source_that_counts_anew_is_heard_again() -> None:
    found = judged(lambda index: (index if index <= HANG else index - HANG, 0.0))
    assert Counter(found) == {Stale.BACK: (doubted := round(STEADY_SECONDS / GAP)), None: COUNT - doubted}
    assert found[HANG + 1 + doubted :] == [None] * (COUNT - HANG - 1 - doubted)


def test_a_few_frames_far_apart_do_not_run_on() -> None:
    liveness = Liveness()
    given = [(0.0, 9), (0.1, 1), (0.6, 2), (1.1, 3), (1.6, 4)]
    assert [liveness.stale(HandFrame(now, number=number), now) for now, number in given] == [None] + [Stale.BACK] * 4


def test_after_a_delay_a_source_is_heard_at_once() -> None:
    found = judged(lambda index: (index, hung(index) / 2 * (index < HANG + 90)))
    assert set(found[HANG + 50 : HANG + 90]) == {Stale.AGE}
    assert found[HANG + 90 :] == [None] * (COUNT - HANG - 90)


@given(st.lists(st.tuples(st.integers(0, 6), st.floats(0, 0.3), st.floats(-0.3, 0.4)), min_size=1, max_size=80))
def test_news_is_never_old_and_its_time_never_goes_back(frames: list[tuple[int, float, float]]) -> None:
    liveness, now, heard = Liveness(), 0.0, []
    for number, passed, age in frames:
        now += passed
        frame = HandFrame(now - age, number=number)
        if liveness.stale(frame, now) is None:
            assert abs(now - frame.time) <= MOST_AGE_SECONDS
            heard.append((now, frame))
    for (before, old), (after, new) in pairwise(heard):
        assert new.time >= old.time - 1e-9
        assert new.number > old.number or after - before >= STEADY_SECONDS
