"""From drives to pressure: the transfer matrix.

Time factor e^{-iωt}, outgoing wave e^{+ikr}/r, pressure as peak complex amplitude in Pa.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import as_drives
from ..accelerated.devices import Backend, check_backend, device_for
from ..geometry import PointsLike, as_places
from .array import TransducerArray, check_array
from .diffraction import KERNELS
from .medium import Medium, as_medium
from .models import residual
from .residual_table import ResidualTable

if TYPE_CHECKING:
    from .tables import ArrayTables

__all__ = ["Precision", "arrivals", "as_drive", "pressure", "transfer_matrix"]

Precision = Literal["double", "single"]

PAIRS_AT_A_TIME = 1_000_000  # of points and transducers: bounds the memory of a large field


def transfer_matrix(array: TransducerArray, at: PointsLike, medium: Medium | None = None) -> NDArray[np.complex128]:
    """Pressure at each point per unit drive of each transducer, the matrix A of the paper's (7).

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    at : ControlPoints, Shape or (m, 3) float
        Points, in metres, at least one piston radius from every transducer's centre, or two radii if the model is a
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
        If a point is not finite, or too close for the transducer's model.

    Notes
    -----
    Rayleigh integrals are looked up, see `ResidualTable`. Absorption is taken along the way from the centre.
    """
    check_array(array)
    return _transfer_matrix(array, as_places(at), as_medium(medium))


def _transfer_matrix(
    array: TransducerArray, points: NDArray[np.float64], medium: Medium, first: int = 0
) -> NDArray[np.complex128]:
    """`transfer_matrix` of checked points, which are numbered from ``first`` in messages."""
    offset = points[:, None, :] - array.positions[None, :, :]
    distance = np.sqrt(np.einsum("mnk,mnk->mn", offset, offset))
    transducer = array.transducer
    if distance.min() < transducer.nearest:
        point, near = np.unravel_index(np.argmin(distance), distance.shape)
        raise ValueError(_too_close(array, points[point], int(first + point), int(near), distance.min()))
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
    array: TransducerArray,
    drive: ArrayLike,
    at: PointsLike,
    medium: Medium | None = None,
    precision: Precision = "double",
    backend: Backend = "cpu",
) -> NDArray[np.complex128]:
    """Pressure that a drive makes at points, the paper's (6).

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    drive : (n,) complex
        Drives; 1 is full drive.
    at : ControlPoints, Shape or (k, 3) float
        Points, in metres.
    medium : Medium, optional
        The air; 20 °C by default.
    precision : {"double", "single"}
        complex128 in NumPy, or a compiled float32 kernel: within 2e-4 of the largest pressure, a hundred times as fast,
        and the choice for fields. For points more than 500 wavelengths away, or if nearly all is absorbed on the
        way, double precision is used all the same.
    backend : {"cpu", "cuda"}
        ``"cuda"`` computes on a GPU, in single precision. If there is no GPU, or the points are too far for single
        precision, the processor does, and a warning says why.

    Returns
    -------
    (k,) complex
        Peak pressure in Pa.

    Raises
    ------
    ValueError
        If the drive has another length than the array, the backend is unknown or lacks the precision, or as
        `transfer_matrix`.
    """
    drive = as_drive(array, drive)
    if precision not in get_args(Precision):
        raise ValueError(f"precision {precision!r} must be one of {', '.join(get_args(Precision))}")
    check_backend(backend, precision)
    points, medium = as_places(at), as_medium(medium)
    tables = _reaching(array, points, medium) if precision == "single" else None
    device = device_for(backend, None if tables else "single precision is too coarse for points so far away")
    if tables is not None:
        from .tables import pressure_at

        return pressure_at(tables, array, drive, points, device)
    result = np.empty(len(points), dtype=np.complex128)
    at_a_time = max(1, PAIRS_AT_A_TIME // len(array))
    for first in range(0, len(points), at_a_time):
        part = slice(first, first + at_a_time)
        result[part] = _transfer_matrix(array, points[part], medium, first) @ drive
    return result


def as_drive(array: TransducerArray, drive: ArrayLike) -> NDArray[np.complex128]:
    """Drives (n,) of an array; `ValueError` if they are not as many as its transducers, or one is beyond full drive."""
    check_array(array)
    drive = as_drives(drive)
    if drive.shape != (len(array),):
        raise ValueError(f"drive has the shape {drive.shape}, but the array has {len(array)} transducers")
    return drive


def arrivals(array: TransducerArray, at: PointsLike, medium: Medium) -> NDArray[np.complex64]:
    """Each transducer's wave (m, n) at each point per unit drive, without the phase of its path.

    It is `transfer_matrix`, errors included, without e^{ikr}, as exact as `pressure` in single precision: for waves
    that are not phasors, or whose delay is known more exactly.
    """
    points = as_places(at)
    if (tables := _reaching(array, points, medium)) is not None:
        from .tables import arrivals_at

        return arrivals_at(tables, array, points)
    found = np.empty((len(points), len(array)), dtype=np.complex64)
    at_a_time = max(1, PAIRS_AT_A_TIME // len(array))
    for first in range(0, len(points), at_a_time):
        part = slice(first, first + at_a_time)
        way = np.linalg.norm(points[part, None] - array.positions, axis=2)
        found[part] = _transfer_matrix(array, points[part], medium, first) * np.exp(-1j * medium.wavenumber * way)
    return found


def _reaching(array: TransducerArray, points: NDArray[np.float64], medium: Medium) -> ArrayTables | None:
    """Tables for the compiled kernels if these are exact enough at the distance of the points; checks the points."""
    from .tables import can_reach, farthest_of, tables_of, too_close  # numba takes half a second to import

    tables = tables_of(array, medium)
    if not can_reach(tables, farthest_of(tables, points)):
        return None
    for index in too_close(array, tables, points):
        _check_distance(array, points[index], index)
    return tables


def _check_distance(array: TransducerArray, point: NDArray[np.float64], number: int) -> None:
    """Raise `ValueError` if a point is too close to a transducer."""
    distance = np.linalg.norm(point - array.positions, axis=1)
    if distance.min() < array.transducer.nearest:
        raise ValueError(_too_close(array, point, number, int(distance.argmin()), distance.min()))


def _too_close(
    array: TransducerArray, point: NDArray[np.float64], number: int, transducer: int, distance: float
) -> str:
    model, nearest = array.transducer.model, array.transducer.nearest
    return (
        f"point {number} at {point.tolist()} m is {distance * 1e3:.2f} mm from transducer {transducer}; the model "
        f"{model!r} needs at least {nearest * 1e3:.2f} mm"
    )
