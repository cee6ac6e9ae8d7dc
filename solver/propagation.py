"""From drives to pressure: the transfer matrix.

Time factor e^{-iωt}, outgoing wave e^{+ikr}/r, pressure as peak complex amplitude in Pa.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .array import TransducerArray
from .diffraction import KERNELS
from .geometry import as_points
from .medium import Medium
from .models import residual
from .table import ResidualTable

__all__ = ["pressure", "transfer_matrix"]

PAIRS_AT_A_TIME = 1_000_000  # of points and transducers: bounds the memory of a large field


def transfer_matrix(array: TransducerArray, at: ArrayLike, medium: Medium | None = None) -> NDArray[np.complex128]:
    """Pressure at each point per unit drive of each transducer, the matrix A of the paper's (7).

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    at : (m, 3) float
        Points, in metres, at least one piston radius from every transducer's centre, or two radii where the model is a
        Rayleigh integral.
    medium : Medium, optional
        The air; 20 °C by default.

    Returns
    -------
    (m, n) complex
        P₁·polarity·response·residual·e^{(ik−α)r}/r in Pa (peak); 0 behind a transducer's baffle.

    Raises
    ------
    ValueError
        Where a point is not finite, or too close for the transducer's model.

    Notes
    -----
    Rayleigh integrals are looked up, see `ResidualTable`. Absorption is taken along the way from the centre.
    """
    return _transfer_matrix(array, as_points(at, "point"), medium or Medium())


def _transfer_matrix(
    array: TransducerArray, points: NDArray[np.float64], medium: Medium, first: int = 0
) -> NDArray[np.complex128]:
    """`transfer_matrix` of checked points, which are numbered from ``first`` in messages."""
    offset = points[:, None, :] - array.positions[None, :, :]
    distance = np.sqrt(np.einsum("mnk,mnk->mn", offset, offset))
    transducer = array.transducer
    if distance.min() < transducer.nearest:
        point, near = np.unravel_index(np.argmin(distance), distance.shape)
        raise ValueError(
            f"point {first + point} at {points[point].tolist()} m is {distance.min() * 1e3:.2f} mm from transducer "
            f"{near}; the model {transducer.model!r} needs at least {transducer.nearest * 1e3:.2f} mm"
        )
    cosine = np.einsum("mnk,nk->mn", offset, array.normals) / distance
    sine = np.sqrt(np.maximum(0.0, 1 - cosine**2))
    if transducer.model in KERNELS:
        wave = ResidualTable.of(transducer, medium, transducer.nearest)(sine, distance)
    else:
        wave = residual(transducer, sine, distance, medium)
    strength = transducer.strength * transducer.polarity * array.response
    travelled = np.exp((1j * medium.wavenumber - medium.attenuation) * distance) / distance
    return np.asarray(np.where(cosine > 0, strength * wave * travelled, 0.0))


def pressure(
    array: TransducerArray, drive: ArrayLike, at: ArrayLike, medium: Medium | None = None
) -> NDArray[np.complex128]:
    """Pressure that a drive makes at points, the paper's (6).

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    drive : (n,) complex
        Drives; 1 is full drive.
    at : (k, 3) float
        Points, in metres.
    medium : Medium, optional
        The air; 20 °C by default.

    Returns
    -------
    (k,) complex
        Peak pressure in Pa.

    Raises
    ------
    ValueError
        Where the drive has another length than the array, or as `transfer_matrix`.
    """
    drive = np.asarray(drive, dtype=np.complex128)
    if drive.shape != (len(array),):
        raise ValueError(f"drive has the shape {drive.shape}, but the array has {len(array)} transducers")
    if (bad := np.flatnonzero(~np.isfinite(drive))).size:
        raise ValueError(f"drive of transducer {bad[0]} is {drive[bad[0]]}; it must be finite")
    points, medium = as_points(at, "point"), medium or Medium()
    result = np.empty(len(points), dtype=np.complex128)
    at_a_time = max(1, PAIRS_AT_A_TIME // len(array))
    for first in range(0, len(points), at_a_time):
        part = slice(first, first + at_a_time)
        result[part] = _transfer_matrix(array, points[part], medium, first) @ drive
    return result
