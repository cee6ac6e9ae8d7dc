from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from phasewire import Hand, Mesh, TransducerArray, touch
from phasewire.hil.loop import touch_picture
from phasewire.hil.loop.touch_picture import MARGIN, outline, plane_of, save_touch_picture
from phasewire.solver import Modulation, pressure, two_sided


def length(lines: np.ndarray) -> float:
    return float(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum())


def test_the_outline_of_a_cube_is_its_twelve_edges_and_three_of_them_are_hidden() -> None:
    seen, hidden = outline(Mesh.cube(), np.array([1.0, 2.0, 3.0]) / np.sqrt(14))
    assert (len(seen), len(hidden)) == (9, 3)  # no diagonal of a face
    np.testing.assert_allclose([length(seen), length(hidden)], [0.9, 0.3])
    assert hidden.min(axis=1).min(axis=0) == pytest.approx([-0.05, -0.05, 0.12])


@given(
    st.floats(0, 1.2), st.floats(0, 6.3), st.lists(st.tuples(*[st.floats(-0.05, 0.05)] * 2), min_size=1, max_size=20)
)
def test_the_plane_is_that_of_the_points_and_shows_them(
    tilt: float, turn: float, places: list[tuple[float, float]]
) -> None:
    normal = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    first = np.array([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), -np.sin(tilt)])
    points = np.array([0, 0, 0.25]) + np.array(places) @ np.array([first, np.cross(normal, first)])
    grid = plane_of(points, 0.0)
    inside = (points - grid.centre) @ grid.axes.T
    assert np.abs((points - grid.centre) @ grid.normal).max() < 1e-5
    assert np.abs(inside).max() <= grid.offsets(0)[-1] - MARGIN + 2e-3
    assert grid.positions()[..., 2].min() > 0.02 - 1e-9
    assert grid.normal[2] >= -1e-9


@pytest.mark.parametrize(
    ("points", "normal"),
    [
        ([[0.01, 0.02, 0.2]], [0, 0, 1]),
        ([[-0.03, 0, 0.2], [0.03, 0, 0.2]], [0, 0, 1]),
        ([[0, 0, 0.1], [0, 0, 0.2]], None),
        ([[0.01, 0, 0.17], [0.02, 0, 0.18]], [-np.sqrt(0.5), 0, np.sqrt(0.5)]),
    ],
    ids=["a point", "a level line", "an upright line", "a sloping line"],
)
def test_few_points_get_the_most_level_plane(points: list[list[float]], normal: list[float] | None) -> None:
    grid = plane_of(np.array(points), 0.0)
    if normal is not None:
        np.testing.assert_allclose(grid.normal, normal, atol=1e-9)
    assert np.abs((np.array(points) - grid.centre) @ grid.normal).max() < 1e-9


def test_a_plane_near_the_array_ends_above_it() -> None:
    points = np.array([[0, 0, 0.03], [0, 0.001, 0.09], [0, -0.05, 0.05]])
    grid = plane_of(points, 0.0)
    assert grid.positions()[..., 2].min() >= 0.02 - 1e-9


def scene() -> tuple[Hand, Mesh]:
    return Hand.flat((0, -0.02, 0.19)), Mesh.cube()


@pytest.fixture(scope="module")
def emitted(array: TransducerArray) -> Modulation:
    points = touch(*scene()).points
    assert points is not None
    return two_sided(array, points).modulation


def test_the_picture_shows_points_where_they_are_and_the_field_that_is_emitted(
    array: TransducerArray, emitted: Modulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(touch_picture, "save_figure", lambda figure, path: figures.append(figure))
    hand, cube = scene()
    felt = touch(hand, cube)
    assert felt.points is not None
    save_touch_picture(tmp_path / "p.png", [hand], [cube], felt, emitted, array, "what was said")
    (figure,) = figures
    space: Any = figure.subfigs[0].axes[0]
    plane = figure.subfigs[1].axes[0]
    assert (space.get_xlabel(), space.get_ylabel(), space.get_zlabel()) == ("x / mm", "y / mm", "z / mm")
    shown = [np.stack(dots._offsets3d, axis=1) for dots in space.collections if "half" in str(dots.get_label())]
    drawn = np.concatenate(shown)
    wanted = felt.points.positions * 1000
    np.testing.assert_allclose(drawn[np.lexsort(drawn.T)], wanted[np.lexsort(wanted.T)])
    grid = plane_of(felt.points.positions, 0.0)
    (image,) = plane.images
    halves = [pressure(array, drive, grid.positions()[3, 7][None])[0] for drive in emitted.weights @ emitted.drives]
    assert np.asarray(image.get_array())[3, 7] == pytest.approx(np.abs(halves).max(), rel=1e-3)
    assert any("drives rebuilt from what was said" in text.get_text() for text in figure.texts)


def test_without_a_touch_there_is_nothing_to_draw(array: TransducerArray, emitted: Modulation, tmp_path: Path) -> None:
    away = Hand.flat((0, 0, 0.4))
    with pytest.raises(ValueError, match="no hand touches an object"):
        save_touch_picture(tmp_path / "p.png", [away], [Mesh.cube()], touch(away, Mesh.cube()), emitted, array, "")
    assert not (tmp_path / "p.png").exists()
