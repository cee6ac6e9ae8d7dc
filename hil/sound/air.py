"""Sound from captured bits: the pressure over time that the outputs make.

There are two ways from bits to pressure, and they agree. `Playback.signal` follows every edge through amplifier,
resonance and air; it is for milliseconds, or for few points. `Playback.phasors` and `Playback.intensity_component` take
the fundamental of each carrier period and the response of the resonance; they are for seconds, and for many points.
While the drive is constant, both equal the solver's phasor model, `solver.pressure`.

Both are linear, while real air saturates at the pressures of a strong focus. Apart from its resonance, a transducer is
the same in all directions and at all frequencies as at 40 kHz. Pressure is peak in Pa, time factor e^{-iωt}.

Nothing is interpolated: sound may take a fraction of a tick, or of a period, to arrive, but the state of a resonance
under a constant drive is known at any time (`OnePole.between`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import real, stretch
from ...emulator.ports.amplifier import Amplifier
from ...protocol.board import CARRIER_HZ, CHANNELS, TICK_HZ, TICKS_PER_PERIOD
from ...protocol.wiring import Wiring
from ...solver import Medium, TransducerArray
from ...solver.acoustics.propagation import arrivals
from ...solver.acoustics.resonator import OnePole, Resonator
from ...solver.geometry import PointsLike, as_places
from .ringing import ResonatorBank, words_of

__all__ = ["Outputs", "Playback", "component", "rms"]

SETTLED = 37  # time constants after which double precision holds no trace of the past
TICKS_AT_A_TIME = 2048
PERIODS_AT_A_TIME = 4096
POINTS_AT_A_TIME = 64
NEGLIGIBLE = 1e-6  # relative to the strongest combination of drives


class Outputs(Protocol):
    """The part of a capture that is needed here."""

    @property
    def wiring(self) -> Wiring:
        """How the transducers are connected."""

    @property
    def end_tick(self) -> int:
        """Number of ticks captured."""

    @property
    def open_transducers(self) -> frozenset[int]:
        """Transducers that are not connected."""

    def bits(self, start: int, stop: int) -> NDArray[np.uint32]:
        """Port words of some ticks, (stop - start, 10)."""

    def drives(self, first: int, last: int) -> NDArray[np.complex64]:
        """Drives emitted in some carrier periods, (last - first, 320) in array order."""


@dataclass(frozen=True, eq=False)
class Playback:
    """The sound of a capture.

    Parameters
    ----------
    capture : Capture
        The outputs. Before tick 0 they are silent.
    array : TransducerArray
        320 transducers with their resonance; by default those of the boards.
    medium : Medium
        The air, at the boards' 40 kHz.
    amplifier : Amplifier
        Between outputs and transducers.

    Raises
    ------
    ValueError
        If the array has another number of transducers, or the medium another frequency.
    """

    capture: Outputs
    array: TransducerArray = field(default_factory=TransducerArray.grid)
    medium: Medium = field(default_factory=Medium)
    amplifier: Amplifier = field(default_factory=Amplifier)

    def __post_init__(self) -> None:
        """Check that all parts fit the boards."""
        if len(self.array) != CHANNELS:
            raise ValueError(f"an array of {len(self.array)} transducers does not fit boards with {CHANNELS} outputs")
        if self.medium.frequency != CARRIER_HZ:
            raise ValueError(
                f"a medium for {self.medium.frequency:g} Hz does not fit the boards' carrier of {CARRIER_HZ} Hz"
            )

    def __repr__(self) -> str:
        return f"Playback({self.capture}, {len(self.array)} transducers)"

    @property
    def resonator(self) -> Resonator:
        """The resonance of the array's transducers."""
        return Resonator.of(self.array.transducer)

    def signal(self, at: PointsLike, start: int, stop: int) -> NDArray[np.float32]:
        """Pressure over time, from every edge of the bits.

        Parameters
        ----------
        at : ControlPoints, Shape or (k, 3) float
            Points, in metres.
        start, stop : int
            Ticks of the capture, 0.5 µs each; stop is not included.

        Returns
        -------
        (k, stop - start) float32
            Instantaneous pressure in Pa at the beginning of each tick.

        Raises
        ------
        ValueError
            If the ticks were not captured, or as in `transfer_matrix`.
        """
        start, stop = stretch("ticks", ("start", "stop"), start, stop, 0, self.capture.end_tick)
        points, resonance = as_places(at), self.resonator.sampled(1 / TICK_HZ)
        lag, here, following = self._heard(points, resonance)
        nearest, farthest = int(lag.min()), int(lag.max())
        lag -= nearest
        first = (start - farthest) // TICKS_PER_PERIOD
        settling = math.ceil(SETTLED * self.resonator.time_constant * CARRIER_HZ)
        bank = ResonatorBank(self.capture, self.amplifier, resonance, max(first - settling, min(first, 0)))
        bank.skip_until(first)
        # The sound of a period begins to arrive `nearest` ticks after it: periods of sound are cut there.
        early = (start - nearest) % TICKS_PER_PERIOD
        begin = (start - nearest) // TICKS_PER_PERIOD
        periods = -(-(early + stop - start) // TICKS_PER_PERIOD)
        sound = np.empty((len(points), periods, TICKS_PER_PERIOD), dtype=np.float32)
        fresh = 0
        for emission in bank.emit_until(begin + periods):
            fresh = emission.arrive(sound, emission.first - begin, fresh, lag, here, following)
        return sound.reshape(len(points), -1)[:, early : early + stop - start]

    def voltages(self, start: int, stop: int) -> NDArray[np.float32]:
        """The voltage of the amplifiers on the transducers.

        Parameters
        ----------
        start, stop : int
            Ticks of the capture, 0.5 µs each; stop is not included.

        Returns
        -------
        (320, stop - start) float32
            In array order, the mean over each tick, in volts.

        Raises
        ------
        ValueError
            If the ticks were not captured.
        """
        from ...solver.compiled.time_kernels import write_drives

        start, stop = stretch("ticks", ("start", "stop"), start, stop, 0, self.capture.end_tick)
        transducer = np.argsort(self.capture.wiring.channels)
        volts = np.empty((CHANNELS, stop - start), dtype=np.float32)
        for first in range(start, stop, TICKS_AT_A_TIME):
            last = min(first + TICKS_AT_A_TIME, stop)
            words = words_of(self.capture, first - 1, last)
            tick_voltages = self.amplifier.tick_voltages.astype(np.float32)
            write_drives(words[1:], tick_voltages, words[0], transducer, volts[:, first - start : last - start])
        return volts

    def phasors(self, at: PointsLike, first: int, last: int) -> NDArray[np.complex64]:
        """Pressure phasors, from the fundamental of each carrier period.

        Parameters
        ----------
        at : ControlPoints, Shape or (k, 3) float
            Points, in metres.
        first, last : int
            Carrier periods of the capture, 25 µs each; last is not included.

        Returns
        -------
        (k, last - first) complex64
            Complex peak pressure in Pa at the beginning of each period.

        Raises
        ------
        ValueError
            If the periods were not captured, or as in `transfer_matrix`.

        Notes
        -----
        The place of a pulse within its period is neglected, and so is the phase that a change gains against the
        carrier: together a few per cent of the change while it happens, and nothing of its final value.
        """
        points = as_places(at)
        first, last = self._periods(first, last)
        phasors = np.empty((len(points), last - first), dtype=np.complex64)
        for rows, columns, part in self._phasors(points, first, last):
            phasors[rows, columns] = part
        return phasors

    def intensity_component(self, at: PointsLike, frequency: float, first: int, last: int) -> NDArray[np.float64]:
        """How strongly the intensity changes at a frequency, as `solver.intensity_component`, but from the bits.

        Parameters
        ----------
        at : ControlPoints, Shape or (k, 3) float
            Points, in metres; any number of them, because nothing is kept over time.
        frequency : float
            The frequency in hertz; 0 is the mean.
        first, last : int
            Carrier periods of the capture, a whole number of cycles.

        Returns
        -------
        (k,) float
            Amplitude A of the term A·cos(2π·frequency·t + φ) of |p|² in Pa², p being the peak pressure.

        Raises
        ------
        ValueError
            If the periods are no whole number of cycles or were not captured, or as in `transfer_matrix`.
        """
        points = as_places(at)
        first, last = self._periods(first, last)
        turns = _turns(frequency, CARRIER_HZ, last - first)
        pairs = np.stack([turns.real, turns.imag], axis=1).astype(np.float32)
        found = np.zeros((len(points), 2))
        for rows, columns, part in self._phasors(points, first, last):
            found[rows] += (part.real**2 + part.imag**2) @ pairs[columns]
        return np.asarray(np.hypot(*found.T))

    def _periods(self, first: int, last: int) -> tuple[int, int]:
        return stretch("periods", ("first", "last"), first, last, 0, self.capture.end_tick // TICKS_PER_PERIOD)

    def _lags(self, points: NDArray[np.float64]) -> range:
        """The greatest and the least age, in periods, of what some points hear."""
        others = self.array.positions
        gap = np.maximum(points.min(axis=0) - others.max(axis=0), others.min(axis=0) - points.max(axis=0))
        reach = np.maximum(points.max(axis=0) - others.min(axis=0), others.max(axis=0) - points.min(axis=0))
        near, far = (float(np.linalg.norm(np.maximum(way, 0))) / self.medium.wavelength for way in (gap, reach))
        return range(max(math.ceil(near) - 2, 0), math.ceil(far) + 2)

    def _arrivals(self, points: NDArray[np.float64]) -> NDArray[np.complex64]:
        """The response of each point to each transducer's drive, without the phase of the path, (k, n)."""
        found = arrivals(self.array, points, self.medium)
        found[:, list(self.capture.open_transducers)] = 0
        return found

    def _heard(
        self, points: NDArray[np.float64], resonance: OnePole
    ) -> tuple[NDArray[np.int64], NDArray[np.complex64], NDArray[np.complex64]]:
        """For each point and channel, (k, 320): lags in ticks, and the weights of the state then and of the next.

        A phase that is neither the path's nor a sign, as in a near field or a calibrated response, is treated as a
        delay.
        """
        from ...solver.compiled.time_kernels import place_waves

        wiring = self.capture.wiring
        shape = (len(points), CHANNELS)
        lag, here, following = np.empty(shape, np.int64), np.empty(shape, np.complex64), np.empty(shape, np.complex64)
        transducer = np.argsort(wiring.channels)
        place_waves(
            points,
            self.array.positions[transducer],
            self._arrivals(points)[:, transducer],
            TICKS_PER_PERIOD / self.medium.wavelength,
            TICKS_PER_PERIOD / (2 * math.pi),
            resonance.between_series(),
            lag,
            here,
            following,
        )
        return lag, here, following

    def _phasors(
        self, points: NDArray[np.float64], first: int, last: int
    ) -> Iterator[tuple[slice, slice, NDArray[np.complex64]]]:
        """Blocks of phasors: which points, which periods since the first, and the phasors.

        The phasor at point i is Σ_q A_iq·z_q a delay ago. Apart from a few complex factors the transducers share their
        course over time: z = envelopes @ fields. So it is a sum over envelopes and whole periods of delay.
        """
        if first == last:
            return
        from ...solver.compiled.time_kernels import place_envelopes

        resonance = self.resonator.enveloped(CARRIER_HZ, 1 / CARRIER_HZ)
        wavelength, series = self.medium.wavelength, resonance.between_series()
        longest = self._lags(points).stop
        envelopes, fields = self._envelopes(resonance, first - longest, last)
        pairs = np.stack([fields.real.T, fields.imag.T]).astype(np.float32)
        for i in range(0, len(points), POINTS_AT_A_TIME):
            rows = slice(i, min(i + POINTS_AT_A_TIME, len(points)))
            lags = self._lags(points[rows])
            re, im = np.empty((2, rows.stop - i, len(lags), len(fields)), dtype=np.float32)
            arriving = self._arrivals(points[rows])
            place_envelopes(
                points[rows], self.array.positions, arriving, 1 / wavelength, series, pairs, lags[0], re, im
            )
            response = (re + 1j * im).reshape(len(re), -1)
            for k in range(0, last - first, PERIODS_AT_A_TIME):
                columns = slice(k, min(k + PERIODS_AT_A_TIME, last - first))
                begin, end = columns.start + longest, columns.stop + longest
                yield rows, columns, response @ np.concatenate([envelopes[:, begin - b : end - b] for b in lags])

    def _envelopes(
        self, resonance: OnePole, first: int, last: int
    ) -> tuple[NDArray[np.complex64], NDArray[np.complex128]]:
        """Envelopes at the beginning of some periods, (r, last - first), and the fields that they multiply, (r, n).

        A modulated field needs one or two of them, whatever the number of transducers.
        """
        begin = first - math.ceil(SETTLED * self.resonator.time_constant * CARRIER_HZ)
        begin = max(begin, min(first, 0))
        drives = self.capture.drives(max(begin, 0), max(last, 0))
        index: dict[bytes, int] = {}
        played = [index.setdefault(row.tobytes(), len(index)) for row in drives]
        distinct = np.frombuffer(b"".join(index), dtype=drives.dtype).reshape(-1, CHANNELS)
        weights, fields = _factors(distinct.astype(np.complex128))
        silent = np.zeros((max(-begin, 0), len(fields)))
        drive = np.concatenate([silent, weights[played]])
        rate = (1 - resonance.decay) * resonance.gain * self.amplifier.gain
        # The state at the beginning of a period is the result of the drives before it.
        rung = scipy.signal.lfilter([0, rate], [1, -resonance.decay], drive, axis=0)
        return np.ascontiguousarray(rung[first - begin :].T, dtype=np.complex64), fields


def rms(signal: ArrayLike) -> NDArray[np.float64]:
    """Root of the mean square over the last axis, (..., t) to (...); over whole carrier periods the rms of a sound."""
    return np.asarray(np.sqrt(np.mean(np.square(np.asarray(signal, dtype=np.float64)), axis=-1)))


def component(series: ArrayLike, frequency: float, rate: float) -> NDArray[np.float64]:
    """Amplitude of a series at a frequency.

    Parameters
    ----------
    series : (..., t) float
        A whole number of cycles.
    frequency : float
        The frequency in hertz; 0 is the mean.
    rate : float
        Samples per second.

    Returns
    -------
    (...) float
        A of the term A·cos(2π·frequency·t + φ).

    Raises
    ------
    ValueError
        If there is no whole number of cycles, or the frequency is not below half the rate.
    """
    values = np.asarray(series, dtype=np.float64)
    return np.asarray(np.abs(values @ _turns(frequency, rate, values.shape[-1])))


def _turns(frequency: float, rate: float, samples: int) -> NDArray[np.complex128]:
    """The factors whose weighted sum with a series is the amplitude at a frequency."""
    frequency = real("frequency", frequency, 0, unit="Hz")
    cycles = samples * frequency / rate
    if not frequency < rate / 2:
        raise ValueError(f"frequency {frequency} Hz must be at least 0 and below half the rate of {rate:g} Hz")
    if not samples or abs(cycles - round(cycles)) > 1e-6 or (frequency > 0 and cycles < 0.5):
        raise ValueError(
            f"{samples} samples at {rate:g} Hz hold {cycles:g} cycles of {frequency:g} Hz; a whole number is needed"
        )
    return np.asarray((2 if frequency else 1) / samples * np.exp(2j * np.pi * frequency / rate * np.arange(samples)))


def _factors(rows: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Matrices (f, r) and (r, n), with the least r, whose product equals (f, n) rows except for `NEGLIGIBLE`."""
    if len(rows) < rows.shape[1]:
        powers, basis = np.linalg.eigh(rows @ rows.conj().T)
        basis = basis[:, powers > NEGLIGIBLE**2 * powers[-1]]
        return basis, basis.conj().T @ rows
    powers, basis = np.linalg.eigh(rows.conj().T @ rows)
    basis = basis[:, powers > NEGLIGIBLE**2 * powers[-1]]
    return rows @ basis, basis.conj().T
