"""The response of all channels' resonators to bits, an interval of carrier periods at a time.

Outputs repeat: a constant field, a sequence or a modulation plays the same few periods again and again. Then the states
of all resonators over a period are sums of a few waveforms, each times a number per period, and any linear quantity
need only be computed for the waveforms. If nothing repeats, the states are computed directly.

A resonance decays slowly, so that no two periods begin alike. But its state is the sum of the response of a resonator
at rest to the period's bits, and of the earlier state, which decays in the same way whatever is played (`OnePole`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from ...emulator.ports.amplifier import FULL_DRIVE_V, Amplifier
from ...protocol.board import CHANNELS, PROCESSORS, TICKS_PER_PERIOD
from ...solver.acoustics.resonator import OnePole

__all__ = ["Bits", "Emission", "ResonatorBank", "words_of"]

NEGLIGIBLE = 1e-5
"""Relative to the strongest waveform: weaker ones are left out. In single precision the sum is the same."""
PERIODS_AT_A_TIME = 1000
ALIKE, MOST_TABLES = 4, 64
"""Waveforms are shared if a table plays in so many periods on average, and there are no more tables than this."""
FEW_PERIODS = 40
"""The number of periods whose states fit a cache."""
POINTS_AT_A_TIME = 64


class Bits(Protocol):
    """The part of a capture that is needed here."""

    @property
    def end_tick(self) -> int:
        """Number of ticks captured."""

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        """Port words of some ticks, (stop - start, 10)."""


class Emission(NamedTuple):
    """The states of all resonators over some carrier periods."""

    first: int
    """The period in which it begins."""
    states: NDArray[np.complex64]
    """Waveforms, (r, 320, t + 1) by channel: at the beginning of each tick, and at the end of the last."""
    shares: NDArray[np.float32] | None
    """How much of each waveform, of 50 ticks, there is in each period, (p, r). None if there is one waveform, which
    holds the states from beginning to end."""

    def arrive(
        self,
        sound: NDArray[np.float32],
        at: int,
        fresh: int,
        lag: NDArray[np.int64],
        here: NDArray[np.complex64],
        following: NDArray[np.complex64],
    ) -> int:
        """Add up the sound at some points.

        Parameters
        ----------
        sound : (k, p, 50) float32
            Written, period by period: at each tick the arriving sound, within the array's range.
        at : int
            Period of `sound` in which the emission begins to arrive; it may lie before the first.
        fresh : int
            Period from which `sound` has not been written yet.
        lag, here, following : (k, 320)
            The delay in ticks from there, not negative, and the weights; see `solver.time_kernels.place_waves`.

        Returns
        -------
        int
            The period from which `sound` is still not written.
        """
        from ...solver.compiled.simd import LANES
        from ...solver.compiled.time_kernels import POINTS_AT_ONCE, sum_bursts  # importing numba takes half a second

        waveforms, steps = len(self.states), self.states.shape[2] - 1
        filled = -(-steps // LANES) * LANES
        waves = np.zeros((4, waveforms, CHANNELS, filled), dtype=np.float32)
        waves[:2, :, :, :steps] = self.states.real[..., :-1], self.states.imag[..., :-1]
        waves[2:, :, :, :steps] = self.states.real[..., 1:], self.states.imag[..., 1:]
        span = -(-(int(lag.max()) + filled) // TICKS_PER_PERIOD)  # periods in which one waveform is heard
        windows = None if self.shares is None else _windows(self.shares, span)
        arriving = span if windows is None else len(windows)
        first = max(-at, 0)
        last = max(min(arriving, len(sound[0]) - at), first)
        again = min(max(fresh - at, first), last)
        for point in range(0, len(sound), POINTS_AT_A_TIME):
            part = sound[point : point + POINTS_AT_A_TIME]
            rows = np.arange(point, point + -(-len(part) // POINTS_AT_ONCE) * POINTS_AT_ONCE).clip(max=len(sound) - 1)
            total = np.empty((len(rows) * waveforms, span * TICKS_PER_PERIOD), dtype=np.float32)
            sum_bursts(waves.reshape(4, -1, filled), lag[rows], here[rows], following[rows], total)
            heard = total.reshape(len(rows), -1, TICKS_PER_PERIOD)[: len(part)]
            earlier, later = part[:, at + first : at + again], part[:, at + again : at + last]
            if windows is None:
                earlier += heard[:, first:again]
                later[:] = heard[:, again:last]
            else:
                earlier += windows[first:again] @ heard
                np.matmul(windows[again:last], heard, out=later)
        return max(fresh, at + last)


def _windows(shares: NDArray[np.float32], span: int) -> NDArray[np.float32]:
    """Shares (p, r) of the last so many periods in each, the last first, (p + span - 1, r span)."""
    padded = np.pad(shares, ((span - 1, span - 1), (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, span, axis=0)[:, :, ::-1]
    return np.ascontiguousarray(windows).reshape(len(windows), -1)


class ResonatorBank:
    """The resonators of all channels from the beginning of a period, before which they are at rest.

    Parameters
    ----------
    capture : Capture
        What drives them; before its tick 0, and after its end, all outputs are low.
    amplifier : Amplifier
        Between outputs and resonators.
    resonance : OnePole
        The resonance in steps of a tick.
    period : int
        Carrier period in which to begin, which may be negative.
    """

    def __init__(self, capture: Bits, amplifier: Amplifier, resonance: OnePole, period: int) -> None:
        self.period = period
        self._capture = capture
        self._drives = amplifier.tick_voltages / FULL_DRIVE_V
        self._resonance = resonance
        self._state = np.zeros(CHANNELS, dtype=np.complex128)

    def skip_until(self, period: int) -> None:
        """Let time pass until a period begins."""
        while self.period < period:
            self._ring(min(FEW_PERIODS, period - self.period))

    def emit_until(self, period: int) -> Iterator[Emission]:
        """Let time pass until a period begins; yields the response of the resonators, piece by piece."""
        while self.period < period:
            count = min(PERIODS_AT_A_TIME, period - self.period)
            played, tables = _different(self._words(count))
            if len(tables) <= min(MOST_TABLES, count // ALIKE):
                yield self._share(played, tables)
                continue
            for first in range(0, count, FEW_PERIODS):
                yield self._ring(min(FEW_PERIODS, count - first))

    def _words(self, periods: int) -> NDArray[np.uint32]:
        """Port words of the next periods, after those of the tick before, (50 periods + 1, 10)."""
        return words_of(self._capture, self.period * TICKS_PER_PERIOD - 1, (self.period + periods) * TICKS_PER_PERIOD)

    def _ring(self, periods: int) -> Emission:
        """Let periods pass, tick by tick."""
        states, end = self._rung(self._words(periods)[None], self._state)
        emission = Emission(self.period, states, None)
        self.period, self._state = self.period + periods, end[0]
        return emission

    def _share(self, played: NDArray[np.intp], tables: NDArray[np.uint32]) -> Emission:
        """Let periods pass, (p,), each of which plays one of a few tables, (m, 51, 10), the tick before included."""
        driven, left = self._rung(tables, np.zeros(CHANNELS, np.complex128))
        falling = self._resonance.decay ** np.arange(TICKS_PER_PERIOD + 1)
        chosen = np.eye(len(tables))[played]
        # How much of each table's effect, and of the initial state, there is when each period begins, and the next.
        kept = scipy.signal.lfilter([0, 1], [1, -falling[-1]], np.pad(chosen, ((0, 1), (0, 0))), axis=0)
        kept = np.concatenate([kept, falling[-1] ** np.arange(len(played) + 1)[:, None]], axis=1)
        left = np.concatenate([left, self._state[None]])
        ringing = np.concatenate([driven, *(turn * left[:, :, None] * falling for turn in (1, 1j))])
        shares, few = _few(np.concatenate([chosen, kept[:-1].real, kept[:-1].imag], axis=1), ringing)
        emission = Emission(self.period, few, shares)
        self.period, self._state = self.period + len(played), kept[-1] @ left
        return emission

    def _rung(
        self, words: NDArray[np.uint32], state: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex64], NDArray[np.complex128]]:
        """Waveforms, (m, 320, t + 1), and their final states, (m, 320), of words, (m, t + 1, 10)."""
        from ...solver.compiled.time_kernels import ring

        states = np.empty((len(words), CHANNELS, words.shape[1]), dtype=np.complex64)
        ends = np.repeat(state[None], len(words), axis=0)
        decay, gain = self._resonance
        for number, played in enumerate(words):
            ring(played[1:], self._drives, decay, (1 - decay) * gain, played[0], ends[number], states[number])
        return states, ends


def words_of(capture: Bits, start: int, stop: int) -> NDArray[np.uint32]:
    """Port words of some ticks, (stop - start, 10), all low before the capture and after it."""
    words = np.zeros((stop - start, PROCESSORS), dtype=np.uint32)
    first, last = max(start, 0), min(stop, capture.end_tick)
    if first < last:
        words[first - start : last - start] = capture.bits(first, last)
    return words


def _different(words: NDArray[np.uint32]) -> tuple[NDArray[np.intp], NDArray[np.uint32]]:
    """The table of each period, (p,), and the tables, (m, 51, 10); of words with those of the tick before."""
    periods = np.lib.stride_tricks.sliding_window_view(words, TICKS_PER_PERIOD + 1, axis=0)[::TICKS_PER_PERIOD]
    index: dict[bytes, int] = {}
    played = [index.setdefault(period.T.tobytes(), len(index)) for period in periods]
    tables = np.frombuffer(b"".join(index), dtype=words.dtype)
    return np.array(played), tables.reshape(-1, TICKS_PER_PERIOD + 1, PROCESSORS)


def _few(
    shares: NDArray[np.float64], waveforms: NDArray[np.complex128]
) -> tuple[NDArray[np.float32], NDArray[np.complex64]]:
    """The fewest waveforms, (r, ...), with shares (p, r), whose sums give the others except for `NEGLIGIBLE`."""
    flat = np.ascontiguousarray(waveforms).reshape(len(waveforms), -1).view(np.float64)
    powers, mixtures = np.linalg.eigh(flat @ flat.T)
    there = powers > (NEGLIGIBLE / 100) ** 2 * powers[-1]
    roots, mixtures = np.sqrt(powers[there]), mixtures[:, there]
    left, strengths, right = np.linalg.svd(shares @ (mixtures * roots), full_matrices=False)
    strong = strengths > NEGLIGIBLE * strengths.max(initial=0)
    few = (right[strong] @ (mixtures / roots).T @ flat).view(np.complex128).reshape(-1, *waveforms.shape[1:])
    left = (left * strengths)[:, strong]
    left[np.abs(left) < NEGLIGIBLE**2 * strengths.max(initial=0)] = 0  # so that silence is silent
    return left.astype(np.float32), few.astype(np.complex64)
