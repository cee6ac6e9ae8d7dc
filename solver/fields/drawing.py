"""Planes of a field, drawn onto matplotlib axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...pictures import MM
from ..acoustics.medium import Medium
from ..shapes.points import ControlPoints
from .grid import Grid
from .quantities import QUANTITIES, sound_pressure_level

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_plane", "edges", "finish"]

IN_PLANE = 1e-3  # metres from a plane at which a control point is drawn in it
LEVELS = (0, -1, -3, -6, -10, -20)  # dB, on the colour bar


def draw_plane(
    axes: Axes,
    grid: Grid,
    pressure: NDArray[np.complex128],
    medium: Medium,
    points: ControlPoints | None = None,
    quantity: str = "pressure",
    largest: float | None = None,
) -> None:
    """Draw a quantity over a plane, with the control points that lie in it.

    Parameters
    ----------
    axes : matplotlib axes
        To draw onto.
    grid : Grid
        The plane.
    pressure : (rows, columns) complex
        Peak pressure in Pa, of the grid's shape.
    medium : Medium
        The air.
    points : ControlPoints, optional
        To be marked.
    quantity : str
        A key of `QUANTITIES`. The colour bar has its unit on the right, and dB relative to its end on the left.
    largest : float, optional
        Value at the end of the colour bar, in the quantity's unit, to compare pictures; by default the largest sample.

    Raises
    ------
    ValueError
        If the quantity is unknown.
    """
    if quantity not in QUANTITIES:
        raise ValueError(f"unknown quantity {quantity!r}; known are {', '.join(QUANTITIES)}")
    what = QUANTITIES[quantity]
    values = what.of(pressure, medium)
    rows, columns = values.shape
    end = float(values.max()) if largest is None else largest
    image = axes.imshow(
        values, origin="lower", extent=edges(grid), cmap="inferno", vmin=0, vmax=end or None, interpolation="bicubic"
    )
    bar = axes.figure.colorbar(image, ax=axes, fraction=0.046 * rows / columns, pad=0.02)
    bar.set_label(f"{what.symbol} / {what.unit}")
    if end > 0:
        levels = bar.ax.secondary_yaxis("left")
        levels.set_yticks(
            [end * 10 ** (level / what.decade) for level in LEVELS],
            [f"{level}".replace("-", "−") for level in LEVELS],
        )
        spl = f" ({float(sound_pressure_level(end)):.0f} dB SPL)" if quantity == "pressure" else ""
        levels.set_ylabel(f"dB re maximum{spl}", labelpad=1)
        levels.tick_params(labelsize="small")
    finish(axes, grid, points, what.name)


def edges(grid: Grid) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a plane's outermost samples, each sample a square, in mm."""
    half = grid.step / 2
    (left, right), (bottom, top) = (
        ((along[0] - half) * MM, (along[-1] + half) * MM) for along in (grid.coordinates(axis)[1] for axis in (0, 1))
    )
    return left, right, bottom, top


def finish(axes: Axes, grid: Grid, points: ControlPoints | None, name: str, colour: str = "#7fdfff") -> None:
    """Add the control points in the plane, the title and the labels of the axes."""
    left, right, bottom, top = edges(grid)
    if points is not None:
        offset = points.positions - grid.centre
        near = offset[np.abs(offset @ grid.normal) < IN_PLANE] @ grid.axes.T
        shift = [grid.coordinates(axis)[1][0] - grid.offsets(axis)[0] for axis in (0, 1)]
        axes.plot(*((near + shift) * MM).T, "o", mfc="none", mec=colour, ms=9, mew=1.0, label="control points")
        if len(near):
            axes.legend(loc="upper right", fontsize="small", facecolor="0.15", labelcolor="w", framealpha=0.7)
        axes.set(xlim=(left, right), ylim=(bottom, top))
    names = [grid.coordinates(axis)[0] for axis in (0, 1)]
    axes.set(title=f"{name} {_where(grid)}", xlabel=f"{names[0]} / mm", ylabel=f"{names[1]} / mm")


def _where(grid: Grid) -> str:
    along = [index for index in range(3) if abs(grid.normal[index]) > 1 - 1e-9]
    if not along:
        x, y, z = grid.centre * MM
        return f"on a plane through ({x:.3g}, {y:.3g}, {z:.3g}) mm"
    if along == [2]:
        return f"{grid.centre[2] * 100:.3g} cm above the array"
    return f"at {'xyz'[along[0]]} = {grid.centre[along[0]] * MM:.3g} mm"
