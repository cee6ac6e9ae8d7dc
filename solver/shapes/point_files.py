"""Files of control points: CSV, JSON and plain text."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from ...base.errors import InputFileError
from ...base.storage import FilePath, read_text
from ..number_files import csv_rows, text_rows
from .points import ControlPoints

__all__ = ["POINT_FILES", "read_points"]

MOST_POINT_BYTES = 4_000_000
"""A hundred thousand points, far more than any solver takes."""
FORMS = ("x,y,z", "x,y,z,amplitude")


def read_points(path: FilePath) -> ControlPoints:
    """Read control points from a CSV, JSON or plain text file, by the suffix of its name.

    CSV: a line per point, ``x,y,z`` or ``x,y,z,amplitude`` in metres; a first line with these names may put the columns
    in any order, and empty lines and those that begin with ``#`` are skipped.
    Plain text (``.txt``, ``.xyz``): the same with white space between the numbers; what follows a ``#`` is skipped.
    JSON: ``{"positions": [[x, y, z], …], "amplitudes": […]}``; the amplitudes are optional.

    Raises
    ------
    InputFileError
        If the file is not readable as such; the error names the line.
    OSError
        If it cannot be opened.
    """
    path = Path(path)
    if path.suffix.lower() not in POINT_FILES:
        raise InputFileError(f"{path}: control points are read from {' or '.join(POINT_FILES)} files")
    text = read_text(path, MOST_POINT_BYTES)
    try:
        positions, amplitudes = POINT_FILES[path.suffix.lower()](text)
        return ControlPoints(positions, amplitudes)
    except (ValueError, TypeError, OverflowError, RecursionError, csv.Error) as error:
        raise InputFileError(f"{path}: {error}") from error


def _read_csv(text: str) -> tuple[list[list[float]], list[float] | None]:
    return _points(csv_rows(text, FORMS))


def _read_text(text: str) -> tuple[list[list[float]], list[float] | None]:
    return _points(text_rows(text, FORMS))


def _points(rows: list[list[float]]) -> tuple[list[list[float]], list[float] | None]:
    """Positions, and amplitudes if there are four columns."""
    if not rows:
        raise ValueError("there are no control points in it")
    return [row[:3] for row in rows], [row[3] for row in rows] if len(rows[0]) == 4 else None


def _read_json(text: str) -> tuple[Any, Any]:
    record = json.loads(text)
    if not isinstance(record, dict) or "positions" not in record:
        raise ValueError('it must be an object with "positions": [[x, y, z], …] and, if wanted, "amplitudes": […]')
    if unknown := sorted(set(record) - {"positions", "amplitudes"}):
        raise ValueError(f"unknown entry {unknown[0]!r}; known are positions and amplitudes")
    return record["positions"], record.get("amplitudes")


POINT_FILES = {".csv": _read_csv, ".json": _read_json, ".txt": _read_text, ".xyz": _read_text}
"""Readers of control points by the suffix of a file's name."""
