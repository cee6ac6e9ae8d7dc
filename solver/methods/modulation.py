"""Modulation: what makes ultrasound perceptible, the paper's sections 2.2 and 3.4.

Receptors in the skin do not follow 40 kHz; they feel the intensity change, best at about 200 Hz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import HIGHEST, array_of, as_drives, real, whole
from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..acoustics.propagation import Precision, pressure
from ..geometry import frozen

__all__ = ["FREQUENCY", "Modulation", "check_frequency", "intensity_component"]

FREQUENCY = 200.0
"""Of the modulation, in hertz."""

CARRIER = 40_000.0  # hertz
LOWEST = 0.01  # hertz; skin does not feel a slower modulation
SINE_SAMPLES = 50
MOST_SAMPLES, MOST_HARMONIC = 1_000_000, 1_000_000


def check_frequency(frequency: float, samples: int, carrier: float = CARRIER) -> float:
    """A frequency in hertz; `ValueError` if a modulation of so many samples cannot have it."""
    hint = f": each of {samples} samples lasts a carrier period or more"
    return real("modulation frequency", frequency, LOWEST, carrier / samples, "Hz", hint=hint)


@dataclass(frozen=True, eq=False)
class Modulation:
    """Drives that take turns, or fade, periodically.

    Parameters
    ----------
    drives : (f, n) complex
        Drives in array order; 1 is full drive.
    weights : (s, f) float
        How much of each drive is emitted during each of the s equally long samples of one period of the modulation, at
        least 0.
    frequency : float
        Wanted frequency of the modulation, in hertz. A sample lasts a whole number of carrier periods, so the one that
        is emitted is `true_frequency`.
    carrier : float
        Frequency of the carrier, in hertz.

    Raises
    ------
    ValueError
        If shapes do not fit, a number is not finite, a weight is negative, a sample drives a transducer beyond 1, or
        the frequency is not possible.
    """

    drives: NDArray[np.complex128]
    weights: NDArray[np.float64]
    frequency: float = FREQUENCY
    carrier: float = CARRIER

    def __init__(
        self, drives: ArrayLike, weights: ArrayLike, frequency: float = FREQUENCY, carrier: float = CARRIER
    ) -> None:
        drives, weights = as_drives(drives), array_of("weights", weights, np.float64)
        if drives.ndim != 2 or not drives.size:
            raise ValueError(f"drives must have the shape (f, n), not {drives.shape}")
        if weights.ndim != 2 or not len(weights) or weights.shape[1] != len(drives):
            raise ValueError(f"weights must have the shape (s, {len(drives)}), not {weights.shape}")
        if (bad := np.argwhere(~np.isfinite(weights) | (weights < 0))).size:
            raise ValueError(
                f"weight {weights[*bad[0]]} of drive {bad[0, 1]} in sample {bad[0, 0]} must be finite and not negative"
            )
        if (bad := np.argwhere(np.abs(weights @ drives) > 1 + 1e-6)).size:
            raise ValueError(f"sample {bad[0, 0]} drives transducer {bad[0, 1]} beyond 1, which is full drive")
        carrier = real("carrier", carrier, 0, HIGHEST, "Hz", above=True)
        frequency = check_frequency(frequency, len(weights), carrier)
        object.__setattr__(self, "drives", frozen(drives))
        object.__setattr__(self, "weights", frozen(weights))
        object.__setattr__(self, "frequency", frequency)
        object.__setattr__(self, "carrier", carrier)

    def __repr__(self) -> str:
        steps, count = self.weights.shape
        return f"Modulation({count} drives of {self.drives.shape[1]}, {steps} steps, {self.frequency:g} Hz)"

    @classmethod
    def on_off(cls, drive: ArrayLike, frequency: float = FREQUENCY, *, carrier: float = CARRIER) -> Modulation:
        """A drive for one half of each period, and silence for the other."""
        return cls(_rows({"drive": drive}), [[1.0], [0.0]], frequency, carrier)

    @classmethod
    def two_sided(
        cls, first: ArrayLike, second: ArrayLike, frequency: float = FREQUENCY, *, carrier: float = CARRIER
    ) -> Modulation:
        """Two drives in turn, each for one half of each period: no half of it is lost."""
        return cls(_rows({"first drive": first, "second drive": second}), np.eye(2), frequency, carrier)

    @classmethod
    def sine(
        cls,
        drive: ArrayLike,
        frequency: float = FREQUENCY,
        depth: float = 1.0,
        *,
        samples: int = SINE_SAMPLES,
        carrier: float = CARRIER,
    ) -> Modulation:
        """A drive whose magnitude falls and rises as a cosine, from 1 to 1 - depth and back.

        Parameters
        ----------
        drive : (n,) complex
            Drive at its full strength.
        frequency : float
            Frequency of the modulation, in hertz.
        depth : float
            0 for none, 1 down to silence.
        samples : int
            Steps of one period, at least 2; each has the cosine's value at its middle.
        carrier : float
            Frequency of the carrier, in hertz.

        Notes
        -----
        With depth 1 the intensity is (1 + cos)²/4, whose first harmonic is half of the largest intensity; on and off
        make 2/π of it.
        """
        depth, carrier = real("depth", depth, 0, 1), real("carrier", carrier, 0, HIGHEST, "Hz", above=True)
        samples = whole("samples", samples, 2, min(math.floor(carrier), MOST_SAMPLES))
        angle = 2 * np.pi * (np.arange(samples) + 0.5) / samples
        return cls.sampled(drive, 1 - depth * (1 - np.cos(angle)) / 2, frequency, carrier=carrier)

    @classmethod
    def sampled(
        cls, drive: ArrayLike, envelope: ArrayLike, frequency: float = FREQUENCY, *, carrier: float = CARRIER
    ) -> Modulation:
        """A drive times an envelope: (s,) factors over one period, at least 0."""
        weights = array_of("envelope", envelope, np.float64)
        if weights.ndim != 1 or not weights.size:
            raise ValueError(f"the envelope must have the shape (s,), not {weights.shape}")
        return cls(_rows({"drive": drive}), weights[:, None], frequency, carrier)

    @property
    def periods(self) -> int:
        """Carrier periods that one sample lasts: the whole number nearest to what the frequency asks for."""
        return max(1, round(self.carrier / (self.frequency * len(self.weights))))

    @property
    def true_frequency(self) -> float:
        """Frequency of the modulation as it is emitted, in hertz."""
        return self.carrier / (self.periods * len(self.weights))

    def slots(self) -> tuple[NDArray[np.complex128], tuple[tuple[int, int], ...]]:
        """One period as a sequence of constant drives.

        Returns
        -------
        frames : (k, n) complex
            The different drives that are emitted, in the order in which they first appear; silence is one of zeros.
        slots : tuple of (int, int)
            Row of ``frames``, and for how many carrier periods it is emitted. Neighbours are different rows, and the
            numbers add up to one period of the modulation.
        """
        index: dict[bytes, int] = {}
        slots: list[tuple[int, int]] = []
        for row in self.weights + 0.0:  # -0.0 is 0.0
            frame = index.setdefault(row.tobytes(), len(index))
            if slots and slots[-1][0] == frame:
                slots[-1] = (frame, slots[-1][1] + self.periods)
            else:
                slots.append((frame, self.periods))
        levels = np.frombuffer(b"".join(index), dtype=np.float64).reshape(len(index), -1)
        return frozen(levels @ self.drives), tuple(slots)


def _rows(drives: dict[str, ArrayLike]) -> NDArray[np.complex128]:
    """Drives as rows, checked to be (n,) each with the same n."""
    rows = {name: array_of(f"the {name}", drive, np.complex128) for name, drive in drives.items()}
    length = next(iter(rows.values())).shape
    for name, row in rows.items():
        if row.ndim != 1 or row.shape != length:
            wanted = length if len(length) == 1 else "(n,)"
            raise ValueError(f"the {name} has the shape {row.shape}; it must be {wanted}")
    return np.stack(list(rows.values()))


def intensity_component(
    array: TransducerArray,
    modulation: Modulation,
    at: ArrayLike,
    harmonic: int = 1,
    medium: Medium | None = None,
    precision: Precision = "double",
) -> NDArray[np.float64]:
    """How strongly the intensity at points changes at the modulation's frequency, or a multiple of it.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    modulation : Modulation
        What they emit.
    at : (k, 3) float
        Points, in metres.
    harmonic : int
        Multiple of the modulation's frequency; 0 is the mean.
    medium : Medium, optional
        The air; by default of 20 °C, with the modulation's carrier.
    precision : {"double", "single"}
        Precision of the pressure, as in `pressure`.

    Returns
    -------
    (k,) float
        Amplitude A of the term A·cos(2π·harmonic·f·t + φ) of the intensity I(t) = |p(t)|², in Pa²; p is the peak
        pressure in Pa.

    Raises
    ------
    ValueError
        If the harmonic is negative, the carriers differ, or as `pressure`.

    Notes
    -----
    The Fourier coefficient in continuous time of what is constant in each sample: with I_j in sample j of s,
    A = 2·|Σ_j I_j·e^{-2πihj/s}|/s · sinc(h/s), h the harmonic. For on and off that is (2/π)·|p|², and for two fields in
    turn (2/π)·||p₁|² - |p₂|²|. In this model the transducers follow at once, and the sound arrives at once.
    """
    harmonic = whole("harmonic", harmonic, 0, MOST_HARMONIC)
    medium = medium or Medium(frequency=modulation.carrier)
    if medium.frequency != modulation.carrier:
        raise ValueError(f"a medium for {medium.frequency:g} Hz does not fit a carrier of {modulation.carrier:g} Hz")
    fields = np.stack([pressure(array, drive, at, medium, precision) for drive in modulation.drives])
    intensity = np.abs(modulation.weights @ fields) ** 2
    s = len(intensity)
    turns = np.exp(-2j * np.pi * harmonic * np.arange(s) / s) * np.sinc(harmonic / s) / s
    return np.asarray((1 if harmonic == 0 else 2) * np.abs(turns @ intensity))
