"""An excerpt of a capture: chosen outputs over a stretch of time, as exports write it.

Ticks are 0.5 µs and count from the beginning of period 0. A capture may be long and its bits many, so an excerpt hands
them out in chunks; nothing here holds more than one of these.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import CHANNELS
from ...protocol.wiring import Pin, Wiring

__all__ = ["Changes", "Excerpt", "PortBits", "edges"]

CHUNK_TICKS = 20_000  # 10 ms, 6.4 MB of levels


class PortBits(Protocol):
    """What an excerpt needs of a capture."""

    @property
    def wiring(self) -> Wiring:
        """How the transducers are connected."""

    @property
    def start_tick(self) -> int:
        """The first tick captured."""

    @property
    def end_tick(self) -> int:
        """The tick after the last one captured."""

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        """The port words of a stretch of time, (stop - start, 10) uint32."""


class Changes(NamedTuple):
    """Where outputs change, in the order of time; all of one length."""

    ticks: NDArray[np.int64]
    outputs: NDArray[np.int64]
    """Places in `Excerpt.channels`; ascending within a tick."""
    levels: NDArray[np.uint8]
    """From that tick on, 0 or 1."""


@dataclass(frozen=True)
class Excerpt:
    """Chosen outputs of a capture over a stretch of time.

    Parameters
    ----------
    capture : PortBits
        What was captured.
    channels : sequence of int
        The outputs, in this order.
    start, stop : int
        Ticks; stop is not included.

    Raises
    ------
    ValueError
        If an output does not exist or is chosen twice, or if the stretch is empty or was not captured.
    """

    capture: PortBits
    channels: tuple[int, ...]
    start: int
    stop: int

    def __post_init__(self) -> None:
        """Check the choice."""
        unknown = [channel for channel in self.channels if channel not in range(CHANNELS)]
        if unknown:
            raise ValueError(f"there is no output channel {unknown[0]}; 0 to {CHANNELS - 1}")
        if len(set(self.channels)) != len(self.channels):
            raise ValueError("an output channel is chosen twice; once is enough")
        if not self.channels:
            raise ValueError("no output channel is chosen; at least one")
        captured = self.capture.start_tick, self.capture.end_tick
        if not captured[0] <= self.start < self.stop <= captured[1]:
            raise ValueError(
                f"ticks {self.start} to {self.stop} are no stretch within the captured {captured[0]} to {captured[1]}"
            )

    @classmethod
    def of(
        cls, capture: PortBits, channels: Sequence[int] | None = None, ticks: tuple[int, int] | None = None
    ) -> Excerpt:
        """An excerpt; of all outputs, and from beginning to end, if nothing else is said."""
        chosen = range(CHANNELS) if channels is None else map(operator.index, channels)
        start, stop = (capture.start_tick, capture.end_tick) if ticks is None else map(operator.index, ticks)
        return cls(capture, tuple(chosen), start, stop)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the outputs' pins."""
        return tuple(Pin.of(channel).name for channel in self.channels)

    @property
    def transducers(self) -> tuple[int, ...]:
        """Which the outputs drive, by their place in array order."""
        by_channel = np.argsort(self.capture.wiring.channels)
        return tuple(by_channel.take(self.channels).tolist())

    @property
    def before(self) -> NDArray[np.uint8]:
        """The levels in the tick before the stretch, (k,) uint8.

        Before tick 0 all outputs are low; if the capture begins later they are taken to have been as in its first.
        """
        if self.start == 0:
            return np.zeros(len(self.channels), np.uint8)
        if self.start == self.capture.start_tick:
            return np.asarray(self._levels(self.start, self.start + 1)[0])
        return np.asarray(self._levels(self.start - 1, self.start)[0])

    def chunks(self) -> Iterator[NDArray[np.uint8]]:
        """The levels piece by piece, (n, k) uint8: 0 or 1, a row for each tick, a column for each output."""
        for first in range(self.start, self.stop, CHUNK_TICKS):
            yield self._levels(first, min(first + CHUNK_TICKS, self.stop))

    def changes(self) -> Iterator[Changes]:
        """Where levels differ from those of the tick before, piece by piece."""
        first, before = self.start, self.before
        for levels in self.chunks():
            rows, outputs = np.nonzero(levels != np.concatenate([before[None], levels[:-1]]))
            yield Changes(first + rows, outputs, levels[rows, outputs])
            first, before = first + len(levels), levels[-1]

    def _levels(self, start: int, stop: int) -> NDArray[np.uint8]:
        words = self.capture.bits(start, stop).astype("<u4")
        levels = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")
        return levels[:, list(self.channels)]


def edges(capture: PortBits, channel: int, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Where one output changes within a stretch of time.

    Parameters
    ----------
    capture : PortBits
        What was captured.
    channel : int
        The output.
    start, stop : int
        Ticks; stop is not included.

    Returns
    -------
    ticks : (e,) int
        The ticks at which the output changes, against the tick before. Before tick 0 it is low, so that the edges of
        stretches that follow each other are together those of the whole.
    levels : (e,) uint8
        0 or 1, from that tick on.

    Raises
    ------
    ValueError
        If there is no such output, or the stretch is empty or was not captured.
    """
    found = list(Excerpt.of(capture, [channel], (start, stop)).changes())
    return np.concatenate([piece.ticks for piece in found]), np.concatenate([piece.levels for piece in found])
