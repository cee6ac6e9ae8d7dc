"""Distributions of durations in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log10

__all__ = ["Latencies", "Latency"]

SHORTEST_SECONDS = 1e-6
PER_DECADE = 48
"""Bins for each factor of ten: a quantile is at most 5 % above the true one."""
BINS = 7 * PER_DECADE + 2
"""Up to 10 s, and one bin for what is shorter and one for what is longer."""


@dataclass(frozen=True)
class Latency:
    """A distribution in a few numbers.

    Parameters
    ----------
    count : int
        How many durations there were.
    median_seconds, p99_seconds : float
        Quantiles 0.5 and 0.99, rounded up by at most 5 %.
    worst_seconds : float
        The longest, exactly.
    """

    count: int = 0
    median_seconds: float = 0.0
    p99_seconds: float = 0.0
    worst_seconds: float = 0.0

    def __str__(self) -> str:
        """In milliseconds, for people."""
        median, p99, worst = (each * 1e3 for each in (self.median_seconds, self.p99_seconds, self.worst_seconds))
        return f"{median:.2f} ms median, {p99:.2f} ms 99 %, {worst:.2f} ms worst"


class Latencies:
    """Durations as they come, counted in logarithmic bins, so that hours of them take no more memory than one."""

    def __init__(self) -> None:
        self._bins = [0] * BINS
        self._count = 0
        self._worst = 0.0

    def add(self, seconds: float) -> None:
        """Count a duration in seconds."""
        place = 0
        if seconds > SHORTEST_SECONDS:
            place = min(ceil(PER_DECADE * log10(seconds / SHORTEST_SECONDS)), BINS - 1)
        self._bins[place] += 1
        self._count += 1
        self._worst = max(self._worst, seconds)

    def quantile(self, share: float) -> float:
        """The duration in seconds that a share of all, 0 to 1, does not exceed: the upper end of its bin."""
        wanted, seen = share * self._count, 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= wanted and seen:
                return min(SHORTEST_SECONDS * 10 ** (place / PER_DECADE), self._worst)
        return 0.0

    @property
    def summary(self) -> Latency:
        """As it stands."""
        return Latency(self._count, self.quantile(0.5), self.quantile(0.99), self._worst)
