from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from phasewire import ControlPoints
from phasewire.solver.methods.split import HOLD, KEEP, Split, _largest_eigenvalue, split
from phasewire.solver.shapes.shapes import parse_shape

DEGENERATE = ["polygon", "polygon:sides=3", "polygon:sides=6,rotation=10", "circle", "star", "concentric", "asterisk"]
SEEDS = st.integers(0, 2**32 - 1)


def cloud(rng: np.random.Generator, m: int) -> NDArray[np.float64]:
    """Points whose principal components are well apart, in any direction."""
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return np.asarray((rng.uniform(-1, 1, (m, 3)) * [0.06, 0.03, 0.02]) @ turn + [0.01, -0.02, 0.2])


def apart(positions: NDArray[np.float64]) -> bool:
    """Whether the first principal component is unmistakable and no point is within 1 mm of the median plane."""
    offset = positions - positions.mean(axis=0)
    _, sizes, directions = np.linalg.svd(offset)
    along = np.sort(offset @ directions[0])
    middle = len(along) // 2
    gaps = np.diff(along)[middle - 1 : middle + len(along) % 2]
    return bool(sizes[1] ** 2 < 0.9 * sizes[0] ** 2 and gaps.min() > 1e-3 and abs(directions[0, 0]) > 0.2)


def sides(mask: NDArray[np.bool_]) -> set[bytes]:
    """The split without a name for either half."""
    return {mask.tobytes(), (~mask).tobytes()}


@given(SEEDS, st.integers(2, 60))
def test_the_plane_is_the_median_of_the_first_principal_component(seed: int, m: int) -> None:
    """Compared with numpy's singular value decomposition; the first half lies towards -x and has the odd point."""
    positions = cloud(np.random.default_rng(seed), m)
    assume(apart(positions))
    offset = positions - positions.mean(axis=0)
    direction = np.linalg.svd(offset)[2][0]
    direction *= np.sign(direction[0])
    nearest = sorted(range(m), key=lambda i: float(offset[i] @ direction))[: (m + 1) // 2]
    result = split(ControlPoints(positions))
    assert np.flatnonzero(result.mask).tolist() == sorted(nearest)
    np.testing.assert_allclose(result.axis, direction, atol=1e-9)


@given(st.lists(st.tuples(*[st.floats(-0.1, 0.1)] * 3), min_size=1, max_size=40), SEEDS)
def test_halves_of_any_points_differ_by_at_most_one(positions: list[tuple[float, ...]], seed: int) -> None:
    """Repeated points, points on a line and points on a plane included, after any previous split."""
    points = ControlPoints(positions)
    before = split(ControlPoints(cloud(np.random.default_rng(seed), len(points))))
    for result in (split(points), split(points, before)):
        assert result.mask.sum() == (len(points) + 1) // 2
        assert np.linalg.norm(result.axis) == pytest.approx(1)


@pytest.mark.parametrize("name", [*DEGENERATE, "rings", "polyline", "sphere"])
def test_noise_of_a_tenth_of_a_millimetre_does_not_move_the_split(name: str) -> None:
    rng = np.random.default_rng(34)
    positions = parse_shape(name).sample().positions
    frames = [ControlPoints(positions + rng.normal(0, 1e-4, positions.shape)) for _ in range(200)]
    state = first = split(frames[0])
    for frame in frames[1:]:
        state = split(frame, state)
        np.testing.assert_array_equal(state.mask, first.mask)
        np.testing.assert_array_equal(state.axis, first.axis)


@pytest.mark.parametrize("name", ["polyline:vertices=-0.05:0:0.2/0.05:0:0.2", "rings", "polygon", "star"])
def test_the_axis_follows_a_shape_that_turns_and_never_turns_round(name: str) -> None:
    positions = parse_shape(name).sample().positions
    state, frames = None, []
    for angle in np.radians(np.arange(0, 720, 2)):
        c, s = np.cos(angle), np.sin(angle)
        turned = positions @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        state = split(ControlPoints(turned), state)
        frames.append(state)
        scatter = np.cov(turned.T)
        assert state.axis @ scatter @ state.axis >= (KEEP - 1e-9) * np.linalg.eigvalsh(scatter)[-1]
        along = turned @ state.axis
        assert along[state.mask].max() < along[~state.mask].min() + 2 * HOLD + 2e-4
    assert min(float(before.axis @ after.axis) for before, after in pairwise(frames)) > 0.99
    swapped = [int((before.mask != after.mask).sum()) for before, after in pairwise(frames)]
    assert sum(swapped) <= 2 * 2 * 2 * len(positions)  # each point crosses the plane at most twice a turn, with another


def test_identified_points_keep_their_half_when_others_come_and_go() -> None:
    """A point that has crossed the plane by less than `HOLD` stays in its half, at any place of the list."""

    def at(x: float, *more: float) -> ControlPoints:
        return ControlPoints([[y, 0, 0.2] for y in (*more, -0.04, 0.04, -x, x)])

    before = split(at(0.003), ids=np.array([1, 2, 3, 4]))
    named = split(at(-0.5 * HOLD, -0.05, 0.05), before, np.array([8, 9, 1, 2, 3, 4]))
    assert named.mask.tolist()[-2:] == [True, False]
    assert split(at(-0.5 * HOLD, -0.05, 0.05), before).mask.tolist()[-2:] == [False, True]


def test_a_new_number_of_points_keeps_the_axis() -> None:
    before = split(ControlPoints(parse_shape("circle").sample(0.015).positions))
    turned = Split(before.mask, np.array([0.6, 0.8, 0.0]))
    np.testing.assert_array_equal(split(parse_shape("circle").sample(0.01), turned).axis, turned.axis)


def test_nulls_are_in_both_halves_and_do_not_count() -> None:
    """Fifty nulls far to the left would otherwise draw the plane to them."""
    positions = [[-0.01, 0, 0.2], [0.01, 0, 0.2], *[[-0.1, 0, 0.2]] * 50]
    points = ControlPoints(positions, [1, 0.5] + [0] * 50)
    result = split(points)
    assert np.flatnonzero(result.mask).tolist() == [0]
    first, second = result.halves(points)
    assert second is not None
    assert (first.amplitudes.tolist(), second.amplitudes.tolist()) == ([1] + [0] * 50, [0.5] + [0] * 50)
    np.testing.assert_array_equal(first.positions, np.delete(positions, 1, axis=0))
    np.testing.assert_array_equal(second.positions, np.delete(positions, 0, axis=0))


def test_a_split_of_other_points_is_refused() -> None:
    points = ControlPoints([[0, 0, 0.2], [0, 0, 0.3]])
    with pytest.raises(ValueError, match="1 control points do not fit a split of 2"):
        split(points).halves(ControlPoints([[0, 0, 0.2]]))


@given(arrays(float, (7, 3), elements=st.floats(-1, 1)), st.integers(-100, 20))
def test_the_largest_eigenvalue_is_numpys(offset: np.ndarray, exponent: int) -> None:
    """To the root of the machine's precision, the accuracy of a closed form if the two largest are equal.

    Squares of numbers below 1e-154 vanish.
    """
    scatter = offset.T @ offset * 10.0**exponent
    largest = np.linalg.eigvalsh(scatter)[-1]
    assert _largest_eigenvalue(scatter.ravel().tolist()) == pytest.approx(largest, rel=3e-8, abs=1e-140)
