"""Control points that a command takes: a shape's notation, or a file of points."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from ..solver.shapes.point_files import POINT_FILES, read_points
from ..solver.shapes.points import ControlPoints
from ..solver.shapes.shapes import SHAPES, parse_shape

__all__ = ["files_in", "read_source", "shapes_and_files"]


def read_source(source: str, spacing: float | None = None) -> ControlPoints:
    """Control points from a shape's notation or from a file of points."""
    if source.partition(":")[0] in SHAPES:
        return parse_shape(source).sample(spacing)
    if Path(source).suffix.lower() in POINT_FILES:
        return read_points(Path(source))
    raise ValueError(
        f"{source!r} is neither a shape ({', '.join(sorted(SHAPES))}) nor a file of points ({', '.join(POINT_FILES)})"
    )


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
