"""Recordings of the Leap's frames as leapjs-playback writes them: JSON, as it is or packed by LZ-string in base64.

Such a file is an object of ``metadata`` and ``frames``. A frame is what the service sent, or since version 2 of the
format a list of values; their names then stand in the first element of ``frames``, nested as the values are.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from ...base.errors import InputFileError
from ...base.storage import FilePath, read_text
from .frames import HandFrame
from .leap_frames import hands_of, whole
from .lz_string import decompress

__all__ = ["PACKED_SUFFIX", "SUFFIX", "LeapRecording", "read_leap_recording"]

SUFFIX, PACKED_SUFFIX = ".json", ".lz"
MOST_PACKED_BYTES = 2**23
MOST_CHARACTERS = 2**25
"""About two minutes of two hands at 110 frames/s."""
MOST_LISTS = 2**21
"""Lists and objects in a file. An empty one takes two characters there, and some ninety bytes of memory."""
MOST_STAMP = 2.0**53
"""In µs."""
USUAL_RATE = 110.0
"""Frames per second of the tracker, if a recording has too few frames to tell."""


class LeapRecording(NamedTuple):
    """What is in a file.

    Parameters
    ----------
    frames : tuple of HandFrame
        The frames with times from 0 s on.
    rate : float
        Frames per second.
    """

    frames: tuple[HandFrame, ...]
    rate: float


def read_leap_recording(path: FilePath) -> LeapRecording:
    """Read a recording of the Leap's frames.

    Raises
    ------
    InputFileError
        If it is none, is damaged or cut off, or is too large.
    OSError
        If it cannot be read.
    """
    try:
        if Path(path).suffix.lower() == PACKED_SUFFIX:
            text = decompress(read_text(path, MOST_PACKED_BYTES), MOST_CHARACTERS)
        else:
            text = read_text(path, MOST_CHARACTERS)
        return _recording(_parsed(text))
    except InputFileError:
        raise
    except RecursionError as error:
        raise InputFileError(f"{path} is no usable recording of the Leap: it is nested too deeply") from error
    except ValueError as error:
        raise InputFileError(f"{path} is no usable recording of the Leap: {error}") from error


def _parsed(text: str) -> list[Any]:
    """The frames that a text holds."""
    if (lists := text.count("[") + text.count("{")) > MOST_LISTS:
        raise ValueError(f"it has {lists} lists and objects; at most {MOST_LISTS} may be")
    said = json.loads(text)
    frames = said.get("frames") if isinstance(said, dict) else None
    if not isinstance(frames, list):
        raise ValueError("there are no frames in it")
    if not frames or not isinstance(frames[0], list):
        return frames
    names, *rows = frames
    return [_unpacked(names, row) for row in rows]


def _unpacked(names: list[Any], values: Any) -> Any:
    """Values under their names: ``[["id"]]`` names those of many objects, ``{"hands": …}`` those of an inner one."""
    if not isinstance(values, list):
        raise ValueError("its packed frames are not what its first row says: a list is missing")
    if len(names) == 1 and isinstance(names[0], list):
        return [_unpacked(names[0], each) for each in values]
    if len(names) != len(values):
        raise ValueError(f"its packed frames have {len(values)} values for {len(names)} names")
    record = {}
    for name, value in zip(names, values, strict=True):
        if isinstance(name, str):
            record[name] = value
        elif isinstance(name, dict) and all(isinstance(inner, list) for inner in name.values()):
            record |= {key: value and _unpacked(inner, value) for key, inner in name.items()}
        else:
            raise ValueError("its first row does not name the values of packed frames")
    return record


def _recording(frames: list[Any]) -> LeapRecording:
    """Frames with their hands and times."""
    made: list[HandFrame] = []
    first = None
    for place, said in enumerate(frames):
        try:
            if not isinstance(said, dict):
                raise ValueError("it is no object")
            hands, notes = hands_of(said)
            stamp, number = said.get("timestamp"), whole(said.get("id"))
            if not isinstance(stamp, (int, float)) or not abs(stamp) < MOST_STAMP:
                raise ValueError(f"its timestamp is {str(stamp)[:20]}")
            first = stamp if first is None else first
        except ValueError as error:
            raise ValueError(f"frame {place}: {error}") from error
        seconds = float(stamp - first) * 1e-6
        time = max(seconds, made[-1].time if made else 0.0)  # the stamps of two recordings that were joined jump back
        made.append(HandFrame(time, hands, place if number is None else number, notes))
    if not made:
        raise ValueError("there are no frames in it")
    steps = [after.time - before.time for before, after in pairwise(made) if after.time > before.time]
    return LeapRecording(tuple(made), 1 / median(steps) if steps else USUAL_RATE)
