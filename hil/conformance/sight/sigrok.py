"""A logic analyser's recording of some outputs, as a sigrok session file: read, and laid beside the device's time.

It may hold gigabytes: it is read piece by piece, and never kept. Its clock is the analyser's own, and its first sample
was taken at any time; `marks` that the device played tell which sample belongs to which tick. Writing such files is
the emulator's (`emulator.ports.sigrok`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from configparser import ConfigParser
from configparser import Error as ConfigError
from copy import copy
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from math import gcd
from pathlib import Path
from typing import NamedTuple
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from ....errors import InputFileError
from ....protocol.board import CHANNELS, PROCESSORS, TICK_HZ, TICKS_PER_PERIOD
from ....protocol.wiring import Pin
from ....storage import open_zip
from .capture import Seen, Unseen, check_stretch
from .marks import LONGEST_PULSE_GAP, Anchor, Mark, TimeBase, find_mark, time_bases

__all__ = ["Probe", "SessionFile", "SigrokSight", "find_marks"]

VERSIONS = ("1", "2")
DEVICE = "device 1"
LEAST_RATE_HZ = 4 * TICK_HZ
"""From here on any rate will do: a tick has at least two samples that are not next to its edges."""
SAME_CLOCK = 1e-7
"""That the clock of a recording at 2 MHz may seem to be off."""
PIECE_BYTES = 2**22
TICKS_AT_A_TIME = 20_000

_RATE = re.compile(r"(\d{1,15}(?:\.\d{1,15})?)\s*([kMG]?)(?:Hz)?", re.ASCII | re.IGNORECASE)
_PROBE = re.compile(r"probe(?P<number>[1-9]\d{0,3})", re.ASCII)
_FACTORS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_OTHERWISE = "no sigrok session file, or damaged (sigrok-cli and PulseView write whole zip archives)"
MOST_TEXT_BYTES = 2**16
"""Of version or metadata, which name some hundred probes."""
MOST_UNIT = 1024
MOST_RATE_HZ = 10**12

CHANNEL_NAMES = {Pin.of(channel).name: channel for channel in range(CHANNELS)}


class Probe(NamedTuple):
    """Where the analyser has touched something."""

    name: str
    bit: int
    """Of a sample, from the first byte's lowest on."""


class _Member(NamedTuple):
    """A part of the samples."""

    name: str
    first: int
    end: int


@dataclass(frozen=True)
class SessionFile:
    """A sigrok session file of version 1 or 2.

    Parameters
    ----------
    path : path
    rate : int
        Samples a second, by the analyser's clock.
    unit : int
        Bytes of a sample.
    probes : tuple of Probe
    members : tuple
        The parts of which the samples consist, in their order.
    """

    path: Path
    rate: int
    unit: int
    probes: tuple[Probe, ...]
    members: tuple[_Member, ...]

    @classmethod
    def open(cls, path: Path) -> SessionFile:
        """Read what a file says of itself, and none of its samples.

        Raises
        ------
        InputFileError
            Where it is no session file with logic samples, or a damaged one.
        OSError
            Where it cannot be read.
        """
        try:
            with open_zip(path, _OTHERWISE) as archive:
                sizes = {info.filename: info.file_size for info in archive.infolist()}
                version, metadata = (_text(archive, name) for name in ("version", "metadata"))
        except KeyError as error:
            raise InputFileError(
                f"{path} is no sigrok session file: there is no version and metadata in it; sigrok-cli -o FILE.sr and "
                "PulseView write such files"
            ) from error
        if version.strip() not in VERSIONS:
            raise InputFileError(
                f"{path} is a sigrok session file of version {version.strip()!r}; {' and '.join(VERSIONS)} are known"
            )
        values = _values(path, metadata)
        unit = _number(path, values, "unitsize")
        return cls(path, _rate(path, values), unit, _probes(values), _members(path, values, sizes, unit))

    @property
    def samples(self) -> int:
        """How many there are."""
        return self.members[-1].end

    def pieces(self, first: int, end: int) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Samples, piece by piece: the number of the first, and (n, unit) bytes.

        Raises
        ------
        InputFileError
            Where the file is damaged.
        OSError
            Where it cannot be read.
        """
        step = max(PIECE_BYTES // self.unit, 1)
        with open_zip(self.path, "damaged") as archive:
            for member in self.members:
                begin, stop = max(first, member.first), min(end, member.end)
                if begin >= stop:
                    continue
                with archive.open(member.name) as stream:
                    stream.seek((begin - member.first) * self.unit)
                    for at in range(begin, stop, step):
                        size = (min(at + step, stop) - at) * self.unit
                        if len(piece := stream.read(size)) < size:
                            raise EOFError(f"{member.name} ends too early")
                        yield at, np.frombuffer(piece, np.uint8).reshape(-1, self.unit)

    def at(self, places: NDArray[np.int64]) -> NDArray[np.uint8]:
        """The samples at some places, (k, unit) bytes; places ascend."""
        taken = np.empty((places.size, self.unit), np.uint8)
        for first, samples in self.pieces(int(places[0]), int(places[-1]) + 1):
            begin, stop = np.searchsorted(places, [first, first + len(samples)])
            taken[begin:stop] = samples[places[begin:stop] - first]
        return taken

    def silences(self, bits: Sequence[int], longer_than: float) -> NDArray[np.int64]:
        """Where most of some bits are low for long.

        Parameters
        ----------
        bits : sequence of int
            Of a sample.
        longer_than : float
            Samples.

        Returns
        -------
        (s, 2) int
            The first sample that is low, and the first that is high again; or the end of the file.
        """
        mask = np.zeros(self.unit * 8, np.uint8)
        mask[list(bits)] = 1
        mask = np.packbits(mask, bitorder="little")
        found = [np.empty((0, 2), np.int64)]
        fall = np.array([0])  # that was not followed by a rise yet; none while it is high
        for first, samples in self.pieces(0, self.samples):
            levels = 2 * _count(samples & mask) > len(bits)
            edges = np.concatenate([fall, first + np.flatnonzero(np.diff(levels, prepend=not fall.size))])
            pairs, fall = edges[: edges.size // 2 * 2].reshape(-1, 2), edges[edges.size // 2 * 2 :]
            found.append(pairs[np.diff(pairs)[:, 0] > longer_than])
        if fall.size and self.samples - fall[0] > longer_than:
            found.append(np.array([[fall[0], self.samples]]))
        return np.concatenate(found)


def _text(archive: ZipFile, name: str) -> str:
    """A small member; raise `ValueError` if it is no text, or too much."""
    with archive.open(name) as stream:
        data = stream.read(MOST_TEXT_BYTES + 1)
    if len(data) > MOST_TEXT_BYTES:
        raise ValueError(f"its {name} has more than {MOST_TEXT_BYTES} bytes")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"its {name} is no text") from error


def _count(samples: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """How many bits of each sample are set, (n,)."""
    count = np.zeros(len(samples), np.uint16)
    for column in samples.view(f"u{gcd(samples.shape[1], 8)}").T:  # in as few words as there can be, for speed
        count += np.bitwise_count(column)
    return count


def _values(path: Path, metadata: str) -> Mapping[str, str]:
    """What the file says of the analyser."""
    parser = ConfigParser(delimiters="=", comment_prefixes="#", interpolation=None)
    try:
        parser.read_string(metadata)
    except ConfigError as error:
        raise InputFileError(f"{path}: its metadata cannot be read: {' '.join(str(error).split())}") from error
    if DEVICE not in parser or "capturefile" not in parser[DEVICE]:
        raise InputFileError(f"{path} holds no logic samples; its metadata should name a capturefile under [{DEVICE}]")
    return parser[DEVICE]


def _number(path: Path, values: Mapping[str, str], key: str) -> int:
    """The number of bytes of a sample."""
    text = values.get(key, "")
    if not (re.fullmatch(r"\d{1,9}", text, re.ASCII) and 1 <= int(text) <= MOST_UNIT):
        raise InputFileError(f"{path}: {key} is {text[:40]!r}; it must be a whole number from 1 to {MOST_UNIT}")
    return int(text)


def _rate(path: Path, values: Mapping[str, str]) -> int:
    text = values.get("samplerate", "")
    found = _RATE.fullmatch(text)
    rate = int(Decimal(found[1]) * _FACTORS[found[2].lower()]) if found else 0
    if not 0 < rate <= MOST_RATE_HZ:
        raise InputFileError(f"{path}: samplerate is {text!r}; it must be one such as 24 MHz")
    return rate


def _probes(values: Mapping[str, str]) -> tuple[Probe, ...]:
    """The probes; unnamed ones were not recorded."""
    found = [(_PROBE.fullmatch(key), name) for key, name in values.items()]
    return tuple(Probe(name, int(key["number"]) - 1) for key, name in found if key)


def _members(path: Path, values: Mapping[str, str], sizes: Mapping[str, int], unit: int) -> tuple[_Member, ...]:
    """The parts of the samples: one that has the capture's name, or some that are numbered from 1 on."""
    capture = values["capturefile"]
    numbered = sum(re.fullmatch(re.escape(capture) + r"-\d+", name) is not None for name in sizes)
    names = [capture] if capture in sizes else [f"{capture}-{number}" for number in range(1, numbered + 1)]
    members: list[_Member] = []
    first = 0
    for name in names:
        if name not in sizes:
            raise InputFileError(f"{path} is damaged: there is no {name}, but {numbered} parts")
        if sizes[name] % unit:
            raise InputFileError(
                f"{path} is damaged: {name} has {sizes[name]} bytes, which is no whole number of samples of {unit}"
            )
        members.append(_Member(name, first, first + sizes[name] // unit))
        first = members[-1].end
    if not first:
        raise InputFileError(f"{path} holds no logic samples; there should be a {capture}-1 in it")
    return tuple(members)


def _wired(file: SessionFile, channels: Mapping[str, int]) -> dict[int, int]:
    """The output channels that were recorded, and the bit of each in a sample."""
    known, names = CHANNEL_NAMES | dict(channels), [probe.name for probe in file.probes]
    there = ", ".join(names) or "none"
    if missing := [name for name in channels if name not in names]:
        raise InputFileError(f"{file.path} has no probe {missing[0]!r}; it has {there}")
    wired: dict[int, int] = {}
    for name, bit in file.probes:
        if name not in known:
            continue
        if known[name] in wired:
            raise InputFileError(
                f"{file.path}: two probes are at output {Pin.of(known[name]).name}, one of them named {name!r}; "
                "it should be one"
            )
        if bit >= 8 * file.unit:
            raise InputFileError(
                f"{file.path} is damaged: {name} is probe {bit + 1}, but a sample of {file.unit} bytes has "
                f"{8 * file.unit} bits"
            )
        wired[known[name]] = bit
    if not wired:
        raise InputFileError(
            f"{file.path}: none of its probes ({there}) is known to be at an output; "
            "name them such as b2p1_07, or say in the profile, under [capture.channels], where they are"
        )
    return wired


def find_marks(file: SessionFile, bits: Sequence[int], marks: Sequence[Mark]) -> list[Anchor]:
    """Find marks in a recording, in the order in which they were played.

    Parameters
    ----------
    file : SessionFile
    bits : sequence of int
        Of a sample, at which outputs are.
    marks : sequence of Mark

    Raises
    ------
    InputFileError
        Where the file is damaged.
    OSError
        Where it cannot be read.
    """
    samples_per_tick = file.rate / TICK_HZ
    silences = file.silences(bits, LONGEST_PULSE_GAP * samples_per_tick)
    return [anchor for mark in marks if (anchor := find_mark(mark, silences, samples_per_tick)) is not None]


@dataclass(frozen=True)
class _Recording:
    """A file and what was played for it to be known by, looked through when first it is needed."""

    path: Path
    channels: Mapping[str, int]
    marks: Sequence[Mark]

    @cached_property
    def file(self) -> SessionFile:
        file = SessionFile.open(self.path)
        if file.rate < LEAST_RATE_HZ and file.rate % TICK_HZ:
            raise InputFileError(
                f"{file.path} was sampled at {file.rate / 1e6:g} MHz; it must be {LEAST_RATE_HZ // 10**6} MHz or more, "
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
                f"{self.path} was not recorded during this run: none of the {len(self.marks)} marks that were played "
                "is in it"
            )
        return self._found

    @cached_property
    def _found(self) -> Sequence[Anchor]:
        return find_marks(self.file, list(self.wired.values()), self.marks)


class SigrokSight:
    """Sees the outputs that a logic analyser recorded while the suite ran.

    The file is opened when first something is to be seen of it, after the run.

    Parameters
    ----------
    path : path
        A sigrok session file, sampled at 8 MHz or more, or at 2, 4 or 6 MHz.
    channels : mapping of str to int
        Output channels at which probes are, by their names; of the others those are known that bear the name of an
        output, such as ``b2p1_07``.
    marks : sequence of Mark
        What was played for it to be known by, in that order; it may still grow until the file is opened.
    """

    deferred = True

    def __init__(self, path: Path, channels: Mapping[str, int], marks: Sequence[Mark]) -> None:
        self._recording = _Recording(path, channels, marks)
        self._marks = marks

    @property
    def name(self) -> str:
        """``sigrok:FILE``."""
        return f"sigrok:{self._recording.path}"

    @property
    def path(self) -> Path:
        """Where the recording is, or will be."""
        return self._recording.path

    def between(self, before: Mark, after: Mark) -> SigrokSight:
        """The same, from one mark to another alone: a device that began anew passes the same periods again."""
        part = copy(self)
        part._marks = self._marks[self._marks.index(before) : self._marks.index(after) + 1]
        return part

    def seen(self, first_period: int, last_period: int) -> Seen:
        """The outputs over some periods, at the middle of each tick; see `Sight`.

        Raises
        ------
        Unseen
            Where they do not lie between two marks that are in the file and less than 10 s apart, or do so twice.
        InputFileError
            Where the file is damaged, of another kind, or of another run.
        OSError
            Where it cannot be read.
        """
        check_stretch(first_period, last_period)
        file, wired = self._recording.file, self._recording.wired
        base = self._base(first_period, last_period)
        ticks = np.arange(first_period * TICKS_PER_PERIOD, last_period * TICKS_PER_PERIOD)
        words = np.empty((ticks.size, PROCESSORS), np.uint32)
        for begin in range(0, ticks.size, TICKS_AT_A_TIME):
            piece = slice(begin, begin + TICKS_AT_A_TIME)
            places = np.rint(base.samples_at(ticks[piece] + 0.5)).astype(np.int64)
            words[piece] = _words(file.at(places), wired)
        observed = _words(np.full((1, file.unit), 0xFF, np.uint8), wired)[0]
        return Seen(first_period, last_period, words, observed)

    def _base(self, first_period: int, last_period: int) -> TimeBase:
        """What tells the time of some periods; raises `Unseen` where nothing does."""
        file = self._recording.file
        anchors = [anchor for anchor in self._recording.anchors if anchor.mark in self._marks]
        bases = [base for base in time_bases(anchors, file.rate / TICK_HZ) if base.covers(first_period, last_period)]
        if len(bases) != 1:
            where = "more than once" if bases else "nowhere"
            raise Unseen(
                f"periods {first_period} to {last_period} lie {where} in {file.path} between two marks that are less "
                "than 10 s apart"
            )
        if file.rate == TICK_HZ and abs(bases[0].samples_per_tick - 1) > SAME_CLOCK:
            raise Unseen(
                f"{file.path} was sampled at 2 MHz by another clock than the device's, so that ticks are missing or "
                f"doubled; {LEAST_RATE_HZ // 10**6} MHz would do"
            )
        return bases[0]


def _words(samples: NDArray[np.uint8], wired: Mapping[int, int]) -> NDArray[np.uint32]:
    """Port words of samples, (n, unit) bytes to (n, 10)."""
    levels = np.zeros((len(samples), CHANNELS), np.uint8)
    levels[:, list(wired)] = np.unpackbits(samples, axis=1, bitorder="little")[:, list(wired.values())]
    return np.packbits(levels, axis=1, bitorder="little").view("<u4").astype(np.uint32)
