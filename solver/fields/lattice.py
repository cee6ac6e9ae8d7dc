"""Fields over planes by FFT: for flat arrays on a regular grid.

On such an array every transducer makes the same field, only shifted, so the field over a parallel plane is a
convolution of the drives with the field of one transducer. If the distance between samples is the pitch divided by
a whole number N, it is a discrete one and exact: sample N·a + r of an axis, 0 ≤ r < N, is
Σ_c drive_c·g_r(a − c), where g_r is the one transducer's field at the samples of phase r. So there are N × N small
convolutions with the same drives, which are transformed once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..acoustics.propagation import Precision, pressure
from ..geometry import frozen
from .grid import Grid

__all__ = ["OFF_GRID", "Lattice", "Shifts", "lattice_of", "shifts_over", "spectrum_size"]

OFF_GRID = 1e-8  # metres that a transducer may stand beside the grid: 7e-6 rad at 40 kHz
NEIGHBOURS = 1e-4  # least metres between columns: a smaller distance is a transducer out of line, not a pitch
SAMPLES_AT_A_TIME = 500_000


class Lattice(NamedTuple):
    """A flat array on a square grid.

    Parameters
    ----------
    pitch : float
        Pitch in metres.
    cells : (n, 2) int
        Column and row of each transducer, from 0.
    response : (n,) complex
        The array's.
    one : TransducerArray
        The transducer of column and row 0, with a response of 1.
    """

    pitch: float
    cells: NDArray[np.intp]
    response: NDArray[np.complex128]
    one: TransducerArray

    @property
    def counts(self) -> tuple[int, int]:
        """Columns and rows."""
        columns, rows = self.cells.max(axis=0) + 1
        return int(columns), int(rows)


class Shifts(NamedTuple):
    """The field of one transducer over a plane, shifted to the place of any other: from drives to a field.

    Parameters
    ----------
    lattice : Lattice
        The array.
    counts : (2,) int
        Samples along x and y.
    spectrum : (height, N, width, N) complex64
        The one transducer's field, transformed along the first and third axis.
    """

    lattice: Lattice
    counts: tuple[int, int]
    spectrum: NDArray[np.complex64]

    def __call__(self, drive: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Pressure, (samples along y, samples along x), of drives (n,)."""
        columns, rows = self.lattice.counts
        high, phases, wide, _ = self.spectrum.shape
        across, up = (-(-count // phases) for count in self.counts)
        cells = np.zeros((high, wide), dtype=np.complex64)
        np.add.at(cells, (self.lattice.cells[:, 1], self.lattice.cells[:, 0]), drive * self.lattice.response)
        product = self.spectrum * scipy.fft.fft2(cells)[:, None, :, None]
        product = scipy.fft.ifft(product, axis=0, overwrite_x=True)[rows - 1 : rows - 1 + up]
        product = scipy.fft.ifft(product, axis=2, overwrite_x=True)[:, :, columns - 1 : columns - 1 + across]
        return np.asarray(product.reshape(up * phases, across * phases)[: self.counts[1], : self.counts[0]])


def spectrum_size(lattice: Lattice, counts: tuple[int, ...], per_pitch: int) -> tuple[int, int]:
    """Rows and columns of the spectrum of samples along x and y, ``per_pitch`` of them per pitch."""
    high, wide = (
        scipy.fft.next_fast_len(-(-samples // per_pitch) + count - 1)
        for samples, count in zip(counts[1::-1], lattice.counts[::-1], strict=True)
    )
    return int(high), int(wide)


def shifts_over(
    lattice: Lattice, grid: Grid, height: float, per_pitch: int, medium: Medium, precision: Precision
) -> Shifts:
    """From drives to the field over a plane at a height in metres; `ValueError` if a sample is too close for the model.

    The first two axes of the grid are x and y, and the array's pitch is ``per_pitch`` of its steps. ``precision`` is
    that of the field of one transducer and of its transform, which is kept in single precision.
    """
    high, wide = spectrum_size(lattice, grid.counts, per_pitch)
    columns, rows = lattice.counts
    x, y = (
        (per_pitch * (np.arange(size)[:, None] - count + 1) + np.arange(per_pitch)).ravel() * grid.step
        + grid.coordinates(axis)[1][0]
        for axis, size, count in ((0, wide, columns), (1, high, rows))
    )
    kernel = np.empty((len(y), len(x)), np.complex128 if precision == "double" else np.complex64)
    at_a_time = max(1, SAMPLES_AT_A_TIME // len(x))
    for first in range(0, len(y), at_a_time):
        part = slice(first, first + at_a_time)
        at = np.stack([*np.broadcast_arrays(x, y[part, None], height)], axis=-1)
        kernel[part] = pressure(lattice.one, [1], at.reshape(-1, 3), medium, precision).reshape(at.shape[:2])
    phased = kernel.reshape(high, per_pitch, wide, per_pitch)
    spectrum = scipy.fft.fft2(phased, axes=(0, 2), overwrite_x=True).astype(np.complex64, copy=False)
    return Shifts(lattice, (grid.counts[0], grid.counts[1]), frozen(spectrum))


def lattice_of(array: TransducerArray) -> Lattice:
    """The square grid on which a flat array stands.

    `ValueError` if the array is not flat and horizontal, looks more than one way, or does not stand on such a grid.
    """
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
    one = TransducerArray([array.positions.min(axis=0)], array.normals[:1], array.transducer)
    return Lattice(pitch, cells.astype(np.intp), array.response, one)
