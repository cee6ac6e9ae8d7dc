"""A served device: its time, and all conversations with it, advanced together.

A device model is not thread-safe and its time does not run by itself. A station lets it pass, and gives every
conversation its turn at the right moment of the device's time. There are two paces: with the wall clock, or as far as
the conversations need it. The second is repeatable for a client that waits for each answer: the same requests then find
the device at the same times, however slow the client is.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum
from typing import Protocol

from ...protocol.board import CORE_HZ, CYCLES_PER_MS
from ..scheduler import Scheduler

__all__ = ["Conversation", "Pace", "Station"]

LINGER_CYCLES = CORE_HZ // 40
"""At the fast pace, how long events in the device are waited for after its last received data: 25 ms, in which
everything has begun that must begin within 20 ms of a request, and a quarter of the watchdog's time."""

STEP_CYCLES = CYCLES_PER_MS
"""The greatest step of time before the caller may stop it."""

STALL_SECONDS = 0.02
CATCH_UP = 2
"""Missed time passes at twice the pace of the clock, and a pause counts as 20 ms. So a client that gives three signs of
life in the watchdog's time is in time even after a pause of this program."""

IDLE_SECONDS = 0.01
"""How far the device's time may lag the wall clock without a visible effect. A device without events is also served
this often: a pause of more than `STALL_SECONDS` would count as a delay of this program."""


class Pace(Enum):
    """What makes a device's time pass."""

    WALL = "wall"
    """The wall clock; what could not be computed in time is caught up."""

    FAST = "fast"
    """The work: as much as transfers take, and as the device needs to come to rest after each."""


class Conversation(Protocol):
    """A partner of a device, in its time: the bytes of a client on one side, a line of the device on the other."""

    @property
    def pending(self) -> int:
        """Bytes that wait for the client."""

    @property
    def full(self) -> bool:
        """Whether the client should pause its output."""

    @property
    def over(self) -> bool:
        """Whether the client is to be dropped after it has received its pending data."""

    @property
    def presses(self) -> bool:
        """Whether some data are under way, so that time must pass at the fast pace too."""

    @property
    def stuck(self) -> bool:
        """Whether the device cannot receive its data now, but may later."""

    @property
    def last_word(self) -> int | None:
        """When the device last received data of the client, in its time; None if never."""

    def receive(self, data: bytes) -> None:
        """Take bytes of the client; raises nothing for any bytes."""

    def take(self, room: int) -> bytes:
        """Return at most so many bytes for the client."""

    def hang_up(self) -> None:
        """The client has gone."""

    def next_time(self, event: int | None) -> int | None:
        """The time of its next action, if no one else acts; the device's own is `event`."""

    def run(self) -> None:
        """Perform the actions that are due."""


class Station:
    """A device's time, and the conversations with it.

    Parameters
    ----------
    scheduler : Scheduler
        The device's time.
    pace : Pace
        What makes it pass.
    clock : callable
        The wall clock, in seconds, which never goes back.
    patient : callable
        Whether the device currently waits for no sign of life. Then a pause is caught up at once, and a client that was
        told to wait, as in DFU, has waited in the device's time too.

    Attributes
    ----------
    conversations : list of Conversation
        The partners of the device.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        pace: Pace,
        clock: Callable[[], float] = time.monotonic,
        patient: Callable[[], bool] = lambda: False,
    ) -> None:
        self.scheduler = scheduler
        self.conversations: list[Conversation] = []
        self.patient = patient
        self._pace = pace
        self._clock = clock
        self._power_up = clock() - scheduler.now / CORE_HZ
        self._last_look = clock()
        self._rest_by = scheduler.now

    def pass_time(self, seconds: float) -> bool:
        """Advance the device's time as its pace requires, for at most so many seconds of the clock.

        Returns
        -------
        bool
            Whether it came that far; otherwise call again.
        """
        end = self._clock() + seconds
        target = self._next_target()
        while self._step(target):
            if self._clock() >= end:
                return False
        return True

    def seconds_to_wait(self) -> float | None:
        """The time until the next action, in seconds of the clock; None until new input.

        It is negative if an action is overdue because this program was delayed.
        """
        event = self.scheduler.next_time()
        turn = self._turn(event)
        if turn is None and event is None:
            return None
        if self._pace is Pace.FAST:
            return IDLE_SECONDS if any(each.stuck for each in self.conversations) else None
        if turn is None:
            return IDLE_SECONDS
        return min(self._power_up + turn / CORE_HZ - self._clock(), IDLE_SECONDS)

    @property
    def seconds_behind(self) -> float:
        """How far the device's time lags the clock, because the model is slower than the device."""
        return (self._target() - self.scheduler.now) / CORE_HZ if self._pace is Pace.WALL else 0.0

    def _target(self) -> int:
        return int((self._clock() - self._power_up) * CORE_HZ)

    def _next_target(self) -> int:
        """How far time should advance now by the clock: after a pause no faster than clients can follow."""
        passed = self._clock() - self._last_look
        self._last_look += passed
        step = int(min(passed, STALL_SECONDS) * CORE_HZ)
        if self._pace is Pace.FAST:
            return self.scheduler.now + step
        event = self.scheduler.next_time()
        resting = event is None and self._turn(event) is None
        if resting or self.patient():
            return self._target()
        return min(self._target(), self.scheduler.now + CATCH_UP * step)

    def _turn(self, event: int | None) -> int | None:
        """The time of a conversation's next action."""
        times = (each.next_time(event) for each in self.conversations)
        return min((time for time in times if time is not None), default=None)

    def _step(self, target: int) -> bool:
        """Let time pass until the next action, or a short step; returns False if it has passed far enough."""
        event = self.scheduler.next_time()
        stop = self._next_stop(self._turn(event), event, target)
        if stop is None:
            return False
        self.scheduler.run_until(max(stop, self.scheduler.now))
        for each in tuple(self.conversations):
            each.run()
        return True

    def _next_stop(self, turn: int | None, event: int | None, target: int) -> int | None:
        if self._pace is Pace.FAST:
            words = (each.last_word for each in self.conversations if each.last_word is not None)
            self._rest_by = max([self._rest_by, *(word + LINGER_CYCLES for word in words)])
            if turn is not None and (turn <= self._rest_by or any(each.presses for each in self.conversations)):
                return turn
            if event is not None and event <= self._rest_by:
                return event
            if not any(each.stuck for each in self.conversations):
                return None
        now = self.scheduler.now
        stop = min(time for time in (target, now + STEP_CYCLES, turn) if time is not None)
        return stop if stop > now or (turn is not None and turn <= now) else None
