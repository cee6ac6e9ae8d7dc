"""Text files of numbers: rows of cells with a fixed set of columns, and hints on what a wrong one meant."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence

from ..base.arguments import spelt

__all__ = ["csv_rows", "text_rows"]

_OTHER_UNIT = re.compile(r"[\W_](mm|cm|um|µm|in|inch|inches)\W*$", re.IGNORECASE)
_METRES = re.compile(r"[\W_]+m\W*$")


def csv_rows(text: str, forms: Sequence[str]) -> list[list[float]]:
    """The numbers in each line of a CSV file, in the order of its form; ``forms`` are those allowed, such as ``x,y,z``.

    A first line without any number has the names of the columns, in any order; without it they are in the order of the
    form. Empty lines and those that begin with ``#`` are skipped.

    `ValueError` if a line has another form than one of these, or than the first, or the names are others or state
    another unit than metres; `csv.Error` if the file is no CSV.
    """
    return _rows(csv.reader(text.splitlines()), forms, ",")


def text_rows(text: str, forms: Sequence[str]) -> list[list[float]]:
    """The numbers in each line of a file with white space between them; what follows a ``#`` is skipped.

    Parameters and errors are those of `csv_rows`.
    """
    return _rows((line.partition("#")[0].split() for line in text.splitlines()), forms, " ")


def _rows(lines: Iterable[list[str]], forms: Sequence[str], separator: str) -> list[list[float]]:
    lengths = [form.count(",") + 1 for form in forms]
    written = " or ".join(form.replace(",", separator) for form in forms)
    rows: list[list[float]] = []
    order: Sequence[int] | None = None
    for number, cells in enumerate(lines, start=1):
        if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
            continue
        row = [value for cell in cells if (value := _number(cell)) is not None]
        if order is None and len(cells) in lengths and not row:
            order = _order_of(number, cells, forms)
            continue
        if len(row) != len(cells) or len(row) not in lengths:
            line = separator.join(cells)
            raise ValueError(f"line {number}: {line!r} is not {written} in numbers{_hint(line, separator)}")
        order = range(len(row)) if order is None else order
        if len(row) != len(order):
            raise ValueError(f"line {number} has {len(row)} numbers, but the lines before it have {len(order)}")
        rows.append([row[column] for column in order])
    return rows


def _order_of(number: int, names: Iterable[str], forms: Sequence[str]) -> list[int]:
    """The column of each name of a form, from the line of names."""
    for name in names:
        if unit := _OTHER_UNIT.search(name.strip()):
            raise ValueError(
                f"line {number}: the column {name.strip()!r} is in {unit[1]}; coordinates must be in metres, "
                "so convert them and call the columns x, y and z"
            )
    plain = [_METRES.sub("", name.strip()).lower() for name in names]
    for form in (form.split(",") for form in forms):
        if sorted(form) == sorted(plain):
            return [plain.index(name) for name in form]
    raise ValueError(
        f"line {number}: the columns are {', '.join(plain)}; they must be {' or '.join(forms)}, in any order"
    )


def _hint(line: str, separator: str) -> str:
    if separator == "," and ";" in line:
        return "; write commas between the numbers, not semicolons, and points in them, as in 0.02,0,0.2"
    return ""


def _number(text: str) -> float | None:
    try:
        return spelt(text.strip())
    except ValueError:
        return None
