"""Recordings of hands: a file of JSON Lines, one frame of hands a line; docs/how-to/hands.md describes the format.

A recording is read line by line, so that its length costs no memory, and each line has a bound. One that was cut off
can be read up to its last whole line.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from importlib.metadata import version
from io import SEEK_END
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np

from ...base.errors import InputFileError
from ...base.storage import FilePath, GrowingFile, growing, open_plain
from ...solver.contact.hand import Hand
from ..transports.transport import Timekeeper
from .frames import HandFrame, TrackedHand
from .pose import Pose
from .sources import PlayedHands, Readiness, read_options

__all__ = ["PLAYING", "RECORDING", "SUFFIX", "HandRecorder", "HandRecording", "played"]

SUFFIX = ".hands"
FORMAT = "phasewire-hands-1"
UNITS = {"m": 1.0, "mm": 1e-3}
MOST_LINE_BYTES = 2**17
"""Enough for `MOST_HANDS` with all digits of their numbers."""
MOST_END_BYTES = 64
"""Of the line that ends a recording."""
MOST_HANDS = 16
MOST_TIME = 1e9
MOST_RATE = 1e5
DECIMALS = 6
"""Of metres and seconds: a micrometre and a microsecond, which no tracker knows."""


class HandRecorder:
    """Writes frames of hands to a file, in a ``with`` statement.

    The file takes its place when the block ends, for whatever reason: a recording that Ctrl-C ends is whole. The old
    file stays if the block fails before the first frame, or if the new one cannot be written, as on a full disk; what
    was written is then kept beside it.

    Parameters
    ----------
    path : str or Path
        The file, by custom with the suffix `SUFFIX`.
    rate : float
        Frames per second that can be expected.
    source : str
        The place where the hands come from, for people.
    pose : Pose, optional
        The pose that was applied to the hands.
    """

    def __init__(self, path: FilePath, rate: float, source: str = "", pose: Pose | None = None) -> None:
        self._path = path
        self._head = {
            "format": FORMAT,
            "made_by": f"phasewire {version('phasewire')}",
            "source": source,
            "units": "m",
            "rate_hz": float(rate),
            "pose": None if pose is None else pose.to_table(),
        }
        self._stack: ExitStack
        self.file: GrowingFile
        self._origin: float | None = None
        self._time = 0.0
        self.frames = 0

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self.file = stack.enter_context(growing(self._path))
            self._put(self._head)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is not None and not self.frames:
            self._stack.__exit__(kind, error, traceback)
            return
        with self._stack:
            if self.file.trouble is None:
                self._put({"frames": self.frames})

    def write(self, frame: HandFrame) -> None:
        """Add a frame; the first one's time becomes 0.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        if self._origin is None:
            self._origin = frame.time
        self._time = max(self._time, round(frame.time - self._origin, DECIMALS))  # a tracker's clock may be set back
        record: dict[str, Any] = {
            "time": self._time,
            "number": frame.number,
            "hands": [
                {
                    "id": each.id,
                    "side": each.hand.side,
                    "landmarks": each.hand.landmarks.round(DECIMALS).tolist(),
                    "widths": each.hand.widths.round(DECIMALS).tolist(),
                }
                for each in frame.hands
            ],
        }
        if frame.notes:
            record["notes"] = list(frame.notes)
        self._put(record)
        self.frames += 1

    def _put(self, record: dict[str, Any]) -> None:
        """Write a line."""
        self.file.write(json.dumps(record, allow_nan=False, separators=(",", ":")).encode() + b"\n")


class HandRecording:
    """A recording of hands that is open for reading: an iterator of its frames. Use it in a ``with`` statement.

    Attributes
    ----------
    rate : float
        Frames per second.
    source : str
        The place where the hands came from, for people.
    pose : Pose or None
        The pose that was applied to them.
    complete : bool
        Whether the recording ends as it should; false if it was cut off.
    """

    def __init__(self, path: FilePath, file: BinaryIO) -> None:
        self._path, self._file = path, file
        self._number = 0
        self._time = -math.inf
        head = self._line()
        if head is None or head.get("format") != FORMAT:
            raise InputFileError(f"{path} is no recording of hands: its first line does not say that it is a {FORMAT}")
        with _Naming(path, 1):
            self._unit = UNITS.get(_text(head, "units", "m"), 0.0)
            if not self._unit:
                raise ValueError(f"units is {head['units']!r}; it must be one of {', '.join(UNITS)}")
            self.rate = _number(head, "rate_hz")
            if not 0 < self.rate <= MOST_RATE:
                raise ValueError(f"rate_hz is {self.rate:g}; it must be above 0 and up to {MOST_RATE:g}")
            self.source = _text(head, "source", "")
            pose = head.get("pose")
            if pose is not None and not isinstance(pose, dict):
                raise ValueError("pose is no table")
            self.pose = None if pose is None else Pose.from_table(pose)
        self._first = file.tell()
        file.seek(max(file.seek(0, SEEK_END) - MOST_END_BYTES, self._first))
        tail = file.read()
        self.complete = tail.endswith(b"\n") and tail.splitlines()[-1].replace(b" ", b"").startswith(b'{"frames":')
        self._rewind()

    @classmethod
    def open(cls, path: FilePath) -> Self:
        """Open a recording.

        Raises
        ------
        InputFileError
            If the file begins like no recording of hands, or is no plain file.
        OSError
            If it cannot be opened.
        """
        file = open_plain(path)
        try:
            return cls(path, file)
        except BaseException:
            file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _rewind(self) -> None:
        """Begin again with the first frame."""
        self._file.seek(self._first)
        self._number, self._time = 1, -math.inf

    def _line(self) -> dict[str, Any] | None:
        """The next line; None at the end, and for a last line that was cut off."""
        line = self._file.readline(MOST_LINE_BYTES + 1)
        self._number += 1
        if len(line) > MOST_LINE_BYTES:
            raise InputFileError(
                f"{self._path}, line {self._number} has more than {MOST_LINE_BYTES} bytes; no line of a recording has"
            )
        if not line.endswith(b"\n"):
            return None
        with _Naming(self._path, self._number):
            try:
                record = json.loads(line, parse_constant=_refuse)
            except RecursionError as error:
                raise ValueError("it is nested too deeply") from error
            if not isinstance(record, dict):
                raise ValueError("it is no object of JSON")
        return record

    def __iter__(self) -> Iterator[HandFrame]:
        """The frames from the first one on.

        Raises
        ------
        InputFileError
            If a line is none, or its time is before that of the line before it; it names the line.
        """
        self._rewind()
        count = 0
        while (record := self._line()) is not None:
            with _Naming(self._path, self._number):
                if "frames" in record:
                    if record["frames"] != count:
                        raise ValueError(f"there should be {_short(record['frames'])} frames; there are {count}")
                    return
                frame = self._frame(record)
            yield frame
            count += 1

    def _frame(self, record: dict[str, Any]) -> HandFrame:
        time = _number(record, "time")
        if not abs(time) <= MOST_TIME:
            raise ValueError(f"time is {time:g} s; it must be up to {MOST_TIME:g}")
        if time < self._time:
            raise ValueError(f"time is {time:.6f} s, before the {self._time:.6f} s of the frame before it")
        self._time = time
        given = record.get("hands")
        if not isinstance(given, list) or len(given) > MOST_HANDS:
            raise ValueError(f"hands must be a list of at most {MOST_HANDS} hands")
        said = record.get("notes", [])
        if not isinstance(said, list) or not all(isinstance(note, str) for note in said):
            raise ValueError("notes must be a list of texts")
        notes, hands = list(said), []
        for place, each in enumerate(given):
            if not isinstance(each, dict):
                raise ValueError(f"hand {place} is no object of JSON")
            try:
                hand, repairs = self._hand(each)
                hands.append(TrackedHand(hand, _whole(each, "id")))
            except ValueError as error:
                raise ValueError(f"hand {place}: {error}") from error
            notes += repairs
        return HandFrame(time, tuple(hands), _whole(record, "number", self._number - 2), tuple(notes))

    def _hand(self, each: dict[str, Any]) -> tuple[Hand, tuple[str, ...]]:
        side = each.get("side")
        if side != "left" and side != "right":
            raise ValueError(f'side is {side!r}; it must be "left" or "right"')
        landmarks = _table(each, "landmarks", self._unit)
        widths = _table(each, "widths", self._unit) if "widths" in each else None
        return Hand.repaired(landmarks, side, widths)


class _Naming:
    """Turns what is wrong with a line into an error that names it."""

    def __init__(self, path: FilePath, number: int) -> None:
        self._place = f"{path}, line {number}"

    def __enter__(self) -> None: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if isinstance(error, ValueError) and not isinstance(error, InputFileError):
            raise InputFileError(f"{self._place}: {error}") from error


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no finite number")


def _number(record: dict[str, Any], name: str) -> float:
    value = record.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e300:
        raise ValueError(f"{name} is {_short(value)}; it must be a finite number")
    return float(value)


def _whole(record: dict[str, Any], name: str, otherwise: int = 0) -> int:
    value = record.get(name, otherwise)
    if isinstance(value, bool) or not isinstance(value, int) or not abs(value) < 2**63:
        raise ValueError(f"{name} is {_short(value)}; it must be a whole number of 64 bits")
    return value


def _text(record: dict[str, Any], name: str, otherwise: str) -> str:
    value = record.get(name, otherwise)
    if not isinstance(value, str):
        raise ValueError(f"{name} is {_short(value)}; it must be a text")
    return value


def _table(each: dict[str, Any], name: str, unit: float) -> Any:
    try:
        values = np.array(each.get(name))
    except (ValueError, OverflowError):
        values = np.array(None)
    if values.dtype.kind not in "if":
        raise ValueError(f"its {name} are no table of numbers")
    return values * unit


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:40]}…"


class RecordingScheme:
    """Recordings of hands."""

    form = f"recording:FILE{SUFFIX}?speed=1&loop=0"
    help = "Hands from a file that `phasewire touch --record` or `phasewire tracker --record` wrote."

    def open(self, rest: str, clock: Timekeeper) -> PlayedHands:
        """Open the recording that a URL names.

        Raises
        ------
        ValueError
            If no file is named, or an option is wrong.
        InputFileError
            If the file is no recording of hands.
        OSError
            If it cannot be opened.
        """
        where, options = read_options(rest, PLAYING, self.form)
        if not where:
            raise ValueError(f"no file is named; such a URL has the form {self.form}")
        recording = HandRecording.open(Path(where))
        source = played(f"the recording {where}", recording, recording.rate, options, clock, recording.close)
        if not recording.complete:
            source.notes = (f"{where} was cut off; it plays up to its last whole line",)
        return source

    def probe(self) -> Readiness:
        """It is always there."""
        return Readiness(True, "always there")


def _speed(text: str) -> float:
    value = float(text)
    if not 0.01 <= value <= 100:
        raise ValueError("it must be from 0.01 to 100")
    return value


def _switch(text: str) -> bool:
    if text not in ("0", "1"):
        raise ValueError("it must be 0 or 1")
    return text == "1"


PLAYING: Mapping[str, Callable[[str], Any]] = {"speed": _speed, "loop": _switch}
"""The options of URLs of recordings, and what reads their values."""


def played(
    name: str,
    frames: Iterable[HandFrame],
    rate: float,
    options: Mapping[str, Any],
    clock: Timekeeper,
    close: Callable[[], None] = lambda: None,
) -> PlayedHands:
    """A source of frames that were recorded.

    Parameters
    ----------
    name : str
        The name for people.
    frames : iterable of HandFrame
        It can be read again and again.
    rate : float
        Frames per second of the recording.
    options : mapping
        As `PLAYING` reads them: ``speed``, by default 1, and ``loop``, by default False.
    clock : Timekeeper
        The clock by which frames are due.
    close : callable
        A function that is called when the source is closed.
    """
    speed = options.get("speed", 1.0)
    return PlayedHands(name, _repeated(frames, rate, speed, options.get("loop", False)), rate * speed, clock, close)


def _repeated(frames: Iterable[HandFrame], rate: float, speed: float, loop: bool) -> Iterator[HandFrame]:
    """The frames at another speed, again and again if wanted, with times and numbers that go on."""
    offset, numbers = 0.0, 0
    while True:
        first = last = None
        for frame in frames:
            first = frame.time if first is None else first
            last = replace(frame, time=offset + (frame.time - first) / speed, number=numbers + frame.number)
            yield last
        if not loop or last is None:
            return
        offset, numbers = last.time + 1 / (rate * speed), last.number + 1


RECORDING = RecordingScheme()
