"""Recordings: frames of pulses in a file, with everything that is needed to play and to identify them.

A recording holds pulses, not drives: playing it gives bit by bit what would have been played when it was made, without
a further calibration. All numbers are little-endian:

=========  =====  ==============================================================================
at         bytes  content
=========  =====  ==============================================================================
0          8      ``PWFRAMES``
8          4      T, the bytes of the text
12         4      CRC-32 of the text
16         8      how many frames follow; all ones in a file that was not finished
24         4      CRC-32 of bytes 0 to 23
28         T      the text: an object of JSON in UTF-8, see `_described`
28 + T     2n+4   frame 0: n bytes of phases in half ticks, n of widths in ticks, and their CRC-32
28+T+2n+4  2n+4   frame 1, and so on
=========  =====  ==============================================================================

The CRC-32 of a frame starts with its number instead of 0, as in ``zlib.crc32(pulses, number)``, so that a misplaced
frame is detected. A file refers to no other file, and is not compressed: a damaged or hostile one costs no more memory
than its text and the requested frames. A truncated file can be read up to its last whole frame.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import whole
from ...base.errors import InputFileError
from ...base.storage import FilePath, growing, open_plain
from ...protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from ...protocol.quantise import PulseFrames, check_pulses
from ...solver import Medium, TransducerArray
from .calibration import Calibration
from .frames import Frames, checked_rate, frame_source

__all__ = ["SUFFIX", "Recording", "record"]

SUFFIX = ".frames"
MAGIC = b"PWFRAMES"
FORMAT = "phasewire-recording-2"
CLOCK = {"carrier_hz": CARRIER_HZ, "ticks_per_period": TICKS_PER_PERIOD}
FRAMES_AT_A_TIME = 256
"""How many are written together: 6 ms of them at the highest rate."""
MOST_TEXT_BYTES = 2**20
"""Enough for the positions of some ten thousand transducers."""
UNFINISHED = 2**64 - 1
MOST_FRAME = 2**63 - 1
CHECKSUM_BYTES = 4
_LAYOUT = struct.Struct("<8sIIQ")
HEAD_BYTES = _LAYOUT.size + CHECKSUM_BYTES


class _Head(NamedTuple):
    """The head of a file."""

    magic: bytes
    text_bytes: int
    text_checksum: int
    frames: int

    def encode(self) -> bytes:
        packed = _LAYOUT.pack(*self)
        return packed + zlib.crc32(packed).to_bytes(CHECKSUM_BYTES, "little")


def record(
    path: FilePath,
    frames: Frames,
    rate: float,
    *,
    array: TransducerArray | None = None,
    medium: Medium | None = None,
    calibration: Calibration | None = None,
    source: str = "",
) -> int:
    """Write frames to a file, completely or not at all, as they come, in constant memory.

    Parameters
    ----------
    path : str or Path
        The file, conventionally with the suffix `SUFFIX`.
    frames : (k, n) complex, PulseFrames, Recording, or iterable of frames
        What to record, see `frame_source`; it must end.
    rate : float
        Frames per second.
    array : TransducerArray, optional
        The n transducers; the default grid by default.
    medium : Medium, optional
        The air for which the frames were made; 20 °C by default.
    calibration : Calibration, optional
        Applied to frames that come as drives.
    source : str
        The origin of the frames, for people.

    Returns
    -------
    int
        The number of frames.

    Raises
    ------
    ValueError
        If the rate is not finite or less than `LEAST_RATE`, a frame is none, or there are too many transducers.
    OSError
        If the file cannot be written, or is no plain file. If the disk is full, the written frames are kept beside it,
        in a recording that the error names.
    """
    path = Path(path)
    rate = checked_rate(rate)
    if path.exists() and not path.is_file():
        raise OSError(f"{path} cannot be written: a recording must be a plain file")
    array, medium = array or TransducerArray.grid(), medium or Medium()
    pulses = frame_source(frames, calibration, len(array))
    text = json.dumps(_described(rate, array, medium, calibration, source), ensure_ascii=False).encode()
    if len(text) > MOST_TEXT_BYTES:
        raise ValueError(f"{len(array)} transducers are more than a recording can describe")
    head = _Head(MAGIC, len(text), zlib.crc32(text), UNFINISHED)
    written = 0
    with growing(path) as file:
        file.write(head.encode() + text)
        while len((taken := pulses.take(FRAMES_AT_A_TIME)).phase):
            file.write(_rows(taken, written))
            written += len(taken.phase)
        file.rewrite(head._replace(frames=written).encode())
    return written


def _described(
    rate: float, array: TransducerArray, medium: Medium, calibration: Calibration | None, source: str
) -> dict[str, Any]:
    """The text of a recording."""
    columns = None
    if calibration is not None:
        columns = {field.name: getattr(calibration, field.name).tolist() for field in fields(calibration)}
    return {
        "format": FORMAT,
        "made_by": f"phasewire {version('phasewire')}",
        "source": source,
        **CLOCK,
        "rate_hz": float(rate),
        "medium": asdict(medium),
        "positions": array.positions.tolist(),
        "normals": array.normals.tolist(),
        "calibration": columns,
    }


def _rows(frames: PulseFrames, first: int) -> bytes:
    """Frames as they stand in a file; the first of them has this number."""
    pulses = np.concatenate(frames, axis=1)
    return b"".join(row.tobytes() + _checksum(row, number) for number, row in enumerate(pulses, start=first))


def _checksum(pulses: NDArray[np.uint8], number: int) -> bytes:
    return zlib.crc32(pulses.tobytes(), number % 2**32).to_bytes(CHECKSUM_BYTES, "little")


class Recording:
    """A recording that is open for reading. Frames are read when they are requested.

    `Recording.open` opens one; use it in a ``with`` statement. `frame_source` takes it as it is.

    Attributes
    ----------
    rate : float
        Frames per second.
    complete : bool
        Whether all frames are there; false for a truncated or unfinished file.
    array : TransducerArray
        Positions and normals of the transducers, in metres.
    medium : Medium
        The air for which the frames were made.
    calibration : Calibration or None
        The one that was applied to frames that came as drives.
    source : str
        The origin of the frames, for people.
    made_by : str
        Program and version.
    """

    def __init__(self, path: FilePath, file: BinaryIO) -> None:
        self._path, self._file = path, file
        head, said = _read_head(path, file)
        for name, own in CLOCK.items():
            if said[name] != own:
                raise ValueError(f"it was made for a device of {name} {said[name]!r}; here it is {own}")
        self.rate = _one(said, "rate_hz", float)
        checked_rate(self.rate)
        self.source, self.made_by = _one(said, "source", str), _one(said, "made_by", str)
        self.array = TransducerArray(_numbers(said, "positions"), _numbers(said, "normals"))
        self.channels = len(self.array)
        self.medium = _medium(_one(said, "medium", dict))
        self.calibration: Calibration | None = None
        if said["calibration"] is not None:
            columns = _one(said, "calibration", dict)
            self.calibration = Calibration(*(_numbers(columns, field.name) for field in fields(Calibration)))
            if len(self.calibration) != self.channels:
                raise ValueError(f"calibration of {len(self.calibration)} transducers, not {self.channels}")
        self._begin = HEAD_BYTES + head.text_bytes
        self._frame_bytes = 2 * self.channels + CHECKSUM_BYTES
        self._frames, odd = divmod(os.fstat(file.fileno()).st_size - self._begin, self._frame_bytes)
        self.complete = self._frames == head.frames and not odd
        if self._frames > head.frames or (self._frames == head.frames and odd):
            raise ValueError(f"there is more in it than its {head.frames} frames")

    def __repr__(self) -> str:
        return f"Recording({self._frames} frames of {self.channels} transducers, {self.rate:g} Hz)"

    @classmethod
    def open(cls, path: FilePath) -> Self:
        """Open a recording.

        Raises
        ------
        InputFileError
            If the file begins like no recording, is damaged there, or is no plain file.
        OSError
            If it cannot be opened.
        """
        file = open_plain(path)
        try:
            return cls(path, file)
        except InputFileError:
            file.close()
            raise
        except KeyError as error:
            file.close()
            raise InputFileError(f"{path} is no usable recording: there is no {error} in it") from error
        except (ValueError, TypeError, OverflowError) as error:
            file.close()
            raise InputFileError(f"{path} is no usable recording: {error}") from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __len__(self) -> int:
        return self._frames

    @property
    def seconds(self) -> float:
        """How long it plays at its own rate."""
        return len(self) / self.rate

    def read(self, start: int, stop: int) -> PulseFrames:
        """Frames from one number to before another, limited to those that exist.

        Raises
        ------
        InputFileError
            If the file is damaged there.
        ValueError
            If it has been closed.
        """
        if self._file.closed:
            raise ValueError(f"{self._path} is closed; open it again")
        start, stop = whole("start", start, 0, MOST_FRAME), whole("stop", stop, 0, MOST_FRAME)
        wanted = range(len(self))[start:stop]
        self._file.seek(self._begin + wanted.start * self._frame_bytes)
        data = self._file.read(len(wanted) * self._frame_bytes)
        if len(data) < len(wanted) * self._frame_bytes:
            raise InputFileError(f"{self._path} has become shorter while it was read")
        rows = np.frombuffer(data, np.uint8).reshape(len(wanted), self._frame_bytes)
        for number, row in zip(wanted, rows, strict=True):
            if _checksum(row[:-CHECKSUM_BYTES], number) != row[-CHECKSUM_BYTES:].tobytes():
                raise InputFileError(f"{self._path}: frame {number} is damaged")
        found = PulseFrames(*(rows[:, at : at + self.channels].copy() for at in (0, self.channels)))
        try:
            check_pulses(found, wanted.start)
        except ValueError as error:
            raise InputFileError(f"{self._path}: {error}") from error
        return found


def _read_head(path: FilePath, file: BinaryIO) -> tuple[_Head, dict[str, Any]]:
    """The head of a file, and its text."""
    begin = file.read(HEAD_BYTES)
    if not begin.startswith(MAGIC):
        raise InputFileError(f"{path} is not a recording; `phasewire record` makes one")
    if len(begin) < HEAD_BYTES or begin != (head := _Head(*_LAYOUT.unpack_from(begin))).encode():
        raise ValueError("it is damaged or cut off in its first bytes")
    if head.text_bytes > MOST_TEXT_BYTES:
        raise ValueError(f"its text has {head.text_bytes} bytes; it may have at most {MOST_TEXT_BYTES}")
    text = file.read(head.text_bytes)
    if len(text) < head.text_bytes or zlib.crc32(text) != head.text_checksum:
        raise ValueError("its text is damaged or cut off")
    try:
        said = json.loads(text)
    except RecursionError as error:
        raise ValueError("its text is nested too deeply") from error
    if not isinstance(said, dict) or said.get("format") != FORMAT:
        raise ValueError(f"its text does not say that it is a {FORMAT}")
    return head, said


Kind = TypeVar("Kind")


def _one(said: dict[str, Any], name: str, kind: type[Kind]) -> Kind:
    """A value of some type; a whole number is a float too."""
    value = said[name]
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        raise ValueError(f"its {name} is no {kind.__name__}")
    return value


def _medium(air: dict[str, Any]) -> Medium:
    kinds = {name: type(value) for name, value in asdict(Medium()).items()}
    return Medium(**{name: _one(air, name, kind) for name, kind in kinds.items()})


def _numbers(said: dict[str, Any], name: str) -> NDArray[np.float64]:
    try:
        return np.array(_one(said, name, list), np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"its {name} are no table of numbers") from error
