"""The clock of a device against the host's clock: offset and drift from readings that take time.

A reading says that the device's clock was at a tick at some moment between two moments of the host. Their middle is
wrong by at most half their distance, so faster readings have more weight.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import TICK_HZ, TICKS_PER_PERIOD

__all__ = ["DeviceClock", "Reading"]

READINGS = 64
LEAST_SPAN_SECONDS = 1.0
"""The least distance of first and last reading for a drift: half a millisecond over it is 500 ppm."""
LEAST_PAUSE_SECONDS = 1e-3
"""A device that lags by less may only drift."""
MOST_REFITS = 4
FINEST_SECONDS = 1e-6
"""The least uncertainty of a reading."""


class Reading(NamedTuple):
    """The device's clock was at `tick` between two moments of the host, in seconds."""

    before: float
    after: float
    tick: int

    @property
    def middle(self) -> float:
        """The best guess of the moment."""
        return (self.before + self.after) / 2

    @property
    def uncertainty(self) -> float:
        """The greatest error of that guess, in seconds."""
        return max((self.after - self.before) / 2, FINEST_SECONDS)


class DeviceClock:
    """An estimate of a device's clock, from the last 64 readings.

    Until they span a second the device is assumed to run at its nominal rate of 2 MHz.

    Attributes
    ----------
    drift_ppm : float
        How much faster than nominal the device runs, in millionths of its rate, by the host's clock.
    uncertainty : float
        The greatest error of the moment of the last reading, in seconds, wherever within the readings the device read
        its clock, apart from its rate.
    assumed_seconds : float
        How long before the last reading the estimate was made, as long as the rate is assumed; 0 once it is measured.

    Notes
    -----
    A device that a busy computer emulates is delayed at times, and catches up. A reading from such a pause contradicts
    the others by more than their uncertainty; it is left out, because it would distort the slope long after the pause.
    A device that is slow at every reading is believed.
    """

    def __init__(self) -> None:
        self._readings: deque[Reading] = deque(maxlen=READINGS)
        self.drift_ppm = 0.0
        self.uncertainty = float("inf")
        self.assumed_seconds = 0.0

    def add(self, reading: Reading) -> None:
        """Add a reading, not older than the last."""
        self._readings.append(reading)
        moments = np.array([each.middle for each in self._readings])
        ticks = np.array([each.tick - reading.tick for each in self._readings], np.float64)
        uncertainties = np.array([each.uncertainty for each in self._readings])
        agreed = np.ones(len(moments), np.bool_)
        for _ in range(MOST_REFITS):
            self._fit(moments[agreed], ticks[agreed], uncertainties[agreed], moments[-1])
            ahead = (moments - self._moment) * self._slope + self._tick - ticks
            held_up = ahead / TICK_HZ > uncertainties + self.uncertainty + LEAST_PAUSE_SECONDS
            if not (agreed & held_up).any() or (agreed & ~held_up).sum() <= len(moments) / 2:
                break
            agreed &= ~held_up
        self._tick += reading.tick
        self.drift_ppm = (self._slope / TICK_HZ - 1) * 1e6

    def _fit(
        self,
        moments: NDArray[np.float64],
        ticks: NDArray[np.float64],
        uncertainties: NDArray[np.float64],
        last: float,
    ) -> None:
        """Fit a line through readings, weighted by their precision, and find its error at the last moment."""
        weights = uncertainties**-2
        weights /= weights.sum()
        self._slope, self._moment, self._tick = float(TICK_HZ), float(weights @ moments), float(weights @ ticks)
        shares = weights  # of each reading in the estimate at the last moment
        self.assumed_seconds = last - self._moment
        if moments[-1] - moments[0] >= LEAST_SPAN_SECONDS:
            away = moments - self._moment
            slopes = weights * away / np.sum(weights * away**2)
            self._slope = float(slopes @ ticks)
            shares = weights + slopes * (last - self._moment)
            self.assumed_seconds = 0.0
        self.uncertainty = float(np.abs(shares) @ uncertainties)

    @property
    def longest(self) -> float:
        """How long the longest of these readings took, in seconds; there must be one."""
        return max(each.after - each.before for each in self._readings)

    @property
    def usual(self) -> float:
        """How long the middle one of these readings took, in seconds; there must have been one."""
        return median(each.after - each.before for each in self._readings)

    def period_at(self, moment: float) -> float:
        """Carrier period, with its fraction, at a moment of the host; there must be a reading."""
        return ((moment - self._moment) * self._slope + self._tick) / TICKS_PER_PERIOD

    def moment_of(self, period: float) -> float:
        """When a carrier period begins, by the host's clock in seconds."""
        return (period * TICKS_PER_PERIOD - self._tick) / self._slope + self._moment
