"""Files of solutions and fields (NPZ).

A solved file holds drives, not pulses: pulses are made on the way to a device.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.arguments import instance_of
from ...base.errors import InputFileError
from ...base.storage import FilePath, replacing
from ..acoustics.aperture import Aperture
from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..acoustics.transducer import Transducer
from ..archives import read_arrays
from ..geometry import frozen
from ..methods.solve import Solution
from ..shapes.points import ControlPoints
from .field import Field, PlaneField, VolumeField
from .grid import Grid

__all__ = ["load_field", "load_solution", "read_arrays", "save_field", "save_solution", "solution_in"]

SOLUTION_FORMAT = "phasewire-solution-2"
EARLIER_FORMATS = ("phasewire-solution-1",)
TRANSDUCER_NUMBERS = ("radius", "strength", "resonance", "time_constant")
MEDIUM_NUMBERS = ("temperature", "frequency", "humidity", "ambient_pressure")
FIELD_FORMAT = "phasewire-field-1"
FIELD_UNITS = (
    "pressure: Pa, peak, complex, e^(-iωt); centre, step: m; axes: unit vectors, the last one of pressure first"
)


def save_solution(path: FilePath, solution: Solution) -> None:
    """Write a solution with all that is needed to use it again, whole or not at all."""
    instance_of(solution, Solution, "solution", "as in save_solution(path, solution)")
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


def load_solution(path: FilePath) -> Solution:
    """Read a solution back.

    Raises
    ------
    InputFileError
        If the file is truncated, corrupted or of another kind.
    OSError
        If it cannot be opened.
    """
    return solution_in(read_arrays(path), path)


def solution_in(arrays: dict[str, np.ndarray[Any, Any]], path: FilePath) -> Solution:
    """The solution in the arrays of a file; raise `InputFileError`, naming the file, if there is none."""
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
        raise ValueError(f"{count} numbers are expected, not {values.shape} of {values.dtype}")
    return [float(value) for value in values]


def save_field(path: FilePath, field: PlaneField | VolumeField) -> None:
    """Write a field as NPZ, whole or not at all.

    Its arrays are `pressure`, (rows, columns) or (layers, rows, columns) complex in Pa (peak), the grid's `centre` (3,)
    and `step` in metres, its `axes` (d, 3), the first of which belongs to the columns, the medium as in a
    solved file, and `units`, which says this in words.
    """
    instance_of(field, Field, "field", "as in save_field(path, field)")
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


def load_field(path: FilePath) -> PlaneField | VolumeField:
    """Read a field back.

    Raises
    ------
    InputFileError
        If the file is truncated, corrupted or of another kind.
    OSError
        If it cannot be opened.
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
