"""Store loading: sends what blocks store to the processors' memories, one load at a time (clause CHN-019).

A load goes when it fits between the changes of the `Agenda` and the questions of the `Supervisor`. `Stores` knows what
is stored and in use; this module knows only which loads have not gone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from ...protocol.chain import Load
from ..ports.clock import Timebase
from ..scheduler import Scheduler
from .agenda import Agenda
from .chain import Chain
from .supervisor import QUESTION_CYCLES

__all__ = ["Loading"]


class _Waiting(NamedTuple):
    ready: int
    """Core cycle from which on it can be sent."""
    load: Load
    last: bool
    """Whether it is the last of its block."""


class Loading:
    """Loads that wait to go onto the chain."""

    def __init__(
        self,
        scheduler: Scheduler,
        time: Timebase,
        chain: Chain,
        agenda: Agenda,
        settle: Callable[[], None],
        on_gone: Callable[[], None],
    ) -> None:
        self._scheduler = scheduler
        self._time = time
        self._chain = chain
        self._agenda = agenda
        self._settle = settle
        self._on_gone = on_gone
        self._waiting: deque[_Waiting] = deque()
        self._question_at = scheduler.now
        self._turn = 0  # advanced with each time that is set for the next load; earlier ones count no more
        self.blocks = 0
        """Blocks of which a load still waits."""
        self.leaves = scheduler.now
        """Core cycle at which the load that was begun last has left."""

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, loads: Sequence[Load], ready: int) -> None:
        """Take the loads of a block, which can be sent from a core cycle on."""
        begins = not self._waiting
        *others, last = loads
        self._waiting += [_Waiting(ready, load, last=False) for load in others]
        self._waiting.append(_Waiting(ready, last, last=True))
        self.blocks += 1
        if begins:
            self._send_at(max(ready, self.leaves))

    def wake(self) -> None:
        """Changes were dropped: the next load may fit sooner than was thought."""
        if self._waiting:
            self._send_at(max(self._scheduler.now, self.leaves))

    def drop(self) -> None:
        """Nothing goes onto the chain any more."""
        self._waiting.clear()
        self.blocks = 0
        self._turn += 1

    def make_way(self, cycle: int) -> None:
        """A question goes at a core cycle: begin no load that would be in its way, or it would wait for all of them."""
        self._question_at = cycle

    def _question_after(self, cycle: int) -> int:
        """When the next question goes; on a folded chain it is not asked, and takes its time all the same."""
        if not self._chain.folded:
            return self._question_at
        return self._time.origin - (self._time.origin - cycle) // QUESTION_CYCLES * QUESTION_CYCLES

    def _send_at(self, cycle: int) -> None:
        self._turn += 1
        self._scheduler.at(cycle, partial(self._send, self._turn))

    def _send(self, turn: int) -> None:
        """Send the next load, if it will have left before the next change is due."""
        if turn != self._turn or not self._waiting:
            return
        self._settle()
        now, (ready, load, last) = self._scheduler.now, self._waiting[0]
        load_cycles = self._agenda.load_cycles
        at = max(now, ready, self._agenda.gap(now, load_cycles), self._chain.free_at)
        question = self._question_after(at)
        if at <= question < at + load_cycles:
            at = question + self._agenda.question_cycles
        if at > now:
            self._send_at(at)
            return
        self._waiting.popleft()
        self._chain.load(load)
        self.leaves = now + load_cycles
        self._send_at(self.leaves)
        if last:
            self.blocks -= 1
            self._on_gone()
