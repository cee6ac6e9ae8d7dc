"""Commands that make a device play for a time, and record what would be played: ``stream``, ``play``, ``record``."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from ..console import JsonOption, console_for, error_console, write_json
from ..errors import InputFileError
from ..protocol.plain import plain
from ..protocol.replies import Info
from ..solver import ControlPoints, Solver, TransducerArray, two_sided
from ..solver.cli import files_in, read_source
from ..solver.files import read_arrays, solution_in
from ..solver.options import METHODS
from ..storage import check_outputs
from .calibration import Calibration
from .device import Device, open_device
from .envelopes import sine
from .frames import Frames, solved
from .options import CalibrationOption, DeviceOption, load_calibration
from .recording import SUFFIX, Recording, record
from .streaming import LOOK_AHEAD_SECONDS, StreamReport
from .transport import DEFAULT_URL

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

STANDARD_INPUT = "-"
RATE = 1000.0
TACTILE_HZ = 200.0

SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="A shape such as circle:radius=0.02, a file of points, a solved file, a recording, or - for frames on "
        "standard input.",
    ),
]
RateOption = Annotated[float, typer.Option(min=1e-3, help="Frames per second.")]
MethodOption = Annotated[
    str, typer.Option(help=f"How points are solved: {', '.join(METHODS)} (see `phasewire solve --help`).")
]
SpinOption = Annotated[
    float, typer.Option(metavar="HZ", help="Turns per second of the points about the array's upright axis.")
]
SecondsOption = Annotated[float | None, typer.Option(min=0, help="For how long, in s; a recording to its end.")]


def turning(points: ControlPoints, turns_per_second: float, rate: float) -> Iterator[ControlPoints]:
    """Control points turned about the upright axis through the middle of the array, frame by frame, for ever."""
    x, y, z = points.positions.T
    for frame in count():
        angle = 2 * math.pi * turns_per_second * frame / rate
        turned = np.stack([x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z], 1)
        yield ControlPoints(turned, points.amplitudes)


def spoken(lines: Iterable[str]) -> Iterator[ControlPoints]:
    """Control points from lines of JSON, ``{"positions": [[x, y, z], …], "amplitudes": […]}``, one frame each.

    Raises
    ------
    InputFileError
        Where a line is something else; it is named.
    """
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            read = json.loads(line)
            if not isinstance(read, dict) or not {"positions"} <= set(read) <= {"positions", "amplitudes"}:
                raise ValueError('it must be {"positions": [[x, y, z], ...], "amplitudes": [...]}')
            yield ControlPoints(read["positions"], read.get("amplitudes"))
        except (ValueError, TypeError, RecursionError) as error:
            raise InputFileError(f"standard input, line {number}: {error}") from error


@contextmanager
def _frames(source: str, what: Info | None, rate: float | None, spin: float, method: str) -> Iterator[tuple[Frames, float]]:
    """The frames of a source, and how many there are in a second."""
    path = Path(source)
    if path.suffix.lower() == SUFFIX:
        if spin:
            raise ValueError(f"{source} holds pulses, which cannot be turned; --spin is for points")
        with Recording.open(path) as recording:
            yield recording, recording.rate if rate is None else rate
        return
    rate = RATE if rate is None else rate
    array = TransducerArray.grid() if what is None else TransducerArray.grid(what.columns, what.rows, what.pitch)
    if source == STANDARD_INPUT:
        yield solved(spoken(sys.stdin), Solver(array, method)), rate
    elif path.suffix.lower() == ".npz":
        solution = solution_in(read_arrays(path), path)
        yield (solution for _ in count()), rate
    else:
        yield solved(turning(read_source(source), spin, rate), Solver(array, method)), rate


class Meter:
    """One line that shows how a stream is doing, on a terminal; nothing elsewhere but its end."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self.last: StreamReport | None = None

    def __call__(self, report: StreamReport) -> None:
        """Show a report in the place of the one before."""
        self.last = report
        if self._console.is_terminal:
            self._console.print(f"\r\x1b[K{report}", end="")

    def end(self) -> None:
        """Leave the last report on a line of its own."""
        if self.last is not None:
            self._console.print(f"\r\x1b[K{self.last}" if self._console.is_terminal else str(self.last))
