"""A logic analyser's recording of some outputs as a sigrok session file.

Writing such files is the emulator's (`emulator.ports.sigrok`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from configparser import ConfigParser
from configparser import Error as ConfigError
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from functools import partial
from pathlib import Path
from time import monotonic, sleep, time
from typing import NamedTuple
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from ....base.errors import InputFileError
from ....base.storage import FilePath, open_zip
from .marks import Mark
from .recorded import Probe, RecordedObserver

__all__ = ["SessionFile", "SigrokObserver"]

VERSIONS = ("1", "2")
DEVICE = "device 1"
PIECE_BYTES = 2**22
RECORDING_SECONDS = 600.0
"""For which a run waits until its recording is saved."""
LOOK_SECONDS = 0.5

_RATE = re.compile(r"(\d{1,15}(?:\.\d{1,15})?)\s*([kMG]?)(?:Hz)?", re.ASCII | re.IGNORECASE)
_PROBE = re.compile(r"probe(?P<number>[1-9]\d{0,3})", re.ASCII)
_FACTORS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_OTHERWISE = "no sigrok session file, or damaged (sigrok-cli and PulseView write whole zip archives)"
MOST_TEXT_BYTES = 2**16
"""The greatest size of version or metadata, which name some hundred probes."""
MOST_UNIT = 1024
MOST_RATE_HZ = 10**12


class _Member(NamedTuple):
    """A part of the samples."""

    name: str
    first: int
    end: int


@dataclass(frozen=True)
class SessionFile:
    """A sigrok session file of version 1 or 2."""

    path: Path
    rate: int
    """Samples a second, by the analyser's clock."""
    unit: int
    """Bytes of a sample."""
    probes: tuple[Probe, ...]
    members: tuple[_Member, ...]
    """The parts of which the samples consist, in their order."""

    @classmethod
    def open(cls, path: FilePath) -> SessionFile:
        """Read a file's metadata, and none of its samples.

        Raises `InputFileError` if it is no session file with logic samples or a damaged one, and `OSError` if it
        cannot be read.
        """
        path = Path(path)
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
    def name(self) -> str:
        """The file's path."""
        return str(self.path)

    @property
    def samples(self) -> int:
        """How many there are."""
        return self.members[-1].end

    def pieces(self, first: int, end: int) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Samples, piece by piece: the number of the first, and (n, unit) bytes.

        Raises `InputFileError` if the file is damaged, and `OSError` if it cannot be read.
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


def _text(archive: ZipFile, name: str) -> str:
    """A small member; raises `ValueError` if it is no text, or too long."""
    with archive.open(name) as stream:
        data = stream.read(MOST_TEXT_BYTES + 1)
    if len(data) > MOST_TEXT_BYTES:
        raise ValueError(f"its {name} has more than {MOST_TEXT_BYTES} bytes")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"its {name} is no text") from error


def _values(path: Path, metadata: str) -> Mapping[str, str]:
    """The file's metadata about the analyser."""
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
    """The parts of the samples: one with the capture's name, or several that are numbered from 1."""
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


class SigrokObserver(RecordedObserver):
    """Sees the outputs that a sigrok session file will hold, which somebody records while the suite runs.

    Its channels and marks are those of `RecordedObserver`. Raises `ValueError` if the path is a folder.
    """

    def __init__(self, path: Path, channels: Mapping[str, int], marks: Sequence[Mark]) -> None:
        if path.is_dir():
            raise ValueError(f"sigrok:{path} is a folder; it should be the file where the recording will be")
        super().__init__(f"sigrok:{path}", partial(SessionFile.open, path), channels, marks)
        self._path, self._since = path, time()

    def finish(self, tell: Callable[[str], object]) -> None:
        """Wait until a recording of this run is there; Ctrl-C and ten minutes end that."""
        end = monotonic() + RECORDING_SECONDS
        with suppress(KeyboardInterrupt):
            if not self._is_saved():
                tell(f"end the recording and save it as {self._path}; Ctrl-C goes on without it")
            while not self._is_saved() and monotonic() < end:
                sleep(LOOK_SECONDS)

    def _is_saved(self) -> bool:
        try:
            if self._path.stat().st_mtime < self._since:
                return False  # an older one is no recording of this run
            SessionFile.open(self._path)
        except (OSError, InputFileError):
            return False
        return True
