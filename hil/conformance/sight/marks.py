"""Marks: patterns that a device plays to align a recording of its outputs with its own count of periods.

A mark is a few changes between a weak pulse on all outputs and silence, a random number of periods apart, so that no
two are alike. The place of the pattern in a recording gives the recording's time; between two marks that are close
together it runs evenly (`TimeBase`). This module reads no file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....protocol.board import CHANNELS, TICK_HZ, TICKS_PER_PERIOD
from ....protocol.pulses import Pulses

__all__ = ["LONGEST_PULSE_GAP", "MARK_PULSES", "Anchor", "Mark", "TimeBase", "find_mark", "time_bases"]

WIDTH = 3
MARK_PULSES = Pulses(np.full(CHANNELS, WIDTH), np.full(CHANNELS, WIDTH))
"""The pulses of a mark while it is on. They begin with the period and last 3 ticks (clause PUL-004), so that neither
the first pulse nor the last is cut."""

CHANGES = 13
LEAST_GAP, MOST_GAP = 2, 40
"""Periods between two changes of a mark: the minimum, and the random range."""

LONGEST_PULSE_GAP = 2 * TICKS_PER_PERIOD - WIDTH
"""Ticks; longer silence is intended. Within a mark pulses are 47 ticks apart, or 147 and more."""

CLOCK_TOLERANCE = 200e-6
"""The greatest relative error of the recorder's clock against the device's."""
JITTER_SAMPLES = 3
"""The error of the distance of two edges: one sample for the jitter of each, and one for the grid of samples."""
LONGEST_STRETCH_TICKS = 10 * TICK_HZ
"""The greatest distance of two marks: clocks run evenly enough for so long."""


@dataclass(frozen=True)
class Mark:
    """A mark as it was played.

    Raises
    ------
    ValueError
        If these are not the changes of a mark.
    """

    changes: tuple[tuple[int, bool], ...]
    """The periods from which all outputs play `MARK_PULSES`, or are silent: in turn, at least 2 periods apart. Before
    the first, which is on, all is silent for at least 2 periods; the last is off, and silence follows for 2 periods."""

    def __post_init__(self) -> None:
        """Check the order."""
        if not any(on for _, on in self.changes) or self.changes[-1][1]:
            raise ValueError(f"a mark goes on and ends with silence, not as {self.changes}")
        for (before, was_on), (after, on) in pairwise(self.changes):
            if on == was_on or after - before < LEAST_GAP:
                raise ValueError(
                    f"changes of a mark at periods {before} and {after}: on and off in turn, "
                    f"at least {LEAST_GAP} periods apart"
                )

    @staticmethod
    def plan(rng: Random) -> list[tuple[int, bool]]:
        """Draw a mark to be played: the periods after the previous change, and whether on or off.

        It begins with silence, whatever was played before. A mark may be played otherwise than drawn; the acknowledged
        periods count.
        """
        return [(rng.randint(LEAST_GAP, MOST_GAP), number % 2 == 1) for number in range(CHANGES)]

    @property
    def first_period(self) -> int:
        """The period in which it is on for the first time."""
        return int(self.edges[0]) // TICKS_PER_PERIOD

    @property
    def last_period(self) -> int:
        """The period from which it is off."""
        return self.changes[-1][0]

    @property
    def edges(self) -> NDArray[np.int64]:
        """Ticks at which an interval of pulses begins or ends, in turn: the first rise and the last fall."""
        known = self.changes if self.changes[0][1] else self.changes[1:]
        periods = np.array([period for period, _ in known], np.int64).reshape(-1, 2)
        return np.ravel(periods * TICKS_PER_PERIOD + np.array([0, WIDTH - TICKS_PER_PERIOD]))


class Anchor(NamedTuple):
    """A mark that was found."""

    mark: Mark
    tick: float
    """Tick of the device, in the middle of the mark."""
    sample: float
    """Sample of the recording, at that moment."""


def find_mark(mark: Mark, silences: NDArray[np.int64], samples_per_tick: float) -> Anchor | None:
    """Find a mark by the pattern of its gaps; None if it is nowhere, or in several places.

    The silences, (s, 2) int, are those longer than `LONGEST_PULSE_GAP`: the first sample that is low, and the first
    that is high again. The samples per tick are known to `CLOCK_TOLERANCE`.
    """
    edges, ticks = silences.ravel(), mark.edges
    at = np.arange(1, edges.size - ticks.size + 1, 2)  # the rises; the mark may begin at each
    for place, gap in enumerate((np.diff(ticks) * samples_per_tick).tolist()):
        seen = edges[at + place + 1] - edges[at + place]
        at = at[np.abs(seen - gap) <= CLOCK_TOLERANCE * gap + JITTER_SAMPLES]
    if at.size != 1:
        return None
    found = edges[at[0] : at[0] + ticks.size]
    return Anchor(mark, float(ticks.mean()), float(found.mean()) - 0.5)  # an edge is seen half a sample late


@dataclass(frozen=True)
class TimeBase:
    """The time of a recording from one mark to another: straight lines between the middles of all marks on the way."""

    anchors: Sequence[Anchor]
    """At least two, in the order of time."""

    def covers(self, first_period: int, last_period: int) -> bool:
        """Whether some periods lie within it, the last not included."""
        return self.anchors[0].mark.first_period <= first_period and last_period <= self.anchors[-1].mark.last_period

    @property
    def samples_per_tick(self) -> float:
        """The mean rate of the recorder's clock by the device's."""
        first, last = self.anchors[0], self.anchors[-1]
        return (last.sample - first.sample) / (last.tick - first.tick)

    def samples_at(self, ticks: NDArray[np.floating]) -> NDArray[np.float64]:
        """The places in the recording, in samples, of ticks of the device."""
        _, known_ticks, known_samples = map(np.array, zip(*self.anchors, strict=True))
        lines = np.clip(np.searchsorted(known_ticks, ticks) - 1, 0, len(self.anchors) - 2)
        slopes = np.diff(known_samples) / np.diff(known_ticks)
        return np.asarray(known_samples[lines] + slopes[lines] * (ticks - known_ticks[lines]))


def time_bases(anchors: Iterable[Anchor], samples_per_tick: float) -> Iterator[TimeBase]:
    """The intervals of a recording whose time is known, from marks in the order in which they were played.

    There is no interval between two marks if the device restarted between them, because its count restarts. The samples
    per tick are known to `CLOCK_TOLERANCE`.
    """
    chain: list[Anchor] = []
    for anchor in anchors:
        if chain and not _linked(chain[-1], anchor, samples_per_tick):
            yield from _base(chain)
            chain = []
        chain.append(anchor)
    yield from _base(chain)


def _base(chain: list[Anchor]) -> Iterator[TimeBase]:
    if len(chain) > 1:
        yield TimeBase(chain)


def _linked(before: Anchor, after: Anchor, samples_per_tick: float) -> bool:
    """Whether the time between two marks is known."""
    ticks, samples = after.tick - before.tick, after.sample - before.sample
    expected = ticks * samples_per_tick
    return 0 < ticks < LONGEST_STRETCH_TICKS and abs(samples - expected) <= CLOCK_TOLERANCE * expected + JITTER_SAMPLES
