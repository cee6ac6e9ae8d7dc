"""Control points: where the field should be strong, and where it should be low."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, length
from ...base.pictures import MM, Drawable, axes_or_new
from ..acoustics.array import TransducerArray
from ..acoustics.propagation import PAIRS_AT_A_TIME
from ..geometry import Scalable, as_points, coincident, counted, extent, frozen, place

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["MAX_POINTS", "REACH", "ControlPoints", "check_reachable", "reachable"]

MAX_POINTS = 4096
"""Most control points that are solved for at once: far more than an array can serve, few enough for the memory."""

COINCIDENT = 1e-4
"""Distance in metres below which two points are one: a hundredth of a wavelength."""

LEAST_AMPLITUDE = 1e-300
"""Of the strongest point: the inverse of a smaller one may be infinite."""

REACH = 2.0
"""Distance in metres beyond which a control point is taken for a mistake, such as millimetres given as metres. The
paper's array works best from 0.15 to 0.5 m."""

LEVEL = 1e-6
"""Height in metres over the plane of a transducer up to which a point is in it, where nothing sounds. The kernels have
the same number."""

LEVEL_MM = 0.1
"""Points whose heights differ by less are drawn as if in one plane."""


@dataclass(frozen=True, eq=False)
class ControlPoints(Scalable["ControlPoints"], Drawable):
    """Points and how strong the field should be at each, relative to the others.

    Parameters
    ----------
    positions : (m, 3) float
        Places in metres, in the array's coordinates.
    amplitudes : float or (m,) float, optional
        Relative pressure amplitudes, of all points or of each, at least 0; a point of amplitude 0 is a null. All 1
        by default. A solver meets the ratios as nearly as the array can; it counts errors in pascals. The drive limit
        decides the pressure.

    Raises
    ------
    ValueError
        If a number is not finite, an amplitude is negative, all are zero, or lengths differ.
    """

    positions: NDArray[np.float64]
    amplitudes: NDArray[np.float64]

    def __init__(self, positions: ArrayLike, amplitudes: ArrayLike | None = None) -> None:
        points = as_points(positions, "control point")
        values = np.ones(len(points)) if amplitudes is None else array_of("amplitudes", amplitudes, np.float64)
        if values.ndim == 0:
            values = np.full(len(points), values)
        if values.shape != (len(points),):
            raise ValueError(f"amplitudes have the shape {values.shape}, but there are {len(points)} control points")
        if not (values.min() >= 0 and values.max() < math.inf):  # true also if one is not a number
            bad = np.flatnonzero(~np.isfinite(values) | (values < 0))
            raise ValueError(f"amplitude {values[bad[0]]} of control point {bad[0]} must be finite and not negative")
        if not values.any():
            raise ValueError("every control point has amplitude 0; at least one must be positive")
        if values.max() < LEAST_AMPLITUDE:
            raise ValueError(f"the largest amplitude is {values.max():g}; it must be at least {LEAST_AMPLITUDE:g}")
        if pair := coincident(points, COINCIDENT):
            warn(
                f"control points {pair[0]} and {pair[1]} are both at {place(points[pair[0]])}: two at one place are "
                "felt as one, and take strength from the others",
                stacklevel=2,
            )
        object.__setattr__(self, "positions", frozen(points))
        object.__setattr__(self, "amplitudes", frozen(values))

    def __repr__(self) -> str:
        return f"ControlPoints({counted(len(self), 'point')}, {extent(self.positions)} about {place(self.centre)})"

    def __len__(self) -> int:
        return len(self.positions)

    def __add__(self, other: ControlPoints) -> ControlPoints:
        """These points, then the others, each with its amplitude."""
        if not isinstance(other, ControlPoints):
            return NotImplemented
        return ControlPoints(
            np.concatenate([self.positions, other.positions]), np.concatenate([self.amplitudes, other.amplitudes])
        )

    def __radd__(self, other: int) -> ControlPoints:
        """These points; ``sum`` begins with 0."""
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def sample(self, spacing: float | None = None) -> ControlPoints:
        """These points, so that they are a shape too: there is no line to cut."""
        if spacing is not None:
            length("spacing", spacing)
        return self

    @property
    def centre(self) -> NDArray[np.float64]:
        """(3,) mean of the positions, in metres."""
        return np.asarray(self.positions.mean(axis=0))

    def placed(self, matrix: NDArray[np.float64], offset: NDArray[np.float64]) -> ControlPoints:
        """The points x at ``matrix @ x + offset``, with their amplitudes; `moved`, `rotated` and `scaled` use it."""
        return ControlPoints(self.positions @ matrix.T + offset, self.amplitudes)

    def plot(self, ax: Axes | None = None, *, second: NDArray[np.bool_] | None = None, **style: Any) -> Axes:
        """Draw them along the two axes on which they extend most; areas show amplitudes, and crosses are nulls.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Axes to draw onto; by default those of a new figure of pyplot.
        second : (m,) bool, optional
            Those of a second half, to be drawn in a second colour.
        **style
            A ``title``, and options of matplotlib's ``scatter``.
        """
        axes = axes_or_new(ax)
        across, up = sorted(np.argsort(-np.ptp(self.positions, axis=0), kind="stable")[:2])
        sizes = 40 * self.amplitudes / self.amplitudes.max()
        rest = 3 - across - up
        low, high = (
            float(bound) * MM + 0.0 for bound in (self.positions[:, rest].min(), self.positions[:, rest].max())
        )
        where = f"{low:.4g} mm" if high - low < LEVEL_MM else f"{low:.4g} to {high:.4g} mm"
        title = style.pop("title", f"{counted(len(self), 'control point')} at {'xyz'[rest]} = {where}")
        later = np.zeros(len(self), np.bool_) if second is None else second
        for name, colour, drawn in (("first half", "C0", ~later), ("second half", "C1", later)):
            for marker, of in (("o", drawn & (self.amplitudes > 0)), ("x", drawn & (self.amplitudes == 0))):
                if of.any():
                    x, y = self.positions[of][:, [across, up]].T * MM
                    size = sizes[of] if marker == "o" else 40
                    look: dict[str, Any] = {
                        "s": size,
                        "color": colour,
                        "marker": marker,
                        "label": name if marker == "o" else None,
                    }
                    axes.scatter(x, y, **look | style)
        if second is not None:
            axes.legend(fontsize="small")
        axes.set(title=title, xlabel=f"{'xyz'[across]} / mm", ylabel=f"{'xyz'[up]} / mm")
        axes.set_aspect("equal", adjustable="datalim")
        return axes

    def part(self, of: NDArray[np.bool_]) -> ControlPoints:
        """The points of a mask (m,); at least one of them must not be a null."""
        return self.trusted(self.positions[of], self.amplitudes[of])

    @classmethod
    def trusted(cls, positions: NDArray[np.float64], amplitudes: NDArray[np.float64]) -> Self:
        """Points whose values were checked before; the arrays are kept, read-only from now on.

        For live use: the checks take as long as a quarter of a solution.
        """
        points = object.__new__(cls)
        object.__setattr__(points, "positions", frozen(positions))
        object.__setattr__(points, "amplitudes", frozen(amplitudes))
        return points


def check_reachable(array: TransducerArray, points: ControlPoints, where: str = "") -> None:
    """Raise `ValueError` if the array cannot reach a point; the message begins with ``where`` and names the point."""
    for problem, advice in _problems(array, points.positions):
        if problem.any():
            first = int(np.argmax(problem))
            raise ValueError(f"{where}control point {first} at {points.positions[first].tolist()} m {advice}")


def reachable(array: TransducerArray, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of (m, 3) points the array can reach: (m,), true for those that `check_reachable` lets pass."""
    from ..acoustics.tables import surely_reachable  # numba takes half a second to import

    if surely_reachable(array, positions, REACH):
        return np.ones(len(positions), np.bool_)
    return np.asarray(~np.any([problem for problem, _ in _problems(array, positions)], axis=0))


def _problems(array: TransducerArray, positions: NDArray[np.float64]) -> list[tuple[NDArray[np.bool_], str]]:
    """The reasons why points cannot be reached: a mask of the points, and the message."""
    in_front, nearest = np.empty(len(positions), np.bool_), np.empty(len(positions))
    at_a_time = max(1, PAIRS_AT_A_TIME // len(array))
    for first in range(0, len(positions), at_a_time):
        part = slice(first, first + at_a_time)
        offset = positions[part, None, :] - array.positions[None, :, :]
        in_front[part] = (np.einsum("mnk,nk->mn", offset, array.normals) > LEVEL)[:, array.able].any(axis=1)
        nearest[part] = np.linalg.norm(offset, axis=2).min(axis=1)
    return [
        (
            ~in_front,
            "is on the array or behind it, as far as that can sound; z must be positive in front of a flat array",
        ),
        (
            nearest < array.transducer.nearest,
            f"is closer to a transducer than {array.transducer.nearest} m, where its model ends",
        ),
        (nearest > REACH, f"is out of reach, more than {REACH:g} m away; coordinates are in metres"),
    ]
