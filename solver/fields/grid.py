"""Grids: the places at which a field is sampled, over a plane or a box at any angle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, instance_of, length, whole
from ..geometry import as_points, as_position, frozen, place

__all__ = ["MAX_SAMPLES", "Grid"]

MAX_SAMPLES = 4_000_000
KINDS = {2: "plane", 3: "box"}


@dataclass(frozen=True, eq=False)
class Grid:
    """Equally spaced samples over a plane or a box.

    Parameters
    ----------
    centre : (3,) float
        The middle of the grid, in metres.
    axes : (d, 3) float
        Orthogonal unit vectors, d of 2 or 3: the directions in which the grid extends.
    counts : (d,) int
        Samples along each axis. With odd counts one sample is in the middle.
    step : float
        Distance between neighbours along every axis, in metres.

    Raises
    ------
    ValueError
        If the axes are not orthogonal unit vectors, a number is out of range, or there are too many samples.
    """

    centre: NDArray[np.float64]
    axes: NDArray[np.float64]
    counts: tuple[int, ...]
    step: float

    def __init__(self, centre: ArrayLike, axes: ArrayLike, counts: Sequence[int], step: float) -> None:
        object.__setattr__(self, "centre", frozen(as_position(centre, "centre of the grid")))
        object.__setattr__(self, "axes", frozen(as_points(axes, "axis of the grid", "axes of the grid")))
        object.__setattr__(
            self,
            "counts",
            tuple(whole("count of samples", n, 1, MAX_SAMPLES) for n in array_of("counts", counts, np.int64)),
        )
        object.__setattr__(self, "step", length("step", step))
        if len(self.axes) not in KINDS or len(self.counts) != len(self.axes):
            raise ValueError(f"{len(self.axes)} axes and {len(self.counts)} counts: a grid has 2 or 3 of each")
        if np.abs(self.axes @ self.axes.T - np.eye(len(self.axes))).max() > 1e-6:
            raise ValueError(f"the axes {self.axes.tolist()} must be orthogonal and of length 1")
        if math.prod(self.counts) > MAX_SAMPLES:
            raise ValueError(f"{' × '.join(map(str, self.counts))} makes more than {MAX_SAMPLES} samples")

    def __repr__(self) -> str:
        counts = " × ".join(map(str, self.counts))
        return f"Grid({counts} samples, {self.step * 1e3:g} mm apart, about {place(self.centre)})"

    @classmethod
    def along(cls, letters: str, centre: ArrayLike, extent: float | Sequence[float], step: float) -> Grid:
        """A grid along the axes of space: ``"xy"`` is a horizontal plane, ``"xz"`` a vertical one, ``"xyz"`` a box.

        Parameters
        ----------
        letters : str
            Two or all of x, y and z, in the order of the grid's axes.
        centre : (3,) float
            Middle in metres.
        extent : float or sequence of float
            Length along every axis, or along each, in metres, rounded down to an even number of steps so that one
            sample is in the middle.
        step : float
            Distance between samples, in metres.
        """
        instance_of(letters, str, "axes", "such as 'xz'")
        if len(letters) not in KINDS or len(set(letters)) != len(letters) or set(letters) - set("xyz"):
            raise ValueError(f"axes {letters!r} must be two or all of x, y and z, each once, such as xy or xz")
        extents: Any = np.ravel(extent).tolist() if np.ndim(extent) else [extent] * len(letters)
        if len(extents) != len(letters):
            raise ValueError(f"{len(extents)} extents for the axes {letters!r}: one for each is needed")
        axes = np.eye(3)[["xyz".index(letter) for letter in letters]]
        return cls.spanning(centre, axes, extents, step)

    @classmethod
    def horizontal(cls, height: float, extent: float, step: float) -> Grid:
        """A horizontal square at a height above the middle of the array; lengths in metres, as in `along`."""
        height = length("height", height)
        return cls.along("xy", (0.0, 0.0, height), extent, step)

    @classmethod
    def spanning(cls, centre: ArrayLike, axes: ArrayLike, extents: Sequence[float], step: float) -> Grid:
        """A grid along any axes, each with its extent in metres; otherwise as `along`."""
        extents, step = (
            [length("extent", extent) for extent in array_of("extents", extents, np.float64)],
            length("step", step),
        )
        if min(extents) / step < 2:
            kind = KINDS.get(len(extents), "grid")
            raise ValueError(f"a step of {step} m is too long for a {kind} of {min(extents)} m; at most half of it")
        if math.prod(extent / step for extent in extents) > MAX_SAMPLES:
            raise ValueError(f"a step of {step} m over {_product(extents)} m makes more than {MAX_SAMPLES} samples")
        return cls(centre, axes, [2 * int(extent / step / 2 + 1e-9) + 1 for extent in extents], step)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of an array of one value per sample: the last axis of the grid first."""
        return self.counts[::-1]

    @property
    def kind(self) -> str:
        """Plane or box."""
        return KINDS[len(self.axes)]

    @property
    def normal(self) -> NDArray[np.float64]:
        """Of a plane, (3,): its axes and this vector are a right-handed system."""
        if len(self.axes) != 2:
            raise ValueError(f"a {self.kind} has no normal; a plane has")
        return np.asarray(np.cross(*self.axes))

    def offsets(self, axis: int) -> NDArray[np.float64]:
        """Coordinates of the samples along an axis of the grid, (count,) in metres from the centre."""
        count = self.counts[whole("axis", axis, 0, len(self.counts) - 1)]
        return np.asarray((np.arange(count) - (count - 1) / 2) * self.step)

    def coordinates(self, axis: int) -> tuple[str, NDArray[np.float64]]:
        """Name and coordinates of the samples along an axis of the grid, (count,) in metres.

        An axis of the grid that is one of space has its name, x, y or z, and the coordinates are those of space;
        otherwise it is u, v or w, and they are from the centre.
        """
        axis = whole("axis", axis, 0, len(self.counts) - 1)
        for letter, unit, middle in zip("xyz", np.eye(3), self.centre, strict=True):
            if np.array_equal(self.axes[axis], unit):
                return letter, middle + self.offsets(axis)
        return "uvw"[axis], self.offsets(axis)

    def positions(self) -> NDArray[np.float64]:
        """Every sample, (..., 3) in metres."""
        at = self.centre
        for axis, direction in enumerate(self.axes):
            along = self.offsets(axis)[:, None] * direction
            at = at + along.reshape((-1, *(1,) * axis, 3))
        return at


def _product(extents: Sequence[float]) -> str:
    return " × ".join(f"{extent:g}" for extent in (extents[:1] if len(set(extents)) == 1 else extents))
