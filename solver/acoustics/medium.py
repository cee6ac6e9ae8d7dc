"""The air."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...base.arguments import HIGHEST, celsius, flag, instance_of, real

__all__ = ["Medium", "as_medium"]

PRESSURES = 1e3, 1e6  # Pa, in which the formulas of air have a meaning
STANDARD_PRESSURE = 101_325.0  # Pa
DECIBELS_PER_NEPER = 20 / math.log(10)
REFERENCE_KELVIN = 293.15
TRIPLE_POINT_KELVIN = 273.16


@dataclass(frozen=True)
class Medium:
    """Air at rest.

    Parameters
    ----------
    temperature : float
        Temperature in degrees Celsius, from −50 to 60.
    frequency : float
        Frequency of the carrier, in hertz.
    absorbing : bool
        Whether the air absorbs sound; 1.3 dB/m at 40 kHz, so a few tenths of a decibel over an array's reach.
    humidity : float
        Relative humidity in per cent; it matters to absorption only.
    ambient_pressure : float
        Pressure of the atmosphere, in Pa; it matters to absorption only.

    Raises
    ------
    ValueError
        If a value is out of range.

    Notes
    -----
    No temperature is refused in which people hold a hand over an array. The formulas of absorption claim ±10 % from
    −20 to 50 °C, for 0.05 to 5 % of water vapour by volume, below 200 kPa, and from 0.0004 to 10 Hz per Pa of ambient
    pressure (ISO 9613-1, clause 7): 40 kHz at one atmosphere, 0.4 Hz/Pa, lies within. That the speed of sound depends
    on humidity, by up to 0.4 %, is left out.
    """

    temperature: float = 20.0
    frequency: float = 40_000.0
    absorbing: bool = False
    humidity: float = 50.0
    ambient_pressure: float = STANDARD_PRESSURE

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, value in (
            ("temperature", celsius("temperature", self.temperature)),
            ("frequency", real("frequency", self.frequency, 0, HIGHEST, "Hz", above=True)),
            ("absorbing", flag("absorbing", self.absorbing)),
            ("humidity", real("humidity", self.humidity, 0, 100, "%")),
            ("ambient_pressure", real("ambient_pressure", self.ambient_pressure, *PRESSURES, "Pa")),
        ):
            object.__setattr__(self, name, value)

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

    @property
    def absorption(self) -> float:
        """What this air absorbs of a pure tone, in dB/m, whether `absorbing` is set or not; ISO 9613-1, (3) to (5).

        Classical and rotational losses, and the relaxation of oxygen and of nitrogen, whose frequencies depend on the
        molar concentration of water vapour (annex B).
        """
        kelvin = self.temperature + 273.15
        warmth = kelvin / REFERENCE_KELVIN
        pressure = self.ambient_pressure / STANDARD_PRESSURE
        saturation = 10 ** (4.6151 - 6.8346 * (TRIPLE_POINT_KELVIN / kelvin) ** 1.261)
        water = self.humidity * saturation / pressure  # per cent of the molecules
        oxygen: float = pressure * (24 + 4.04e4 * water * (0.02 + water) / (0.391 + water))
        nitrogen: float = pressure / math.sqrt(warmth) * (9 + 280 * water * math.exp(-4.170 * (warmth ** (-1 / 3) - 1)))
        squared = self.frequency**2
        relaxation: float = warmth**-2.5 * (
            0.01275 * math.exp(-2239.1 / kelvin) / (oxygen + squared / oxygen)
            + 0.1068 * math.exp(-3352.0 / kelvin) / (nitrogen + squared / nitrogen)
        )
        return 8.686 * squared * (1.84e-11 / pressure * math.sqrt(warmth) + relaxation)

    @property
    def attenuation(self) -> float:
        """Attenuation α of pressure as in e^{−αr}, in Np/m; 0 unless `absorbing`."""
        return self.absorption / DECIBELS_PER_NEPER if self.absorbing else 0.0


def as_medium(medium: Medium | None) -> Medium:
    """The air, by default of 20 °C; `ValueError` if it is anything else."""
    return Medium() if medium is None else instance_of(medium, Medium, "medium", "such as Medium(temperature=25)")
