"""Planes of a field, drawn onto matplotlib axes: a quantity, or the surface of oil that the field pushes down."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...base.pictures import LIGHT, MM, ON_FIELD, SEQUENTIAL, axes_or_new, colour_bar, fixed_size
from ..methods.solve import Wanted, control_points
from ..shapes.points import ControlPoints
from .grid import Grid
from .oil import Oil, PlaneLike, oil_surface
from .quantities import QUANTITIES, sound_pressure_level

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap

__all__ = ["OIL", "draw_oil", "draw_plane"]

OIL = "oil"  # what is drawn beside QUANTITIES

IN_PLANE = 1e-3  # metres from a plane at which a control point is drawn in it
STEEPEST = 0.9  # slope as which the steepest one of an oil surface is drawn
SUN = math.radians(30)  # height of the light over an oil surface
DIFFUSE, SHININESS = 0.75, 30  # of oil: the part of light that is scattered, and the sharpness of its highlights
WIDE = 4.0  # inches of axes whose colour bar has dB too, if no layout engine makes room for them
BEFORE_BAR = 0.6  # inches for dB
LEVELS = (0, -1, -3, -6, -10, -20)  # dB, on the colour bar


def draw_plane(
    ax: Axes | None,
    field: PlaneLike,
    points: Wanted | None = None,
    quantity: str = "pressure",
    largest: float | None = None,
    **style: Any,
) -> Axes:
    """Draw a quantity over a plane; parameters and errors are those of `PlaneField.plot`."""
    if quantity not in QUANTITIES:
        raise ValueError(f"unknown quantity {quantity!r}; known are {', '.join(QUANTITIES)}, {OIL}")
    what = QUANTITIES[quantity]
    marked = None if points is None else control_points(points)
    values = what.of(field.pressure, field.medium)
    axes, title = axes_or_new(ax), style.pop("title", f"{what.name} {_where(field.grid)}")
    end = float(values.max()) if largest is None else largest
    look: dict[str, Any] = {"cmap": SEQUENTIAL, "vmin": 0, "vmax": end or None, "interpolation": "bicubic"}
    image = axes.imshow(values, origin="lower", extent=_edges(field.grid), **look | style)
    _finish(axes, field.grid, marked, title)
    rows, columns = values.shape
    size, end = fixed_size(axes), image.get_clim()[1] or 0.0
    decibels = end > 0 and (size is None or size[0] >= WIDE)
    label, part = f"{what.symbol} / {what.unit}", 0.046 * rows / columns
    bar = colour_bar(axes, image, label, fraction=part, pad=0.02, before=BEFORE_BAR if decibels else 0.0)
    if decibels:
        levels = bar.ax.secondary_yaxis("left")
        levels.set_yticks(
            [end * 10 ** (level / what.decade) for level in LEVELS], [f"{level}".replace("-", "−") for level in LEVELS]
        )
        spl = f" ({float(sound_pressure_level(end)):.0f} dB SPL)" if quantity == "pressure" else ""
        levels.set_ylabel(f"dB re maximum{spl}", labelpad=1)
        levels.tick_params(labelsize="small")
    return axes


def draw_oil(
    ax: Axes | None, field: PlaneLike, points: Wanted | None = None, oil: Oil | None = None, **style: Any
) -> Axes:
    """Draw the surface of oil that a field pushes down, lit from the upper left at a shallow angle.

    `ValueError` if the plane is not horizontal.
    """
    surface = oil_surface(field, oil)
    marked = None if points is None else control_points(points)
    deepest = f"deepest dimple {-surface.min() * MM:.2g} mm"
    axes, title = axes_or_new(ax), style.pop("title", f"Oil {_where(field.grid)}: {deepest}")
    look: dict[str, Any] = {"cmap": _oil_colours(), "vmin": 0, "vmax": 1, "interpolation": "bicubic"}
    axes.imshow(_lit(surface / field.grid.step), origin="lower", extent=_edges(field.grid), **look | style)
    _finish(axes, field.grid, marked, title, colour="#a8f0ff")
    return axes


def _lit(heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Brightness from 0 to 1 of a glossy surface, (rows, columns); heights and distances are in the same unit.

    However low the relief, its steepest slope is drawn as `STEEPEST`: it shows shapes, not depths. The light is diffuse
    (n·l, Lambert) with a highlight ((n·h)^s, Blinn), seen from above.
    """
    along_y, along_x = np.gradient(heights)
    steepest = np.hypot(along_x, along_y).max()
    steeper = STEEPEST / steepest if steepest > 0 else 0.0
    normal = np.stack([-steeper * along_x, -steeper * along_y, np.ones_like(heights)])
    normal /= np.linalg.norm(normal, axis=0)
    light = np.array([-math.sqrt(0.5) * math.cos(SUN), math.sqrt(0.5) * math.cos(SUN), math.sin(SUN)])
    between = light + np.array([0, 0, 1])
    between /= np.linalg.norm(between)
    diffuse, gloss = (np.maximum(0.0, np.tensordot(way, normal, 1)) for way in (light, between))
    return np.asarray(DIFFUSE * diffuse + (1 - DIFFUSE) * gloss**SHININESS)


def _oil_colours() -> Colormap:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("oil", ["#1c1206", "#8a5a14", "#d9a33a", "#ffe9b0", "#fffdf4"])


def _edges(grid: Grid) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a plane's outermost samples, each sample a square, in mm."""
    half = grid.step / 2
    (left, right), (bottom, top) = (
        ((along[0] - half) * MM, (along[-1] + half) * MM) for along in (grid.coordinates(axis)[1] for axis in (0, 1))
    )
    return left, right, bottom, top


def _finish(axes: Axes, grid: Grid, points: ControlPoints | None, title: str, colour: str = LIGHT) -> None:
    """Add the control points in the plane, the title and the labels of the axes."""
    left, right, bottom, top = _edges(grid)
    if points is not None:
        offset = points.positions - grid.centre
        near = offset[np.abs(offset @ grid.normal) < IN_PLANE] @ grid.axes.T
        shift = [grid.coordinates(axis)[1][0] - grid.offsets(axis)[0] for axis in (0, 1)]
        axes.plot(*((near + shift) * MM).T, "o", mfc="none", mec=colour, ms=9, mew=1.0, label="control points")
        if len(near):
            axes.legend(loc="upper right", **ON_FIELD)
        axes.set(xlim=(left, right), ylim=(bottom, top))
    names = [grid.coordinates(axis)[0] for axis in (0, 1)]
    axes.set(title=title, xlabel=f"{names[0]} / mm", ylabel=f"{names[1]} / mm")


def _where(grid: Grid) -> str:
    along = [index for index in range(3) if abs(grid.normal[index]) > 1 - 1e-9]
    if not along:
        x, y, z = grid.centre * MM
        return f"on a plane through ({x:.3g}, {y:.3g}, {z:.3g}) mm"
    if along == [2]:
        return f"{grid.centre[2] * 100:.3g} cm above the array"
    return f"at {'xyz'[along[0]]} = {grid.centre[along[0]] * MM:.3g} mm"
