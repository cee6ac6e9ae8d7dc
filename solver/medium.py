"""The air."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Medium"]


@dataclass(frozen=True)
class Medium:
    """Air at rest, without absorption.

    Parameters
    ----------
    temperature : float
        In degrees Celsius.
    frequency : float
        Of the carrier, in hertz.

    Raises
    ------
    ValueError
        Below absolute zero, or where the frequency is not positive.
    """

    temperature: float = 20.0
    frequency: float = 40_000.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not -273.15 < self.temperature < math.inf:
            raise ValueError(f"temperature {self.temperature} °C must be finite and above absolute zero (-273.15 °C)")
        if not 0 < self.frequency < math.inf:
            raise ValueError(f"frequency {self.frequency} Hz must be positive and finite")

    @property
    def speed_of_sound(self) -> float:
        """Speed of sound c = 331.3·√(1 + T/273.15), in m/s."""
        return 331.3 * math.sqrt(1 + self.temperature / 273.15)

    @property
    def wavelength(self) -> float:
        """Wavelength λ = c/f, in metres."""
        return self.speed_of_sound / self.frequency

    @property
    def wavenumber(self) -> float:
        """Wavenumber k = 2π/λ, in rad/m."""
        return 2 * math.pi / self.wavelength
