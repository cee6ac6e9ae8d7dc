"""A stream of fields over one plane, by FFT: for flat arrays on a regular grid.

On such an array every transducer makes the same field, only shifted, so the field over a parallel plane is a
convolution of the drives with the field of one transducer. If the distance between samples is the pitch divided by
a whole number N, it is a discrete one and exact: sample N·a + r of an axis, 0 ≤ r < N, is
Σ_c drive_c·g_r(a − c), where g_r is the one transducer's field at the samples of phase r. So there are N × N small
convolutions with the same drives, which are transformed once.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..acoustics.array import TransducerArray, check_array
from ..acoustics.medium import Medium, as_medium
from ..acoustics.propagation import transfer_matrix
from ..geometry import frozen
from .field import PlaneField
from .grid import MAX_SAMPLES, Grid

__all__ = ["PlanePropagator"]

OFF_GRID = 1e-8  # metres that a transducer may stand beside the grid: 7e-6 rad at 40 kHz
NEIGHBOURS = 1e-4  # least metres between columns: a smaller distance is a transducer out of line, not a pitch
POINTS_AT_A_TIME = 500_000


@dataclass(frozen=True, eq=False)
class PlanePropagator:
    """From drives to the field over one horizontal plane, made once and used for many drives.

    Parameters
    ----------
    array : TransducerArray
        n transducers at one height, which look the same way and stand on a square grid along x and y. Places of the
        grid may be empty.
    height : float
        Of the plane, in metres.
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
    _cells: NDArray[np.intp]
    _response: NDArray[np.complex128]
    _cell_shape: tuple[int, int]
    _spectrum: NDArray[np.complex64]

    def __init__(
        self,
        array: TransducerArray,
        height: float,
        extent: float = 0.2,
        per_pitch: int = 10,
        medium: Medium | None = None,
    ) -> None:
        if not (isinstance(per_pitch, Integral) and per_pitch >= 1):
            raise ValueError(f"per_pitch {per_pitch} must be a whole number, at least 1")
        check_array(array)
        medium = as_medium(medium)
        pitch, cells = _square_grid(array)
        grid = Grid.horizontal(height, extent, pitch / per_pitch)
        columns, rows = (int(count) + 1 for count in cells.max(axis=0))
        blocks = -(-grid.counts[0] // per_pitch)
        sizes = [scipy.fft.next_fast_len(blocks + count - 1) for count in (rows, columns)]
        if sizes[0] * sizes[1] * per_pitch**2 > MAX_SAMPLES:
            raise ValueError(
                f"a step of {grid.step:g} m over {extent:g} m with an array of {columns} × {rows} places needs more "
                f"than {MAX_SAMPLES} samples"
            )
        x, y = (
            (per_pitch * (np.arange(size)[:, None] - count + 1) + np.arange(per_pitch)).ravel() * grid.step + start
            for size, count, start in (
                (sizes[1], columns, grid.coordinates(0)[1][0]),
                (sizes[0], rows, grid.coordinates(1)[1][0]),
            )
        )
        at = np.stack([*np.broadcast_arrays(x, y[:, None], height)], axis=-1)
        one = TransducerArray([array.positions.min(axis=0)], array.normals[:1], array.transducer)  # response 1
        parts = np.array_split(at.reshape(-1, 3), 1 + at.size // 3 // POINTS_AT_A_TIME)
        kernel = np.concatenate([transfer_matrix(one, part, medium)[:, 0] for part in parts])
        kernel = kernel.reshape(sizes[0], per_pitch, sizes[1], per_pitch)
        object.__setattr__(self, "grid", grid)
        object.__setattr__(self, "medium", medium)
        object.__setattr__(self, "_cells", cells)
        object.__setattr__(self, "_response", array.response)
        object.__setattr__(self, "_cell_shape", (rows, columns))
        object.__setattr__(self, "_spectrum", frozen(scipy.fft.fft2(kernel, axes=(0, 2)).astype(np.complex64)))

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
            If the drive has another length than the array, or is not finite.
        """
        with np.errstate(over="ignore"):
            drive = np.asarray(drive, dtype=np.complex128).astype(np.complex64)
        if drive.shape != (len(self._cells),):
            raise ValueError(f"drive has the shape {drive.shape}, but the array has {len(self._cells)} transducers")
        if (bad := np.flatnonzero(~np.isfinite(drive))).size:
            raise ValueError(f"drive of transducer {bad[0]} is {drive[bad[0]]}; it must be finite")
        rows, columns = self._cell_shape
        (high, phases, wide, _), side = self._spectrum.shape, self.grid.counts[0]
        blocks = -(-side // phases)
        cells = np.zeros((high, wide), dtype=np.complex64)
        np.add.at(cells, (self._cells[:, 1], self._cells[:, 0]), drive * self._response)
        product = self._spectrum * scipy.fft.fft2(cells)[:, None, :, None]
        product = scipy.fft.ifft(product, axis=0, overwrite_x=True)[rows - 1 : rows - 1 + blocks]
        product = scipy.fft.ifft(product, axis=2, overwrite_x=True)[:, :, columns - 1 : columns - 1 + blocks]
        values = product.reshape(blocks * phases, blocks * phases)[:side, :side]
        return PlaneField(self.grid, frozen(values.astype(np.complex128)), self.medium)


def _square_grid(array: TransducerArray) -> tuple[float, NDArray[np.intp]]:
    """Pitch of a flat regular array in metres, and the column and row of each transducer, (n, 2), from 0."""
    flat = np.abs(array.positions[:, 2] - array.positions[0, 2]) <= OFF_GRID
    alike = np.abs(array.normals - array.normals[0]).max(axis=1) <= OFF_GRID
    for holds, problem in ((flat, "is not at the height of transducer 0"), (alike, "looks another way")):
        if not holds.all():
            raise ValueError(
                f"transducer {int(np.argmin(holds))} {problem}: the array must be flat and horizontal, and look one "
                f"way; `sample_plane` takes any array"
            )
    offset = array.positions[:, :2] - array.positions[:, :2].min(axis=0)
    gaps = np.diff(np.sort(offset, axis=0), axis=0)
    if not (gaps > NEIGHBOURS).any():
        raise ValueError("a single transducer has no pitch; `sample_plane` takes any array")
    pitch, span = float(gaps[gaps > NEIGHBOURS].min()), float(offset.max())
    if abs(excess := span / round(span / pitch) - pitch) < pitch / 1000:
        pitch += excess  # rounding of coordinates adds up over a long array
    cells = np.rint(offset / pitch)
    beside = np.abs(offset - cells * pitch).max(axis=1)
    if beside.max() > OFF_GRID:
        worst = int(beside.argmax())
        raise ValueError(
            f"transducer {worst} stands {beside[worst] * 1e3:.3g} mm beside a square grid of {pitch * 1e3:.6g} mm; "
            f"`sample_plane` takes any array"
        )
    return pitch, cells.astype(np.intp)
