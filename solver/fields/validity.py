"""Where the linear model ends: shocks at a focus, the pressure that no drive exceeds, and the wind that sound makes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..acoustics.array import TransducerArray
from ..acoustics.medium import DECIBELS_PER_NEPER, Medium, as_medium
from .quantities import air_density, intensity, sound_pressure_level

__all__ = ["NONLINEARITY", "Validity", "aperture_radius", "fundamental", "shock_distance", "validity"]

NONLINEARITY = 1.2  # β = (γ + 1)/2 of air
QUASI_LINEAR, STRONG = 0.5, 1.5  # distortion parameter, IEC 61949:2007


def aperture_radius(array: TransducerArray) -> float:
    """Radius of the disc with the array's mean square distance from its mean normal, in metres."""
    offset = array.positions - array.positions.mean(axis=0)
    normal = array.normals.mean(axis=0)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
    across = offset - np.outer(offset @ normal, normal)
    return math.sqrt(2 * float(np.mean(np.sum(across**2, axis=1))) + array.transducer.reach**2)


def shock_distance(peak: float, medium: Medium | None = None) -> float:
    """After how many metres a plane wave of a peak pressure, in Pa, forms a shock: ρc³/(βωp)."""
    return 1 / (_steepening(as_medium(medium)) * peak)


def _steepening(medium: Medium) -> float:
    """βω/(ρc³), in 1/(Pa·m): by how much a plane wave steepens."""
    angular = 2 * math.pi * medium.frequency
    return NONLINEARITY * angular / (air_density(medium) * medium.speed_of_sound**3)


def fundamental(distortion: float) -> float:
    """The part of a fundamental that remains after so much distortion, 1 at 0; of a wave that began as a sine.

    Blackstock's solution, which joins Fubini's, 2·J₁(σ)/σ up to σ = 1, with Fay's sawtooth, 2/(1 + σ) from about 3 on
    (D. T. Blackstock, J. Acoust. Soc. Am. 39, 1019, 1966): B₁ = (2/π)·V + (2/(πσ))·∫_{φ}^{π} cos(x − σ·sin x) dx, with
    the shock V = sin φ, φ = σ·sin φ.
    """
    if distortion < 1e-6:
        return 1.0
    if distortion <= 1:
        return float(2 * scipy.special.j1(distortion) / distortion)
    onset = scipy.optimize.brentq(lambda x: x - distortion * math.sin(x), math.acos(1 / distortion), math.pi)
    rest, _ = scipy.integrate.quad(lambda x: math.cos(x - distortion * math.sin(x)), onset, math.pi)
    return float(2 / math.pi * math.sin(onset) + 2 / (math.pi * distortion) * rest)


@dataclass(frozen=True)
class Validity:
    """How far a focal pressure of the linear model can be believed.

    Parameters
    ----------
    peak : float
        The pressure that the linear model gives, peak in Pa.
    distortion : float
        σ, the distortion parameter at the focus: below 0.5 the linear model holds, beyond 1.5 waves are shocked.
    remaining : float
        The part of the fundamental that harmonics have not taken.
    bound : float
        The fundamental that no drive exceeds at this focus, peak in Pa.
    shock_distance : float
        Distance after which a plane wave of this pressure would be a shock, in metres.
    streaming : float
        Speed that the air gets until the focus if nothing slows it, in m/s.
    """

    peak: float
    distortion: float
    remaining: float
    bound: float
    shock_distance: float
    streaming: float

    @property
    def linear(self) -> bool:
        """Whether the linear model holds, to about 3 % of the fundamental."""
        return self.distortion <= QUASI_LINEAR

    def record(self) -> dict[str, float | bool]:
        """Its numbers for JSON."""
        return {
            "peak_pa": self.peak,
            "distortion": self.distortion,
            "linear": self.linear,
            "fundamental_share": self.remaining,
            "bound_pa": self.bound,
            "streaming_m_s": self.streaming,
        }

    @property
    def brief(self) -> str:
        """One short line for a picture."""
        holds = "the linear model holds" if self.linear else "beyond the linear model"
        return f"{holds}: distortion {self.distortion:.2g} at the strongest place, {QUASI_LINEAR:g} is the limit"

    def __str__(self) -> str:
        word = (
            "holds" if self.linear else "is exceeded" if self.distortion <= STRONG else "has ended: waves are shocked"
        )
        return (
            f"{self.peak:.0f} Pa ({float(sound_pressure_level(self.peak)):.0f} dB SPL) at the focus: the linear model "
            f"{word} (distortion {self.distortion:.3g}, {QUASI_LINEAR:g} is the limit); about {self.remaining:.0%} of "
            f"the fundamental remain, no drive exceeds {self.bound:.0f} Pa; wind of up to {self.streaming:.1g} m/s"
        )


def validity(array: TransducerArray, peak: float, at: ArrayLike, medium: Medium | None = None) -> Validity:
    """How far the linear model's pressure at a focus can be believed.

    Parameters
    ----------
    array : TransducerArray
        It is taken as a disc of its `aperture_radius` that focuses.
    peak : float
        Peak pressure at the focus in Pa, such as ``field.strongest()[0]``.
    at : (3,) float
        The focus, in metres, such as ``field.strongest()[1]``.
    medium : Medium, optional
        The air; 20 °C by default. Its `absorption` is counted whether it is `absorbing` or not.

    Raises
    ------
    ValueError
        If the pressure is negative or not finite.

    Notes
    -----
    With the gain G = ka²/(2F) of a disc of radius a that focuses at the distance F, the pressure on its axis is about
    p_m/√(1 + (G² − 1)·(1 − z/F)²). Steepening adds up along it to

        σ = (βω/(ρc³))·∫ p dz = (βω·p_m·F/(ρc³))·ln(G + √(G² − 1))/√(G² − 1)

    (D. R. Bacon, Ultrasound Med. Biol. 10, 189, 1984; IEC 61949:2007). The fundamental is then p_m·`fundamental`(σ),
    and tends to 2·p_m/σ, whatever p_m. Sound absorbed on the way pushes air: without friction u²/2 = (2α/(ρc))·∫ I dz
    from the array to the focus. All are estimates for one focus: a field of several has less of each, and a bound is no
    target: near it most energy is in harmonics. Nearer than the disc's radius waves come from the side and on longer
    ways; a focus there is judged as one at that distance.
    """
    if not 0 <= peak < math.inf:
        raise ValueError(f"a focal pressure of {peak} Pa must be at least 0 and finite")
    medium = as_medium(medium)
    radius = aperture_radius(array)
    way = max(float(np.linalg.norm(np.asarray(at, np.float64) - array.positions.mean(axis=0))), radius)
    gain = max(medium.wavenumber * radius**2 / (2 * way), 1 + 1e-9)
    root = math.sqrt(gain**2 - 1)
    each = _steepening(medium) * way * math.asinh(root) / root
    lost = 2 * medium.absorption / DECIBELS_PER_NEPER
    fluence = float(intensity(peak, medium)) * way * math.atan(root) / root
    streaming = math.sqrt(2 * lost * fluence / (air_density(medium) * medium.speed_of_sound))
    distance = shock_distance(peak, medium) if peak else math.inf
    return Validity(peak, each * peak, fundamental(each * peak), 2 / each, distance, streaming)
