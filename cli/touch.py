"""The command that lets hands touch objects: ``touch``."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.control import Control
from rich.segment import ControlType

from ..base.errors import DeviceError, DeviceRefusedError, PhasewireError, TrackerLostError
from ..base.pictures import check_picture_path, save_figure
from ..base.signals import loading
from ..base.storage import check_outputs
from ..host.hands.placing import PlacedHands
from ..host.hands.pose import Pose
from ..host.hands.returning import open_returning
from ..host.hands.sources import HandSource, files_of, open_hands
from ..host.streaming.device import Device, open_device
from ..host.touching.log import TouchLog, log_path
from ..host.touching.loop import MOST_RAMP_SECONDS, RAMP_SECONDS, TouchLoop, TouchMoment
from ..host.touching.report import TouchReport
from ..host.transports.opening import DEFAULT_URL
from ..host.transports.transport import Timekeeper
from ..protocol.plain import plain
from ..protocol.replies import Status
from ..solver import METHODS, TransducerArray
from ..solver.contact.mesh import Mesh
from ..solver.contact.solids import SOLIDS
from ..solver.contact.touch import LEAST_SPACING, MOST_POINTS, Toucher
from ..solver.methods.modulation import FREQUENCY
from ..solver.objects.parsing import MovingObject, object_help, object_name, parse_object
from ..solver.shapes.curves import SPACING
from ..solver.shapes.points import MAX_POINTS
from .console import JsonOption, among, console_for, error_console, write_json
from .listening import ListenersOption, MaxExposureOption, kept, limiter, listener_files
from .options import (
    MOST_SECONDS,
    CalibrationOption,
    DeviceOption,
    PoseOption,
    load_calibration,
)
from .playing import array_of, check_render
from .points import ArrayOption, load_array
from .rendering import RENDER_HELP, SQUARE, RenderOption
from .viewing import ViewOption, viewed_device, watching

__all__ = ["commands", "read_objects", "warn_of_notes"]

commands = typer.Typer(rich_markup_mode=None)

BACK = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))
HANDS = "gesture:sweep"


class _Meter:
    """One line that shows the progress, on a terminal; elsewhere none."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self.last = TouchReport()

    def __call__(self, report: TouchReport) -> None:
        """Replace the report on the line."""
        self.last = report
        if self._console.is_terminal:
            self._console.control(BACK)
            self._console.print(str(report)[: self._console.width - 1], end="")

    def end(self) -> None:
        """Clear the line."""
        if self._console.is_terminal:
            self._console.control(BACK)


class _Best:
    """Keeps the moment with the most points, faded in, for the picture."""

    def __init__(self) -> None:
        self.moment: TouchMoment | None = None
        self._points = -MAX_POINTS - 1

    def __call__(self, moment: TouchMoment) -> None:
        """Consider the next moment; a point that is not faded in counts against it, as the field lacks it."""
        if moment.cycle is None or moment.touch.points is None:
            return
        faded_in = moment.fading.levels == 1
        points = int(np.where(faded_in, 1, -1).sum())
        if points > self._points:
            self.moment, self._points = moment, points


class _Reach:
    """Keeps where hands and objects were until they touch, to explain why none did."""

    def __init__(self) -> None:
        self._touched = False
        self._hands: list[NDArray[np.float64]] = []
        self._objects: list[NDArray[np.float64]] = []
        self._meshes: tuple[Mesh, ...] = ()

    def __call__(self, moment: TouchMoment) -> None:
        """Consider the next moment."""
        self._touched |= moment.touch.points is not None
        if self._touched:  # no explanation is needed, and the next frame waits for this call
            return
        for which, hand in enumerate(moment.hands):
            _widen(self._hands, which, hand.landmarks)
        for which, mesh in enumerate(moment.objects):
            if which >= len(self._meshes) or mesh is not self._meshes[which]:  # it has moved
                _widen(self._objects, which, mesh.vertices)
        self._meshes = tuple(moment.objects)

    def explained(self, names: Sequence[str]) -> str:
        """Where objects and hands were, in m."""
        if not self._hands:
            return "no hand was seen"
        low, high = np.min(self._hands, axis=0)[0], np.max(self._hands, axis=0)[1]
        objects = [f"{name} {_box(*box)}" for name, box in zip(names, self._objects, strict=False)]
        return f"no hand touched an object: hands were {_box(low, high)}; {'; '.join(objects)}"


def _widen(boxes: list[NDArray[np.float64]], which: int, points: NDArray[np.float64]) -> None:
    """Let one of some boxes, (2, 3), contain points too; it is the next new one, or is there."""
    box = np.array([points.min(axis=0), points.max(axis=0)])
    if which == len(boxes):
        boxes.append(box)
    boxes[which] = np.array([np.minimum(boxes[which][0], box[0]), np.maximum(boxes[which][1], box[1])])


def _box(low: NDArray[np.float64], high: NDArray[np.float64]) -> str:
    axes = (f"{axis} {a:.3f} to {b:.3f}" for axis, a, b in zip("xyz", low, high, strict=True))
    return f"within {', '.join(axes)} m"


@commands.command(
    epilog="Example: phasewire touch cube --hand gesture:sweep --seconds 4",
    help=f"""Let hands touch objects: what they feel is played on a device, live, and its outputs are off at the end.

Hands are cut with the objects, control points are placed on the cuts, split in two halves, solved, and sent as
soon as they are there. The halves take turns 200 times a second. Without a hand that touches, and without news of
the hands, the outputs are silent within 50 ms. A line that is too slow for a block in each turn, such as most
UARTs, leaves the turns to the device, and limits how often a new pose is played.

With --render the points, or the cuts themselves, are rendered in another way. The device repeats the fields of each
pose from its memory, at most 24, fewer on a slow line; a new pose takes longer to arrive.

An object is a name or a file with what differs from its defaults, such as sphere:size=0.06,turn=90 or
cup.stl:scale=0.001 . Its centre is put at x, y, z.

\b
{object_help()}

Of an emulated device and a gesture or a recording the time passes as fast as this computer allows.
{RENDER_HELP}""",
)
def touch(
    context: typer.Context,
    objects: Annotated[
        list[str],
        typer.Argument(
            metavar="OBJECT...",
            help="Each one of the paper's objects or a mesh file, with its parameters, such as cube, "
            "sphere:size=0.06,x=0.02,turn=90 or cup.stl:scale=0.001.",
            autocompletion=among(SOLIDS),
        ),
    ],
    hand: Annotated[
        str,
        typer.Option(
            "--hand",
            metavar="URL",
            help="The source of hands: gesture:approach|sweep|grasp|tap, recording:FILE, leap:, video:FILE or "
            "camera:N; `phasewire tracker` lists which are ready.",
        ),
    ] = HANDS,
    reconnect: Annotated[
        bool,
        typer.Option("--reconnect", help="Go on when a lost tracker comes back; silence until then."),
    ] = False,
    device: DeviceOption = DEFAULT_URL,
    seconds: Annotated[
        float | None,
        typer.Option(min=0, max=MOST_SECONDS, help="How long at most, in s; until the hands end, or Ctrl-C."),
    ] = None,
    spacing: Annotated[
        float, typer.Option(min=LEAST_SPACING, metavar="M", help="Length of arc between control points, in m.")
    ] = SPACING,
    corners: Annotated[
        bool, typer.Option("--corners/--no-corners", help="Whether edges and corners are denser and stronger.")
    ] = True,
    points: Annotated[
        int, typer.Option(min=1, max=MAX_POINTS, help="Control points at most; edges and corners keep theirs.")
    ] = MOST_POINTS,
    method: Annotated[
        str, typer.Option(help=f"The solving method: {', '.join(METHODS)}.", autocompletion=among(METHODS))
    ] = "wgs",
    frequency: Annotated[
        float, typer.Option(metavar="HZ", help="Frequency at which the halves of the points alternate.")
    ] = FREQUENCY,
    render: RenderOption = None,
    max_exposure: MaxExposureOption = None,
    listeners: ListenersOption = None,
    rate: Annotated[
        float | None, typer.Option(min=1e-3, help="Frames of hands per second at most; by default all that come.")
    ] = None,
    ramp: Annotated[
        float, typer.Option(min=0, max=MOST_RAMP_SECONDS, metavar="S", help="How long a point fades in and out, in s.")
    ] = RAMP_SECONDS,
    predict: Annotated[
        bool, typer.Option("--predict/--no-predict", help="Whether to extrapolate hands by their velocity.")
    ] = True,
    pose: PoseOption = None,
    array: ArrayOption = None,
    calibration: CalibrationOption = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--record", metavar="FILE", help="Write the hands to this .hands file, and points and drives beside it."
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", metavar="FILE", help="Where to draw the moment with the most points: .png, .svg or .pdf."
        ),
    ] = None,
    timeline: Annotated[
        Path | None,
        typer.Option(
            "--timeline",
            metavar="FILE",
            help="Where to draw the latency of that moment, from the hand's time stamp to the first tick of its field, "
            "measured on this computer with an emulated device: .png, .svg or .pdf.",
        ),
    ] = None,
    view: ViewOption = False,
    json_target: JsonOption = None,
) -> None:
    """Let hands touch objects, and play what they feel; the help above has the details."""
    check_outputs(
        [picture, timeline, recording, None if recording is None else log_path(recording), json_target],
        [*files_of(hand), *listener_files(listeners), *filter(None, (pose, array, calibration))],
    )
    for drawn in filter(None, (picture, timeline)):
        check_picture_path(drawn)
    if render is not None:
        check_render(context, "frequency")
        if timeline is not None:
            raise ValueError("--timeline follows the halves that alternate; leave out --render, or --timeline")
    way = render or f"{SQUARE},frequency={frequency}"
    placed, own = None if pose is None else Pose.load(pose), load_array(array)
    toucher = Toucher(spacing, corners, points)
    out, meter, best = console_for(json_target), _Meter(error_console()), _Best()
    things = [thing for _, thing in read_objects(objects)]
    with ExitStack() as stack:
        url, emulator = stack.enter_context(viewed_device(device, wanted=view))
        opened = stack.enter_context(open_device(url, calibration=load_calibration(calibration)))
        opener = partial(open_returning, on_loss=_tell_loss) if reconnect else open_hands
        source = stack.enter_context(_opened_hands(opener, hand, opened, placed, view))
        warn_of_notes(source)
        transducers = array_of(opened, own)
        reach = _Reach()
        seen: list[Callable[[TouchMoment], None]] = [reach, best] if picture or timeline else [reach]
        if recording is not None:
            seen.append(stack.enter_context(TouchLog(recording, source.rate, way, hand, placed)))
        loop = TouchLoop(
            opened,
            source,
            _placed_at(things, opened.time.monotonic()),
            toucher,
            transducers,
            method=method,
            render=way,
            ramp=ramp,
            predict=predict,
            most_points=points,
            rate=rate,
            limit=limiter(transducers, max_exposure, listeners),
            on_moment=partial(_each, seen),
        )
        with error_console().status("loading"):
            loop.warm_up()
        watch = stack.enter_context(watching(opened, transducers, emulator, wanted=view))
        if watch is not None:
            seen.append(lambda moment: watch.moment(moment, loop))
        error_console().print(f"{source.name} touches {', '.join(objects)} on {opened.name}")
        told = {"format": "phasewire-touch-1", "device": opened.name, "hands": hand, "objects": objects}
        ended: str | None = None
        failure: Exception | KeyboardInterrupt | None = None
        try:
            loop.run(math.inf if seconds is None else seconds, meter)
            ended = "the hands have ended" if source.ended else f"after {seconds:g} s"
        except KeyboardInterrupt as interrupt:
            ended = "Ctrl-C"
            failure = None if seconds is None else interrupt
        except (PhasewireError, ValueError) as error:
            failure = error
        finally:
            meter.end()
            if meter.last.frames and not meter.last.touching:
                error_console().print(f"warning: {reach.explained(objects)}", style="yellow")
            _tell(out, meter.last, default=render is None)
        if max_exposure is not None:
            out.print(kept(max_exposure, meter.last.least_gain))
        final = _final(opened, failure)
        said = "" if ended is None else f"Ended: {ended}. "
        out.print(f"{said}The outputs are off." if final else "The device's watchdog turns the outputs off.")
        write_json(
            json_target,
            told
            | {
                "render": way,
                "max_exposure_db": max_exposure,
                "touch": meter.last.record(),
                "ended": ended,
                "error": None if ended else str(failure),
                "status": plain(final),
            },
        )
        if failure is not None:
            raise failure
    for path, draw in (
        (picture, partial(_draw, transducers)),
        (timeline, partial(_draw_way, toucher, method)),
    ):
        if path is not None and best.moment is None:
            error_console().print(f"{path} was not drawn: no hand touched an object", style="yellow")
        elif path is not None and best.moment is not None:
            draw(path, best.moment)
            error_console().print(f"Drawn to {path}")


def read_objects(texts: Sequence[str]) -> list[tuple[str, MovingObject]]:
    """The objects of a command line with their names; what was repaired is a warning."""
    with error_console().status("reading") as status:
        found = [(text, parse_object(text, status.update)) for text in texts]
    for text, thing in found:
        for repair in thing.mesh.repairs:
            error_console().print(f"warning: {text}: {repair}", style="yellow")
    return [(object_name(text), thing) for text, thing in found]


def warn_of_notes(source: HandSource) -> None:
    """Say what is wrong with a source of hands as a whole."""
    for note in source.notes:
        error_console().print(f"warning: {note}", style="yellow")


def _final(device: Device, failure: BaseException | None) -> Status | None:
    """The device's state at the end; None if it was lost."""
    if isinstance(failure, DeviceError) and not isinstance(failure, DeviceRefusedError):
        return None  # asking it again would only take time
    with suppress(DeviceError):
        return device.status()
    return None


def _placed_at(things: Sequence[MovingObject], begin: float) -> Sequence[Mesh] | Callable[[float], Sequence[Mesh]]:
    """Objects for the loop: fixed ones, or functions of time if one of them moves."""
    if all(thing.still for thing in things):
        return [thing.mesh for thing in things]
    return lambda moment: [thing.at(moment - begin) for thing in things]


def _tell_loss(error: TrackerLostError) -> None:
    error_console().print(f"warning: {error}; waiting until it is back", style="yellow")


def _opened_hands(
    opener: Callable[[str, Timekeeper], HandSource], hand: str, device: Device, placed: Pose | None, view: bool
) -> HandSource:
    """The hands, by the clock of the device; if a page is open, by the wall clock."""
    if not view:
        return PlacedHands(opener(hand, device.time), placed)
    with loading():
        from ..view.hands import at_wall_pace
    return at_wall_pace(PlacedHands(opener(hand, time), placed))


def _each(seen: Sequence[Callable[[TouchMoment], None]], moment: TouchMoment) -> None:
    """Tell everyone who observes of a moment."""
    for look in seen:
        look(moment)


def _tell(out: Console, report: TouchReport, *, default: bool) -> None:
    """Report on the hands."""
    out.print(f"{report}.")
    if report.latency.count:
        stages = ", ".join(f"{name} {stage.median_seconds * 1e3:.2f}" for name, stage in report.stages.items())
        out.print(f"Of the latency, medians in ms: {stages}.")
    if report.notes:
        out.print(f"The last note on the hands: {report.last_note}.")
    if report.stored and default:
        out.print(
            "The line is too slow for a block in each turn: the device took the turns from its memory, and the line "
            "limited how often a new pose was played."
        )


def _draw(array: TransducerArray, path: Path, moment: TouchMoment) -> None:
    """Draw a moment, and the field as an emulated device emits it."""
    with loading():
        from ..hil.loop.touch_picture import save_touch_picture
        from ..hil.loop.touching import as_emitted

    assert moment.cycle is not None
    frames = moment.cycle.frames
    emitted = as_emitted([frames.pulses(number) for number in range(len(frames.phase))], moment.cycle.hold)
    source = "the bits that emulated boards play for the pulses that were sent"
    save_touch_picture(path, moment.hands, moment.objects, moment.touch, emitted, array, source)


def _draw_way(toucher: Toucher, method: str, path: Path, moment: TouchMoment) -> None:
    """Draw the latency from the hands of a moment to the first tick of their field."""
    with loading():
        from ..hil.loop.touch_latency import draw_touch_latency, measure_touch_latency

    save_figure(draw_touch_latency(measure_touch_latency(moment.hands, moment.objects, toucher, method=method)), path)
