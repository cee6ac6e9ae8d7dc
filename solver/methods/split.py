"""Two locally dense halves of the control points, the paper's section 3.4."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import frozen
from ..shapes.points import ControlPoints

__all__ = ["Split", "split"]

KEEP = 0.8  # of the largest variance: with as much along it, the previous axis stays
DEGENERATE = 0.95  # of the largest variance: an eigenvector with as much counts as a first principal component too
HOLD = 1e-3  # metres: how much nearer to its previous half each point is taken to be
TILT = 1e-3  # of the plane, so that points which lie on it fall to one side
ACROSS = 1, 2, 0  # coordinates by which points on the plane are told apart
OBLIQUE = 0.1  # least cosine between an axis and the direction that decides its sign


@dataclass(frozen=True, eq=False)
class Split:
    """A split of control points in two halves by a plane.

    Parameters
    ----------
    mask : (m,) bool
        Whether each point is in the first half. Nulls, which are in both, are False.
    axis : (3,) float
        Unit normal of the plane, from the first half to the second.
    ids : (m,) int64, optional
        Identities of the points.
    """

    mask: NDArray[np.bool_]
    axis: NDArray[np.float64]
    ids: NDArray[np.int64] | None = None

    def __repr__(self) -> str:
        first = int(self.mask.sum())
        return f"Split({first} + {len(self.mask) - first} points)"

    def sides(self, m: int, ids: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """The halves in which m points of the next frame have been, (m,): -1 the first, 1 the second, 0 for new ones.

        Without identities, the points are taken for the same ones if there are as many as here.
        """
        side = np.where(self.mask, -1.0, 1.0)
        if ids is None or self.ids is None:
            return side if len(side) == m else np.zeros(m)
        known = dict(zip(self.ids.tolist(), side.tolist(), strict=True))
        return np.array([known.get(each, 0.0) for each in ids.tolist()])

    def halves(self, points: ControlPoints) -> tuple[ControlPoints, ControlPoints | None]:
        """The points of each half in their order; no second half if only one point is no null.

        Each half contains all nulls: the field must be low there all the time.

        Raises
        ------
        ValueError
            If the split is one of another number of points.
        """
        first, second = self.masks(points)
        return points.part(first), None if second is None else points.part(second)

    def masks(self, points: ControlPoints) -> tuple[NDArray[np.bool_], NDArray[np.bool_] | None]:
        """Which points are in each half, (m,) both; the rest as `halves`."""
        if len(points) != len(self.mask):
            raise ValueError(f"{len(points)} control points do not fit a split of {len(self.mask)}")
        nulls = points.amplitudes == 0
        second = ~self.mask & ~nulls
        return self.mask | nulls, second | nulls if second.any() else None


def split(points: ControlPoints, previous: Split | None = None, ids: NDArray[np.int64] | None = None) -> Split:
    """Split control points by the plane through the median of their first principal component.

    Parameters
    ----------
    points : ControlPoints
        m points. Those that are no nulls are split; the halves differ by at most one point, which the first half has.
    previous : Split, optional
        The split of the last frame. With it the halves change only for a reason.
    ids : (m,) int64, optional
        Identities of the points, by which those of the last frame are known.

    Returns
    -------
    Split
        The first half is on the side of -x, or else -y or -z, unless ``previous`` says otherwise.

    Notes
    -----
    On squares, rings and stars the first principal component is not defined, and noise decides it anew in each
    frame. So in the first frame the direction nearest to x is taken among those with nearly the largest variance
    (`DEGENERATE`). From then on the axis stays while its variance is at least `KEEP` of the largest, and otherwise
    turns towards the first principal component just as far as that takes: a plane that follows a turning shape
    without a jump. Two points that were there before change sides only if one is more than twice `HOLD` beyond the
    other. Points on the plane are told apart by a slight `TILT` of it, by the coordinates y, z and x in this order.
    """
    sounding = points.amplitudes > 0
    all_sound = bool(sounding.all())
    positions = points.positions if all_sound else points.positions[sounding]
    offset = positions - np.add.reduce(positions) / len(positions)
    scatter = offset.T @ offset
    axis = _first_axis(scatter) if previous is None else _next_axis(scatter, previous.axis)
    along = offset @ _tilted(axis.tolist())
    if previous is not None:
        sides = previous.sides(len(points), ids)
        along += HOLD * (sides if all_sound else sides[sounding])
    first = np.argsort(along, kind="stable")[: (len(along) + 1) // 2]
    mask = np.zeros(len(points), dtype=np.bool_)
    mask[first if all_sound else np.flatnonzero(sounding)[first]] = True
    return Split(frozen(mask), frozen(axis), ids)


def _tilted(axis: list[float]) -> NDArray[np.float64]:
    """An axis with a slight tilt, by which points on the plane across it are told apart.

    NumPy would take ten times as long: it is made for many vectors.
    """
    for fixed in ACROSS:
        across = [float(k == fixed) - axis[fixed] * part for k, part in enumerate(axis)]
        if (length := math.hypot(*across)) > OBLIQUE:
            break
    (a, b, c), (d, e, f) = axis, (part / length for part in across)
    upright = b * f - c * e, c * d - a * f, a * e - b * d
    return np.array([p + TILT * q + TILT**2 * r for p, q, r in zip(axis, (d, e, f), upright, strict=True)])


def _first_axis(scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """The direction of nearly the largest variance that is nearest to x, or else to y or z."""
    values, vectors = np.linalg.eigh(scatter)
    leading = vectors[:, values >= DEGENERATE * values[-1]]
    return _first_sure([leading @ (leading.T @ fixed) for fixed in np.eye(3)])


def _next_axis(scatter: NDArray[np.float64], previous: NDArray[np.float64]) -> NDArray[np.float64]:
    """The direction with `KEEP` of the largest variance that is nearest to the previous axis.

    In the plane of the previous axis and the first principal component e, the variance at the angle φ from e is
    λ·cos²φ + λ'·sin²φ, where λ' is the variance across e.
    """
    largest = _largest_eigenvalue(scatter.ravel().tolist())
    if previous @ scatter @ previous >= KEEP * largest:
        return previous.copy()
    vectors = np.linalg.eigh(scatter).eigenvectors
    first = vectors[:, -1] * (1 if vectors[:, -1] @ previous >= 0 else -1)
    across = previous - (previous @ first) * first
    across /= np.linalg.norm(across)
    sine_squared = (1 - KEEP) * largest / (largest - across @ scatter @ across)
    return np.asarray(math.sqrt(1 - sine_squared) * first + math.sqrt(sine_squared) * across)


def _largest_eigenvalue(symmetric: list[float]) -> float:
    """Of a symmetric (3, 3) matrix, row by row, by Smith's formula: a tenth of the time that finding all takes.

    If the two largest are equal, half of the digits are right.
    """
    xx, xy, xz, _, yy, yz, _, _, zz = symmetric
    mean = (xx + yy + zz) / 3
    xx, yy, zz = xx - mean, yy - mean, zz - mean
    scale = math.sqrt((xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if scale == 0:
        return mean
    xx, xy, xz, yy, yz, zz = (part / scale for part in (xx, xy, xz, yy, yz, zz))
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    cosine = min(max(determinant / 2, -1.0), 1.0)
    return mean + 2 * scale * math.cos(math.acos(cosine) / 3)


def _first_sure(vectors: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """The first vector that is longer than `OBLIQUE`, as a unit vector; what is shorter has no sure direction."""
    lengths = [float(np.linalg.norm(vector)) for vector in vectors]
    chosen = next(index for index, length in enumerate(lengths) if length > OBLIQUE)
    return np.asarray(vectors[chosen] / lengths[chosen])
