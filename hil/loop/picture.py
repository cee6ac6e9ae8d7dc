"""The picture of an end-to-end run: the emitted field, the array as driven, and the square waves between."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...base.pictures import LANDSCAPE, new_figure, save_figure
from ...base.storage import FilePath
from ...protocol.board import TICKS_PER_PERIOD
from ...solver import PlaneField
from ...solver.fields.validity import validity
from .end_to_end import EndToEnd

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_waves", "save_end_to_end_picture"]


def draw_waves(axes: Axes, run: EndToEnd) -> None:
    """Draw some outputs, spread over the chain, from one period before they began to play to two after."""
    boundary = run.ack.commit_period * TICKS_PER_PERIOD
    run.capture.plot(axes, start=boundary - TICKS_PER_PERIOD, stop=boundary + 2 * TICKS_PER_PERIOD, zero=boundary)
    axes.axvline(0, color="0.3", linewidth=1, linestyle="--")
    axes.set(
        title=f"Square waves at 2 MHz, around the promised boundary of period {run.ack.commit_period}",
        xlabel="time since the boundary / µs",
    )


def save_end_to_end_picture(path: FilePath, run: EndToEnd, field: PlaneField, headline: str) -> None:
    """Write the picture in the format of the path's suffix."""
    figure = new_figure(7.6, LANDSCAPE)
    axes = figure.subplot_mosaic([["field", "array"], ["waves", "waves"]], height_ratios=[1.35, 1])
    field.plot(axes["field"], points=run.solution.points)
    run.solution.array.plot(axes["array"], drive=run.rebuilt)
    axes["array"].set_title("Drive rebuilt from the bits (area: magnitude)")
    draw_waves(axes["waves"], run)
    figure.suptitle(headline)
    believed = validity(run.solution.array, *field.strongest(), field.medium)
    figure.supxlabel(f"Field: {believed.brief}", fontsize="small")
    save_figure(figure, path)
