"""Coordinates: reading, checking and freezing them."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["FARTHEST", "Scalar", "as_points", "frozen"]

FARTHEST = 1000.0
"""Largest coordinate in metres. Sound at 40 kHz is long gone by then, and nothing overflows."""

Scalar = TypeVar("Scalar", bound=np.generic)


def as_points(values: ArrayLike, what: str, many: str | None = None) -> NDArray[np.float64]:
    """Read (m, 3) coordinates in metres, m of at least 1, none further than `FARTHEST`.

    Raises
    ------
    ValueError
        The message names the first bad row. ``what`` is the name of a row; ``many``, the name of several, is by default
        ``what`` with an s.
    """
    many = many or f"{what}s"
    try:
        if np.iscomplexobj(values):
            raise TypeError("they are complex")
        points = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{many} must be (m, 3) numbers: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise ValueError(f"{many} must have the shape (m, 3) with m of at least 1, not {points.shape}")
    if points.max() <= FARTHEST and points.min() >= -FARTHEST:  # false if one is not a number
        return points
    if (bad := np.flatnonzero(~np.isfinite(points).all(axis=1))).size:
        raise ValueError(f"{what} {bad[0]} is {points[bad[0]].tolist()}; its coordinates must be finite numbers")
    bad = np.flatnonzero((np.abs(points) > FARTHEST).any(axis=1))
    raise ValueError(f"{what} {bad[0]} is {points[bad[0]].tolist()}; coordinates are metres, at most {FARTHEST:g}")


def frozen(values: NDArray[Scalar]) -> NDArray[Scalar]:
    """The same array, read-only from now on."""
    values.setflags(write=False)
    return values
