"""A compiled kernel that lets series of many sources arrive at places after their delays; see `arriving`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.compiling import kernel

__all__ = ["collect"]

STEPS_AT_A_TIME = 256
"""Of all sources these, and those within the range of delays before them, fit a cache."""
SOURCES_AT_A_TIME = 16


def _fast(function: Any) -> Any:
    return kernel(function, fastmath={"contract", "nsz", "reassoc"})


@_fast
def collect(series: Any, lag: Any, weight: Any, row: Any, collected: Any) -> None:
    """Add delayed and weighted series, which repeat, to the rows of ``collected`` (r, t).

    ``series`` (t, n) are those of n sources. Entry e of source q has the delay ``lag[e, q]`` in steps, of any sign and
    size, the factor ``weight[e, q]``, and is added to the row ``row[e, q]``.
    """
    steps, sources = series.shape
    latest, earliest = lag.max(), lag.min()
    span = latest - earliest
    real = np.empty((sources, STEPS_AT_A_TIME + span), np.float32)
    imaginary = np.empty_like(real)
    sums = np.empty((2, collected.shape[0], STEPS_AT_A_TIME), np.float32)
    for begin in range(0, steps, STEPS_AT_A_TIME):
        count = min(STEPS_AT_A_TIME, steps - begin)
        for first in range(0, sources, SOURCES_AT_A_TIME):
            last = min(first + SOURCES_AT_A_TIME, sources)
            for i in range(count + span):
                step = (begin + i - latest) % steps
                for q in range(first, last):
                    real[q, i], imaginary[q, i] = series[step, q].real, series[step, q].imag
        sums[:] = 0
        for e in range(lag.shape[0]):
            for q in range(sources):
                a, b = weight[e, q].real, weight[e, q].imag
                x, y = real[q, latest - lag[e, q] :], imaginary[q, latest - lag[e, q] :]
                u, v = sums[0, row[e, q]], sums[1, row[e, q]]
                for i in range(count):
                    u[i] += a * x[i] - b * y[i]
                    v[i] += a * y[i] + b * x[i]
        for r in range(collected.shape[0]):
            for i in range(count):
                collected[r, begin + i] = complex(sums[0, r, i], sums[1, r, i])
