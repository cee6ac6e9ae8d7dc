"""The clock of the benchmark scripts beside it."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from time import perf_counter

__all__ = ["median"]

PATIENCE = 0.4  # seconds for one median


def median(call: Callable[[], object]) -> float:
    """Median time of a call in seconds."""
    call()
    times: list[float] = []
    end = perf_counter() + PATIENCE
    while perf_counter() < end or len(times) < 3:
        before = perf_counter()
        call()
        times.append(perf_counter() - before)
    return statistics.median(times)
