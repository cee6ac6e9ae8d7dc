"""Places and rotations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import FARTHEST

__all__ = ["as_position", "rotation_matrix"]


def as_position(value: ArrayLike, what: str) -> NDArray[np.float64]:
    """Read (3,) coordinates in metres; ``what`` names them in the error.

    Raises
    ------
    ValueError
        If these are not three numbers, or one is not finite or larger than `FARTHEST`.
    """
    place = np.array(value, dtype=np.float64)
    if place.shape != (3,) or not (place.max() <= FARTHEST and place.min() >= -FARTHEST):
        raise ValueError(f"{what} {place.tolist()} must be three numbers of metres, at most {FARTHEST:g} each")
    return place


def rotation_matrix(degrees: float, axis: ArrayLike) -> NDArray[np.float64]:
    """The (3, 3) rotation about an axis through the origin, counterclockwise seen from its tip: Rodrigues' formula.

    Raises
    ------
    ValueError
        If the angle is not finite, or the axis has no direction.
    """
    direction = np.array(axis, dtype=np.float64)
    length = np.linalg.norm(direction)
    if direction.shape != (3,) or not 0 < length < math.inf:
        raise ValueError(f"axis {direction.tolist()} must be three finite numbers, not all of them 0")
    if not math.isfinite(degrees):
        raise ValueError(f"an angle of {degrees} degrees is not finite")
    x, y, z = direction / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(degrees)
    turn: NDArray[np.float64] = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return turn
