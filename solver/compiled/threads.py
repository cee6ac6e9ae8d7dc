"""Threads that share one big problem: kernels run without the interpreter's lock."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from numba import config

__all__ = ["THREADS", "share"]

THREADS: int = config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]  # numba has no types
"""numba's number: one for each core that the process may use, or ``$NUMBA_NUM_THREADS``."""


def share(work: Callable[[int], object], threads: int) -> None:
    """Call ``work`` with every number below ``threads``, each in a thread of its own."""
    if threads == 1:  # to start one takes 0.1 ms
        work(0)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(threads)))
