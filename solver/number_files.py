"""Text files of numbers: rows of cells with a fixed set of columns, and hints on what a wrong one meant."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence

__all__ = ["csv_rows", "text_rows"]

_OTHER_UNIT = re.compile(r"[\W_](mm|cm|um|µm|in|inch|inches)\W*$", re.IGNORECASE)


def csv_rows(text: str, forms: Sequence[str]) -> list[list[float]]:
    """The numbers in each line of a CSV file.

    A first line without any number is taken for names; empty lines and those that begin with ``#`` are skipped.

    Parameters
    ----------
    text : str
        The whole file.
    forms : sequence of str
        The names of the columns in each allowed form, such as ``x,y,z``.

    Raises
    ------
    ValueError
        If a line has another form than one of these, or than the first, or the names state another unit than metres.
    csv.Error
        If the file is no CSV.
    """
    return _rows(csv.reader(text.splitlines()), forms, ",")


def text_rows(text: str, forms: Sequence[str]) -> list[list[float]]:
    """The numbers in each line of a file with white space between them; what follows a ``#`` is skipped.

    Parameters and errors are those of `csv_rows`.
    """
    return _rows((line.partition("#")[0].split() for line in text.splitlines()), forms, " ")


def _rows(lines: Iterable[list[str]], forms: Sequence[str], separator: str) -> list[list[float]]:
    lengths = [form.count(",") + 1 for form in forms]
    rows: list[list[float]] = []
    names_may_come = True
    for number, cells in enumerate(lines, start=1):
        if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
            continue
        numbers = [_number(cell) for cell in cells]
        if names_may_come and len(cells) in lengths and not any(value is not None for value in numbers):
            names_may_come = False
            _check_names(number, cells)
            continue
        names_may_come = False
        row = [value for value in numbers if value is not None]
        if len(row) != len(cells) or len(row) not in lengths:
            written = " or ".join(form.replace(",", separator) for form in forms)
            line = separator.join(cells)
            raise ValueError(f"line {number}: {line!r} is not {written} in numbers{_hint(line, separator)}")
        if rows and len(row) != len(rows[0]):
            raise ValueError(f"line {number} has {len(row)} numbers, but the lines before it have {len(rows[0])}")
        rows.append(row)
    return rows


def _check_names(number: int, names: Iterable[str]) -> None:
    for name in names:
        if unit := _OTHER_UNIT.search(name.strip()):
            raise ValueError(
                f"line {number}: the column {name.strip()!r} is in {unit[1]}; coordinates must be in metres, "
                "so convert them and call the columns x, y and z"
            )


def _hint(line: str, separator: str) -> str:
    if separator == "," and ";" in line:
        return "; write commas between the numbers, not semicolons, and points in them, as in 0.02,0,0.2"
    return ""


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
