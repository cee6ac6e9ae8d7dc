from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from phasewire import ControlPoints, TransducerArray
from phasewire.solver.shapes.points import check_reachable, reachable


@pytest.mark.parametrize(
    ("positions", "amplitudes", "message"),
    [
        ([[0, 0, 0.2]] * 2, [1, -0.5], "amplitude -0.5 of control point 1 must be finite and not negative"),
        ([[0, 0, 0.2]], [1, 1], r"amplitudes have the shape \(2,\), but there are 1 control points"),
        ([[0, 0, 0.2]], [0], "every control point has amplitude 0"),
        ([[0, 0, 0.2]] * 2, [1e-310, 0], "the largest amplitude is 1e-310; it must be at least 1e-300"),
        ([], None, "m of at least 1"),
        ([[0, 0]], None, r"shape \(m, 3\)"),
    ],
)
def test_bad_points_are_named(positions: list[list[float]], amplitudes: list[float] | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ControlPoints(positions, amplitudes)


@given(
    positions=arrays(float, st.tuples(st.integers(1, 6), st.just(3)), elements=st.floats(-3, 3)),
    tilted=st.booleans(),
    dead=st.booleans(),
)
@settings(deadline=None)
def test_a_point_is_reachable_if_it_passes_the_check(positions: np.ndarray, tilted: bool, dead: bool) -> None:
    flat = TransducerArray.grid(4, 3)
    normals = [[0.6, 0, 0.8]] * 6 + [[0, 0, 1]] * 6 if tilted else flat.normals
    limits = np.ones(12)
    limits[:5] = 0 if dead else 1
    array = TransducerArray(flat.positions, normals, limits=limits)
    positions[::2] /= 10
    passed = []
    for position in positions:
        try:
            check_reachable(array, ControlPoints([position]))
            passed.append(True)
        except ValueError:
            passed.append(False)
    assert reachable(array, positions).tolist() == passed
