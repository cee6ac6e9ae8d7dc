"""Commands that make a device play for a time, and record what would be played: ``stream``, ``play``, ``record``."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from itertools import count
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.control import Control
from rich.segment import ControlType

from ..console import JsonOption, among, console_for, error_console, write_json
from ..errors import InputFileError
from ..protocol.board import CARRIER_HZ
from ..protocol.plain import plain
from ..protocol.replies import Info
from ..solver import ControlPoints, Solver, TransducerArray, two_sided
from ..solver.cli import files_in, read_source, shapes_and_files
from ..solver.files import POINT_FILES, read_arrays, solution_in
from ..solver.options import METHODS
from ..storage import check_outputs
from .device import Device, open_device
from .envelopes import sine
from .frames import Frames, beginning, solved
from .options import CalibrationOption, DeviceOption, load_calibration
from .recording import SUFFIX, Recording, record
from .streaming import LOOK_AHEAD_SECONDS, StreamReport
from .transport import DEFAULT_URL

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

STANDARD_INPUT = "-"
BACK = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))
RATE = 1000.0
TACTILE_HZ = 200.0

SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="A shape such as circle:radius=0.02, a file of points, a solved file, a recording, or - for frames on "
        "standard input.",
        autocompletion=shapes_and_files((*POINT_FILES, ".npz", SUFFIX)),
    ),
]
RateOption = Annotated[float, typer.Option(min=1e-3, help="Frames per second.")]
MethodOption = Annotated[
    str,
    typer.Option(
        help=f"How points are solved: {', '.join(METHODS)} (see `phasewire solve --help`).",
        autocompletion=among(METHODS),
    ),
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
def _frames(
    source: str, what: Info | None, rate: float | None, spin: float, method: str
) -> Iterator[tuple[Frames, float]]:
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
            self._console.control(BACK)
            self._console.print(str(report)[: self._console.width - 1], end="")

    def end(self) -> None:
        """Leave the last report on a line of its own."""
        if self.last is not None:
            if self._console.is_terminal:
                self._console.control(BACK)
            self._console.print(str(self.last))


@commands.command(epilog="Example: phasewire stream circle:radius=0.02 --spin 5 --seconds 2")
def stream(
    source: SourceArgument,
    device: DeviceOption = DEFAULT_URL,
    rate: Annotated[
        float | None, typer.Option(min=1e-3, help=f"Frames per second; {RATE:g}, or a recording's own, by default.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="For how long, in s; until Ctrl-C or the end of the frames by default.")
    ] = None,
    method: MethodOption = "tikhonov",
    spin: SpinOption = 0.0,
    modulation: Annotated[
        float, typer.Option(metavar="HZ", help="Frequency at which the device modulates the frames, or 0 for none.")
    ] = TACTILE_HZ,
    look_ahead: Annotated[
        float, typer.Option(min=0, help="How long before its time a frame is sent, in s.")
    ] = LOOK_AHEAD_SECONDS,
    reconnect: Annotated[
        bool, typer.Option("--reconnect", help="Go on with the next frame when a lost device comes back.")
    ] = False,
    calibration: CalibrationOption = None,
    json_target: JsonOption = None,
) -> None:
    """Play frames one after the other at a rate, and leave the outputs off.

    Points are solved live, frame by frame; --spin moves them. Standard input has a line of JSON for each frame:
    {"positions": [[x, y, z], ...], "amplitudes": [...]}, in m, the amplitudes optional. The time of an emulated device
    passes with what is sent to it, as fast as this computer allows.
    """
    check_outputs([json_target], inputs=files_in(source))
    meter = Meter(error_console())
    with open_device(device, calibration=load_calibration(calibration)) as opened:
        with _frames(source, opened.info, rate, spin, method) as (frames, pace):
            if modulation:
                opened.modulate(*sine(modulation))
            try:
                opened.stream(
                    frames if seconds is None else beginning(frames, round(seconds * pace)),
                    pace,
                    look_ahead=look_ahead,
                    reconnect=reconnect,
                    on_progress=meter,
                )
            except KeyboardInterrupt:
                if seconds is not None:
                    raise
            finally:
                meter.end()
        status = opened.status()
        name = opened.name
    console_for(json_target).print("The outputs are off.")
    write_json(json_target, {"device": name, "stream": plain(meter.last), "status": plain(status)})


@commands.command(epilog="Example: phasewire play sphere:radius=0.04 --seconds 2")
def play(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A shape such as sphere:radius=0.04, or a file of points.",
            autocompletion=shapes_and_files(POINT_FILES),
        ),
    ],
    device: DeviceOption = DEFAULT_URL,
    seconds: Annotated[float, typer.Option(min=0, help="How long to play, in s.")] = 1.0,
    forever: Annotated[bool, typer.Option("--forever", help="Play until Ctrl-C.")] = False,
    unattended: Annotated[
        bool, typer.Option("--unattended", help="Leave the device playing when this command ends.")
    ] = False,
    modulation: Annotated[
        float, typer.Option(metavar="HZ", help="Frequency at which the halves of the points take turns.")
    ] = TACTILE_HZ,
    method: MethodOption = "wgs",
    calibration: CalibrationOption = None,
    json_target: JsonOption = None,
) -> None:
    """Play a shape by two-sided modulation, which the device does from its memory.

    The points are split in two halves that take turns, so that the array never rests (the paper's section 3.4). Two
    frames are stored; nothing more need be sent. With --unattended the device goes on by itself, also unplugged from
    this computer where it has power of its own, until `phasewire stop`.
    """
    check_outputs([json_target], inputs=files_in(source))
    if forever and unattended:
        raise ValueError("--forever waits for Ctrl-C and --unattended does not wait: give one of them")
    points = read_source(source)
    corrected = load_calibration(calibration)
    opened = open_device(device, calibration=corrected)
    with leaving_on(opened) if unattended else opened:
        array = TransducerArray.grid(opened.info.columns, opened.info.rows, opened.info.pitch)
        drives, steps = two_sided(array, points, method=method, frequency=modulation).modulation.slots()
        for slot, drive in enumerate(drives):
            opened.store(slot, drive)
        ack = opened.play(steps, unattended=unattended)
        turn = sum(periods for _, periods in steps)
        error_console().print(
            f"{opened.name} plays {source} from carrier period {ack.commit_period} on, {CARRIER_HZ / turn:g} times a "
            "second"
            + (", until `phasewire stop`" if unattended else ", until Ctrl-C" if forever else f", for {seconds:g} s")
        )
        if not unattended:
            with suppress(KeyboardInterrupt) if forever else nullcontext():
                opened.keep_playing(math.inf if forever else seconds)
        status = opened.status()
    console_for(json_target).print("It plays on." if unattended else "Stopped; the outputs are off.")
    write_json(
        json_target,
        {
            "device": opened.name,
            "commit_period": ack.commit_period,
            "steps": [list(step) for step in steps],
            "status": plain(status),
        },
    )


@commands.command(name="record", epilog="Example: phasewire record circle --spin 5 --seconds 2 -o circle.h5")
def record_command(
    source: SourceArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help=f"The {SUFFIX} file to write.")],
    seconds: Annotated[float, typer.Option(min=1e-3, help="How long the recording is to be, in s.")],
    rate: RateOption = RATE,
    method: MethodOption = "tikhonov",
    spin: SpinOption = 0.0,
    calibration: CalibrationOption = None,
    json_target: JsonOption = None,
) -> None:
    """Write the frames of a stream to a file, from which `phasewire stream` plays them later, bit for bit."""
    check_outputs([output, json_target], inputs=files_in(source))
    if output.suffix.lower() != SUFFIX:
        raise ValueError(f"{output}: a recording is an HDF5 file, with the suffix {SUFFIX}")
    corrected = load_calibration(calibration)
    with _frames(source, None, rate, spin, method) as (frames, pace):
        total = round(seconds * pace)
        written = record(output, beginning(frames, total), pace, calibration=corrected, source=source)
    console_for(json_target).print(f"{output}: {written} frames at {pace:g}/s.")
    write_json(json_target, {"output": str(output), "frames": written, "rate": pace})


@contextmanager
def leaving_on(device: Device) -> Iterator[Device]:
    """A device that is left playing where all went well."""
    try:
        yield device
    except BaseException:
        with device:
            raise
    device.close()
