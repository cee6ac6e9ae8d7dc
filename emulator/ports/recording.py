"""What one port of an executed processor played, recorded from its pins: a table of 50 words for each period.

Neighbouring periods that are alike are kept once, so that memory grows with what changes, not with time. Periods and
ticks are those of the port's own clock.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import TICKS_PER_PERIOD
from ...protocol.chain import SLICE_BYTES
from .history import FULL, SILENT, Rows

__all__ = ["PortRecord", "PortRecording"]


class PortRecord(NamedTuple):
    """A recording as it was at some moment."""

    starts: NDArray[np.int64]
    """Period from which on each table plays, (t,), ascending; the first is before all time."""
    tables: NDArray[np.uint32]
    """The words of each, (t, 50)."""

    def words(self, start: int, stop: int) -> NDArray[np.uint32]:
        """The words at its own ticks, (stop - start,)."""
        first, last = start // TICKS_PER_PERIOD, -(-stop // TICKS_PER_PERIOD)
        table = np.searchsorted(self.starts, np.arange(first, last), side="right") - 1
        return self.tables[table].reshape(-1)[start - first * TICKS_PER_PERIOD :][: stop - start]

    # A capture expands pulses of all ports first, and then takes the words of those that play none: this one plays
    # silent pulses.

    @property
    def slices(self) -> NDArray[np.uint8]:
        """Silent pulses, (1, 48)."""
        return np.zeros((1, SLICE_BYTES), np.uint8)

    def rows(self, first: int, last: int) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """The row of `slices` and the modulation sample of each period, (n,) each."""
        return np.full(last - first, SILENT, np.int64), np.full(last - first, FULL, np.uint8)


BEFORE_ALL = -(2**62)


class PortRecording:
    """Takes the words of successive ticks."""

    def __init__(self) -> None:
        self._starts = Rows.of(np.array([BEFORE_ALL], np.int64))
        self._tables = Rows.of(np.zeros((1, TICKS_PER_PERIOD), np.uint32))
        self._begun = np.empty(0, np.uint32)
        self._period = 0

    @property
    def ticks(self) -> int:
        """Ticks that were recorded."""
        return self._period * TICKS_PER_PERIOD + len(self._begun)

    def extend(self, words: NDArray[np.uint32]) -> None:
        """Take the words of the ticks after those that were recorded."""
        begun = np.concatenate([self._begun, words])
        whole = len(begun) // TICKS_PER_PERIOD
        tables, self._begun = (
            begun[: whole * TICKS_PER_PERIOD].reshape(-1, TICKS_PER_PERIOD),
            begun[whole * TICKS_PER_PERIOD :],
        )
        before = np.concatenate([self._tables.view()[-1:], tables[:-1]])[:whole]
        new = np.flatnonzero((tables != before).any(axis=1))
        self._starts.extend(self._period + new)
        self._tables.extend(tables[new])
        self._period += whole

    def recorded(self) -> PortRecord:
        """All of it, as it is now; what is not recorded yet of a period that has begun counts as silent."""
        starts, tables = self._starts.view(), self._tables.view()
        if not len(self._begun):
            return PortRecord(starts, tables)
        last = np.zeros((1, TICKS_PER_PERIOD), np.uint32)
        last[0, : len(self._begun)] = self._begun
        return PortRecord(np.append(starts, self._period), np.concatenate([tables, last]))

    def forget(self, period: int) -> None:
        """Drop what had ended when a period began."""
        stale = int(np.searchsorted(self._starts.view(), period, side="right")) - 1
        if stale > 0:
            self._starts = Rows.of(self._starts.view()[stale:])
            self._tables = Rows.of(self._tables.view()[stale:])
