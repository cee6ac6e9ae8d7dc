from __future__ import annotations

import dataclasses
import math
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Circle, ControlPoints, Sphere
from phasewire.base.errors import InputFileError
from phasewire.solver.shapes.shapes import (
    SHAPES,
    Asterisk,
    Concentric,
    Drawn,
    Polygon,
    Polyline,
    Rings,
    Star,
    parse_shape,
    shape_help,
)
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation


@given(st.floats(0.01, 0.2), st.floats(0.1, 0.5), st.floats(-0.99, 0.99))
def test_samples_lie_on_the_sphere_and_on_the_palm(radius: float, height: float, share: float) -> None:
    sphere = Sphere(radius, height, height + share * radius, x=0.01, y=-0.02) if height + share * radius > 0 else None
    if sphere is None:
        return
    positions = sphere.sample().positions
    np.testing.assert_allclose(np.linalg.norm(positions - [0.01, -0.02, height], axis=1), radius, rtol=1e-9)
    np.testing.assert_allclose(positions[:, 2], sphere.palm)


def test_a_circle_is_sampled_evenly_about_every_15_mm() -> None:
    """A circumference of 251.3 mm holds 16.76 steps of 15 mm; 17 points are the nearest."""
    positions = Circle(0.04, 0.2).sample(0.015).positions
    assert len(positions) == 17
    steps = np.linalg.norm(np.roll(positions, -1, axis=0) - positions, axis=1)
    np.testing.assert_allclose(steps, 2 * 0.04 * math.sin(math.pi / 17))


PLACES = st.tuples(*[st.floats(-0.1, 0.1)] * 3)


@pytest.mark.parametrize("shape", [Circle(x=0.02), Star(rotation=20), Rings(), Polyline()])
@given(offset=PLACES, degrees=st.floats(-360, 360), factor=st.floats(0.5, 2))
def test_copies_elsewhere_have_their_points_there(
    shape: Drawn, offset: tuple[float, float, float], degrees: float, factor: float
) -> None:
    """As scipy turns them; larger copies have their points as far apart as was asked for."""
    points, spacing = shape.sample(0.005), 0.005
    np.testing.assert_allclose(shape.moved(offset).sample(spacing).positions, points.positions + offset, atol=1e-12)
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0, 0.6, 0.8]))
    turned = shape.rotated(degrees, (0, 3, 4))
    np.testing.assert_allclose(
        turned.sample(spacing).positions, turn.apply(points.positions - shape.centre) + shape.centre, atol=1e-12
    )
    larger = turned.scaled(factor)
    np.testing.assert_allclose(larger.sample().centre, shape.centre, atol=0.003)  # with other numbers of points
    np.testing.assert_allclose(
        larger.sample(spacing * factor).positions - shape.centre,
        factor * (turned.sample(spacing).positions - shape.centre),
        atol=1e-12,
    )


def test_a_sum_has_the_points_of_its_parts_in_order_and_each_place_once() -> None:
    """Two squares with a common side; each keeps its default number of points."""
    left, point = Polygon(radius=0.02 * math.sqrt(2), x=-0.02), ControlPoints([[0, 0, 0.3]], 0.5)
    right = left.moved((0.04, 0, 0))
    pair = left + right
    both = pair.sample(0.01)
    assert len(both) == 16 + 16 - 5
    np.testing.assert_allclose(both.positions[:16], left.sample(0.01).positions)
    assert pdist(both.positions).min() == pytest.approx(0.01)
    for sum_, at in ((point + left, 0), (left + point, -1)):
        assert sum_.sample().amplitudes[at] == 0.5
        assert len(sum_.sample()) == len(left.sample()) + 1
    with_star = (left + Star()).moved((0, 0, 0.1))
    assert len(with_star.sample()) == len(left.sample()) + 30
    assert "Drawing" in repr(with_star)


def test_points_are_moved_and_added_with_their_amplitudes() -> None:
    points = ControlPoints([[0, 0, 0.2], [0.02, 0, 0.2]], [1, 0.5])
    more = points + points.scaled(2).rotated(90).moved((0, 0, 0.1))
    np.testing.assert_allclose(more.positions[2:], [[0.01, -0.02, 0.3], [0.01, 0.02, 0.3]], atol=1e-12)
    np.testing.assert_array_equal(more.amplitudes, [1, 0.5, 1, 0.5])
    np.testing.assert_array_equal(ControlPoints(points.positions, 0.3).amplitudes, [0.3, 0.3])
    assert points.sample(0.001) is points


def test_shapes_and_points_are_added_by_sum() -> None:
    parts: list[Any] = [Circle(), Circle().moved((0.1, 0, 0)), ControlPoints([[0, 0, 0.2]])]
    total: Any = sum(parts)
    np.testing.assert_array_equal(total.sample().positions, (parts[0] + parts[1] + parts[2]).sample().positions)
    points: Any = sum(parts[2:] * 3)
    assert len(points) == 3


def test_a_tiny_circle_is_one_point() -> None:
    assert len(Circle(1e-3).sample(0.015)) == 1


def test_the_notation_of_the_command_line() -> None:
    assert parse_shape("sphere") == Sphere()
    assert parse_shape("sphere:radius=0.04,palm=0.18") == Sphere(radius=0.04, palm=0.18)
    assert parse_shape("circle:x=-0.01") == Circle(x=-0.01)
    assert parse_shape("polygon:sides=5,rotation=-20") == Polygon(sides=5, rotation=-20.0)
    line = Polyline(((0, 0, 0.2), (0.01, -0.02, 0.2)), closed=True)
    assert parse_shape("polyline:vertices=0:0:0.2/1e-2:-0.02:0.2,closed=yes") == line


def test_a_polyline_s_vertices_come_from_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("line.txt").write_text("0 0 0.2\n0.01 0 0.2\n")
    assert parse_shape("polyline:vertices=line.txt") == Polyline(((0, 0, 0.2), (0.01, 0, 0.2)))
    Path("loud.csv").write_text("0,0,0.2,2\n0.01,0,0.2,1\n")
    with pytest.raises(ValueError, match=r"^loud\.csv: the vertices of a line have no amplitudes"):
        parse_shape("polyline:vertices=loud.csv")
    Path("bad.txt").write_text("0 0\n")
    with pytest.raises(InputFileError, match=r"^bad\.txt: line 1: '0 0' is not x y z"):
        parse_shape("polyline:vertices=bad.txt")


def test_the_help_of_shapes_can_be_parsed() -> None:
    assert [parse_shape(line) for line in shape_help().splitlines()] == [shape() for shape in SHAPES.values()]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cube", "unknown shape 'cube'; known are asterisk, circle, concentric, poly"),
        ("circle:size=1", "circle has no parameter 'size'; it has height, radius, x, y"),
        ("circle:radius=big", "circle radius 'big' is not a number of metres"),
        ("circle:radius", "circle radius '' is not a number"),
        ("circle:radius=-1", "circle radius -1.0 m must be positive and at most 5 m"),
        ("circle:radius=20", "circle radius 20.0 m must be positive and at most 5 m"),
        ("polygon:sides=4.5", "polygon sides '4.5' is not a whole number"),
        ("polygon:sides=2", "polygon sides 2 must be a whole number from 3 to 4096"),
        ("polygon:sides=5000", "polygon sides 5000 must be"),
        ("polygon:rotation=up", "polygon rotation 'up' is not a number of degrees"),
        ("star:rotation=400", "star rotation 400.0 degrees must be from -360 to 360 degrees"),
        ("star:radius=0", "star radius 0.0 m must be positive"),
        ("asterisk:height=0", "asterisk height 0.0 m must be positive"),
        ("concentric:inner=0.05", "concentric inner 0.05 m must be less than outer 0.045 m"),
        ("rings:distance=0.064", "rings of radius 0.032 m do not intersect at a distance of 0.064 m"),
        ("polyline:closed=1", "polyline closed '1' is not yes or no"),
        ("polyline:vertices=0:0:0.2/up", "polyline vertices '0:0:0.2/up' is not x:y:z/x:y:z"),
        ("polyline:vertices=0:0/0:1", r"polyline corners must have the shape \(m, 3\)"),
        ("polyline:vertices=0:0:0.2", r"all of whose corners lie at \[0.0, 0.0, 0.2\] m has no length"),
        ("polyline:vertices=0:0:0.2/0:nan:0.2", "polyline corner 1 is .*nan"),
        ("sphere:palm=0.3", "a palm at 0.3 m misses the sphere, which spans 0.12 to 0.22 m"),
    ],
)
def test_bad_shapes_are_named(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_shape(text)


@pytest.mark.parametrize(
    ("spacing", "message"),
    [(0, "spacing 0 m must be"), (math.nan, "nan"), (1e-9, "at most 4096"), (5e-324, "at most 4096")],
)
def test_bad_spacings_are_named(spacing: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Circle().sample(spacing)
    with pytest.raises(ValueError, match=message):
        Asterisk().sample(spacing)


NUMBERS = st.floats() | st.floats(0.01, 0.5)


@given(st.data(), st.sampled_from(sorted(SHAPES)), st.none() | NUMBERS)
def test_any_numbers_make_points_or_a_clear_error(data: st.DataObject, name: str, spacing: float | None) -> None:
    values = {"float": NUMBERS, "int": st.integers(), "bool": st.sampled_from(["yes", "no"])}
    known = {field.name: values[field.type] for field in dataclasses.fields(SHAPES[name]) if field.type in values}
    parameters = data.draw(st.fixed_dictionaries({}, optional=known))
    text = f"{name}:" + ",".join(f"{key}={value}" for key, value in parameters.items())
    try:
        points = parse_shape(text).sample(spacing)
    except ValueError:
        return
    assert np.isfinite(points.positions).all()


FIGURE_6 = [(Rings(), 32), (Star(), 30), (Concentric(), 32), (Asterisk(), 21)]


@pytest.mark.parametrize(("shape", "count"), FIGURE_6, ids=lambda value: type(value).__name__)
def test_the_shapes_of_figure_6_have_its_points(shape: Drawn, count: int) -> None:
    """At any size, and each within a cube of 10 cm; a given spacing precedes the count."""
    positions = shape.sample().positions
    assert len(positions) == count
    assert np.ptp(positions, axis=0).max() <= 0.1 + 1e-9
    assert np.ptp(positions, axis=0).max() >= 0.08
    assert pdist(positions).min() > 5e-3
    name = type(shape).__name__.lower()
    size = "outer=0.02,inner=0.007" if name == "concentric" else "radius=0.02"
    assert len(parse_shape(f"{name}:{size}").sample()) == count
    assert len(shape.sample(0.004)) > 2 * count


def test_the_rings_have_16_points_each() -> None:
    positions = Rings(radius=0.03, distance=0.04, x=0.01, y=0.02).sample().positions
    for first, centre in ((0, 0.03), (16, -0.01)):
        offset = positions[first : first + 16] - [centre, 0.02, 0.2]
        np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 0.03)
        steps = np.linalg.norm(np.roll(offset, -1, axis=0) - offset, axis=1)
        np.testing.assert_allclose(steps, 2 * 0.03 * math.sin(math.pi / 16))


def test_rings_that_cross_in_a_sample_share_one_point() -> None:
    """The right ring meets the left one at acos(-distance/2/radius), here its fifth step of 22.5°, and once below."""
    positions = Rings(0.03, 2 * 0.03 * math.cos(math.radians(67.5))).sample().positions
    assert len(positions) == 30
    assert pdist(positions).min() > 5e-3


def test_the_circles_have_24_and_8_points_equally_spaced() -> None:
    positions = Concentric().sample().positions
    radii = np.linalg.norm(positions[:, :2], axis=1)
    np.testing.assert_allclose(radii, [0.045] * 24 + [0.015] * 8)
    angles = np.unwrap(np.arctan2(positions[:, 1], positions[:, 0]))
    np.testing.assert_allclose(np.diff(angles[:24]) * 0.045, np.diff(angles[24:])[0] * 0.015)


def test_the_star_is_a_pentagram_with_three_points_on_each_side() -> None:
    """The sides of a pentagram lie on the five lines that join every second tip; each line has four triples of them."""
    positions = Star(radius=0.04, rotation=10, x=0.01, y=-0.01).sample().positions - [0.01, -0.01, 0.2]
    angles = np.radians(100 + 72 * np.arange(5))
    tips = 0.04 * np.stack([np.cos(angles), np.sin(angles), np.zeros(5)], axis=1)
    for tip in tips:
        assert np.linalg.norm(positions - tip, axis=1).min() < 1e-12
    on_lines = 0
    for k in range(5):
        along = tips[(k + 2) % 5] - tips[k]
        across = np.abs(np.cross(along / np.linalg.norm(along), positions - tips[k])[:, 2])
        on_lines += int((across < 1e-12).sum())
    assert on_lines == 10 * 2 + 5 * 2 + 5 * 2  # inside a side once; tips and inner corners twice
    turned = positions @ np.array(
        [[math.cos(a := math.radians(72)), math.sin(a), 0], [-math.sin(a), math.cos(a), 0], [0, 0, 1]]
    )
    assert pdist(np.round(positions, 9)).min() > 5e-3
    assert all(np.linalg.norm(positions - point, axis=1).min() < 1e-12 for point in turned)


def test_the_asterisk_has_six_equal_arms_of_four_and_three_points() -> None:
    positions = Asterisk(radius=0.042, x=0.01).sample().positions - [0.01, 0, 0.2]
    radii = np.linalg.norm(positions, axis=1)
    arms = np.round(np.degrees(np.arctan2(positions[:, 1], positions[:, 0])), 6) % 360
    assert sorted(set(arms.tolist())) == [30, 90, 150, 210, 270, 330]
    for k, arm in enumerate((90, 150, 210, 270, 330, 30)):
        np.testing.assert_allclose(radii[arms == arm], 0.042 - 0.012 * np.arange(3 if k % 2 else 4))
    assert pdist(positions).min() == pytest.approx(0.006 * math.sqrt(3))  # the triangle around the centre


@given(st.integers(3, 12), st.floats(0.03, 0.06), st.floats(-360, 360), st.floats(0.002, 0.02))
def test_a_polygon_is_as_symmetric_as_its_points(sides: int, radius: float, rotation: float, spacing: float) -> None:
    positions = Polygon(sides, radius, rotation, x=0.01).sample(spacing).positions[:, :2] - [0.01, 0]
    assert len(positions) % sides == 0
    complex_plane = positions[:, 0] + 1j * positions[:, 1]
    turned = complex_plane * np.exp(2j * np.pi / sides)
    assert np.abs(turned[:, None] - complex_plane).min(axis=1).max() < 1e-12
    assert np.isclose(np.abs(complex_plane), radius).sum() == sides  # the corners
    apothem = radius * math.cos(math.pi / sides)
    outwards = np.radians(rotation - 90 + 360 / sides * np.arange(sides))
    reach = positions @ np.stack([np.cos(outwards), np.sin(outwards)])
    np.testing.assert_allclose(reach.max(axis=1), apothem)  # on a side, and the first side faces -y


def walk(vertices: list[list[float]], step: float, count: int) -> list[list[float]]:
    """Points every ``step`` along straight pieces, by walking: the literal version of sampling by arc length."""
    points, at, piece = [vertices[0]], list(vertices[0]), 1
    for _ in range(count - 1):
        left = step
        while piece < len(vertices) - 1 and math.dist(at, vertices[piece]) <= left:
            left -= math.dist(at, vertices[piece])
            at, piece = list(vertices[piece]), piece + 1
        share = left / math.dist(at, vertices[piece])
        at = [a + share * (b - a) for a, b in zip(at, vertices[piece], strict=True)]
        points.append(at)
    return points


CORNER = st.tuples(st.integers(-50, 50), st.integers(-50, 50), st.integers(100, 300))


@given(st.lists(CORNER, min_size=2, max_size=8, unique=True), st.booleans(), st.floats(0.003, 0.05))
def test_polylines_are_sampled_by_arc_length(corners: list[tuple[int, int, int]], closed: bool, spacing: float) -> None:
    """Both ends of an open one; whole numbers of steps, the nearest to the spacing."""
    vertices = [[value / 1000 for value in corner] for corner in corners]
    line = [*vertices, vertices[0]] if closed else vertices
    length = sum(math.dist(a, b) for a, b in pairwise(line))
    steps = round(length / spacing)
    if steps == 0:
        expected = vertices[:1] if closed else walk(line, length / 2, 2)[1:]
    else:
        expected = walk(line, length / steps, steps if closed else steps + 1)
    kept: list[list[float]] = []
    for point in expected:
        if all(math.dist(point, other) > 1e-3 * spacing for other in kept):
            kept.append(point)
    positions = Polyline(tuple(map(tuple, vertices)), closed).sample(spacing).positions
    np.testing.assert_allclose(positions, kept, atol=1e-9)


def test_repeated_corners_add_nothing() -> None:
    once, twice = (Polyline(((0, 0, 0.2),) * n + ((0.03, 0, 0.2),) * n).sample().positions for n in (1, 2))
    np.testing.assert_array_equal(once, twice)
    np.testing.assert_allclose(once[:, 0], [0, 0.015, 0.03])


@given(st.text())
def test_any_text_is_a_shape_or_a_clear_error(text: str) -> None:
    for notation in (text, f"circle:{text}", f"polygon:sides={text}", f"polyline:vertices={text}"):
        with suppress(ValueError):
            parse_shape(notation)
