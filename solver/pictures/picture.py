"""Pictures of fields as files, and the surface of oil."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...pictures import LANDSCAPE, MM, save_figure
from ...storage import FilePath
from ..fields.drawing import edges, finish
from ..fields.field import PlaneField
from ..fields.oil import Oil, oil_surface
from ..fields.quantities import QUANTITIES
from ..methods.solve import Wanted, control_points
from ..shapes.points import ControlPoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap

__all__ = ["OIL", "compare_fields", "draw_oil", "save_field_picture"]

OIL = "oil"  # what `save_field_picture` can draw beside QUANTITIES
STEEPEST = 0.9  # slope as which the steepest one of an oil surface is drawn
SUN = math.radians(30)  # height of the light over an oil surface
DIFFUSE, SHININESS = 0.75, 30  # of oil: the part of light that is scattered, and the sharpness of its highlights


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
        extent=edges(field.grid),
        cmap=_oil_colours(),
        vmin=0,
        vmax=1,
        interpolation="bicubic",
    )
    finish(axes, field.grid, points, "Oil", colour="#a8f0ff")
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


def compare_fields(
    fields: Mapping[str, PlaneField], points: Wanted | None = None, quantity: str = "pressure"
) -> NDArray[Any]:
    """Draw fields side by side in a new figure of pyplot, all on one scale.

    Parameters
    ----------
    fields : mapping of str to PlaneField
        At least one, by the name of each, such as that of a method.
    points : ControlPoints, Shape or (m, 3) float, optional
        Those in the planes are marked.
    quantity : str
        A key of `QUANTITIES`.

    Returns
    -------
    (n,) matplotlib axes
        In the order of the fields.

    Raises
    ------
    ValueError
        If there are no fields, or the quantity is unknown.
    """
    from matplotlib import pyplot

    if not fields:
        raise ValueError("there are no fields to compare; give at least one")
    if quantity not in QUANTITIES:
        raise ValueError(f"unknown quantity {quantity!r}; known are {', '.join(QUANTITIES)}")
    marked = None if points is None else control_points(points)
    what = QUANTITIES[quantity]
    largest = max(float(what.of(field.pressure, field.medium).max()) for field in fields.values())
    figure, grid = pyplot.subplots(1, len(fields), figsize=(LANDSCAPE, 3.6), squeeze=False, layout="compressed")
    for (name, field), axes in zip(fields.items(), grid[0], strict=True):
        field.plot(axes, points=marked, quantity=quantity, largest=largest)
        axes.set_title(name)
        if axes is not grid[0, -1]:
            axes.images[0].colorbar.remove()
    figure.suptitle(f"{what.name}, one scale")
    return np.asarray(grid[0])


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
        field.plot(figure.subplots(), points=marked, quantity=quantity)
    save_figure(figure, path)
