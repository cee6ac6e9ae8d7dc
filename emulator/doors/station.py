"""A device on its stand: its time, and everyone who speaks to it, moved on together.

The model of a device knows no threads and its time does not run by itself. A station lets it pass, and gives every
conversation its turn at the moment, in the device's time, at which it has something to do. Two paces: with the wall
clock, or as far as the conversations need it. The second is repeatable for a client that waits for each answer: the
same requests then find the device at the same times, however slow the client is.
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
"""How long what happens in the device is waited for at the fast pace, after the last word that it heard: 25 ms, in
which everything has begun that is to begin within 20 ms of a request, and a quarter of the watchdog's time."""

STEP_CYCLES = CYCLES_PER_MS
"""How far time passes at most before somebody may call a halt."""

STALL_SECONDS = 0.02
CATCH_UP = 2
"""What was missed is caught up at twice the pace of the clock, and a pause counts as 20 ms. So a client that gives
three signs of life in the time of the watchdog is in time also when this program was held up."""

IDLE_SECONDS = 0.01
"""How far the device's time may fall behind the wall clock while nobody would see it. Also who waits for the device is
looked after so often: a pause of more than `STALL_SECONDS` would be taken for one in which this program was held up."""


class Pace(Enum):
    """What makes a device's time pass."""

    WALL = "wall"
    """The clock of the world; what could not be computed in time is caught up."""

    FAST = "fast"
    """What is to be done: as much as transfers take, and as the device needs to come to rest after each."""


class Conversation(Protocol):
    """One who speaks to a device, in its time: the bytes of a client on one side, a line of the device on the other."""

    @property
    def pending(self) -> int:
        """Bytes that wait for the client."""

    @property
    def full(self) -> bool:
        """Whether the client should send no more for now."""

    @property
    def over(self) -> bool:
        """Whether the client is to be left, once it has what is pending."""

    @property
    def presses(self) -> bool:
        """Whether something of it is under way, so that time must pass at the fast pace too."""

    @property
    def stuck(self) -> bool:
        """Whether the device does not hear for now what it says; perhaps it would later."""

    @property
    def last_word(self) -> int | None:
        """When the device last heard something of the client, in its time; None if never."""

    def receive(self, data: bytes) -> None:
        """Take bytes of the client. Whatever they are, nothing is raised for them."""

    def take(self, room: int) -> bytes:
        """Give bytes to the client, at most so many."""

    def hang_up(self) -> None:
        """The client has gone."""

    def next_time(self, event: int | None) -> int | None:
        """When it has something to do, if nobody else acts; the device itself does at `event`."""

    def run(self) -> None:
        """Do what is due now."""


class Station:
    """A device's time, and the conversations with it.

    Parameters
    ----------
    scheduler : Scheduler
        The device's time.
    pace : Pace
        What makes it pass.
    clock : callable
        A clock of the world, in seconds, which never goes back.
    patient : callable
        Whether the device waits for no sign of life now. Then a pause is not caught up slowly, and a client that was
        told to wait, as in DFU, has waited in the device's time too.

    Attributes
    ----------
    conversations : list of Conversation
        Those who speak to the device.
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
        """Let the device's time pass as far as its pace has it, for at most so many seconds of the clock.

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
        """How long nobody will have anything to do, in seconds of the clock; None if until somebody stirs.

        It is less than 0 if somebody's turn is over already, because this program was held up.
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
        """How far the device's time is behind the clock: what a model that is slower than the device falls back."""
        return (self._target() - self.scheduler.now) / CORE_HZ if self._pace is Pace.WALL else 0.0

    def _target(self) -> int:
        return int((self._clock() - self._power_up) * CORE_HZ)

    def _next_target(self) -> int:
        """How far time should pass now, where the clock decides: after a pause no faster than clients can follow."""
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
        """When a conversation has something to do."""
        times = (each.next_time(event) for each in self.conversations)
        return min((time for time in times if time is not None), default=None)

    def _step(self, target: int) -> bool:
        """Let time pass until somebody has something to do, or a little on; False where it has passed far enough."""
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
