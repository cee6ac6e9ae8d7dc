"""Marks, found again in edges that were worked out by hand."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.hil.conformance.sight.marks import MARK_PULSES, Anchor, Mark, TimeBase, find_mark, time_bases

from tests import from_spec


def mark_at(period: int, seed: int = 1) -> Mark:
    changes = []
    for gap, on in Mark.plan(Random(seed)):
        period += gap
        changes.append((period, on))
    return Mark(tuple(changes))


def silences_of(marks: list[Mark], rate: float, start: float) -> np.ndarray:
    """Where a recording of these marks alone is silent: an output that is on plays in ticks 0 to 2 of each period."""
    edges = []
    for mark in marks:
        changes = mark.changes if mark.changes[0][1] else mark.changes[1:]
        for period, on in changes:
            tick = 50 * period if on else 50 * (period - 1) + 3
            edges.append(int(np.ceil((tick - start) * rate)))
    return np.array([0, *edges, edges[-1] + 10_000]).reshape(-1, 2)


def test_the_pulse_of_a_mark_begins_with_its_period() -> None:
    assert {
        frozenset(from_spec.high_ticks((phase, width)))
        for phase, width in zip(MARK_PULSES.phase.tolist(), MARK_PULSES.width.tolist(), strict=True)
    } == {frozenset({0, 1, 2})}


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ((), "ends with silence"),
        (((4, False),), "ends with silence"),
        (((4, True),), "ends with silence"),
        (((4, True), (6, True), (9, False)), "periods 4 and 6: on and off in turn"),
        (((4, True), (5, False)), "periods 4 and 5: .* at least 2 periods apart"),
        (((9, True), (4, False)), "periods 9 and 4"),
    ],
)
def test_what_is_no_mark_is_refused(changes: tuple[tuple[int, bool], ...], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Mark(changes)


@given(
    st.sampled_from([1.0, 2.0, 4.0, 6.25, 12.0, 50.0]),
    st.floats(-150e-6, 150e-6),
    st.floats(-1e9, 0.0),
    st.integers(0, 2**32 - 1),
)
def test_a_mark_is_found_to_a_fraction_of_a_sample(rate: float, off: float, start: float, seed: int) -> None:
    """For any error and start of the clock; edges are seen up to a sample late."""
    before, mark, after = mark_at(100, seed), mark_at(5_000, seed + 1), mark_at(10_000, seed + 2)
    silences = silences_of([before, mark, after], rate * (1 + off), start)
    found = find_mark(mark, silences, rate)
    assert found is not None
    assert abs(found.sample - (found.tick - start) * rate * (1 + off)) <= 0.5 + 1e-4


def test_jitter_of_a_sample_is_borne_and_more_is_not() -> None:
    mark, rng = mark_at(100), np.random.default_rng(2)
    silences = silences_of([mark], 12.0, 0.0)
    assert find_mark(mark, silences + rng.integers(-1, 2, silences.shape), 12.0) is not None
    silences[3] += 8
    assert find_mark(mark, silences, 12.0) is None


def test_neither_other_marks_nor_a_repeated_one_are_found() -> None:
    marks = [mark_at(100 + 1_000 * seed, seed) for seed in range(30)]
    silences = silences_of(marks, 4.0, 0.0)
    assert all(find_mark(mark, silences, 4.0) is not None for mark in marks)
    assert all(find_mark(mark_at(100, seed), silences, 4.0) is None for seed in range(30, 130))
    twice = silences_of([mark_at(100), mark_at(2_000)], 4.0, 0.0)
    assert find_mark(mark_at(100), twice, 4.0) is None
    assert find_mark(mark_at(100), np.empty((0, 2), np.int64), 4.0) is None


def anchor(period: int, sample: float) -> Anchor:
    mark = Mark(((period, True), (period + 10, False)))
    return Anchor(mark, float(mark.edges.mean()), sample)


def test_time_runs_straight_from_mark_to_mark() -> None:
    anchors = [anchor(0, 100.0), anchor(1_000, 200_110.0), anchor(2_000, 400_100.0)]
    (base,) = time_bases(anchors, 4.0)
    ticks = np.array([one.tick for one in anchors])
    assert base.samples_at(ticks) == pytest.approx([100.0, 200_110.0, 400_100.0])
    assert base.samples_at(ticks[:2] + 25_000) == pytest.approx([100_105.0, 300_105.0])
    assert base.samples_at(ticks[[0, 2]] + [-100, 100]) == pytest.approx([100 - 400.02, 400_100 + 399.98])
    assert base.samples_per_tick == 4.0
    assert base.covers(0, 2_010)
    assert not base.covers(0, 2_011)
    assert not TimeBase(anchors[1:]).covers(999, 1_500)


@pytest.mark.parametrize(
    ("second", "linked"),
    [
        (anchor(10_000, 2_000_000.0), True),
        (anchor(10_000, 2_000_399.0), True),
        (anchor(10_000, 2_000_500.0), False),  # 250 ppm
        (anchor(399_999, 79_999_800.0), True),
        (anchor(400_000, 80_000_000.0), False),  # 10 s
        (anchor(10_000, 90_000_000.0), False),  # the device restarted in between
        (Anchor(anchor(0, 0.0).mark, -1_000.0, -4_000.0), False),  # they are not in the order of time
    ],
)
def test_between_marks_time_is_known_if_they_are_near_and_agree(second: Anchor, linked: bool) -> None:
    first = anchor(0, 0.0)
    assert [list(base.anchors) for base in time_bases([first, second], 4.0)] == ([[first, second]] if linked else [])


def test_each_life_of_the_device_has_a_time_of_its_own() -> None:
    lives = [anchor(0, 0.0), anchor(500, 100_000.0), anchor(20, 300_000.0), anchor(520, 400_000.0), anchor(5, 1e6)]
    assert [[one.sample for one in base.anchors] for base in time_bases(lives, 4.0)] == [
        [0.0, 100_000.0],
        [300_000.0, 400_000.0],
    ]
