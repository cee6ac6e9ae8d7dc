"""Compiled kernels: from pulses to port words, and from port words to what they emit.

What a period plays is given by the row of its 48 packed bytes and the modulation sample that applies; neighbours that
are alike are computed once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiling import kernel
from ..protocol.board import CHANNELS_PER_PROCESSOR, TICKS_PER_PERIOD

__all__ = ["demodulate", "expand"]

U32 = np.uint32
PAIRS = CHANNELS_PER_PROCESSOR // 2


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
    """Port words of successive periods.

    Parameters
    ----------
    slices : (s, 48) uint8
        Packed pulses of one processor.
    rows : (n,) int64
        For each period, which of them it plays.
    samples : (n,) uint8
        For each period, the modulation sample that applies; 255 leaves pulses as they are.
    widths : (256, 26) uint8
        The width that each width gets under each sample.
    words : (50 n,) uint32
        Written.
    """
    for period in range(rows.size):
        at = period * TICKS_PER_PERIOD
        if period and rows[period] == rows[period - 1] and samples[period] == samples[period - 1]:
            for tick in range(at, at + TICKS_PER_PERIOD):
                words[tick] = words[tick - TICKS_PER_PERIOD]
        else:
            _rasterise(slices[rows[period]], widths[samples[period]], words[at : at + TICKS_PER_PERIOD])


@kernel
def demodulate(words: Any, alike: Any, turn: Any, columns: Any, drives: Any) -> None:
    """The fundamental of each of a port's 32 square waves, in successive periods, from their edges.

    A wave that is high from tick r to tick f has (2/T)·∫ e^{iωt} dt = (e^{iωf} − e^{iωr})/(iπ); in units of the widest
    pulse's 2/π each edge counts ±e^{iωt}/(2i).

    Parameters
    ----------
    words : (50 n,) uint32
    alike : (n,) bool
        Whether a period is known to be as the one before.
    turn : (50,) complex
        e^{iωt}/(2i) at each tick t of a period.
    columns : (32,) int64
        Column of `drives` for each bit.
    drives : (n, 320) complex
        Those columns are written.
    """
    for period in range(alike.size):
        if alike[period]:
            for bit in range(CHANNELS_PER_PROCESSOR):
                drives[period, columns[bit]] = drives[period - 1, columns[bit]]
            continue
        for bit in range(CHANNELS_PER_PROCESSOR):
            drives[period, columns[bit]] = 0
        at = period * TICKS_PER_PERIOD
        before = words[at + TICKS_PER_PERIOD - 1]
        for tick in range(TICKS_PER_PERIOD):
            word = words[at + tick]
            edges = word ^ before
            before = word
            bit = 0
            while edges:
                if edges & U32(1):
                    if word >> U32(bit) & U32(1):
                        drives[period, columns[bit]] -= turn[tick]
                    else:
                        drives[period, columns[bit]] += turn[tick]
                edges >>= U32(1)
                bit += 1
