"""Commands that compute: ``solve``, ``field`` and ``focus``."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import textwrap
import warnings
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, cast, get_args

import numpy as np
import typer
from rich import box
from rich.table import Column, Table
from rich.text import Text

from ..base.pictures import FORMATS
from ..base.storage import check_outputs
from ..solver.accelerated.devices import Backend
from ..solver.acoustics.array import COLUMNS, PITCH, ROWS, TransducerArray
from ..solver.acoustics.medium import Medium
from ..solver.acoustics.propagation import pressure
from ..solver.acoustics.transducer import MODELS, TRANSDUCERS
from ..solver.fields.drawing import OIL
from ..solver.fields.field import PlaneField, VolumeField, sample_cut, sample_volume
from ..solver.fields.files import load_solution, save_field, save_solution
from ..solver.fields.focus import focus_report
from ..solver.fields.grid import Grid
from ..solver.fields.quantities import QUANTITIES
from ..solver.fields.validity import validity
from ..solver.geometry import counted
from ..solver.methods.methods import METHODS, options_of
from ..solver.methods.options import Output
from ..solver.methods.solve import Solution, Solver
from ..solver.pictures.picture import save_field_picture
from ..solver.pictures.vti import save_vti
from ..solver.shapes.curves import SPACING
from ..solver.shapes.point_files import POINT_FILES
from ..solver.shapes.points import REACH
from ..solver.shapes.shapes import parse_shape, shape_help
from .console import JsonOption, among, console_for, error_console, given, write_json
from .points import ARCHIVE, ArrayOption, SourceKind, files_in, kind_of, load_array, read_source, shapes_and_files

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

PLANES = {"xy": "xy", "xz": "xz", "yz": "yz", "box": "xyz"}  # by name, the axes of each
CLEARANCE = 0.01  # the least distance in metres of a standing plane from the array
DEFAULT_TRANSDUCER = "MA40S4S"
NUMBERS, VTK = ".npz", ".vti"
DRAWN = (*QUANTITIES, OIL)


SolvedArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="A solved file; or a shape, a file of points, or - for points on standard input, which wgs then solves "
        "for the default array.",
        autocompletion=shapes_and_files((*POINT_FILES, ARCHIVE)),
    ),
]


def well_spelt(source: str) -> str:
    """The source, unless it is a misspelt shape, which is refused here: before the command misses an option."""
    is_shape = kind_of(source) is SourceKind.SHAPE
    if is_shape and not any(file.exists() for file in files_in(source)):  # the command reads a file once, later
        parse_shape(source)
    return source


def solved_source(source: str) -> Solution:
    """The solution in a file, or that of a shape or of points by the default method for the default array."""
    if kind_of(source) is SourceKind.ARCHIVE:
        return load_solution(source)
    points = read_source(source)
    with error_console().status("solving"):
        return Solver(TransducerArray.grid()).solve(points)


def method_help() -> str:
    """A few lines per method: its purpose, and its options with their defaults."""
    lines = []
    for name in METHODS:
        try:
            method, defaults = METHODS[name], options_of(name)
        except ValueError as error:  # another package's, which must not break the help
            lines.append(f"{name}: {error}")
            continue
        values = ((key, getattr(defaults, key)) for key in ("output", *method.options))
        listed = ", ".join(key if value is None else f"{key}={value}" for key, value in values)
        lines.append(f"{name}: {method.summary}")
        lines.append(textwrap.fill(listed, width=74, initial_indent="    ", subsequent_indent="    "))
    return "\n".join(lines)


def read_settings(settings: Sequence[str]) -> dict[str, Any]:
    """Options of a method from ``name=value`` texts; numbers are read as such, the rest is left to `Options`.

    Raises
    ------
    ValueError
        If a text has no ``=``, or a name is set twice.
    """
    values: dict[str, Any] = {}
    for text in settings:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"--set {text!r} must be a name, = and a value, as in gamma=0.5")
        if name in values:
            raise ValueError(f"--set {name} is given twice")
        values[name] = value
        for read in (int, float):
            with contextlib.suppress(ValueError):
                values[name] = read(value)
                break
    return values


def with_transducer(array: TransducerArray, name: str | None, model: str | None) -> TransducerArray:
    """The same array of other transducers; None for what remains."""
    if name is not None and name not in TRANSDUCERS:
        raise ValueError(f"unknown transducer {name!r}; known are {', '.join(TRANSDUCERS)}")
    part = array.transducer if name is None else dataclasses.replace(TRANSDUCERS[name], model=array.transducer.model)
    if model is not None:
        part = dataclasses.replace(part, model=model)
    return TransducerArray(array.positions, array.normals, part)


@commands.command(
    name="solve",
    epilog="Example: phasewire solve sphere:radius=0.04,palm=0.18 --output sphere.npz",
    help=f"""Find the drives that make a shape, and write them to a file.

SOURCE is a shape or a file of control points.

A shape is a name with what differs from its defaults, such as sphere:radius=0.04,palm=0.18 or polygon:sides=5 . Lengths
are in metres, rotations in degrees; the vertices of a polyline can also be the name of a file of points.

\b
{shape_help()}

A .csv file has a line x,y,z or x,y,z,amplitude for each point; a .txt or .xyz file has spaces instead of commas.
A .json file is {{"positions": [[x, y, z], ...], "amplitudes": [...]}}. Coordinates are in metres from the middle of the
array, z up; amplitudes are relative, 0 asks for a null.

The methods and their options:

\b
{method_help()}

An option is set as in --set gamma=0.5 --set steps=30 . Of all of them, output is one of {", ".join(get_args(Output))}:
scaled alike, each at full drive with its phase, or raised and cut off at full drive.""",
)
def solve_command(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help=f"A shape, a file of points ({', '.join(POINT_FILES)}), or - for points on standard input.",
            autocompletion=shapes_and_files(POINT_FILES),
            callback=well_spelt,
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The .npz file to write.")],
    spacing: Annotated[
        float | None,
        typer.Option(
            help="Distance between a shape's control points along its arc, in m; by default "
            f"{SPACING:g}, or as many points as the paper's Figure 6 has."
        ),
    ] = None,
    method: Annotated[str, typer.Option(help="How to solve; see above.", autocompletion=among(METHODS))] = "wgs",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="OPTION=VALUE", help="Set an option of the method; can be given several times."),
    ] = None,
    array: ArrayOption = None,
    columns: Annotated[int, typer.Option(help="Without --array: transducers along x.")] = COLUMNS,
    rows: Annotated[int, typer.Option(help="Without --array: transducers along y.")] = ROWS,
    pitch: Annotated[float, typer.Option(help="Without --array: distance between transducers, in m.")] = PITCH,
    transducer: Annotated[
        str | None,
        typer.Option(
            help=f"The transducer, by its published strength: {', '.join(TRANSDUCERS)}; by default that of --array, or "
            f"{DEFAULT_TRANSDUCER}.",
            autocompletion=among(TRANSDUCERS),
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help=f"Model of the transducer: {', '.join(MODELS)}; by default that of --array, or piston.",
            autocompletion=among(MODELS),
        ),
    ] = None,
    temperature: Annotated[float, typer.Option(help="Temperature of the air, in °C.")] = 20.0,
    humidity: Annotated[
        float | None, typer.Option(help="Humidity of air that absorbs, in %; by default nothing is absorbed.")
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Find the drives that make a shape (the help text above is built from the shapes and the methods)."""
    if output.suffix.lower() != ".npz":
        raise ValueError(f"{output}: the name of a solved file ends in .npz")
    check_outputs([output, json_target], inputs=[*files_in(source), *filter(None, (array,))])
    points = read_source(source, spacing)
    read = load_array(array)
    for option in ("columns", "rows", "pitch"):
        if read is not None and given(context, option):
            raise ValueError(f"--{option} has no effect with --array, which states where each transducer is")
    used = with_transducer(read or TransducerArray.grid(columns, rows, pitch), transducer, model)
    medium = Medium(temperature) if humidity is None else Medium(temperature, absorbing=True, humidity=humidity)
    options = read_settings(settings or [])
    options_of(method, options)  # names options of no method, which may be names of other things
    solver = Solver(used, method, medium=medium, **options)
    with error_console().status("solving"):
        solver.solve(points)
    solver.forget()
    started = perf_counter()
    solution = solver.solve(points)
    milliseconds = (perf_counter() - started) * 1e3
    reached = np.abs(pressure(used, solution.drive, points.positions, solution.medium))
    save_solution(output, solution)
    console_for(json_target).print(
        f"{counted(len(points), 'control point')}, {counted(len(used), 'transducer')}, "
        f"{method} in {milliseconds:.2f} ms: {reached.min():.0f} to {reached.max():.0f} Pa (peak) at the points. "
        f"Written to {output}.",
    )
    write_json(
        json_target,
        {
            "format": "phasewire-solve-1",
            "file": str(output),
            "method": method,
            "control_points": len(points),
            "transducers": len(used),
            "milliseconds": milliseconds,
            "pressure_pa": reached.tolist(),
        },
    )


def field_grid(solution: Solution, plane: str, at: float | None, extent: float, step: float) -> Grid:
    """The grid for the options of ``field``.

    Planes and boxes are centred above the array, those with a height on the points' mean height; but they begin no
    lower than `CLEARANCE` above the array.
    """
    if plane not in PLANES:
        raise ValueError(f"unknown plane {plane!r}; known are {', '.join(PLANES)}")
    axes = PLANES[plane]
    centre = np.array([0.0, 0.0, solution.points.positions[:, 2].mean()])
    upright = (solution.array.normals[:, 2] > 0).all()  # nothing looks down from above
    if "z" in axes and upright and extent < REACH:  # Grid raises for an invalid extent
        lowest = solution.array.positions[:, 2].max() + CLEARANCE
        centre[2] = max(centre[2], lowest + extent / 2)
    if at is not None:
        across = "".join(set("xyz") - set(axes))
        if not across:
            raise ValueError(f"--at {at} has no meaning for a box; it is the place of a plane")
        if across == "z":
            return Grid.horizontal(at, extent, step)
        centre["xyz".index(across)] = at
    return Grid.along(axes, centre, extent, step)


def check_field_output(output: Path, plane: str, quantity: str) -> None:
    """Raise `ValueError` if a field of this kind cannot be written to a file of this name."""
    suffix = output.suffix.lower()
    if suffix not in (NUMBERS, VTK):
        if suffix not in FORMATS:
            raise ValueError(f"{output}: a picture's name ends in {', '.join(FORMATS)}; numbers go to .npz or .vti")
        if plane == "box":
            raise ValueError(f"{output}: a box cannot be drawn; write it to an {NUMBERS} or {VTK} file")
        if quantity not in DRAWN:
            raise ValueError(f"unknown quantity {quantity!r}; known are {', '.join(DRAWN)}")
        if quantity == OIL and plane != "xy":
            raise ValueError(f"oil lies level: it shows the plane xy, not {plane}")
    elif quantity != DRAWN[0]:
        raise ValueError(f"{output}: --quantity chooses what a picture shows; a {suffix} file holds the pressure")


@commands.command(epilog="Example: phasewire field sphere.npz --plane xz --output field.png")
def field(
    source: SolvedArgument,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="The .png, .svg, .pdf, .npz or .vti file to write."),
    ],
    plane: Annotated[
        str,
        typer.Option(
            help="xy is horizontal, xz and yz stand on the array, box is a volume.", autocompletion=among(PLANES)
        ),
    ] = "xy",
    at: Annotated[
        float | None,
        typer.Option(
            "--at",
            "--height",
            help="Where the plane crosses the axis perpendicular to it, in m: the height of xy, by default the mean "
            "of the points; y of xz and x of yz, by default 0.",
        ),
    ] = None,
    extent: Annotated[float, typer.Option(help="Side of the plane or box, in m.")] = 0.2,
    step: Annotated[
        float | None, typer.Option(help="Distance between samples, in m; 1 mm by default, of a box 2 mm.")
    ] = None,
    quantity: Annotated[
        str, typer.Option(help=f"The quantity of a picture: {', '.join(DRAWN)}.", autocompletion=among(DRAWN))
    ] = DRAWN[0],
    backend: Annotated[
        str, typer.Option(help="cpu, or cuda for a GPU, if there is one.", autocompletion=among(get_args(Backend)))
    ] = "cpu",
    json_target: JsonOption = None,
) -> None:
    """Compute the field of a solved file or a shape over a plane or a box, as a picture or as numbers.

    An .npz file holds the complex peak pressure in Pa and the grid; its entry "units" says more. A .vti file is for
    ParaView: amplitude, real and imaginary part of the pressure, intensity and radiation pressure.

    Intensity and radiation pressure assume a plane wave with full reflection. The oil is that of the paper's Figure 6:
    its surface under radiation pressure, lit from the side.
    """
    check_field_output(output, plane, quantity)
    check_outputs([output, json_target], inputs=files_in(source))
    solution = solved_source(source)
    if step is None:
        step = 2e-3 if plane == "box" else 1e-3
    grid = field_grid(solution, plane, at, extent, step)
    sample = sample_volume if grid.kind == "box" else sample_cut
    with error_console().status("computing the field"), warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("default")
        result: PlaneField | VolumeField = sample(
            solution.array, solution.drive, grid, solution.medium, cast("Backend", backend)
        )
    for warning in heard:
        error_console().print(f"warning: {warning.message}", style="yellow")
    if output.suffix.lower() == NUMBERS:
        save_field(output, result)
    elif output.suffix.lower() == VTK:
        save_vti(output, result)
    elif isinstance(result, PlaneField):
        save_field_picture(output, result, solution.points, quantity, solution.array)
    strongest, where = result.strongest()
    x, y, z = where * 1e3
    middle = ", ".join(f"{coordinate:g}" for coordinate in grid.centre)
    console_for(json_target).print(
        f"{result.pressure.size} samples over a {grid.kind} around ({middle}) m; strongest {strongest:.0f} Pa (peak, "
        f"linear model) at x = {x:.1f} mm, y = {y:.1f} mm, z = {z:.1f} mm. Written to {output}.",
    )
    believed = validity(solution.array, strongest, where, solution.medium)
    if not believed.linear:
        error_console().print(f"warning: {believed}", style="yellow")
    write_json(
        json_target,
        {
            "format": "phasewire-field-report-1",
            "file": str(output),
            "plane": plane,
            "centre_m": grid.centre.tolist(),
            "step_m": grid.step,
            "samples": result.pressure.size,
            "strongest": {"pa": strongest, "x_m": where[0], "y_m": where[1], "z_m": where[2]},
            "validity": believed.record(),
        },
    )


@commands.command(epilog="Example: phasewire focus sphere.npz")
def focus(
    source: SolvedArgument,
    json_target: JsonOption = None,
) -> None:
    """Report the result at control points, of a solved file or a shape: strength, sharpness, missing ones and ghosts.

    A point is missing if it has at most half its share of the mean pressure; a ghost is a local maximum away from all
    points with more than half the mean. The widths are those at half the pressure along x, y and z.
    """
    check_outputs([json_target], inputs=files_in(source))
    solution = solved_source(source)
    with error_console().status("examining the foci"):
        report = focus_report(solution.array, solution.drive, solution.points, solution.medium)
    out = console_for(json_target)
    headers = ("point", "x, y, z / mm", "|p| / Pa", "off / mm", "−6 dB / mm")
    columns = (Column(header, justify="right", no_wrap=True) for header in headers)
    table = Table(*columns, "", box=box.SIMPLE_HEAD)  # narrow enough for 80 columns
    for found in report.foci:
        off, mark = f"{math.hypot(*found.offset) * 1e3:.1f}", Text("missing", "red") if found.missing else ""
        width = _millimetres(found.width, digits=0)
        table.add_row(str(found.index), _millimetres(found.position), f"{found.pressure:.0f}", off, width, mark)
    for null in report.nulls:
        level = f"null, {null.level:.0f} dB"
        table.add_row(str(null.index), _millimetres(null.position), f"{null.pressure:.0f}", "", "", level)
    for ghost in report.ghosts:
        table.add_row("", _millimetres(ghost.position), f"{ghost.pressure:.0f}", "", "", Text("ghost", "red"))
    out.print(table)
    out.print(report.summary())
    focal = max(report.foci, key=lambda found: found.peak)
    believed = validity(solution.array, focal.peak, focal.position, solution.medium)
    out.print(f"{believed}.", style=None if believed.linear else "yellow")
    write_json(
        json_target,
        {"format": "phasewire-focus-1", "file": source} | report.record() | {"validity": believed.record()},
    )


def _millimetres(lengths: Sequence[float | None], digits: int = 1) -> str:
    return ", ".join("–" if length is None else f"{length * 1e3:.{digits}f}" for length in lengths)
