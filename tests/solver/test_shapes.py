from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Circle, Sphere
from phasewire.solver.shapes import parse_shape, shape_help


def test_the_demo_s_sphere_is_cut_in_a_circle_of_4_cm() -> None:
    """5² = 3² + 4²."""
    cut = Sphere(radius=0.05, height=0.17, palm=0.20).cut()
    assert cut.radius == pytest.approx(0.04)
    assert cut.height == 0.20


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


def test_a_tiny_circle_is_one_point() -> None:
    assert len(Circle(1e-3).sample(0.015)) == 1


def test_the_notation_of_the_command_line() -> None:
    assert parse_shape("sphere") == Sphere()
    assert parse_shape("sphere:radius=0.04,palm=0.18") == Sphere(radius=0.04, palm=0.18)
    assert parse_shape("circle:x=-0.01") == Circle(x=-0.01)


def test_the_help_can_be_typed_back() -> None:
    assert [parse_shape(line) for line in shape_help().splitlines()] == [Circle(), Sphere()]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cube", "unknown shape 'cube'; known are circle, sphere"),
        ("circle:size=1", "circle has no parameter 'size'; it has height, radius, x, y"),
        ("circle:radius=big", "circle radius 'big' is not a number of metres"),
        ("circle:radius", "circle radius '' is not a number"),
        ("circle:radius=-1", "circle radius -1.0 m must be positive and at most 1000 m"),
        ("circle:x=nan", "circle x nan m must be at most 1000 m"),
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


NUMBERS = st.floats() | st.floats(0.01, 0.5)


@given(st.dictionaries(st.sampled_from(["radius", "height", "palm", "x", "y"]), NUMBERS), NUMBERS)
def test_any_numbers_make_points_or_a_clear_error(parameters: dict[str, float], spacing: float) -> None:
    text = "sphere:" + ",".join(f"{name}={value!r}" for name, value in parameters.items())
    try:
        points = parse_shape(text).sample(spacing)
    except ValueError:
        return
    assert np.isfinite(points.positions).all()


@given(st.text())
def test_any_text_is_a_shape_or_a_clear_error(text: str) -> None:
    for notation in (text, f"circle:{text}"):
        with suppress(ValueError):
            parse_shape(notation)
