"""Compiled kernels from the drives and bits of a capture to waves; see `emission`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiling import kernel
from ..protocol.board import CHANNELS_PER_PROCESSOR, TICKS_PER_PERIOD

__all__ = ["SQUARES", "count_high", "ring_up"]

SQUARES = 1024
"""Steps of |drive|² from 0 to 1; pulses of neighbouring widths are at least four steps apart."""


@kernel
def ring_up(drives: Any, decay: Any, rate: Any, shares: Any, state: Any, waves: Any, duty: Any) -> None:
    """Let resonances follow their drives, period by period, and look up the duty of each pulse.

    Parameters
    ----------
    drives : (t, n) complex64
    decay, rate : complex128
        z ← decay·z + rate·drive.
    shares : (SQUARES + 1,) float32
        Duty of the pulse whose |drive|² is so many steps.
    state : (2, n) float64
        Real and imaginary parts before the first period; afterwards, after the last.
    waves : (t, n) complex64
        Written: the state at the beginning of each period.
    duty : (t, n) float32
        Written.
    """
    a, b, c, d = decay.real, decay.imag, rate.real, rate.imag
    for period in range(drives.shape[0]):
        for q in range(drives.shape[1]):
            x, y, u, v = state[0, q], state[1, q], drives[period, q].real, drives[period, q].imag
            waves[period, q] = complex(np.float32(x), np.float32(y))
            state[0, q] = a * x - b * y + c * u - d * v
            state[1, q] = a * y + b * x + c * v + d * u
            duty[period, q] = shares[min(int((u * u + v * v) * np.float32(SQUARES) + np.float32(0.5)), SQUARES)]


@kernel
def count_high(words: Any, columns: Any, duty: Any) -> None:
    """Share of each period in which the outputs of one port are high, whatever they play.

    Parameters
    ----------
    words : (50 t,) uint32
    columns : (32,) int64
        Column of `duty` for each bit.
    duty : (t, n) float32
        Those columns are written.
    """
    for period in range(duty.shape[0]):
        for bit in range(CHANNELS_PER_PROCESSOR):
            high = 0
            for tick in range(TICKS_PER_PERIOD):
                high += words[period * TICKS_PER_PERIOD + tick] >> np.uint32(bit) & np.uint32(1)
            duty[period, columns[bit]] = np.float32(high / TICKS_PER_PERIOD)
