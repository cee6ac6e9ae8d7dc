"""A picture of a study: the answers beside the paper's, and the flat shapes in two ways."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.pictures import BLUE, ORANGE, new_figure
from .judging import PAPER_TRIALS, TABLE_1, Confusion
from .pointer import HAJAS, WAYS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .running import Study

__all__ = ["draw_study"]

OURS, THEIRS = BLUE, ORANGE


def draw_study(study: Study) -> Figure:
    """The confusion matrix as counts, right answers by shape beside the paper's, and outline against pointer."""
    figure = new_figure(6.4)
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    upper, lower = parts
    matrix, shapes = upper.subplots(1, 2, width_ratios=(1.1, 1))
    _draw_counts(matrix, study.felt)
    found = study.felt.by_shape()
    _draw_bars(
        shapes,
        [_short(shape) for shape in found],
        {
            "simulated": [share for share, _ in found.values()],
            "people (Long et al.)": [TABLE_1[shape][shape] / PAPER_TRIALS for shape in found],
        },
        [error for _, error in found.values()],
        1 / len(found),
    )
    shapes.set_title("Right answers by shape")
    flat = lower.subplots(1, 2)
    for axes, (judge, answers) in zip(flat, study.pointer.items(), strict=True):
        both = [answers.outline, answers.pointer]
        _draw_bars(
            axes,
            ["static outline", "moving pointer"],
            {
                "simulated": [each.accuracy for each in both],
                "people (Hajas et al.)": [HAJAS[way] for way in WAYS],
            },
            [each.error for each in both],
            1 / len(both[0].answers),
        )
        axes.set_title(f"Flat shapes on a palm, judge taught by {judge}")
    accuracy = f"{study.felt.accuracy:.0%} ± {study.felt.error:.0%}"
    figure.suptitle(
        f"Simulated study: {accuracy} right, people 80 %\n"
        f"field off {study.silent.accuracy:.0%}, shuffled labels {study.shuffled.accuracy:.0%}, by chance 20 %"
    )
    return figure


def _draw_counts(axes: Axes, confusion: Confusion) -> None:
    """Counts in squares; the darker, the larger is their share of the row."""
    from matplotlib.patches import Rectangle

    names = [_short(answer) for answer in confusion.answers]
    for row, counts in enumerate(confusion.counts):
        for column, count in enumerate(counts.tolist()):
            colour = OURS if confusion.shapes[row] == confusion.answers[column] else THEIRS
            share = 0.7 * count / counts.sum()
            axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, color=colour, alpha=share, linewidth=0))
            axes.text(column, row, str(count) if count else "–", ha="center", va="center")
    axes.set(
        xlim=(-0.5, len(names) - 0.5),
        ylim=(len(confusion.shapes) - 0.5, -0.5),
        xticks=range(len(names)),
        xticklabels=names,
        yticks=range(len(confusion.shapes)),
        yticklabels=[_short(shape) for shape in confusion.shapes],
        xlabel="answered",
        ylabel="explored",
        title="Answers of the simulated persons",
    )
    axes.tick_params(length=0)


def _draw_bars(
    axes: Axes, names: Sequence[str], shares: dict[str, list[float]], errors: Sequence[float], chance: float
) -> None:
    """Shares of right answers, ours with standard errors, beside those of people; and that of guessing."""
    at = np.arange(len(names))
    for offset, colour, (label, values) in zip((-0.2, 0.2), (OURS, THEIRS), shares.items(), strict=True):
        axes.bar(at + offset, values, 0.4, color=colour, label=label, yerr=errors if colour == OURS else None)
    axes.axhline(chance, color="0.3", linestyle="--", linewidth=1, label="by chance")
    axes.set(xticks=at, xticklabels=names, ylabel="share of right answers", ylim=(0, 1.3), yticks=np.arange(6) / 5)
    axes.legend(fontsize="small", loc="upper center", ncols=2, frameon=False)
    axes.spines[["right", "top"]].set_visible(False)


def _short(shape: str) -> str:
    """A name that is narrow enough for a column."""
    return shape.replace("_", "\n").replace("horizontal", "lying").replace("vertical", "upright")
