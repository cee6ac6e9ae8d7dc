"""Pictures of fields and arrays, drawn onto matplotlib axes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..storage import replacing
from .array import TransducerArray
from .field import PlaneField
from .points import ControlPoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["check_picture_path", "draw_array", "draw_field", "save_field_picture", "save_figure"]

FORMATS = (".png", ".svg", ".pdf")
MM = 1e3


def check_picture_path(path: Path) -> None:
    """Raise `ValueError` where a path does not end in the name of a picture format."""
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"{path}: a picture's name ends in {', '.join(FORMATS)}")


def draw_field(axes: Axes, field: PlaneField, points: ControlPoints | None = None) -> None:
    """Draw |p| in Pa over a plane, with the control points that lie in it."""
    half = (field.x[1] - field.x[0]) / 2
    low, high = (field.x[0] - half) * MM, (field.x[-1] + half) * MM
    image = axes.imshow(
        np.abs(field.pressure),
        origin="lower",
        extent=(low, high, low, high),
        cmap="inferno",
        interpolation="bilinear",
    )
    axes.figure.colorbar(image, ax=axes, label="|p| / Pa (peak)", fraction=0.046, pad=0.03)
    if points is not None:
        near = points.positions[np.abs(points.positions[:, 2] - field.height) < 1e-3]
        axes.plot(
            near[:, 0] * MM,
            near[:, 1] * MM,
            "o",
            mfc="none",
            mec="#7fdfff",
            ms=9,
            mew=1.0,
            label="control points",
        )
        axes.legend(loc="upper right", fontsize="small", framealpha=0.7)
        axes.set(xlim=(low, high), ylim=(low, high))
    axes.set(title=f"Pressure {field.height * 100:.3g} cm above the array", xlabel="x / mm", ylabel="y / mm")


def draw_array(axes: Axes, array: TransducerArray, drive: NDArray[np.complex128]) -> None:
    """Draw the transducers, coloured by phase; the area of a dot shows its magnitude."""
    x, y = array.positions[:, 0] * MM, array.positions[:, 1] * MM
    dots = axes.scatter(
        x,
        y,
        s=4 + 66 * np.abs(drive),
        c=np.degrees(np.angle(drive)),
        cmap="twilight_shifted",
        vmin=-180,
        vmax=180,
        edgecolors="0.5",
        linewidths=0.5,
    )
    axes.figure.colorbar(dots, ax=axes, label="phase / degrees", ticks=range(-180, 181, 90), fraction=0.046, pad=0.03)
    axes.set(title="Drive of the array", xlabel="x / mm", ylabel="y / mm", aspect="equal")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the path's suffix, whole or not at all."""
    with replacing(path) as part:
        figure.savefig(part, format=path.suffix[1:].lower(), dpi=120)


def save_field_picture(path: Path, field: PlaneField, points: ControlPoints) -> None:
    """Write a picture of a field."""
    from matplotlib.figure import Figure  # matplotlib takes as long to import as everything else together

    figure = Figure(figsize=(7, 6), layout="constrained")
    draw_field(figure.subplots(), field, points)
    save_figure(figure, path)
