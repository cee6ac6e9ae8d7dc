"""What each transducer emits, from captured bits: the waves that skin and ears get.

`Playback` in `air` goes on to the pressure at points. Here the waves stay apart, one column for each transducer: `feel`
judges many places by them, and sound below the carrier as well.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..emulator import Capture
from ..emulator.ports.amplifier import Amplifier
from ..protocol.board import CARRIER_HZ, CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS, TICKS_PER_PERIOD
from ..solver import TransducerArray
from ..solver.acoustics.resonator import Resonator
from .air import SETTLED

__all__ = ["EmittedWaves", "emitted_waves"]

PERIODS_AT_A_TIME = 512  # whose drives fit a cache


class EmittedWaves(NamedTuple):
    """What the transducers emit, carrier period by carrier period."""

    first: int
    """The carrier period of the first row."""
    waves: NDArray[np.complex64]
    """Phasors at the beginning of each period, (t, n), after amplifier and resonance; 1 is full drive in the steady
    state. Time factor e^{-iωt}, ω of the carrier."""
    duty: NDArray[np.float32]
    """Share of each period in which the output is high, (t, n); 0 for transducers that are not connected."""

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
    if not begin <= first <= last <= capture.periods:
        raise ValueError(f"periods {first} to {last} are not within the captured {begin} to {capture.periods}")
    from .emission_kernels import count_high, ring_up  # importing numba takes half a second

    resonator = Resonator.of(array.transducer)
    resonance = resonator.enveloped(CARRIER_HZ, 1 / CARRIER_HZ)
    rate = (1 - resonance.decay) * resonance.gain * (amplifier or Amplifier()).gain
    settling = math.ceil(SETTLED * resonator.time_constant * CARRIER_HZ)
    state = np.zeros((2, CHANNELS))
    waves, duty = np.empty((last - first, CHANNELS), np.complex64), np.empty((last - first, CHANNELS), np.float32)
    columns = np.argsort(capture.wiring.channels).reshape(PROCESSORS, CHANNELS_PER_PROCESSOR)
    deranged = [processor for processor, track in enumerate(capture.tracks) if track.deranged]
    early = capture.drives(max(begin, first - settling), first)
    ring_up(early, resonance.decay, rate, _shares(), state, np.empty_like(early), np.empty(early.shape, np.float32))
    for start in range(first, last, PERIODS_AT_A_TIME):
        stop = min(start + PERIODS_AT_A_TIME, last)
        rows = slice(start - first, stop - first)
        drives = capture.drives(start, stop)
        ring_up(drives, resonance.decay, rate, _shares(), state, waves[rows], duty[rows])
        if deranged:  # its bits are not whole pulses, whose widths the drives tell
            words = capture.bits(start * TICKS_PER_PERIOD, stop * TICKS_PER_PERIOD)
            for processor in deranged:
                count_high(np.ascontiguousarray(words[:, processor]), columns[processor], duty[rows])
    for number, tick in capture.open_since.items():
        duty[max(tick // TICKS_PER_PERIOD - first, 0) :, number] = 0
    return EmittedWaves(first, waves, duty)


@cache
def _shares() -> NDArray[np.float32]:
    """The duty of a pulse by the square of its drive, sin²(π·duty), in the steps of `ring_up`."""
    from .emission_kernels import SQUARES

    squares = np.arange(SQUARES + 1) / SQUARES
    width = np.rint(TICKS_PER_PERIOD / np.pi * np.arcsin(np.sqrt(squares)))
    return (width / TICKS_PER_PERIOD).astype(np.float32)
