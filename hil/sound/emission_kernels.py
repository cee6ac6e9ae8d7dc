"""Compiled kernels from the drives and bits of a capture to waves; see `emission`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.compiling import kernel
from ...protocol.board import CHANNELS_PER_PROCESSOR, TICKS_PER_PERIOD

__all__ = ["measure", "ring_up"]


@kernel
def ring_up(drives: Any, decay: Any, rate: Any, state: Any, waves: Any) -> None:
    """Let resonances follow their drives, period by period.

    Parameters
    ----------
    drives : (t, n) complex64
    decay, rate : complex128
        z ← decay·z + rate·drive.
    state : (2, n) float64
        Real and imaginary parts before the first period; afterwards, after the last.
    waves : (t, n) complex64
        Written: the state at the beginning of each period.
    """
    a, b, c, d = decay.real, decay.imag, rate.real, rate.imag
    for period in range(drives.shape[0]):
        for q in range(drives.shape[1]):
            x, y, u, v = state[0, q], state[1, q], drives[period, q].real, drives[period, q].imag
            waves[period, q] = complex(np.float32(x), np.float32(y))
            state[0, q] = a * x - b * y + c * u - d * v
            state[1, q] = a * y + b * x + c * v + d * u


@kernel
def measure(words: Any, columns: Any, pulses: Any) -> None:
    """Duty and moment of the outputs of one port in each period, whatever they play; see `EmittedWaves.pulses`.

    Parameters
    ----------
    words : (50 t,) uint32
    columns : (32,) int64
        Column of `pulses` for each bit.
    pulses : (t, n) complex64
        Those columns are written.
    """
    for period in range(pulses.shape[0]):
        for bit in range(CHANNELS_PER_PROCESSOR):
            high, moment = 0, 0  # ticks, and half ticks from the middle
            for tick in range(TICKS_PER_PERIOD):
                level = int(words[period * TICKS_PER_PERIOD + tick] >> np.uint32(bit) & np.uint32(1))
                high += level
                moment += level * (2 * tick + 1 - TICKS_PER_PERIOD)
            duty = high / TICKS_PER_PERIOD
            pulses[period, columns[bit]] = np.complex64(complex(duty, moment / (2 * TICKS_PER_PERIOD**2)))
