"""Writing pictures: the file's suffix gives the format, and a file is written completely or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .storage import FilePath, replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FORMATS", "check_picture_path", "save_figure"]

FORMATS = (".png", ".svg", ".pdf")


def check_picture_path(path: FilePath) -> None:
    """Raise `ValueError` if a path does not end in the name of a picture format."""
    if Path(path).suffix.lower() not in FORMATS:
        raise ValueError(f"{path}: a picture's name ends in {', '.join(FORMATS)}")


def save_figure(figure: Figure, path: FilePath) -> None:
    """Write a figure in the format of the path's suffix, completely or not at all."""
    with replacing(path) as part:
        figure.savefig(part, format=Path(path).suffix[1:].lower(), dpi=120)
