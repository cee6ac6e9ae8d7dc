"""Hands: 21 landmarks, and the sixteen quadrilaterals that feel (section 4.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import FARTHEST, array_of
from ...base.arguments import length as length_of
from ..geometry import as_points, as_position, frozen, place, rotation_matrix
from .anatomy import BONES, FINGERS, LENGTH, NEUTRAL, PALM, PARENTS, WIDTHS, Side, posed

__all__ = ["LANDMARKS", "QUADS", "Hand", "Side"]

LANDMARKS = 21
QUADS = 16
"""Quadrilaterals of a hand: the palm, then three of each finger from the thumb to the little finger, base first."""
LEAST_SIZE, MOST_SIZE = 0.3, 2.0
"""Of the palm, as parts of the mean hand's. A newborn has a third of it, few adults have 1.3; trackers err."""
LEAST_BONE, MOST_BONE = 0.2, 3.0
"""Of a finger's bones, as parts of the mean hand's at the size of this palm: trackers shorten a bone that they see from
its end, and people differ."""
LEAST_BREADTH = 0.3
"""Across the knuckles, as a part of the mean hand's at the size of this palm; and along the palm."""
MOST_WIDTH = 0.1
"""Of a finger, in metres."""
BACKWARDS = math.radians(20)
"""Bend of finger joints to the back of the hand, on average, from which on the hand is rather one of the other side."""
MOST_NAMED = 3
_NEUTRAL_PALM = float(np.linalg.norm(NEUTRAL[PALM], axis=1).mean())
_NEUTRAL_BREADTH = float(NEUTRAL[17, 0] - NEUTRAL[5, 0])
_MIDDLE = np.zeros(LANDMARKS)
_MIDDLE[[0, 5, 9, 13, 17]] = 1 / 2, 1 / 8, 1 / 8, 1 / 8, 1 / 8
_FINGER_BONES = np.array([landmark for landmark in range(1, LANDMARKS) if PARENTS[landmark - 1] != 0])
"""The landmarks at the ends of fingers' bones."""


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand at one moment.

    Parameters
    ----------
    landmarks : (21, 3) float
        The landmarks in metres, in the array's coordinates, in the order of MediaPipe's hand landmarks: the wrist; then
        of thumb, index, middle, ring and little finger four each, from the base to the tip.
    side : str
        "left" or "right".
    widths : (5,) float, optional
        Breadth of each finger from the thumb on, in metres; by default as the hand's size would have it
        (`anatomy.WIDTHS`).

    Raises
    ------
    ValueError
        If these are not 21 points, one is not finite, or no hand could have them: it is too large or too small, the
        palm has no breadth, or a bone is far too long or too short. `repaired` accepts more.
    """

    landmarks: NDArray[np.float64]
    side: Side
    widths: NDArray[np.float64]

    def __init__(self, landmarks: ArrayLike, side: Side = "right", widths: ArrayLike | None = None) -> None:
        points, size, possible, _ = _checked(landmarks, side)
        if not possible and len(wrong := _impossible(points, size)):
            said = [_described(points, landmark, size) for landmark in wrong[:MOST_NAMED]]
            more = f"; so are {len(wrong) - MOST_NAMED} more" if len(wrong) > MOST_NAMED else ""
            raise ValueError(f"{'; '.join(said)}{more}")
        self._keep(points, side, size, widths)

    def __repr__(self) -> str:
        return f"Hand({self.side}, palm at {place(self.centre)})"

    def _keep(self, points: NDArray[np.float64], side: Side, size: float, widths: ArrayLike | None) -> None:
        object.__setattr__(self, "landmarks", frozen(points))
        object.__setattr__(self, "side", side)
        object.__setattr__(self, "widths", frozen(size * WIDTHS if widths is None else _as_widths(widths)))

    @classmethod
    def repaired(
        cls, landmarks: ArrayLike, side: Side = "right", widths: ArrayLike | None = None
    ) -> tuple[Self, tuple[str, ...]]:
        """A hand of landmarks as trackers give them; some of them may be impossible.

        A bone that is far too long or too short gets the nearest possible length and keeps its direction, and the rest
        of the finger moves with it. A hand whose fingers bend to its back is one of the other side.

        Returns
        -------
        Hand, tuple of str
            The hand, and what was repaired.

        Raises
        ------
        ValueError
            As `Hand`, but not for bones.
        """
        points, size, possible, bend = _checked(landmarks, side)
        notes = []
        for landmark in () if possible else _impossible(points, size):
            notes.append(f"{_described(points, landmark, size)}; it was repaired")
            _repair(points, landmark, size)
        if (bend if side == "right" else -bend) > BACKWARDS:
            notes.append(f"the {side} hand's fingers bend to its back; it was taken for the other hand")
            side = "right" if side == "left" else "left"
        hand = cls.__new__(cls)
        hand._keep(points, side, size, widths)
        return hand, tuple(notes)

    @classmethod
    def flat(
        cls, centre: ArrayLike = (0, 0, 0.17), side: Side = "right", length: float = LENGTH, curl: ArrayLike = 0.0
    ) -> Self:
        """A hand of mean proportions, its palm level and facing the array, its fingertips to +y.

        Parameters
        ----------
        centre : (3,) float
            Centre of the palm, in metres.
        side : str
            "left" or "right".
        length : float
            Length from the wrist to the middle fingertip, in metres.
        curl : float or (5,) float
            How far all fingers bend, or each from the thumb on: from 0, straight, to 1, as in a fist.

        Raises
        ------
        ValueError
            If the length or the curl is out of range.
        """
        curls, tall = array_of("curl", curl, np.float64), length_of("length", length)
        if curls.shape not in ((), (len(FINGERS),)) or not ((curls >= 0) & (curls <= 1)).all():
            raise ValueError(
                f"curl {curls.tolist()} must be one number or {len(FINGERS)}, from 0, straight, to 1, a fist"
            )
        points = posed(side, curls) * (tall / LENGTH)
        return cls(points - _middle(points) + as_position(centre, "centre"), side)

    @cached_property
    def centre(self) -> NDArray[np.float64]:
        """(3,) the middle of the palm, half-way from the wrist to the knuckles, in metres."""
        return frozen(_middle(self.landmarks))

    @cached_property
    def quads(self) -> NDArray[np.float64]:
        """(16, 4, 3) what feels: planar quadrilaterals in metres.

        The palm, then three of each finger from the thumb to the little finger, base first. Corners: base left, base
        right, tip right, tip left, as seen on the back of the hand with the fingertips up; so they run counterclockwise
        there. The edge from tip left to tip right of a finger's quadrilateral is, bit by bit, that from base left to
        base right of the next one.
        """
        from .hand_quads import hand_quads

        return frozen(hand_quads(self.landmarks, self.widths, 1.0 if self.side == "right" else -1.0))

    def moved(self, offset: ArrayLike) -> Self:
        """The same hand, moved by (3,) metres."""
        return self._elsewhere(self.landmarks + as_position(offset, "offset"))

    def rotated(self, degrees: float, axis: ArrayLike = (0, 0, 1)) -> Self:
        """The same hand, turned about an axis through the middle of its palm, counterclockwise.

        Raises
        ------
        ValueError
            If the axis has no direction.
        """
        turn = rotation_matrix(degrees, axis)
        return self._elsewhere((self.landmarks - self.centre) @ turn.T + self.centre)

    def _elsewhere(self, landmarks: NDArray[np.float64]) -> Self:
        """The same hand in another place: its bones are as possible as before."""
        if not (landmarks.max() <= FARTHEST and landmarks.min() >= -FARTHEST):
            as_points(landmarks, "landmark")  # says which one
        hand = object.__new__(type(self))
        object.__setattr__(hand, "landmarks", frozen(landmarks))
        object.__setattr__(hand, "side", self.side)
        object.__setattr__(hand, "widths", self.widths)
        return hand


class _Checked(NamedTuple):
    """Landmarks that have a palm, and their measures.

    ``size`` is relative to the mean hand, ``possible`` says whether all bones can be real, and ``bend`` is the angle in
    radians by which the fingers bend to the back, if it is a right hand.
    """

    points: NDArray[np.float64]
    size: float
    possible: bool
    bend: float


def _checked(landmarks: ArrayLike, side: Side) -> _Checked:
    if side not in ("left", "right"):
        raise ValueError(f"the side of a hand is 'left' or 'right', not {side!r}")
    points = as_points(landmarks, "landmark")
    if len(points) != LANDMARKS:
        raise ValueError(f"a hand has {LANDMARKS} landmarks, not {len(points)}")
    from .hand_quads import hand_measures

    mean, length, breadth, shortest, longest, bend = hand_measures(points, BONES)
    size = mean / _NEUTRAL_PALM
    if not LEAST_SIZE <= size <= MOST_SIZE:
        millimetres = "; these look like millimetres" if LEAST_SIZE <= size / 1000 <= MOST_SIZE else ""
        raise ValueError(
            f"the palm is {mean:.3g} m long, from landmark 0 to the knuckles (5, 9, 13, 17); "
            f"it must be from {LEAST_SIZE * _NEUTRAL_PALM:.2g} to {MOST_SIZE * _NEUTRAL_PALM:.2g} m{millimetres}"
        )
    if length < LEAST_BREADTH * mean:
        raise ValueError("the palm has no length: its knuckles are on all sides of landmark 0, the wrist")
    least = LEAST_BREADTH * _NEUTRAL_BREADTH * size
    if breadth < least:
        raise ValueError(
            f"the palm has no breadth: landmarks 5 and 17 are {breadth * 1e3:.1f} mm apart across it; "
            f"a palm of this length has at least {least * 1e3:.1f} mm"
        )
    return _Checked(points, size, shortest >= LEAST_BONE * size and longest <= MOST_BONE * size, bend)


def _middle(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the palm: half-way from the wrist to the knuckles."""
    return _MIDDLE @ points


def _as_widths(widths: ArrayLike) -> NDArray[np.float64]:
    values = array_of("widths", widths, np.float64)
    if values.shape != (len(FINGERS),) or not (values > 0).all() or not (values <= MOST_WIDTH).all():
        raise ValueError(
            f"widths must be {len(FINGERS)} numbers above 0 and up to {MOST_WIDTH} m, one for each finger, "
            f"not {values.tolist()}"
        )
    return values


def _impossible(points: NDArray[np.float64], size: float) -> NDArray[np.int64]:
    """The landmarks at the ends of fingers' bones that are far too long or too short."""
    bones = points[_FINGER_BONES] - points[_FINGER_BONES - 1]
    parts = np.sqrt((bones * bones).sum(axis=1)) / (BONES[_FINGER_BONES - 1] * size)
    found: NDArray[np.int64] = _FINGER_BONES[(parts < LEAST_BONE) | (parts > MOST_BONE)]
    return found


def _described(points: NDArray[np.float64], landmark: int, size: float) -> str:
    length = float(np.linalg.norm(points[landmark] - points[landmark - 1]))
    least, most = (part * BONES[landmark - 1] * size * 1e3 for part in (LEAST_BONE, MOST_BONE))
    return (
        f"the {FINGERS[(landmark - 1) // 4]}'s bone from landmark {landmark - 1} to {landmark} is "
        f"{length * 1e3:.1f} mm long; in a hand of this size it has {least:.1f} to {most:.1f} mm"
    )


def _repair(points: NDArray[np.float64], landmark: int, size: float) -> None:
    """Give the bone that ends at a landmark a possible length, and move the rest of the finger with it."""
    usual = BONES[landmark - 1] * size
    length = float(np.linalg.norm(points[landmark] - points[landmark - 1]))
    wanted = usual * (LEAST_BONE * 1.001 if length < usual else MOST_BONE * 0.999)
    # A bone without length continues the last one that has some.
    bones = [points[landmark] - points[before] for before in range(landmark - 1, -1, -1)]
    bone = next((bone for bone in bones if bone.any()), points[PALM].mean(axis=0) - points[0])
    tip = 4 * ((landmark - 1) // 4) + 4
    points[landmark : tip + 1] += points[landmark - 1] + bone / np.linalg.norm(bone) * wanted - points[landmark]
