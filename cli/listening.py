"""The options ``--listeners`` and ``--max-exposure``: where people are, and how loud it may be there."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from ..base.signals import loading
from ..host.streaming.limiting import SHORTEST_PULSE, Limit
from ..solver import TransducerArray
from ..solver.geometry import as_points
from ..solver.shapes.point_files import POINT_FILES
from ..solver.shapes.shapes import read_vertices

__all__ = ["ListenersOption", "MaxExposureOption", "kept", "limiter", "listener_files", "load_listeners"]

ListenersOption = Annotated[
    str | None,
    typer.Option(
        "--listeners",
        metavar="PLACES",
        help=f"Places of ears: x:y:z/x:y:z/... in m, or a file of points ({', '.join(POINT_FILES)}); by default those "
        "of a person who sits in front of the array on a table.",
    ),
]

MaxExposureOption = Annotated[
    float | None,
    typer.Option(
        "--max-exposure",
        min=0,
        max=200,
        metavar="DB",
        help="Turn the drives down so far that the ultrasound keeps this level at the listeners, in dB SPL, such as "
        "110.",
    ),
]


def listener_files(text: str | None) -> list[Path]:
    """The file that an option may name."""
    return [] if text is None else [Path(text)]


def load_listeners(text: str | None) -> NDArray[np.float64] | None:
    """The places that an option names, (j, 3) in metres; None for the default person."""
    if text is None:
        return None
    try:
        return as_points(read_vertices(text), "listener")
    except ValueError as error:
        raise ValueError(
            f"--listeners {text}: {error}; places are x:y:z/x:y:z/... in m, or a file of points"
        ) from error


def limiter(array: TransducerArray, max_exposure: float | None, listeners: str | None) -> Limit | None:
    """A function from emitted drives (k, n) to the factor that keeps the limit for all of them; None without a limit.

    Raises
    ------
    ValueError
        If the limit is not finite, a place is none, or listeners are named without a limit.
    """
    if max_exposure is None:
        if listeners is not None:
            raise ValueError("--listeners has no effect without --max-exposure; give one such as 110, or leave it out")
        return None
    with loading():
        from ..feel.exposure import exposure_limit
    places = load_listeners(listeners)
    try:
        return exposure_limit(array, places, max_exposure)
    except ValueError as error:
        raise ValueError(str(error) if listeners is None else f"--listeners {listeners}: {error}") from error


def kept(limit_db: float, least_gain: float) -> str:
    """A line for people: what a limit of exposure has cost."""
    done = f"At the listeners {limit_db:g} dB SPL were kept"
    if least_gain == 1:
        return f"{done}, at full drive."
    down = f"{done}; drives were turned down by up to {-20 * math.log10(least_gain):.0f} dB."
    if least_gain < SHORTEST_PULSE / 2:
        down += " From 30 dB on outputs are silent, because pulses are whole ticks."
    return down
