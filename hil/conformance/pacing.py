"""How a case and a device share time: waits by the device's own clock, which may lag behind that of the host."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from math import ceil

from ...protocol.board import CARRIER_HZ, TICK_HZ, TICKS_PER_PERIOD
from ...protocol.codes import RESTART_SECONDS
from ...protocol.replies import ClockReading
from .transports.line import RawLine

__all__ = ["MOST_SLOWNESS", "Pacing"]

LAST_LOOK_SECONDS = 0.1
"""Time for a device's data to reach this program."""
WAIT_SECONDS = 1.0
"""What a line and a computer may add to a wait for a tick."""
PACE_SECONDS = 0.1
"""The least time over which the device's clock is compared with the host's."""
MOST_SLOWNESS = 64
"""Periods are then named 3.2 s ahead."""
RETURN_SECONDS = RESTART_SECONDS + 1.0
"""Time for a device to come back after a restart (clause TIM-002), and for the computer to find it."""


class Pacing(ABC):
    """The time of a device, as a case waits for it.

    Parameters
    ----------
    line : RawLine
        The line to the device.

    Attributes
    ----------
    slowness : int
        Factor on the waiting time of cases before something happens.
    pace : float
        The time of the device for one second of the host, as last measured; at most 1.
    """

    def __init__(self, line: RawLine) -> None:
        self.line = line
        self.slowness = 1
        self.pace = 1.0
        self._paced_from = 0, 0.0
        self._known_tick, self._known_at = 0, 0.0

    @abstractmethod
    def clock(self) -> ClockReading:
        """Ask for CLOCK, and note the tick by `_know`."""

    @property
    def is_far(self) -> bool:
        """Whether the device's time is not that of this process: either may lag."""
        return self.line.time is time

    def slow_down(self) -> bool:
        """Give cases more time from now on, because one had too little; returns whether more could be given."""
        if not self.is_far or self.slowness >= MOST_SLOWNESS:
            return False
        self.slowness *= 4
        return True

    def wait(self, seconds: float) -> None:
        """Let time pass for the host; a simulated device may lag."""
        self.line.time.sleep(seconds)

    def outlast(self, seconds: float) -> None:
        """Let time pass for the device, which must answer CLOCK: this is neither a sign of life nor a change."""
        due = self.clock().now + ceil(seconds * TICK_HZ) if self.is_far else 0
        self.wait(seconds)
        if self.is_far:
            self._wait_until_tick(due)

    def paced(self, seconds: float) -> float:
        """How long so much time of a device takes for the host, by its pace before: it may have no clock to ask for."""
        return seconds / self.pace

    @property
    def return_seconds(self) -> float:
        """The longest time until a device is back after a restart."""
        return self.paced(RETURN_SECONDS)

    def wait_periods(self, periods: float) -> None:
        """Let carrier periods of the device pass."""
        self.outlast(periods / CARRIER_HZ)

    def wait_until(self, period: int) -> None:
        """Let time pass until a carrier period of the device has begun by its own clock, while that comes nearer."""
        self._wait_until_tick(period * TICKS_PER_PERIOD)

    def _wait_until_tick(self, tick: int) -> None:
        for left in self._left_until(tick):
            self.wait((left + 1) / TICK_HZ)

    def _left_until(self, tick: int) -> Iterator[int]:
        """The ticks that the device still has to go, asked repeatedly.

        No wait is longer than the case asked for when it named the tick, and the waits end if the clock does not come
        nearer, or hardly: it may be as slow as cases can be made (`MOST_SLOWNESS`).
        """
        now, began, first = self.line.time.monotonic, self.line.time.monotonic(), None
        least = named = self.line.watch.highest
        while (left := tick - (told := self.clock().now)) > 0:
            first = told if first is None else first
            due = (now() - began - WAIT_SECONDS) * TICK_HZ / (MOST_SLOWNESS if self.is_far else 1)
            comes_nearer = told >= least and told - first >= due
            assert comes_nearer, (
                f"the clock does not reach tick {tick}: it named tick {named} before the wait, {first} at its begin "
                f"and {told} after {now() - began:.3f} s"
            )
            yield left
            least = told + 1

    def _looks(self, seconds: float) -> Iterator[float]:
        """Repeat while the device may still send something, until the time is over.

        It is over when host and device agree that it is, and what was sent before has arrived.
        """
        due = self.clock().now + ceil(seconds * TICK_HZ) if self.is_far else 0
        end = self.line.time.monotonic() + seconds
        while (left := end - self.line.time.monotonic()) > 0:
            yield left
        if self.is_far:
            for ticks in self._left_until(due):
                yield (ticks + 1) / TICK_HZ
            yield LAST_LOOK_SECONDS

    def period(self) -> int:
        """The device's present carrier period, by its own clock."""
        return self.clock().now // TICKS_PER_PERIOD

    def _know(self, tick: int) -> None:
        """Note the device's tick, and after some time how fast it counts."""
        self._known_tick, self._known_at = tick, self.line.time.monotonic()
        first, at = self._paced_from
        passed = self._known_at - at
        if at and tick >= first and passed < PACE_SECONDS:
            return
        if at and tick >= first:
            self.pace = min(max((tick - first) / TICK_HZ / passed, 1 / MOST_SLOWNESS), 1.0) if self.is_far else 1.0
        self._paced_from = tick, self._known_at

    def measure_pace(self) -> None:
        """Compare the device's clock with the host's, before the device has none to ask for."""
        if self.is_far:
            self._paced_from = self.clock().now, self.line.time.monotonic()
            self.wait(PACE_SECONDS)
            self.clock()

    def _is_over(self, began: float, seconds: float) -> bool:
        """Whether time is over by the host's clock and, if the device is slower, by the device's."""
        passed = self.line.time.monotonic() - began
        if passed >= seconds and self.is_far:
            self.clock()
        return passed >= self.paced(seconds)
