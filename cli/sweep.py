"""The command that measures many designs of an array: ``sweep``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Column, Table

from ..base.pictures import check_picture_path, save_figure
from ..base.storage import check_outputs
from ..hil.sweep.crews import CREWS, Crew
from ..hil.sweep.design import FIELDS
from ..hil.sweep.files import SWEEP_FILES, read_sweep
from ..hil.sweep.journal import journal_path
from ..hil.sweep.measures import MEASURE_UNITS, MEASURES
from ..hil.sweep.picture import draw_sweep, drawn_fields
from ..hil.sweep.results import Results, read_results
from ..hil.sweep.running import run_sweep
from .console import JsonOption, among, console_for, error_console, write_json

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

SHOWN_PROBLEMS = 5


@commands.command(
    epilog="Example: phasewire sweep examples/sweeps/paper_array.toml -o paper_array.parquet --plot paper_array.png",
    help=f"""Measure many designs of an array: strength, spread, ghosts and audible level of each.

FILE is a .toml file of fixed values, designs and axes, or a .csv file of designs (docs/how-to/sweeps.md). A design has
the fields {", ".join(FIELDS)}. All rows are checked before the first is measured.

The output is a Parquet file, with the same bytes whoever measured the rows. If the sweep is interrupted or killed, the
same command goes on from the rows that are done.""",
)
def sweep(
    file: Annotated[Path, typer.Argument(metavar="FILE", help=f"What to sweep: {', '.join(SWEEP_FILES)}.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The .parquet file to write.")],
    on: Annotated[
        str,
        typer.Option(
            metavar="CREW",
            help=f"Who measures: {', '.join(CREWS)}, or the address of a scheduler of Dask, such as tcp://HOST:8786.",
            autocompletion=among(CREWS),
        ),
    ] = "processes",
    workers: Annotated[
        int | None, typer.Option(help="How many threads or processes; by default as many as cores.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where to draw each measure over each swept field: .png, .svg or .pdf."),
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Measure many designs (the help text above is built from the fields)."""
    if output.suffix.lower() != ".parquet":
        raise ValueError(f"{output}: the name of a sweep's results ends in .parquet")
    check_outputs([output, plot, json_target], inputs=[file])
    if plot is not None:
        check_picture_path(plot)
    designs, started = read_sweep(file), perf_counter()
    if plot is not None:
        drawn_fields(designs.columns())
    console, out = error_console(), console_for(json_target)
    links: list[str | None] = []

    def begin(crew: Crew) -> None:
        links.append(crew.link)
        if crew.link is not None:
            console.print(f"Dask shows the workers at {crew.link}")

    try:
        with _progress(console, len(designs)) as move:
            run = run_sweep(designs, output, on=on, workers=workers, on_begin=begin, on_row=move)
    except BaseException:
        if links and journal_path(output).exists():
            console.print(f"The rows that are done are in {journal_path(output)}; the same command goes on from there.")
        raise
    results = read_results(output)
    seconds = perf_counter() - started
    out.print(_table(results))
    for row, problem in list(results.problems.items())[:SHOWN_PROBLEMS]:
        console.print(f"row {row} has no measures: {problem}", style="yellow")
    if (more := len(results.problems) - SHOWN_PROBLEMS) > 0:
        console.print(f"{more} more rows have no measures; the column problem says why", style="yellow")
    if plot is not None:
        save_figure(draw_sweep(results, file.stem), plot)
        console.print(f"Drawn to {plot}")
    out.print(
        f"{output} has {len(designs)} rows: {run.measured} measured in {seconds:.1f} s, {run.kept} of an earlier run."
    )
    write_json(
        json_target,
        {
            "format": "phasewire-sweep-1",
            "file": str(output),
            "rows": len(designs),
            "swept": list(designs.swept),
            "measured": run.measured,
            "kept": run.kept,
            "on": on,
            "workers": run.workers,
            "dashboard": next(iter(links), None),
            "seconds": seconds,
            "measures": _summary(results),
            "problems": {str(row): problem for row, problem in results.problems.items()},
        },
    )


@contextmanager
def _progress(console: Console, rows: int) -> Iterator[Callable[[int, int], None]]:
    """A bar on a terminal; elsewhere nothing."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(bar_width=24), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("sweeping", total=rows)
        yield lambda done, _total: bar.update(task, completed=done)


def _summary(results: Results) -> dict[str, dict[str, float] | None]:
    """The least value of each measure, the median and the largest; None if no row has it."""
    found: dict[str, dict[str, float] | None] = {}
    for name in MEASURES:
        values = results.numbers(name)
        values = values[~np.isnan(values)]
        found[name] = (
            {"least": float(values.min()), "median": float(np.median(values)), "largest": float(values.max())}
            if len(values)
            else None
        )
    return found


def _table(results: Results) -> Table:
    table = Table("measure", *(Column(name, justify="right") for name in ("least", "median", "largest")))
    for name, values in _summary(results).items():
        unit = f" / {MEASURE_UNITS[name]}" if name in MEASURE_UNITS else ""
        shown = ["–"] * 3 if values is None else [f"{value:.4g}" for value in values.values()]
        table.add_row(f"{name.partition('_')[0]}{unit}", *shown)
    return table
