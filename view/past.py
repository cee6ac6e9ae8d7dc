"""The last seconds, to go back to."""

from __future__ import annotations

from collections import deque

from ..protocol.board import CARRIER_HZ
from .snapshot import Snapshot

__all__ = ["HISTORY_PERIODS", "PAST_SECONDS", "Past"]

PAST_SECONDS = 10
HISTORY_PERIODS = (PAST_SECONDS + 1) * CARRIER_HZ
"""Carrier periods that an emulated device has to keep for it."""
MOST_SNAPSHOTS = 1000
"""More than come in that time; a device's clock that starts anew must not let them grow."""


class Past:
    """The snapshots of the last `PAST_SECONDS` of a device's time; older ones are dropped."""

    def __init__(self) -> None:
        self._kept: deque[Snapshot] = deque(maxlen=MOST_SNAPSHOTS)

    def __len__(self) -> int:
        return len(self._kept)

    def add(self, snapshot: Snapshot) -> None:
        """Add the newest; if the device's time began anew, the others are dropped."""
        if self._kept and snapshot.period < self._kept[-1].period:
            self._kept.clear()
        self._kept.append(snapshot)
        while self._kept[0].period < snapshot.period - PAST_SECONDS * CARRIER_HZ:
            self._kept.popleft()

    @property
    def span(self) -> tuple[int, int] | None:
        """The oldest and the newest period; None if there is none."""
        return (self._kept[0].period, self._kept[-1].period) if self._kept else None

    def at(self, period: int) -> Snapshot | None:
        """The newest snapshot that is not after a period, else the oldest; None if there is none."""
        return next(
            (each for each in reversed(self._kept) if each.period <= period), self._kept[0] if self._kept else None
        )
