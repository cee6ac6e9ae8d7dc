"""The picture of a felt map: perceived intensity over the flat skin, and the spectrum where it is strongest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base.pictures import BLUE, GREEN, INK, LANDSCAPE, RED, new_figure, save_figure
from ..base.storage import FilePath
from ..solver.geometry import place
from .perception import FeltMap
from .receptors import TOUCH_CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_felt_spectrum", "save_felt_picture"]

MICROMETRES = 1e6
LEAST = 1e-3
"""Part of the strongest vibration below which none is drawn."""


def draw_felt_spectrum(axes: Axes, felt: FeltMap) -> None:
    """Draw how the strongest place vibrates, and the thresholds of the channels of touch."""
    size = np.abs(felt.spectra[:, felt.strongest])
    shown = size > LEAST * size.max(initial=0)
    axes.vlines(felt.frequencies[shown], 0, size[shown] * MICROMETRES, color=INK, linewidth=1.5, label="vibration")
    for channel, dashes, colour in zip(TOUCH_CHANNELS, ("-", "--", ":"), (BLUE, RED, GREEN), strict=True):
        known = np.array(channel.thresholds)[:, 0]
        least = channel.threshold(known) * MICROMETRES
        axes.plot(known, least, dashes, color=colour, linewidth=1.2, label=f"threshold, {channel.name}")
    axes.set(
        title=f"Strongest place, {place(felt.places.positions[felt.strongest])}",
        xlabel="frequency / Hz",
        ylabel="displacement / µm (peak)",
        xscale="log",
        yscale="log",
    )
    axes.legend(fontsize="small")


def save_felt_picture(path: FilePath, felt: FeltMap, headline: str) -> None:
    """Write the picture in the format of the path's suffix."""
    figure = new_figure(5.0, LANDSCAPE)
    left, right = figure.subplots(1, 2)
    felt.plot(left)
    draw_felt_spectrum(right, felt)
    figure.suptitle(headline)
    save_figure(figure, path)
