"""Synthetic hands: ``gesture:approach`` and its kin, for whoever has no tracker.

Every gesture is a smooth function of time: places and speeds are continuous.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import spelt
from ...solver.contact.hand import Hand, Side
from ..transports.transport import Timekeeper
from .frames import HandFrame, TrackedHand
from .sources import PlayedHands, Readiness, read_options

__all__ = ["GESTURE", "GESTURES"]

Place: TypeAlias = NDArray[np.float64]

RATE = 120.0
MOST_RATE = 10_000.0
HEIGHT = 0.17
"""Of the middle of the paper's objects above the array, in metres."""
POINTING = (0.7, 0.0, 0.9, 0.9, 0.9)
"""How far each finger bends when the index finger points."""


def _swing(time: float, period: float) -> float:
    """From 0 to 1 and back within a period, by a cosine."""
    return (1 - math.cos(2 * math.pi * time / period)) / 2


def _flat(side: Side) -> Hand:
    return Hand.flat((0, 0, 0), side)


def _pointing(side: Side) -> Hand:
    return Hand.flat((0, 0, 0), side, curl=POINTING).rotated(-70, (1, 0, 0))


def approach(hand: Hand, place: Place, time: float) -> Hand:
    """A flat hand comes down from 15 cm above to 5 cm below the place, and goes up again, every 4 s."""
    return hand.moved(place + np.array([0, 0, 0.15 - 0.2 * _swing(time, 4)]))


def sweep(hand: Hand, place: Place, time: float) -> Hand:
    """A flat hand goes from 15 cm left of the place to 15 cm right of it, and back, every 4 s."""
    return hand.moved(place + np.array([0.3 * _swing(time, 4) - 0.15, 0, 0]))


def grasp(hand: Hand, place: Place, time: float) -> Hand:
    """A hand 6 cm above the place closes and opens, every 3 s."""
    return Hand.flat(place + np.array([0, -0.03, 0.06]), hand.side, curl=0.05 + 0.75 * _swing(time, 3))


def tap(hand: Hand, place: Place, time: float) -> Hand:
    """An index finger that points down goes 6 cm down to the place and up again, within 0.5 s of every second."""
    down = _swing(min(time % 1.0, 0.5), 0.5)
    return hand.moved(place + np.array([0, 0, 0.06 * (1 - down)]) - hand.landmarks[8])


GESTURES: dict[str, tuple[Callable[[Side], Hand], Callable[[Hand, Place, float], Hand]]] = {
    "approach": (_flat, approach),
    "sweep": (_flat, sweep),
    "grasp": (_flat, grasp),
    "tap": (_pointing, tap),
}
"""Of each: the hand of a side at (0, 0, 0) that is moved, and where it is at a time in seconds."""


class GestureScheme:
    """Synthetic hands."""

    form = "gesture:approach|sweep|grasp|tap?rate=120&seconds=10&x=0&z=0.17&side=right"
    help = "A synthetic hand that moves smoothly, without end unless seconds are given."

    def open(self, rest: str, clock: Timekeeper) -> PlayedHands:
        """Begin the gesture that a URL names.

        Raises
        ------
        ValueError
            If there is no such gesture, or an option is wrong.
        """
        known: dict[str, Callable[[str], Any]] = {
            "rate": lambda text: _within(text, 1, MOST_RATE, "frames per second"),
            "seconds": lambda text: _within(text, 0, 1e6, "seconds"),
            "x": lambda text: _within(text, -1, 1, "metres"),
            "z": lambda text: _within(text, -1, 1, "metres"),
            "side": _side,
        }
        name, options = read_options(rest, known, self.form)
        if name not in GESTURES:
            raise ValueError(f"there is no gesture {name!r}; there are {', '.join(GESTURES)}")
        rate = options.get("rate", RATE)
        place = np.array([options.get("x", 0.0), 0.0, options.get("z", HEIGHT)])
        begin, move = GESTURES[name]
        hand = begin(options.get("side", "right"))
        moving = _frames(lambda time: move(hand, place, time), rate, options.get("seconds", math.inf))
        return PlayedHands(f"the gesture {name}", moving, rate, clock)

    def probe(self) -> Readiness:
        """It is always there."""
        return Readiness(True, "always there")


def _frames(gesture: Callable[[float], Hand], rate: float, seconds: float) -> Iterator[HandFrame]:
    for number in count():
        time = number / rate
        if time >= seconds:
            return
        yield HandFrame(time, (TrackedHand(gesture(time), 1),), number)


def _within(text: str, least: float, most: float, unit: str) -> float:
    value = spelt(text)
    if not least <= value <= most:
        raise ValueError(f"it must be from {least:g} to {most:g} {unit}")
    return value


def _side(text: str) -> Side:
    if text == "left":
        return "left"
    if text == "right":
        return "right"
    raise ValueError("it must be left or right")


GESTURE = GestureScheme()
