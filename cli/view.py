"""The command that opens the live page: ``view``; and the option ``--view`` of others."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated, Any

import typer

from ..base.signals import loading
from ..base.storage import check_outputs
from ..emulator.machine import open_emulator
from ..host.hands.placing import PlacedHands
from ..host.hands.pose import Pose
from ..host.hands.sources import HandSource, files_of, open_hands
from ..host.streaming.device import open_device
from ..host.transports.opening import DEFAULT_URL
from ..protocol.plain import plain
from ..solver import METHODS
from ..solver.contact.solids import SOLIDS
from ..solver.objects.parsing import object_help
from .console import JsonOption, among, console_for, error_console, given, write_json
from .options import MOST_SECONDS, CalibrationOption, DeviceOption, PoseOption, load_calibration
from .playing import array_of
from .points import ArrayOption, load_array
from .touch import read_objects, warn_of_notes
from .viewing import opened_page, viewed_device

with loading():
    from ..view.browser import VIDEO_SUFFIX, saved_from, suffix_of
    from ..view.hands import MouseHands, at_wall_pace
    from ..view.recordings import TAPES, open_tape
    from ..view.server import LOOPBACK, is_loopback
    from ..view.settings import HandSetting, Settings
    from ..view.shelf import Shelf
    from ..view.studio import Studio
    from ..view.tap import emitter_of
    from ..view.view import View

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

MOUSE = "mouse:"
SAVED_SECONDS, LEAST_VIDEO_SECONDS = 4.0, 0.2


@commands.command(
    epilog="Example: phasewire view cube",
    help=f"""Show hands, objects, array and field live in 3D, on a page in the browser, and change them there.

Without --hand a hand is dragged with the mouse, or moved with the sliders of the page. What it touches is played on the
device, as `phasewire touch` does it. The page shows what the transducers really emit: from the bits of an emulated
device, or as read back from another one. Esc stops; so does closing the page, unless --unwatched is given.

Instead of objects, a recording can be shown, without a device: a .frames file of `phasewire record`, or a .touch or
.hands file of `phasewire touch --record`.

\b
{object_help()}

An emulated device keeps the pace of the wall clock.
""",
)
def view(
    context: typer.Context,
    objects: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[OBJECT]...",
            help="Each one of the paper's objects or a mesh file, with its parameters, such as cube or "
            "cup.stl:scale=0.001; or one recording. A cube by default.",
            autocompletion=among(SOLIDS),
        ),
    ] = None,
    hand: Annotated[
        str,
        typer.Option(
            "--hand",
            metavar="URL",
            help="The source of hands: mouse:, gesture:approach|sweep|grasp|tap, recording:FILE, leap:, video:FILE or "
            "camera:N; `phasewire tracker` lists which are ready.",
        ),
    ] = MOUSE,
    device: DeviceOption = DEFAULT_URL,
    method: Annotated[
        str, typer.Option(help=f"The solving method: {', '.join(METHODS)}.", autocompletion=among(METHODS))
    ] = "wgs",
    seconds: Annotated[
        float | None,
        typer.Option(min=0, max=MOST_SECONDS, help="How long at most, in s; until the hands end, or Ctrl-C."),
    ] = None,
    listen: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="The address to listen at. At another one than the default, such as 0.0.0.0, whoever can reach this "
            "computer and has the link can command the device; the connection is not encrypted.",
        ),
    ] = LOOPBACK,
    port: Annotated[int, typer.Option(min=0, max=65535, help="The port to listen at; 0 for any that is free.")] = 0,
    browser: Annotated[
        bool,
        typer.Option("--browser/--no-browser", help="Whether to open the page in the browser; its link is printed."),
    ] = True,
    unwatched: Annotated[
        bool, typer.Option("--unwatched", help="Play on when no page is open, and begin before one is.")
    ] = False,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw a picture (.png) or record a video (.webm) of the page without a window, and end. That needs "
            "Chromium, Chrome or Edge.",
        ),
    ] = None,
    pose: PoseOption = None,
    array: ArrayOption = None,
    calibration: CalibrationOption = None,
    json_target: JsonOption = None,
) -> None:
    """Open the live page; the help above has the details."""
    check_outputs([save, json_target], [*files_of(hand), *filter(None, (pose, array, calibration))])
    if save is not None and suffix_of(save) == VIDEO_SUFFIX and seconds is not None and seconds < LEAST_VIDEO_SECONDS:
        raise ValueError(f"--seconds {seconds:g} is too short for a video; at least {LEAST_VIDEO_SECONDS:g}")
    if not is_loopback(listen):
        error_console().print(
            f"warning: the page listens at {listen}: whoever can reach this computer there and has the link can "
            "command the device, and the connection is not encrypted",
            style="yellow",
        )
    named, own = objects or ["cube"], load_array(array)
    serving: dict[str, Any] = {"listen": listen, "port": port, "embedded": False, "saving": save is not None}
    told: dict[str, Any] = {"format": "phasewire-view-1", "shown": named, "device": None, "status": None}
    if any(Path(name).suffix.lower() in TAPES for name in named):
        _check_recording(context, named)
        with (
            open_tape(Path(named[0]), own) as tape,
            View(tape.emitter, tape=tape, settings=tape.settings, **serving) as page,
        ):
            _show(page, lambda over: tape.run(page, over), time.monotonic, save, seconds, browser)
        write_json(json_target, told)
        return
    placed = None if pose is None else Pose.load(pose)
    shelf = Shelf(read_objects(named))
    with ExitStack() as stack:
        url, emulator = stack.enter_context(viewed_device(device))
        opened = stack.enter_context(open_device(url, calibration=load_calibration(calibration)))
        emulator = emulator or open_emulator(opened.serial)
        transducers = array_of(opened, own)
        moved = HandSetting() if hand == MOUSE else None
        source = stack.enter_context(closing(_hands(hand, moved, placed)))
        warn_of_notes(source)
        settings = Settings(method=method, objects=shelf.settings, hand=moved)
        studio = Studio(
            opened, transducers, shelf, source, settings, emulator=emulator, unwatched=unwatched or save is not None
        )
        with error_console().status("loading what is compiled; the first time this takes a minute"):
            studio.warm_up()
        page = stack.enter_context(View(emitter_of(opened, transducers), settings=settings, director=studio, **serving))
        page.warm_up()
        _show(page, lambda over: studio.run(page, over), opened.time.monotonic, save, seconds, browser)
        told |= {"device": opened.name, "status": plain(opened.status())}
    console_for(json_target).print("The outputs are off.")
    write_json(json_target, told)


def _check_recording(context: typer.Context, named: list[str]) -> None:
    """Raise `ValueError` if a recording is not alone, or an option has no effect on it."""
    if len(named) > 1:
        raise ValueError(f"a recording is shown alone, not beside others: {', '.join(named)}")
    for option in ("hand", "device", "method", "unwatched", "pose", "calibration"):
        if given(context, option):
            raise ValueError(f"--{option} has no effect on a recording; leave it out")


def _hands(url: str, moved: HandSetting | None, pose: Pose | None) -> HandSource:
    """The hand that a page moves, or those of a URL at the pace of the wall clock."""
    if moved is not None:
        return MouseHands(moved)
    return at_wall_pace(PlacedHands(open_hands(url, time), pose))


def _show(
    page: View,
    run: Callable[[Callable[[], bool]], None],
    clock: Callable[[], float],
    save: Path | None,
    seconds: float | None,
    browser: bool,
) -> None:
    """Let the page be seen, or saved, while something runs until it is over, for so many seconds by a clock."""
    if save is not None:
        with saved_from(page, save, SAVED_SECONDS if seconds is None else seconds) as saved:
            run(saved)
        error_console().print(f"Drawn to {save}")
        return
    opened_page(page, browser=browser)
    began = clock()
    try:
        run(lambda: seconds is not None and clock() - began >= seconds)
    except KeyboardInterrupt:
        if seconds is not None:
            raise
