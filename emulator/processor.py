"""One driver processor: a mailbox, a rasteriser, and two tables of 50 words that a 32-bit port plays in turn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..protocol.blocks import unpack_pulses
from ..protocol.board import CHANNELS_PER_PROCESSOR, CYCLES_PER_PERIOD, TICKS_PER_PERIOD
from ..protocol.chain import Commit, Slice, decode
from ..protocol.pulses import Pulses
from ..protocol.timing import RASTERISE_CYCLES
from .scheduler import Scheduler

__all__ = ["Processor", "rasterise"]

_BITS = np.uint32(1) << np.arange(CHANNELS_PER_PROCESSOR, dtype=np.uint32)


def rasterise(pulses: Pulses) -> NDArray[np.uint32]:
    """The 50 port words of one carrier period, one bit per transducer, (50,) uint32."""
    since_start = (np.arange(TICKS_PER_PERIOD)[:, None] - pulses.start) % TICKS_PER_PERIOD
    high = since_start < pulses.width
    return np.asarray(np.bitwise_or.reduce(np.where(high, _BITS, np.uint32(0)), axis=1))


class Processor:
    """Receives slices and commits, and records what its port plays.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    offset_ticks : int
        How late this processor's port clock runs against the others'.
    log : callable
        Takes a line about each thing that happens.
    """

    def __init__(self, scheduler: Scheduler, offset_ticks: int, log: Callable[[str], None]) -> None:
        self._scheduler = scheduler
        self._offset_ticks = offset_ticks
        self._log = log
        self._mailbox = b""
        self._waiting = False
        self.missed_commits = 0
        self.starts: list[int] = [0]
        self.tables: list[NDArray[np.uint32]] = [np.zeros(TICKS_PER_PERIOD, np.uint32)]

    def receive(self, tokens: bytes) -> None:
        """Take a message from the chain, complete at this moment."""
        message = decode(tokens)
        if isinstance(message, Slice):
            self._mailbox = message.packed
        elif isinstance(message, Commit):
            self._commit(message)

    def _commit(self, commit: Commit) -> None:
        problem = None
        if not commit.guards(self._mailbox):
            problem = "the slice in the mailbox is another"
        elif self._waiting:
            problem = "another table waits"
        elif self._scheduler.now + RASTERISE_CYCLES > commit.period * CYCLES_PER_PERIOD:
            problem = "too late to rasterise"
        if problem:
            self.missed_commits += 1
            self._log(f"misses the commit for period {commit.period}: {problem}")
            return
        self._waiting = True
        table = rasterise(unpack_pulses(self._mailbox))
        self._scheduler.at(commit.period * CYCLES_PER_PERIOD, lambda: self._swap(commit.period, table))

    def _swap(self, period: int, table: NDArray[np.uint32]) -> None:
        self._waiting = False
        self.starts.append(period * TICKS_PER_PERIOD + self._offset_ticks)
        self.tables.append(np.roll(table, self._offset_ticks))
        self._log(f"plays the new table from tick {self.starts[-1]}")
