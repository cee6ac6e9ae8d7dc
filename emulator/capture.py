"""Captures: what the 320 outputs did, bit by bit, as a logic analyser on all ten ports would see it."""

from __future__ import annotations

import operator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..protocol.board import CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS, TICKS_PER_PERIOD
from ..protocol.wiring import Wiring

__all__ = ["Capture"]


@dataclass(frozen=True, eq=False)
class Capture:
    """The outputs from power-up to the moment of capture. Ticks are 0.5 µs, periods 50 ticks.

    Parameters
    ----------
    wiring : Wiring
        How the transducers really are connected, whatever the controller's table says.
    end_tick : int
        Number of ticks captured.
    starts : sequence of (s,) int
        For each processor, the ticks at which its tables begin to play, ascending from 0.
    tables : sequence of (s, 50) uint32
        For each processor, those tables; each repeats until the next begins.
    """

    wiring: Wiring
    end_tick: int
    starts: tuple[NDArray[np.int64], ...]
    tables: tuple[NDArray[np.uint32], ...]

    @property
    def periods(self) -> int:
        """Whole carrier periods captured."""
        return self.end_tick // TICKS_PER_PERIOD

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        """The port words of a stretch of time.

        Parameters
        ----------
        start, stop : int
            Ticks since power-up; stop is not included.

        Returns
        -------
        (stop - start, 10) uint32
            One column per processor in the order of the chain; bit b is output b of its port.

        Raises
        ------
        ValueError
            Where the stretch was not captured.
        """
        start, stop = operator.index(start), operator.index(stop)
        if not 0 <= start <= stop <= self.end_tick:
            raise ValueError(f"ticks {start} to {stop} are not within the captured 0 to {self.end_tick}")
        ticks = np.arange(start, stop)
        words = np.empty((ticks.size, PROCESSORS), np.uint32)
        for processor, (starts, tables) in enumerate(zip(self.starts, self.tables, strict=True)):
            segment = np.searchsorted(starts, ticks, side="right") - 1
            words[:, processor] = tables[segment, ticks % TICKS_PER_PERIOD]
        return words

    def channels(self, start: int, stop: int) -> NDArray[np.uint8]:
        """The same stretch as one 0 or 1 per output channel, (stop - start, 320) uint8."""
        bits = self.bits(start, stop)[:, :, None] >> np.arange(CHANNELS_PER_PROCESSOR, dtype=np.uint32) & 1
        return bits.reshape(stop - start, CHANNELS).astype(np.uint8)

    def drive(self, period: int) -> NDArray[np.complex128]:
        """The drive emitted in one carrier period, demodulated from the bits.

        Parameters
        ----------
        period : int
            Carrier period since power-up.

        Returns
        -------
        (320,) complex
            In array order; the continuous-time fundamental of each square wave, where the widest pulse (25 ticks) has
            magnitude 1.

        Notes
        -----
        A bit lasts a whole tick, so its contribution to (2/T)·∫ s(t)·e^{iωt} dt is centred half a tick after its start
        and weighted by sinc. A plain DFT of the samples would be off by half a tick, 3.6°.
        """
        first = operator.index(period) * TICKS_PER_PERIOD
        bits = self.channels(first, first + TICKS_PER_PERIOD)
        centres = np.exp(2j * np.pi * (np.arange(TICKS_PER_PERIOD) + 0.5) / TICKS_PER_PERIOD)
        # (2/T)·(tick integral) over the 2/π of the widest pulse: sin(π/50) per tick.
        return self.wiring.unsort(np.sin(np.pi / TICKS_PER_PERIOD) * (centres @ bits))
