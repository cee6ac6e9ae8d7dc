"""Pictures at their printed size: figures, their fonts, and their files, written completely or not at all."""

from __future__ import annotations

from abc import ABC, abstractmethod
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .storage import FilePath, write_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "COLUMN",
    "CYCLIC",
    "FELT",
    "FORMATS",
    "GREEN",
    "INK",
    "LANDSCAPE",
    "LIGHT",
    "MM",
    "ON_FIELD",
    "ORANGE",
    "RED",
    "SEQUENTIAL",
    "SKIN",
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
HEADLINE = 1.2
"""Size of a figure's title, of that of other text."""
EDGE = 0.08
"""Inches of paper around what is drawn: the canvas is as large as that needs."""
DOTS_PER_INCH = 150
NOTEBOOK = (5.6, 4.4)
"""Width and height in inches of a picture that is made by itself."""
BAR = 1.0
"""Inches that a colour bar and the labels on its right need."""
MM = 1e3
"""Millimetres in a metre: axes are in millimetres."""

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
"""Of the palette of Okabe and Ito, which people with any colour vision can tell apart; lines and markers differ too."""
SEQUENTIAL, CYCLIC, FELT = "inferno", "twilight_shifted", "plasma_r"
"""Colour maps of magnitudes, phases, and feeling on pale skin: even for the eye, also for one that is colour-blind."""
LIGHT, INK, SKIN = "#7fdfff", "#333333", "#e6e0da"
"""Colours of marks on a dark field, of outlines on paper, and of skin that feels nothing."""

ON_FIELD: dict[str, Any] = {"fontsize": "small", "facecolor": "0.15", "labelcolor": "w", "framealpha": 0.7}
"""Options of a legend on a dark field."""


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
            self.plot(figure.subplots())
            printed(figure).savefig(data, format="png", dpi=DOTS_PER_INCH * 2 // 3)
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
        The axes, what is drawn in them, and its label, for matplotlib.
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


def printed(figure: Figure) -> Figure:
    """Give the text of a figure its size on paper, once, and return the figure.

    Sizes are set on the figure's own text: settings of matplotlib are those of all threads, and of the user. A size
    that was asked for by a name, such as ``"small"``, keeps its meaning.
    """
    from matplotlib import rcParams  # matplotlib takes as long to import as everything else together
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.font_manager import FontProperties
    from matplotlib.text import Text

    def points(size: str | float) -> float:
        return FontProperties(size=size).get_size_in_points()

    if vars(figure).get("is_printed"):
        return figure
    vars(figure)["is_printed"] = True
    headline, title = points(rcParams["figure.titlesize"]), points(rcParams["axes.titlesize"])
    label = points(rcParams["axes.labelsize"])
    usual: dict[Text, tuple[float, float]] = {}
    for part in (figure, *figure.subfigs):
        usual |= dict.fromkeys(part.texts, (headline, HEADLINE))
    for axes in figure.findobj(Axes):
        usual |= {axes.title: (title, 1.0), axes.xaxis.label: (label, 1.0), axes.yaxis.label: (label, 1.0)}
    for text in figure.findobj(Text):
        was, factor = usual.get(text, (None, 1.0))
        here = text.get_fontsize()
        text.set_fontsize(FONT_POINTS * (factor if here == was else here / rcParams["font.size"]))
    for axis in figure.findobj(Axis):
        asked = axis.get_tick_params().get("labelsize")
        axis.set_tick_params("both", labelsize=FONT_POINTS * (points(asked) / rcParams["font.size"] if asked else 1.0))
    return figure


def new_figure(height: float, width: float = COLUMN) -> Figure:
    """An empty figure; its height and width are in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def check_picture_path(path: FilePath) -> None:
    """Raise `ValueError` if a path does not end in the name of a picture format."""
    if Path(path).suffix.lower() not in FORMATS:
        raise ValueError(f"{path}: a picture's name ends in {', '.join(FORMATS)}")


def save_figure(figure: Figure, path: FilePath) -> None:
    """Write a figure on a canvas that fits it, in the format of the path's suffix, completely or not at all."""
    data = BytesIO()  # because matplotlib's writer of PDF fails a second time if the disk is full
    kind = Path(path).suffix[1:].lower()
    printed(figure).savefig(data, format=kind, dpi=DOTS_PER_INCH, bbox_inches="tight", pad_inches=EDGE)
    write_file(path, data.getvalue())
