"""Perceived intensity, drawn over the flat skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.pictures import FELT, INK, MM, SKIN
from .unfolding import SkinPlaces

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar
    from matplotlib.image import AxesImage

__all__ = ["INTENSITY", "draw_intensity", "write_scale"]

INTENSITY = "perceived intensity / threshold"
LEAST_TOP = 2.0
"""The end of the scale, of the threshold, where hardly anything is felt."""
MARGIN = 4e-3
"""Metres of paper around the skin."""
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def draw_intensity(
    axes: Axes, places: SkinPlaces, intensity: NDArray[np.float64], largest: float | None = None, **style: Any
) -> AxesImage:
    """Draw intensity from the threshold on, by its logarithm, as touch has it; skin that feels nothing is pale.

    ``intensity`` (k,) is in multiples of the threshold; the picture interpolates between the k places, and continues
    them to the outline. ``largest`` is the end of the scale, for several pictures; by default the largest intensity.
    ``style`` are options of matplotlib's ``imshow``. The lines on ``axes`` have labels for a legend.
    """
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm
    from matplotlib.path import Path

    image = _continued(places.mask, intensity)
    rows, columns = np.array(places.mask.shape) * places.spacing * MM
    top = max(LEAST_TOP, float(intensity.max()) if largest is None else largest)
    colours = colormaps[FELT].with_extremes(under=SKIN)
    colours.colorbar_extend = "min"  # type: ignore[assignment]  # the stubs allow only its default, False
    norm = {} if {"vmin", "vmax"} & set(style) else {"norm": LogNorm(1, top)}
    look: dict[str, Any] = {"cmap": colours, "interpolation": "bicubic"} | norm
    drawn = axes.imshow(image, origin="lower", extent=(0, columns, 0, rows), **look | style)
    lines = [line * MM for line in places.outline]
    skin = Path.make_compound_path(*(Path(line, closed=True) for line in lines))
    drawn.set_clip_path(skin, axes.transData)
    for number, line in enumerate(lines):
        axes.fill(*line.T, fill=False, edgecolor=INK, linewidth=0.9, label=None if number else "skin, laid out")
    if image.min() < 1 < image.max():
        x, y = ((np.arange(count) + 0.5) * places.spacing * MM for count in image.shape[::-1])
        edge = axes.contour(x, y, image, levels=[1], colors=INK, linewidths=0.8, linestyles="--")
        edge.set_array(None)  # a line, not a quantity
        edge.set_edgecolor(INK)
        edge.set_clip_path(skin, axes.transData)
        axes.plot([], [], color=INK, linewidth=0.8, linestyle="--", label="threshold: felt inside")
    every = np.concatenate([*lines, [[0, 0], [columns, rows]]])
    (left, bottom), (right, top_mm) = every.min(axis=0) - MARGIN * MM, every.max(axis=0) + MARGIN * MM
    axes.set(xlim=(left, right), ylim=(bottom, top_mm), xlabel="across / mm", ylabel="along / mm", aspect="equal")
    return drawn


def _continued(mask: NDArray[np.bool_], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of the cells of a mask for all cells: linear between them, and as the nearest one around them."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.ndimage import distance_transform_edt

    image = np.zeros(mask.shape)
    image[mask] = values
    nearest = image[tuple(distance_transform_edt(~mask, return_distances=False, return_indices=True))]
    if not mask.all():
        between = LinearNDInterpolator(np.argwhere(mask), values)(np.argwhere(~mask))
        image[~mask] = np.where(np.isnan(between), nearest[~mask], between)
    return image


def write_scale(bar: Colorbar) -> None:
    """Round numbers on the scale of what `draw_intensity` drew."""
    low, high = bar.mappable.get_clim()
    ticks = [tick for tick in TICKS if (low or 0.0) <= tick <= (high or 0.0)]
    bar.set_ticks(ticks, labels=[f"{tick}" for tick in ticks])
    bar.ax.minorticks_off()
