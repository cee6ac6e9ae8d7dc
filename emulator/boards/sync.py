"""The sync line: high for one tick at the beginning of every 4096th period of the device that drives it (CHN-026)."""

from __future__ import annotations

from collections.abc import Callable

from ...protocol.board import CYCLES_PER_PERIOD
from ...protocol.codes import SYNC_PERIODS

__all__ = ["SyncLine"]

PULSE_CYCLES = SYNC_PERIODS * CYCLES_PER_PERIOD


class SyncLine:
    """When pulses come. Core cycles since all devices on the line got power."""

    def __init__(self) -> None:
        self._first: int | None = None
        self._listeners: set[Callable[[int], None]] = set()

    def drive(self, first: int) -> None:
        """The driving device begins its period 0."""
        self._first = first

    def next_pulse(self, cycle: int) -> int | None:
        """The first pulse at or after a core cycle; None if nobody drives the line."""
        if self._first is None:
            return None
        return self._first + max(-((self._first - cycle) // PULSE_CYCLES), 0) * PULSE_CYCLES

    def listen(self, lose: Callable[[int], None]) -> None:
        """From now on tell a device, once, if the driving one begins anew: the core cycle from which on pulses fail."""
        self._listeners.add(lose)

    def fail(self, cycle: int) -> None:
        """The driving device has lost its power, or begins anew: its pulses come no more as they did."""
        self._first = None
        listeners, self._listeners = self._listeners, set()
        for lose in listeners:
            lose(cycle)
