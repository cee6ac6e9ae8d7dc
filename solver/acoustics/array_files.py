"""Files of arrays: CSV of positions and normals, and TOML of panels, or of devices that have panels.

A file of devices also says how each is reached. `read_devices` hands that on as it stands, to a host.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import InputFileError
from ...base.storage import FilePath, read_text, read_toml
from ..number_files import csv_rows
from ..placement import PLACEMENT_KEYS, read_placement, table_numbers
from .array import TransducerArray
from .transducer import TRANSDUCERS, Transducer

__all__ = ["ARRAY_FILES", "DEVICE", "DEVICE_FIELDS", "PlacedDevice", "read_devices", "read_transducers"]

MOST_CSV_BYTES = 16_000_000
"""A hundred thousand transducers with normals."""
FORMS = ("x,y,z", "x,y,z,nx,ny,nz")
UP = [0.0, 0.0, 1.0]
DEVICE, PANELS, PART, NAME, FILE = "device", "panel", "transducer", "name", "file"
PITCHES = ("pitch_m", "pitch_mm")
GRID = ("columns", "rows", *PITCHES)
DEVICE_FIELDS = ("url", NAME, "calibration", "channels")
"""The fields of a device that say nothing about its transducers' places."""


class PlacedDevice(NamedTuple):
    """A device in a file: its transducers in place, and the fields `DEVICE_FIELDS` as far as they are given."""

    array: TransducerArray
    fields: Mapping[str, Any]


def read_transducers(path: FilePath) -> TransducerArray:
    """Read an array from a CSV or TOML file, by the suffix of its name; docs/how-to/any-array.md describes them.

    CSV: a line per transducer, ``x,y,z`` or ``x,y,z,nx,ny,nz``: its position in metres, and the direction in which it
    looks, of any length; without one, it looks up. A first line with these names may put the columns in any order.
    TOML: a list ``[[panel]]`` of grids, or of CSV files, each with its placement; or a list ``[[device]]`` of devices
    with such panels; and what each ``[transducer]`` is.

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


def read_devices(path: FilePath) -> list[PlacedDevice]:
    """Read the devices of a TOML file, a list ``[[device]]``; docs/how-to/rigs.md describes it.

    A device has its own ``[[device.panel]]``, or the fields of its only panel; without any, it is a grid of 20 × 16.
    Its placement moves it as a whole.

    `InputFileError` if the file is not readable as such, or has no devices; the error names the device, the panel and
    the field. `OSError` if it cannot be opened.
    """
    path = Path(path)
    content = read_toml(path)
    if DEVICE not in content:
        raise InputFileError(f"{path}: it has no devices; each begins with [[{DEVICE}]]")
    return [
        PlacedDevice(array, {key: entry[key] for key in DEVICE_FIELDS if key in entry})
        for array, entry in _entries(content, path)
    ]


def _read_toml(path: Path) -> TransducerArray:
    arrays = [array for array, _ in _entries(read_toml(path), path)]
    try:
        return TransducerArray.joined(arrays)
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error


def _entries(content: dict[str, Any], path: Path) -> list[tuple[TransducerArray, dict[str, Any]]]:
    """The panels of a file, or else its devices: each placed, and its table."""
    try:
        _check_keys(content, (PANELS, DEVICE, PART))
        if PANELS in content and DEVICE in content:
            raise ValueError(f"[[{PANELS}]] and [[{DEVICE}]] exclude each other; a device's panel is [[device.panel]]")
        kind, read = (DEVICE, _device) if DEVICE in content else (PANELS, _panel)
        tables = _tables(content, kind, f"[[{kind}]]")
        part = _part(content.get(PART, {}))
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error
    entries = []
    for number, table in enumerate(tables, start=1):
        try:
            entries.append((read(table, part, path.parent), table))
        except ValueError as error:
            raise InputFileError(f"{path}, {kind} {number}: {error}") from error
    return entries


def _tables(table: Mapping[str, Any], key: str, begins: str) -> list[dict[str, Any]]:
    """A list of tables, at least one."""
    tables = table.get(key)
    if not isinstance(tables, list) or not tables:
        raise ValueError(f"it has no {key}s; each begins with {begins}")
    for each in tables:
        if not isinstance(each, dict):
            raise ValueError(f"{each!r} is no table; each {key} begins with {begins}")
    return tables


def _device(entry: dict[str, Any], part: Transducer, folder: Path) -> TransducerArray:
    """The transducers of a device, in place."""
    _check_keys(entry, (*DEVICE_FIELDS, PANELS, FILE, *GRID, *PLACEMENT_KEYS))
    places = {key: value for key, value in entry.items() if key not in DEVICE_FIELDS}
    if PANELS in entry:
        if alone := [key for key in places if key in (FILE, *GRID)]:
            raise ValueError(f"{alone[0]} and [[{DEVICE}.{PANELS}]] exclude each other; give one of them")
        panels = []
        for number, panel in enumerate(_tables(entry, PANELS, f"[[{DEVICE}.{PANELS}]]"), start=1):
            try:
                panels.append(_panel(panel, part, folder))
            except ValueError as error:
                raise ValueError(f"{PANELS} {number}: {error}") from error
        array = TransducerArray.joined(panels)
    elif any(key in places for key in (FILE, *GRID)):
        return _panel(places, part, folder)
    else:
        array = TransducerArray.grid(transducer=part)
    return array.placed(*read_placement(entry))


def _part(values: Any) -> Transducer:
    """The transducer of a table: one with a published strength, and what differs from it."""
    if not isinstance(values, dict):
        raise ValueError(f"{PART} is {values!r}; it must be a table, which begins with [{PART}]")
    known = {field.name: str if field.name in ("model", "source") else float for field in fields(Transducer)}
    del known["aperture"]
    _check_keys(values, (NAME, *known))
    name = values.get(NAME, "MA40S4S")
    if not isinstance(name, str) or name not in TRANSDUCERS:
        raise ValueError(f"unknown {PART} {name!r}; known are {', '.join(TRANSDUCERS)}")
    changed = {key: value for key, value in values.items() if key != NAME}
    for key, value in changed.items():
        if isinstance(value, bool) or not isinstance(value, (int, float) if known[key] is float else str):
            kind = "a number" if known[key] is float else "text"
            raise ValueError(f"{PART} {key} is {value!r}; it must be {kind}")
    return replace(TRANSDUCERS[name], **changed)


def _panel(entry: dict[str, Any], part: Transducer, folder: Path) -> TransducerArray:
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


ARRAY_FILES = {".csv": _read_csv, ".toml": _read_toml}
"""Readers of arrays by the suffix of a file's name."""
