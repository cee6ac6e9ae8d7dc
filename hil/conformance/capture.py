"""What a case can see of the 320 outputs. (Interim: the emulator's alone.)"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...emulator import Emulator
from ...protocol.board import CHANNELS_PER_PROCESSOR, PROCESSORS, PROCESSORS_PER_BOARD, TICKS_PER_PERIOD

__all__ = ["EmulatorSight", "Mark", "Seen", "Sight", "Unseen"]


class Unseen(Exception):
    """That stretch was not recorded; the text says why."""


@dataclass(frozen=True, eq=False)
class Seen:
    """A stretch of outputs, in whole periods of the device's time.

    Parameters
    ----------
    first_period, last_period : int
        last is not included.
    words : (ticks, 10) uint32
        One column a processor in the order of the chain; bit b is output b of its port, 0 where it is not observed.
    observed : (10,) uint32
        Which outputs are seen.
    """

    first_period: int
    last_period: int
    words: NDArray[np.uint32]
    observed: NDArray[np.uint32]

    def period(self, number: int) -> NDArray[np.uint32]:
        """The words of one period, (50, 10)."""
        at = (number - self.first_period) * TICKS_PER_PERIOD
        return self.words[at : at + TICKS_PER_PERIOD]

    def excerpt(self, period: int, channel: int) -> str:
        """One output over one period, for people."""
        processor, bit = divmod(channel, CHANNELS_PER_PROCESSOR)
        board, number = divmod(processor, PROCESSORS_PER_BOARD)
        levels = self.period(period)[:, processor] >> np.uint32(bit) & 1
        return f"period {period} b{board}p{number}_{bit:02}: {''.join('.#'[level] for level in levels)}"


class Sight(Protocol):
    """By what outputs are seen."""

    name: str
    deferred: bool
    """Whether what happens can only be judged after the run."""

    def seen(self, first_period: int, last_period: int) -> Seen:
        """What the outputs did; raises `Unseen`."""


class EmulatorSight:
    """The outputs of an emulated device in this process."""

    name = "emulator"
    deferred = False

    def __init__(self, emulator: Emulator) -> None:
        self._emulator = emulator

    def seen(self, first_period: int, last_period: int) -> Seen:
        """What the outputs did."""
        capture = self._emulator.capture()
        if not 0 <= first_period <= last_period <= capture.periods:
            raise Unseen(f"periods {first_period} to {last_period} are not among the {capture.periods} captured")
        words = capture.bits(first_period * TICKS_PER_PERIOD, last_period * TICKS_PER_PERIOD)
        return Seen(first_period, last_period, words, np.full(PROCESSORS, 2**32 - 1, np.uint32))


@dataclass(frozen=True)
class Mark:
    """A pattern of changes by which a recording of a case is known."""

    changes: tuple[tuple[int, bool], ...]

    @staticmethod
    def plan(rng: random.Random) -> list[tuple[int, bool]]:
        """Gaps in periods, and whether the outputs are on behind them."""
        return [(rng.randrange(2, 41), number % 2 == 0) for number in range(12)]
