"""A stream of fields over one plane, by FFT; `lattice` says how."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import as_single, whole
from ..acoustics.array import TransducerArray, check_array
from ..acoustics.medium import Medium, as_medium
from ..geometry import frozen
from .field import PlaneField
from .grid import MAX_SAMPLES, Grid
from .lattice import Shifts, lattice_of, shifts_over, spectrum_size

__all__ = ["PlanePropagator"]


@dataclass(frozen=True, eq=False)
class PlanePropagator:
    """From drives to the field over one horizontal plane, made once and used for many drives.

    Parameters
    ----------
    array : TransducerArray
        n transducers at one height, which look the same way and stand on a square grid along x and y. Places of the
        grid may be empty.
    height : float
        Height of the plane, in metres.
    extent : float
        Side of the square, in metres, as in `sample_plane`.
    per_pitch : int
        Samples per pitch: the distance between samples is the array's pitch divided by this number.
    medium : Medium, optional
        The air; 20 °C by default.

    Raises
    ------
    ValueError
        If a number is out of range, the array is not flat or not on a square grid, a sample is too close for the
        far-field model, or there are too many samples. `sample_plane` takes any array and any step.
    """

    grid: Grid
    medium: Medium
    _shifts: Shifts

    def __init__(
        self,
        array: TransducerArray,
        height: float,
        extent: float = 0.2,
        per_pitch: int = 10,
        medium: Medium | None = None,
    ) -> None:
        per_pitch = whole("per_pitch", per_pitch, 1, MAX_SAMPLES)
        check_array(array)
        medium = as_medium(medium)
        lattice = lattice_of(array)
        grid = Grid.horizontal(height, extent, lattice.pitch / per_pitch)
        if math.prod(spectrum_size(lattice, grid.counts, per_pitch)) * per_pitch**2 > MAX_SAMPLES:
            columns, rows = lattice.counts
            raise ValueError(
                f"a step of {grid.step:g} m over {extent} m with an array of {columns} × {rows} places needs more "
                f"than {MAX_SAMPLES} samples"
            )
        object.__setattr__(self, "grid", grid)
        object.__setattr__(self, "medium", medium)
        object.__setattr__(
            self, "_shifts", shifts_over(lattice, grid, float(grid.centre[2]), per_pitch, medium, "double")
        )

    def __repr__(self) -> str:
        return f"PlanePropagator({self.grid})"

    def __call__(self, drive: ArrayLike) -> PlaneField:
        """The field of a drive.

        Parameters
        ----------
        drive : (n,) complex
            Drives; 1 is full drive, 0 is a dead transducer.

        Returns
        -------
        PlaneField
            Computed in single precision: within 1e-5 of the strongest sample of the sum in double precision.

        Raises
        ------
        ValueError
            If the drive has another length than the array, or is beyond full drive.
        """
        drive = as_single(drive)
        n = len(self._shifts.lattice.cells)
        if drive.shape != (n,):
            raise ValueError(f"drive has the shape {drive.shape}, but the array has {n} transducers")
        return PlaneField(self.grid, frozen(self._shifts(drive).astype(np.complex128)), self.medium)
