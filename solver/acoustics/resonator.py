"""The transducer in time: a resonance that a voltage rings up, and that rings down without it.

The phasor model of `propagation` is its steady state. It is linear, and one resonance is all it has. Time factor
e^{-iωt}.

The resonance is a band-pass from drive to emitted wave, H(s) = (2/τ)·s/(s² + (2/τ)·s + ω₀²), which is 1 at ω₀ and
blocks direct voltage. Its impulse response is Re(g·e^{pt}) with the pole p = −1/τ − iω_d, ω_d² = ω₀² − 1/τ², and
g = (2/τ)·(1 − i/(τω_d)), so the wave is the real part of one complex number z with z' = p·z + g·drive. While the drive
is constant z moves towards −g·drive/p as e^{pt}: no step is approximated, nor a moment between two steps.

The wave follows the speed of the piston. That a far field follows its acceleration, which turns every phase alike by a
quarter of a period and lifts the n-th harmonic n times (the third to 1 %), is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import real
from .transducer import Transducer

__all__ = ["OnePole", "Resonator"]

LARGEST = 1e9  # Hz, or s
EPSILON = float(np.finfo(float).eps)
MOST_POWERS = 40  # of a step, in which a resonance turns by less than half a period: π⁴⁰/40! is below rounding


class OnePole(NamedTuple):
    """A resonance in equal steps, with a constant drive in each: z ← decay·z + (1 − decay)·gain·drive."""

    decay: complex
    gain: complex

    def ring(self, drive: ArrayLike, start: ArrayLike = 0) -> NDArray[np.complex128]:
        """The state at the beginning of each step, and at the end of the last.

        Parameters
        ----------
        drive : (t, ...) float or complex
            Drive in each step.
        start : (...) complex
            The state before the first.

        Returns
        -------
        (t + 1, ...) complex
        """
        drive = np.asarray(drive)
        states = np.empty((len(drive) + 1, *drive.shape[1:]), dtype=np.complex128)
        states[0] = start
        towards = (1 - self.decay) * self.gain * drive
        for step, target in enumerate(towards):
            states[step + 1] = self.decay * states[step] + target
        return states

    def between(self, fraction: ArrayLike) -> NDArray[np.complex128]:
        """Weight λ of the next state after a ``fraction`` of a step: the state is (1 − λ)·z + λ·(next z), exactly."""
        decayed = np.exp(np.log(self.decay) * np.asarray(fraction, dtype=np.float64))
        return np.asarray((1 - decayed) / (1 - self.decay))

    def between_series(self) -> NDArray[np.complex128]:
        """The same as a polynomial of the fraction, (d,) complex: its coefficients, ascending, to double precision."""
        exponent = np.log(self.decay)
        powers = np.arange(MOST_POWERS)
        terms = exponent**powers / scipy.special.factorial(powers)
        degree = int(np.flatnonzero(np.abs(terms) > EPSILON * abs(exponent))[-1])
        return np.asarray(np.where(powers == 0, 0, terms)[: degree + 1] / (self.decay - 1))


@dataclass(frozen=True)
class Resonator:
    """The resonance of a transducer.

    Parameters
    ----------
    frequency : float
        Frequency at which it responds most, in hertz.
    time_constant : float
        τ of its amplitude, in seconds; `Transducer` names its source.

    Raises
    ------
    ValueError
        If a number is not positive and finite, or it would not oscillate.
    """

    frequency: float = Transducer.resonance
    time_constant: float = Transducer.time_constant

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, unit in (("frequency", "Hz"), ("time_constant", "s")):
            value = real(f"resonator {name}", getattr(self, name), 0, LARGEST, unit, above=True)
            object.__setattr__(self, name, value)
        if self.quality <= 0.5:
            raise ValueError(
                f"a resonator of {self.frequency:g} Hz and {self.time_constant:g} s has the quality factor "
                f"{self.quality:.3g}; it oscillates only above 0.5"
            )

    @classmethod
    def of(cls, transducer: Transducer) -> Self:
        """The resonance of a transducer."""
        return cls(transducer.resonance, transducer.time_constant)

    @property
    def quality(self) -> float:
        """Quality factor Q = π·f·τ."""
        return math.pi * self.frequency * self.time_constant

    @property
    def pole(self) -> complex:
        """The pole p in 1/s: z goes as e^{pt} when it is not driven."""
        decay, angular = 1 / self.time_constant, 2 * math.pi * self.frequency
        return complex(-decay, -math.sqrt(angular**2 - decay**2))

    def response(self, frequency: float) -> complex:
        """The wave's phasor per unit drive at a frequency in hertz, in the steady state; 1 at the resonance."""
        return complex(self.responses(np.asarray(real("frequency", frequency, -LARGEST, LARGEST, "Hz"))))

    def responses(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """The same at (...) finite frequencies."""
        s = -2j * math.pi * frequency
        rate = 2 / self.time_constant
        return np.asarray(rate * s / (s**2 + rate * s + (2 * math.pi * self.frequency) ** 2))

    def sampled(self, step: float) -> OnePole:
        """In steps of so many seconds, with a real drive that is constant in each; the wave is the state's real part.

        Raises
        ------
        ValueError
            If a step lasts half a period of the resonance or more.
        """
        pole, step = self.pole, real("step", step, unit="s")
        if not 0 < -pole.imag * step < math.pi:
            raise ValueError(
                f"a step of {step} s must be positive and less than half a period, {0.5 / self.frequency} s"
            )
        gain = 2 / self.time_constant * (1 - 1j / (self.time_constant * -pole.imag))
        return OnePole(complex(np.exp(pole * step)), -gain / pole)

    def enveloped(self, carrier: float, step: float) -> OnePole:
        """Around a carrier in hertz, with a complex drive that is constant in each step of so many seconds.

        The state is the wave's phasor, with the steady state of `response`. The part of the wave that turns against the
        carrier is left out, and so are changes within a period of the carrier: about 1/(2Q) of a change.

        Raises
        ------
        ValueError
            If the resonance gets half a period or more away from the carrier within a step.
        """
        step, carrier = real("step", step, unit="s"), real("carrier", carrier, 0, LARGEST, "Hz")
        pole = self.pole + 2j * math.pi * carrier
        if not (step > 0 and abs(pole.imag) * step < math.pi):
            raise ValueError(
                f"a step of {step} s must be positive and so short that resonance and carrier, {self.frequency:g} and "
                f"{carrier:g} Hz, part by less than half a period"
            )
        return OnePole(complex(np.exp(pole * step)), self.response(carrier))
