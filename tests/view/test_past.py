"""The last ten seconds: which snapshot belongs to a period, and what is dropped."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from phasewire.view.past import MOST_SNAPSHOTS, Past
from phasewire.view.snapshot import Snapshot

TEN_SECONDS = 400_000


def at(period: int) -> Snapshot:
    return Snapshot(np.zeros((1, 4), np.complex64), period)


@given(st.lists(st.integers(0, 3 * TEN_SECONDS), min_size=1, max_size=60).map(sorted), st.integers(-5, 4 * TEN_SECONDS))
def test_the_newest_that_is_not_after_a_period_is_found(periods: list[int], asked: int) -> None:
    past = Past()
    for period in periods:
        past.add(at(period))
    kept = [period for period in periods if period >= periods[-1] - TEN_SECONDS]
    assert past.span == (kept[0], kept[-1])
    found = past.at(asked)
    assert found is not None
    assert found.period == max((period for period in kept if period <= asked), default=kept[0])


def test_a_device_that_began_anew_has_no_past() -> None:
    past = Past()
    past.add(at(1000))
    past.add(at(10))
    assert past.span == (10, 10)


def test_it_stays_small_whatever_comes() -> None:
    past = Past()
    for _ in range(3 * MOST_SNAPSHOTS):
        past.add(at(7))
    assert len(past) == MOST_SNAPSHOTS
