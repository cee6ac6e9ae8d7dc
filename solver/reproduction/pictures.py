"""Pictures of the `figures`, drawn onto matplotlib figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.pictures import SEQUENTIAL, new_figure
from ..fields.drawing import draw_oil
from ..fields.field import PlaneField
from .figures import SHAPES_OF_FIGURE_6, TECHNIQUES, AtHeight, Figure4, Rendering, Timing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = ["draw_figure_4", "draw_figure_6", "draw_figure_7", "draw_range"]

MM, CM, MICROSECONDS = 1e3, 1e2, 1e6
COLOURS = {"multiplex": "tab:gray", "min_norm": "tab:blue", "tikhonov": "tab:orange", "wgs": "tab:red", "paper": "k"}
PERIOD = 25.0  # µs of a 40 kHz carrier


def _show(axes: Axes, field: PlaneField, loudest: float) -> AxesImage:
    """|p| over a horizontal plane, on a scale that several panels share."""
    x, y = field.x * MM, field.y * MM
    return axes.imshow(
        np.abs(field.pressure),
        origin="lower",
        extent=(x[0], x[-1], y[0], y[-1]),
        cmap=SEQUENTIAL,
        vmin=0,
        vmax=loudest,
        interpolation="bicubic",
    )


def _loudest(fields: Iterable[PlaneField]) -> float:
    return max(float(np.abs(field.pressure).max()) for field in fields)


def draw_figure_6(panels: Sequence[Rendering], quantity: str = "pressure") -> Figure:
    """A row per technique and a column per shape: |p| on one scale, or the oil that it pushes."""
    figure = new_figure(8.1)
    grid = figure.subplots(len(TECHNIQUES), len(SHAPES_OF_FIGURE_6), squeeze=False)
    loudest = _loudest(panel.field for panel in panels)
    for panel, axes in zip(panels, grid.ravel(), strict=True):
        if quantity == "oil":
            draw_oil(axes, panel.field)
        else:
            image = _show(axes, panel.field, loudest)
        numbers = panel.record()
        axes.set_xlabel(
            f"spread {numbers['deviation_over_mean']:.1%}, {numbers['mean_pa']:.0f} Pa\n"
            f"min/mean {numbers['min_over_mean']:.2f}\n"
            f"missing {numbers['missing']}, ghosts {numbers['ghosts']}",
            fontsize="small",
        )
        axes.set(xticks=[], yticks=[], ylabel="", title="")
    for axes, technique in zip(grid[:, 0], TECHNIQUES.values(), strict=True):
        axes.set_ylabel(technique.name)
    for axes, (number, (name, _)) in zip(grid[0], SHAPES_OF_FIGURE_6.items(), strict=True):
        axes.set_title(f"{number}  {name}")
    if quantity != "oil":
        figure.colorbar(image, ax=grid, label="|p| / Pa (peak)", shrink=0.4, pad=0.01)
    side = panels[0].field.x[-1] - panels[0].field.x[0]
    what = "oil pushed by radiation pressure" if quantity == "oil" else "acoustic field"
    figure.suptitle(f"Figure 6 again: {what}, {side * CM:.0f} cm wide, 20 cm above the array")
    return figure


def draw_figure_7(timings: Sequence[Timing], machine: str) -> Figure:
    """Time of an update against the number of control points, both in decades."""
    figure = new_figure(4.7)
    axes = figure.subplots()
    for name in dict.fromkeys(timing.technique for timing in timings):
        row = [timing for timing in timings if timing.technique == name]
        axes.loglog(
            [timing.points for timing in row],
            [timing.seconds * MICROSECONDS for timing in row],
            marker="o",
            ms=4,
            color=COLOURS[name.split()[0]],
            ls="--" if " " in name else "-",
            label=name,
        )
    axes.axhline(PERIOD, color="0.6", lw=1)
    axes.text(1, PERIOD * 1.05, "one carrier period, 25 µs", color="0.4", fontsize="small")
    axes.set(xlabel="control points", ylabel="median time of an update / µs", title=f"Figure 7 again, on {machine}")
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize="small", ncols=2)
    return figure


def draw_range(found: Sequence[AtHeight]) -> Figure:
    """Strength, sharpness and contrast against the height; the paper's working range is shaded."""
    figure = new_figure(6.3)
    strong, sharp, clean = figure.subplots(3, sharex=True)
    height = [at.height * CM for at in found]
    strong.plot(height, [at.focus for at in found], "o-", ms=3, label="a single focus")
    strong.plot(height, [at.ring for at in found], "s-", ms=3, label="a ring of 6 cm, mean of its points")
    strong.set(ylabel="|p| / Pa (peak)", ylim=(0, None), title="What the array can do, by height above it")
    strong.legend(fontsize="small")
    for values, label in (([at.width for at in found], "across"), ([at.depth for at in found], "along the axis")):
        sharp.plot(height, [np.nan if value is None else value * MM for value in values], "o-", ms=3, label=label)
    sharp.set(ylabel="−6 dB size of the focus / mm", yscale="log")
    sharp.legend(fontsize="small")
    clean.plot(height, [at.contrast for at in found], "s-", ms=3, color="tab:orange")
    clean.axhline(0, color="0.6", lw=1)
    clean.set(xlabel="height / cm", ylabel="strongest lobe beside\nthe ring / dB")
    for axes in (strong, sharp, clean):
        axes.axvspan(15, 50, color="tab:green", alpha=0.08)
        axes.grid(True, alpha=0.25)
    strong.text(15.5, strong.get_ylim()[1] * 0.05, "the paper's range", color="tab:green", fontsize="small")
    return figure


def draw_figure_4(what: Figure4) -> Figure:
    """The two halves, and the component of the intensity that is felt, by both halves in turn and by on and off."""
    figure = new_figure(6.3)
    rows = (
        ("|p| / Pa (peak)", what.halves, ("a  one half of the modulation's period", "b  the other half")),
        (
            "root of the 200 Hz\ncomponent of |p|² / Pa",
            (what.two_sided, what.one_sided),
            ("c  what changes at 200 Hz:\na and b in turn", "d  what changes at 200 Hz:\nall points, on and off"),
        ),
    )
    for panels, (label, fields, titles) in zip(figure.subplots(2, 2), rows, strict=True):
        loudest = _loudest(fields)
        for axes, field, title in zip(panels, fields, titles, strict=True):
            image = _show(axes, field, loudest)
            axes.set(title=title, xlabel="x / mm", ylabel="y / mm")
        figure.colorbar(image, ax=panels, label=label, pad=0.01)
    figure.suptitle(f"Figure 4 again: a square of 10 cm. {what.result.gain.mean:.2f} times the change of intensity")
    return figure
