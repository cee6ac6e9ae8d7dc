"""What a case can see of the 320 outputs, and by whose eyes.

A `Sight` hands out stretches of the device's time as `Seen`: whole periods of port words, be it those that an emulator
kept or those that a logic analyser recorded (`sigrok`). Nothing here lets time pass, and nothing here judges.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ....emulator import Emulator
from ....protocol.board import CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS, TICKS_PER_PERIOD
from ....protocol.wiring import Pin

__all__ = ["NOT_ONE", "EmulatorSight", "Seen", "SeenPulses", "Sight", "Unseen", "check_stretch"]

NOT_ONE = -1
"""Start and width of what is not one pulse, or was not seen."""

PERIODS_AT_A_TIME = 256  # 4 MB of levels


class Unseen(Exception):
    """Something of the outputs could not be seen; the message says why."""


class SeenPulses(NamedTuple):
    """The one pulse of each period and output channel, (n, 320) int8 each."""

    start: NDArray[np.int8]
    """Tick of the period at which it begins, 0 to 49; 0 for silence, `NOT_ONE` where there is not one pulse."""
    width: NDArray[np.int8]
    """Ticks, round the end of the period if need be (clause PUL-004); 0 for silence, `NOT_ONE` as above."""


@dataclass(frozen=True, eq=False)
class Seen:
    """The outputs over a stretch of whole periods.

    Parameters
    ----------
    first_period, last_period : int
        Periods of the device; the last is not included.
    words : (50 · periods, 10) uint32
        The port words of each tick, one column per processor in the order of the chain; bit b is output b of its port,
        0 where it was not observed.
    observed : (10,) uint32
        Which outputs were observed, as bits of their processors' words.

    Raises
    ------
    ValueError
        Where the stretch is none, or the words are not of its length.
    """

    first_period: int
    last_period: int
    words: NDArray[np.uint32]
    observed: NDArray[np.uint32]

    def __post_init__(self) -> None:
        """Check the shapes, and let nobody write."""
        check_stretch(self.first_period, self.last_period)
        shape = (self.last_period - self.first_period) * TICKS_PER_PERIOD, PROCESSORS
        if self.words.shape != shape:
            raise ValueError(
                f"periods {self.first_period} to {self.last_period} have words of the shape {shape}, "
                f"not {self.words.shape}"
            )
        self.words.setflags(write=False)
        self.observed.setflags(write=False)

    @property
    def channels(self) -> NDArray[np.bool_]:
        """Which output channels were observed, (320,)."""
        return _levels(self.observed).astype(bool)

    def period(self, number: int) -> NDArray[np.uint32]:
        """The port words of one period, (50, 10)."""
        return np.asarray(self._periods(number, operator.index(number) + 1)[0])

    def pulses(self, first: int, last: int) -> SeenPulses:
        """The pulses of some periods.

        Parameters
        ----------
        first, last : int
            Periods of the device; the last is not included.

        Raises
        ------
        ValueError
            Where they are not within the stretch.
        """
        words = self._periods(first, last)
        pulses = SeenPulses(
            np.full((len(words), CHANNELS), NOT_ONE, np.int8), np.full((len(words), CHANNELS), NOT_ONE, np.int8)
        )
        observed = self.channels
        for begin in range(0, len(words), PERIODS_AT_A_TIME):
            piece = slice(begin, begin + PERIODS_AT_A_TIME)
            rises = _levels(words[piece] & ~np.roll(words[piece], 1, axis=1))
            width = _levels(words[piece]).sum(axis=1, dtype=np.int8)
            one = observed & ((rises.sum(axis=1, dtype=np.int8) == 1) | (width == 0))
            pulses.start[piece][one] = rises.argmax(axis=1)[one]
            pulses.width[piece][one] = width[one]
        return pulses

    def excerpt(self, period: int, channel: int) -> str:
        """One output in one period, such as ``period 1000 b2p1_07: ....####......``: a sign for each tick."""
        processor, bit = divmod(channel, CHANNELS_PER_PROCESSOR)
        signs = (".#"[level] for level in (self.period(period)[:, processor] >> np.uint32(bit) & 1).tolist())
        what = "".join(signs) if self.channels[channel] else "not observed"
        return f"period {period} {Pin.of(channel).name}: {what}"

    def _periods(self, first: int, last: int) -> NDArray[np.uint32]:
        """The port words of some periods, (last - first, 50, 10)."""
        check_stretch(first, last)
        if not self.first_period <= first < last <= self.last_period:
            raise ValueError(
                f"periods {first} to {last} are not within what was seen, {self.first_period} to {self.last_period}"
            )
        by_period = self.words.reshape(-1, TICKS_PER_PERIOD, PROCESSORS)
        return by_period[first - self.first_period : last - self.first_period]


class Sight(Protocol):
    """What sees the outputs."""

    @property
    def name(self) -> str:
        """``emulator`` or ``sigrok:FILE``."""

    @property
    def deferred(self) -> bool:
        """Whether what happens can be seen after the run only."""

    def seen(self, first_period: int, last_period: int) -> Seen:
        """The outputs over some periods of the device, the last not included.

        Raises
        ------
        Unseen
            Where they were not recorded.
        ValueError
            Where these are no periods.
        """


@dataclass(frozen=True)
class EmulatorSight:
    """Sees all outputs of an emulator, in its present life: as far back as its last start."""

    emulator: Emulator

    name = "emulator"
    deferred = False

    def seen(self, first_period: int, last_period: int) -> Seen:
        """The outputs over some periods, all of which must be over; see `Sight`."""
        check_stretch(first_period, last_period)
        if self.emulator.controller is None:
            raise Unseen("the emulated device does not run, and counts no periods")
        capture = self.emulator.capture()
        kept = -(-capture.start_tick // TICKS_PER_PERIOD)
        if not kept <= first_period < last_period <= capture.periods:
            raise Unseen(
                f"periods {first_period} to {last_period} are not among those that the emulator kept, "
                f"{kept} to {capture.periods}"
            )
        words = capture.bits(first_period * TICKS_PER_PERIOD, last_period * TICKS_PER_PERIOD)
        return Seen(first_period, last_period, words, np.full(PROCESSORS, 2**32 - 1, np.uint32))


def check_stretch(first_period: int, last_period: int) -> None:
    """Raise `ValueError` where two numbers are not the bounds of a stretch of periods."""
    if not 0 <= operator.index(first_period) < operator.index(last_period):
        raise ValueError(
            f"{first_period} to {last_period} are no stretch of periods: from 0 on, and the last beyond the first"
        )


def _levels(words: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """The 320 output channels of port words, (…, 10) to (…, 320) of 0 and 1."""
    octets = np.ascontiguousarray(words.astype("<u4")).view(np.uint8)
    return np.unpackbits(octets, axis=-1, bitorder="little")
