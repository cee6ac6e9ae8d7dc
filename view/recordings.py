"""Recordings as tapes for a view: of `stream` and `record`, and of `touch`."""

from __future__ import annotations

import json
import time
from base64 import b64decode
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import FARTHEST
from ..base.errors import InputFileError
from ..base.storage import open_plain
from ..host.hands.recording import SUFFIX as HANDS
from ..host.hands.recording import HandRecording
from ..host.streaming.recording import SUFFIX as FRAMES
from ..host.streaming.recording import Recording
from ..host.touching.log import FORMAT
from ..host.touching.log import LOG_SUFFIX as TOUCH
from ..protocol.board import CARRIER_HZ
from ..protocol.quantise import PulseFrames, check_pulses
from ..solver import TransducerArray
from ..solver.contact.hand import Hand
from .settings import Settings
from .snapshot import Emitter, Snapshot
from .view import View

__all__ = ["TAPES", "RecordedTape", "open_tape"]

TAPES = (FRAMES, TOUCH, HANDS)
"""Suffixes of recordings that can be shown."""
MOST_MOMENTS = 100_000
"""Of a recording of touch: a quarter of an hour at 110 frames a second."""
MOST_IN_TURN = 256
MOST_FIELDS = 1_000_000
"""In all; each takes 640 bytes of memory. They are six minutes of 24 fields in turn, 110 times a second."""
MOST_TIME = 1e9
MOST_AMPLITUDE = 1e3
"""Of a point, relative to the others."""
MOST_LINE_BYTES = 2**20
TICK_SECONDS = 1 / 30


class RecordedTape:
    """Snapshots of a recording, by carrier periods from its beginning.

    ``times`` are those of each moment in seconds, never decreasing, the first at 0; ``moment`` makes of the number of a
    moment what there is to see then. Its period is set here.
    """

    def __init__(self, emitter: Emitter, times: Any, moment: Callable[[int], dict[str, Any]]) -> None:
        self.emitter, self._moment = emitter, moment
        self._periods = [round(each * CARRIER_HZ) for each in times]
        self.settings = Settings(at=0)
        """The first ones: it begins at its beginning."""

    @property
    def span(self) -> tuple[int, int]:
        """Its first and its last period."""
        return 0, self._periods[-1]

    def at(self, period: int) -> Snapshot:
        """The moment of a period, or the last one before it."""
        number = max(bisect_right(self._periods, period) - 1, 0)
        return Snapshot(period=period, state="recording", source="recorded pulses", **self._moment(number))

    def run(self, view: View, over: Callable[[], bool]) -> None:
        """Let a view play it at its own pace, again and again, whenever its settings say that it runs."""
        last = time.monotonic()
        while not over():
            time.sleep(TICK_SECONDS)
            now = time.monotonic()
            passed, last = round((now - last) * CARRIER_HZ), now
            if view.settings.running:
                view.settle(partial(self._later, passed))

    def _later(self, periods: int, settings: Settings) -> Settings:
        """Settings that show a later moment; after the last one comes the first."""
        at = (settings.at or 0) + periods
        return replace(settings, at=at if at <= self._periods[-1] else 0) if settings.running else settings


@contextmanager
def open_tape(path: Path, array: TransducerArray | None = None) -> Iterator[RecordedTape]:
    """Open a recording, with one of the suffixes `TAPES`, to be shown while the block lasts.

    The hands of a ``.touch`` file are read from the ``.hands`` file beside it. A recording of touch does not name its
    array: ``array`` is it, the default grid by default. `InputFileError` if the file is damaged, or holds nothing.
    """
    suffix = path.suffix.lower()
    if suffix == FRAMES:
        with Recording.open(path) as recording:
            if not len(recording):
                raise InputFileError(f"{path} holds no frame")
            yield _of_frames(path, recording)
        return
    emitter = Emitter(array or TransducerArray.grid(), path.name)
    hands = path if suffix == HANDS else path.with_suffix(HANDS)
    played = _read_touch(path, len(emitter.array)) if suffix == TOUCH else []
    seen = _read_hands(hands) if suffix == HANDS or hands.is_file() else []
    if not seen and not played:
        raise InputFileError(f"{path} holds no hands and no pulses")
    yield _of_touch(emitter, seen, played)


def _of_frames(path: Path, recording: Recording) -> RecordedTape:
    emitter = Emitter(recording.array, path.name, calibration=recording.calibration, medium=recording.medium)

    def moment(number: int) -> dict[str, Any]:
        return {"drives": recording.read(number, number + 1).pulses(0).to_drive()[None]}

    return RecordedTape(emitter, np.arange(len(recording)) / recording.rate, moment)


def _of_touch(
    emitter: Emitter, seen: list[tuple[float, tuple[Hand, ...]]], played: list[tuple[float, _Played]]
) -> RecordedTape:
    times = sorted({each for each, _ in seen} | {each for each, _ in played})
    silent = {"drives": np.zeros((1, len(emitter.array)))}

    def moment(number: int) -> dict[str, Any]:
        hands, moment = _last(seen, times[number]), _last(played, times[number])
        return (silent if moment is None else moment.seen()) | {"hands": hands or ()}

    return RecordedTape(emitter, times, moment)


def _last(items: list[tuple[float, Any]], moment: float) -> Any:
    """The last item that is not after a moment; None if there is none."""
    number = bisect_right(items, moment, key=lambda item: item[0])
    return items[number - 1][1] if number else None


class _Played(NamedTuple):
    """What was played from one moment of a recording of touch on."""

    pulses: PulseFrames
    points: NDArray[np.float64]
    ids: NDArray[np.int64]

    def seen(self) -> dict[str, Any]:
        """As fields of a `Snapshot`."""
        drives = np.stack([self.pulses.pulses(number).to_drive() for number in range(len(self.pulses.phase))])
        return {"drives": drives, "points": self.points, "ids": self.ids}


def _read_hands(path: Path) -> list[tuple[float, tuple[Hand, ...]]]:
    found: list[tuple[float, tuple[Hand, ...]]] = []
    with HandRecording.open(path) as recording:
        for frame in recording:
            _check_length(path, len(found))
            found.append((frame.time, tuple(tracked.hand for tracked in frame.hands)))
    origin = found[0][0] if found else 0.0
    return [(moment - origin, hands) for moment, hands in found]


def _read_touch(path: Path, transducers: int) -> list[tuple[float, _Played]]:
    """What was played, line by line, up to the last whole one."""
    found: list[tuple[float, _Played]] = []
    fields = 0
    with open_plain(path) as file:
        for number in count(1):
            line = file.readline(MOST_LINE_BYTES)
            if not line.endswith(b"\n"):
                return found
            try:
                record = json.loads(line)
                if number == 1:
                    if record.get("format") != FORMAT:
                        raise ValueError(f"it does not say that it is a {FORMAT}")
                    continue
                moment, played = _played(record, transducers)
                if not (found[-1][0] if found else 0) <= moment <= MOST_TIME:
                    raise ValueError(f"its time is {moment:g} s; times must not decrease")
            except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
                raise InputFileError(f"{path}, line {number}: {error}") from error
            fields += len(played.pulses.phase)
            if fields > MOST_FIELDS:
                raise InputFileError(f"{path} holds more than {MOST_FIELDS} fields, which is too long for a page")
            _check_length(path, len(found))
            found.append((moment, played))
    return found


def _check_length(path: Path, moments: int) -> None:
    if moments >= MOST_MOMENTS:
        raise InputFileError(f"{path} holds more than {MOST_MOMENTS} moments, which is too long for a page")


def _played(record: dict[str, Any], transducers: int) -> tuple[float, _Played]:
    phase, width = (
        np.frombuffer(b64decode(record[name]), np.uint8).reshape(-1, transducers) for name in ("phase", "width")
    )
    if not 1 <= len(phase) == len(width) <= MOST_IN_TURN:
        raise ValueError(f"it has {len(phase)} phases and {len(width)} widths; both must be from 1 to {MOST_IN_TURN}")
    pulses = PulseFrames(phase, width)
    check_pulses(pulses)
    positions, amplitudes = np.array(record["positions"], float).reshape(-1, 3), np.array(record["amplitudes"], float)
    ids, points = np.array(record["ids"], np.int64), np.column_stack([positions, amplitudes])
    if not (np.abs(positions) <= FARTHEST).all() or not ((amplitudes >= 0) & (amplitudes <= MOST_AMPLITUDE)).all():
        raise ValueError(f"its points must be within {FARTHEST:g} m, and their amplitudes from 0 to {MOST_AMPLITUDE:g}")
    if ids.shape != amplitudes.shape:
        raise ValueError(f"it has {len(points)} points, but {ids.size} ids")
    return float(record["time"]), _Played(pulses, points, ids)
