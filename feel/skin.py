"""Skin as a viscoelastic half-space: its displacement under a pressure that changes in space and time.

This is Lamb's problem, solved in the domain of wavenumber and frequency: a normal pressure p·e^{i(k·x−ωt)} on the surface
z = 0 of a body moves it by u = H(k, ω)·p into the body, with (H. Lamb, Phil. Trans. R. Soc. A 203, 1904; K. F. Graff,
Wave Motion in Elastic Solids, 1975, section 6.2)

    H = −k_T²·α/(μ·R),  R = (2k² − k_T²)² − 4k²·α·β,  α² = k² − k_L²,  β² = k² − k_T²

and k_T² = ρω²/μ, k_L² = k_T²·(1 − 2ν)/(2 − 2ν). The zero of R is the surface wave. Losses make the shear modulus μ
complex. In the limit ω → 0 it is Boussinesq's H = (1 − ν)/(μk). Time factor e^{−iωt}, so losses have Im μ < 0.

Left out: layers, so also the waves that bones guide; the borders of a finger; that skin is stretched, and stiffer along
its lines; forces along the surface; large strains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

__all__ = ["MOST_HZ", "Skin", "displacement"]

MOST_HZ = 800.0
"""Highest frequency that counts: no channel of touch is known above it."""
MARGIN = 0.12
"""Metres of free skin around a grid, in which waves fade before they come round."""
NEGLIGIBLE = 1e-4
"""A frequency is skipped if its pressure is below this part of the strongest frequency's, both summed over the places."""
FREQUENCIES_AT_A_TIME = 64
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Skin:
    """A half-space with the shear modulus μ = stiffness − iω·viscosity, of Kelvin and Voigt; by default a hand's.

    Parameters
    ----------
    stiffness : float
        Static shear modulus, in Pa.
    viscosity : float
        Of shear, in Pa·s.
    density : float
        In kg/m³.
    poisson : float
        Poisson's ratio ν. Tissue is so hard to compress that it is 1/2 in all but the fifth digit.

    Raises
    ------
    ValueError
        If a number is out of range.

    Notes
    -----
    The stiffness makes surface waves of 7 m/s, at which they plateau on a fingertip by laser vibrometry (Manfredi et
    al., PLoS ONE 7, e31203, 2012). The viscosity is that of `forearm`: none was found for the hand.
    """

    stiffness: float = 59e3
    viscosity: float = 5.03
    density: float = 1100.0
    poisson: float = 0.5

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, unit in (("stiffness", "Pa"), ("density", "kg/m³")):
            if not 0 < (value := getattr(self, name)) < math.inf:
                raise ValueError(f"skin {name} {value} {unit} must be positive and finite")
        if not 0 <= self.viscosity < math.inf:
            raise ValueError(f"skin viscosity {self.viscosity} Pa·s must be finite and not negative")
        if not 0 <= self.poisson <= 0.5:
            raise ValueError(f"skin poisson {self.poisson} must lie between 0 and 0.5")

    @classmethod
    def forearm(cls) -> Self:
        """Healthy skin of the forearm: Zhang et al., Med. Eng. Phys. 33, 31, 2011, from surface waves of 100 to 400 Hz."""
        return cls(stiffness=7.86e3, viscosity=5.03)

    def modulus(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Complex shear modulus at frequencies in hertz, (...) Pa."""
        return np.asarray(self.stiffness - 2j * np.pi * np.asarray(frequency) * self.viscosity)

    def response(self, wavenumber: ArrayLike, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Normal displacement of the surface, into the body, per normal pressure on it.

        Parameters
        ----------
        wavenumber : (...) float
            Along the surface, in rad/m, not negative.
        frequency : (...) float
            In hertz, not negative; the two are broadcast.

        Returns
        -------
        (...) complex
            In m/Pa; infinite where both are 0, because a steady pressure on all of the surface moves the body away.
        """
        k, f = np.asarray(wavenumber, dtype=np.float64), np.asarray(frequency, dtype=np.float64)
        mu = self.modulus(f)
        shear = self.density * (2 * np.pi * f) ** 2 / mu  # k_T²
        along = k**2
        # −i·√(k_T² − k²) has a positive real part, or it is a wave that leaves the surface.
        alpha, beta = (-1j * np.sqrt(part * shear - along + 0j) for part in (self._bulk, 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            moving = -shear * alpha / (mu * ((2 * along - shear) ** 2 - 4 * along * alpha * beta))
            static = (1 - self.poisson) / (self.stiffness * k)
        return np.asarray(np.where(f > 0, moving, static))

    @property
    def _bulk(self) -> float:
        """(c_T/c_L)², which is k_L²/k_T²."""
        return (1 - 2 * self.poisson) / (2 - 2 * self.poisson)

    def surface_wavenumber(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Complex wavenumber of the surface wave, Rayleigh's, (...) rad/m: its imaginary part is the decay in Np/m.

        Notes
        -----
        With ξ = (c/c_T)² it is the root of ξ³ − 8ξ² + (24 − 16b)ξ − 16(1 − b) = 0, b = (c_T/c_L)², that lies between 0
        and 1 (Rayleigh, Proc. London Math. Soc. 17, 1885).
        """
        roots = np.roots([1, -8, 24 - 16 * self._bulk, -16 * (1 - self._bulk)])
        squared = float(min(root.real for root in roots if abs(root.imag) < 1e-9))
        angular = 2 * np.pi * np.asarray(frequency, dtype=np.float64)
        return np.asarray(angular * np.sqrt(self.density / (self.modulus(frequency) * squared)))

    def surface_speed(self, frequency: ArrayLike) -> NDArray[np.float64]:
        """Phase speed of the surface wave at frequencies above 0, (...) m/s."""
        return np.asarray(2 * np.pi * np.asarray(frequency) / self.surface_wavenumber(frequency).real)

    def shear_speed(self, frequency: ArrayLike) -> NDArray[np.float64]:
        """Phase speed of shear waves within the body at frequencies in hertz, (...) m/s."""
        return np.asarray(1 / np.sqrt(self.density / self.modulus(frequency)).real)


def displacement(
    skin: Skin, pressure: ArrayLike, rate: float, spacing: float, margin: float = MARGIN
) -> NDArray[np.float64]:
    """How a pressure over a regular grid, on an endless skin, moves its surface.

    Parameters
    ----------
    skin : Skin
        What it pushes.
    pressure : (t, y, x) float
        Normal pressure over one period of a stimulus that repeats, in Pa. A stimulus that does not repeat ends in
        silence, in which the waves fade.
    rate : float
        Of samples in time, in hertz.
    spacing : float
        Of the grid, in metres.
    margin : float
        Width of the free skin around the grid, in metres, in which waves must fade before they come round.

    Returns
    -------
    (t, y, x) float
        Displacement into the body, in metres, of all frequencies up to half the rate.
    """
    pressure = np.asarray(pressure, dtype=np.float64)
    spectra = scipy.fft.rfft(pressure, axis=0)
    frequencies = np.arange(len(spectra)) * rate / len(pressure)
    moved = displaced(skin, spectra, frequencies, spacing, margin)
    return np.asarray(scipy.fft.irfft(moved, len(pressure), axis=0))


def displaced(
    skin: Skin, spectra: NDArray[np.complexfloating], frequencies: NDArray[np.float64], spacing: float, margin: float
) -> NDArray[np.complexfloating]:
    """The complex amplitudes (f, y, x) of displacement, in metres, that those of pressure, in Pa, make.

    Notes
    -----
    A convolution by FFT. The sample at k = 0 stands for the cell of wavenumbers around it and is the mean of H over a
    disc of its area: so the steady displacement is finite, and that of slow pressures is right although H is steep there.
    """
    rows, columns = (scipy.fft.next_fast_len(count + math.ceil(margin / spacing)) for count in spectra.shape[1:])
    steps_y, steps_x = (2 * np.pi * np.fft.fftfreq(count, spacing) for count in (rows, columns))
    wavenumbers, places = np.unique(np.hypot(steps_y[:, None], steps_x).round(6), return_inverse=True)
    radius = 2 * math.sqrt(math.pi / (rows * columns)) / spacing
    inner = radius * (_NODES + 1) / 2
    moved = np.empty_like(spectra)
    for first in range(0, len(spectra), FREQUENCIES_AT_A_TIME):
        part = slice(first, first + FREQUENCIES_AT_A_TIME)
        each = frequencies[part, None]
        response = np.empty((len(each), len(wavenumbers)), dtype=spectra.dtype)
        response[:, 1:] = skin.response(wavenumbers[1:], each)
        response[:, 0] = skin.response(inner, each) @ (_WEIGHTS * inner) / radius
        padded = scipy.fft.fft2(spectra[part], (rows, columns), workers=-1)
        padded *= response[:, places.reshape(rows, columns)]
        moved[part] = scipy.fft.ifft2(padded, workers=-1)[:, : spectra.shape[1], : spectra.shape[2]]
    return moved
