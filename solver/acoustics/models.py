"""Models of one transducer: its wave as a residual, the factor that remains beside e^{ikr}/r and the strength.

Time factor e^{-iωt}, outgoing wave e^{+ikr}/r, pressure as peak complex amplitude in Pa.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of
from .diffraction import KERNELS, Kernel, face_rings, integrate
from .medium import Medium, as_medium
from .transducer import MODELS, Transducer

__all__ = ["directivity", "residual"]


def residual(
    transducer: Transducer, sine: ArrayLike, distance: ArrayLike, medium: Medium | None = None
) -> NDArray[np.complex128]:
    """The wave ψ of one transducer as ψ·r·e^{-ikr}/P₁, the slow part of it; 1 on the axis far away.

    Parameters
    ----------
    transducer : Transducer
        Its `model` says how.
    sine : (...) float
        sinθ, the sine of the angle off the axis; only the half space in front of it is meant.
    distance : (...) float
        r from the middle of the face, in metres. Rayleigh integrals are accurate to 1e-9 from two radii on, and RS-II
        still to 1 % at one.
    medium : Medium, optional
        The air; 20 °C by default. Absorption is left out.

    Returns
    -------
    (...) complex
        The residual.

    Raises
    ------
    ValueError
        If a sine is not between 0 and 1, or a distance is not positive.
    """
    sine, distance = np.broadcast_arrays(array_of("sine", sine, np.float64), array_of("distance", distance, np.float64))
    if (bad := np.flatnonzero(~((sine >= 0) & (sine <= 1)))).size:
        raise ValueError(f"sine {bad[0]} is {sine.flat[bad[0]]}; it must lie between 0 and 1")
    if (bad := np.flatnonzero(~((distance > 0) & (distance < np.inf)))).size:
        raise ValueError(f"distance {bad[0]} is {distance.flat[bad[0]]} m; it must be positive and finite")
    return WAVES[transducer.model](transducer, sine, distance, as_medium(medium))


def directivity(sine: ArrayLike, radius: float, medium: Medium) -> NDArray[np.float64]:
    """Far-field directivity of a baffled piston of a radius in metres, D = 2·J₁(ka·sinθ)/(ka·sinθ); 1 on the axis."""
    argument = medium.wavenumber * radius * np.asarray(sine, dtype=np.float64)
    small = np.abs(argument) < 1e-8
    safe = np.where(small, 1.0, argument)
    return np.asarray(np.where(small, 1.0, 2 * scipy.special.j1(safe) / safe))


def _monopole(
    _transducer: Transducer, sine: NDArray[np.float64], _distance: NDArray[np.float64], _medium: Medium
) -> NDArray[np.complex128]:
    return np.ones(sine.shape, dtype=np.complex128)


def _piston(
    transducer: Transducer, sine: NDArray[np.float64], _distance: NDArray[np.float64], medium: Medium
) -> NDArray[np.complex128]:
    return directivity(sine, transducer.radius, medium).astype(np.complex128)


def _rayleigh(
    kernel: Kernel, transducer: Transducer, sine: NDArray[np.float64], distance: NDArray[np.float64], medium: Medium
) -> NDArray[np.complex128]:
    rings = face_rings(transducer.face, medium.wavenumber)
    smooth = integrate(kernel, rings, sine.ravel() ** 2, 1 / distance.ravel(), medium.wavenumber)
    return np.asarray(smooth.reshape(sine.shape) * kernel.front(sine, distance))


Model = Callable[[Transducer, NDArray[np.float64], NDArray[np.float64], Medium], NDArray[np.complex128]]

WAVES: dict[str, Model] = dict(
    zip(MODELS, (_monopole, _piston, *(partial(_rayleigh, kernel) for kernel in KERNELS.values())), strict=True)
)
