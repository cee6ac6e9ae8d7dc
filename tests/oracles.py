"""Closed forms that several tests compare with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def quantisation_bound(magnitude: ArrayLike) -> NDArray[np.float64]:
    """Largest distance from a drive of this magnitude to its nearest exact pulse.

    Exact pulses form a staggered lattice in polar coordinates. Around magnitude r its cells measure
    d = (π/50)·√(1 − r²) along the radius and t = (π/50)·r across it, and a point of such a lattice is never further
    than (d² + t²)/(2·max(d, t)) from its nearest neighbour. Two per cent are added because the cells are bent.
    """
    r = np.asarray(magnitude, dtype=np.float64)
    side = np.maximum(r, np.sqrt(np.maximum(0.0, 1 - r * r)))
    return np.asarray(1.02 * np.pi / 50 / 2 / side)


def piston_wave(
    kind: str, sine: ArrayLike, distance: ArrayLike, radius: float, wavenumber: float
) -> NDArray[np.complex128]:
    """ψ·r·e^{-ikr} of a disc by one integral along its rim, (...); ``kind`` is rayleigh (RS-II) or rayleigh-1.

    What Stokes' theorem makes of the Rayleigh integrals: the plane wave e^{ikz} where the point is above the disc, and
    a wave from the rim. Over the squared distance to the rim both are singular, their difference is not: with
    e^{ikR} − e^{ikz} = 2i·sin(k(R−z)/2)·e^{ik(R+z)/2} and d² = R² − z² it is exact everywhere above the disc's plane.
    """
    r = np.asarray(distance, dtype=np.float64)[..., None]
    s = np.asarray(sine, dtype=np.float64)[..., None]
    rim = np.cos(np.pi * (np.arange(2000) + 0.5) / 2000)
    z, across = r * np.sqrt(1 - s * s), r * s
    far = np.sqrt(z * z + across**2 + radius**2 - 2 * radius * across * rim)
    lever = radius**2 - radius * across * rim
    difference = wavenumber * np.sinc(wavenumber * (far - z) / 2 / np.pi) / (far + z)  # of the two waves over i·d²
    wave = 1j * difference * np.exp(1j * wavenumber * ((far + z) / 2 - r))
    if kind == "rayleigh-1":
        wave = z / far * wave - np.exp(1j * wavenumber * (z - r)) / (far * (far + z))
    return np.asarray(2 * r[..., 0] / (1j * wavenumber * radius**2) * (wave * lever).mean(axis=-1))
