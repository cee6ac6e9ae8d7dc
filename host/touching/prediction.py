"""Where hands will be when the field for them begins: a frame is always older than what is played for it."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

from ...solver.contact.hand import Hand, Side
from ..hands.frames import HandFrame

__all__ = ["MOST_AHEAD_SECONDS", "Predictor"]

MOST_AHEAD_SECONDS = 0.05
MOST_SPEED = 4.0
"""In m/s. What is faster is taken for a jump of the tracking: hands above an array stay well below it."""
SMOOTH_SECONDS = 0.01
"""Over which a velocity is smoothed, for the tracker's noise is divided by a short time."""
OLDEST_SECONDS = 0.2
"""Between two frames of a hand; after a longer gap nothing is known of its velocity."""


Velocity: TypeAlias = tuple[float, float, float]
STILL: Velocity = (0.0, 0.0, 0.0)


class _Seen(NamedTuple):
    """A hand as it was seen last."""

    time: float
    place: list[float]
    velocity: Velocity


class Predictor:
    """Moves the hands of each frame ahead by their velocity, which it learns from frame to frame.

    The velocity is that of the palm's middle: a hand is moved as a whole, and never bent.
    """

    def __init__(self) -> None:
        self._seen: dict[tuple[int, Side], _Seen] = {}

    def hands(self, frame: HandFrame, moment: float) -> tuple[Hand, ...]:
        """The hands of the next frame as they will be at a moment.

        Parameters
        ----------
        frame : HandFrame
            Newer than those before it.
        moment : float
            The moment by the clock of the frame, in seconds; at most `MOST_AHEAD_SECONDS` after it are heeded.
        """
        ahead = min(max(moment - frame.time, 0.0), MOST_AHEAD_SECONDS)
        seen, moved = {}, []
        for tracked in frame.hands:
            key = (tracked.id, tracked.hand.side)
            place = tracked.hand.centre.tolist()
            velocity = _velocity(self._seen.get(key), frame.time, place)
            seen[key] = _Seen(frame.time, place, velocity)
            shift = [part * ahead for part in velocity]
            moved.append(tracked.hand.moved(shift) if any(shift) else tracked.hand)
        self._seen = seen  # of hands that are gone nothing is kept
        return tuple(moved)


def _velocity(before: _Seen | None, time: float, place: list[float]) -> Velocity:
    """In m/s; nothing for a hand that is new, or has jumped."""
    if before is None or not 0 < (passed := time - before.time) <= OLDEST_SECONDS:
        return STILL
    newest = [(now - then) / passed for now, then in zip(place, before.place, strict=True)]
    if math.hypot(*newest) > MOST_SPEED:
        return STILL
    share = passed / (passed + SMOOTH_SECONDS)
    x, y, z = (last + (new - last) * share for last, new in zip(before.velocity, newest, strict=True))
    return x, y, z
