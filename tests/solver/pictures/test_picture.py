from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from phasewire import ControlPoints, Medium, TransducerArray
from phasewire.solver.fields.drawing import draw_oil
from phasewire.solver.fields.field import PlaneField, sample_cut
from phasewire.solver.fields.grid import Grid
from phasewire.solver.methods.solve import Wanted

SMALL = TransducerArray.grid(4, 3)
LYING = Grid.along("xy", (0, 0.01, 0.1), [0.06, 0.04], 5e-3)
STANDING = Grid.along("xz", (0, 0.01, 0.1), [0.06, 0.04], 5e-3)
OBLIQUE = Grid((0, 0, 0.1), [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]], (13, 9), 5e-3)


def field_over(grid: Grid) -> PlaneField:
    return sample_cut(SMALL, np.exp(1j * np.arange(12)), grid, Medium(25))


def drawn(grid: Grid, points: Wanted | None = None, quantity: str = "pressure", **style: Any) -> Axes:
    axes: Axes = Figure().subplots()
    field_over(grid).plot(axes, points=points, quantity=quantity, **style)
    return axes


@pytest.mark.parametrize(
    ("grid", "title", "labels", "extent"),
    [
        (LYING, "Pressure 10 cm above the array", ("x / mm", "y / mm"), (-32.5, 32.5, -12.5, 32.5)),
        (STANDING, "Pressure at y = 10 mm", ("x / mm", "z / mm"), (-32.5, 32.5, 77.5, 122.5)),
        (OBLIQUE, "Pressure on a plane through (0, 0, 100) mm", ("u / mm", "y / mm"), (-32.5, 32.5, -22.5, 22.5)),
    ],
)
def test_a_picture_is_titled_with_its_plane(
    grid: Grid, title: str, labels: tuple[str, str], extent: tuple[float, ...]
) -> None:
    axes = drawn(grid)
    assert (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) == (title, *labels)
    assert axes.images[0].get_extent() == pytest.approx(extent)


@pytest.mark.parametrize(
    ("grid", "point", "at"),
    [
        (LYING, (0.02, 0.005, 0.1), (20, 5)),
        (STANDING, (0.02, 0.01, 0.11), (20, 110)),
        (OBLIQUE, (0.006, 0.01, 0.108), (10, 10)),
    ],
)
def test_control_points_in_the_plane_are_marked(
    grid: Grid, point: tuple[float, float, float], at: tuple[float, float]
) -> None:
    away = np.array(point) + 2e-3 * grid.normal
    points = ControlPoints(np.array([point, away]))
    for wanted in (points, points.positions):
        (marks,) = drawn(grid, wanted).lines
        np.testing.assert_allclose(np.asarray(marks.get_xydata()), [at], atol=1e-9)


@pytest.mark.parametrize(("quantity", "half"), [("pressure", 10 ** (-6 / 20)), ("radiation", 10 ** (-6 / 10))])
def test_the_bar_has_decibels_too(quantity: str, half: float) -> None:
    image = drawn(LYING, quantity=quantity).images[0]
    assert image.colorbar is not None
    (levels,) = image.colorbar.ax.child_axes
    labels = [label.get_text() for label in levels.get_yticklabels()]
    largest = np.asarray(image.get_array()).max()
    assert levels.get_yticks()[labels.index("−6")] == pytest.approx(half * largest)
    assert levels.get_yticks()[labels.index("0")] == pytest.approx(largest)


def test_silence_can_be_drawn() -> None:
    silent = PlaneField(LYING, np.zeros(LYING.shape, complex), Medium())
    silent.plot(Figure().subplots())
    draw_oil(Figure().subplots(), silent)
