"""Matches acknowledgements to blocks, and records the result of each block.

Blocks are entered in consecutively numbered parcels when they are sent. Acknowledgements come in the order of the
blocks; on a lossless line each block has one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...base.errors import ReplyError
from ...protocol.codes import Reason
from ...protocol.replies import ACKS

__all__ = ["DAMAGE", "NUMBERS", "Answers", "Ledger", "Parcel"]

NUMBERS = 2**32
DAMAGE = frozenset({Reason.LENGTH, Reason.CHECKSUM})
"""Reasons that concern the line rather than the block."""


class Answers(NamedTuple):
    """The results of k blocks.

    Parameters
    ----------
    acks : (k,) structured
        Their acknowledgements, with the fields of `protocol.replies.ACKS`; zeros if there was none.
    answered : (k,) bool
        Whether there was one. If not, the block or its acknowledgement was lost on the way.
    """

    acks: NDArray[np.void]
    answered: NDArray[np.bool_]

    @classmethod
    def none(cls, count: int) -> Self:
        """No results yet for so many blocks."""
        return cls(np.zeros(count, ACKS), np.zeros(count, np.bool_))


@dataclass(eq=False, slots=True)
class Parcel:
    """Blocks that are sent together.

    Parameters
    ----------
    first : int
        Number of the first of them.
    answers : Answers
        The result of each; written when it is known.
    sent : int
        How many were passed to the line.
    done : int
        How many, from the first on, were answered or given up.
    """

    first: int
    answers: Answers
    sent: int = 0
    done: int = 0

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.answers.answered)

    @property
    def settled(self) -> bool:
        """Whether all results are final."""
        return self.done == self.count


class Ledger:
    """The parcels on their way, in order.

    Parameters
    ----------
    lossy : bool
        Whether blocks and acknowledgements can be lost on the way.
    """

    def __init__(self, lossy: bool) -> None:
        self._lossy = lossy
        self._parcels = deque[Parcel]()
        self._next = 0

    @property
    def unanswered(self) -> int:
        """Blocks that were sent and have no result."""
        return sum(parcel.sent - parcel.done for parcel in self._parcels)

    @property
    def settled(self) -> bool:
        """Whether every entered block has its final result."""
        return not self._parcels

    def enter(self, parcel: Parcel) -> None:
        """Begin a parcel of blocks that are about to be sent."""
        if parcel.count:
            self._parcels.append(parcel)

    def match(self, acks: NDArray[np.void]) -> None:
        """Match acknowledgements to their blocks.

        Those of blocks that were given up before are ignored, or recorded late.

        Raises
        ------
        ReplyError
            If one belongs to no sent block, or, on a lossless line, not to the next.
        """
        while len(acks):
            waiting = next((parcel for parcel in self._parcels if parcel.sent > parcel.done), None)
            taken = self._match_next(waiting, acks) if waiting else 0
            acks = acks[taken or self._match_one(waiting, acks[0]) :]
        self._file()

    def give_up(self) -> None:
        """Stop waiting for all sent blocks; more of the last parcel may follow."""
        for parcel in self._parcels:
            parcel.done = parcel.sent
        self._file()

    def clear(self) -> None:
        """Forget all blocks."""
        if self._parcels:
            self._next = self._parcels[-1].first + self._parcels[-1].sent
        self._parcels.clear()

    def _file(self) -> None:
        """Remove completed parcels."""
        while self._parcels and self._parcels[0].settled:
            parcel = self._parcels.popleft()
            self._next = parcel.first + parcel.count

    def _match_next(self, parcel: Parcel, acks: NDArray[np.void]) -> int:
        """Match as many acknowledgements as possible to the next blocks of a parcel; returns how many."""
        count, number = min(len(acks), parcel.sent - parcel.done), (parcel.first + parcel.done) % NUMBERS
        if int(acks["sequence"][0]) != number:
            return 0
        if count > 1 and (acks["sequence"][:count] != np.arange(number, number + count).astype(np.uint32)).any():
            return 0
        until = parcel.done + count
        parcel.answers.acks[parcel.done : until] = acks[:count]
        parcel.answers.answered[parcel.done : until] = True
        parcel.done = until
        return count

    def _match_one(self, waiting: Parcel | None, ack: np.void) -> int:
        """Match one acknowledgement, of any number, to its block; returns how many, which is one."""
        number = int(ack["sequence"])
        damaged = not self._lossy and int(ack["reason"]) in DAMAGE
        for parcel in self._parcels:
            place = (number - parcel.first) % NUMBERS
            if damaged and parcel is waiting:  # its number may be damaged too, so its position counts
                place = parcel.done
            elif place >= parcel.sent or (not self._lossy and (parcel is not waiting or place != parcel.done)):
                continue
            self._pass_over(parcel)
            parcel.answers.acks[place] = ack
            parcel.answers.answered[place] = True
            parcel.done = max(parcel.done, place + 1)
            return 1
        oldest = self._parcels[0].first if self._parcels else self._next
        if (number - oldest) % NUMBERS < NUMBERS // 2:
            raise ReplyError(f"block {number} out of turn")
        return 1  # an older block's

    def _pass_over(self, parcel: Parcel) -> None:
        """What was sent before a parcel with an answer was lost."""
        for before in self._parcels:
            if before is parcel:
                return
            before.done = before.count
