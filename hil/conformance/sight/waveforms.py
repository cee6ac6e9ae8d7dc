"""The expected outputs, from the formulae of SPEC.md alone, and their differences from the observed ones.

This module does not know how a device, emulated or real, makes its outputs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ....protocol.board import CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS, TICKS_PER_PERIOD
from ....protocol.pulses import Pulses
from ....protocol.wiring import Pin, Wiring
from ..cases import Inconclusive
from .capture import Seen

__all__ = [
    "SILENCE",
    "Words",
    "check_play",
    "check_silent",
    "expected_words",
    "modulated",
    "modulated_width",
    "only",
    "silent",
]

Words = NDArray[np.uint32]
"""Levels of all outputs: one row a tick, one column a processor in the order of the chain, bit b for output b."""

SILENCE: Words = np.zeros((TICKS_PER_PERIOD, PROCESSORS), np.uint32)
"""A period of low outputs, (50, 10)."""
SAMPLES, WIDTHS = 256, 26
CHUNK_PERIODS = 2048
"""Compared in one go: 4 MB."""


def expected_words(pulses: Pulses, wiring: Wiring) -> Words:
    """The outputs in a period of these pulses of 320 transducers, (50, 10) uint32.

    A pulse begins at tick ⌊(phase − width)/2⌋ modulo 50 and lasts `width` ticks (clause PUL-004).
    """
    width = pulses.width.astype(np.int64)
    start = (pulses.phase.astype(np.int64) - width) // 2 % TICKS_PER_PERIOD
    since = (np.arange(TICKS_PER_PERIOD)[:, None] - start) % TICKS_PER_PERIOD
    levels = np.zeros((TICKS_PER_PERIOD, CHANNELS), bool)
    levels[:, wiring.channels] = since < width
    packed: Words = np.packbits(levels, axis=1, bitorder="little").view("<u4").astype(np.uint32)
    return packed


def modulated_width(width: int, sample: int) -> int:
    """The width of a pulse under a modulation sample, by the formula of clause PUL-006."""
    return math.floor(
        TICKS_PER_PERIOD / math.pi * math.asin(sample / 255 * math.sin(math.pi * width / TICKS_PER_PERIOD)) + 1 / 2
    )


def modulated(pulses: Pulses, sample: int) -> Pulses:
    """Pulses under a modulation sample: the same phases, other widths (clause PUL-006)."""
    return Pulses(pulses.phase, _modulated_widths()[sample, pulses.width])


@cache
def _modulated_widths() -> NDArray[np.uint8]:
    return np.array(
        [[modulated_width(width, sample) for width in range(WIDTHS)] for sample in range(SAMPLES)], np.uint8
    )


def only(transducer: int, phase: int = 0, width: int = 25) -> Pulses:
    """The pulse of one transducer; all others are silent."""
    phases, widths = np.zeros(CHANNELS, np.uint8), np.zeros(CHANNELS, np.uint8)
    phases[transducer], widths[transducer] = phase, width
    return Pulses(phases, widths)


def silent(seen: Seen, first: int | None = None, last: int | None = None) -> bool:
    """Whether all observed outputs are low, from a period to another, not included."""
    return not _stretch(seen, first, last).any()


def check_silent(seen: Seen, first: int | None = None, last: int | None = None) -> None:
    """Fail if an observed output is not low throughout, from a period to another, not included."""
    first = seen.first_period if first is None else first
    last = seen.last_period if last is None else last
    check_play(seen, [(first, SILENCE)], last)


def check_play(seen: Seen, steps: Iterable[tuple[int, Words]], last: int | None = None) -> None:
    """Fail if the outputs did anything but these steps, each of which plays until the next begins.

    Parameters
    ----------
    seen : Seen
        Outputs that are not observed are not judged.
    steps : iterable of (int, (50, 10) uint32)
        The period from which the outputs do this in every period, in rising order. What came before the first step is
        not judged.
    last : int, optional
        Period before which the last step ends, otherwise the end of what was seen.

    Raises
    ------
    Inconclusive
        If something should play, but none of its outputs is observed.
    AssertionError
        An error with the first difference: its period, tick and output, what was seen there, and what should be.
    """
    last = seen.last_period if last is None else last
    known = list(steps)
    numbers = np.array([period for period, _ in known])
    patterns = {id(words): words for _, words in known}  # few, as they repeat
    whole = np.stack(list(patterns.values()))
    play = whole & seen.observed
    if whole.any() and not play.any():
        raise Inconclusive("none of the outputs that should play is observed; a probe at one of them is enough")
    places = {key: place for place, key in enumerate(patterns)}
    pattern = np.array([places[id(words)] for _, words in known])
    within = seen.first_period <= numbers[0] <= last <= seen.last_period
    assert within, (
        f"{numbers[0]} to {last} should be within the periods seen, {seen.first_period} to {seen.last_period}"
    )
    assert all(one < other for one, other in pairwise(numbers)), f"steps should be in rising order, not {numbers}"
    for begin in range(int(numbers[0]), last, CHUNK_PERIODS):
        end = min(begin + CHUNK_PERIODS, last)
        step = np.searchsorted(numbers, np.arange(begin, end), side="right") - 1
        found = (_stretch(seen, begin, end) & seen.observed).reshape(-1, TICKS_PER_PERIOD, PROCESSORS)
        differ = found != play[pattern[step]]
        if differ.any():
            at = int(np.argmax(differ.any(axis=(1, 2))))
            raise AssertionError(_difference(begin + at, found[at], play[pattern[step[at]]], int(numbers[step[at]])))


def _stretch(seen: Seen, first: int | None, last: int | None) -> Words:
    first = seen.first_period if first is None else first
    last = seen.last_period if last is None else last
    return seen.words[(first - seen.first_period) * TICKS_PER_PERIOD : (last - seen.first_period) * TICKS_PER_PERIOD]


def _difference(period: int, found: Words, wanted: Words, since: int) -> str:
    """The first difference within a period, for people."""
    differ = (found ^ wanted)[:, :, None] >> np.arange(CHANNELS_PER_PROCESSOR, dtype=np.uint32) & 1
    by_channel = differ.reshape(TICKS_PER_PERIOD, CHANNELS).astype(bool)
    tick = int(np.argmax(by_channel.any(axis=1)))
    channel = int(np.argmax(by_channel[tick]))
    return (
        f"the first difference is in period {period}, at tick {tick}, output {Pin.of(channel).name}; there\n"
        f"{_levels(found, channel)} is seen,\n{_levels(wanted, channel)} should be, from period {since} on\n"
        f"(in this period {int(by_channel.any(axis=0).sum())} outputs differ)"
    )


def _levels(words: Words, channel: int) -> str:
    processor, bit = divmod(channel, CHANNELS_PER_PROCESSOR)
    return "".join(".#"[int(word) >> bit & 1] for word in words[:, processor])
