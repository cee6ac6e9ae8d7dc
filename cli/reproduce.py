"""Commands that compute the paper's figures again: ``reproduce``."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
import typer
from rich.table import Column, Table

from ..base.pictures import check_picture_path, save_figure
from ..base.storage import check_outputs
from ..solver.reproduction.figures import (
    SHAPES_OF_FIGURE_6,
    TECHNIQUES,
    AtHeight,
    Rendering,
    Timing,
    reproduce_figure_4,
    reproduce_figure_6,
    reproduce_figure_7,
    reproduce_range,
)
from ..solver.reproduction.pictures import draw_figure_4, draw_figure_6, draw_figure_7, draw_range
from .console import JsonOption, console_for, error_console, write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None, no_args_is_help=True, help="Compute a figure of the paper again.")

OutputOption = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE", help="The .png, .svg or .pdf file to draw.")
]
Result = TypeVar("Result")


def _compute(what: str, output: Path, json_target: str | None, compute: Callable[[], Result]) -> Result:
    """Check the outputs, then compute, with a sign of progress."""
    check_picture_path(output)
    check_outputs([output, json_target])
    with error_console().status(what):
        return compute()


def _finish(
    output: Path, figure: Figure, json_target: str | None, record: dict[str, Any], table: Table, claims: list[str]
) -> None:
    """Write the picture, the table, the verdicts on the paper's claims, and the record."""
    save_figure(figure, output)
    out = console_for(json_target)
    out.print(table)
    for claim in claims:
        out.print(claim)
    out.print(f"Drawn to {output}.")
    write_json(json_target, {"format": "phasewire-reproduction-1", "file": str(output), "claims": claims} | record)


def _table(*headers: str) -> Table:
    """An empty table of text and numbers, narrow enough for 80 columns."""
    left, *right = (Column(header, justify="right", no_wrap=True) for header in headers)
    left.justify = "left"
    return Table(left, *right, box=None, padding=(0, 2, 0, 0), pad_edge=False)


def _verdict(holds: bool) -> str:
    return "reproduced" if holds else "NOT reproduced"


@commands.command(epilog="Example: phasewire reproduce figure6 --oil --output oil.png")
def figure6(
    output: OutputOption = Path("figure6.png"),
    oil: Annotated[bool, typer.Option("--oil", help="Draw oil pushed by the field instead of the field.")] = False,
    json_target: JsonOption = None,
) -> None:
    """Four shapes by linear multiplexing (A), without (B) and with regularisation (C), and by our own method."""
    panels = _compute("rendering four shapes by four techniques", output, json_target, reproduce_figure_6)
    table = _table("technique and shape", "mean/Pa", "min/mean", "spread", "missing", "ghosts")
    for panel in panels:
        numbers = panel.record()
        table.add_row(
            f"{panel.technique}{panel.shape}  {SHAPES_OF_FIGURE_6[panel.shape][0]}",
            f"{numbers['mean_pa']:.0f}",
            f"{numbers['min_over_mean']:.2f}",
            f"{numbers['deviation_over_mean']:.1%}",
            str(numbers["missing"]),
            str(numbers["ghosts"]),
        )
    _finish(
        output,
        draw_figure_6(panels, "oil" if oil else "pressure"),
        json_target,
        {"panels": [panel.record() for panel in panels]},
        table,
        figure_6_claims(panels),
    )


def figure_6_claims(panels: list[Rendering]) -> list[str]:
    """The paper's claims about Figure 6, and the verdicts."""

    def total(letter: str, key: str) -> int:
        return sum(int(panel.record()[key]) for panel in panels if panel.technique == letter)

    def mean(letter: str, key: str) -> float:
        return float(np.mean([panel.record()[key] for panel in panels if panel.technique == letter]))

    spreads = {letter: mean(letter, "deviation_over_mean") for letter in TECHNIQUES}
    worse = total("A", "ghosts") > 3 * total("B", "ghosts") and total("A", "missing") > 0
    better = spreads["C"] < 0.95 * spreads["B"]
    return [
        f"A misses points and has prominent secondary maxima: {_verdict(worse)} "
        f"({total('A', 'missing')} missing, {total('A', 'ghosts')} ghosts; B {total('B', 'missing')} and "
        f"{total('B', 'ghosts')})",
        f"C is markedly more regular than B: {_verdict(better)} (mean spread {spreads['C']:.1%} against "
        f"{spreads['B']:.1%}, ghosts {total('C', 'ghosts')} against {total('B', 'ghosts')})",
        f"ours: mean spread {spreads['ours']:.2%}, {total('ours', 'ghosts')} ghosts, at "
        f"{mean('ours', 'mean_pa') / mean('C', 'mean_pa'):.0%} of the strength of C",
    ]


@commands.command(epilog="Example: phasewire reproduce figure7 --json figure7.json")
def figure7(output: OutputOption = Path("figure7.png"), json_target: JsonOption = None) -> None:
    """Time of an update against the number of control points, from 1 to 512, by every technique.

    Times are measured on this machine, under its present load; the paper used a GeForce GTX 780 Ti.
    """
    timings = _compute("timing; this takes some ten seconds", output, json_target, reproduce_figure_7)
    counts = sorted({timing.points for timing in timings})
    table = _table("points, time / µs", *map(str, counts))
    for name in dict.fromkeys(timing.technique for timing in timings):
        row = {timing.points: timing.seconds * 1e6 for timing in timings if timing.technique == name}
        table.add_row(name, *(_short(row[count]) for count in counts))
    machine = f"{platform.machine()}, {os.cpu_count()} cores"
    record = {"machine": machine, "timings": [asdict(timing) for timing in timings]}
    _finish(output, draw_figure_7(timings, machine), json_target, record, table, figure_7_claims(timings))


def _short(microseconds: float) -> str:
    """A time in at most four characters, thousands as k and millions as M."""
    if microseconds < 9999.5:
        return f"{microseconds:.0f}"
    return f"{microseconds / 1e3:.0f}k" if microseconds < 999.5e3 else f"{microseconds / 1e6:.1f}M"


def figure_7_claims(timings: list[Timing]) -> list[str]:
    """The paper's claims about Figure 7, and the verdicts."""
    seconds = {(timing.technique, timing.points): timing.seconds for timing in timings}
    most = max(timing.points for timing in timings)
    ratios = {count: seconds["wgs two-sided", count] / seconds["wgs", count] for count in (min(32, most), most)}
    few, many = ratios.values()
    costlier = seconds["paper", most] > seconds["min_norm", most]
    return [
        f"regularisation costs more than none: {_verdict(costlier)} for the paper's own augmented system "
        f"({seconds['paper', most] / seconds['min_norm', most]:.1f} times at {most} points); solved in the space of "
        f"the points, it costs {seconds['tikhonov', most] / seconds['min_norm', most]:.2f} times as much",
        f"two-sided takes about twice as long, less so for many points: {_verdict(1.5 < few < 3 and many < few)} "
        f"({few:.1f} times at {min(ratios)}, {many:.1f} times at {most}: both halves are one call, and two halves cost "
        "less than a large whole)",
    ]


@commands.command(name="range", epilog="Example: phasewire reproduce range --output range.pdf")
def range_command(output: OutputOption = Path("range.png"), json_target: JsonOption = None) -> None:
    """Strength and sharpness from 5 to 60 cm above the array."""
    found = _compute("computing from 5 to 60 cm", output, json_target, reproduce_range)
    table = _table("height / cm", "focus / Pa", "across / mm", "along / mm", "ring / Pa", "next to the ring / dB")
    for at in found:
        sizes = ("–" if size is None else f"{size * 1e3:.1f}" for size in (at.width, at.depth))
        table.add_row(f"{at.height * 100:.1f}", f"{at.focus:.0f}", *sizes, f"{at.ring:.0f}", f"{at.contrast:.1f}")
    _finish(
        output, draw_range(found), json_target, {"heights": [asdict(at) for at in found]}, table, range_claims(found)
    )


def range_claims(found: list[AtHeight]) -> list[str]:
    """The paper's claims about the range, and the verdicts."""
    strongest = max(found, key=lambda at: at.focus)
    inside = [at for at in found if 0.15 <= at.height <= 0.50]
    near, far = inside[0], inside[-1]
    far_off = [at for at in found if at.height >= 0.3]
    slope = np.polyfit(np.log([at.height for at in far_off]), np.log([at.focus for at in far_off]), 1)[0]
    best = 0.15 <= strongest.height <= 0.50
    return [
        f"pressure falls as the reciprocal of distance: {_verdict(abs(slope + 1) < 0.2)} (exponent {slope:.2f} from "
        "30 cm on)",
        f"best between 15 and 50 cm: {_verdict(best)} for strength, which is largest at {strongest.height * 100:.1f} "
        f"cm ({strongest.focus:.0f} Pa); within that range a focus goes from {near.focus:.0f} to {far.focus:.0f} Pa "
        f"and its width from {_mm(near.width)} to {_mm(far.width)}. A linear model knows neither saturation, which "
        "takes most near the array, nor the threshold of touch",
    ]


def _mm(length: float | None) -> str:
    return "beyond the computed range" if length is None else f"{length * 1e3:.1f} mm"


@commands.command(epilog="Example: phasewire reproduce figure4 --output figure4.svg")
def figure4(output: OutputOption = Path("figure4.png"), json_target: JsonOption = None) -> None:
    """Two-sided modulation of a square of 10 cm, beside on and off."""
    results = _compute(
        "solving the square's halves",
        output,
        json_target,
        lambda: {
            "wgs": reproduce_figure_4("wgs"),
            "wgs at full power": reproduce_figure_4("wgs", output="phase"),
            "the paper's": reproduce_figure_4("paper"),
        },
    )
    table = _table("change / Pa²", "two-sided", "one-sided", "gain", "of the weakest")
    gains = {name: result.result.gain for name, result in results.items()}
    for name, gain in gains.items():
        changes = (f"{change.mean():.3g}" for change in (gain.two_sided, gain.one_sided))
        table.add_row(name, *changes, f"{gain.mean:.2f}", f"{gain.weakest:.2f}")
    low, high = (pick(gain.mean for gain in gains.values()) for pick in (min, max))
    claims = [
        f"almost twice as powerful: {_verdict(low > 1.6)} (the change of intensity at the points grows {low:.2f} to "
        f"{high:.2f} times; the array's power grows about twice too, as it never rests)"
    ]
    record = {
        "methods": {
            name: {"gain": gain.mean, "gain_of_the_weakest": gain.weakest, "two_sided_pa2": gain.two_sided.tolist()}
            | {"one_sided_pa2": gain.one_sided.tolist()}
            for name, gain in gains.items()
        }
    }
    _finish(output, draw_figure_4(results["wgs"]), json_target, record, table, claims)
