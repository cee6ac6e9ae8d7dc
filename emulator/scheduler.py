"""Discrete events in integer time. The unit is the core cycle, 2.5 ns."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import count

__all__ = ["NEVER", "Branch", "Scheduler"]

NEVER = 2**62
"""A core cycle that does not come: it is more than three centuries away, and fits 64 bits."""


class Scheduler:
    """Runs actions in order of time; those of the same time in the order they were scheduled."""

    def __init__(self) -> None:
        self._now = 0
        self._queue: list[tuple[int, int, Callable[[], None], Branch | None]] = []
        self._tie = count()

    @property
    def now(self) -> int:
        """Core cycles that have passed."""
        return self._now

    def at(self, time: int, action: Callable[[], None]) -> None:
        """Run an action at a time, which must not lie in the past."""
        self.enter(time, action, None)

    def enter(self, time: int, action: Callable[[], None], owner: Branch | None) -> None:
        """The same for an action of a branch."""
        if time < self._now:
            raise ValueError(f"cycle {time} is in the past; it is cycle {self._now}")
        heapq.heappush(self._queue, (time, next(self._tie), action, owner))

    def drop(self, owner: Branch) -> None:
        """Forget what belongs to a branch."""
        self._queue = [entry for entry in self._queue if entry[3] is not owner]
        heapq.heapify(self._queue)

    def next_time(self) -> int | None:
        """Time of the next action, None if nothing is scheduled."""
        return self._queue[0][0] if self._queue else None

    def run_until(self, time: int) -> None:
        """Run everything due up to and including a time; afterwards it is that time.

        An action may do the same; what it leaves is run after it.
        """
        while self._queue and self._queue[0][0] <= time:
            due, _, action, _ = heapq.heappop(self._queue)
            self._now = max(self._now, due)
            action()
        self._now = max(self._now, time)


class Branch(Scheduler):
    """A part of another schedule that ends as a whole: what goes on inside something that may lose its power.

    Parameters
    ----------
    trunk : Scheduler
        Keeps the time.
    """

    def __init__(self, trunk: Scheduler) -> None:
        self._trunk = trunk
        self._ended = False

    @property
    def now(self) -> int:
        """Core cycles that have passed."""
        return self._trunk.now

    def at(self, time: int, action: Callable[[], None]) -> None:
        """Run an action at a time, unless the branch has ended, or will have by then."""
        if not self._ended:
            self._trunk.enter(time, action, self)

    def next_time(self) -> int | None:
        """Time of the next action of the whole schedule."""
        return self._trunk.next_time()

    def run_until(self, time: int) -> None:
        """Let the whole schedule come to a time."""
        self._trunk.run_until(time)

    def end(self) -> None:
        """Nothing of it happens any more, and nothing of it is kept."""
        self._ended = True
        self._trunk.drop(self)
