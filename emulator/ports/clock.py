"""Clocks: the periods of a device, and the port clock of a board, which need not agree with them.

Two units meet here. The scheduler counts core cycles from when power was first applied; a device counts ticks and
periods from its period 0 (clause TIM-002). A board whose oscillator is shared counts the same ticks; one whose clock
runs late, fast or slow has a count of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import CYCLES_PER_PERIOD, CYCLES_PER_TICK

__all__ = ["COUNTER_TICKS", "BoardClock", "Timebase"]

COUNTER_TICKS = 2**16
"""A port's counter has 16 bits: it wraps every 32.768 ms, which is no whole number of periods (clause TIM-004).

No output uses it: the period comes from `own_tick`, which has no limit. The counter serves only
`Processor.feel_pulse`.
"""
BILLION = 10**9


@dataclass(frozen=True)
class Timebase:
    """The periods of a device."""

    origin: int

    def tick(self, cycle: int) -> int:
        """The tick that a core cycle lies in, counted from period 0."""
        return (cycle - self.origin) // CYCLES_PER_TICK

    def period(self, cycle: int) -> int:
        """The period that a core cycle lies in."""
        return (cycle - self.origin) // CYCLES_PER_PERIOD

    def boundary(self, period: int) -> int:
        """Core cycle at which a period begins."""
        return self.origin + period * CYCLES_PER_PERIOD

    def first_boundary(self, cycle: int) -> int:
        """The first period that begins at a core cycle or later."""
        return -((self.origin - cycle) // CYCLES_PER_PERIOD)


class BoardClock:
    """The ticks of one board against those of the device: a straight line with a bend wherever its rate was changed."""

    def __init__(self, offset_ticks: int = 0) -> None:
        self._bends = [(0, -offset_ticks, 0)]  # from a tick of the device on: the board's tick there, and its rate

    def set_rate(self, tick: int, parts_per_billion: int) -> None:
        """Let the board's oscillator run fast (or slow, if negative) from a tick of the device on."""
        if parts_per_billion != self._bends[-1][2]:
            self._bends.append((tick, self.own_tick(tick), parts_per_billion))

    @property
    def exact(self) -> bool:
        """Whether it has always agreed with the device."""
        return self._bends == [(0, 0, 0)]

    def own_tick(self, tick: int) -> int:
        """The board's tick at a tick of the device; negative before it has started."""
        since, own, rate = next(bend for bend in reversed(self._bends) if bend[0] <= max(tick, 0))
        return own + tick - since + (tick - since) * rate // BILLION

    def tick_of(self, own: int) -> int:
        """The first tick of the device at which the board has come to a tick of its own."""
        if self.exact:
            return own
        tick = max(own - self.own_tick(0), 0)
        while self.own_tick(tick) < own:
            tick += max((own - self.own_tick(tick)) * 9 // 10, 1)
        while tick and self.own_tick(tick - 1) >= own:
            tick -= 1
        return tick

    def own_ticks(self, start: int, stop: int) -> NDArray[np.int64]:
        """The board's ticks at a stretch of the device's, (stop - start,)."""
        ticks = np.arange(start, stop, dtype=np.int64)
        own = np.empty_like(ticks)
        for since, at_bend, rate in self._bends:
            after = ticks >= since if since else np.ones(ticks.size, bool)
            passed = ticks[after] - since  # times the rate alone it fits 64 bits for months, times a billion not
            own[after] = at_bend + passed + passed * rate // BILLION
        return own

    def counter(self, tick: int) -> int:
        """The port's 16-bit counter at a tick of the device."""
        return self.own_tick(tick) % COUNTER_TICKS
