"""What every driver processor is to its board, whatever runs in it: a place, a clock, pins and power."""

from __future__ import annotations

from abc import ABC, abstractmethod

from ...protocol.board import CHANNELS_PER_PROCESSOR, PROCESSORS
from ..ports.capture import Forced, Track
from ..ports.clock import BoardClock, Timebase
from ..scheduler import Scheduler

__all__ = ["AMBIENT_C", "SUPPLY_MV", "Package"]

AMBIENT_C = 25
SUPPLY_MV = 15_000
ALL_BITS = 2**CHANNELS_PER_PROCESSOR - 1


class Package(ABC):
    """A driver processor, seen from its board.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    place : int
        Its place in the chain, 0 to 9. The processor is not told.
    clock : BoardClock
        The ticks of its board.
    """

    def __init__(self, scheduler: Scheduler, place: int, clock: BoardClock) -> None:
        self._scheduler = scheduler
        self.place = place
        self.clock = clock
        self.temperature_c = AMBIENT_C
        self.forced: list[Forced] = []
        self.is_last = place == PROCESSORS - 1
        """Whether nothing gives credit on the link behind it."""
        self.stopped = False
        """Whether it has no power any more."""
        self.sync_connected = True
        self._time: Timebase | None = None

    @property
    def _tick(self) -> int:
        return 0 if self._time is None else max(self._time.tick(self._scheduler.now), 0)

    def stop(self) -> None:
        """Lose power: the pins fall low at once, and nothing is taken any more."""
        self.stopped = True
        self.force(low=ALL_BITS)

    def force(self, *, high: int = 0, low: int = 0) -> None:
        """Hold bits of the port from now on, besides those that are held already."""
        held = self.forced[-1] if self.forced else Forced(0)
        self._hold(held.high | high, held.low | low)

    def let_go(self, *, high: int = 0, low: int = 0) -> None:
        """Hold these bits of the port no more."""
        held = self.forced[-1] if self.forced else Forced(0)
        self._hold(held.high & ~high, held.low & ~low)

    def _hold(self, high: int, low: int) -> None:
        if (high, low) != (self.forced[-1][1:] if self.forced else (0, 0)):
            self.forced.append(Forced(self._tick, high, low))

    def set_clock_error(self, parts_per_billion: int) -> None:
        """Its board's oscillator runs fast from now on, or slow if negative."""
        self.clock.set_rate(self._tick, parts_per_billion)

    @property
    @abstractmethod
    def number(self) -> int | None:
        """The number that it took; None before (clause CHN-022)."""

    @abstractmethod
    def start(self, time: Timebase) -> None:
        """The first pulse of the sync line: period 0 begins."""

    @abstractmethod
    def take_up_pulses(self, tick: int) -> None:
        """Every pulse of the sync line up to a tick of the device, that of one of them, came in time."""

    @abstractmethod
    def feel_pulse(self, tick: int) -> None:
        """A later pulse of the sync line is due, at a tick of the device."""

    @abstractmethod
    def listen(self, since: int) -> None:
        """From now on questions come, counted from a core cycle."""

    @abstractmethod
    def set_temperature(self, celsius: int) -> None:
        """The board has another temperature."""

    @abstractmethod
    def set_supply(self, millivolts: int) -> None:
        """The output amplifiers get another voltage."""

    @abstractmethod
    def slow_down(self, slowness: int) -> None:
        """From now on everything takes so many times as long; 1 is as it should be."""

    @abstractmethod
    def track(self) -> Track:
        """What its port did so far."""

    @abstractmethod
    def forget(self, period: int) -> None:
        """Drop what its port did before a period of its own clock."""
