"""The command that shows the whole path: ``demo``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from ..base.pictures import check_picture_path
from ..base.signals import loading
from ..base.storage import check_outputs
from ..emulator import Emulator
from ..hil.loop.end_to_end import EndToEnd, run_end_to_end
from ..hil.loop.picture import save_end_to_end_picture
from ..protocol.board import TICK_HZ
from ..protocol.codes import BLOCK_BYTES
from ..solver import Solver, Sphere, TransducerArray
from .console import JsonOption, console_for, error_console, write_json
from .viewing import opened_page

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)


@commands.command(epilog="Example: phasewire demo --picture demo.svg --json demo.json")
def demo(
    picture: Annotated[
        Path, typer.Option("--picture", metavar="FILE", help="Where to draw the result: .png, .svg or .pdf.")
    ] = Path("demo.png"),
    view: Annotated[
        bool, typer.Option("--view", help="Show the result in 3D in the browser too, until the page is closed.")
    ] = False,
    json_target: JsonOption = None,
) -> None:
    """Show the whole path: a sphere on a palm, five emulated boards, pressure.

    A sphere of 10 cm, centred 17 cm above the array, is cut by a palm at 20 cm. The circle that the palm feels is
    sampled every 15 mm, solved, quantised to pulses, packed, sent through pyusb to an emulated device, sorted, carried
    over the chain, played as 320 square waves, captured bit by bit, and propagated back to the palm.

    The exit code is 0 if the rebuilt drive is the intended one, up to quantisation, and 1 if it is not.
    """
    check_picture_path(picture)
    check_outputs([picture, json_target])
    out, progress = console_for(json_target), error_console()
    started = perf_counter()

    def told(stage: str, what: str) -> None:
        progress.print(Text.assemble(("✓ ", "green"), (f"{stage:<9} ", "bold"), what))

    with progress.status("cutting the sphere") as status:
        sphere, array = Sphere(), TransducerArray.grid()
        points = sphere.sample()
        told(
            "shape",
            f"sphere of {sphere.radius * 200:g} cm, centred {sphere.height * 100:g} cm up, palm at "
            f"{sphere.palm * 100:g} cm: a circle of {sphere.cut().radius * 100:g} cm radius, "
            f"{len(points)} control points",
        )
        status.update("solving")
        solver = Solver(array)
        solver.solve(points)
        solver.forget()
        before = perf_counter()
        solution = solver.solve(points)
        microseconds = (perf_counter() - before) * 1e6
        told("solve", f"{len(array)} drives by weighted Tikhonov and Gauss–Newton steps in {microseconds:.0f} µs")
        status.update("sending, playing and capturing")
        with Emulator() as emulator:
            run = run_end_to_end(solution, emulator)
        told("quantise", "a phase in half ticks and a width in ticks for each transducer, 12 bits")
        told(
            "send",
            f"one block of {BLOCK_BYTES} bytes by pyusb, accepted for carrier period {run.ack.commit_period}",
        )
        told("boards", "sorted by the wiring table, ten slices down the chain, latched:")
        _tell_events(progress, emulator, run)
        told("capture", f"{run.capture.end_tick} ticks of 0.5 µs on 320 outputs, read bit by bit")
        status.update("propagating to the palm")
        field = run.field(sphere.palm)
        strongest = float(np.abs(field.pressure).max())
        told(
            "field",
            f"{field.pressure.size} samples on the palm, at most {strongest:.0f} Pa (peak, linear model)",
        )
        status.update("drawing")
        verdict = "PASS: the rebuilt drive is the intended one" if run.passed else "FAIL: something else came back"
        save_end_to_end_picture(picture, run, field, f"phasewire demo: a sphere of 10 cm on a palm at 20 cm. {verdict}")
        told("picture", str(picture))

    _print_differences(out, run)
    _print_checks(out, run)
    seconds = perf_counter() - started
    out.print(f"\n{verdict} ({seconds:.1f} s)", style="bold green" if run.passed else "bold red")
    write_json(json_target, _record(run, strongest, seconds))
    if view:
        _show(run, sphere.palm)
    if not run.passed:
        raise typer.Exit(1)


def _show(run: EndToEnd, palm: float) -> None:
    """Show what was captured on a page, until it is closed or Ctrl-C."""
    with loading():
        from ..view import Emitter, Snapshot, View
        from ..view.settings import Settings
        from ..view.snapshot import rows_of
        from ..view.tap import BITS
    emitter = Emitter(run.solution.array, "phasewire demo", run.capture.wiring)
    with View(emitter, settings=Settings(xy_at=palm), embedded=False) as page, suppress(KeyboardInterrupt):
        page.show(Snapshot(run.rebuilt[None], source=BITS, points=rows_of(run.solution.points)))
        opened_page(page)
        error_console().print("It ends when the page is closed, or with Ctrl-C")
        page.wait_until_left()


def _tell_events(progress: Console, emulator: Emulator, run: EndToEnd) -> None:
    """Print the times of events inside the device, until the outputs began to play."""
    moments = sorted({tick / TICK_HZ for tick in run.latch_ticks})
    first = emulator.events[0].time
    lines = [(event.time, f"controller {event.what}") for event in emulator.events if event.where == "controller"]
    lines = [line for line in lines if line[0] < moments[0]]
    who = "all ten processors" if len(moments) == 1 else "the processors, not together,"
    lines += [(moment, f"{who} play the new table") for moment in moments]
    for moment, what in lines:
        progress.print(f"            {(moment - first) * 1e6:6.1f} µs  {what}")


def _number_column(header: str) -> Column:
    return Column(header, justify="right", no_wrap=True)


def _print_differences(out: Console, run: EndToEnd) -> None:
    table = Table("largest error", _number_column("rebuilt"), _number_column("quantisation alone"), "unit")
    for row in run.differences():
        table.add_row(row["what"], f"{row['rebuilt']:.4f}", f"{row['quantisation']:.4f}", row["unit"])
    out.print("\nWhat the boards emitted against what was intended, and how much of the difference is quantisation:")
    out.print(table)


def _print_checks(out: Console, run: EndToEnd) -> None:
    out.print("Requirements:")
    table = Table("check", _number_column("measured"), _number_column("at most"), "unit", "")
    for check in run.checks():
        mark = Text("pass", "green") if check.passed else Text("FAIL", "red")
        table.add_row(check.name, f"{check.value:.3g}", f"{check.limit:.3g}", check.unit, mark)
    out.print(table)


def _record(run: EndToEnd, strongest: float, seconds: float) -> dict[str, Any]:
    return {"format": "phasewire-demo-1"} | run.record() | {"field_maximum_pa": strongest, "seconds": seconds}
