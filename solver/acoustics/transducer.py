"""The transducer, as data: its name, its strength, and the model of its wave."""

from __future__ import annotations

from dataclasses import dataclass

from ...base.arguments import real, whole
from .aperture import Aperture
from .diffraction import KERNELS

__all__ = ["MODELS", "TRANSDUCERS", "Transducer"]

MODELS = ("monopole", "piston", *KERNELS)
"""Names of the models of a transducer's wave, which `models` computes: a point, a baffled piston's far field, and the
Rayleigh integrals of `KERNELS` over its face."""


DATA_SHEET = "20 Pa rms at 30 cm and 10 V rms, as the paper states; 8.49 Pa·m peak"
LIMITS = (("radius", "m", 1.0), ("strength", "Pa·m", 1e6), ("resonance", "Hz", 1e9), ("time_constant", "s", 1.0))


@dataclass(frozen=True)
class Transducer:
    """One kind of transducer; the muRata MA40S4S by default.

    Parameters
    ----------
    radius : float
        Effective radius of the piston, in metres.
    strength : float
        P₁, the pressure × distance on the axis far away at full drive, in Pa·m (peak).
    source : str
        The source of the strength.
    resonance : float
        Frequency of its resonance, in hertz.
    time_constant : float
        τ of the resonance's amplitude, in seconds. No curve of the MA40S4S is published; a quality factor of 25 to 60
        at 40 kHz, common for its kind, is 0.2 to 0.5 ms.
    polarity : int
        1, or −1 for one that is soldered the other way round.
    model : str
        A key of `MODELS`.
    aperture : Aperture, optional
        The moving part of its face, for the models that are Rayleigh integrals; the disc of its radius by default.

    Raises
    ------
    ValueError
        If a value is out of range, or an aperture is given to a model that has none.
    """

    radius: float = 4.5e-3
    strength: float = 5.73
    source: str = f"{DATA_SHEET}, scaled to the fundamental of a square wave between 0 and 15 V"
    resonance: float = 40_000.0
    time_constant: float = 0.3e-3
    polarity: int = 1
    model: str = "piston"
    aperture: Aperture | None = None

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, unit, limit in LIMITS:
            value = real(f"transducer {name}", getattr(self, name), 0, limit, unit, above=True)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "polarity", whole("transducer polarity", self.polarity, -1, 1))
        if not self.polarity:
            raise ValueError("transducer polarity 0 must be 1 or -1")
        if self.model not in MODELS:
            raise ValueError(f"unknown transducer model {self.model!r}; known are {', '.join(MODELS)}")
        if self.aperture is not None and self.model not in KERNELS:
            raise ValueError(f"transducer model {self.model!r} has no aperture; {', '.join(KERNELS)} have one")

    def __repr__(self) -> str:
        return f"Transducer({self.model}, radius {self.radius * 1e3:g} mm, {self.strength:g} Pa·m)"

    @property
    def face(self) -> float | Aperture:
        """The moving part: its aperture, or else the disc of its radius in metres."""
        return self.radius if self.aperture is None else self.aperture

    @property
    def reach(self) -> float:
        """Distance from the middle of the face to its edge, in metres."""
        return self.radius if self.aperture is None else self.aperture.reach

    @property
    def nearest(self) -> float:
        """Distance from which the model can be used, in metres: one radius, or two if it is a Rayleigh integral."""
        return 2 * self.reach if self.model in KERNELS else self.radius


TRANSDUCERS = {
    "MA40S4S": Transducer(),
    "MA40S4S-10Vrms": Transducer(strength=8.49, source=DATA_SHEET),
    "MA40S4S-levitate": Transducer(
        strength=6.0,
        source="default of the levitate package (Applied Acoustics, Chalmers), about 6 Pa at 1 m and 20 V, peak",
    ),
    "MA40S4S-acoustools": Transducer(
        strength=3.4, source="AcousTools, 0.17 Pa·m per volt at 20 V; 8.02 Pa·m in its earlier versions"
    ),
}
"""Transducers by name. They are the same part; published strengths disagree by more than a factor of two."""
