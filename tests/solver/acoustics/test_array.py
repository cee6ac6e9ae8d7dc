from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from phasewire import Transducer, TransducerArray


def test_the_default_grid_is_the_paper_s_array() -> None:
    array = TransducerArray.grid()
    assert len(array) == 320
    assert array.positions.shape == array.normals.shape == (320, 3)
    np.testing.assert_allclose(array.positions.mean(axis=0), 0, atol=1e-15)
    np.testing.assert_allclose(array.positions[1] - array.positions[0], [10.3e-3, 0, 0])
    np.testing.assert_allclose(array.positions[20] - array.positions[0], [0, 10.3e-3, 0], atol=1e-15)
    assert (array.normals == [0, 0, 1]).all()


@pytest.mark.parametrize(
    ("positions", "normals", "message"),
    [
        ([[0, 0, 0]], [[0, 0, 2]], "normal of transducer 0 has length 2"),
        ([[0, 0, 0]], [[0, 0, 1], [0, 0, 1]], "1 positions but 2 normals"),
        ([], [], "m of at least 1"),
        ([0, 0, 0], [0, 0, 1], r"shape \(m, 3\)"),
    ],
)
def test_impossible_arrays_are_refused(positions: list[float], normals: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TransducerArray(positions, normals)


def test_a_calibrated_array_keeps_everything_else() -> None:
    array = TransducerArray.grid(2, 2)
    real = array.calibrated([1, -1, 0.5j, 0], [1, 0.5, 0, 1])
    np.testing.assert_array_equal(real.positions, array.positions)
    np.testing.assert_array_equal(real.response, [1, -1, 0.5j, 0])
    np.testing.assert_array_equal(real.limits, [1, 0.5, 0, 1])
    again = real.calibrated([1, 1, 1, 1])
    np.testing.assert_array_equal(again.limits, real.limits)
    with pytest.raises(ValueError, match="read-only"):
        real.response[0] = 2


def test_an_array_is_turned_about_its_centre_and_moved() -> None:
    """A panel that faces the default one, 30 cm above it; a point of it goes where the hand would put it."""
    panel = TransducerArray.grid(4, 2)
    facing = panel.moved((0, 0, 0.3)).rotated(180, (1, 0, 0))
    np.testing.assert_allclose(facing.positions, panel.positions * [1, -1, 1] + [0, 0, 0.3], atol=1e-12)
    np.testing.assert_allclose(facing.normals, [[0, 0, -1]] * 8, atol=1e-12)


def test_joined_panels_stand_in_their_order() -> None:
    left, right = TransducerArray.grid(2, 1), TransducerArray.grid(1, 1).calibrated([-1], [0.5])
    joined = TransducerArray.joined([left, right])
    np.testing.assert_array_equal(joined.positions, np.vstack([left.positions, right.positions]))
    np.testing.assert_array_equal(joined.response, [1, 1, -1])
    np.testing.assert_array_equal(joined.limits, [1, 1, 0.5])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda a: a.calibrated([1, 1, 1]), r"responses have the shape \(3,\), but there are 4 transducers"),
        (lambda a: a.calibrated([1, 1, np.nan, 1]), "of transducer 2 must be 0 or have a gain from 1e-06 to 100"),
        (lambda a: a.calibrated([1, 1, 1, 101]), "of transducer 3 must be 0 or have a gain"),
        (lambda a: a.calibrated([1, 1e-7, 1, 1]), "response .* of transducer 1 must be 0 or have a gain"),
        (lambda a: a.calibrated([0, 0, 0, 0]), "every transducer has response 0, that is dead"),
        (lambda a: a.calibrated(["loud"] * 4), "responses \\(n,\\) must be numbers: they are text"),
        (lambda a: a.calibrated([1] * 4, [1, 1, 1, 1.1]), "limit 1.1 of transducer 3 must be 0 or lie between"),
        (lambda a: a.calibrated([1] * 4, [1, -0.1, 1, 1]), "limit -0.1 of transducer 1"),
        (lambda a: a.calibrated([1, 0, 0, 0], [0, 1, 1, 1]), "every working transducer has limit 0"),
        (lambda a: a.placed(np.eye(3) * 2, [0, 0, 0]), r"must be a \(3, 3\) rotation matrix"),
        (lambda a: a.placed(np.diag([1, 1, -1]), [0, 0, 0]), "rotation matrix"),
        (lambda a: a.placed(np.eye(2), [0, 0, 0]), "rotation matrix"),
        (lambda a: a.placed(np.eye(3), [0, 0]), r"translation \[0.0, 0.0\] must be three numbers of metres"),
        (lambda a: TransducerArray.joined([]), "at least one array"),
        (lambda a: TransducerArray.joined([a, a.rotated(180)]), "transducers 0 and 7 are both at .* m; each needs a p"),
        (
            lambda a: TransducerArray.joined([a, TransducerArray.grid(1, 1, transducer=Transducer(5e-3))]),
            "all of the same transducer",
        ),
    ],
)
def test_impossible_changes_are_named(make: Callable[[TransducerArray], Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(TransducerArray.grid(2, 2))
