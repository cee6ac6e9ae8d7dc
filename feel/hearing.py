"""The audible sound of an array: what its outputs emit below 20 kHz, and what air makes of the beam's power.

Ultrasound itself is not heard, but two things are.

*Linear*: a square wave between 0 and 15 V has a mean, its duty, and a place in its period. If these change, its
spectrum reaches below 20 kHz, and the transducer emits it, weakly, far below its resonance.

*Demodulated*: air is not linear. A wave p₁ is a source of sound of the frequencies of p₁² (P. J. Westervelt, J. Acoust.
Soc. Am. 35, 535, 1963): □p₂ = −(β/(ρc⁴))·∂²p₁²/∂t². If the power of the beam changes 200 times a second, the air in it
is a loudspeaker. That a switch of phases lets the amplitude of a resonance dip is enough.

Left out, with their size: skin that moves by 1 to 3 µm over 1 cm² at 200 Hz radiates 0 to 10 dB SPL at 0.6 m. The beam
after it met a hand may be as loud as before. The radiation pressure of ultrasound on the eardrum itself, p²/(ρc²) of
the peak p, sounds like up to 23 dB SPL if 110 dB of ultrasound are switched on and off, and like 71 dB at 134 dB: how
much of it gets through the ear canal is not known. Distortion within transducers is not published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import as_frequencies, length, whole
from ..solver import Medium, TransducerArray
from ..solver.acoustics.medium import as_medium
from ..solver.acoustics.resonator import Resonator
from ..solver.fields.quantities import REFERENCE
from ..solver.fields.validity import NONLINEARITY, aperture_radius
from ..solver.geometry import PointsLike, as_places
from .arriving import as_waves
from .power import power_over_time

__all__ = ["PARTS", "REACH", "Audible", "a_weighting", "audible", "square_pulses"]

LOWEST, HIGHEST = 20.0, 20_000.0  # Hz
POLES = (20.598997, 107.65265, 737.86223, 12194.217)  # Hz
AT_1_KHZ = -1.9997  # dB
REACH = 0.2
"""Length of the beam in metres, up to the hand that stops it."""
PARTS = ("linear", "demodulated")
FRACTIONS = 8  # of a period, to which a delay is rounded
NODES = 64  # of the integral along the beam
RESOLVED = 20.0  # Hz: the integral, which is smooth, is computed so often


def a_weighting(frequency: ArrayLike) -> NDArray[np.float64]:
    """The A-weighting in dB of frequencies in hertz, (...), at least 0 (IEC 61672-1:2013, annex E); −∞ at 0."""
    squared = as_frequencies(frequency) ** 2
    first, second, third, fourth = (pole**2 for pole in POLES)
    with np.errstate(divide="ignore"):
        response = np.log10(fourth * squared**2) - np.log10(
            (squared + first) * np.sqrt((squared + second) * (squared + third)) * (squared + fourth)
        )
    return np.asarray(20 * response - AT_1_KHZ)


def square_pulses(drives: ArrayLike) -> NDArray[np.complex64]:
    """Duty and moment of the pulses of intended drives, (t, n), as `hil.EmittedWaves.pulses` has them from bits.

    A drive a·e^{iθ} is a pulse of the duty d = arcsin(a)/π around the moment θ/2π of the period. What reaches beyond an
    end of the period is high at its other end.
    """
    drives = np.asarray(drives)
    duty = np.arcsin(np.minimum(np.abs(drives), 1)) / np.pi
    centre = np.angle(drives) / (2 * np.pi) % 1
    early, late = np.maximum(duty / 2 - centre, 0), np.maximum(centre + duty / 2 - 1, 0)
    return np.asarray(duty + 1j * (duty * (centre - 0.5) + early - late), np.complex64)


@dataclass(frozen=True, eq=False)
class Audible:
    """Sound between 20 Hz and 20 kHz at places.

    Parameters
    ----------
    linear, demodulated : (j, t) float
        Both parts over time, in Pa.
    rate : float
        Samples per second, one for each carrier period.
    """

    linear: NDArray[np.float64]
    demodulated: NDArray[np.float64]
    rate: float

    @property
    def pressure(self) -> NDArray[np.float64]:
        """Both together over time, (j, t) in Pa, if a transducer moves in phase with its voltage at resonance."""
        return self.linear + self.demodulated

    def spectrum(self, part: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Frequencies in Hz, (f,), and the mean squares at each, (j, f) in Pa², of a part of `PARTS`.

        Notes
        -----
        A Hann window, whose power is taken out again, so that neither the ends of the series nor a cycle that is cut
        off are heard as clicks. A tone spreads over three neighbours, which add up to its mean square.
        """
        series = getattr(self, part)
        window = scipy.signal.get_window("hann", series.shape[1])
        squares = np.abs(scipy.fft.rfft(series * window)) ** 2 * 2 / (series.shape[1] * np.sum(window**2))
        return np.asarray(scipy.fft.rfftfreq(series.shape[1], 1 / self.rate)), np.asarray(squares)

    def weighted(self, part: str) -> NDArray[np.float64]:
        """The A-weighted level of a part at each place, (j,) in dB re 20 µPa."""
        frequency, squares = self.spectrum(part)
        heard = (frequency >= LOWEST) & (frequency <= HIGHEST)
        return _decibels(squares[:, heard] @ 10 ** (a_weighting(frequency[heard]) / 10))

    @property
    def levels_dba(self) -> NDArray[np.float64]:
        """The A-weighted level of all parts, (j,) in dB re 20 µPa. Their powers add up: their phases are not known."""
        with np.errstate(divide="ignore"):
            return np.asarray(10 * np.log10(sum(10 ** (self.weighted(part) / 10) for part in PARTS)))

    def record(self) -> dict[str, list[float | None]]:
        """Its levels at each place for JSON, in dB(A); None for silence."""
        levels = {"dba": self.levels_dba} | {f"{part}_dba": self.weighted(part) for part in PARTS}
        return {name: [float(each) if np.isfinite(each) else None for each in of] for name, of in levels.items()}

    def strongest(self, place: int, count: int = 5) -> list[tuple[float, str, float]]:
        """The loudest tones at a place: frequency in Hz, part, and A-weighted level in dB, the loudest first."""
        place = whole("place", place, 0, len(self.linear) - 1)
        found, count = [], whole("count", count, 0, self.linear.shape[1])
        for part in PARTS:
            frequency, squares = self.spectrum(part)
            tones = np.convolve(squares[place], np.ones(3), "same")
            levels = _decibels(tones) + a_weighting(frequency)
            peaks, _ = scipy.signal.find_peaks(levels, distance=3)
            found += [(float(frequency[k]), part, float(levels[k])) for k in peaks if LOWEST <= frequency[k] <= HIGHEST]
        return sorted(found, key=lambda tone: -tone[2])[:count]

    def __str__(self) -> str:
        loudest = int(self.levels_dba.argmax())
        if not np.isfinite(self.levels_dba[loudest]):
            return "nothing is heard"
        parts = ", ".join(f"{part} {self.weighted(part)[loudest]:.0f}" for part in PARTS)
        return f"{self.levels_dba[loudest]:.0f} dB(A) at the loudest place: {parts}"


def audible(
    array: TransducerArray,
    waves: ArrayLike,
    pulses: ArrayLike | None,
    at: PointsLike,
    medium: Medium | None = None,
    reach: float = REACH,
) -> Audible:
    """The audible sound of an array at places.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    waves : (t, n) complex
        The phasor that each emits at the beginning of each carrier period. They are taken to repeat: give whole cycles
        of what repeats, or a second of what does not.
    pulses : (t, n) complex or None
        Duty and moment of each square wave (`hil.EmittedWaves.pulses`, `square_pulses`); without them there is no
        linear part.
    at : (j, 3) float
        Places, in metres; within the beam the demodulated part is that of its edge.
    medium : Medium, optional
        The air; its frequency is the carrier's.
    reach : float
        Length of the beam, in metres.

    Returns
    -------
    Audible

    Raises
    ------
    ValueError
        If a series has another shape, or the reach is not positive.

    Notes
    -----
    Linear: a pulse of duty d is x = (π/2)·d times a full drive, and the far field P₁/r times x·(f/f₀)·H(f), the
    response of the resonance, and f/f₀ because it follows the piston's acceleration. A piston so small sends low sound
    alike in all directions, and around its housing too. The outputs' high level is 15 V. A voltage that is high at the
    part s of a period T counts e^{iωTs}; the straight line in s that fits it best over a period needs duty and moment
    only. Against the transform of every edge that costs 5 % up to 5 kHz, 15 % up to 10 kHz, and about 1 dB of the
    level. Delays are rounded to 1/8 of a period.

    Demodulated: the beam carries the power W(t) along the array's mean normal, spread over a disc of its
    `aperture_radius` a. With p₁² = ρc·W over its section, Westervelt's sources, s along the axis and R from there, give

        p₂ = β/(4πc³)·∂²/∂t² ∫₀^reach W(t − (s + R)/c)/R·D ds,  D = 2J₁(x)/x, x = (ωa/c)·sin(angle off the axis)

    The integral over all sources of the computed field, up to the same reach, is the judge: for the two halves of a
    circle of 10 cm that alternate, all strong tones up to 2 kHz agree within 2 dB, and the level within 1.5 dB; for an
    array of 8 × 8 this model is up to 4 dB above it at 1.6 kHz. Without a hand that ends the beam the integral is 2 dB
    higher. On a ray, the spherical solution of Burgers' equation, p₂ = β/(4ρc³)·r·ln(r/r₀)·∂|p|²/∂t, was 12 to 16 dB
    too high: it takes the field at an ear for as wide as the audible wave, while it is a pattern of narrow lobes.
    """
    medium, points = as_medium(medium), as_places(at)
    emitted = as_waves(array, waves)
    reach = length("reach", reach)
    steps = len(emitted)
    frequency = np.asarray(scipy.fft.rfftfreq(steps, 1 / medium.frequency))
    heard = (frequency >= LOWEST) & (frequency <= HIGHEST)
    linear = np.zeros((len(points), len(frequency)), np.complex128)
    if pulses is not None:
        linear = _arriving_pulses(array, as_waves(array, pulses, "pulses"), points, medium, frequency)
        # The resonance's time factor is e^{-iωt}, that of the transform e^{+iωt}.
        linear *= np.conj(Resonator.of(array.transducer).responses(frequency)) * 1j * frequency / medium.frequency
    coarse = np.arange(0, medium.frequency / 2 + RESOLVED, RESOLVED)
    spectrum = scipy.fft.rfft(power_over_time(array, emitted, medium))
    factor = -NONLINEARITY / (4 * math.pi * medium.speed_of_sound**3) * (2 * np.pi * frequency) ** 2
    along = np.stack([np.interp(frequency, coarse, row) for row in _beam(array, points, medium, reach, coarse)])
    late = np.linalg.norm(points - array.positions.mean(axis=0), axis=1)[:, None] / medium.speed_of_sound
    along *= np.exp(-2j * np.pi * frequency * late)  # not interpolated: far away it turns fast
    low, made = (scipy.fft.irfft(np.where(heard, part, 0), steps) for part in (linear, spectrum * factor * along))
    return Audible(np.asarray(low), np.asarray(made), medium.frequency)


def _arriving_pulses(
    array: TransducerArray,
    pulses: NDArray[np.complex64],
    points: NDArray[np.float64],
    medium: Medium,
    frequency: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Spectrum of the drive that arrives as pressure at full drive, (j, f) with e^{+iωt}, before any resonance."""
    from .arriving_kernels import collect  # importing numba takes half a second

    distance = np.linalg.norm(points[:, None] - array.positions, axis=2)
    delay = np.rint(FRACTIONS * distance / medium.wavelength).astype(np.int64)
    lag = -(-delay // FRACTIONS)
    sign = array.transducer.polarity * np.where(array.response.real < 0, -1, 1)
    weight = math.pi / 2 * array.transducer.strength * sign * np.abs(array.response) / distance
    row = np.arange(len(points))[:, None] * FRACTIONS + lag * FRACTIONS - delay
    collected = np.empty((len(points) * FRACTIONS, len(pulses)), np.complex64)
    collect(pulses, lag, weight.astype(np.complex64), row, collected)
    duty, moment = (
        scipy.fft.rfft(part).reshape(len(points), FRACTIONS, -1) for part in (collected.real, collected.imag)
    )
    half = np.maximum(np.pi * frequency / medium.frequency, 1e-9)  # of the angle by which the sound turns in a period
    level, slope = np.sin(half) / half, 6 * (np.sin(half) - half * np.cos(half)) / half**2
    ahead = np.exp(2j * half * np.arange(FRACTIONS)[:, None] / FRACTIONS)
    return np.asarray(np.einsum("jaf,af->jf", duty * level - 1j * slope * moment, ahead) * np.exp(-1j * half))


def _beam(
    array: TransducerArray, points: NDArray[np.float64], medium: Medium, reach: float, frequency: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """The integral along the beam of e^{−iω(s + R − R₀)/c}·D/R, (j, f); R₀ is the distance from the array's middle."""
    normal = array.normals.mean(axis=0)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
    offset, radius = points - array.positions.mean(axis=0), aperture_radius(array)
    height = offset @ normal
    aside = np.maximum(np.linalg.norm(offset - np.outer(height, normal), axis=1), radius)
    late = np.linalg.norm(offset, axis=1)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    at = (nodes + 1) * reach / 2
    distance = np.hypot(aside[:, None], height[:, None] - at)
    wavenumber = 2 * np.pi * frequency[:, None, None] / medium.speed_of_sound
    argument = np.maximum(wavenumber * radius * aside[:, None] / distance, 1e-9)
    spread = 2 * scipy.special.j1(argument) / argument
    waves = np.exp(-1j * wavenumber * (at + distance - late[:, None])) * spread / distance
    return np.asarray((waves @ weights).T * reach / 2)


def _decibels(squares: ArrayLike) -> NDArray[np.float64]:
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(np.asarray(squares) / REFERENCE**2))
