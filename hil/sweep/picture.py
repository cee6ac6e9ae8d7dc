"""The picture of a sweep: each measure over each swept field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.pictures import BLUE, LANDSCAPE, new_figure
from .design import FIELDS
from .results import PROBLEM, Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_sweep", "drawn_fields"]

MOST_FIELDS = 8
ROW_INCHES = 1.75
LETTERS = 11
"""In an inch, side by side with room between names."""
BAND = (10, 90)  # per cent of the rows lie below its ends


class Panel(NamedTuple):
    """A measure as it is drawn."""

    name: str
    label: str
    factor: float = 1.0


PANELS = (
    Panel("strength_pa", "mean |p| at the points / Pa"),
    Panel("least_pa", "least |p| / Pa"),
    Panel("spread", "spread / %", 100.0),
    Panel("lobe_db", "strongest lobe / dB"),
    Panel("ghosts", "ghosts"),
    Panel("audible_dba", "audible / dB(A)"),
)
LABELS = {
    "pitch_mm": "pitch / mm",
    "tolerance_mm": "tolerance / mm",
    "temperature_c": "air / °C",
    "assumed_c": "assumed air / °C",
    "gain_error_db": "gain error / dB",
    "phase_error_deg": "phase error / degrees",
    "modulation_hz": "modulation / Hz",
}


def drawn_fields(columns: Mapping[str, Sequence[object]]) -> dict[str, list[str]]:
    """The fields over which a picture draws, each with those that always change together with it; the seed is left out.

    Raises `ValueError` if they are none, or more than `MOST_FIELDS`.
    """
    drawn: dict[str, list[str]] = {}
    for name in FIELDS:
        kinds = len(set(columns[name]))
        if name == "seed" or kinds == 1:
            continue
        for other, together in drawn.items():
            if kinds == len(set(columns[other])) == len(set(zip(columns[name], columns[other], strict=True))):
                together.append(name)
                break
        else:
            drawn[name] = []
    if not 1 <= len(drawn) <= MOST_FIELDS:
        raise ValueError(f"{len(drawn)} fields differ between designs, seeds aside; 1 to {MOST_FIELDS} can be drawn")
    return drawn


def draw_sweep(results: Results, headline: str) -> Figure:
    """Draw the median over all rows with the same value of a field, and where eight tenths of them lie.

    Raises `ValueError` as `drawn_fields`.
    """
    rows = np.flatnonzero([problem is None for problem in results.columns[PROBLEM]])
    swept = drawn_fields(results.columns)
    figure = new_figure(ROW_INCHES * len(PANELS) + 0.8, LANDSCAPE)
    grid = figure.subplots(len(PANELS), len(swept), squeeze=False, sharex="col", sharey="row")
    for along, (name, together) in enumerate(swept.items()):
        for panel, axes in zip(PANELS, grid[:, along], strict=True):
            _draw(axes, results, name, panel, rows)
        grid[-1, along].set_xlabel(", ".join(LABELS.get(each, each) for each in (name, *together)))
    for panel, axes in zip(PANELS, grid[:, 0], strict=True):
        axes.set_ylabel(panel.label)
    figure.suptitle(f"{headline}\nmedians of {len(rows)} rows, and where 80 % of those with the same value lie")
    return figure


def _values(results: Results, name: str, rows: NDArray[np.intp]) -> list[Any]:
    """The values of a field in order; texts in that of the rows."""
    values = dict.fromkeys(results.columns[name][row] for row in rows)
    return list(values) if FIELDS[name] == "str" or None in values else sorted(values)


def _draw(axes: Axes, results: Results, name: str, panel: Panel, rows: NDArray[np.intp]) -> None:
    values = _values(results, name, rows)
    measured = results.numbers(panel.name) * panel.factor
    column = results.columns[name]
    below, middle, above = [], [], []
    for value in values:
        found = measured[[row for row in rows if column[row] == value]]
        found = found[np.isfinite(found)]
        low, mid, high = np.percentile(found, [BAND[0], 50, BAND[1]]) if len(found) else [np.nan] * 3
        below.append(low)
        middle.append(mid)
        above.append(high)
    is_number = all(isinstance(value, (int, float)) for value in values)
    at = values if is_number else list(range(len(values)))
    axes.fill_between(at, below, above, color=BLUE, alpha=0.2, linewidth=0)
    axes.plot(at, middle, color=BLUE, marker="o", markersize=3, linewidth=1.2)
    axes.grid(color="0.9")
    if not is_number:
        names = ["default" if value is None else str(value) for value in values]
        is_wide = sum(map(len, names)) > LETTERS * axes.bbox.width / axes.figure.dpi
        axes.set_xticks(at, names, rotation=45 if is_wide else 0)
