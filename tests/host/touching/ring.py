"""A simple toucher, simple hands and sources, for tests of the loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from phasewire import ControlPoints
from phasewire.host.hands.frames import HandFrame, TrackedHand
from phasewire.host.hands.sources import PlayedHands
from phasewire.host.transports.transport import Timekeeper
from phasewire.solver.contact.arcs import Arcs
from phasewire.solver.contact.hand import Hand
from phasewire.solver.contact.touch import Touch, Toucher

__all__ = ["POINTS", "Ring", "frames", "hand_at", "source"]

POINTS = 12
RADIUS = 0.03


class Ring(Toucher):
    """Finds a ring of points about each hand that is below 0.3 m, with the same ids as long as it is there."""

    def touch(self, hands: Any, objects: Any, time: float | None = None) -> Touch:
        """The ring about the palm of each hand."""
        angle = 2 * np.pi * np.arange(POINTS) / POINTS
        ring = RADIUS * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        found = [(ring + hand.centre, number) for number, hand in enumerate(hands) if hand.centre[2] < 0.3]
        if not found:
            return _touch([], np.empty(0, np.int64))
        ids = np.concatenate([POINTS * number + np.arange(POINTS) for _, number in found])
        return _touch([positions for positions, _ in found], ids)

    def forget(self) -> None:
        """Nothing is kept."""


def _touch(rings: Sequence[NDArray[np.float64]], ids: NDArray[np.int64]) -> Touch:
    points = ControlPoints(np.concatenate(rings)) if rings else None
    touch = Touch(Arcs.joined([]), points, np.stack([ids, 0 * ids, 0 * ids, 0 * ids]))
    touch.__dict__["arcs"] = [np.concatenate([ring, ring[:1]]) for ring in rings]
    return touch


def hand_at(place: Sequence[float]) -> Hand:
    """A flat hand whose palm is at a place."""
    return Hand.flat(place)


def frames(rate: float, seconds: float, place: Callable[[float], Sequence[float] | None]) -> Iterator[HandFrame]:
    """Frames of one hand at a place for each time, or without a hand."""
    for number in range(round(rate * seconds)):
        at = place(number / rate)
        hands = () if at is None else (TrackedHand(hand_at(at), 1),)
        yield HandFrame(number / rate, hands, number)


def source(
    clock: Timekeeper, rate: float, seconds: float, place: Callable[[float], Sequence[float] | None]
) -> PlayedHands:
    """A source of these frames."""
    return PlayedHands("test", frames(rate, seconds, place), rate, clock)
