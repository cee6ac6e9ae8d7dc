from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from phasewire import ControlPoints, Solution, TransducerArray, pressure, sample_plane, solve


def test_a_plane_holds_the_pressure_at_its_samples(sphere_solution: Solution) -> None:
    array, drive = sphere_solution.array, sphere_solution.drive
    plane = sample_plane(array, drive, 0.2, extent=0.1, step=0.01)
    assert plane.pressure.shape == (plane.y.size, plane.x.size) == (11, 11)
    for row, column in ((0, 0), (3, 8), (10, 5)):
        expected = pressure(array, drive, [[plane.x[column], plane.y[row], 0.2]])[0]
        assert plane.pressure[row, column] == pytest.approx(expected)


def test_the_step_is_kept_and_the_middle_is_sampled(array: TransducerArray) -> None:
    plane = sample_plane(array, np.ones(320), 0.2, extent=0.05, step=0.02)
    np.testing.assert_allclose(plane.x, [-0.02, 0, 0.02])
    with pytest.raises(ValueError, match="read-only"):
        plane.pressure[0, 0] = 0


def test_the_strongest_sample_is_at_the_focus(array: TransducerArray) -> None:
    focus = (0.02, -0.03)
    plane = sample_plane(array, solve(array, ControlPoints([[*focus, 0.2]])).drive, 0.2, step=2e-3)
    row, column = np.unravel_index(np.abs(plane.pressure).argmax(), plane.pressure.shape)
    assert (plane.x[column], plane.y[row]) == (pytest.approx(focus[0], abs=2e-3), pytest.approx(focus[1], abs=2e-3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"height": -0.1}, "height -0.1 m must be positive"),
        ({"height": 0.2, "extent": np.inf}, "extent inf m"),
        ({"height": 0.2, "step": 0}, "step 0 m"),
        ({"height": 0.2, "step": 5e-324}, "makes more than"),
        ({"height": 0.2, "extent": 1e200}, "makes more than"),
        ({"height": 0.2, "extent": 1e-3, "step": 1e-3}, "too long for a plane of 0.001 m"),
        ({"height": 1e300}, "coordinates are metres, at most 1000"),
        ({"height": 0.2, "step": 1e-6}, "makes more than 4000000 samples"),
    ],
)
def test_impossible_planes_are_named(array: TransducerArray, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sample_plane(array, np.ones(320), **arguments)


def test_too_many_samples_for_a_large_array_are_refused() -> None:
    large = TransducerArray.grid(100, 100, 1e-3)
    with pytest.raises(ValueError, match="10000 transducers are too many"):
        sample_plane(large, np.ones(10_000), 0.2, step=2e-4)
