"""Pictures at their printed size: figures, their fonts, and their files, written completely or not at all."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .storage import FilePath, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure

__all__ = [
    "COLUMN",
    "FORMATS",
    "LANDSCAPE",
    "MM",
    "Drawable",
    "axes_or_new",
    "check_picture_path",
    "colour_bar",
    "fixed_size",
    "new_figure",
    "printed",
    "save_figure",
]

FORMATS = (".png", ".svg", ".pdf")
COLUMN, LANDSCAPE = 7.1, 10.5
"""Widths in inches between the margins of A4 paper, upright and turned."""
FONT_POINTS = 8.5
DOTS_PER_INCH = 150
NOTEBOOK = (5.6, 4.4)
"""Width and height in inches of a picture that is made by itself."""
BAR = 1.0
"""Inches that a colour bar and the labels on its right need."""
MM = 1e3
"""Millimetres in a metre: axes are in millimetres."""


class Drawable(ABC):
    """Something with a picture: `plot` draws it onto axes, and a notebook shows it."""

    @abstractmethod
    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw it onto matplotlib axes, by default onto those of a new figure of pyplot, and return them.

        ``style`` is a ``title``, and options of the matplotlib function that draws it.
        """

    def _repr_png_(self) -> bytes | None:
        """The picture for a notebook, which shows the text instead if there is none."""
        from matplotlib.figure import Figure

        figure, data = Figure(figsize=NOTEBOOK, layout="compressed"), BytesIO()
        try:
            with printed():
                self.plot(figure.subplots())
                figure.savefig(data, format="png", dpi=DOTS_PER_INCH * 2 // 3)
        except ValueError:  # too large a shape, an empty capture
            return None
        return data.getvalue()


def axes_or_new(ax: Axes | None) -> Axes:
    """The given axes, or those of a new figure of pyplot in its user's style; pyplot is not touched otherwise."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    axes: Axes = pyplot.subplots(figsize=NOTEBOOK, layout="compressed")[1]
    return axes


def fixed_size(axes: Axes) -> tuple[float, float] | None:
    """Width and height of axes in inches; None if a layout engine will change them to make room for labels."""
    engine = axes.figure.get_layout_engine()
    if engine is not None and not engine.colorbar_gridspec:
        return None
    return axes.bbox.width / axes.figure.dpi, axes.bbox.height / axes.figure.dpi


def colour_bar(
    axes: Axes, mappable: ScalarMappable, label: str, *, fraction: float, pad: float, before: float = 0.0
) -> Colorbar:
    """Add a colour bar on the right of axes. Its labels have room of their own, whatever arranges the figure.

    Parameters
    ----------
    axes, mappable, label
        As for matplotlib.
    fraction, pad : float
        Parts of the axes' width for the bar and before it, if a layout engine makes room for the labels.
    before : float
        Inches that labels on the bar's left need.
    """
    shrink = 1.0
    if (size := fixed_size(axes)) is not None:
        width, height = size
        fraction, pad = min(BAR / width, 0.5), pad + before / width
        shrink = min((1 - fraction - pad) * width / height * axes.get_data_ratio(), 1.0)
    return axes.figure.colorbar(mappable, ax=axes, label=label, fraction=fraction, pad=pad, shrink=shrink)


@contextmanager
def printed() -> Iterator[None]:
    """Fonts in points for a picture that is printed at its size; a context or a decorator."""
    from matplotlib import rc_context  # matplotlib takes as long to import as everything else together

    with rc_context({"font.size": FONT_POINTS, "axes.titlesize": "medium", "figure.titlesize": "large"}):
        yield


def new_figure(height: float, width: float = COLUMN) -> Figure:
    """An empty figure; its height and width are in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def check_picture_path(path: FilePath) -> None:
    """Raise `ValueError` if a path does not end in the name of a picture format."""
    if Path(path).suffix.lower() not in FORMATS:
        raise ValueError(f"{path}: a picture's name ends in {', '.join(FORMATS)}")


def save_figure(figure: Figure, path: FilePath) -> None:
    """Write a figure in the format of the path's suffix, completely or not at all."""
    with printed(), replacing(path) as part:  # the labels of ticks take their font now
        figure.savefig(part, format=Path(path).suffix[1:].lower(), dpi=DOTS_PER_INCH)
