"""The picture of a felt map: the perceived intensity over the flat skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..pictures import MM, axes_or_new, colour_bar
from .perception import FeltMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_felt"]


def draw_felt(ax: Axes | None, felt: FeltMap, **style: Any) -> Axes:
    """Draw perceived intensity over the flat skin, in thresholds; a line surrounds what is above the threshold."""
    mask, spacing = felt.places.mask, felt.places.spacing
    image = np.full(mask.shape, np.nan)
    image[mask] = felt.intensity
    rows, columns = mask.shape
    edges = (0, columns * spacing * MM, 0, rows * spacing * MM)
    axes, title = axes_or_new(ax), style.pop("title", "Perceived intensity over the skin, laid out flat")
    look: dict[str, Any] = {"cmap": "inferno", "vmin": 0, "vmax": max(1.0, float(felt.intensity.max()))}
    drawn = axes.imshow(image, origin="lower", extent=edges, interpolation="nearest", **look | style)
    if np.nanmin(image) < 1 < np.nanmax(image):
        axes.contour(np.nan_to_num(image), levels=[1], extent=edges, colors="#7fdfff", linewidths=1)
    axes.set(title=title, xlabel="across / mm", ylabel="along / mm", facecolor="0.9")
    colour_bar(axes, drawn, "perceived intensity / threshold", fraction=0.046 * rows / columns, pad=0.02)
    return axes
