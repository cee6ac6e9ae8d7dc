"""Outlines: lengths, strokes and walks against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Circle, ControlPoints, Hand, Mesh, Polygon, Polyline, touch
from phasewire.solver.rendering.outline import Outline

SQUARE = Polygon(sides=4, radius=0.03)
SIDE = 0.03 * np.sqrt(2)
LINE = Polyline(vertices=((0.0, 0.0, 0.2), (0.04, 0.0, 0.2)))


def test_control_points_make_strokes_where_they_are_near_each_other() -> None:
    circle = Circle(radius=0.03, x=-0.04).sample(0.01) + Circle(radius=0.03, x=0.04).sample(0.01)
    strokes = Outline.of(circle).strokes
    assert [len(stroke) for stroke in strokes] == [20, 20]
    assert all((stroke[0] == stroke[-1]).all() for stroke in strokes)
    apart = Outline.of(ControlPoints([[-0.05, 0, 0.2], [0.05, 0, 0.2]]))
    assert [len(stroke) for stroke in apart.strokes] == [1, 1]
    assert (apart.tangents == [1, 0, 0]).all()


def test_tangents_lie_along_the_line() -> None:
    outline = Outline.of(Circle(radius=0.03))
    radial = outline.points.positions - [0, 0, 0.2]
    assert np.linalg.norm(outline.tangents, axis=1) == pytest.approx(1)
    assert np.abs(np.einsum("mi,mi->m", outline.tangents, radial)).max() < 0.03 * 0.05


@given(st.integers(20, 300), st.floats(0.1, 10))
def test_a_walk_keeps_its_speed(count: int, speed: float) -> None:
    outline = Outline.of(Circle(radius=0.03))
    places = outline.walk(count, speed)
    steps = np.linalg.norm(np.diff(np.concatenate([places, places[:1]]), axis=0), axis=1)
    chord = 2 * 0.03 * np.sin(np.pi / count)
    assert steps == pytest.approx(chord, rel=0.01)
    assert outline.round_trip(speed) == pytest.approx(2 * np.pi * 0.03 / speed, rel=1e-3)


def test_a_walk_rests_at_each_corner() -> None:
    outline = Outline.of(SQUARE)
    whole, pause = outline.round_trip(0.1, 0.3), 0.3
    assert whole == pytest.approx(4 * SIDE / 0.1 + 4 * pause)
    places = outline.walk(10_000, 0.1, pause)
    corners = SQUARE.curves()[0].at(SIDE * np.arange(4))
    for corner in corners:
        rests = (np.linalg.norm(places - corner, axis=1) < 1e-9).mean() * whole
        assert rests == pytest.approx(pause, abs=0.01)


def test_an_open_line_is_walked_to_and_fro() -> None:
    places = Outline.of(LINE).walk(8, 1.0)
    assert places[:, 0] == pytest.approx([0.005, 0.015, 0.025, 0.035, 0.035, 0.025, 0.015, 0.005])
    assert Outline.of(LINE).round_trip(1.0) == pytest.approx(0.08)


def test_the_outline_of_a_touch_has_its_arcs_and_identities() -> None:
    felt = touch(Hand.flat((0, 0, 0.17)), Mesh.sphere())
    outline = Outline.of(felt)
    assert len(outline.strokes) == len(felt.arcs)
    assert outline.ids is not None
    assert (outline.ids == felt.ids).all()
    assert np.isfinite(outline.walk(50, 1.0, 0.01)).all()
    with pytest.raises(ValueError, match="touch nothing"):
        Outline.of(touch(Hand.flat((0, 0, 0.6)), Mesh.sphere()))


@given(st.integers(3, 9), st.floats(0.005, 0.06))
def test_a_polygon_has_as_many_corners_as_sides(sides: int, radius: float) -> None:
    """Its samples may fall on corners, but not beside them."""
    outline = Outline.of(Polygon(sides=sides, radius=radius))
    assert outline.round_trip(1.0, 1.0) == pytest.approx(outline.length + sides, abs=1e-6)


def test_vertices_that_repeat_are_no_corners() -> None:
    points = ControlPoints([[0, 0, 0.2], [0, 0, 0.2], [0.01, 0, 0.2], [0.02, 0, 0.2]])
    assert Outline.of(points).round_trip(1.0, 1.0) == pytest.approx(0.04 + 2)


def test_a_point_that_is_felt_alone_is_visited() -> None:
    points = ControlPoints([[0.01 * step, 0, 0.2] for step in range(5)] + [[0, 0.08, 0.2]])
    places = Outline.of(points).walk(100, 1.0)
    alone = np.linalg.norm(places - [0, 0.08, 0.2], axis=1) < 1e-9
    assert alone.mean() == pytest.approx(0.005 / 0.045, abs=0.02)
