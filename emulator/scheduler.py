"""Discrete events in integer time. The unit is the core cycle, 2.5 ns."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import count

__all__ = ["Scheduler"]


class Scheduler:
    """Runs actions in order of time; those of the same time in the order they were scheduled."""

    def __init__(self) -> None:
        self.now = 0
        self._queue: list[tuple[int, int, Callable[[], None]]] = []
        self._tie = count()

    def at(self, time: int, action: Callable[[], None]) -> None:
        """Run an action at a time, which must not lie in the past."""
        if time < self.now:
            raise ValueError(f"cycle {time} is in the past; it is cycle {self.now}")
        heapq.heappush(self._queue, (time, next(self._tie), action))

    def next_time(self) -> int | None:
        """Time of the next action, None if nothing is scheduled."""
        return self._queue[0][0] if self._queue else None

    def run_until(self, time: int) -> None:
        """Run everything due up to and including a time; afterwards it is that time."""
        while self._queue and self._queue[0][0] <= time:
            self.now, _, action = heapq.heappop(self._queue)
            action()
        self.now = max(self.now, time)
