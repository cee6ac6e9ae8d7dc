"""What a command plays: points, or a file of frames, with the conditions for which it was made.

====================  =====================================================================================
a shape, or points    solved live, frame by frame; they may turn
``-``                 points on standard input, a line of JSON for each frame
``.npz``              as solved; or the arrays ``phase`` and ``width``, (n,) or (k, n); or ``drives``, (k, n)
``.frames``           a recording
====================  =====================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count, repeat
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from ..base.errors import InputFileError
from ..host.streaming.calibration import Calibration
from ..host.streaming.frames import NUMBERS, Frames, solved
from ..host.streaming.recording import SUFFIX, Recording
from ..protocol.pulses import Pulses
from ..protocol.quantise import PulseFrames, check_pulses
from ..solver import ControlPoints, Medium, Solution, Solver, TransducerArray
from ..solver.fields.files import read_arrays, solution_in
from .console import error_console, given
from .points import SourceKind, kind_of, read_source, spoken, typed

__all__ = [
    "Source",
    "check_options",
    "frames_of",
    "open_file",
    "open_source",
]

HEEDED: dict[str, tuple[tuple[type, ...], str]] = {
    "spin": ((ControlPoints,), "only a shape or a file of points can turn"),
    "render": ((ControlPoints,), "only a shape or a file of points is rendered"),
    "max_exposure": ((ControlPoints, Iterator, Solution, np.ndarray), "it holds pulses, which are played unchanged"),
    "interpolate": ((ControlPoints, Iterator, np.ndarray), "it holds no drives that follow each other"),
    "method": ((ControlPoints, Iterator), "only points are solved for"),
    "array": ((ControlPoints, Iterator), "its frames are solved already"),
    "calibration": ((ControlPoints, Iterator, Solution, np.ndarray), "it holds pulses, which are played unchanged"),
}
"""Options that only some kinds of content use, and why others do not."""


class Source(NamedTuple):
    """Content to play, and the conditions for which it was made, as far as they are known."""

    content: ControlPoints | Iterator[ControlPoints] | Pulses | Solution | PulseFrames | NDArray[Any] | Recording
    """Points, or points frame by frame; one frame; or many: pulses, drives (k, n), a recording."""
    rate: float | None = None
    """Frames per second."""
    array: TransducerArray | None = None
    medium: Medium | None = None
    calibration: Calibration | None = None
    """The calibration that was already applied."""

    @property
    def still(self) -> Pulses | Solution | None:
        """The only frame, if there is only one."""
        return self.content if isinstance(self.content, Pulses | Solution) else None

    @property
    def channels(self) -> int | None:
        """The number of transducers that its frames are for; None if points are solved for any array."""
        match self.content:
            case Pulses() as frame:
                return len(frame)
            case Solution() as solution:
                return len(solution.drive)
            case PulseFrames() as frames:
                return int(frames.phase.shape[1])
            case np.ndarray() as drives:
                return int(drives.shape[1])
            case Recording() as recording:
                return recording.channels
        return None

    @property
    def holds_drives(self) -> bool:
        """Whether the frames are drives, which a calibration corrects, and not pulses."""
        return not isinstance(self.content, Pulses | PulseFrames | Recording)

    @property
    def ends(self) -> bool:
        """Whether it ends by itself."""
        return not isinstance(self.content, ControlPoints | Pulses | Solution)


@contextmanager
def open_source(source: str) -> Iterator[Source]:
    """The content of a SOURCE, as `kind_of` has it; errors as `open_file`."""
    match kind_of(source):
        case SourceKind.STANDARD_INPUT:
            yield Source(spoken(typed()))
        case SourceKind.ARCHIVE | SourceKind.RECORDING:
            with open_file(Path(source)) as what:
                yield what
        case _:
            yield Source(read_source(source))


@contextmanager
def open_file(path: Path) -> Iterator[Source]:
    """The content of a file of frames.

    Raises
    ------
    InputFileError
        If it is truncated, corrupted, or holds none.
    OSError
        If it cannot be opened.
    """
    if path.suffix.lower() == SUFFIX:
        with Recording.open(path) as recording:
            if not recording.complete:
                error_console().print(
                    f"warning: {path} was cut off; it is used up to its last whole frame, {len(recording)} in all",
                    style="yellow",
                )
            yield Source(recording, recording.rate, recording.array, recording.medium, recording.calibration)
    else:
        yield _in_archive(read_arrays(path), path)


def _in_archive(arrays: dict[str, NDArray[Any]], path: Path) -> Source:
    if "format" in arrays:
        solution = solution_in(arrays, path)
        return Source(solution, array=solution.array, medium=solution.medium)
    try:
        if {"phase", "width"} <= set(arrays):
            return Source(_pulses(arrays["phase"], arrays["width"]))
        if "drives" in arrays:
            return Source(_drives(arrays["drives"]))
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error
    raise InputFileError(
        f"{path} holds neither a solution nor pulses (phase and width) nor drives; `phasewire solve` makes a solution"
    )


def _pulses(phase: NDArray[Any], width: NDArray[Any]) -> Pulses | PulseFrames:
    """One frame or many, according to the shape of the arrays."""
    if phase.ndim == 1:
        return Pulses(phase, width)
    tables = PulseFrames(phase, width)
    for name, values in tables._asdict().items():
        if values.ndim != 2 or values.shape != phase.shape:
            raise ValueError(f"phase and width must both be (n,) or (k, n), not {phase.shape} and {width.shape}")
        if values.dtype.kind not in "iu" or values.min(initial=0) < 0:
            raise ValueError(f"{name} must be whole numbers from 0 on")
    check_pulses(tables)
    return PulseFrames(*(values.astype(np.uint8) for values in tables))


def _drives(drives: NDArray[Any]) -> NDArray[Any]:
    if drives.ndim != 2 or drives.dtype.kind not in NUMBERS:
        raise ValueError(f"drives must be complex numbers (k, n), not {drives.dtype} {drives.shape}")
    return drives


def turning(points: ControlPoints, turns_per_second: float, rate: float) -> Iterator[ControlPoints]:
    """Control points turned about the upright axis through the middle of the array, frame by frame, for ever."""
    x, y, z = points.positions.T
    for frame in count():
        angle = 2 * math.pi * turns_per_second * frame / rate
        turned = np.stack([x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z], 1)
        yield ControlPoints(turned, points.amplitudes)


def frames_of(source: Source, array: TransducerArray, method: str, spin: float, rate: float) -> Frames:
    """The frames of a source in turn; points are solved for an array by a method, and turn at so many Hz."""
    match source.content:
        case ControlPoints() as points:
            return solved(turning(points, spin, rate), Solver(array, method))
        case Pulses() | Solution() as frame:
            return repeat(frame)
        case PulseFrames() | np.ndarray() | Recording() as frames:
            return frames
        case points_in_turn:
            return solved(points_in_turn, Solver(array, method))


def check_options(context: typer.Context, name: str, source: Source) -> None:
    """Raise `ValueError` if an option of the command line has no effect on the content of a source of this name."""
    for option, (kinds, why) in HEEDED.items():
        if given(context, option) and not isinstance(source.content, kinds):
            raise ValueError(f"--{option.replace('_', '-')} has no effect on {name}: {why}")
