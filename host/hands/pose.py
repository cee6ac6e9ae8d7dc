"""Poses: from a tracker's coordinates to the array's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import real
from ...base.errors import InputFileError
from ...base.storage import FilePath, read_toml
from ...solver.contact.hand import Hand
from ...solver.geometry import as_points, as_position, as_rotation, frozen, place
from ...solver.placement import PLACEMENT_KEYS, read_placement, table_numbers
from .frames import HandFrame

__all__ = ["Pose"]

LEAST_SCALE, MOST_SCALE = 0.5, 2.0
"""Beyond these it is no error of the tracker's scale but a wrong unit."""
_KEYS = (*PLACEMENT_KEYS, "scale")


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a tracker is: x in the array's coordinates is ``rotation @ (scale * x) + translation``.

    Parameters
    ----------
    rotation : (3, 3) float
        Turns the tracker's axes into the array's.
    translation : (3,) float
        The place of the tracker's origin in the array's coordinates, in metres.
    scale : float
        Corrects the tracker's lengths, from `LEAST_SCALE` to `MOST_SCALE`.

    Raises
    ------
    ValueError
        If the rotation is none, the translation is not finite or too large, or the scale is out of its range.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    scale: float = 1.0

    def __post_init__(self) -> None:
        """Check it."""
        object.__setattr__(self, "rotation", frozen(as_rotation(self.rotation)))
        object.__setattr__(self, "translation", frozen(as_position(self.translation, "translation")))
        object.__setattr__(self, "scale", real("scale", self.scale, LEAST_SCALE, MOST_SCALE))

    def __repr__(self) -> str:
        return f"Pose(translation {place(self.translation)}, scale {self.scale:g})"

    @classmethod
    def none(cls) -> Self:
        """That of a tracker whose coordinates are the array's."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def load(cls, path: FilePath) -> Self:
        """Read a pose file; docs/how-to/hands.md describes it.

        Raises
        ------
        InputFileError
            If the file is no TOML, or a field of it is unknown or wrong; it names the field.
        OSError
            If it cannot be read.
        """
        table = read_toml(path)
        try:
            return cls.from_table(table)
        except ValueError as error:
            raise InputFileError(f"{path} is no pose of a tracker: {error}") from error

    @classmethod
    def from_table(cls, table: dict[str, Any]) -> Self:
        """A pose of the fields of a pose file.

        Raises
        ------
        ValueError
            An error that names the field that is unknown or wrong.
        """
        for key in table:
            if key not in _KEYS:
                raise ValueError(f"there is no field {key!r}; the fields are {', '.join(_KEYS)}")
        rotation, translation = read_placement(table)
        return cls(rotation, translation, float(table_numbers(table, "scale", (), 1)))

    def to_table(self) -> dict[str, Any]:
        """The fields of a pose file."""
        return {
            "translation_m": self.translation.tolist(),
            "rotation": self.rotation.tolist(),
            "scale": float(self.scale),
        }

    @classmethod
    def estimate(cls, seen: ArrayLike, true: ArrayLike) -> tuple[Self, float]:
        """The pose that takes points as the tracker sees them best to where they are, in the sense of least squares.

        Kabsch's algorithm; the scale stays 1.

        Parameters
        ----------
        seen : (m, 3) float
            The seen points in the tracker's coordinates, in metres; m of at least 3, not all in a line.
        true : (m, 3) float
            The same points in the array's coordinates, in metres.

        Returns
        -------
        Pose, float
            And the root of the mean square distance that is left, in metres.

        Raises
        ------
        ValueError
            If the points are too few, or do not tell a rotation.
        """
        there, here = as_points(seen, "point"), as_points(true, "point")
        if there.shape != here.shape or len(there) < 3:
            raise ValueError(
                f"{len(there)} points were seen, {len(here)} are given; both must be 3 or more, and as many"
            )
        about, to = there.mean(axis=0), here.mean(axis=0)
        left, values, right = np.linalg.svd((there - about).T @ (here - to))
        if values[1] <= 1e-6 * values[0]:
            raise ValueError("the points are in a line, which does not tell a rotation; add one beside it")
        upright = np.diag([1, 1, np.sign(np.linalg.det(left @ right))])  # no reflection
        rotation = (left @ upright @ right).T
        pose = cls(rotation, to - rotation @ about)
        missed = there @ pose.rotation.T + pose.translation - here
        return pose, float(np.sqrt((missed**2).sum(axis=1).mean()))

    def apply(self, frame: HandFrame) -> HandFrame:
        """The same hands in the array's coordinates; notes say which ones were left out because none can be so."""
        hands, notes = [], list(frame.notes)
        for each in frame.hands:
            try:
                hands.append(replace(each, hand=self.moved(each.hand)))
            except ValueError as error:
                notes.append(f"the {each.hand.side} hand {each.id} was left out after its pose was applied: {error}")
        return replace(frame, hands=tuple(hands), notes=tuple(notes))

    def moved(self, hand: Hand) -> Hand:
        """The same hand in the array's coordinates.

        Raises
        ------
        ValueError
            If no hand can be so: see `Hand`.
        """
        landmarks = (self.scale * hand.landmarks) @ self.rotation.T + self.translation
        return Hand(landmarks, hand.side, self.scale * hand.widths)
