"""Broken rasterisers: from phase and width to the ticks in which an output is high (chapter PUL).

In all of them, what a processor reports as playing is right.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ....emulator.ports import raster
from ....protocol.board import MAX_WIDTH_TICKS, TICKS_PER_PERIOD
from .patching import Patch, mutant
from .seams import Words, is_high, rasterise, see_words, spread

INVERTED_PROCESSOR, INVERTED_BIT = 4, 17


@mutant("PUL-004")
def odd_pairs_are_half_a_tick_late(patch: Patch) -> None:
    """If phase and width differ in parity the pulse begins half a tick late instead of early: it is rounded up."""
    rasterise(patch, lambda phase, width, _, tick: (tick - ((phase - width + 1) >> 1)) % TICKS_PER_PERIOD < width)


@mutant("PUL-004", by=rasterise)
def widest_pulse_has_24_ticks(phase: Any, width: Any, unmodulated: Any, tick: Any) -> Any:
    """A pulse of 25 ticks lasts 24: a table of widths ends one entry early."""
    full = is_high(phase, width, unmodulated, tick)
    return full & ~((width == MAX_WIDTH_TICKS) & ((tick - ((phase - width) >> 1)) % TICKS_PER_PERIOD == 24))


@mutant("PUL-004", by=rasterise)
def pulse_ends_with_the_period(phase: Any, width: Any, _: Any, tick: Any) -> Any:
    """A pulse that wraps around the end of the period is cut off there: its rest is not carried to the beginning."""
    begin = ((phase - width) >> 1) % TICKS_PER_PERIOD
    return (begin <= tick) & (tick < begin + width)


@mutant("PUL-004", "TIM-003")
def pulse_ends_in_the_next_period(patch: Patch) -> None:
    """The rest of a pulse that wraps is high in the following period, even if other pulses play by then."""

    def whole(phase: Any, width: Any, _: Any, tick: Any) -> Any:
        begin = ((phase - width) >> 1) % TICKS_PER_PERIOD
        return (begin <= tick) & (tick < begin + width)

    def rest(phase: Any, width: Any, _: Any, tick: Any) -> Any:
        begin = ((phase - width) >> 1) % TICKS_PER_PERIOD
        return tick < begin + width - TICKS_PER_PERIOD

    heads, tails = spread(whole), spread(rest)

    def expand(slices: Any, rows: Any, samples: Any, widths: Any, words: Words) -> None:
        played, left = heads(slices, rows, samples, widths), tails(slices, rows, samples, widths)
        words[:] = played
        words[TICKS_PER_PERIOD:] |= left[:-TICKS_PER_PERIOD]

    def with_the_period_before(words: Any, start: int, stop: int) -> Words:
        seen: Words = words(start - TICKS_PER_PERIOD, stop)[TICKS_PER_PERIOD:]
        return seen

    patch.replace(raster, "expand", expand)
    see_words(patch, with_the_period_before)


@mutant("PUL-001", "PUL-004")
def phase_99_is_taken_for_0(patch: Patch) -> None:
    """The last phase plays as phase 0: phases are taken modulo 99."""
    rasterise(patch, lambda phase, width, *rest: is_high(phase % 99, width, *rest))


@mutant("PUL-002")
def width_0_plays_a_tick(patch: Patch) -> None:
    """A pulse of width 0 with a phase plays one tick: only a pulse whose 12 bits are all 0 is skipped."""
    rasterise(patch, lambda phase, width, *rest: is_high(phase, np.where((width == 0) & (phase > 0), 1, width), *rest))


@mutant("PUL-001", "PUL-004")
def phase_is_that_of_the_leading_edge(patch: Patch) -> None:
    """A pulse begins at its phase; its centre should be there."""
    rasterise(patch, lambda phase, width, _, tick: (tick - (phase >> 1)) % TICKS_PER_PERIOD < width)


@mutant("PUL-001", "PUL-004")
def phase_is_in_whole_ticks(patch: Patch) -> None:
    """The lowest bit of the phase is dropped first: a pulse can only start at every other position."""
    rasterise(patch, lambda phase, width, *rest: is_high(phase & ~1, width, *rest))


@mutant("PUL-004")
def odd_widths_are_one_less(patch: Patch) -> None:
    """A pulse of odd width is a tick shorter: it is drawn as two equal halves around its centre."""
    rasterise(patch, lambda phase, width, *rest: is_high(phase, width & ~1, *rest))


@mutant("PUL-004")
def pulses_run_backwards(patch: Patch) -> None:
    """A later phase plays earlier: a port shifts its table out from the other end."""
    rasterise(patch, lambda phase, width, _, tick: is_high(phase, width, _, TICKS_PER_PERIOD - 1 - tick))


@mutant("PUL-004", "SAF-001", by=see_words)
def one_output_is_inverted(words: Any, start: int, stop: int) -> Words:
    """Bit 17 of processor 4 is low when it should be high, and high when it should be low."""
    inverted: Words = words(start, stop)
    inverted[:, INVERTED_PROCESSOR] ^= np.uint32(1 << INVERTED_BIT)
    return inverted


@mutant("PUL-004", by=rasterise)
def tick_0_repeats_the_last(phase: Any, width: Any, unmodulated: Any, tick: Any) -> Any:
    """The first tick of a period repeats the last one of the period before: the port's word is written a tick late."""
    return is_high(phase, width, unmodulated, np.where(tick == 0, TICKS_PER_PERIOD - 1, tick))
