"""Files that the solver reads and writes: control points (CSV, JSON, plain text), solutions and fields (NPZ).

A solved file holds drives, not pulses: pulses are made on the way to a device.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputFileError
from ..storage import read_text, replacing
from .aperture import Aperture
from .archives import read_arrays
from .array import TransducerArray
from .field import PlaneField, VolumeField
from .geometry import frozen
from .grid import Grid
from .medium import Medium
from .points import ControlPoints
from .solve import Solution
from .transducer import Transducer

__all__ = [
    "POINT_FILES",
    "load_field",
    "load_solution",
    "read_arrays",
    "read_points",
    "save_field",
    "save_solution",
    "solution_in",
]

SOLUTION_FORMAT = "phasewire-solution-2"
EARLIER_FORMATS = ("phasewire-solution-1",)
TRANSDUCER_NUMBERS = ("radius", "strength", "resonance", "time_constant")
MEDIUM_NUMBERS = ("temperature", "frequency", "humidity", "ambient_pressure")
FIELD_FORMAT = "phasewire-field-1"
FIELD_UNITS = (
    "pressure: Pa, peak, complex, e^(-iωt); centre, step: m; axes: unit vectors, the last one of pressure first"
)
MOST_POINT_BYTES = 4_000_000
"""A hundred thousand points, far more than any solver takes."""


def read_points(path: Path) -> ControlPoints:
    """Read control points from a CSV, JSON or plain text file, by the suffix of its name.

    CSV: a line per point, ``x,y,z`` or ``x,y,z,amplitude`` in metres; a first line without any number is taken for
    names, and empty lines and those that begin with ``#`` are skipped.
    Plain text (``.txt``, ``.xyz``): the same with white space between the numbers; what follows a ``#`` is skipped.
    JSON: ``{"positions": [[x, y, z], …], "amplitudes": […]}``, where the amplitudes are optional.

    Raises
    ------
    InputFileError
        Where the file is not readable as such; it says where.
    OSError
        Where it cannot be opened.
    """
    if path.suffix.lower() not in POINT_FILES:
        raise InputFileError(f"{path}: control points are read from {' or '.join(POINT_FILES)} files")
    text = read_text(path, MOST_POINT_BYTES)
    try:
        positions, amplitudes = POINT_FILES[path.suffix.lower()](text)
        return ControlPoints(positions, amplitudes)
    except (ValueError, TypeError, OverflowError, RecursionError, csv.Error) as error:
        raise InputFileError(f"{path}: {error}") from error


def _read_csv(text: str) -> tuple[list[list[float]], list[float] | None]:
    return _read_table(csv.reader(text.splitlines()), ",")


def _read_text(text: str) -> tuple[list[list[float]], list[float] | None]:
    return _read_table((line.partition("#")[0].split() for line in text.splitlines()), " ")


def _read_table(lines: Iterable[list[str]], separator: str) -> tuple[list[list[float]], list[float] | None]:
    """Positions and, where there are four columns, amplitudes, from the cells of each line of a file."""
    rows: list[list[float]] = []
    names_may_come = True
    for number, cells in enumerate(lines, start=1):
        if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
            continue
        numbers = [_number(cell) for cell in cells]
        if names_may_come and len(cells) in (3, 4) and not any(value is not None for value in numbers):
            names_may_come = False
            continue
        names_may_come = False
        row = [value for value in numbers if value is not None]
        if len(row) != len(cells) or len(row) not in (3, 4):
            form = separator.join("xyz")
            raise ValueError(
                f"line {number}: {separator.join(cells)!r} is not {form} or {form}{separator}amplitude in numbers"
            )
        if rows and len(row) != len(rows[0]):
            raise ValueError(f"line {number} has {len(row)} numbers, but the lines before it have {len(rows[0])}")
        rows.append(row)
    if not rows:
        raise ValueError("there are no control points in it")
    return [row[:3] for row in rows], [row[3] for row in rows] if len(rows[0]) == 4 else None


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _read_json(text: str) -> tuple[Any, Any]:
    record = json.loads(text)
    if not isinstance(record, dict) or "positions" not in record:
        raise ValueError('it must be an object with "positions": [[x, y, z], …] and, if wanted, "amplitudes": […]')
    if unknown := sorted(set(record) - {"positions", "amplitudes"}):
        raise ValueError(f"unknown entry {unknown[0]!r}; known are positions and amplitudes")
    return record["positions"], record.get("amplitudes")


POINT_FILES = {".csv": _read_csv, ".json": _read_json, ".txt": _read_text, ".xyz": _read_text}
"""Readers of control points by the suffix of a file's name."""


def save_solution(path: Path, solution: Solution) -> None:
    """Write a solution with all that is needed to use it again, whole or not at all."""
    array, points = solution.array, solution.points
    with replacing(path) as part, part.open("wb") as file:
        entries = {
            "format": np.array(SOLUTION_FORMAT),
            "drive": solution.drive,
            "array_positions": array.positions,
            "array_normals": array.normals,
            "array_response": array.response,
            "array_limits": array.limits,
            "point_positions": points.positions,
            "point_amplitudes": points.amplitudes,
            "method": np.array(solution.method),
            **_transducer_arrays(array.transducer),
            **_medium_arrays(solution.medium),
        }
        np.savez(file, allow_pickle=False, **entries)


def load_solution(path: Path) -> Solution:
    """Read a solution back.

    Raises
    ------
    InputFileError
        Where the file is truncated, corrupted or of another kind.
    OSError
        Where it cannot be opened.
    """
    return solution_in(read_arrays(path), path)


def solution_in(arrays: dict[str, np.ndarray[Any, Any]], path: Path) -> Solution:
    """The solution in the arrays of a file; raise `InputFileError`, naming the file, where there is none."""
    if str(arrays.get("format")) in EARLIER_FORMATS:
        raise InputFileError(
            f"{path} was made by an earlier version of phasewire; solve it again with `phasewire solve`"
        )
    if str(arrays.get("format")) != SOLUTION_FORMAT:
        raise InputFileError(f"{path} is not a solved file; `phasewire solve` makes one")
    try:
        drive = np.asarray(arrays["drive"], dtype=np.complex128)
        array = TransducerArray(
            arrays["array_positions"],
            arrays["array_normals"],
            _transducer_in(arrays),
            arrays["array_response"],
            arrays["array_limits"],
        )
        points = ControlPoints(arrays["point_positions"], arrays["point_amplitudes"])
        medium = _medium_in(arrays)
        if drive.shape != (len(array),):
            raise ValueError(f"{drive.size} drives for {len(array)} transducers")
        if not (within := np.abs(drive) <= 1 + 1e-6).all():
            raise ValueError(f"the drive of transducer {np.argmin(within)} is not within 1")
        return Solution(frozen(drive), array, points, medium, str(arrays["method"]))
    except KeyError as error:
        raise InputFileError(f"{path} is not a usable solved file: it has no entry {error}") from error
    except (TypeError, ValueError) as error:
        raise InputFileError(f"{path} is not a usable solved file: {error}") from error


def _transducer_arrays(transducer: Transducer) -> dict[str, np.ndarray[Any, Any]]:
    arrays = {
        "transducer": np.array([getattr(transducer, name) for name in TRANSDUCER_NUMBERS], dtype=np.float64),
        "transducer_polarity": np.array(transducer.polarity),
        "transducer_model": np.array(transducer.model),
        "transducer_source": np.array(transducer.source),
    }
    if transducer.aperture is not None:
        arrays["aperture_image"] = transducer.aperture.image
        arrays["aperture_pixel"] = np.array([transducer.aperture.pixel])
    return arrays


def _transducer_in(arrays: dict[str, np.ndarray[Any, Any]]) -> Transducer:
    aperture = None
    if "aperture_image" in arrays:
        aperture = Aperture(arrays["aperture_image"], *_floats(arrays["aperture_pixel"], 1))
    numbers = _floats(arrays["transducer"], len(TRANSDUCER_NUMBERS))
    return Transducer(
        **dict(zip(TRANSDUCER_NUMBERS, numbers, strict=True)),
        polarity=arrays["transducer_polarity"].item(),
        model=str(arrays["transducer_model"]),
        source=str(arrays["transducer_source"]),
        aperture=aperture,
    )


def _medium_arrays(medium: Medium) -> dict[str, np.ndarray[Any, Any]]:
    return {
        "medium": np.array([getattr(medium, name) for name in MEDIUM_NUMBERS], dtype=np.float64),
        "medium_absorbing": np.array(medium.absorbing),
    }


def _medium_in(arrays: dict[str, np.ndarray[Any, Any]]) -> Medium:
    numbers = _floats(arrays["medium"], len(MEDIUM_NUMBERS))
    return Medium(**dict(zip(MEDIUM_NUMBERS, numbers, strict=True)), absorbing=bool(arrays["medium_absorbing"].item()))


def _floats(values: np.ndarray[Any, Any], count: int) -> list[float]:
    if values.shape != (count,) or values.dtype.kind != "f":
        raise ValueError(f"{count} numbers are expected where {values.shape} of {values.dtype} stand")
    return [float(value) for value in values]


def save_field(path: Path, field: PlaneField | VolumeField) -> None:
    """Write a field as NPZ, whole or not at all.

    Its arrays are `pressure`, (rows, columns) or (layers, rows, columns) complex in Pa (peak), the grid's `centre` (3,)
    and `step` in metres, its `axes` (d, 3), of which the first belongs to the columns, the medium as in a
    solved file, and `units`, which says this in words.
    """
    with replacing(path) as part, part.open("wb") as file:
        np.savez(
            file,
            format=np.array(FIELD_FORMAT),
            pressure=field.pressure,
            centre=field.grid.centre,
            axes=field.grid.axes,
            step=np.array(field.grid.step),
            units=np.array(FIELD_UNITS),
            allow_pickle=False,
            **_medium_arrays(field.medium),
        )


def load_field(path: Path) -> PlaneField | VolumeField:
    """Read a field back.

    Raises
    ------
    InputFileError
        Where the file is truncated, corrupted or of another kind.
    OSError
        Where it cannot be opened.
    """
    arrays = read_arrays(path)
    if str(arrays.get("format")) != FIELD_FORMAT:
        raise InputFileError(f"{path} is not a field; `phasewire field` makes one")
    try:
        pressure = np.asarray(arrays["pressure"], dtype=np.complex128)
        (step,) = _floats(arrays["step"].reshape(-1), 1)
        grid = Grid(arrays["centre"], arrays["axes"], pressure.shape[::-1], step)
        medium = _medium_in(arrays)
        if not np.isfinite(pressure).all():
            raise ValueError("a pressure in it is not finite")
        kind = PlaneField if grid.kind == "plane" else VolumeField
        return kind(grid, frozen(pressure), medium)
    except KeyError as error:
        raise InputFileError(f"{path} is not a usable field: it has no entry {error}") from error
    except (TypeError, ValueError) as error:
        raise InputFileError(f"{path} is not a usable field: {error}") from error
