"""Calibration: how each transducer differs from the ideal one, and the corrected drives.

A calibration is applied only between drives and pulses: `frames` applies it to every drive on its way to a device. It
does not measure anything, and does not change pulses. A solver whose array has the same responses
(`TransducerArray.calibrated`) already returns corrected drives, and better ones, because it knows which transducers it
can do without; such drives need no calibration.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, check_drives, spelt, whole
from ...base.errors import InputFileError
from ...base.storage import FilePath, read_text, replacing
from ...solver.acoustics.array import LEAST, MAX_GAIN, MAX_TRANSDUCERS
from ...solver.geometry import frozen

__all__ = ["COLUMNS", "Calibration"]

MOST_BYTES = 2**20
"""Limit for a file, enough for ten thousand transducers."""
COLUMNS = ("transducer", "gain", "phase_deg", "polarity", "dead")


@dataclass(frozen=True, eq=False)
class Calibration:
    """The real emission of each of n transducers, in array order; two with the same values are equal.

    Parameters
    ----------
    gain : (n,) float
        Magnitude of emission per unit drive, relative to the ideal; from 1e-6 to 100, or 0, which counts as dead.
    phase_deg : (n,) float
        The excess of its phase, which means too late, in degrees from -360 to 360.
    polarity : (n,) int
        1, or -1 if it is connected with reversed polarity.
    dead : (n,) bool
        Whether it emits nothing, or shall not; its other values are then ignored.

    Raises
    ------
    ValueError
        If a value is out of range, lengths differ, or every transducer is dead.
    """

    gain: NDArray[np.float64]
    phase_deg: NDArray[np.float64]
    polarity: NDArray[np.int8]
    dead: NDArray[np.bool_]

    def __init__(self, gain: ArrayLike, phase_deg: ArrayLike, polarity: ArrayLike, dead: ArrayLike) -> None:
        given = zip(COLUMNS[1:], (gain, phase_deg, polarity, dead), strict=True)
        columns = [array_of(name, values, np.float64) for name, values in given]
        if any(values.ndim != 1 or len(values) != len(columns[0]) for values in columns):
            shapes = ", ".join(str(values.shape) for values in columns)
            raise ValueError(f"{', '.join(COLUMNS[1:])} must have the shape (n,) each, not {shapes}")
        for name, values in zip(COLUMNS[1:], columns, strict=True):
            allowed, wanted = _allowed(name, values)
            if not allowed.all():
                wrong = int(np.argmin(allowed))
                raise ValueError(f"{name} {values[wrong]:g} of transducer {wrong} must be {wanted}")
        if (columns[3].astype(np.bool_) | (columns[0] == 0)).all():
            raise ValueError("every transducer is dead; at least one must work")
        object.__setattr__(self, "gain", frozen(columns[0]))
        object.__setattr__(self, "phase_deg", frozen(columns[1]))
        object.__setattr__(self, "polarity", frozen(columns[2].astype(np.int8)))
        object.__setattr__(self, "dead", frozen(columns[3].astype(np.bool_)))

    def __repr__(self) -> str:
        gains = f"gains {self.gain.min():.3g} to {self.gain.max():.3g}"
        return f"Calibration({len(self)} transducers, {gains}, {int(np.sum(self.dead))} dead)"

    @classmethod
    def perfect(cls, n: int) -> Self:
        """``n`` ideal transducers."""
        n = whole("n", n, 1, MAX_TRANSDUCERS)
        return cls(np.ones(n), np.zeros(n), np.ones(n), np.zeros(n))

    def __len__(self) -> int:
        return len(self.gain)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Calibration):
            return NotImplemented
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in COLUMNS[1:])

    @cached_property
    def response(self) -> NDArray[np.complex128]:
        """Emission of each transducer per unit drive, (n,) complex: 1 is ideal, 0 is dead."""
        turned = self.gain * self.polarity * np.exp(1j * np.deg2rad(self.phase_deg))
        return frozen(np.where(self.dead, 0, turned))

    @cached_property
    def _inverse(self) -> NDArray[np.complex128]:
        able = self.response != 0
        return np.divide(1, self.response, out=np.zeros_like(self.response), where=able)

    def apply(self, drives: NDArray[Any], first: int = 0) -> NDArray[np.complexfloating]:
        """The drives with which these transducers emit what ideal ones would emit with the given drives.

        Each drive is divided by the transducer's response. One that would exceed 1 is driven fully, with the right
        phase: a transducer of gain 0.8 at full drive emits 0.8, a fifth too little. The others are not reduced to
        match, so ratios between transducers suffer, but not the loudness. A dead one gets 0.

        Parameters
        ----------
        drives : (n,) or (k, n) complex
            Magnitude at most 1; complex64 stays what it is.
        first : int
            Number of the first of k frames, for errors.

        Raises
        ------
        ValueError
            If the number of drives differs from that of transducers, or a drive is not finite or its magnitude exceeds
            1.
        """
        drives, first = np.asarray(drives), whole("first", first, 0, 2**63 - 1)
        if drives.dtype != np.complex64:
            drives = array_of("drives", drives, np.complex128)
        if drives.shape[-1:] != (len(self),):
            raise ValueError(f"drives of the shape {drives.shape} for a calibration of {len(self)} transducers")
        check_drives(drives, first)
        wanted: NDArray[np.complexfloating] = drives * self._inverse.astype(drives.dtype)
        wanted /= np.maximum(np.abs(wanted), 1)
        return wanted

    def save(self, path: FilePath) -> None:
        """Write a CSV file that `load` reads, either completely or not at all.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            columns = (getattr(self, name).tolist() for name in COLUMNS[1:])
            for transducer, (gain, phase_deg, polarity, dead) in enumerate(zip(*columns, strict=True)):
                writer.writerow((transducer, repr(gain), repr(phase_deg), polarity, int(dead)))

    @classmethod
    def load(cls, path: FilePath) -> Self:
        """Read a CSV file: the line ``transducer,gain,phase_deg,polarity,dead``, then one for each transducer.

        Transducers count from 0, in array order; their lines may stand in any order. Gain and phase are numbers, the
        phase in degrees, polarity is 1 or -1, dead is 0 or 1. Empty lines and those that begin with ``#`` are skipped.

        Raises
        ------
        InputFileError
            If the file is malformed; it names the line, the column and the problem.
        OSError
            If it cannot be opened.
        """
        text = read_text(path, MOST_BYTES)
        try:
            rows = _read(text.splitlines())
            return cls(*zip(*(rows[transducer] for transducer in range(len(rows))), strict=True))
        except (ValueError, csv.Error) as error:
            raise InputFileError(f"{path}: {error}") from error


def _allowed(name: str, values: NDArray[np.float64]) -> tuple[NDArray[np.bool_], str]:
    """Which values of a column are valid, and the rule in words."""
    match name:
        case "gain":
            return (values == 0) | (values >= LEAST) & (values <= MAX_GAIN), f"0 or from {LEAST:g} to {MAX_GAIN:g}"
        case "phase_deg":
            return np.abs(values) <= 360, "from -360 to 360 degrees"
        case "polarity":
            return np.abs(values) == 1, "1 or -1"
    return (values == 0) | (values == 1), "0 or 1"


def _read(lines: Iterable[str]) -> dict[int, list[float]]:
    """Values by transducer, of 0 to n - 1."""
    rows: dict[int, list[float]] = {}
    numbers: dict[int, int] = {}  # of the lines in which they stand
    named = False
    for number, line in enumerate(lines, start=1):
        if not line.strip(" \t,;") or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if not named:
            if tuple(cells) != COLUMNS:
                raise ValueError(f"line {number}: {','.join(cells)!r} must name the columns {','.join(COLUMNS)!r}")
            named = True
            continue
        if len(cells) != len(COLUMNS):
            raise ValueError(f"line {number} has {len(cells)} cells; it must have {len(COLUMNS)}: {','.join(COLUMNS)}")
        transducer = _transducer(cells[0], number)
        if transducer in rows:
            raise ValueError(f"line {number}: transducer {transducer} stands in line {numbers[transducer]} already")
        rows[transducer] = [_value(*cell, number) for cell in zip(COLUMNS[1:], cells[1:], strict=True)]
        numbers[transducer] = number
    if not rows:
        raise ValueError(f"there is no transducer in it; after the line {','.join(COLUMNS)} comes one for each")
    missing = next((transducer for transducer in range(len(rows)) if transducer not in rows), None)
    if missing is not None:
        last = max(rows)
        raise ValueError(
            f"transducer {missing} is missing, but there is {last} in line {numbers[last]}; all from 0 on are needed"
        )
    return rows


def _transducer(cell: str, line: int) -> int:
    if not (cell.isascii() and cell.isdigit()):
        raise ValueError(f"line {line}, column transducer: {cell!r} must be a whole number, 0 or more")
    return int(cell)


def _value(name: str, cell: str, line: int) -> float:
    try:
        value = spelt(cell)
    except ValueError:
        value = np.nan
    allowed, wanted = _allowed(name, np.array(value))
    if not allowed:
        raise ValueError(f"line {line}, column {name}: {cell!r} must be {wanted}")
    return value
