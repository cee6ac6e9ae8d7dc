"""The command that says how a shape is felt and heard: ``feel``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Column, Table

from ..base.pictures import check_picture_path
from ..base.signals import loading
from ..base.storage import check_outputs
from ..protocol.board import CHANNELS
from ..solver import Cycle, Renderer, TransducerArray
from ..solver.rendering.ways import AUTO, WAYS, described
from ..solver.shapes.point_files import POINT_FILES
from .console import JsonOption, among, console_for, error_console, write_json
from .listening import ListenersOption, listener_files, load_listeners
from .playing import MethodOption
from .points import ArrayOption, files_in, load_array, read_outline, shapes_and_files
from .rendering import RENDER_HELP, SQUARE

if TYPE_CHECKING:
    from ..hil.loop.sensing import Sensation

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

MOST_WAYS = 4


@commands.command(
    epilog="Example: phasewire feel circle:radius=0.03 --render stm --render am -o feel.png",
    help=f"""Say how a shape is felt and heard, as emulated boards emit it: skin, ears, exposure, power.

Each way of rendering is played on an emulated device. From the bits of its outputs follow the waves, from these the
push on a flat hand over the shape, the motion of its skin, and the intensity that its receptors could perceive; and
what ears hear, and how loud the ultrasound is there. All of it is a model; docs/explanation/skin.md and
quiet-and-safe.md say what it leaves out.
{RENDER_HELP}""",
)
def feel(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A shape such as circle:radius=0.03, a file of points, or - for points on standard input.",
            autocompletion=shapes_and_files(POINT_FILES),
        ),
    ],
    render: Annotated[
        list[str] | None,
        typer.Option(
            "--render",
            metavar="WAY",
            help=f"A way of rendering, to be given up to {MOST_WAYS} times; {SQUARE} and {AUTO} by default.",
            autocompletion=among((AUTO, *WAYS)),
        ),
    ] = None,
    method: MethodOption = "wgs",
    listeners: ListenersOption = None,
    picture: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Where to draw the felt maps: .png, .svg or .pdf."),
    ] = None,
    array: ArrayOption = None,
    json_target: JsonOption = None,
) -> None:
    """Say how a shape is felt and heard; the help above has the details."""
    check_outputs(
        [picture, json_target], inputs=[*files_in(source), *listener_files(listeners), *filter(None, [array])]
    )
    if picture is not None:
        check_picture_path(picture)
    names = render or [SQUARE, AUTO]
    if len(names) > MOST_WAYS:
        raise ValueError(f"{len(names)} ways of rendering are too many for a picture; at most {MOST_WAYS} are possible")
    outline, transducers = read_outline(source), load_array(array) or TransducerArray.grid()
    if len(transducers) != CHANNELS:
        raise ValueError(f"--array has {len(transducers)} transducers, but emulated boards have {CHANNELS}")
    ears = load_listeners(listeners)
    cycles: dict[str, Cycle] = {}
    for name in names:
        renderer = Renderer(transducers, name, method)
        shown = f"{AUTO}: {described(renderer.way_for(outline))}" if name == AUTO else name
        cycles[shown] = renderer.render(outline)
    with loading():
        from ..feel.exposure import NOTE
        from ..hil.loop.sensing import sense, skin_over
        from ..hil.loop.sensing_picture import save_sensation_picture
    hand = skin_over(outline)
    found: dict[str, Sensation] = {}
    with error_console().status("playing") as status:
        for name, cycle in cycles.items():
            status.update(f"playing {name}")
            found[name] = sense(cycle, hand, ears, transducers)
    out = console_for(json_target)
    _print(out, found)
    for name, sensed in found.items():
        out.print(f"\n{name}\n{sensed.felt.summary()}")
        for said in (sensed.sound, sensed.exposure, sensed.power, sensed.validity):
            out.print(str(said))
    out.print(f"\n{NOTE}.", style="yellow")
    if picture is not None:
        save_sensation_picture(picture, found, f"{source}: felt and heard, by the bits of emulated boards")
        error_console().print(f"Drawn to {picture}")
    write_json(
        json_target,
        {
            "format": "phasewire-feel-1",
            "source": source,
            "ways": {name: sensed.record() for name, sensed in found.items()},
            "exposure_note": NOTE,
        },
    )


def _print(out: Console, found: dict[str, Sensation]) -> None:
    """A table of all ways: intensity over the threshold, share of skin, what is heard, ultrasound, power."""
    table = Table(
        "way",
        *(Column(header, justify="right") for header in ("felt, ×", "skin, %", "dB(A)", "dB SPL", "W")),
    )
    for name, sensed in found.items():
        intensity = sensed.felt.intensity
        table.add_row(
            name,
            f"{intensity.max():.1f}",
            f"{(intensity >= 1).mean() * 100:.0f}",
            f"{sensed.sound.levels_dba.max():.0f}",
            f"{sensed.exposure.greatest_db.max():.1f}",
            f"{sensed.power.acoustic:.1f}",
        )
    out.print(table)
