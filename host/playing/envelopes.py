"""Envelopes for `Device.modulate`: skin feels not the carrier but the change of its strength."""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

from ...protocol.board import CARRIER_HZ
from ...protocol.codes import AMPLITUDES, MODULATION_SAMPLES
from ...solver.methods.modulation import Modulation

__all__ = ["Envelope", "sine"]

STEPS = 200
"""Samples in one period of the modulation, if the carrier leaves room for so many."""
LOWEST_HZ = CARRIER_HZ / (MODULATION_SAMPLES * (2**16 - 1))


class Envelope(NamedTuple):
    """Amplitudes, 0 to 255, and for how many carrier periods each holds."""

    samples: bytes
    hold: int

    def __repr__(self) -> str:
        return f"Envelope({len(self.samples)} samples, {self.frequency:g} Hz)"

    @property
    def frequency(self) -> float:
        """Its repetition rate, in Hz."""
        return CARRIER_HZ / (len(self.samples) * self.hold)


def sine(frequency: float, depth: float = 1.0) -> Envelope:
    """An amplitude that falls and rises as a cosine.

    Parameters
    ----------
    frequency : float
        In Hz, up to 20 000; rounded to a whole number of carrier periods (`Envelope.frequency`). Skin feels 40 to 400
        Hz, 200 Hz best.
    depth : float
        1 for down to silence, 0 for none.

    Raises
    ------
    ValueError
        If a number is out of range.
    """
    if not LOWEST_HZ < frequency <= CARRIER_HZ / 2:
        raise ValueError(f"a modulation of {frequency:g} Hz must lie between {LOWEST_HZ:.1g} and {CARRIER_HZ / 2:g} Hz")
    hold = ceil(CARRIER_HZ / (frequency * STEPS))
    count = max(2, round(CARRIER_HZ / (frequency * hold)))
    weights = Modulation.sine([1.0], CARRIER_HZ / (count * hold), depth, samples=count, carrier=CARRIER_HZ).weights
    return Envelope(bytes(round(float(weight) * (AMPLITUDES - 1)) for weight in weights[:, 0]), hold)
