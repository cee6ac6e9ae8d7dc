"""Waves over time at a few places, such as ears: the sum over the transducers, each a delay ago."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import array_of
from ..solver import Medium, TransducerArray, transfer_matrix
from ..solver.acoustics.models import directivity
from ..solver.acoustics.resonator import Resonator
from ..solver.geometry import PointsLike, as_places

__all__ = ["arriving", "as_waves", "behind", "responses"]


LARGEST = 1e12
"""Of waves, to that of full drive: their squares fit single precision."""


def _is_single(waves: ArrayLike) -> bool:
    return isinstance(waves, np.ndarray) and waves.dtype == np.complex64


def as_waves(array: TransducerArray, waves: ArrayLike, name: str = "waves") -> NDArray[np.complex64]:
    """A series for each transducer, (t, n); `ValueError` if it is none, has no rows, or is not finite."""
    series = np.ascontiguousarray(waves if _is_single(waves) else array_of(name, waves, np.complex64))
    if series.ndim != 2 or series.shape[1] != len(array) or not len(series):
        raise ValueError(
            f"{name} have the shape {series.shape}; (t, {len(array)}) is needed, a row for each carrier period and "
            "a column for each transducer"
        )
    if not np.abs(series.view(np.float32)).max() <= LARGEST:
        raise ValueError(f"{name} must be at most {LARGEST:g} times full drive, but some are not")
    return series


def behind(array: TransducerArray, at: PointsLike) -> NDArray[np.bool_]:
    """Whether each place is beside or behind the baffle of each transducer, (j, n)."""
    offset = as_places(at)[:, None] - array.positions
    return np.asarray(np.einsum("jnk,nk->jn", offset, array.normals) <= 0)


def responses(array: TransducerArray, at: PointsLike, medium: Medium) -> NDArray[np.complex128]:
    """Pressure at each place per unit drive of each transducer, (j, n), and never 0 because of a baffle.

    The models are of pistons in an endless baffle, behind which there is nothing (`transfer_matrix`). Real housings let
    sound around them, less the further it turns. So beside and behind a transducer its wave is taken as strong as that
    of a baffled piston at 90°, at the same distance. It is a bound as far as the piston goes; sound that housings,
    table or room reflect is left out.
    """
    points = as_places(at)
    matrix = transfer_matrix(array, points, medium)
    hidden = behind(array, points)
    if hidden.any():
        transducer = array.transducer
        grazing = 1.0 if transducer.model == "monopole" else float(directivity(1.0, transducer.reach, medium))
        distance = np.linalg.norm(points[:, None] - array.positions, axis=2)
        travelled = np.exp((1j * medium.wavenumber - medium.attenuation) * distance) / distance
        bound = transducer.strength * transducer.polarity * array.response * grazing * travelled
        matrix = np.where(hidden, bound, matrix)
    return np.asarray(matrix)


def arriving(array: TransducerArray, waves: ArrayLike, at: PointsLike, medium: Medium) -> NDArray[np.complex64]:
    """Pressure phasors (j, t) at places (j, 3) over time: peak Pa at the beginning of each period of the carrier.

    ``waves`` (t, n) are the phasors that the transducers emit at the beginning of each period. They are taken to
    repeat, so that their end is still on its way when they begin. Raises what `transfer_matrix` raises, and
    `ValueError` for waves of another shape.

    Between two periods the wave moves as a resonance does under a constant drive (`OnePole.between`), so nothing is
    interpolated as long as drives change at the beginning of a period.
    """
    from .arriving_kernels import collect  # importing numba takes half a second

    series, points = as_waves(array, waves), as_places(at)
    delay = np.linalg.norm(points[:, None] - array.positions, axis=2) / medium.wavelength
    whole = np.ceil(delay).astype(np.int64)
    resonance = Resonator.of(array.transducer).enveloped(medium.frequency, 1 / medium.frequency)
    ahead = resonance.between(whole - delay)
    response = responses(array, points, medium)
    lag = np.concatenate([whole, whole - 1])
    weight = np.concatenate([response * (1 - ahead), response * ahead]).astype(np.complex64)
    row = np.tile(np.arange(len(points))[:, None], (2, len(array)))
    collected = np.empty((len(points), len(series)), np.complex64)
    collect(series, lag, weight, row, collected)
    return collected
