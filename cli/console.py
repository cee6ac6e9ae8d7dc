"""Output of commands: results on standard output, everything else on standard error, JSON on request.

It also holds the shell completion of options, and whether one is given.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import typer
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table

from ..base.errors import visible
from ..base.storage import write_file

__all__ = ["JsonOption", "among", "console_for", "error_console", "given", "print_list", "write_json"]

LIST_COLUMNS = 10_000
"""Wide enough for every name and reason."""
LEAST_COLUMN, BETWEEN = 8, 3
"""Characters: the least width of a column that folds, and from one column to the next."""

JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE", help="Also write the result as JSON to FILE; - is standard output."),
]


def error_console() -> Console:
    """The console for progress and messages."""
    return _console(on_standard_error=True)


def console_for(json_target: str | None) -> Console:
    """The console for people's results: standard output, unless JSON goes there."""
    return _console(on_standard_error=json_target == "-")


class _Console(Console):
    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """All that is printed passes here, as texts and codes of this program's own."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text))

    def on_broken_pipe(self) -> None:  # rich would end the program by itself
        raise BrokenPipeError("nobody reads the output")


def _console(on_standard_error: bool) -> Console:
    # Texts contain names of files, in which [red] and :key: are not markup.
    return _Console(stderr=on_standard_error, markup=False, emoji=False, highlight=False, soft_wrap=True)


def print_list(out: Console, table: Table, *whole: str) -> None:
    """Print a table with long names: a terminal folds them, elsewhere each row is a line, to be searched.

    Parameters
    ----------
    out, table
        The console and the table.
    *whole : str
        Headers of columns whose texts people copy, such as URLs: they are never folded. A terminal that is too narrow
        for that gets a line for each cell.
    """
    needed = 1
    for column in table.columns:
        column.overflow = "fold"
        column.no_wrap = column.header in whole
        longest = max(cell_len(str(text)) for text in (column.header, *column.cells))
        needed += BETWEEN + (longest if column.no_wrap else min(longest, LEAST_COLUMN))
    if not out.is_terminal:
        out.width = LIST_COLUMNS
    elif needed > out.width:
        wide = max(cell_len(str(column.header)) for column in table.columns)
        for row in zip(*(column.cells for column in table.columns), strict=True):
            for column, text in zip(table.columns, row, strict=True):
                if str(text):
                    out.print(f"{column.header!s:{wide}}  {text}")
            out.print()
        return
    out.print(table)


def write_json(target: str | None, record: dict[str, Any]) -> None:
    """Write a record to a file, to standard output for ``-``, nowhere for None."""
    if target is None:
        return
    text = json.dumps(record, indent=2, allow_nan=False)
    if target == "-":
        typer.echo(text)
        return
    write_file(target, text + "\n")


def among(names: Iterable[str]) -> Callable[[str], list[str]]:
    """A shell's completions for an option with fixed values."""
    known = tuple(names)

    def complete(incomplete: str) -> list[str]:
        return [name for name in known if name.startswith(incomplete)]

    return complete


def given(context: typer.Context, option: str) -> bool:
    """Whether an option is on the command line. Defaults in a file apply to many commands, and may be unused here."""
    source = context.get_parameter_source(option)
    return source is not None and source.name == "COMMANDLINE"
