"""Where hands will be when the field for them begins: a frame is always older than what is played for it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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


class _Seen(NamedTuple):
    """A hand as it was seen last."""

    time: float
    centre: NDArray[np.float64]
    velocity: NDArray[np.float64]


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
            By the clock of the frame, in seconds; at most `MOST_AHEAD_SECONDS` after it are heeded.
        """
        ahead = min(max(moment - frame.time, 0.0), MOST_AHEAD_SECONDS)
        seen, moved = {}, []
        for tracked in frame.hands:
            key = (tracked.id, tracked.hand.side)
            centre = tracked.hand.centre
            velocity = self._velocity(self._seen.get(key), frame.time, centre)
            seen[key] = _Seen(frame.time, centre, velocity)
            shift = velocity * ahead
            moved.append(tracked.hand.moved(shift) if shift.any() else tracked.hand)
        self._seen = seen  # of hands that are gone nothing is kept
        return tuple(moved)

    @staticmethod
    def _velocity(before: _Seen | None, time: float, centre: NDArray[np.float64]) -> NDArray[np.float64]:
        """In m/s; nothing for a hand that is new, or has jumped."""
        if before is None or not 0 < (passed := time - before.time) <= OLDEST_SECONDS:
            return np.zeros(3)
        newest = (centre - before.centre) / passed
        if newest @ newest > MOST_SPEED**2:
            return np.zeros(3)
        return np.asarray(before.velocity + (newest - before.velocity) * passed / (passed + SMOOTH_SECONDS))
