"""Curves and their cut into control points by arc length. Lengths in metres.

Every line becomes points here, whatever drew the line.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import length
from ..geometry import as_points
from .points import MAX_POINTS, ControlPoints

__all__ = ["SPACING", "Curve", "chain", "even_spacing", "ring", "sample_curves", "without_coincidences"]

SPACING = 0.015
"""Arc length between control points in metres, the paper's section 5."""

COINCIDENT = 1e-3  # of the spacing: points closer than this are one point


@dataclass(frozen=True, eq=False)
class Curve:
    """A line in space, known by its arc length.

    Parameters
    ----------
    length : float
        Length in metres, positive.
    closed : bool
        Whether its end is its beginning.
    at : function
        Function from (k,) arc lengths to (k, 3) positions, both in metres.
    sides : int
        Number of congruent sides into which it falls; points are spread alike over all of them.
    corners : tuple of float
        Arc lengths of its vertices, in metres, if it has some.
    """

    length: float
    closed: bool
    at: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    sides: int = 1
    corners: tuple[float, ...] = ()

    def placed(self, matrix: NDArray[np.float64], offset: NDArray[np.float64]) -> Curve:
        """The same curve, its points x at ``matrix @ x + offset``; the matrix turns and scales alone."""
        factor = float(np.cbrt(np.linalg.det(matrix)))
        return Curve(
            factor * self.length,
            self.closed,
            lambda arc: self.at(arc / factor) @ matrix.T + offset,
            self.sides,
            tuple(factor * corner for corner in self.corners),
        )

    def polyline(self, step: float) -> NDArray[np.float64]:
        """Vertices along the curve, (k, 3), at most ``step`` metres apart, its corners among them."""
        even = np.linspace(0.0, self.length, max(2, math.ceil(self.length / step) + 1))
        arcs = np.union1d(even, self.corners)
        return self.at(arcs[np.concatenate([np.diff(arcs) > COINCIDENT * step, [True]])])


def ring(x: float, y: float, height: float, radius: float, start: float = 0.0) -> Curve:
    """A horizontal circle, counterclockwise from the angle ``start`` (radians)."""

    def at(arc: NDArray[np.float64]) -> NDArray[np.float64]:
        angle = start + arc / radius
        return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle), np.full(len(arc), height)], axis=1)

    return Curve(2 * math.pi * radius, closed=True, at=at)


def chain(vertices: ArrayLike, *, closed: bool = False, sides: int = 1) -> Curve:
    """Straight pieces from vertex to vertex, (v, 3) in metres; repeated ones add nothing.

    If it is closed, a last piece leads back to the first vertex. ``sides`` are those of `Curve`; v if all pieces are
    equally long and the corners must be among the points. `ValueError` if the vertices are no coordinates, or it has no
    length.
    """
    corners = as_points(vertices, "polyline corner")
    if closed:
        corners = np.concatenate([corners, corners[:1]])
    pieces = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    corners = corners[np.concatenate([[True], pieces > 0])]
    reached = np.concatenate([[0.0], np.cumsum(pieces[pieces > 0])])
    length = float(reached[-1])
    if length == 0:
        raise ValueError(f"a polyline all of whose corners lie at {corners[0].tolist()} m has no length")

    def at(arc: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(arc, reached, corners[:, axis]) for axis in range(3)], axis=1)

    return Curve(length, closed, at, sides, tuple(reached.tolist()))


def even_spacing(curves: Sequence[Curve], count: int) -> float:
    """The spacing in metres with which curves together take ``count`` points: an open one has both of its ends."""
    return sum(curve.length for curve in curves) / (count - sum(not curve.closed for curve in curves))


def sample_curves(curves: Sequence[Curve], spacing: float = SPACING) -> ControlPoints:
    """Cut curves into control points, curve by curve, equally spaced along each; ``spacing`` is in metres.

    The spacing on a curve is the nearest to the wanted one that divides its length: the strength along a line should
    not vary, so equal spacing goes before corners. A closed curve begins with a point at its start; an open one has
    points at both ends, or a single one in its middle if it is shorter than half the spacing. A curve with sides takes
    the same whole number of steps on each, corners included, unless the sides are shorter than half the spacing.

    If curves meet in a sample, it is one point, not two: the second would only make the system singular. `ValueError`
    if the spacing is not positive, or so small that there are too many points.
    """
    spacing = length("spacing", spacing)
    steps = [_steps(curve, spacing) for curve in curves]
    if (total := sum(count + (not curve.closed) for curve, count in zip(curves, steps, strict=True))) > MAX_POINTS:
        raise ValueError(f"spacing {spacing} m makes {total:.3g} control points; at most {MAX_POINTS} are possible")
    positions = np.concatenate(
        [curve.at(_arc_lengths(curve, int(count))) for curve, count in zip(curves, steps, strict=True)]
    )
    points = ControlPoints.trusted(as_points(positions, "control point"), np.ones(len(positions)))
    return without_coincidences(points, spacing)


def _steps(curve: Curve, spacing: float) -> float:
    """Steps between points: whole, but a float, because it may overflow to infinity."""
    wanted = curve.length / spacing
    return float(curve.sides * np.rint(wanted / curve.sides) or np.rint(wanted))


def _arc_lengths(curve: Curve, steps: int) -> NDArray[np.float64]:
    if curve.closed:
        return curve.length * np.arange(max(1, steps)) / max(1, steps)
    if steps == 0:
        return np.array([curve.length / 2])
    return curve.length * np.arange(steps + 1) / steps


def without_coincidences(points: ControlPoints, spacing: float = SPACING) -> ControlPoints:
    """The points without those that lie within a thousandth of the spacing, in metres, of an earlier one."""
    from scipy.spatial import cKDTree  # which takes 0.1 s to import

    stays = np.ones(len(points), dtype=np.bool_)
    stays[cKDTree(points.positions).query_pairs(COINCIDENT * spacing, output_type="ndarray")[:, 1]] = False
    return points.part(stays)
