"""Wiring: which output of which processor drives which transducer.

A *channel* numbers the outputs along the chain: channel = (board·2 + processor)·32 + bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import array_of, whole
from .board import (
    BOARDS,
    CHANNELS,
    CHANNELS_PER_PROCESSOR,
    COLUMNS,
    PROCESSORS_PER_BOARD,
    ROWS,
)

__all__ = ["Pin", "Wiring"]

Scalar = TypeVar("Scalar", bound=np.generic)


class Pin(NamedTuple):
    """One output pin of the chain."""

    board: int
    processor: int
    bit: int

    @classmethod
    def of(cls, channel: int) -> Pin:
        """The pin that a channel number stands for, from 0 to 319; `ValueError` for any other."""
        channel = whole("channel", channel, 0, CHANNELS - 1)
        processor, bit = divmod(channel, CHANNELS_PER_PROCESSOR)
        return cls(*divmod(processor, PROCESSORS_PER_BOARD), bit)

    @property
    def name(self) -> str:
        """``b2p1_07`` is bit 7 of the port of board 2's processor 1."""
        return f"b{self.board}p{self.processor}_{self.bit:02}"


@dataclass(frozen=True, eq=False)
class Wiring:
    """A one-to-one table from transducers to output channels.

    Parameters
    ----------
    channels : (320,) int
        Channel of each transducer, in array order (row-major over the grid).

    Raises
    ------
    ValueError
        If a channel is missing or used twice.
    """

    channels: NDArray[np.int64]

    def __init__(self, channels: ArrayLike) -> None:
        table = array_of("channels", channels, np.int64)
        if table.shape != (CHANNELS,) or not np.array_equal(np.sort(table), np.arange(CHANNELS)):
            raise ValueError(f"a wiring table names each of the channels 0 to {CHANNELS - 1} exactly once")
        table.setflags(write=False)
        object.__setattr__(self, "channels", table)

    def __repr__(self) -> str:
        return f"Wiring({len(self.channels)} transducers)"

    @classmethod
    def strips(cls) -> Wiring:
        """The default: each board under a strip of four columns, its processors under the lower and the upper half.

        Within a processor's 4 × 8 block the bits run to and fro, row by row, as a track on a board would.
        """
        row, column = np.divmod(np.arange(CHANNELS), COLUMNS)
        board, across = np.divmod(column, COLUMNS // BOARDS)
        processor, up = np.divmod(row, ROWS // PROCESSORS_PER_BOARD)
        width = COLUMNS // BOARDS
        bit = width * up + np.where(up % 2 == 0, across, width - 1 - across)
        return cls((board * PROCESSORS_PER_BOARD + processor) * CHANNELS_PER_PROCESSOR + bit)

    def pin(self, transducer: int) -> Pin:
        """Board, processor on that board, and port bit that drive a transducer; `ValueError` if there is none."""
        return Pin.of(int(self.channels[whole("transducer", transducer, 0, CHANNELS - 1)]))

    def sort(self, by_transducer: NDArray[Scalar]) -> NDArray[Scalar]:
        """From array order to channel order, along the last axis."""
        by_channel = np.empty_like(by_transducer)
        by_channel[..., self.channels] = by_transducer
        return by_channel

    def unsort(self, by_channel: NDArray[Scalar]) -> NDArray[Scalar]:
        """From channel order to array order, along the last axis."""
        return by_channel[..., self.channels]
