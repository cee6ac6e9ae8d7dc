"""One clock for several devices: their periods by the count of the first.

On one sync line the periods of all begin in the same ticks, and their counts differ by a constant (clause CHN-026): the
last pulse of each, and a whole number of the line's pulses between these. The host's estimates of the clocks say how
many. They also say whether there is such a line: without one pulses do not coincide. Then only the estimates relate the
devices, and their error is that of the fields.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ...base.errors import DeviceError
from ...protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from ...protocol.codes import SYNC_PERIODS
from ...protocol.replies import ClockReading
from ..transports.transport import Timekeeper
from .clock import DeviceClock

__all__ = ["CommonClock", "CommonTime", "common_time"]

MOST_UNSURE_PERIODS = SYNC_PERIODS // 100
"""Pulses of devices without a common line coincide within these by chance once in 50 times, and not for long."""
DELAY_PERIODS, DELAY_SECONDS = 400, 2.0
"""A device that a busy computer emulates may lag by this many periods; by more for at most this many seconds. A device
that misses the line's pulses also notices it itself (clause CHN-027)."""
QUARTZ_PPM = 100
"""The greatest difference of the rates of two quartz clocks, in millionths; used until it is measured."""
SLIP_PERIODS = 0.75
"""An offset is kept until the estimate differs from it by more than this, so that it does not flicker."""


class CommonTime:
    """The time of several devices, of which each may keep its own, as emulated ones in this process do.

    Parameters
    ----------
    keepers : sequence of Timekeeper
        Theirs.
    """

    def __init__(self, keepers: Sequence[Timekeeper]) -> None:
        self._keepers = keepers

    def monotonic(self) -> float:
        """Seconds, of the device that has come furthest."""
        return max(keeper.monotonic() for keeper in self._keepers)

    def sleep(self, seconds: float, /) -> None:
        """Let time pass, and bring all to the same moment."""
        end = self.monotonic() + seconds
        for keeper in self._keepers:
            if (left := end - keeper.monotonic()) > 0:
                keeper.sleep(left)


def common_time(keepers: Iterable[Timekeeper]) -> Timekeeper:
    """The time of several devices; that of one, or of all that wait by the same clock, is theirs."""
    different = list(dict.fromkeys(keepers))
    return different[0] if len(different) == 1 else CommonTime(different)


class CommonClock:
    """The counts of periods of several devices, related to that of the first.

    Parameters
    ----------
    names : sequence of str
        The names of the devices, for errors.
    readings : sequence of ClockReading
        A reading of each device.

    Attributes
    ----------
    shared : bool
        Whether the devices share a sync line.
    offsets : list of int
        The number of periods by which the count of each device is ahead of the first one's.
    error : float
        The greatest distance of periods that should coincide, in seconds: 0 on one sync line, else as estimated.
    drift_ppm : float
        The greatest difference of two clocks' rates, in millionths, by the host's clock; 0 on one sync line.
    """

    def __init__(self, names: Sequence[str], readings: Sequence[ClockReading]) -> None:
        self._names = names
        self._pulses = [reading.sync_period for reading in readings]
        self._pulsed = all(
            reading.now // TICKS_PER_PERIOD - reading.sync_period <= SYNC_PERIODS for reading in readings
        )
        self._together_at = 0.0
        self.shared = False
        self.offsets = [0] * len(readings)
        self.error = float("inf")
        self.drift_ppm = 0.0

    def __str__(self) -> str:
        """One line for people."""
        if self.shared:
            return "one clock: the devices share a sync line" if len(self.offsets) > 1 else "one clock"
        return (
            f"clocks estimated to {self.error * 1e6:.0f} µs; they drift apart by {self.drift_ppm:.1f} ppm: no coherent "
            f"focus, because a carrier period is {1e6 / CARRIER_HZ:g} µs"
        )

    def meet(self, clocks: Sequence[DeviceClock], moment: float) -> bool:
        """Find out whether the devices share a sync line, at a moment of the host; returns it."""
        apart, unsure = _apart(clocks, moment), _unsure(clocks)
        self.offsets = [self._by_pulses(place, periods) for place, periods in enumerate(apart)]
        self.shared = len(clocks) == 1 or (
            self._pulsed
            and all(
                abs(periods - offset) <= least <= MOST_UNSURE_PERIODS
                for periods, offset, least in zip(apart[1:], self.offsets[1:], unsure[1:], strict=True)
            )
        )
        self._together_at = moment
        if not self.shared:
            self.offsets = [round(periods) for periods in apart]
        self.follow(clocks, moment)
        return self.shared

    def follow(self, clocks: Sequence[DeviceClock], moment: float) -> None:
        """Take account of new readings of the devices' clocks.

        Raises
        ------
        DeviceError
            If a device of a common sync line has lost it.
        """
        apart, unsure = _apart(clocks, moment), _unsure(clocks)
        off = [abs(periods - offset) for periods, offset in zip(apart, self.offsets, strict=True)]
        if self.shared:
            self.error = 0.0
            beyond = [distance - least - DELAY_PERIODS for distance, least in zip(off, unsure, strict=True)]
            worst = max(range(len(beyond)), key=beyond.__getitem__)
            if beyond[worst] <= 0:
                self._together_at = moment
            elif moment - self._together_at > DELAY_SECONDS:
                raise DeviceError(
                    f"{self._names[worst]} has lost the common clock: its periods are now {off[worst]:.0f} periods off "
                    f"those of {self._names[0]}; check the sync line between them, and open the devices again"
                )
            return
        self.offsets = [
            round(periods) if distance > SLIP_PERIODS else offset
            for periods, distance, offset in zip(apart, off, self.offsets, strict=True)
        ]
        self.error = max(
            (abs(periods - offset) + least) / CARRIER_HZ
            for periods, offset, least in zip(apart[1:], self.offsets[1:], unsure[1:], strict=True)
        ) + QUARTZ_PPM * 1e-6 * max(clock.assumed_seconds for clock in clocks)
        drifts = [clock.drift_ppm for clock in clocks]
        self.drift_ppm = max(drifts) - min(drifts)

    def _by_pulses(self, place: int, periods: float) -> int:
        """The constant by which a device's count is ahead if it shares the line, nearest to an estimate."""
        between = self._pulses[place] - self._pulses[0]
        return between + SYNC_PERIODS * round((periods - between) / SYNC_PERIODS)


def _apart(clocks: Sequence[DeviceClock], moment: float) -> list[float]:
    """By how many periods the count of each device is ahead of the first one's at a moment of the host."""
    first = clocks[0].period_at(moment)
    return [clock.period_at(moment) - first for clock in clocks]


def _unsure(clocks: Sequence[DeviceClock]) -> list[float]:
    """The greatest errors of `_apart`."""
    first = clocks[0].uncertainty
    return [(clock.uncertainty + first) * CARRIER_HZ for clock in clocks]
