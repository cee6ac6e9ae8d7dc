"""What was felt and played, in two files: hands as a recording of hands, and beside it points and pulses.

The second file has the suffix `LOG_SUFFIX`: JSON Lines, the first of which says what follows, and in which way it was
rendered (``render``); then there is one for each frame that was played:

==============  ========================================================================================
``time``        of the frame in s; the first frame of hands is at 0, as in the recording
``ids``         of the points, each stays as long as the point
``positions``   [x, y, z] of each in m, in the array's coordinates
``amplitudes``  relative to each other and to full strength, with their ramps
``phase``       base64 of rows of bytes: the pulses' phases in half ticks, of each of the fields in turn
``width``       base64 of rows of bytes: their widths in ticks
``hold``        for how many carrier periods each field is played
``envelope``    frequency in Hz of an amplitude modulation on top; 0 for none
==============  ========================================================================================

``np.frombuffer(base64.b64decode(line["phase"]), np.uint8).reshape(-1, 320)`` reads them.
"""

from __future__ import annotations

import json
from base64 import b64encode
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ...base.storage import FilePath, GrowingFile, growing
from ..hands.pose import Pose
from ..hands.recording import SUFFIX, HandRecorder
from .loop import TouchMoment

__all__ = ["LOG_SUFFIX", "TouchLog", "log_path"]

LOG_SUFFIX = ".touch"
FORMAT = "phasewire-touch-log-1"
DECIMALS = 6


def log_path(path: FilePath) -> Path:
    """The file beside a recording of hands.

    Raises
    ------
    ValueError
        If the recording has another suffix than `SUFFIX`.
    """
    path = Path(path)
    if path.suffix.lower() != SUFFIX:
        raise ValueError(f"{path}: a recording of hands has the suffix {SUFFIX}")
    return path.with_suffix(LOG_SUFFIX)


class TouchLog:
    """Writes both files, in a ``with`` statement; they take their places when it ends, for whatever reason.

    If one cannot be written, neither does, as `HandRecorder` says.

    Parameters
    ----------
    path : str or Path
        The path of the recording of hands.
    rate : float
        Frames per second that can be expected.
    render : str
        The name of the way in which way the points are rendered, for people.
    source : str
        The place where the hands come from, for people.
    pose : Pose, optional
        The pose that was applied to the hands.
    """

    def __init__(self, path: FilePath, rate: float, render: str, source: str, pose: Pose | None = None) -> None:
        self._path, self._hands = log_path(path), HandRecorder(path, rate, source, pose)
        self._head = {"format": FORMAT, "hands": Path(path).name, "source": source, "render": render}
        self._stack: ExitStack
        self._file: GrowingFile
        self._origin: float | None = None

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self._hands)
            self._file = stack.enter_context(growing(self._path))
            self._put(self._head)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        trouble = self._hands.file.trouble or self._file.trouble
        self._hands.file.trouble = self._file.trouble = trouble
        if kind is not None and not self._hands.frames:
            self._stack.__exit__(kind, error, traceback)
        else:
            self._stack.close()

    def __call__(self, moment: TouchMoment) -> None:
        """Add a moment.

        Raises
        ------
        OSError
            If a file cannot be written.
        """
        if self._origin is None:
            self._origin = moment.time
        self._hands.write(moment.frame)
        if moment.cycle is None:
            return
        fading, cycle = moment.fading, moment.cycle
        self._put(
            {
                "time": round(moment.time - self._origin, DECIMALS),
                "ids": fading.ids.tolist(),
                "positions": fading.positions.round(DECIMALS).tolist(),
                "amplitudes": (fading.amplitudes * fading.levels).round(DECIMALS).tolist(),
                "phase": _text(cycle.frames.phase),
                "width": _text(cycle.frames.width),
                "hold": cycle.hold,
                "envelope": cycle.envelope,
            }
        )

    def _put(self, record: dict[str, Any]) -> None:
        self._file.write(json.dumps(record, separators=(",", ":")).encode() + b"\n")


def _text(pulses: NDArray[np.uint8]) -> str:
    return b64encode(pulses.tobytes()).decode("ascii")
