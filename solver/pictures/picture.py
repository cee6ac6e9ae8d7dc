"""Pictures of fields and arrays, drawn onto matplotlib axes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...pictures import save_figure
from ...storage import FilePath
from ..acoustics.array import TransducerArray
from ..fields.field import PlaneField
from ..fields.grid import Grid
from ..fields.oil import Oil, oil_surface
from ..fields.quantities import QUANTITIES, sound_pressure_level
from ..methods.solve import Wanted, control_points
from ..shapes.points import ControlPoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap

__all__ = ["OIL", "draw_array", "draw_field", "draw_oil", "save_field_picture"]

OIL = "oil"  # what `save_field_picture` can draw beside QUANTITIES
MM = 1e3
IN_PLANE = 1e-3  # metres from a plane at which a control point is drawn in it
LEVELS = (0, -1, -3, -6, -10, -20)  # dB, on the colour bar
STEEPEST = 0.9  # slope as which the steepest one of an oil surface is drawn
SUN = math.radians(30)  # height of the light over an oil surface
DIFFUSE, SHININESS = 0.75, 30  # of oil: the part of light that is scattered, and the sharpness of its highlights


def draw_field(axes: Axes, field: PlaneField, points: ControlPoints | None = None, quantity: str = "pressure") -> None:
    """Draw a quantity over a plane, with the control points that lie in it.

    Parameters
    ----------
    axes : matplotlib axes
        To draw onto.
    field : PlaneField
        The field.
    points : ControlPoints, optional
        To be marked.
    quantity : str
        A key of `QUANTITIES`. The colour bar has its unit on the right, and dB relative to the largest sample on the
        left.

    Raises
    ------
    ValueError
        If the quantity is unknown.
    """
    if quantity not in QUANTITIES:
        raise ValueError(f"unknown quantity {quantity!r}; known are {', '.join(QUANTITIES)}")
    what = QUANTITIES[quantity]
    values = what.of(field.pressure, field.medium)
    rows, columns = values.shape
    image = axes.imshow(
        values, origin="lower", extent=_edges(field.grid), cmap="inferno", vmin=0, interpolation="bicubic"
    )
    bar = axes.figure.colorbar(image, ax=axes, fraction=0.046 * rows / columns, pad=0.02)
    bar.set_label(f"{what.symbol} / {what.unit}")
    if (largest := float(values.max())) > 0:
        levels = bar.ax.secondary_yaxis("left")
        levels.set_yticks(
            [largest * 10 ** (level / what.decade) for level in LEVELS],
            [f"{level}".replace("-", "−") for level in LEVELS],
        )
        spl = f" ({float(sound_pressure_level(largest)):.0f} dB SPL)" if quantity == "pressure" else ""
        levels.set_ylabel(f"dB re maximum{spl}", labelpad=1)
        levels.tick_params(labelsize="small")
    _finish(axes, field, points, what.name)


def draw_oil(axes: Axes, field: PlaneField, points: ControlPoints | None = None, oil: Oil | None = None) -> None:
    """Draw the surface of oil that a field pushes down, lit from the upper left at a shallow angle.

    Raises
    ------
    ValueError
        If the plane is not horizontal.
    """
    surface = oil_surface(field, oil)
    axes.imshow(
        _lit(surface / field.grid.step),
        origin="lower",
        extent=_edges(field.grid),
        cmap=_oil_colours(),
        vmin=0,
        vmax=1,
        interpolation="bicubic",
    )
    _finish(axes, field, points, "Oil", colour="#a8f0ff")
    axes.set_title(f"{axes.get_title()}: deepest dimple {-surface.min() * MM:.2g} mm")


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


def _finish(axes: Axes, field: PlaneField, points: ControlPoints | None, name: str, colour: str = "#7fdfff") -> None:
    """Add the control points in the plane, the title and the labels of the axes."""
    grid = field.grid
    left, right, bottom, top = _edges(grid)
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


def draw_array(axes: Axes, array: TransducerArray, drive: NDArray[np.complex128]) -> None:
    """Draw the transducers, coloured by phase; the area of a dot shows its magnitude."""
    x, y = array.positions[:, 0] * MM, array.positions[:, 1] * MM
    dots = axes.scatter(
        x,
        y,
        s=4 + 66 * np.abs(drive),
        c=np.degrees(np.angle(drive)),
        cmap="twilight_shifted",
        vmin=-180,
        vmax=180,
        edgecolors="0.5",
        linewidths=0.5,
    )
    axes.figure.colorbar(dots, ax=axes, label="phase / degrees", ticks=range(-180, 181, 90), fraction=0.046, pad=0.03)
    axes.set(title="Drive of the array", xlabel="x / mm", ylabel="y / mm", aspect="equal")


def save_field_picture(
    path: FilePath, field: PlaneField, points: Wanted | None = None, quantity: str = "pressure"
) -> None:
    """Write a picture of a field with its control points: a quantity of `QUANTITIES`, or the ``oil`` that it pushes."""
    from matplotlib.figure import Figure  # matplotlib takes as long to import as everything else together

    marked = None if points is None else control_points(points)
    shape = field.grid.counts[0] / field.grid.counts[1]
    figure = Figure(figsize=(min(max(5.2 * shape, 3.0), 12.0) + 1.8, 6), layout="compressed")
    if quantity == OIL:
        draw_oil(figure.subplots(), field, marked)
    else:
        draw_field(figure.subplots(), field, marked, quantity)
    save_figure(figure, path)
