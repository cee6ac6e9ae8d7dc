"""Files of arrays: CSV of positions and normals, and TOML of panels."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputFileError
from ...storage import FilePath, read_text, read_toml
from ..number_files import csv_rows
from ..placement import PLACEMENT_KEYS, read_placement, table_numbers
from .array import TransducerArray
from .transducer import TRANSDUCERS, Transducer

__all__ = ["ARRAY_FILES", "read_transducers"]

MOST_CSV_BYTES = 16_000_000
"""A hundred thousand transducers with normals."""
FORMS = ("x,y,z", "x,y,z,nx,ny,nz")
UP = [0.0, 0.0, 1.0]
PANELS, PART, NAME, FILE = "panel", "transducer", "name", "file"
PITCHES = ("pitch_m", "pitch_mm")
GRID = ("columns", "rows", *PITCHES)


def read_transducers(path: FilePath) -> TransducerArray:
    """Read an array from a CSV or TOML file, by the suffix of its name; docs/how-to/any-array.md describes them.

    CSV: a line per transducer, ``x,y,z`` or ``x,y,z,nx,ny,nz``: its position in metres, and the direction in which it
    looks, of any length; without one, it looks up. A first line with these names may put the columns in any order.
    TOML: a list ``[[panel]]`` of grids, or of CSV files, each with its placement; and what each ``[transducer]`` is.

    The order of the file is the order of the channels.

    Raises
    ------
    InputFileError
        If the file is not readable as such; the error names the line or the field.
    OSError
        If it cannot be opened.
    """
    path = Path(path)
    if path.suffix.lower() not in ARRAY_FILES:
        raise InputFileError(f"{path}: an array is read from a {' or '.join(ARRAY_FILES)} file")
    return ARRAY_FILES[path.suffix.lower()](path)


def _read_csv(path: Path) -> TransducerArray:
    text = read_text(path, MOST_CSV_BYTES)
    try:
        rows = csv_rows(text, FORMS)
        if not rows:
            raise ValueError("there are no transducers in it")
        table = np.array(rows)
        positions, normals = table[:, :3], table[:, 3:] if table.shape[1] == 6 else np.tile(UP, (len(table), 1))
        lengths = np.linalg.norm(normals, axis=1)
        if (bad := np.flatnonzero(~((lengths > 0) & (lengths < np.inf)))).size:
            raise ValueError(
                f"the normal of transducer {bad[0]} is {normals[bad[0]].tolist()}; it must have a direction"
            )
        return TransducerArray(positions, normals / lengths[:, None])
    except (ValueError, csv.Error) as error:
        raise InputFileError(f"{path}: {error}") from error


def _read_panels(path: Path) -> TransducerArray:
    content = read_toml(path)
    try:
        _check_keys(content, (PANELS, PART))
        entries = content.get(PANELS)
        if not isinstance(entries, list) or not entries:
            raise ValueError(f"it has no panels; each begins with [[{PANELS}]]")
        part = _part(content.get(PART, {}))
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error
    panels = []
    for number, entry in enumerate(entries, start=1):
        try:
            panels.append(_panel(entry, part, path.parent))
        except ValueError as error:
            raise InputFileError(f"{path}, panel {number}: {error}") from error
    try:
        return TransducerArray.joined(panels)
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error


def _part(values: Any) -> Transducer:
    """The transducer of a table: one with a published strength, and what differs from it."""
    if not isinstance(values, dict):
        raise ValueError(f"{PART} is {values!r}; it must be a table, which begins with [{PART}]")
    known = {field.name: str if field.name in ("model", "source") else float for field in fields(Transducer)}
    del known["aperture"]
    _check_keys(values, (NAME, *known))
    name = values.get(NAME, "MA40S4S")
    if name not in TRANSDUCERS:
        raise ValueError(f"unknown {PART} {name!r}; known are {', '.join(TRANSDUCERS)}")
    changed = {key: value for key, value in values.items() if key != NAME}
    for key, value in changed.items():
        if isinstance(value, bool) or not isinstance(value, (int, float) if known[key] is float else str):
            kind = "a number" if known[key] is float else "text"
            raise ValueError(f"{PART} {key} is {value!r}; it must be {kind}")
    return replace(TRANSDUCERS[name], **changed)


def _panel(entry: Any, part: Transducer, folder: Path) -> TransducerArray:
    if not isinstance(entry, dict):
        raise ValueError(f"{entry!r} is no table; each panel begins with [[{PANELS}]]")
    if FILE in entry:
        _check_keys(entry, (FILE, *PLACEMENT_KEYS))
        if not isinstance(entry[FILE], str) or Path(entry[FILE]).suffix.lower() != ".csv":
            raise ValueError(f"{FILE} is {entry[FILE]!r}; it must be the name of a .csv file")
        try:
            read = _read_csv(folder / entry[FILE])
        except OSError as error:
            raise ValueError(f"{FILE} {entry[FILE]!r} cannot be read: {error.strerror}") from error
        panel = TransducerArray(read.positions, read.normals, part)
    else:
        _check_keys(entry, (*GRID, *PLACEMENT_KEYS))
        if all(key in entry for key in PITCHES):
            raise ValueError(f"{' and '.join(PITCHES)} exclude each other; give one of them")
        for key in ("columns", "rows"):
            if not isinstance(entry.get(key), int) or isinstance(entry[key], bool):
                raise ValueError(f"{key} is {entry.get(key)!r}; it must be a whole number")
        if not any(key in entry for key in PITCHES):
            raise ValueError("it has no pitch; give pitch_mm, such as 10.3, or pitch_m")
        metres = float(table_numbers(entry, "pitch_mm", ())) * 1e-3 if "pitch_mm" in entry else None
        pitch = float(table_numbers(entry, "pitch_m", ())) if metres is None else metres
        panel = TransducerArray.grid(entry["columns"], entry["rows"], pitch, part)
    return panel.placed(*read_placement(entry))


def _check_keys(table: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            raise ValueError(f"there is no field {key!r}; the fields are {', '.join(known)}")


ARRAY_FILES = {".csv": _read_csv, ".toml": _read_panels}
"""Readers of arrays by the suffix of a file's name."""
