"""Skin and ears: the feeling, the sound and the exposure that waves over time cause where people are.

Its functions take the waves that transducers emit, a row for each carrier period, or a field at points. They know the
solver's array and air, and nothing of ticks, packets or devices: `hil` brings them the waves that the bits of a device
make.
"""

from __future__ import annotations

from .exposure import LIMITS, Exposure, exposure_at, exposure_limit, seated
from .hearing import Audible, a_weighting, audible
from .perception import FeltMap, feel, felt_map, radiation_pressures
from .power import RadiatedPower, radiated_power, warming
from .receptors import TOUCH_CHANNELS
from .skin import Skin
from .unfolding import SkinPatch, SkinPlaces, Unfolded

__all__ = [
    "LIMITS",
    "TOUCH_CHANNELS",
    "Audible",
    "Exposure",
    "FeltMap",
    "RadiatedPower",
    "Skin",
    "SkinPatch",
    "SkinPlaces",
    "Unfolded",
    "a_weighting",
    "audible",
    "exposure_at",
    "exposure_limit",
    "feel",
    "felt_map",
    "radiated_power",
    "radiation_pressures",
    "seated",
    "warming",
]


def __dir__() -> list[str]:
    return __all__
