"""The wave of each transducer, from captured bits: it is judged for skin and ears.

`Playback` in `air` goes on to the pressure at points. Here the waves stay apart, one column for each transducer: `feel`
judges many places by them, and sound below the carrier as well.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import stretch
from ...emulator import Capture
from ...emulator.ports.amplifier import Amplifier
from ...protocol.board import (
    CARRIER_HZ,
    CHANNELS,
    CHANNELS_PER_PROCESSOR,
    HALF_TICKS_PER_PERIOD,
    MAX_WIDTH_TICKS,
    PROCESSORS,
    TICKS_PER_PERIOD,
)
from ...protocol.pulses import MODULATED_WIDTH
from ...solver import TransducerArray
from ...solver.acoustics.resonator import Resonator
from .air import SETTLED

__all__ = ["EmittedWaves", "emitted_waves"]

PERIODS_AT_A_TIME = 1024  # whose drives fit a cache


class EmittedWaves(NamedTuple):
    """The emission of the transducers, carrier period by carrier period."""

    first: int
    """The carrier period of the first row."""
    waves: NDArray[np.complex64]
    """Phasors at the beginning of each period, (t, n), after amplifier and resonance; 1 is full drive in the steady
    state. Time factor e^{-iωt}, ω of the carrier."""
    pulses: NDArray[np.complex64]
    """Duty and moment of the square waves, (t, n), for sound below the carrier: the duty of each period, and as the
    imaginary part the moment, ∫ (s − ½) ds over the part s of the period in which the output is high. 0 for transducers
    that are not connected."""

    @property
    def duty(self) -> NDArray[np.float32]:
        """Share of each period in which the output is high, (t, n)."""
        return self.pulses.real

    def __repr__(self) -> str:
        return (
            f"EmittedWaves(periods {self.first} to {self.first + len(self.waves)}, {self.waves.shape[1]} transducers)"
        )


def emitted_waves(
    capture: Capture, array: TransducerArray, first: int, last: int, amplifier: Amplifier | None = None
) -> EmittedWaves:
    """The waves of all transducers, from the bits of their outputs.

    Parameters
    ----------
    capture : Capture
        The outputs. What they did before ``first`` still rings; before the capture begins they are at rest.
    array : TransducerArray
        320 transducers with their resonance. Its `response` is left to the transfer matrix.
    first, last : int
        Carrier periods of the capture, 25 µs each; last is not included.
    amplifier : Amplifier, optional
        Between outputs and transducers; 15 V by default.

    Returns
    -------
    EmittedWaves

    Raises
    ------
    ValueError
        If the array has another number of transducers, or the periods were not captured.

    Notes
    -----
    As `Playback.phasors`, and with its limits: the fundamental of each period drives the resonance
    (`Resonator.enveloped`), and the place of a pulse within its period is neglected.
    """
    if len(array) != CHANNELS:
        raise ValueError(f"an array of {len(array)} transducers does not fit boards with {CHANNELS} outputs")
    begin = -(-capture.start_tick // TICKS_PER_PERIOD)
    first, last = stretch("periods", ("first", "last"), first, last, begin, capture.periods)
    from ...emulator.ports.raster import emit  # importing numba takes half a second
    from .emission_kernels import measure, ring_up

    resonator = Resonator.of(array.transducer)
    resonance = resonator.enveloped(CARRIER_HZ, 1 / CARRIER_HZ)
    rate = (1 - resonance.decay) * resonance.gain * (amplifier or Amplifier()).gain
    state = np.zeros((2, CHANNELS))
    waves, pulses = np.empty((2, last - first, CHANNELS), np.complex64)
    columns = np.argsort(capture.wiring.channels).reshape(PROCESSORS, CHANNELS_PER_PROCESSOR)
    segments = [track.segments for track in capture.tracks]
    slices = tuple(port.slices for port in segments)
    settling = math.ceil(SETTLED * resonator.time_constant * CARRIER_HZ)
    early = capture.drives(max(begin, first - settling), first)
    ring_up(early, resonance.decay, rate, state, np.empty_like(early))
    for start in range(first, last, PERIODS_AT_A_TIME):
        stop = min(start + PERIODS_AT_A_TIME, last)
        part = slice(start - first, stop - first)
        ring_up(capture.drives(start, stop), resonance.decay, rate, state, waves[part])
        rows, samples = map(np.stack, zip(*(port.rows(start, stop) for port in segments), strict=True))
        emit(slices, rows, samples, np.ascontiguousarray(MODULATED_WIDTH), _pulses(), columns, pulses[part])
        for track, its_columns, port in zip(capture.tracks, columns, range(PROCESSORS), strict=True):
            if track.deranged:  # its bits are not the pulses that were sent
                words = capture.bits(start * TICKS_PER_PERIOD, stop * TICKS_PER_PERIOD)
                measure(np.ascontiguousarray(words[:, port]), its_columns, pulses[part])
    for number, tick in capture.open_since.items():
        pulses[max(tick // TICKS_PER_PERIOD - first, 0) :, number] = 0
    return EmittedWaves(first, waves, pulses)


@cache
def _pulses() -> NDArray[np.complex64]:
    """Duty and moment of a pulse of each phase and width, (100, 26), from its bits (clause PUL-004)."""
    phase, width = np.mgrid[:HALF_TICKS_PER_PERIOD, : MAX_WIDTH_TICKS + 1][..., None]
    ticks = np.arange(TICKS_PER_PERIOD)
    high = (ticks - ((phase - width) >> 1)) % TICKS_PER_PERIOD < width
    factors = 1 + 1j * ((ticks + 0.5) / TICKS_PER_PERIOD - 0.5)
    return np.asarray(high @ factors / TICKS_PER_PERIOD, np.complex64)
