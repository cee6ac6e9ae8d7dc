"""Commands that compute: ``solve`` and ``field``."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
import typer

from ..console import JsonOption, console_for, error_console, write_json
from ..storage import check_outputs
from .array import COLUMNS, PITCH, ROWS, TransducerArray
from .curves import SPACING
from .field import sample_plane
from .files import POINT_FILES, load_solution, read_points, save_field, save_solution
from .medium import Medium
from .options import METHODS
from .picture import check_picture_path, save_field_picture
from .points import ControlPoints
from .propagation import pressure
from .shapes import SHAPES, parse_shape, shape_help
from .solve import solve

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)


def read_source(source: str, spacing: float | None = None) -> ControlPoints:
    """Control points from a shape's notation or from a file of points."""
    if source.partition(":")[0] in SHAPES:
        return parse_shape(source).sample(spacing)
    if Path(source).suffix.lower() in POINT_FILES:
        return read_points(Path(source))
    raise ValueError(
        f"{source!r} is neither a shape ({', '.join(sorted(SHAPES))}) nor a file of points ({', '.join(POINT_FILES)})"
    )


def files_in(source: str) -> list[Path]:
    """Every file that a source may be, or may name as a parameter of a shape."""
    return [
        Path(source),
        *(Path(item.partition("=")[2]) for item in source.partition(":")[2].split(",") if "=" in item),
    ]


@commands.command(
    name="solve",
    help=f"""Find the drives that make a shape, and write them to a file.

SOURCE is a shape or a file of control points.

A shape is a name with what differs from its defaults, such as sphere:radius=0.04,palm=0.18 or polygon:sides=5 . Lengths
are in metres, rotations in degrees; the vertices of a polyline can also be the name of a file of points.

\b
{shape_help()}

A .csv file has a line x,y,z or x,y,z,amplitude for each point; a .txt or .xyz file has spaces instead of commas.
A .json file is {{"positions": [[x, y, z], ...], "amplitudes": [...]}}. Coordinates are in metres from the middle of the
array, z up; amplitudes are relative, 0 makes a null.""",
)
def solve_command(
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help=f"A shape, or a file of points: {', '.join(POINT_FILES)}.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The .npz file to write.")],
    spacing: Annotated[
        float | None,
        typer.Option(
            help="Distance between a shape's control points along its arc, in m; by default "
            f"{SPACING:g}, or as many points as the paper's Figure 6 has."
        ),
    ] = None,
    method: Annotated[str, typer.Option(help=f"Solver: {', '.join(sorted(METHODS))}.")] = "tikhonov",
    columns: Annotated[int, typer.Option(help="Transducers along x.")] = COLUMNS,
    rows: Annotated[int, typer.Option(help="Transducers along y.")] = ROWS,
    pitch: Annotated[float, typer.Option(help="Distance between transducers, in m.")] = PITCH,
    temperature: Annotated[float, typer.Option(help="Of the air, in °C.")] = 20.0,
    json_target: JsonOption = None,
) -> None:
    """Find the drives that make a shape (the help text above is built from the shapes)."""
    if output.suffix.lower() != ".npz":
        raise ValueError(f"{output}: the name of a solved file ends in .npz")
    check_outputs([output, json_target], inputs=files_in(source))
    points = read_source(source, spacing)
    array = TransducerArray.grid(columns, rows, pitch)
    started = perf_counter()
    solution = solve(array, points, method, medium=Medium(temperature))
    milliseconds = (perf_counter() - started) * 1e3
    reached = np.abs(pressure(array, solution.drive, points.positions, solution.medium))
    save_solution(output, solution)
    console_for(json_target).print(
        f"{len(points)} control points, {len(array)} transducers, {method} in {milliseconds:.1f} ms: "
        f"{reached.min():.0f} to {reached.max():.0f} Pa (peak) at the points. Written to {output}.",
    )
    write_json(
        json_target,
        {
            "file": str(output),
            "method": method,
            "control_points": len(points),
            "transducers": len(array),
            "milliseconds": milliseconds,
            "pressure_pa": reached.tolist(),
        },
    )


@commands.command()
def field(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A solved file.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="The .png, .svg, .pdf or .npz file to write."),
    ],
    height: Annotated[
        float | None,
        typer.Option(help="Of the plane above the array, in m; the mean of the points by default."),
    ] = None,
    extent: Annotated[float, typer.Option(help="Side of the square plane, in m.")] = 0.2,
    step: Annotated[float, typer.Option(help="Distance between samples, in m.")] = 1e-3,
    json_target: JsonOption = None,
) -> None:
    """Compute the pressure of a solved file over a horizontal plane, as a picture or as numbers.

    An .npz file holds x, y and height in metres and the complex peak pressure in Pa.
    """
    as_numbers = output.suffix.lower() == ".npz"
    if not as_numbers:
        check_picture_path(output)
    check_outputs([output, json_target], inputs=[file])
    solution = load_solution(file)
    level = float(solution.points.positions[:, 2].mean()) if height is None else height
    with error_console().status("computing the field"):
        plane = sample_plane(solution.array, solution.drive, level, extent, step, solution.medium)
    if as_numbers:
        save_field(output, plane)
    else:
        save_field_picture(output, plane, solution.points)
    magnitude = np.abs(plane.pressure)
    row, column = np.unravel_index(int(magnitude.argmax()), magnitude.shape)
    strongest = {"pa": float(magnitude.max()), "x_m": float(plane.x[column]), "y_m": float(plane.y[row])}
    console_for(json_target).print(
        f"{plane.pressure.size} samples at z = {level:g} m; strongest {strongest['pa']:.0f} Pa (peak, linear model) at "
        f"x = {strongest['x_m'] * 1e3:.1f} mm, y = {strongest['y_m'] * 1e3:.1f} mm. Written to {output}.",
    )
    write_json(
        json_target,
        {"file": str(output), "height_m": level, "samples": plane.pressure.size, "strongest": strongest},
    )
