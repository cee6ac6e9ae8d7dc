"""The picture of ways to render: a felt map of each, and what is heard of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..feel.hearing import PARTS, a_weighting
from ..pictures import LANDSCAPE, new_figure, printed, save_figure
from ..solver.fields.quantities import REFERENCE
from ..storage import FilePath
from .sensing import Sensation

__all__ = ["save_sensation_picture"]

LEAST_DB = -10.0


@printed()
def save_sensation_picture(path: FilePath, sensations: Mapping[str, Sensation], headline: str) -> None:
    """Write the felt map of each way beside the spectrum of its audible sound, in the format of the path's suffix."""
    count = len(sensations)
    figure = new_figure(7.6, LANDSCAPE)
    maps = figure.subplots(2, count, squeeze=False, height_ratios=[1.6, 1])
    strongest = max(float(sensed.felt.intensity.max()) for sensed in sensations.values())
    for column, (name, sensed) in enumerate(sensations.items()):
        felt, heard = maps[0, column], maps[1, column]
        sensed.felt.plot(felt, vmin=0, vmax=strongest, title=name.replace(":", "\n", 1))
        loudest = int(sensed.sound.levels_dba.argmax())
        for part in PARTS:
            frequency, squares = sensed.sound.spectrum(part)
            audible = frequency >= 20
            with np.errstate(divide="ignore"):
                level = 10 * np.log10(squares[loudest, audible] / REFERENCE**2) + a_weighting(frequency[audible])
            heard.semilogx(frequency[audible], level, linewidth=0.7, label=part)
        heard.set(
            title=f"heard: {sensed.sound.levels_dba[loudest]:.0f} dB(A)",
            xlabel="frequency / Hz",
            ylabel="dB(A)" if column == 0 else "",
            xlim=(20, 20_000),
            ylim=(LEAST_DB, 80),
        )
        heard.legend(fontsize="small")
    figure.suptitle(headline)
    save_figure(figure, path)
