"""Compiled kernels: from pulses to port words, and from either to what is emitted.

What a period plays is given by the row of its 48 packed bytes and the modulation sample that applies; neighbours that
are alike are computed once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from ...base.compiling import kernel
from ...protocol.board import CHANNELS_PER_PROCESSOR, MAX_WIDTH_TICKS, TICKS_PER_PERIOD

__all__ = ["demodulate", "emit", "expand"]

U32 = np.uint32
PAIRS = CHANNELS_PER_PROCESSOR // 2
PULSE_BITS, PHASE_BITS = 12, 7
PHASE_MASK, WIDTH_MASK = (1 << PHASE_BITS) - 1, (1 << PULSE_BITS - PHASE_BITS) - 1


@kernel
def _pair(packed: Any, pair: int) -> Any:
    """Two pulses of 12 bits (clause PUL-005)."""
    return U32(packed[3 * pair]) | U32(packed[3 * pair + 1]) << U32(8) | U32(packed[3 * pair + 2]) << U32(16)


@kernel
def _rasterise(packed: Any, widths: Any, edges: Any, words: Any) -> None:
    """The 50 words of one period: a bit turns on where its pulse begins and off where it ends (clause PUL-004)."""
    edges[:] = U32(0)
    for pair in range(PAIRS):
        both = _pair(packed, pair)
        for odd in range(2):
            phase, width = int(both & U32(PHASE_MASK)), int(widths[both >> U32(PHASE_BITS) & U32(WIDTH_MASK)])
            bit = U32(1) << U32(2 * pair + odd)
            begin = (phase - width + 2 * TICKS_PER_PERIOD) >> 1
            if begin >= TICKS_PER_PERIOD:
                begin -= TICKS_PER_PERIOD
            edges[begin] ^= bit
            edges[begin + width] ^= bit  # at most 25 ticks after the end of the period; nothing for a width of 0
            both >>= U32(PULSE_BITS)
    running = U32(0)
    for tick in range(TICKS_PER_PERIOD + 1, edges.size):  # what goes round the end is high when the period begins
        running ^= edges[tick]
        edges[tick - TICKS_PER_PERIOD] ^= edges[tick]
    for tick in range(TICKS_PER_PERIOD):
        running ^= edges[tick]
        words[tick] = running


@kernel
def expand(slices: Any, rows: Any, samples: Any, widths: Any, words: Any) -> None:
    """Port words of all processors in successive periods.

    Parameters
    ----------
    slices : tuple of (s, 48) uint8
        Packed pulses of each processor.
    rows : (10, n) int64
        The place in these of what each period plays.
    samples : (10, n) uint8
        The modulation sample that applies in each period; 255 leaves pulses as they are.
    widths : (256, 26) uint8
        The width that each width gets under each sample.
    words : (50 n, 10) uint32
        The result, written here.
    """
    table = np.empty((TICKS_PER_PERIOD, len(slices)), np.uint32)
    edges = np.empty(TICKS_PER_PERIOD + MAX_WIDTH_TICKS, np.uint32)
    for period in range(rows.shape[1]):
        for processor in range(len(slices)):
            row, sample = rows[processor, period], samples[processor, period]
            if not period or row != rows[processor, period - 1] or sample != samples[processor, period - 1]:
                _rasterise(slices[processor][row], widths[sample], edges, table[:, processor])
        words[period * TICKS_PER_PERIOD : (period + 1) * TICKS_PER_PERIOD] = table


@kernel
def emit(slices: Any, rows: Any, samples: Any, widths: Any, drive: Any, columns: Any, drives: Any) -> None:
    """What all processors emit in successive periods, pulse by pulse.

    Parameters
    ----------
    slices, rows, samples, widths
        The arguments of `expand`.
    drive : (100, 26) complex
        The drive of a pulse of each phase and width.
    columns : (10, 32) int64
        Column of `drives` for each bit.
    drives : (n, 320) complex
        The result, written here.
    """
    for period in range(rows.shape[1]):
        if period:
            drives[period] = drives[period - 1]
        for processor in range(len(slices)):
            row, sample = rows[processor, period], samples[processor, period]
            if period and row == rows[processor, period - 1] and sample == samples[processor, period - 1]:
                continue
            for pair in range(PAIRS):
                both = _pair(slices[processor][row], pair)
                for odd in range(2):
                    width = widths[sample, both >> U32(PHASE_BITS) & U32(WIDTH_MASK)]
                    drives[period, columns[processor, 2 * pair + odd]] = drive[both & U32(PHASE_MASK), width]
                    both >>= U32(PULSE_BITS)


@kernel
def _lowest(word: Any) -> Any:
    """The lowest bit that is set."""
    return trailing_zeros(word)  # type: ignore[call-arg]  # numba passes an intrinsic its context


@kernel
def demodulate(words: Any, turn: Any, columns: Any, drives: Any) -> None:
    """The fundamental of each of a port's 32 square waves, in successive periods, from their edges.

    A wave that is high from tick r to tick f has (2/T)·∫ e^{iωt} dt = (e^{iωf} − e^{iωr})/(iπ); in units of the widest
    pulse's 2/π each edge counts ±e^{iωt}/(2i).

    Parameters
    ----------
    words : (50 n,) uint32
    turn : (50,) complex
        e^{iωt}/(2i) at each tick t of a period.
    columns : (32,) int64
        Column of `drives` for each bit.
    drives : (n, 320) complex
        Those columns are written.
    """
    sums = np.empty(CHANNELS_PER_PROCESSOR, drives.dtype)
    for period in range(drives.shape[0]):
        at = period * TICKS_PER_PERIOD
        sums[:] = 0
        before = words[at + TICKS_PER_PERIOD - 1]
        for tick in range(TICKS_PER_PERIOD):
            word = words[at + tick]
            rises, falls, before = word & ~before, before & ~word, word
            while rises:
                sums[_lowest(rises)] -= turn[tick]
                rises &= rises - U32(1)
            while falls:
                sums[_lowest(falls)] += turn[tick]
                falls &= falls - U32(1)
        for bit in range(CHANNELS_PER_PROCESSOR):
            drives[period, columns[bit]] = sums[bit]
