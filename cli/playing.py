"""Commands that make a device play for a time, or record a stream.

``show``, ``stream``, ``play``, ``record``.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.control import Control
from rich.segment import ControlType

from ..base.errors import DeviceError
from ..base.storage import check_outputs
from ..host.streaming.calibration import Calibration
from ..host.streaming.cycles import play_cycle
from ..host.streaming.envelopes import parse_envelope, sine
from ..host.streaming.frames import (
    Frames,
    LoopedFrames,
    beginning,
    differences,
    interpolated_frames,
    limited_frames,
    to_pulses,
)
from ..host.streaming.group import AnyDevice, DeviceGroup
from ..host.streaming.limiting import TurnedDown
from ..host.streaming.recording import SUFFIX, Recording, record
from ..host.streaming.streaming import LOOK_AHEAD_SECONDS, StreamReport
from ..host.transports.opening import DEFAULT_URL, is_fresh
from ..protocol.board import CARRIER_HZ, WATCHDOG_MS
from ..protocol.plain import plain
from ..solver import ControlPoints, Cycle, Medium, Outline, Renderer, Solver, TransducerArray
from ..solver.methods.methods import METHODS
from ..solver.rendering.cycle import MOST_FRAMES
from ..solver.rendering.renderer import LEAST_FRAMES
from ..solver.rendering.ways import AUTO, described
from ..solver.shapes.point_files import POINT_FILES
from .console import JsonOption, among, console_for, error_console, given, write_json
from .listening import ListenersOption, MaxExposureOption, kept, limiter, listener_files
from .options import (
    MOST_SECONDS,
    CalibrationOption,
    DeviceOption,
    ForeverOption,
    SecondsOption,
    command_for,
    load_calibration,
    note_where_fresh,
    open_any,
    rig_file,
)
from .points import ARCHIVE, ArrayOption, files_in, load_array, read_outline, read_source, shapes_and_files
from .rendering import RENDER_HELP, SQUARE, RenderOption
from .sources import Source, check_options, frames_of, open_source
from .viewing import ViewOption, viewed_device, watching

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

BACK = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))
RATE = 1000.0
SECONDS = 1.0
"""How long endless content plays by default."""
TACTILE_HZ = 200.0
MOST_TURNS = CARRIER_HZ / 2
RENDERED = " --render "
"""Between source and way in the description of a recording that was rendered."""

SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="A shape such as circle:radius=0.02, a file of points, a file of frames (.npz as solved, or with phase "
        "and width, or drives; .frames as recorded), or - for points on standard input.",
        autocompletion=shapes_and_files((*POINT_FILES, ARCHIVE, SUFFIX)),
    ),
]
RateOption = Annotated[
    float | None,
    typer.Option(
        min=1e-3,
        max=CARRIER_HZ,
        help=f"Frames per second; {RATE:g}, or a recording's own, by default.",
    ),
]
DurationOption = Annotated[
    float | None,
    typer.Option(
        "--seconds",
        min=0,
        max=MOST_SECONDS,
        help=f"How long at most, in s; by default to the end of the frames, or {SECONDS:g} s if they have none.",
    ),
]
MethodOption = Annotated[
    str,
    typer.Option(
        help=f"The solving method for points: {', '.join(METHODS)} (see `phasewire solve --help`).",
        autocompletion=among(METHODS),
    ),
]
InterpolateOption = Annotated[
    bool,
    typer.Option(
        "--interpolate",
        help="Lead each frame over into the next, which is quieter: the device gets frames for every carrier period, "
        "each a frame's time later.",
    ),
]
SpinOption = Annotated[
    float,
    typer.Option(
        metavar="HZ",
        min=-MOST_TURNS,
        max=MOST_TURNS,
        help="Turns per second of the points about the array's upright axis.",
    ),
]


def array_of(device: AnyDevice, own: TransducerArray | None = None) -> TransducerArray:
    """The transducers of a device, or those of a file, with a warning if they differ; `ValueError` if not as many."""
    if isinstance(device, DeviceGroup):
        if own is not None:
            raise ValueError("--array has no effect on a rig: its file says where the transducers are; leave it out")
        return device.array
    what = device.info
    if own is None:
        return TransducerArray.grid(what.columns, what.rows, what.pitch)
    if len(own) != what.channels:
        raise ValueError(
            f"--array has {len(own)} transducers, but the device has {what.channels}; it must have one for each "
            "channel, in their order"
        )
    warn_of_differences("--array", own, None, device)
    return own


def check_fit(name: str, source: Source, device: AnyDevice) -> None:
    """Raise `ValueError` if frames of a source of this name are for another number of transducers than a device has."""
    there = device.channels
    if source.channels in (None, there):
        return
    if isinstance(device, DeviceGroup):
        has = f"the rig's {len(device)} devices have {there}"
    else:
        what = device.info
        has = f"the device has {there} ({what.columns} × {what.rows}, {what.pitch * 1e3:g} mm apart)"
    raise ValueError(f"{name} is for {source.channels} transducers, but {has}; solve it again for an array of {there}")


def warn_of_differences(name: str, array: TransducerArray | None, medium: Medium | None, device: AnyDevice) -> None:
    """Warn if the device differs from the one that the named source was made for."""
    if isinstance(device, DeviceGroup):
        found = differences(array, medium, device.devices[0].info, device.array)
    else:
        found = differences(array, medium, device.info)
    for difference in found:
        error_console().print(f"warning: {name} was made for something else: {difference}", style="yellow")


def check_single(url: str, **wanted: bool) -> None:
    """Raise `ValueError` if an option is wanted that only one device has, and a URL names a rig."""
    for option, is_wanted in wanted.items():
        if is_wanted and rig_file(url) is not None:
            raise ValueError(f"--{option} is for one device, not for a rig; leave it out")


def frames_in(source: Source, seconds: float | None, rate: float) -> int | None:
    """How many frames of a source make so many seconds, None for all."""
    if seconds is None:
        return None if source.ends else round(SECONDS * rate)
    return round(seconds * rate)


class Meter:
    """One line that shows the state of a stream, on a terminal; elsewhere only the last."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self.last: StreamReport | None = None
        self.watch: Callable[[StreamReport], None] | None = None
        """Is told of each report too."""

    def __call__(self, report: StreamReport) -> None:
        """Replace the report on the line."""
        self.last = report
        if self.watch is not None:
            self.watch(report)
        if self._console.is_terminal:
            self._console.control(BACK)
            self._console.print(str(report)[: self._console.width - 1], end="")

    def end(self) -> None:
        """Leave the last report on a line of its own."""
        if self.last is not None:
            if self._console.is_terminal:
                self._console.control(BACK)
            self._console.print(str(self.last))


@commands.command(epilog="Example: phasewire show circle:radius=0.02 --seconds 2")
def show(
    context: typer.Context,
    source: SourceArgument,
    device: DeviceOption = DEFAULT_URL,
    seconds: SecondsOption = SECONDS,
    forever: ForeverOption = False,
    method: MethodOption = "wgs",
    array: ArrayOption = None,
    calibration: CalibrationOption = None,
    json_target: JsonOption = None,
) -> None:
    """Play one frame on a device, and leave its outputs off.

    A shape or points are solved first. The frame is not modulated, so skin hardly feels it: `phasewire stream SOURCE`
    plays it modulated at 200 Hz. While it plays, the device gets regular signs of life; if this program dies, the
    device's watchdog turns the outputs off. The time of an emulated device passes as fast as this computer allows.
    """
    check_outputs([json_target], inputs=[*files_in(source), *filter(None, [array])])
    own = load_array(array)
    with open_source(source) as what:
        check_options(context, source, what)
        if isinstance(what.content, Iterator):
            what = Source(read_source(source))  # its first line
        elif what.still is None and not isinstance(what.content, ControlPoints):
            raise ValueError(f"{source} holds many frames; `phasewire stream {shlex.quote(source)}` plays them")
    with open_any(device, calibration) as opened:
        check_fit(source, what, opened)
        warn_of_differences(source, what.array, what.medium, opened)
        if isinstance(what.content, ControlPoints):
            what = Source(Solver(array_of(opened, own), method).solve(what.content))
        assert what.still is not None
        still = to_pulses(what.still, opened.calibration, opened.channels)  # pulses are not compared
        ack = opened.show(still)
        message = f"{opened.name} plays {source} from carrier period {ack.commit_period}"
        error_console().print(message + (", until Ctrl-C" if forever else f", for {seconds:g} s"))
        with suppress(KeyboardInterrupt) if forever else nullcontext():
            opened.keep_playing(math.inf if forever else seconds)
        status = opened.status()
    console_for(json_target).print("Stopped; the outputs are off.")
    write_json(
        json_target,
        {
            "format": "phasewire-show-1",
            "device": opened.name,
            "commit_period": ack.commit_period,
            "status": plain(status),
        },
    )


@commands.command(
    epilog="Example: phasewire stream circle:radius=0.02 --spin 5 --seconds 2",
    help=f"""Play frames one after the other at a rate, and leave the outputs off.

Points are solved live, frame by frame; --spin moves them, and --render modulates them in another way. Standard input
has a line of JSON for each frame: {{"positions": [[x, y, z], ...], "amplitudes": [...]}}, in m, the amplitudes
optional. Its lines must come at the rate: each late one is an underrun, and without a line for the watchdog's time,
{WATCHDOG_MS / 1000:g} s at power-up, the device turns its outputs off and the command ends with code 4. The time of an
emulated device passes with the data that are sent to it, as fast as this computer allows.
{RENDER_HELP}""",
)
def stream(
    context: typer.Context,
    source: SourceArgument,
    device: DeviceOption = DEFAULT_URL,
    rate: RateOption = None,
    seconds: DurationOption = None,
    forever: ForeverOption = False,
    method: MethodOption = "tikhonov",
    spin: SpinOption = 0.0,
    modulation: Annotated[
        str,
        typer.Option(
            metavar="HZ",
            help="Frequency at which the device modulates the frames, 0 for none; several, as in 150+250; or a mono "
            "WAV file. Append :depth=0.5,phase=90,force=yes to change the sine: with force, radiation pressure follows "
            "it.",
        ),
    ] = f"{TACTILE_HZ:g}",
    render: RenderOption = None,
    interpolate: InterpolateOption = False,
    max_exposure: MaxExposureOption = None,
    listeners: ListenersOption = None,
    look_ahead: Annotated[
        float, typer.Option(min=0, help="How long before its time a frame is sent, in s.")
    ] = LOOK_AHEAD_SECONDS,
    reconnect: Annotated[
        bool, typer.Option("--reconnect", help="Go on with the next frame when a lost device comes back.")
    ] = False,
    array: ArrayOption = None,
    calibration: CalibrationOption = None,
    view: ViewOption = False,
    json_target: JsonOption = None,
) -> None:
    """Play frames at a rate; the help above has the details."""
    check_outputs([json_target], inputs=[*files_in(source), *listener_files(listeners)])
    check_single(device, view=view, reconnect=reconnect)
    own = load_array(array)
    envelope = parse_envelope(modulation) if render is None else None
    meter = Meter(error_console())
    with open_source(source) as what:
        check_options(context, source, what)
        if render is not None:
            check_render(context, "modulation", "spin", "interpolate")
        if envelope is not None and not given(context, "modulation") and is_rendered(what):
            envelope = None
            error_console().print(f"{source} was rendered and is modulated already; the device leaves it as it is")
        with ExitStack() as stack:
            url, emulator = stack.enter_context(viewed_device(device, wanted=view))
            opened = open_any(url, calibration)
            stack.enter_context(opened)
            check_fit(source, what, opened)
            warn_of_differences(source, what.array, what.medium, opened)
            transducers = array_of(opened, own)
            down = TurnedDown(limiter(transducers, max_exposure, listeners))
            if interpolate and opened.most_updates_per_second < CARRIER_HZ:
                raise ValueError(
                    f"--interpolate needs {CARRIER_HZ} frames/s, but this line carries "
                    f"{opened.most_updates_per_second:.0f}; leave it out"
                )
            if render is None:
                frames, pace = solved_frames(
                    what, transducers, opened.calibration, down, method, spin, rate, interpolate=interpolate
                )
            else:
                cycle = rendered(transducers, render, method, read_outline(source))
                pace = rate or min(CARRIER_HZ / cycle.hold, opened.most_updates_per_second)
                check_pace(pace, cycle)
                frames = LoopedFrames(cycle, pace, opened.calibration, down=down)
                envelope = sine(cycle.envelope) if cycle.envelope else None
            most = None if forever else frames_in(what, seconds, pace)
            if most is not None:
                frames = beginning(frames, most)
            watch = stack.enter_context(watching(opened, transducers, emulator, wanted=view))
            if watch is not None:
                frames = watch.frames(frames, pace)
                meter.watch = watch.progress
            told = {"format": "phasewire-stream-1", "device": opened.name, "status": None, "error": None}
            try:
                play = opened.stream if isinstance(opened, DeviceGroup) else partial(opened.stream, reconnect=reconnect)
                play(frames, pace, look_ahead=look_ahead, envelope=envelope, on_progress=meter)
            except KeyboardInterrupt:
                if not forever:
                    raise
            except (DeviceError, ValueError) as error:
                write_json(json_target, told | {"stream": plain(meter.last), "error": str(error)})
                raise
            finally:
                meter.end()
            status = opened.status()
    if max_exposure is not None:
        console_for(json_target).print(kept(max_exposure, down.gain))
    console_for(json_target).print("The outputs are off.")
    write_json(json_target, told | {"exposure_gain": down.gain, "stream": plain(meter.last), "status": plain(status)})


@commands.command(
    epilog="Example: phasewire play circle:radius=0.03 --render stm --seconds 2",
    help=f"""Play a shape modulated, which the device does from its memory.

Without --render the points are split in two halves that alternate, so that the array never rests (the paper's section
3.4). The frames of one cycle are stored; no more data are needed. With --unattended the device goes on by itself until
`phasewire stop`, even unplugged from this computer if it has power of its own.
{RENDER_HELP}""",
)
def play(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A shape such as sphere:radius=0.04, a file of points, or - for points on standard input.",
            autocompletion=shapes_and_files(POINT_FILES),
        ),
    ],
    device: DeviceOption = DEFAULT_URL,
    seconds: SecondsOption = SECONDS,
    forever: ForeverOption = False,
    unattended: Annotated[
        bool, typer.Option("--unattended", help="Leave the device playing when this command ends.")
    ] = False,
    modulation: Annotated[
        float, typer.Option(metavar="HZ", help="Frequency at which the halves of the points alternate.")
    ] = TACTILE_HZ,
    render: RenderOption = None,
    max_exposure: MaxExposureOption = None,
    listeners: ListenersOption = None,
    method: MethodOption = "wgs",
    array: ArrayOption = None,
    calibration: CalibrationOption = None,
    view: ViewOption = False,
    json_target: JsonOption = None,
) -> None:
    """Play a shape modulated; the help above has the details."""
    check_outputs([json_target], inputs=[*files_in(source), *listener_files(listeners)])
    if unattended and (given(context, "forever") or given(context, "seconds")):
        raise ValueError("--unattended does not wait: --forever and --seconds have no effect with it; leave them out")
    if render is not None:
        check_render(context, "modulation")
    check_single(device, view=view)
    outline, own = read_outline(source), load_array(array)
    if unattended and view:
        raise ValueError("--unattended does not wait for a page: leave out --view")
    if unattended:
        note_where_fresh(device)
    with ExitStack() as stack:
        url, emulator = stack.enter_context(viewed_device(device, wanted=view))
        opened = open_any(url, calibration)
        stack.enter_context(leaving_on(opened) if unattended else opened)
        transducers = array_of(opened, own)
        way = f"{SQUARE},frequency={modulation}" if render is None else render
        cycle = rendered(transducers, way, method, outline, opened.slots)
        watch = stack.enter_context(watching(opened, transducers, emulator, wanted=view))
        limit = limiter(transducers, max_exposure, listeners)
        ack, steps, gain = play_cycle(opened, cycle, unattended=unattended, limit=limit)
        turn = sum(periods for _, periods in steps)
        stop = command_for("stop", device)
        until = f"until {stop}" if unattended else "until Ctrl-C" if forever else f"for {seconds:g} s"
        error_console().print(
            f"{opened.name} plays {source} from carrier period {ack.commit_period} on, {CARRIER_HZ / turn:g} times a "
            f"second, {until}"
        )
        if not unattended:
            most = math.inf if forever else seconds
            with suppress(KeyboardInterrupt) if forever else nullcontext():
                if watch is None:
                    opened.keep_playing(most)
                else:
                    watch.play(outline.points, steps, most, ack.commit_period)
        status = opened.status()
    if not unattended:
        said = "Stopped; the outputs are off."
    elif is_fresh(device):
        said = "It would play on, but it ends with this command."
    else:
        said = f"It plays on until {stop}."
    if max_exposure is not None:
        console_for(json_target).print(kept(max_exposure, gain))
    console_for(json_target).print(said)
    write_json(
        json_target,
        {
            "format": "phasewire-play-1",
            "device": opened.name,
            "commit_period": ack.commit_period,
            "exposure_gain": gain,
            "steps": [list(step) for step in steps],
            "status": plain(status),
        },
    )


@commands.command(
    name="record",
    epilog="Example: phasewire record circle --spin 5 --seconds 2 -o circle.frames",
    help=f"""Write the frames of a stream to a file, from which `phasewire stream` plays them later, bit for bit.

Points are solved for --array, by default 20 × 16 transducers, 10.3 mm apart, and air of 20 °C. Solved or recorded
frames keep their array and their air, and a recording its rate and its calibration. Frames of --render are modulated
already: stream them with --modulation 0.
{RENDER_HELP}""",
)
def record_command(
    context: typer.Context,
    source: SourceArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help=f"The {SUFFIX} file to write.")],
    seconds: DurationOption = None,
    rate: RateOption = None,
    method: MethodOption = "tikhonov",
    spin: SpinOption = 0.0,
    render: RenderOption = None,
    interpolate: InterpolateOption = False,
    max_exposure: MaxExposureOption = None,
    listeners: ListenersOption = None,
    array: ArrayOption = None,
    calibration: CalibrationOption = None,
    json_target: JsonOption = None,
) -> None:
    """Write the frames of a stream to a file; the help above has the details."""
    check_outputs([output, json_target], inputs=[*files_in(source), *listener_files(listeners)])
    if output.suffix.lower() != SUFFIX:
        raise ValueError(f"{output}: a recording has the suffix {SUFFIX}")
    own = load_array(array)
    with open_source(source) as what:
        check_options(context, source, what)
        used = what.array or own or TransducerArray.grid()
        corrected = load_calibration(calibration) if what.holds_drives else what.calibration
        down = TurnedDown(limiter(used, max_exposure, listeners))
        if render is None:
            frames, pace = solved_frames(what, used, corrected, down, method, spin, rate, interpolate=interpolate)
        else:
            check_render(context, "spin", "interpolate")
            cycle = rendered(used, render, method, read_outline(source))
            check_pace(rate or CARRIER_HZ, cycle)
            if cycle.envelope:
                raise ValueError(
                    f"--render {render} leaves its modulation to the device, and a recording holds frames alone; leave "
                    "modulation out, and give --modulation to `phasewire stream`"
                )
            pace = rate or CARRIER_HZ / cycle.hold
            frames = LoopedFrames(cycle, pace, corrected, down=down)
        most = frames_in(what, seconds, pace)
        written = record(
            output,
            frames if most is None else beginning(frames, most),
            pace,
            array=used,
            medium=what.medium,
            calibration=corrected,
            source=source if render is None else f"{source}{RENDERED}{render}",
        )
    console_for(json_target).print(f"{output}: {written} frames at {pace:g}/s.")
    if max_exposure is not None:
        console_for(json_target).print(kept(max_exposure, down.gain))
    told = {"format": "phasewire-record-1", "output": str(output), "frames": written, "rate": pace}
    write_json(json_target, told | {"exposure_gain": down.gain})


def solved_frames(
    what: Source,
    array: TransducerArray,
    calibration: Calibration | None,
    down: TurnedDown,
    method: str,
    spin: float,
    rate: float | None,
    *,
    interpolate: bool,
) -> tuple[Frames, float]:
    """The frames of a source and their rate; if asked, led over into each other or turned down."""
    pace = rate or what.rate or RATE
    frames = frames_of(what, array, method, spin, pace)
    if interpolate:
        return interpolated_frames(frames, pace, calibration, down), float(CARRIER_HZ)
    return limited_frames(frames, calibration, down) if down.limits else frames, pace


def rendered(array: TransducerArray, way: str, method: str, outline: Outline, most_frames: int = MOST_FRAMES) -> Cycle:
    """The cycle of an outline; if the way is chosen, people are told which it is."""
    renderer = Renderer(array, way, method, most_frames=most_frames)
    if way == AUTO:
        error_console().print(f"{AUTO} is {described(renderer.way_for(outline))}")
    return renderer.render(outline)


def check_pace(rate: float, cycle: Cycle) -> None:
    """Raise `ValueError` if so many frames per second do not show a cycle."""
    if len(cycle) > 2 and rate < LEAST_FRAMES * cycle.frequency:
        raise ValueError(
            f"{rate:g} frames/s are too few for a cycle that is repeated {cycle.frequency:g} times a second; it needs "
            f"{LEAST_FRAMES * cycle.frequency:g}. `phasewire play` lets the device repeat it"
        )


def is_rendered(what: Source) -> bool:
    """Whether a recording was made by a way of rendering."""
    return isinstance(what.content, Recording) and RENDERED in what.content.source


def check_render(context: typer.Context, *options: str) -> None:
    """Raise `ValueError` if one of some options of a command line has no effect with ``--render``."""
    for option in options:
        if given(context, option):
            raise ValueError(
                f"--{option} has no effect with --render; give it as a parameter, or leave one of them out"
            )


@contextmanager
def leaving_on(device: AnyDevice) -> Iterator[AnyDevice]:
    """A device that keeps playing after success."""
    try:
        yield device
    except BaseException:
        with device:
            raise
    device.close()
