"""The outputs, tick by tick: an oracle of the emulator, written from SPEC.md alone.

It shares no code with the implementation. What the device has accepted is a list of changes with the periods at which
they take effect; the words of the ten ports in every tick follow from these alone. Slowness does not matter.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests import from_spec as spec

Pulses = tuple[spec.Pulse, ...]
Words = NDArray[np.uint32]
Item = tuple[str, int]
"""A slot, entry or sample and its number or place."""

SILENT: Pulses = ((0, 0),) * 320
FULL = 255
"""The sample under which a pulse stays as it is."""


class Change(NamedTuple):
    """A change that was accepted. An update is a sequence of one step without end, silence one of no steps."""

    period: int
    """At which it takes effect."""
    steps: tuple[tuple[Pulses, int], ...] | None = None
    """Pulses and for how many periods they play; None leaves the pulses unchanged."""
    repeats: int = 0
    samples: bytes | None = None
    """Amplitudes of the modulation, empty to end it; None leaves it unchanged."""
    hold: int = 1
    unattended: bool = False
    sequence: bool = False
    disables: bool = False
    tokens: int = 0
    """Its messages on the first link, at most (CHN-006, CHN-029)."""
    guards: frozenset[Item] = frozenset()
    """The stored items that it plays (BLK-022)."""

    @property
    def length(self) -> int:
        """Periods that the steps take once."""
        return sum(periods for _, periods in self.steps or ())

    @property
    def end(self) -> float:
        """The period at which a sequence has played its last repeat (BLK-015)."""
        return self.period + self.repeats * self.length if self.repeats else float("inf")


def playing(changes: Sequence[Change], period: int) -> Change | None:
    """The update or the sequence that plays (BLK-012, BLK-015)."""
    begun = [change for change in changes if change.steps is not None and change.period <= period]
    if not begun or not begun[-1].steps or period >= begun[-1].end:
        return None
    return begun[-1]


def modulating(changes: Sequence[Change], period: int) -> Change | None:
    """The modulation that plays (BLK-012, BLK-017)."""
    begun = [change for change in changes if change.samples is not None and change.period <= period]
    return begun[-1] if begun and begun[-1].samples else None


def pulses_in(changes: Sequence[Change], period: int) -> Pulses:
    """The pulses of a period, before modulation: the entry whose turn it is (BLK-015)."""
    change = playing(changes, period)
    if change is None or change.steps is None:
        return SILENT
    left = (period - change.period) % change.length
    for pulses, periods in change.steps:
        if left < periods:
            return pulses
        left -= periods
    raise AssertionError("a position within the sequence has a step")


def sample_in(changes: Sequence[Change], period: int) -> int:
    """The modulation's sample of a period, by its own count of periods (BLK-017)."""
    change = modulating(changes, period)
    if change is None or change.samples is None:
        return FULL
    return change.samples[(period - change.period) // change.hold % len(change.samples)]


@functools.lru_cache(None)
def high(pulse: spec.Pulse, sample: int) -> list[int]:
    """The ticks in which an output is high (PUL-004, PUL-006)."""
    phase, width = pulse
    return sorted(spec.high_ticks((phase, spec.modulated_width(width, sample))))


@functools.lru_cache(1000)
def port_words(pulses: Pulses, sample: int, wiring: tuple[int, ...]) -> Words:
    """The words of the ten ports in the fifty ticks of a period, (50, 10) (REQ-004)."""
    words = np.zeros((50, 10), np.uint32)
    for pulse, channel in zip(pulses, wiring, strict=True):
        processor, bit = divmod(channel, 32)
        words[high(pulse, sample), processor] |= np.uint32(1 << bit)
    return words


def period_words(changes: Sequence[Change], period: int, wiring: tuple[int, ...]) -> Words:
    """The words of all ports in a period, (50, 10)."""
    return port_words(pulses_in(changes, period), sample_in(changes, period), wiring)
