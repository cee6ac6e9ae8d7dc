"""What a pressure means: intensity, radiation pressure and level.

Pressures are peak amplitudes in Pa, so a mean over the carrier's period brings a factor 1/2: ⟨p(t)²⟩ = |p|²/2.
Intensity and radiation pressure take the wave for a plane one, whose particle velocity is p/(ρc). That is good
far from the array and at a focus that is not too tight; where waves cross, as in a standing wave, it is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, real
from ..acoustics.medium import Medium, as_medium

__all__ = [
    "QUANTITIES",
    "Quantity",
    "air_density",
    "check_pressure",
    "check_reflection",
    "intensity",
    "radiation_pressure",
    "relative_level",
    "sound_pressure_level",
]

GAS_CONSTANT = 8.314_462_618  # J/(mol·K)
MOLAR_MASS = 28.9647e-3  # kg/mol, dry air (ISO 2533)
LOUDEST = 1e12  # Pa; no air bears a ten-thousandth part of it
REFERENCE = 20e-6  # Pa rms, the reference of sound pressure levels in air (ISO 1683)


def air_density(medium: Medium) -> float:
    """Density of dry air in kg/m³, as an ideal gas: ρ = p₀·M/(R·T)."""
    return medium.ambient_pressure * MOLAR_MASS / (GAS_CONSTANT * (medium.temperature + 273.15))


def intensity(pressure: ArrayLike, medium: Medium | None = None) -> NDArray[np.float64]:
    """Intensity of a plane wave, averaged over the carrier's period: I = |p|²/(2ρc).

    Parameters
    ----------
    pressure : (...) complex
        Peak pressure in Pa.
    medium : Medium, optional
        The air; 20 °C by default.

    Returns
    -------
    (...) float
        Intensity in W/m².
    """
    medium = as_medium(medium)
    magnitude = _peak(pressure)
    return np.asarray(magnitude**2 / (2 * air_density(medium) * medium.speed_of_sound))


def radiation_pressure(
    pressure: ArrayLike, medium: Medium | None = None, reflection: float = 2.0
) -> NDArray[np.float64]:
    """Pressure with which a plane wave pushes a surface that it meets squarely: P = α·|p|²/(2ρc²).

    Parameters
    ----------
    pressure : (...) complex
        Peak pressure in Pa of the wave that arrives, without what the surface reflects.
    medium : Medium, optional
        The air; 20 °C by default.
    reflection : float
        α, 1 + |R|² for a reflection of amplitude R: 2 for all of the wave, as skin, oil and other dense things do, and
        1 for none, in a perfect absorber.

    Returns
    -------
    (...) float
        Radiation pressure in Pa, averaged over the carrier's period.

    Raises
    ------
    ValueError
        If α is not between 1 and 2.

    Notes
    -----
    The wave carries the momentum I/c = ⟨p(t)²⟩/(ρc²) = |p|²/(2ρc²) through each square metre and second; a surface that
    absorbs it takes it once, one that reflects it takes it twice. This is the Langevin pressure, of a beam within air
    at rest (Lee and Wang, "Acoustic radiation pressure", J. Acoust. Soc. Am. 94, 1099, 1993). With the rms pressure the
    same is written α·p²/(ρc²).
    """
    reflection, medium = check_reflection(reflection), as_medium(medium)
    return reflection * intensity(pressure, medium) / medium.speed_of_sound


def check_reflection(reflection: float) -> float:
    """α of `radiation_pressure`; `ValueError` if it is out of range."""
    return real("reflection", reflection, 1, 2, hint=": 1 for an absorber, 2 for a mirror")


def _peak(pressure: ArrayLike) -> NDArray[np.float64]:
    """|p| of pressures of any shape."""
    return check_pressure(array_of("pressure", pressure, np.complex128))


def check_pressure(pressure: NDArray[Any]) -> NDArray[np.float64]:
    """|p| of pressures; `ValueError` if one is not finite or beyond `LOUDEST`."""
    magnitude = np.asarray(np.abs(pressure))
    if not magnitude.max(initial=0) <= LOUDEST:
        bad = pressure.flat[int(np.argmin(magnitude.ravel() <= LOUDEST))]
        raise ValueError(f"pressure {bad} Pa must be finite and at most {LOUDEST:g} Pa")
    return magnitude


def sound_pressure_level(pressure: ArrayLike) -> NDArray[np.float64]:
    """Level of a peak pressure in Pa, in dB re 20 µPa rms; −∞ if it is 0."""
    return _decibels(_peak(pressure) / (math.sqrt(2) * REFERENCE))


def relative_level(pressure: ArrayLike, reference: float | None = None) -> NDArray[np.float64]:
    """Level of a pressure relative to a reference in the same unit, the largest |p| by default, in dB.

    Raises
    ------
    ValueError
        If the reference is not positive, such as the largest |p| of a silent field.
    """
    magnitude = _peak(pressure)
    if not magnitude.size:
        return magnitude
    if reference is None and not (reference := float(magnitude.max())):
        raise ValueError("a level relative to silence has no meaning; name a reference, in Pa")
    return _decibels(magnitude / real("reference", reference, 0, LOUDEST, "Pa", above=True))


def _decibels(ratio: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(ratio))


@dataclass(frozen=True)
class Quantity:
    """Something that follows from the pressure.

    Parameters
    ----------
    name, symbol, unit : str
        Words for people.
    decade : float
        dB for each factor of ten: 20 if it grows as the pressure, 10 if it grows as its square.
    of : function
        Function of peak pressure in Pa, (...) complex, and the air, to (...) float.
    """

    name: str
    symbol: str
    unit: str
    decade: float
    of: Callable[[NDArray[np.complex128], Medium], NDArray[np.float64]]


def _magnitude(pressure: NDArray[np.complex128], _medium: Medium) -> NDArray[np.float64]:
    return np.abs(pressure)


QUANTITIES = {
    "pressure": Quantity("Pressure", "|p|", "Pa (peak)", 20, _magnitude),
    "intensity": Quantity("Intensity", "I", "W/m² (mean)", 10, intensity),
    "radiation": Quantity("Radiation pressure, full reflection,", "P", "Pa (mean)", 10, radiation_pressure),
}
"""What can be drawn and exported, by name."""
