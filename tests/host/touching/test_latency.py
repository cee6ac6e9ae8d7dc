"""Distributions of durations: against NumPy's quantiles."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.touching.latency import Latencies


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
