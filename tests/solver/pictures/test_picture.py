from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from phasewire import ControlPoints, Medium, TransducerArray
from phasewire.solver.fields.drawing import _lit, draw_oil
from phasewire.solver.fields.field import PlaneField, sample_cut
from phasewire.solver.fields.grid import Grid
from phasewire.solver.fields.quantities import intensity
from phasewire.solver.methods.solve import Wanted
from phasewire.solver.pictures.picture import save_field_picture

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


@pytest.mark.parametrize("quantity", ["pressure", "oil"])
def test_options_go_to_matplotlib(quantity: str) -> None:
    axes = drawn(LYING, quantity=quantity, title="Mine", cmap="gray", vmax=0.5)
    (image,) = axes.images
    assert (axes.get_title(), image.get_cmap().name, image.get_clim()) == ("Mine", "gray", (0, 0.5))


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


def test_a_quantity_is_drawn_in_its_unit() -> None:
    axes = drawn(LYING, quantity="intensity")
    field = field_over(LYING)
    np.testing.assert_allclose(np.asarray(axes.images[0].get_array()), intensity(field.pressure, field.medium))
    assert axes.images[0].colorbar is not None
    assert axes.images[0].colorbar.ax.get_ylabel() == "I / W/m² (mean)"


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


def test_unknown_quantities_are_named() -> None:
    with pytest.raises(ValueError, match="unknown quantity 'taste'; known are pressure, intensity, radiation"):
        drawn(LYING, quantity="taste")


def test_light_from_the_upper_left_falls_on_a_dimple_s_lower_right() -> None:
    """In a picture whose rows go up."""
    axis = np.linspace(-2, 2, 41)
    lit = _lit(-np.exp(-(axis**2) - axis[:, None] ** 2))
    upper_left, lower_right, flat = lit[27, 13], lit[13, 27], lit[0, 0]
    assert upper_left < 0.6 * flat < flat < 0.7 * lower_right
    assert 0 <= lit.min() <= lit.max() <= 1
    np.testing.assert_allclose(lit, lit[::-1, ::-1].T, atol=1e-12)


def test_the_relief_is_the_same_however_deep() -> None:
    heights = np.random.default_rng(1).normal(size=(9, 9))
    np.testing.assert_allclose(_lit(1e-6 * heights), _lit(heights), atol=1e-12)


def test_a_picture_of_oil_states_its_depth() -> None:
    axes = Figure().subplots()
    draw_oil(axes, field_over(LYING))
    assert axes.get_title().startswith("Oil 10 cm above the array: deepest dimple ")
    assert to_rgb(axes.images[0].get_cmap()(0.0)) != to_rgb(axes.images[0].get_cmap()(1.0))


@pytest.mark.parametrize("quantity", ["pressure", "radiation", "oil"])
@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml")])
def test_pictures_are_written(tmp_path: Path, quantity: str, suffix: str, magic: bytes) -> None:
    path = tmp_path / f"p{suffix}"
    save_field_picture(path, field_over(LYING), ControlPoints([[0, 0, 0.1]]), quantity)
    assert path.read_bytes().startswith(magic)
