"""Compiled kernels: from pulses to port words, and from port words to what they emit.

What a period plays is given by the row of its 48 packed bytes and the modulation sample that applies; neighbours that
are alike are computed once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from ..compiling import kernel
from ..protocol.board import CHANNELS_PER_PROCESSOR, TICKS_PER_PERIOD

__all__ = ["demodulate", "expand"]

U32 = np.uint32
PAIRS = CHANNELS_PER_PROCESSOR // 2


@kernel
def _lowest(word: Any) -> Any:
    """The lowest bit that is set."""
    return trailing_zeros(word)  # type: ignore[call-arg]  # numba passes an intrinsic its context


@kernel
def _rasterise(packed: Any, widths: Any, words: Any) -> None:
    """The 50 words of one period: a bit turns on where its pulse begins and off where it ends (clause PUL-004)."""
    running = U32(0)
    words[:] = U32(0)
    for pair in range(PAIRS):
        first, middle, last = packed[3 * pair], packed[3 * pair + 1], packed[3 * pair + 2]
        for odd in range(2):
            if odd:
                phase, width = int(middle >> 4 | (last & 7) << 4), int(widths[last >> 3])
            else:
                phase, width = int(first & 0x7F), int(widths[first >> 7 | (middle & 15) << 1])
            if width == 0:
                continue
            bit = U32(1) << U32(2 * pair + odd)
            start = ((phase - width) >> 1) % TICKS_PER_PERIOD
            stop = start + width
            words[start] ^= bit
            if stop < TICKS_PER_PERIOD:
                words[stop] ^= bit
            elif stop > TICKS_PER_PERIOD:  # round the end of the period: high when it begins
                words[stop - TICKS_PER_PERIOD] ^= bit
                running ^= bit
    for tick in range(TICKS_PER_PERIOD):
        running ^= words[tick]
        words[tick] = running


@kernel
def expand(slices: Any, rows: Any, samples: Any, widths: Any, words: Any) -> None:
    """Port words of all processors in successive periods.

    Parameters
    ----------
    slices : tuple of (s, 48) uint8
        For each processor, packed pulses.
    rows : (10, n) int64
        For each period, which of them it plays.
    samples : (10, n) uint8
        For each period, the modulation sample that applies; 255 leaves pulses as they are.
    widths : (256, 26) uint8
        The width that each width gets under each sample.
    words : (50 n, 10) uint32
        Written.
    """
    table = np.empty((TICKS_PER_PERIOD, len(slices)), np.uint32)
    for period in range(rows.shape[1]):
        for processor in range(len(slices)):
            row, sample = rows[processor, period], samples[processor, period]
            if not period or row != rows[processor, period - 1] or sample != samples[processor, period - 1]:
                _rasterise(slices[processor][row], widths[sample], table[:, processor])
        words[period * TICKS_PER_PERIOD : (period + 1) * TICKS_PER_PERIOD] = table


@kernel
def demodulate(words: Any, alike: Any, turn: Any, columns: Any, drives: Any) -> None:
    """The fundamental of each of the 320 square waves, in successive periods, from their edges.

    A wave that is high from tick r to tick f has (2/T)·∫ e^{iωt} dt = (e^{iωf} − e^{iωr})/(iπ); in units of the widest
    pulse's 2/π each edge counts ±e^{iωt}/(2i).

    Parameters
    ----------
    words : (50 n, 10) uint32
    alike : (10, n) bool
        Whether a processor is known to play in a period what it played in the one before.
    turn : (50,) complex
        e^{iωt}/(2i) at each tick t of a period.
    columns : (10, 32) int64
        Column of `drives` for each bit.
    drives : (n, 320) complex
        Written.
    """
    sums = np.empty(CHANNELS_PER_PROCESSOR, drives.dtype)
    for period in range(alike.shape[1]):
        at = period * TICKS_PER_PERIOD
        if period:
            drives[period] = drives[period - 1]
        for processor in range(alike.shape[0]):
            if period and alike[processor, period]:
                continue
            sums[:] = 0
            before = words[at + TICKS_PER_PERIOD - 1, processor]
            for tick in range(TICKS_PER_PERIOD):
                word = words[at + tick, processor]
                rises, falls, before = word & ~before, before & ~word, word
                while rises:
                    sums[_lowest(rises)] -= turn[tick]
                    rises &= rises - U32(1)
                while falls:
                    sums[_lowest(falls)] += turn[tick]
                    falls &= falls - U32(1)
            for bit in range(CHANNELS_PER_PROCESSOR):
                drives[period, columns[processor, bit]] = sums[bit]
