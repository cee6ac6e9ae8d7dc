"""What a command solves for: control points, from a shape's notation or a file, and an array. It imports no host."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated

import typer

from ..solver.acoustics.array import TransducerArray
from ..solver.acoustics.array_files import read_transducers
from ..solver.rendering.outline import Outline
from ..solver.shapes.point_files import POINT_FILES, read_points
from ..solver.shapes.points import ControlPoints
from ..solver.shapes.shapes import SHAPES, parse_shape

__all__ = ["ArrayOption", "files_in", "load_array", "read_outline", "read_source", "shapes_and_files"]

ArrayOption = Annotated[
    Path | None,
    typer.Option(
        "--array",
        metavar="FILE",
        help="A .csv or .toml file of the array's transducers (docs/how-to/any-array.md).",
    ),
]


def load_array(path: Path | None) -> TransducerArray | None:
    """The array in a file, None without one."""
    return None if path is None else read_transducers(path)


def read_source(source: str, spacing: float | None = None) -> ControlPoints:
    """Control points from a shape's notation or from a file of points."""
    if source.partition(":")[0] in SHAPES:
        return parse_shape(source).sample(spacing)
    if Path(source).suffix.lower() in POINT_FILES:
        return read_points(Path(source))
    from ..solver.contact.solids import SOLIDS  # only this error needs them
    from ..solver.objects.mesh_files import MESH_FILES

    name = source.partition(":")[0]
    is_object = name in SOLIDS or Path(name).suffix.lower() in MESH_FILES
    raise ValueError(
        f"{source!r} is neither a shape ({', '.join(sorted(SHAPES))}) nor a file of points ({', '.join(POINT_FILES)})"
        + "; it is an object for `phasewire touch`" * is_object
    )


def read_outline(source: str) -> Outline:
    """The outline of a shape in its notation, or of a file of points."""
    shape = source.partition(":")[0] in SHAPES
    return Outline.of(parse_shape(source) if shape else read_source(source))


def shapes_and_files(suffixes: Iterable[str]) -> Callable[[str], list[str]]:
    """What a shell offers for a source: shapes, and files that are here; it knows its way to others."""
    wanted = tuple(suffixes)

    def complete(incomplete: str) -> list[str]:
        files = sorted(path.name for path in Path().iterdir() if path.suffix.lower() in wanted)
        return [name for name in (*SHAPES, *files) if name.startswith(incomplete)]

    return complete


def files_in(source: str) -> list[Path]:
    """Every file that a source may be, or may name as a parameter of a shape."""
    return [
        Path(source),
        *(Path(item.partition("=")[2]) for item in source.partition(":")[2].split(",") if "=" in item),
    ]
