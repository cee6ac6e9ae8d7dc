"""What a case can see of the 320 outputs, and who sees it.

An `Observer` returns intervals of the device's time as `Seen`: whole periods of port words, kept by an emulator or
recorded by a logic analyser (`sigrok`). This module neither lets time pass nor judges.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....emulator import Emulator
from ....protocol.board import CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS, TICKS_PER_PERIOD
from ....protocol.wiring import Pin
from .marks import Mark

__all__ = ["NOT_ONE", "EmulatorObserver", "Observer", "Seen", "SeenPulses", "Unseen", "check_stretch"]

NOT_ONE = -1
"""Start and width of an output that has not exactly one pulse, or was not observed."""

PERIODS_AT_A_TIME = 256  # 4 MB of levels


class Unseen(Exception):
    """A part of the outputs could not be observed; the message says why."""


class SeenPulses(NamedTuple):
    """The one pulse of each period and output channel, (n, 320) int8 each."""

    start: NDArray[np.int8]
    """Tick of the period at which it begins, 0 to 49; 0 for silence, `NOT_ONE` if there is not exactly one pulse."""
    width: NDArray[np.int8]
    """Ticks, around the end of the period if need be (clause PUL-004); 0 for silence, `NOT_ONE` as above."""


@dataclass(frozen=True, eq=False)
class Seen:
    """The outputs over an interval of whole periods.

    Raises
    ------
    ValueError
        If the interval is empty, or the words have another length.
    """

    first_period: int
    last_period: int
    """Periods of the device; the last is not included."""
    words: NDArray[np.uint32]
    """(50 · periods, 10) uint32; the port words of each tick, one column per processor in the order of the chain; bit b
    is output b of its port, 0 if it was not observed."""
    observed: NDArray[np.uint32]
    """(10,) uint32; which outputs were observed, as bits of their processors' words."""

    def __post_init__(self) -> None:
        """Check the shapes, and make the arrays read-only."""
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
        """The pulses of some periods, the last not included; raises `ValueError` if they are not within it."""
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


class Observer:
    """What sees the outputs.

    A capture of another kind derives from this class, or makes a `RecordedObserver` of samples.

    Attributes
    ----------
    name : str
        The name in reports, such as ``emulator`` or ``sigrok:FILE``.
    deferred : bool
        Whether what happens can be seen after the run only. Then cases play marks, by which it is found.
    """

    name: str
    deferred = False

    def seen(self, first_period: int, last_period: int) -> Seen:
        """The outputs over some periods of the device, the last not included.

        Raises `Unseen` if they were not recorded, and `ValueError` if these are no periods.
        """
        raise NotImplementedError

    def between(self, before: Mark, after: Mark) -> Observer:  # noqa: ARG002  # for what is seen later
        """The same, from one mark to another alone, if what happens is seen after the run."""
        return self

    def finish(self, tell: Callable[[str], object]) -> None:
        """End a recording once all cases have played, for what is seen after the run; people are told what to do."""

    def close(self) -> None:
        """Give back what it holds."""


class EmulatorObserver(Observer):
    """Sees all outputs of an emulator, in its present life: as far back as its last start."""

    name = "emulator"

    def __init__(self, emulator: Emulator) -> None:
        self._emulator = emulator

    def seen(self, first_period: int, last_period: int) -> Seen:
        """The outputs over some periods, all of which must be over; see `Observer`."""
        check_stretch(first_period, last_period)
        if self._emulator.controller is None:
            raise Unseen("the emulated device does not run, and counts no periods")
        capture = self._emulator.capture()
        kept = -(-capture.start_tick // TICKS_PER_PERIOD)
        if not kept <= first_period < last_period <= capture.periods:
            raise Unseen(
                f"periods {first_period} to {last_period} are not among those that the emulator kept, "
                f"{kept} to {capture.periods}"
            )
        words = capture.bits(first_period * TICKS_PER_PERIOD, last_period * TICKS_PER_PERIOD)
        return Seen(first_period, last_period, words, np.full(PROCESSORS, 2**32 - 1, np.uint32))


def check_stretch(first_period: int, last_period: int) -> None:
    """Raise `ValueError` if two numbers are not the bounds of an interval of periods."""
    if not 0 <= operator.index(first_period) < operator.index(last_period):
        raise ValueError(
            f"{first_period} to {last_period} are no interval of periods: from 0 on, and the last beyond the first"
        )


def _levels(words: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """The 320 output channels of port words, (…, 10) to (…, 320) of 0 and 1."""
    octets = np.ascontiguousarray(words.astype("<u4")).view(np.uint8)
    return np.unpackbits(octets, axis=-1, bitorder="little")
