"""Skin as a viscoelastic half-space: its displacement under a pressure that changes in space and time.

This is Lamb's problem, solved in the domain of wavenumber and frequency: a normal pressure p·e^{i(k·x−ωt)} on the
surface of a body moves it by u = H(k, ω)·p into the body, with (H. Lamb, Phil. Trans. R. Soc. A 203, 1, 1904; K. F.
Graff, Wave Motion in Elastic Solids, 1975, chapter 6)

    H = −k_T²·α/(μ·R),  R = (2k² − k_T²)² − 4k²·α·β,  α² = k² − k_L²,  β² = k² − k_T²

and k_T² = ρω²/μ, k_L² = k_T²·(1 − 2ν)/(2 − 2ν). The zero of R is the surface wave. Losses make the shear modulus μ
complex. In the limit ω → 0 it is Boussinesq's H = (1 − ν)/(μk). Time factor e^{−iωt}, so losses have Im μ < 0.

Left out: layers and bones, and the resonance that they make; the borders of a finger; that skin is stretched, and
stiffer along its lines; forces along the surface; large strains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self, TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import array_of, as_frequencies, real, shown

__all__ = ["MOST_HZ", "Skin", "displacement"]

MOST_WAVENUMBER = 1e9  # rad/m
MOST_HZ = 800.0
"""Highest frequency that counts: no channel of touch is known above it."""
NEGLIGIBLE = 1e-5
"""A frequency is skipped if its pressure, summed over the places, is below this part of the strongest frequency's."""
FREQUENCIES_AT_A_TIME = 256
RANGES = (("stiffness", 1e12, "Pa"), ("viscosity", 1e9, "Pa·s"), ("density", 1e6, "kg/m³"), ("poisson", 0.5, ""))
DEPTH, NODES_PER_TURN, BEYOND = 4.0, 3.0, 1.2
"""Of an integral over wavenumbers: its depth below the real axis times the reach, its nodes for each turn of the
integrand, and its end as a part of the grid's largest wavenumber. Without any loss it is then right to 1e-5."""
Wave = TypeVar("Wave", np.complex64, np.complex128)


@dataclass(frozen=True)
class Skin:
    """A half-space with the shear modulus μ = stiffness − iω·viscosity, of Kelvin and Voigt; by default a hand's.

    Parameters
    ----------
    stiffness : float
        Static shear modulus, in Pa.
    viscosity : float
        Shear viscosity in Pa·s.
    density : float
        Density in kg/m³.
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
        for name, most, unit in RANGES:
            value = real(f"skin {name}", getattr(self, name), 0, most, unit, above=name in ("stiffness", "density"))
            object.__setattr__(self, name, value)

    @classmethod
    def forearm(cls) -> Self:
        """Skin of healthy forearms, by surface waves of 100 to 400 Hz: Zhang et al., Med. Eng. Phys. 33, 31, 2011."""
        return cls(stiffness=7.86e3, viscosity=5.03)

    def modulus(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Complex shear modulus at frequencies in hertz, (...) Pa."""
        return np.asarray(self.stiffness - 2j * np.pi * as_frequencies(frequency) * self.viscosity)

    def response(self, wavenumber: ArrayLike, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Normal displacement of the surface, into the body, per normal pressure on it.

        Parameters
        ----------
        wavenumber : (...) float or complex
            Wavenumber along the surface in rad/m, at least 0. H continues to those with a negative imaginary part.
        frequency : (...) float
            Frequency in hertz, not negative; the two are broadcast.

        Returns
        -------
        (...) complex
            H in m/Pa; infinite where both are 0, because a steady pressure on all of the surface moves the body away.
        """
        k, f = array_of("wavenumber", wavenumber, np.complex128), as_frequencies(frequency)
        if not np.abs(k).max(initial=0) < MOST_WAVENUMBER:
            raise ValueError(f"wavenumber {shown(wavenumber)} rad/m must be finite and below {MOST_WAVENUMBER:g}")
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
        angular = 2 * np.pi * as_frequencies(frequency)
        return np.asarray(angular * np.sqrt(self.density / (self.modulus(frequency) * squared)))

    def surface_speed(self, frequency: ArrayLike) -> NDArray[np.float64]:
        """Phase speed of the surface wave at frequencies above 0, (...) m/s."""
        return np.asarray(2 * np.pi * as_frequencies(frequency, above=True) / self.surface_wavenumber(frequency).real)

    def shear_speed(self, frequency: ArrayLike) -> NDArray[np.float64]:
        """Phase speed of shear waves within the body at frequencies in hertz, (...) m/s."""
        return np.asarray(1 / np.sqrt(self.density / self.modulus(frequency)).real)


def displacement(skin: Skin, pressure: ArrayLike, rate: float, spacing: float) -> NDArray[np.float64]:
    """Displacement (t, y, x) into the body, in metres, of an endless skin under a pressure (t, y, x) in Pa over a grid.

    The pressure is that of one period of a stimulus that repeats; one that does not must end in silence, in which the
    waves leave. ``rate`` is the number of samples in a second, ``spacing`` the grid's step in metres. All frequencies
    up to half the rate are counted.
    """
    pressure = np.asarray(pressure, dtype=np.float64)
    spectra = scipy.fft.rfft(pressure, axis=0).conj()  # SciPy's factor of time is e^{+iωt}
    moved = displaced(skin, spectra, np.arange(len(spectra)) * rate / len(pressure), spacing)
    return np.asarray(scipy.fft.irfft(moved.conj(), len(pressure), axis=0))


def displaced(skin: Skin, spectra: NDArray[Wave], frequencies: NDArray[np.float64], spacing: float) -> NDArray[Wave]:
    """The complex amplitudes (f, y, x) of displacement, in metres, that those of pressure, in Pa, make.

    A convolution by FFT with the displacement around a point, cut off beyond the diagonal of the grid: so nothing
    comes round, however far waves go (Vico, Greengard and Ferrando, J. Comput. Phys. 323, 191, 2016).
    """
    rows, columns = spectra.shape[1:]
    reach = math.hypot(rows, columns)
    size = scipy.fft.next_fast_len(max(rows, columns) + math.ceil(reach))
    along = 2 * np.pi * np.fft.fftfreq(size, spacing)
    wavenumbers, cells = np.unique(np.hypot(along[:, None], along).round(6), return_inverse=True)
    cut_off = _CutOff.at(reach * spacing, wavenumbers)
    moved = np.empty_like(spectra)
    for first in range(0, len(spectra), FREQUENCIES_AT_A_TIME):
        response = cut_off.response(skin, frequencies[first : first + FREQUENCIES_AT_A_TIME]).astype(spectra.dtype)
        for index, each in enumerate(response, first):  # a wave fits a processor's cache
            wave = scipy.fft.fft(scipy.fft.fft(spectra[index], size, axis=1), size, axis=0)
            wave *= each[cells].reshape(size, size)
            moved[index] = scipy.fft.ifft(scipy.fft.ifft(wave, axis=0)[:rows], axis=1)[:, :columns]
    return moved


class _CutOff(NamedTuple):
    """The response of a skin on which nothing moves beyond a distance R from the point that is pushed.

    With the displacement G(r) around a point, the inverse transform of H, it is ∫₀^R G(r)·J₀(kr)·2πr dr. The part of H
    that falls slowly, (1 − ν)/(μk), is taken apart and transformed in closed form:

        H_R(k) = (1 − ν)/μ·∫₀^R J₀(kr) dr + ∫ (H(q) − (1 − ν)/(μq))·q·W(k, q) dq,
        W = ∫₀^R J₀(kr)·J₀(qr)·r dr = R·(k·J₁(kR)·J₀(qR) − q·J₀(kR)·J₁(qR))/(k² − q²)

    The path of q runs below the real axis, where H is smooth: its pole, the surface wave, and its branch points are on
    the axis or above.
    """

    nodes: NDArray[np.complex128]
    steady: NDArray[np.float64]
    weights: NDArray[np.complex64]

    @classmethod
    def at(cls, reach: float, wavenumbers: NDArray[np.float64]) -> Self:
        """For (k,) wavenumbers, in rad/m, and a distance in metres."""
        depth, end = DEPTH / reach, BEYOND * float(wavenumbers.max())
        t, share = np.polynomial.legendre.leggauss(64 + math.ceil(NODES_PER_TURN * end * reach / (2 * np.pi)))
        x = end * (t + 1) / 2
        q = x - 1j * depth * x / (x + depth)
        step = share * end / 2 * (1 - 1j * (depth / (x + depth)) ** 2)
        k, kr, qr = wavenumbers[:, None], wavenumbers[:, None] * reach, q * reach
        bessel = scipy.special
        both = k * bessel.j1(kr) * bessel.jv(0, qr) - q * bessel.j0(kr) * bessel.jv(1, qr)
        weights = both * (reach * q * step) / (k**2 - q**2)
        steady = np.full(len(wavenumbers), reach)
        np.divide(bessel.itj0y0(kr[:, 0])[0], wavenumbers, out=steady, where=wavenumbers > 0)
        return cls(q, steady, weights.T.astype(np.complex64))

    def response(self, skin: Skin, frequencies: NDArray[np.float64]) -> NDArray[np.complexfloating]:
        """(f, k) in m/Pa."""
        each = frequencies[:, None]
        soft = (1 - skin.poisson) / skin.modulus(each)
        moving = (skin.response(self.nodes, each) - soft / self.nodes).astype(np.complex64) @ self.weights
        return np.asarray(soft * self.steady + moving)
