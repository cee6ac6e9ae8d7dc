"""The picture of ways to render: a felt map of each, and what is heard of them."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.pictures import BLUE, RED, new_figure, save_figure
from ...base.storage import FilePath
from ...feel.drawing import INTENSITY, draw_intensity, write_scale
from ...feel.hearing import PARTS, a_weighting
from ...solver.fields.quantities import REFERENCE
from .sensing import Sensation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["save_sensation_picture"]

LEAST_DB, MOST_DB = -10.0, 80.0
WAY_INCHES, BESIDE_INCHES = {1: 3.4, 2: 3.0, 3: 2.7}, 1.3
"""Width of each way by their number, and of what stands beside them: labels and the scale."""
LEAST_WAY_INCHES = 2.3
HEARD_INCHES = 2.4
"""Height of a spectrum with its labels."""
LETTERS = 11
"""Of a headline in an inch."""
STYLES = dict(zip(PARTS, ((RED, 0.9), (BLUE, 0.9)), strict=True))


def save_sensation_picture(path: FilePath, sensations: Mapping[str, Sensation], headline: str) -> None:
    """Write the felt map of each way above the spectrum of its audible sound, in the format of the path's suffix."""
    column = WAY_INCHES.get(len(sensations), LEAST_WAY_INCHES)
    width = column * len(sensations) + BESIDE_INCHES
    names = ["\n".join(_lines(name, column)) for name in sensations]
    high = column * 1.25 + 0.6 + 0.15 * max(name.count("\n") for name in names)
    figure = new_figure(high + HEARD_INCHES, width)
    maps, spectra = figure.subplots(2, len(sensations), squeeze=False, sharey="row", height_ratios=(high, HEARD_INCHES))
    strongest = max(float(sensed.felt.intensity.max()) for sensed in sensations.values())
    for axes, name, sensed in zip(maps, names, sensations.values(), strict=True):
        felt = sensed.felt
        drawn = draw_intensity(axes, felt.places, felt.intensity, strongest)
        axes.set(title=f"{name}\nfelt: up to {felt.intensity.max():.2g} × threshold")
    for axes, sensed in zip(spectra, sensations.values(), strict=True):
        _draw_heard(axes, sensed)
    for axes in (*maps[1:], *spectra[1:]):
        axes.set_ylabel("")
    bar = figure.colorbar(drawn, ax=list(maps), label=INTENSITY, pad=0.01, fraction=0.05, aspect=30)
    write_scale(bar)
    named: dict[str, Any] = {}
    for axes in (*maps, *spectra):
        named |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    look: dict[str, Any] = {"loc": "outside lower center", "frameon": False, "fontsize": "small"}
    figure.legend(named.values(), named, ncols=min(2 * len(sensations), 4), **look)
    figure.suptitle(textwrap.fill(headline, round(width * LETTERS)))
    save_figure(figure, path)


def _lines(name: str, inches: float) -> list[str]:
    """The name of a way in lines that fit: its parameters on lines of their own."""
    head, _, parameters = name.partition(":")
    return [head, *textwrap.wrap(parameters.replace(",", ", "), round(inches * LETTERS))]


def _draw_heard(axes: Axes, sensed: Sensation) -> None:
    """Draw the lines of the spectrum where it is loudest, in dB(A)."""
    loudest = int(sensed.sound.levels_dba.argmax())
    for part in PARTS:
        frequency, squares = sensed.sound.spectrum(part)
        audible = frequency >= 20
        with np.errstate(divide="ignore"):
            level = 10 * np.log10(squares[loudest, audible] / REFERENCE**2) + a_weighting(frequency[audible])
        shown = level > LEAST_DB
        colour, thick = STYLES[part]
        label = f"{part} sound"
        axes.vlines(frequency[audible][shown], LEAST_DB, level[shown], color=colour, linewidth=thick, label=label)
    axes.set(
        title=f"heard: {sensed.sound.levels_dba[loudest]:.0f} dB(A)",
        xlabel="frequency / Hz",
        ylabel="level / dB(A)",
        xscale="log",
        xlim=(50, 20_000),
        xticks=[100, 1000, 10_000],
        xticklabels=["100", "1000", "10 000"],
        ylim=(LEAST_DB, MOST_DB),
    )
    axes.grid(axis="y", color="0.92")
    axes.set_axisbelow(True)
