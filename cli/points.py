"""What a command solves for: control points, from a shape's notation or a file, and an array. It imports no host."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ..base.errors import InputFileError
from ..base.storage import standard_input
from ..solver.acoustics.array import TransducerArray
from ..solver.acoustics.array_files import read_transducers
from ..solver.rendering.outline import Outline
from ..solver.shapes.point_files import POINT_FILES, read_points
from ..solver.shapes.points import ControlPoints
from ..solver.shapes.shapes import SHAPES, known_shapes, parse_shape

__all__ = [
    "ARCHIVE",
    "ArrayOption",
    "SourceKind",
    "files_in",
    "kind_of",
    "load_array",
    "read_outline",
    "read_source",
    "shapes_and_files",
    "spoken",
    "typed",
]

MOST_LINE = 2**20
"""Characters, enough for ten thousand points."""

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


class SourceKind(Enum):
    """What a SOURCE is, and the words for it."""

    SHAPE = "a shape"
    POINTS = "a file of points"
    STANDARD_INPUT = "standard input"
    ARCHIVE = "a file of frames"
    RECORDING = "a recording"


STANDARD_INPUT, ARCHIVE, RECORDING = "-", ".npz", ".frames"


def kind_of(source: str) -> SourceKind:
    """What a SOURCE of a command line is, by its name alone.

    Raises
    ------
    ValueError
        If it is nothing that a command can take; shapes with a similar name are named.
    """
    name, suffix = source.partition(":")[0], Path(source).suffix.lower()
    if source == STANDARD_INPUT:
        return SourceKind.STANDARD_INPUT
    if name in SHAPES:
        return SourceKind.SHAPE
    if suffix in POINT_FILES:
        return SourceKind.POINTS
    if suffix in (ARCHIVE, RECORDING):
        return SourceKind.ARCHIVE if suffix == ARCHIVE else SourceKind.RECORDING
    from ..solver.contact.solids import SOLIDS  # only this error needs them
    from ..solver.objects.mesh_files import MESH_FILES

    if name in SOLIDS or Path(name).suffix.lower() in MESH_FILES:
        raise ValueError(f"{source!r} is no shape or file of points; it is an object for `phasewire touch`")
    raise ValueError(
        f"{source!r} is neither a shape nor a file of points ({', '.join(POINT_FILES)}) or frames "
        f"({ARCHIVE}, {RECORDING}); shapes: {known_shapes(name)}"
    )


def read_source(source: str, spacing: float | None = None) -> ControlPoints:
    """Control points from a shape's notation, from a file of points, or from the first line of standard input."""
    match kind_of(source):
        case SourceKind.SHAPE:
            return parse_shape(source).sample(spacing)
        case SourceKind.POINTS:
            return read_points(Path(source))
        case SourceKind.STANDARD_INPUT:
            points = next(spoken(typed()), None)
            if points is None:
                raise InputFileError("standard input ended without a line of points")
            return points
        case kind:
            raise ValueError(
                f"{source} is {kind.value}, but this command takes points; `phasewire stream {shlex.quote(source)}` "
                "plays it"
            )


def typed() -> Iterator[str]:
    """The lines of standard input, those that are too long in pieces; `InputFileError` if it is closed."""
    stream = standard_input()
    return iter(lambda: stream.readline(MOST_LINE + 1), "")


def spoken(lines: Iterable[str]) -> Iterator[ControlPoints]:
    """Control points from lines of JSON, ``{"positions": [[x, y, z], …], "amplitudes": […]}``, one frame each.

    Raises
    ------
    InputFileError
        If a line is anything else; it is named.
    """
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            if len(line) > MOST_LINE:
                raise ValueError(f"it has more than {MOST_LINE} characters")
            read = json.loads(line)
            if not isinstance(read, dict) or not {"positions"} <= set(read) <= {"positions", "amplitudes"}:
                raise ValueError('it must be {"positions": [[x, y, z], ...], "amplitudes": [...]}')
            yield ControlPoints(read["positions"], read.get("amplitudes"))
        except (ValueError, TypeError, RecursionError) as error:
            raise InputFileError(f"standard input, line {number}: {error}") from error


def read_outline(source: str) -> Outline:
    """The outline of a shape in its notation, or of points."""
    return Outline.of(parse_shape(source) if kind_of(source) is SourceKind.SHAPE else read_source(source))


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
