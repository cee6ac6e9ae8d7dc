"""Persons who explore: hands of their own size and side, which sweep and tilt by habits of their own.

A path is a smooth function of time that knows nothing of the object: a person comes down from above and sweeps to and
fro along x, y and z, each at a pace of its own. So what the hand does tells nothing about what it meets; people adapt
their exploring to what they feel (Lederman and Klatzky, Hand movements, Cognitive Psychology 19, 1987).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...solver.contact.hand import Hand, Side
from ...solver.geometry import rotation_matrix

__all__ = ["Exploration", "Person"]

MEAN_LENGTH, DEVIATION, MOST_DEVIATIONS = 0.1893, 0.010, 2.0
"""Of hands, in metres: the mean is `anatomy.LENGTH`, the deviation that of men and women in ANSUR II, rounded."""
LEFT_HANDED = 0.1
"""Share of people (Papadatou-Pastou et al., Human handedness, Psychological Bulletin 146, 2020: 10.6 %)."""
PACE_HZ = 0.25, 0.6
"""Sweeps a second along an axis: a hand moves at up to 0.2 m/s, as the gestures do."""
REACH = np.array([[0.03, 0.06], [0.03, 0.06], [0.04, 0.06]])
"""How far a sweep goes to either side along x, y and z, in metres, least and most."""
MIDDLE = np.array([0.0, -0.03, 0.17])
"""Of the sweeps of the palm's centre: fingers are in front of the palm, and the objects' middle is 17 cm up."""
WANDER = np.array([0.01, 0.02, 0.01])
"""By which a person's middle differs, in metres either way."""
MOST_TILT, MOST_CURL = 15.0, 0.15
"""Degrees about x and y either way; bend of the fingers, 1 in a fist."""
DESCENT, DESCENT_SECONDS = 0.08, 0.5
"""By how much higher an exploration begins, in metres, and how long the hand takes to come down."""


@dataclass(frozen=True, eq=False)
class Exploration:
    """How a hand moves in one trial."""

    hand: Hand
    """The hand with its palm at the origin, level."""
    middle: NDArray[np.float64]
    """(3,) float; the middle of the sweeps, in metres."""
    reach: NDArray[np.float64]
    """(3,) float; how far they go to either side, in metres."""
    pace: NDArray[np.float64]
    """(5,) float; sweeps a second along x, y and z, and tilts about x and y."""
    phase: NDArray[np.float64]
    """(5,) float; phases of these at the beginning, in radians."""
    tilt: NDArray[np.float64]
    """(2,) float; the largest tilts about x and y, in degrees."""

    def pose(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The (3, 3) rotation of the hand and the (3,) place of its palm at a time in seconds."""
        swing = np.sin(2 * np.pi * self.pace * time + self.phase)
        place = self.middle + self.reach * swing[:3]
        place[2] += DESCENT * (1 + np.cos(np.pi * min(time / DESCENT_SECONDS, 1.0))) / 2
        about_x, about_y = self.tilt * swing[3:]
        return rotation_matrix(about_y, (0, 1, 0)) @ rotation_matrix(about_x, (1, 0, 0)), place

    def at(self, time: float) -> Hand:
        """The hand at a time in seconds."""
        turn, place = self.pose(time)
        return Hand(self.hand.landmarks @ turn.T + place, self.hand.side, self.hand.widths)


@dataclass(frozen=True)
class Person:
    """A hand and habits: the same for the same number and seed."""

    number: int
    seed: int
    length: float
    """Length of the hand, in metres."""
    side: Side
    """Side of the hand that explores."""
    curl: float
    """Bend of the fingers, 1 in a fist."""
    # As of `Exploration`:
    middle: tuple[float, ...]
    reach: tuple[float, ...]
    pace: tuple[float, ...]
    tilt: tuple[float, ...]

    @classmethod
    def drawn(cls, number: int, seed: int) -> Self:
        """A person by chance."""
        chance = np.random.default_rng([seed, number])
        deviation = float(np.clip(chance.standard_normal(), -MOST_DEVIATIONS, MOST_DEVIATIONS))
        return cls(
            number,
            seed,
            MEAN_LENGTH + DEVIATION * deviation,
            "left" if chance.random() < LEFT_HANDED else "right",
            float(chance.uniform(0, MOST_CURL)),
            tuple((MIDDLE + WANDER * chance.uniform(-1, 1, 3)).tolist()),
            tuple(chance.uniform(*REACH.T).tolist()),
            tuple(chance.uniform(*PACE_HZ, 5).tolist()),
            tuple(chance.uniform(0, MOST_TILT, 2).tolist()),
        )

    def explores(self, trial: int) -> Exploration:
        """The path of a trial: by this person's habits, from phases by chance."""
        phase = np.random.default_rng([self.seed, self.number, trial]).uniform(0, 2 * np.pi, 5)
        hand = Hand.flat((0, 0, 0), self.side, self.length, self.curl)
        middle, reach, pace, tilt = map(np.array, (self.middle, self.reach, self.pace, self.tilt))
        return Exploration(hand, middle, reach, pace, phase, tilt)
