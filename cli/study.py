"""The command that simulates the paper's user study: ``study``."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Column, Table

from ..base.pictures import check_picture_path, save_figure
from ..base.storage import check_outputs
from ..hil.study.judging import PAPER_TRIALS, TABLE_1, chance_at_most
from ..hil.study.picture import draw_study
from ..hil.study.pointer import HAJAS
from ..hil.study.running import PERSONS, REPEATS, SECONDS, SEED, Study, run_study
from .console import JsonOption, console_for, error_console, write_json

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

SURE = 0.999
"""A control that guesses fails so seldom: once in a thousand studies."""
MOST_PERSONS, MOST_REPEATS, MOST_SECONDS = 1000, 100, 10
MOST_PROCESSES = 4
"""Each takes 1 GB for an exploration of 3 s."""


@commands.command(epilog="Example: phasewire study --persons 6 --trials 1 --json study.json")
def study(
    persons: Annotated[int, typer.Option(min=2, max=MOST_PERSONS, help="How many persons explore.")] = PERSONS,
    trials: Annotated[
        int, typer.Option(min=1, max=MOST_REPEATS, help="How often each explores each of the six objects.")
    ] = REPEATS,
    seconds: Annotated[
        float, typer.Option(min=0.5, max=MOST_SECONDS, help="How long an exploration is, in s.")
    ] = SECONDS,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Of persons, paths and errors: the same gives the same.")
    ] = SEED,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="The .png, .svg or .pdf file to draw.")
    ] = Path("study.png"),
    json_target: JsonOption = None,
) -> None:
    """Simulate the paper's user study: hands explore objects, and a classifier answers.

    Each trial goes the whole way: hands, control points, fields, an emulated device, its bits, the motion of the skin,
    the thresholds of touch, and a person's errors. The classifier is tested on persons that it was not trained on. A
    second experiment compares the static outline of flat shapes with a moving pointer.

    By default it takes a few minutes. It says what such judges can tell apart, not what people feel.

    The exit code is 1 if a judge does better than chance with the field off, or on shuffled labels: then the study
    itself is wrong.
    """
    check_picture_path(output)
    check_outputs([output, json_target])
    out, started = console_for(json_target), perf_counter()
    with _progress(error_console()) as on_trial:
        found = run_study(
            persons,
            trials,
            seed,
            seconds=seconds,
            processes=min(os.cpu_count() or 1, MOST_PROCESSES),
            on_trial=on_trial,
        )
    save_figure(draw_study(found), output)
    _tell(out, found)
    limit = chance_at_most(int(found.silent.counts.sum()), len(found.silent.answers), SURE)
    sound = max(found.silent.accuracy, found.shuffled.accuracy) <= limit
    verdict = "Both controls are" if sound else "NOT SOUND: a control is not"
    out.print(f"{verdict} at chance, at most {limit:.0%} by guessing in {SURE:.1%} of such studies.")
    out.print(f"Drawn to {output} ({perf_counter() - started:.0f} s).")
    options = {"persons": persons, "trials": trials, "seconds": seconds, "seed": seed}
    told = {"format": "phasewire-study-1", "options": options, "controls_at_chance": sound}
    write_json(json_target, told | found.record())
    if not sound:
        raise typer.Exit(1)


@contextmanager
def _progress(console: Console) -> Iterator[Callable[[int, int], None]]:
    """A bar on a terminal; elsewhere nothing."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(bar_width=24), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("exploring", total=None)

        def move(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, description="judging" if done == total else "exploring")

        yield move


def _tell(out: Console, found: Study) -> None:
    numbers = [Column(_short(answer), justify="right", no_wrap=True) for answer in found.felt.answers]
    table = Table("explored", *numbers, Column("right", justify="right"), Column("people", justify="right"))
    shares = found.felt.by_shape()
    for shape, counts in zip(found.felt.shapes, found.felt.counts.tolist(), strict=True):
        share, error = shares[shape]
        people = f"{TABLE_1[shape][shape] / PAPER_TRIALS:.0%}"
        table.add_row(_short(shape), *map(str, counts), f"{share:.0%} ± {error:.0%}", people)
    out.print("Answers, by what was explored:")
    out.print(table)
    right = sum(row[shape] for shape, row in TABLE_1.items())
    asked = PAPER_TRIALS * len(TABLE_1)
    out.print(
        f"Right: {found.felt.accuracy:.0%} ± {found.felt.error:.0%}; people in the paper {right / asked:.0%}. "
        f"If the cone may be answered too: {found.with_cone.accuracy:.0%}."
    )
    out.print(f"Field off: {found.silent.accuracy:.0%}. Shuffled labels: {found.shuffled.accuracy:.0%}.")
    for judge, both in found.pointer.items():
        ordering = "pointer better than outline" if both.better > 2 * both.error else "NOT told apart or reversed"
        out.print(
            f"Flat shapes, judge taught by {judge}: static outline {both.outline.accuracy:.0%}, moving pointer "
            f"{both.pointer.accuracy:.0%}: {ordering}; people {HAJAS['outline']:.0%} and {HAJAS['pointer']:.0%}."
        )


def _short(shape: str) -> str:
    return shape.replace("horizontal_prism", "lying").replace("vertical_prism", "upright")
