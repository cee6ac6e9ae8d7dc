"""A recording of some outputs by a logic analyser, laid beside the device's time.

It may hold gigabytes: it is read piece by piece, and never kept. Its clock is the analyser's own, and its first sample
was taken at any time; `marks` that the device played tell which sample belongs to which tick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from math import gcd
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ....base.errors import InputFileError
from ....protocol.board import CHANNELS, PROCESSORS, TICK_HZ, TICKS_PER_PERIOD
from ....protocol.wiring import Pin
from .capture import Observer, Seen, Unseen, check_stretch
from .marks import LONGEST_PULSE_GAP, Anchor, Mark, TimeBase, find_mark, time_bases

__all__ = ["Probe", "RecordedObserver", "SampleRecording", "find_marks", "silences"]

LEAST_RATE_HZ = 4 * TICK_HZ
"""From here on any rate will do: a tick has at least two samples that are not next to its edges."""
SAME_CLOCK = 1e-7
"""That the clock of a recording at 2 MHz may seem to be off."""
TICKS_AT_A_TIME = 20_000

CHANNEL_NAMES = {Pin.of(channel).name: channel for channel in range(CHANNELS)}


class Probe(NamedTuple):
    """Where the analyser has touched something."""

    name: str
    bit: int
    """Of a sample, from the first byte's lowest on."""


class SampleRecording(Protocol):
    """Samples of some outputs, taken at even distances."""

    @property
    def name(self) -> str:
        """For people."""

    @property
    def rate(self) -> int:
        """Samples a second, by the analyser's clock."""

    @property
    def unit(self) -> int:
        """Bytes of a sample."""

    @property
    def probes(self) -> Sequence[Probe]:
        """Where in a sample each probe stands."""

    @property
    def samples(self) -> int:
        """How many there are."""

    def pieces(self, first: int, end: int) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Samples, piece by piece: the number of the first, and (n, unit) bytes.

        Raises `InputFileError` if the recording is damaged, and `OSError` if it cannot be read.
        """


def _at(recording: SampleRecording, places: NDArray[np.int64]) -> NDArray[np.uint8]:
    """The samples at some places, (k, unit) bytes; places ascend."""
    taken = np.empty((places.size, recording.unit), np.uint8)
    for first, samples in recording.pieces(int(places[0]), int(places[-1]) + 1):
        begin, stop = np.searchsorted(places, [first, first + len(samples)])
        taken[begin:stop] = samples[places[begin:stop] - first]
    return taken


def silences(recording: SampleRecording, bits: Sequence[int], longer_than: float) -> NDArray[np.int64]:
    """Where most of some bits of the samples are low for more than so many samples, (s, 2) int.

    The first sample that is low, and the first that is high again; or the end of the recording.
    """
    mask = np.zeros(recording.unit * 8, np.uint8)
    mask[list(bits)] = 1
    mask = np.packbits(mask, bitorder="little")
    found = [np.empty((0, 2), np.int64)]
    fall = np.array([0])  # that was not followed by a rise yet; none while it is high
    for first, samples in recording.pieces(0, recording.samples):
        levels = 2 * _count(samples & mask) > len(bits)
        edges = np.concatenate([fall, first + np.flatnonzero(np.diff(levels, prepend=not fall.size))])
        pairs, fall = edges[: edges.size // 2 * 2].reshape(-1, 2), edges[edges.size // 2 * 2 :]
        found.append(pairs[np.diff(pairs)[:, 0] > longer_than])
    if fall.size and recording.samples - fall[0] > longer_than:
        found.append(np.array([[fall[0], recording.samples]]))
    return np.concatenate(found)


def _count(samples: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """How many bits of each sample are set, (n,)."""
    count = np.zeros(len(samples), np.uint16)
    for column in samples.view(f"u{gcd(samples.shape[1], 8)}").T:  # in as few words as there can be, for speed
        count += np.bitwise_count(column)
    return count


def _wired(file: SampleRecording, channels: Mapping[str, int]) -> dict[int, int]:
    """The output channels that were recorded, and the bit of each in a sample."""
    known, names = CHANNEL_NAMES | dict(channels), [probe.name for probe in file.probes]
    there = ", ".join(names) or "none"
    if missing := [name for name in channels if name not in names]:
        raise InputFileError(f"{file.name} has no probe {missing[0]!r}; it has {there}")
    wired: dict[int, int] = {}
    for name, bit in file.probes:
        if name not in known:
            continue
        if known[name] in wired:
            raise InputFileError(
                f"{file.name}: two probes are at output {Pin.of(known[name]).name}, one of them named {name!r}; "
                "it should be one"
            )
        if bit >= 8 * file.unit:
            raise InputFileError(
                f"{file.name} is damaged: {name} is probe {bit + 1}, but a sample of {file.unit} bytes has "
                f"{8 * file.unit} bits"
            )
        wired[known[name]] = bit
    if not wired:
        raise InputFileError(
            f"{file.name}: none of its probes ({there}) is known to be at an output; "
            "name them such as b2p1_07, or say in the profile, under [capture.channels], where they are"
        )
    return wired


def find_marks(file: SampleRecording, bits: Sequence[int], marks: Sequence[Mark]) -> list[Anchor]:
    """Find marks in a recording, by the bits at which outputs are, in the order in which they were played.

    Raises `InputFileError` if the file is damaged, and `OSError` if it cannot be read.
    """
    samples_per_tick = file.rate / TICK_HZ
    found = silences(file, bits, LONGEST_PULSE_GAP * samples_per_tick)
    return [anchor for mark in marks if (anchor := find_mark(mark, found, samples_per_tick)) is not None]


@dataclass(frozen=True)
class _Known:
    """A recording and what was played for it to be known by, looked through when first it is needed."""

    open: Callable[[], SampleRecording]
    channels: Mapping[str, int]
    marks: Sequence[Mark]

    @cached_property
    def file(self) -> SampleRecording:
        file = self.open()
        if file.rate < LEAST_RATE_HZ and file.rate % TICK_HZ:
            raise InputFileError(
                f"{file.name} was sampled at {file.rate / 1e6:g} MHz; it must be {LEAST_RATE_HZ // 10**6} MHz or more, "
                "or 2, 4 or 6 MHz"
            )
        return file

    @cached_property
    def wired(self) -> Mapping[int, int]:
        return _wired(self.file, self.channels)

    @cached_property
    def anchors(self) -> Sequence[Anchor]:
        """The marks that are in it; `InputFileError`, each time and after one look, if none is."""
        if not self._found:
            raise InputFileError(
                f"{self.file.name} was not recorded during this run: none of the {len(self.marks)} marks that were "
                "played is in it"
            )
        return self._found

    @cached_property
    def _found(self) -> Sequence[Anchor]:
        return find_marks(self.file, list(self.wired.values()), self.marks)


class RecordedObserver(Observer):
    """Sees the outputs that a logic analyser recorded while the suite ran.

    Parameters
    ----------
    name : str
        The capture's name, for reports.
    open : callable
        Gives the recording; it is called when first something is to be seen of it, after the run. It was sampled at
        8 MHz or more, or at 2, 4 or 6 MHz.
    channels : mapping of str to int
        Output channels at which probes are, by their names; of the others those are known that bear the name of an
        output, such as ``b2p1_07``.
    marks : sequence of Mark
        What was played for it to be known by, in that order; it may still grow until the recording is opened.
    """

    deferred = True

    def __init__(
        self, name: str, open: Callable[[], SampleRecording], channels: Mapping[str, int], marks: Sequence[Mark]
    ) -> None:
        self.name = name
        self._recording = _Known(open, channels, marks)
        self._marks = marks

    def between(self, before: Mark, after: Mark) -> RecordedObserver:
        """The same, from one mark to another alone: a device that began anew passes the same periods again."""
        part = copy(self)
        part._marks = self._marks[self._marks.index(before) : self._marks.index(after) + 1]
        return part

    def seen(self, first_period: int, last_period: int) -> Seen:
        """The outputs over some periods, at the middle of each tick; see `Observer`.

        Raises `Unseen` if they do not lie between two marks that are in the file and less than 10 s apart, or do so
        twice, `InputFileError` if the file is damaged, of another kind, or of another run, and `OSError` if it cannot
        be read.
        """
        check_stretch(first_period, last_period)
        file, wired = self._recording.file, self._recording.wired
        base = self._base(first_period, last_period)
        ticks = np.arange(first_period * TICKS_PER_PERIOD, last_period * TICKS_PER_PERIOD)
        words = np.empty((ticks.size, PROCESSORS), np.uint32)
        for begin in range(0, ticks.size, TICKS_AT_A_TIME):
            piece = slice(begin, begin + TICKS_AT_A_TIME)
            places = np.rint(base.samples_at(ticks[piece] + 0.5)).astype(np.int64)
            words[piece] = _words(_at(file, places), wired)
        observed = _words(np.full((1, file.unit), 0xFF, np.uint8), wired)[0]
        return Seen(first_period, last_period, words, observed)

    def _base(self, first_period: int, last_period: int) -> TimeBase:
        """The time base of some periods; raises `Unseen` if there is none."""
        file = self._recording.file
        anchors = [anchor for anchor in self._recording.anchors if anchor.mark in self._marks]
        bases = [base for base in time_bases(anchors, file.rate / TICK_HZ) if base.covers(first_period, last_period)]
        if len(bases) != 1:
            where = "more than once" if bases else "nowhere"
            raise Unseen(
                f"periods {first_period} to {last_period} lie {where} in {file.name} between two marks that are less "
                "than 10 s apart"
            )
        if file.rate == TICK_HZ and abs(bases[0].samples_per_tick - 1) > SAME_CLOCK:
            raise Unseen(
                f"{file.name} was sampled at 2 MHz by another clock than the device's, so that ticks are missing or "
                f"doubled; {LEAST_RATE_HZ // 10**6} MHz would do"
            )
        return bases[0]


def _words(samples: NDArray[np.uint8], wired: Mapping[int, int]) -> NDArray[np.uint32]:
    """Port words of samples, (n, unit) bytes to (n, 10)."""
    levels = np.zeros((len(samples), CHANNELS), np.uint8)
    levels[:, list(wired)] = np.unpackbits(samples, axis=1, bitorder="little")[:, list(wired.values())]
    return np.packbits(levels, axis=1, bitorder="little").view("<u4").astype(np.uint32)
