"""Which frames of a live source are news.

A tracker that hangs may go on sending: the same frame again and again, or new numbers with a time that stands still. So
the content of a frame says whether the tracker lives, not its arrival.
"""

from __future__ import annotations

from enum import StrEnum
from math import inf

from .frames import HandFrame

__all__ = ["MOST_AGE_SECONDS", "STEADY_SECONDS", "Liveness", "Stale"]

MOST_AGE_SECONDS = 0.2
"""The time of a frame that is news may differ from the clock by this. A camera of 20 pictures/s, the least that is
usable, whose hands are found in one picture after the other, is 50 ms late, and a service some ms; this is four times
as much. A hand at 0.5 m/s has moved by 100 mm by then."""
STEADY_SECONDS = 2 * MOST_AGE_SECONDS
"""For so long numbers and times must run on after they went back, as those of a tracker do that was restarted. It is
twice the greatest age, so that the times of news never decrease."""


class Stale(StrEnum):
    """Why a frame is no news."""

    REPEATED = "repeated the one before"
    NUMBER = "had a new time but the number of the one before"
    TIME = "had a new number but the time of the one before"
    BACK = f"went back in number or time, or came within {STEADY_SECONDS:g} s after one that did"
    AGE = f"had a time more than {MOST_AGE_SECONDS:g} s from their arrival"


class Liveness:
    """Judges the frames of one live source, one after the other.

    A frame is news if its number and its time are above those of the frame before it, and its age is at most
    `MOST_AGE_SECONDS`. After a number or a time that goes back there is no news until both have run on for
    `STEADY_SECONDS`.
    """

    def __init__(self) -> None:
        self._number: float = -inf
        self._time = self._ran_at = -inf
        self._doubted_since: float | None = None
        """Since when numbers and times run on after they went back; None if they have for long enough."""

    def stale(self, frame: HandFrame, now: float) -> Stale | None:
        """Why a frame is no news; None if it is.

        Parameters
        ----------
        frame : HandFrame
            The next one of the source.
        now : float
            When it came, in seconds of the clock that its time is by.
        """
        back = frame.number < self._number or frame.time < self._time
        counted, later = frame.number > self._number, frame.time > self._time
        self._number, self._time = frame.number, frame.time
        if not back and not (counted and later):
            return Stale.TIME if counted else Stale.NUMBER if later else Stale.REPEATED
        fresh = abs(now - frame.time) <= MOST_AGE_SECONDS
        gap, self._ran_at = now - self._ran_at, now
        if back or (self._doubted_since is not None and (not fresh or gap > MOST_AGE_SECONDS)):
            self._doubted_since = now
        if not fresh and not back:
            return Stale.AGE
        if self._doubted_since is not None and now - self._doubted_since < STEADY_SECONDS:
            return Stale.BACK
        self._doubted_since = None
        return None
