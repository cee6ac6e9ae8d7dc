"""Captures: what the 320 outputs did, as a logic analyser on all ten ports would see it.

Nothing is kept bit by bit: a capture holds segments, and expands the stretch that is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import stretch, whole
from ...base.pictures import Drawable, axes_or_new
from ...protocol.board import (
    CHANNELS,
    CHANNELS_PER_PROCESSOR,
    HALF_TICKS_PER_PERIOD,
    MAX_WIDTH_TICKS,
    PROCESSORS,
    TICK_HZ,
    TICKS_PER_PERIOD,
)
from ...protocol.pulses import MODULATED_WIDTH
from ...protocol.wiring import Pin, Wiring
from .clock import BoardClock
from .history import Segments
from .recording import PortRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Capture", "Forced", "Track"]

CHUNK_PERIODS = 1024  # 2 MB of bits
DRAWN_PERIODS, DRAWN_OUTPUTS = 3, 8
MOST_PERIODS = 4000  # in the default spectrum: 0.1 s
FLOOR_DB, MOST_KILOHERTZ = -80.0, 400.0  # of a drawn spectrum
MICROSECONDS_PER_TICK = 1e6 / TICK_HZ
ALL_HIGH = 2**CHANNELS_PER_PROCESSOR - 1


class Forced(NamedTuple):
    """What holds a port's outputs from a tick on, whatever is played; the newest counts."""

    tick: int
    high: int = 0
    """Bits that are stuck high."""
    low: int = 0
    """Bits that are stuck low."""


class Track(NamedTuple):
    """What one port did."""

    segments: Segments | PortRecord
    clock: BoardClock
    forced: tuple[Forced, ...] = ()

    @property
    def deranged(self) -> bool:
        """Whether its bits are not those of known pulses: recorded ones, a clock of its own, or pins that are held."""
        return isinstance(self.segments, PortRecord) or bool(self.forced) or not self.clock.exact


@dataclass(frozen=True, eq=False)
class Capture(Drawable):
    """The outputs up to the moment of capture. Ticks count from period 0; ticks are 0.5 µs, periods 50 ticks.

    Parameters
    ----------
    wiring : Wiring
        How the transducers really are connected, whatever the controller's table says.
    end_tick : int
        Number of ticks captured.
    tracks : tuple of Track
        One for each processor in the order of the chain.
    open_since : mapping of int to int
        Transducers that are not connected, each with the tick since when: their outputs switch, and they emit nothing.
    start_tick : int
        The tick at which it begins, if what was before has been forgotten.
    """

    wiring: Wiring
    end_tick: int
    tracks: tuple[Track, ...]
    open_since: Mapping[int, int] = field(default_factory=dict)
    start_tick: int = 0

    def __repr__(self) -> str:
        ticks = self.end_tick - self.start_tick
        return f"Capture({len(self.tracks)} ports, {ticks} ticks, {ticks / TICKS_PER_PERIOD:g} periods)"

    @property
    def open_transducers(self) -> frozenset[int]:
        """Transducers that are not connected, even if they were disconnected after the end."""
        return frozenset(self.open_since)

    @property
    def periods(self) -> int:
        """Whole carrier periods captured."""
        return self.end_tick // TICKS_PER_PERIOD

    @property
    def latches(self) -> list[list[int]]:
        """For each processor the ticks at which it began to play something else: an update, a sequence, silence."""
        return [
            [track.clock.tick_of(own) for own in (track.segments.starts[1:] * TICKS_PER_PERIOD).tolist()]
            for track in self.tracks
        ]

    def plot(
        self,
        ax: Axes | None = None,
        *,
        start: int | None = None,
        stop: int | None = None,
        outputs: Sequence[int] | None = None,
        zero: int | None = None,
        **style: Any,
    ) -> Axes:
        """Draw the square waves of some outputs.

        Parameters
        ----------
        ax : matplotlib axes, optional
            The axes to draw onto; by default those of a new figure of pyplot.
        start, stop : int, optional
            Ticks since period 0, by default the last `DRAWN_PERIODS` that were captured.
        outputs : sequence of int, optional
            Output channels, from the top; by default `DRAWN_OUTPUTS` of them, spread over the chain.
        zero : int, optional
            The tick at which the time axis has its 0; ``start`` by default.
        **style
            A ``title``, and options of matplotlib's ``stairs``.

        Raises
        ------
        ValueError
            If there is no such output, or the stretch is empty or was not captured.
        """
        last = self.end_tick if stop is None else stop
        first = max(self.start_tick, last - DRAWN_PERIODS * TICKS_PER_PERIOD) if start is None else start
        origin = first if zero is None else zero
        drawn = np.linspace(0, CHANNELS - 1, DRAWN_OUTPUTS).astype(int).tolist() if outputs is None else outputs
        if first >= last or not drawn:
            raise ValueError(
                f"outputs {list(drawn)} from tick {first} to {last} make no picture; give some outputs, and let time "
                "pass before the capture"
            )
        for output in drawn:
            _check_output(output)
        bits = self.channels(first, last)
        time = (np.arange(first, last + 1) - origin) * MICROSECONDS_PER_TICK
        axes, top, labels = axes_or_new(ax), len(drawn) - 1, []
        title = style.pop("title", "Square waves at 2 MHz")
        for row, channel in enumerate(drawn):
            look: dict[str, Any] = {"fill": True, "alpha": 0.85, "color": f"C{row % 10}"} | style
            axes.stairs(top - row + 0.7 * bits[:, channel], time, baseline=top - row, **look)
            pin = Pin.of(channel)
            labels.append(f"{pin.board}, {pin.processor}, {pin.bit}")
        axes.set(
            title=title,
            ylabel="board, processor, bit",
            xlabel=f"time since tick {origin} / µs",
            xlim=(time[0], time[-1]),
            yticks=[top - row + 0.35 for row in range(len(drawn))],
            yticklabels=labels,
        )
        axes.tick_params(axis="y", length=0)
        return axes

    def plot_spectrum(
        self, ax: Axes | None = None, *, output: int = 0, periods: int | None = None, **style: Any
    ) -> Axes:
        """Draw the spectrum of an output, in dB relative to the fundamental of full drive, 2/π of the supply.

        Parameters
        ----------
        ax : matplotlib axes, optional
            The axes to draw onto; by default those of a new figure of pyplot.
        output : int
            The output channel.
        periods : int, optional
            The last so many carrier periods are taken, or as many as were captured; 400 resolve 100 Hz. By default
            those since the output's processor began to play what it plays, at most `MOST_PERIODS`.
        **style
            A ``title``, and options of matplotlib's ``vlines``.

        Raises
        ------
        ValueError
            If there is no such output, or no whole period was captured.
        """
        _check_output(output)
        if periods is None:
            begun = max([self.start_tick, *self.latches[output // CHANNELS_PER_PROCESSOR]])
            periods = min(MOST_PERIODS, (self.end_tick - begun) // TICKS_PER_PERIOD)
        count = min(periods, (self.end_tick - self.start_tick) // TICKS_PER_PERIOD)
        if count < 1:
            raise ValueError(f"the spectrum of {count} periods cannot be drawn; at least 1 must be captured")
        ticks = count * TICKS_PER_PERIOD
        bits = self.channels(self.end_tick - ticks, self.end_tick)[:, output]
        amplitudes = 2 * np.abs(np.fft.rfft(bits)[1:]) / ticks
        levels = 20 * np.log10(np.maximum(amplitudes * np.pi / 2, 10 ** (FLOOR_DB / 20)))
        kilohertz = np.fft.rfftfreq(ticks, 1e3 / TICK_HZ)[1:]
        axes, title = axes_or_new(ax), style.pop("title", f"Spectrum of output {output}")
        axes.vlines(kilohertz, FLOOR_DB, levels, **dict[str, Any](linewidth=1) | style)
        axes.set(
            title=title,
            xlabel="frequency / kHz",
            ylabel="dB re full drive",
            xlim=(0, MOST_KILOHERTZ),
            ylim=(FLOOR_DB, 5),
        )
        return axes

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        """The port words of a stretch of time.

        Parameters
        ----------
        start, stop : int
            Ticks since period 0; stop is not included.

        Returns
        -------
        (stop - start, 10) uint32
            One column per processor in the order of the chain; bit b is output b of its port.

        Raises
        ------
        ValueError
            If the stretch was not captured.
        """
        start, stop = stretch("ticks", ("start", "stop"), start, stop, self.start_tick, self.end_tick)
        words = np.empty((stop - start, PROCESSORS), np.uint32)
        step = CHUNK_PERIODS * TICKS_PER_PERIOD
        for begin in range(start, stop, step):
            end = min(begin + step, stop)
            words[begin - start : end - start] = self._words(begin, end)
        return words

    def _words(self, start: int, stop: int) -> NDArray[np.uint32]:
        """Port words, (stop - start, 10)."""
        from .raster import expand

        first, last = start // TICKS_PER_PERIOD, -(-stop // TICKS_PER_PERIOD)
        words = np.empty(((last - first) * TICKS_PER_PERIOD, PROCESSORS), np.uint32)
        expand(self._slices, *self._rows(first, last), _widths(), words)
        words = words[start - first * TICKS_PER_PERIOD :][: stop - start]
        for processor, track in enumerate(self.tracks):
            if track.deranged:
                words[:, processor] = _deranged(track, start, stop)
        return words

    @property
    def _slices(self) -> tuple[NDArray[np.uint8], ...]:
        return tuple(track.segments.slices for track in self.tracks)

    def _rows(self, first: int, last: int) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """What each processor plays in each period, (10, n) rows of its slices, and the samples over them."""
        played = [track.segments.rows(first, last) for track in self.tracks]
        return np.stack([rows for rows, _ in played]), np.stack([samples for _, samples in played])

    def channels(self, start: int, stop: int) -> NDArray[np.uint8]:
        """The same stretch as one 0 or 1 per output channel, (stop - start, 320) uint8."""
        bits = self.bits(start, stop)[:, :, None] >> np.arange(CHANNELS_PER_PROCESSOR, dtype=np.uint32) & 1
        return bits.reshape(stop - start, CHANNELS).astype(np.uint8)

    def drives(self, first: int, last: int, dtype: Any = np.complex64) -> NDArray[Any]:
        """The drive emitted in each of successive carrier periods, as the bits emit it.

        Parameters
        ----------
        first, last : int
            Carrier periods; last is not included.
        dtype : complex type
            Type of the result.

        Returns
        -------
        (last - first, 320) complex
            Drives in array order: the continuous-time fundamental of each square wave (not a sum over samples, which
            would be half a tick off), where the widest pulse (25 ticks) has magnitude 1.

        Raises
        ------
        ValueError
            If the periods were not captured.

        Notes
        -----
        If a port plays whole pulses, each is looked up by its two edges; if its clock is its own or its pins are
        held, all edges of its bits are summed.
        """
        begin = -(-self.start_tick // TICKS_PER_PERIOD)
        first, last = stretch("periods", ("first", "last"), first, last, begin, self.periods)
        from .raster import demodulate, emit

        turn, pulse_drives = _turn().astype(dtype), _pulse_drives().astype(dtype)
        columns = np.argsort(self.wiring.channels).reshape(PROCESSORS, CHANNELS_PER_PROCESSOR)
        drives = np.empty((last - first, CHANNELS), dtype)
        for begin in range(first, last, CHUNK_PERIODS):
            end = min(begin + CHUNK_PERIODS, last)
            chunk = drives[begin - first : end - first]
            emit(self._slices, *self._rows(begin, end), _widths(), pulse_drives, columns, chunk)
            for track, its_columns in zip(self.tracks, columns, strict=True):
                if track.deranged:
                    words = _deranged(track, begin * TICKS_PER_PERIOD, end * TICKS_PER_PERIOD)
                    demodulate(words, turn, its_columns, chunk)
        for number, tick in self.open_since.items():
            drives[max(tick // TICKS_PER_PERIOD - first, 0) :, number] = 0
        return drives

    def drive(self, period: int) -> NDArray[np.complex128]:
        """The drive emitted in one carrier period, (320,) complex; see `drives`."""
        period = whole("period", period, 0, self.periods)
        return np.asarray(self.drives(period, period + 1, np.complex128)[0])


def _check_output(output: int) -> None:
    whole("output", output, 0, CHANNELS - 1)


def _deranged(track: Track, start: int, stop: int) -> NDArray[np.uint32]:
    """The words of any port at ticks of the device, (stop - start,)."""
    own = track.clock.own_ticks(start, stop)
    first, last = (int(own[0]), int(own[-1]) + 1) if own.size else (0, 0)
    words = _played(track.segments, first, last)[own - first]
    for number, (tick, high, low) in enumerate(track.forced):
        until = track.forced[number + 1].tick if number + 1 < len(track.forced) else stop
        held = slice(max(tick - start, 0), max(until - start, 0))
        words[held] = words[held] & np.uint32(~low & ALL_HIGH) | np.uint32(high)
    return words


def _played(segments: Segments | PortRecord, start: int, stop: int) -> NDArray[np.uint32]:
    """The words that one port plays at its own ticks, (stop - start,)."""
    if isinstance(segments, PortRecord):
        return segments.words(start, stop)
    from .raster import expand

    first, last = start // TICKS_PER_PERIOD, -(-stop // TICKS_PER_PERIOD)
    rows, samples = segments.rows(first, last)
    words = np.empty(((last - first) * TICKS_PER_PERIOD, 1), np.uint32)
    expand((segments.slices,), rows[None], samples[None], _widths(), words)
    return words[start - first * TICKS_PER_PERIOD :, 0][: stop - start]


@cache
def _widths() -> NDArray[np.uint8]:
    return np.ascontiguousarray(MODULATED_WIDTH, np.uint8)


@cache
def _turn() -> NDArray[np.complex128]:
    """What a falling edge at each tick of a period adds to the fundamental, (50,), of which the widest pulse has 1."""
    return np.asarray(np.exp(2j * np.pi * np.arange(TICKS_PER_PERIOD) / TICKS_PER_PERIOD) / 2j)


@cache
def _pulse_drives() -> NDArray[np.complex128]:
    """The fundamental of a pulse of each phase and width, (100, 26), from its two edges (clause PUL-004)."""
    phase, width = np.mgrid[:HALF_TICKS_PER_PERIOD, : MAX_WIDTH_TICKS + 1]
    begin = (phase - width) >> 1
    turn = _turn()
    return np.asarray(turn[(begin + width) % TICKS_PER_PERIOD] - turn[begin % TICKS_PER_PERIOD])
