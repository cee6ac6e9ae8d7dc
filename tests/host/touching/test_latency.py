"""Distributions of durations: against NumPy's quantiles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.touching.latency import Latencies, Latency


@given(st.lists(st.floats(0, 20), min_size=1, max_size=200))
def test_quantiles_are_at_most_five_percent_above_the_true_ones(durations: list[float]) -> None:
    latencies = Latencies()
    for seconds in durations:
        latencies.add(seconds)
    summary = latencies.summary
    assert summary.count == len(durations)
    assert summary.worst_seconds == max(durations)
    for share, found in ((0.5, summary.median_seconds), (0.99, summary.p99_seconds)):
        true = float(np.quantile(durations, share, method="inverted_cdf"))
        assert found <= max(true * 1.05, 1e-6) or true > 10
        assert found >= min(true, 10) * (1 - 1e-12)


def test_without_durations_the_summary_is_zero() -> None:
    assert Latencies().summary == Latency(0, 0.0, 0.0, 0.0)


def test_people_read_milliseconds() -> None:
    latencies = Latencies()
    for seconds in (0.001, 0.001, 0.002):
        latencies.add(seconds)
    assert str(latencies.summary) == "1.00 ms median, 2.00 ms 99 %, 2.00 ms worst"


def test_memory_is_bounded() -> None:
    latencies = Latencies()
    before = len(latencies._bins)
    for seconds in (0.0, 1e-9, 1e9, *np.geomspace(1e-7, 1e3, 1000)):
        latencies.add(float(seconds))
    assert len(latencies._bins) == before
    assert latencies.quantile(1.0) == pytest.approx(10 ** (7 + 1 / 48) * 1e-6)
