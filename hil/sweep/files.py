"""The file of a sweep: fixed values, designs one by one, and axes whose product is swept; every row is checked.

TOML: a field of `Design` at the top is the same in all rows. ``[[design]]`` tables, or a ``table`` that names a CSV
file, are designs one by one. Each field in ``[grid]`` is an axis: a list of values, or ``{from, to, count}``, which are
equally spaced. A row is one of the designs with one value of each axis; the last axis changes fastest. A CSV file alone
is a list of designs: its first line names fields, and an empty cell leaves a field as it is.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ...base.errors import InputFileError
from ...base.storage import FilePath, read_text, read_toml
from ...solver import ControlPoints, parse_shape, read_points
from ...solver.methods.solve import check_size
from ...solver.shapes.point_files import POINT_FILES
from ...solver.shapes.points import check_reachable
from .design import FIELDS, Design

__all__ = ["MOST_ROWS", "SWEEP_FILES", "Sweep", "read_sweep"]

MOST_ROWS = 100_000
"""Some hours on two cores."""
MOST_TABLE_BYTES = 16_000_000
MOST_PROBLEMS = 50
"""That are explained; the rows of others are named only."""
GRID, DESIGN, TABLE = "grid", "design", "table"
RANGE = {"from", "to", "count"}

Row = dict[str, object]


@dataclass(frozen=True, eq=False)
class Sweep:
    """What to measure.

    Parameters
    ----------
    designs : tuple of Design
        The rows.
    points : dict of str to ControlPoints
        The control points of each source.
    """

    designs: tuple[Design, ...]
    points: dict[str, ControlPoints]

    def __repr__(self) -> str:
        return f"Sweep({len(self)} designs, swept: {', '.join(self.swept) or 'nothing'})"

    def __len__(self) -> int:
        return len(self.designs)

    @property
    def swept(self) -> tuple[str, ...]:
        """The fields that differ between rows."""
        return tuple(name for name, values in self.columns().items() if len(set(values)) > 1)

    def columns(self) -> dict[str, list[Any]]:
        """The values of each field in all rows."""
        return {name: [getattr(design, name) for design in self.designs] for name in FIELDS}

    def fingerprint(self, version: str) -> str:
        """A hexadecimal number that differs for other rows, other points, or another version of phasewire."""
        digest = sha256(version.encode())
        for source, points in sorted(self.points.items()):
            digest.update(repr((source, points.positions.tolist(), points.amplitudes.tolist())).encode())
        for design in self.designs:
            digest.update(repr(design).encode())
        return digest.hexdigest()


def read_sweep(path: FilePath) -> Sweep:
    """Read a sweep, and check all of its rows.

    Parameters
    ----------
    path : str or Path
        A .toml or .csv file. Files of points and tables that it names are searched in its folder.

    Raises
    ------
    InputFileError
        If it is not readable as such, or rows cannot be computed: all of them are named, each with what would be right.
    OSError
        If it cannot be opened.
    """
    path = Path(path)
    if path.suffix.lower() not in SWEEP_FILES:
        raise InputFileError(f"{path}: a sweep is read from a {' or '.join(SWEEP_FILES)} file")
    try:
        rows = SWEEP_FILES[path.suffix.lower()](path)
    except InputFileError:
        raise
    except (ValueError, csv.Error) as error:
        raise InputFileError(f"{path}: {error}") from error
    checker = _Checker(path.parent)
    for number, row in enumerate(rows):
        checker.check(number, row)
    if checker.wrong:
        count = sum(map(len, checker.wrong.values()))
        problems = list(checker.wrong.items())
        lines = [f"{_numbered(numbers)}: {problem}" for problem, numbers in problems[:MOST_PROBLEMS]]
        if rest := sorted(number for _, numbers in problems[MOST_PROBLEMS:] for number in numbers):
            lines.append(f"{_numbered(rest)}: similar problems")
        raise InputFileError("\n  ".join([f"{path}: {count} of {len(rows)} rows cannot be computed", *lines]))
    return Sweep(tuple(checker.designs), checker.points)


class _Checker:
    """Turns rows into designs that can be computed, and collects what is wrong with the others."""

    def __init__(self, folder: Path) -> None:
        self.designs: list[Design] = []
        self.points: dict[str, ControlPoints] = {}
        self.wrong: defaultdict[str, list[int]] = defaultdict(list)
        self._folder = folder
        self._known: dict[tuple[object, ...], str | None] = {}

    def check(self, number: int, row: Row) -> None:
        try:
            design = Design.read(row)
            problem = self._unsolvable(design)
        except ValueError as error:
            problem = str(error)
        if problem is None:
            self.designs.append(design)
        else:
            self.wrong[problem].append(number)

    def _unsolvable(self, design: Design) -> str | None:
        """Why its points cannot be solved for; judged once for all designs with the same array, points and method."""
        key = (design.source, design.columns, design.rows, design.pitch_mm, design.model, design.method)
        if key not in self._known:
            try:
                points = self._read(design.source)
                check_size(design.array(), points, design.method)
                check_reachable(design.array(), points)
                self._known[key] = None
            except (ValueError, OSError) as error:
                self._known[key] = f"source {design.source!r}: {error}"
        return self._known[key]

    def _read(self, source: str) -> ControlPoints:
        if source not in self.points:
            is_file = Path(source).suffix.lower() in POINT_FILES and ":" not in source
            self.points[source] = read_points(self._folder / source) if is_file else parse_shape(source).sample()
        return self.points[source]


def _numbered(numbers: Sequence[int]) -> str:
    """Numbers of rows, neighbours as a range."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    said = ", ".join(f"{first}" if first == last else f"{first} to {last}" for first, last in runs)
    return f"row {said}" if len(numbers) == 1 else f"rows {said}"


def _read_table(path: Path) -> list[Row]:
    lines = [
        (number, [cell.strip() for cell in cells])
        for number, cells in enumerate(csv.reader(read_text(path, MOST_TABLE_BYTES).splitlines()), start=1)
        if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#")
    ]
    if len(lines) < 2:
        raise ValueError("it has no designs; after a line with names of fields comes a line for each")
    number, names = lines[0]
    for name in names:
        if name not in FIELDS:
            raise ValueError(f"line {number}: there is no field {name!r}; the fields are {', '.join(FIELDS)}")
        if names.count(name) > 1:
            raise ValueError(f"line {number} names {name} twice")
    for number, cells in lines[1:]:
        if len(cells) != len(names):
            raise ValueError(f"line {number} has {len(cells)} cells; it must have {len(names)}: {','.join(names)}")
    _check_count(len(lines) - 1)
    return [{name: cell for name, cell in zip(names, cells, strict=True) if cell} for _, cells in lines[1:]]


def _read_toml(path: Path) -> list[Row]:
    content = read_toml(path)
    for name in content:
        if name not in (*FIELDS, GRID, DESIGN, TABLE):
            known = ", ".join((GRID, DESIGN, TABLE, *FIELDS))
            raise ValueError(f"there is no field {name!r}; the fields are {known}")
    axes = _axes(content.get(GRID, {}))
    designs = _designs(content, path.parent)
    _check_count(len(designs) * math.prod(len(values) for values in axes.values()))
    fixed = {name: value for name, value in content.items() if name in FIELDS}
    _check_apart({"the top": fixed, f"[{GRID}]": axes, "the designs": {name for row in designs for name in row}})
    combined = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    return [fixed | design | values for design in designs for values in combined]


def _designs(content: Mapping[str, Any], folder: Path) -> list[Row]:
    """The designs that are given one by one; an empty one if there are none."""
    if TABLE in content:
        if DESIGN in content:
            raise ValueError(f"{TABLE} and [[{DESIGN}]] exclude each other; give one of them")
        name = content[TABLE]
        if not isinstance(name, str) or Path(name).suffix.lower() != ".csv":
            raise ValueError(f"{TABLE} is {name!r}; it must be the name of a .csv file")
        try:
            return _read_table(folder / name)
        except OSError as error:
            raise ValueError(f"{TABLE} {name!r} cannot be read: {error.strerror}") from error
    designs = content.get(DESIGN, [{}])
    if not isinstance(designs, list) or not designs or not all(isinstance(each, dict) for each in designs):
        raise ValueError(f"{DESIGN} must be a list of tables, each of which begins with [[{DESIGN}]]")
    return designs


def _axes(grid: object) -> dict[str, list[object]]:
    """The values of each axis."""
    if not isinstance(grid, dict):
        raise ValueError(f"{GRID} must be a table, which begins with [{GRID}]")
    return {name: _axis(name, values) for name, values in grid.items()}


def _axis(name: str, values: Any) -> list[object]:
    if isinstance(values, list) and values:
        return values
    if not isinstance(values, dict) or values.keys() != RANGE:
        raise ValueError(f"the axis {name} must be a list of values, or such as {{from = 8, to = 12, count = 5}}")
    first, last, count = values["from"], values["to"], values["count"]
    if type(count) is not int or not 2 <= count <= MOST_ROWS:
        raise ValueError(f"the axis {name} has count {count!r}; it must be a whole number from 2 to {MOST_ROWS}")
    for end in (first, last):
        if isinstance(end, bool) or not isinstance(end, (int, float)) or not abs(end) < 1e12:
            raise ValueError(f"the axis {name} goes from {first!r} to {last!r}; both must be finite numbers")
    return [float(value) for value in np.linspace(first, last, count)]


def _check_count(rows: int) -> None:
    if rows > MOST_ROWS:
        raise ValueError(f"it has {rows} rows; at most {MOST_ROWS} can be swept at once")


def _check_apart(places: Mapping[str, Iterable[str]]) -> None:
    """Raise `ValueError` if a field is given at two places."""
    seen: dict[str, str] = {}
    for place, names in places.items():
        for name in names:
            if name in seen:
                raise ValueError(f"{name} is given at {seen[name]} and in {place}; give it once")
            seen[name] = place


SWEEP_FILES = {".toml": _read_toml, ".csv": _read_table}
"""Readers of sweeps by the suffix of a file's name."""
