"""The judge of a picture as it is printed: text that can be read, and colours that can be looked up."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D, Bbox
from phasewire.base.pictures import COLUMN, printed

__all__ = ["faults_of"]

SMALLEST_POINTS = 7.0
FEWEST_COLOURS = 200
SLACK_POINTS = 0.5
LIGHT = "oil"  # colours that are light and stand for no quantity


class Line(NamedTuple):
    """A line of text as drawn."""

    text: str
    points: float
    box: Bbox


def faults_of(figure: Figure, width: float = COLUMN) -> list[str]:
    """Everything in a figure that a reader cannot read.

    Parameters
    ----------
    figure : Figure
    width : float
        Inches of the paper between its margins; a wider figure is printed smaller.
    """
    canvas: Any = FigureCanvasAgg(figure)
    lines = _drawn(canvas)
    scale = min(1.0, width / figure.get_figwidth())
    return [
        *(f"{line.text!r} is cut" for line in lines if not _holds(figure.bbox, line.box)),
        *(f"{line.text!r}: {line.points * scale:.1f} pt" for line in lines if line.points * scale < SMALLEST_POINTS),
        *(f"{a.text!r} overlaps {b.text!r}" for a, b in combinations(lines, 2) if a.box.overlaps(b.box)),
        *_faults_of_scales(figure, np.asarray(canvas.buffer_rgba())),
    ]


def _drawn(canvas: Any) -> list[Line]:
    """All lines of text, as the renderer is told to draw them."""
    renderer = canvas.get_renderer()
    draw_text, found = renderer.draw_text, []

    def spy(
        gc: Any, x: float, y: float, s: str, prop: Any, angle: float, ismath: Any = False, mtext: Any = None
    ) -> None:
        wide, high, below = renderer.get_text_width_height_descent(s, prop, ismath)
        turned = Affine2D().rotate_deg(angle).translate(x, canvas.figure.bbox.height - y)
        box = turned.transform_bbox(Bbox([[0, -below], [wide, high - below]]))
        found.append(Line(s, prop.get_size_in_points(), box.padded(-SLACK_POINTS * canvas.figure.dpi / 72)))
        draw_text(gc, x, y, s, prop, angle, ismath, mtext)

    renderer.draw_text = spy
    printed(canvas.figure)
    canvas.draw()
    return [line for line in found if line.text.strip()]


def _holds(outer: Any, inner: Bbox) -> bool:
    return bool(outer.x0 <= inner.x0 and inner.x1 <= outer.x1 and outer.y0 <= inner.y0 and inner.y1 <= outer.y1)


def _faults_of_scales(figure: Figure, pixels: np.ndarray) -> Iterator[str]:
    """Colour bars without a unit or with too few colours, and colours without a bar."""
    mapped: list[Any] = figure.findobj(lambda one: isinstance(one, ScalarMappable) and one.get_array() is not None)
    bars = [one.colorbar for one in mapped if one.colorbar is not None]
    for bar in bars:
        label = bar.ax.get_ylabel() or bar.ax.get_xlabel()
        if " / " not in label:
            yield f"colour bar {label!r} names no unit"
        x0, y0, x1, y1 = (round(edge) for edge in bar.ax.get_window_extent().extents)
        shown = pixels[len(pixels) - y1 : len(pixels) - y0, (x0 + x1) // 2]
        if len(np.unique(shown, axis=0)) < min(FEWEST_COLOURS, len(shown) // 2):
            yield f"colour bar {label!r} shows few colours"
    scales = [(bar.cmap.name, *bar.mappable.get_clim()) for bar in bars]
    for one in mapped:
        if one.get_cmap().name == LIGHT:
            continue
        if one not in [bar.solids for bar in bars] and (one.get_cmap().name, *one.get_clim()) not in scales:
            yield f"colours of {one.get_cmap().name} have no bar"
