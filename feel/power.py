"""Acoustic power, and the heat that skin gets of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import real
from ..solver import Medium, Transducer, TransducerArray
from ..solver.acoustics.medium import as_medium
from ..solver.acoustics.models import residual
from ..solver.fields.quantities import LOUDEST, air_density, intensity
from .arriving import as_waves

__all__ = ["RadiatedPower", "absorbed_share", "full_power", "power_over_time", "radiated_power", "warming"]

CAPACITANCE = 2.55e-9  # F, MA40S4S at 1 kHz (muRata, data sheet)
SKIN_IMPEDANCE = 1.5e6  # Pa·s/m: a density of 1000 to 1100 kg/m³ times 1500 m/s, the lower end of what is published
SKIN_CONDUCTIVITY = 0.37  # W/(m·K), and
SKIN_DIFFUSIVITY = 1.1e-7  # m²/s of dermis (F. A. Duck, Physical Properties of Tissue, 1990)
HEAT_RATIO = 1.4  # γ of air
AIR_DIFFUSIVITY = 2.1e-5  # m²/s, thermal, of air at 20 °C
EXCHANGE = 100.0  # W/m², of the order of what skin at rest gives off
FAR = 1e4  # metres, beyond every near field
NODES = 200


def full_power(transducer: Transducer, medium: Medium | None = None) -> float:
    """Acoustic power of one transducer at full drive, in watts.

    The far field's intensity over the half space, W = P₁²/(2ρc)·2π·∫ |ψ(θ)|² sinθ dθ, with ψ the `residual` of its
    model. For a baffled piston that is (2π·P₁²/(ρc·(ka)²))·(1 − J₁(2ka)/(ka)).
    """
    medium = as_medium(medium)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    angle = (nodes + 1) * math.pi / 4
    sine = np.sin(angle)
    wave = residual(transducer, sine, np.full(NODES, FAR), medium)
    steradians = 2 * math.pi * float(np.abs(wave) ** 2 * sine @ weights) * math.pi / 4
    return float(intensity(transducer.strength, medium)) * steradians


def power_over_time(array: TransducerArray, waves: ArrayLike, medium: Medium | None = None) -> NDArray[np.float64]:
    """Acoustic power in each carrier period, (t,) in watts, of waves (t, n).

    The sum of what each would radiate by itself. The work that transducers do on each other's waves is left out. It is
    Re(z*ᵀRz) with R(d) = P₁²/(2ρc)·2π·∫ D²(θ)·J₀(kd·sinθ) sinθ dθ between two at a distance d; on the default array it
    is 13 % of one's own power for neighbours, of changing sign, and it adds 0.3 % to the power of an outline.
    """
    series = as_waves(array, waves)
    share = np.repeat(np.abs(array.response) ** 2, 2).astype(np.float32)
    parts = series.view(np.float32)
    return np.asarray(np.einsum("tq,tq,q->t", parts, parts, share) * full_power(array.transducer, medium), np.float64)


def absorbed_share(medium: Medium | None = None) -> float:
    """Part of a plane wave's power that smooth bare skin keeps at normal incidence, about 0.9 %.

    0.1 % enters the body, 4ρc/Z. 0.8 % is lost in the thermal boundary layer of the air, δ = √(2χ/ω), on a wall that
    stays at its temperature: 2(γ − 1)·kδ (A. D. Pierce, Acoustics, 1981, section 10-4). Hair, ridges, sweat and cloth
    keep more; fabric is felt to warm (Kamigaki, Suzuki and Shinoda, EuroHaptics 2020).
    """
    medium = as_medium(medium)
    layer = math.sqrt(2 * AIR_DIFFUSIVITY / (2 * math.pi * medium.frequency))
    body = 4 * air_density(medium) * medium.speed_of_sound / SKIN_IMPEDANCE
    return body + 2 * (HEAT_RATIO - 1) * medium.wavenumber * layer


def warming(peak: float, seconds: float, medium: Medium | None = None) -> float:
    """By how many kelvins the skin's surface warms at a pressure that stays, at most.

    Parameters
    ----------
    peak : float
        Peak pressure of the wave that arrives, in Pa.
    seconds : float
        Since it began.
    medium : Medium, optional
        The air; 20 °C by default.

    Notes
    -----
    A constant flux q into a half-space: ΔT = (2q/κ)·√(χt/π) (Carslaw and Jaeger, Conduction of Heat in Solids, 1959,
    section 2.9). Heat that blood, air and the skin beside the focus carry away is left out.
    """
    peak = real("peak", peak, 0, LOUDEST, "Pa")
    seconds = real("seconds", seconds, 0, 1e9, "s")
    flux = absorbed_share(medium) * float(intensity(peak, medium))
    rise: float = 2 * flux / SKIN_CONDUCTIVITY * math.sqrt(SKIN_DIFFUSIVITY * seconds / math.pi)
    return rise


@dataclass(frozen=True)
class RadiatedPower:
    """Mean power of waves, in watts.

    Parameters
    ----------
    acoustic, greatest : float
        Radiated, on average over time and in the strongest carrier period.
    switching : float
        What 15 V outputs lose by charging as many capacitances as play, C·V²·f each. Together with ``acoustic`` it is a
        lower bound of the electrical power: what transducers lose themselves is not published.
    skin : float
        Kept by skin, if all of ``acoustic`` met it squarely.
    """

    acoustic: float
    greatest: float
    switching: float
    skin: float

    def record(self) -> dict[str, float]:
        """Its numbers for JSON, in watts."""
        return {
            "acoustic_w": self.acoustic,
            "greatest_w": self.greatest,
            "switching_w": self.switching,
            "skin_w": self.skin,
        }

    def __str__(self) -> str:
        return (
            f"{self.acoustic:.3g} W of sound on average, {self.greatest:.3g} W at most, from at least "
            f"{self.acoustic + self.switching:.3g} W electrical; bare skin keeps at most {self.skin * 1e3:.2g} mW "
            f"(a palm of 80 cm² gives off {EXCHANGE * 8:.0f} mW at rest)"
        )


def radiated_power(
    array: TransducerArray, waves: ArrayLike, medium: Medium | None = None, supply_v: float = 15.0
) -> RadiatedPower:
    """Mean power of waves (t, n) over their time; see `power_over_time`."""
    medium, series = as_medium(medium), as_waves(array, waves)
    supply_v = real("supply_v", supply_v, 0, 1e3, "V")
    radiated = power_over_time(array, series, medium)
    playing = float(np.mean(series != 0) * len(array))
    mean = float(radiated.mean())
    switching = playing * CAPACITANCE * supply_v**2 * medium.frequency
    return RadiatedPower(mean, float(radiated.max()), switching, absorbed_share(medium) * mean)
