"""A clock for tests."""

from __future__ import annotations


class Clock:
    """Time that passes only during a wait."""

    def __init__(self, now: float = 1000.0) -> None:
        self.now = now

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float, /) -> None:
        assert seconds > 0
        self.now += seconds
