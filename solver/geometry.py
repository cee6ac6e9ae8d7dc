"""Coordinates and rotations: reading, checking and freezing them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, Generic, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import FARTHEST, array_of, real

__all__ = [
    "Movable",
    "PointsLike",
    "Scalable",
    "Scalar",
    "as_places",
    "as_points",
    "as_position",
    "as_rotation",
    "as_scale",
    "coincident",
    "counted",
    "extent",
    "frozen",
    "place",
    "rotation_matrix",
]

SCALES = 1e-6, 1e6
MOST_DEGREES = 1e12

_ACROSS = np.array([1.0, 2**0.5, 3**0.5])
"""A direction along which no two places of a grid coincide."""

Scalar = TypeVar("Scalar", bound=np.generic)
Moved = TypeVar("Moved", covariant=True)


class Movable(ABC, Generic[Moved]):
    """Something with a place in space, of which there are copies elsewhere."""

    @property
    @abstractmethod
    def centre(self) -> NDArray[np.float64]:
        """(3,) the point about which it turns, in metres."""

    @abstractmethod
    def placed(self, matrix: NDArray[np.float64], offset: NDArray[np.float64]) -> Moved:
        """The same, each point x at ``matrix @ x + offset``: a (3, 3) matrix that turns and scales, and (3,) metres."""

    def moved(self, offset: ArrayLike) -> Moved:
        """The same, moved by (3,) metres; `ValueError` if the offset is no place."""
        return self.placed(np.eye(3), as_position(offset, "offset"))

    def rotated(self, degrees: float, axis: ArrayLike = (0, 0, 1)) -> Moved:
        """The same, turned about an axis through its `centre`, counterclockwise as seen from the axis' tip.

        `ValueError` if the angle is not finite, or the axis has no direction.
        """
        turn = rotation_matrix(degrees, axis)
        return self.placed(turn, self.centre - turn @ self.centre)


class Scalable(Movable[Moved]):
    """Something of which there are larger and smaller copies, too."""

    def scaled(self, factor: float) -> Moved:
        """The same, ``factor`` times as large, about its `centre`; `ValueError` if the factor is not positive."""
        factor = as_scale(factor)
        return self.placed(factor * np.eye(3), (1 - factor) * self.centre)


@runtime_checkable
class Sampled(Protocol):
    """Control points, or a shape that is sampled into some."""

    def sample(self) -> Any: ...


PointsLike: TypeAlias = ArrayLike | Sampled
"""Control points, a shape, or (m, 3) positions in metres."""


def as_places(values: PointsLike) -> NDArray[np.float64]:
    """The (m, 3) positions of points, in metres; errors as `as_points`."""
    return as_points(values.sample().positions if isinstance(values, Sampled) else values, "point")


def as_points(values: ArrayLike, what: str, many: str | None = None) -> NDArray[np.float64]:
    """Read (m, 3) coordinates in metres, m of at least 1, none further than `FARTHEST`.

    Raises
    ------
    ValueError
        The message names the first bad row. ``what`` is the name of a row; ``many``, the name of several, is by default
        ``what`` with an s.
    """
    many = many or f"{what}s"
    points = array_of(f"{many} (m, 3)", values, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        one = f"; write [{points.tolist()}] for one {what}" if points.shape == (3,) else ""
        raise ValueError(f"{many} must have the shape (m, 3) with m of at least 1, not {points.shape}{one}")
    if points.max() <= FARTHEST and points.min() >= -FARTHEST:  # false if one is not a number
        return points
    if (bad := np.flatnonzero(~np.isfinite(points).all(axis=1))).size:
        raise ValueError(f"{what} {bad[0]} is {points[bad[0]].tolist()}; its coordinates must be finite numbers")
    bad = np.flatnonzero((np.abs(points) > FARTHEST).any(axis=1))
    raise ValueError(
        f"{what} {bad[0]} is {points[bad[0]].tolist()}; coordinates are metres, at most {FARTHEST:g}: 150 mm is 0.15"
    )


def as_position(value: ArrayLike, what: str) -> NDArray[np.float64]:
    """Read (3,) coordinates in metres; ``what`` names them in the error.

    `ValueError` if these are not three numbers, or one is not finite or larger than `FARTHEST`.
    """
    place = array_of(what, value, np.float64)
    if place.shape != (3,) or not (place.max() <= FARTHEST and place.min() >= -FARTHEST):
        raise ValueError(
            f"{what} {place.tolist()} must be three numbers of metres, at most {FARTHEST:g} each: 150 mm is 0.15"
        )
    return place


def as_scale(factor: float) -> float:
    """The factor of a scaled thing; `ValueError` if it is out of range."""
    return real("scale", factor, *SCALES)


def as_rotation(values: ArrayLike) -> NDArray[np.float64]:
    """Read a (3, 3) rotation matrix, which may be written with three digits; the result is exact.

    `ValueError` if the rows are not perpendicular and of length 1, or it is a reflection.
    """
    matrix = array_of("rotation", values, np.float64)
    if matrix.shape != (3, 3) or not np.allclose(matrix @ matrix.T, np.eye(3), rtol=0, atol=1e-3):
        raise ValueError(f"rotation {matrix.tolist()} must have three perpendicular rows of length 1")
    if np.linalg.det(matrix) < 0:
        raise ValueError(
            f"rotation {matrix.tolist()} is a reflection: a left hand would become a right one; "
            "change the sign of a row if an axis points the wrong way"
        )
    left, _, right = np.linalg.svd(matrix)  # what is written with three digits becomes exact
    nearest: NDArray[np.float64] = left @ right
    return nearest


def rotation_matrix(degrees: float, axis: ArrayLike) -> NDArray[np.float64]:
    """The (3, 3) rotation about an axis through the origin, counterclockwise seen from its tip: Rodrigues' formula.

    `ValueError` if the angle is not finite, or the axis has no direction.
    """
    try:
        direction = array_of("axis", axis, np.float64)
    except ValueError:
        direction = np.array(np.nan)
    length = np.linalg.norm(direction)
    if direction.shape != (3,) or not 0 < length < math.inf:
        raise ValueError(f"axis {axis!r} must be three finite numbers, not all of them 0, such as (1, 0, 0) for x")
    degrees = real("angle", degrees, -MOST_DEGREES, MOST_DEGREES, "degrees")
    x, y, z = direction / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(degrees)
    turn: NDArray[np.float64] = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return turn


def coincident(points: NDArray[np.float64], distance: float) -> tuple[int, int] | None:
    """The first two of (m, 3) points that are closer than a distance in metres, far below that of usual neighbours."""
    order = np.argsort(points @ _ACROSS, kind="stable")
    gaps = np.diff(points[order], axis=0)
    bad = np.flatnonzero((gaps * gaps).sum(axis=1) < distance**2)
    if not bad.size:
        return None
    first, second = sorted(order[bad[0] : bad[0] + 2].tolist())
    return first, second


def extent(points: NDArray[np.float64]) -> str:
    """The size of the box around (m, 3) points for people, such as ``196 × 155 × 0 mm``."""
    return " × ".join(f"{float(f'{length * 1e3:.3g}'):.6g}" for length in np.ptp(points, axis=0)) + " mm"


def counted(count: int, what: str) -> str:
    """A number of things for people, such as ``1 point`` or ``2 points``."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def place(point: ArrayLike) -> str:
    """A place of (3,) metres for people, such as ``(0, 0, 200) mm``."""
    rounded = np.round(np.asarray(point) * 1e3, 1) + 0.0  # no minus before zero
    return f"({', '.join(f'{value:g}' for value in rounded)}) mm"


def frozen(values: NDArray[Scalar]) -> NDArray[Scalar]:
    """The same array, read-only from now on."""
    values.setflags(write=False)
    return values
