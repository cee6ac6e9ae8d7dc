from __future__ import annotations

import numpy as np
import pytest
from phasewire import ControlPoints, Medium, TransducerArray, pressure, solve
from phasewire.solver.methods.split import split
from phasewire.solver.methods.two_sided import TwoSidedSolver, two_sided
from phasewire.solver.shapes.shapes import parse_shape


def test_the_gain_is_what_a_literal_computation_finds(array: TransducerArray) -> None:
    points = parse_shape("circle").sample()
    warm = Medium(30)
    result = two_sided(array, points, "tikhonov", medium=warm, mu=0.1, output="phase")
    mask = split(points).mask
    felt = []
    for part in (mask, ~mask, np.ones(len(points), bool)):
        half = ControlPoints(points.positions[part])
        drive = solve(array, half, "tikhonov", medium=warm, mu=0.1, output="phase").drive
        felt.append(np.abs(pressure(array, drive, points.positions, warm)))
    first, second, whole = felt
    louder = first[mask].mean() / second[~mask].mean()
    first, second = first * min(1, 1 / louder), second * min(1, louder)
    np.testing.assert_allclose(result.gain.two_sided, np.abs(first**2 - second**2), rtol=1e-4)
    np.testing.assert_allclose(result.gain.one_sided, whole**2)
    assert result.gain.mean == pytest.approx(np.mean(np.abs(first**2 - second**2)) / np.mean(whole**2), rel=1e-4)
    assert result.gain.weakest == pytest.approx(np.abs(first**2 - second**2).min() / (whole**2).min(), rel=1e-4)
    np.testing.assert_allclose(np.abs(result.one_sided.drives), 1, rtol=1e-5)


@pytest.mark.parametrize("output", ["solved", "phase", "limited"])
def test_amplitudes_are_relative_across_the_halves(array: TransducerArray, output: str) -> None:
    """The quiet points have a half of their own, whose field must be turned down to their share."""
    positions = [[x, y, 0.2] for x in (-0.04, 0.04) for y in (-0.03, 0, 0.03)]
    points = ControlPoints(positions, [1, 1, 1, 0.3, 0.3, 0.3])
    result = two_sided(array, points, output=output)
    on, off = (np.abs(pressure(array, drive, positions)) for drive in result.modulation.slots()[0])
    assert off[3:].mean() / on[:3].mean() == pytest.approx(0.3)
    assert result.modulation.weights[0, 0] == 1
    reached = np.where(result.split.mask, on, off) / points.amplitudes
    np.testing.assert_allclose(reached, reached.mean(), rtol=0.02)


def test_a_null_is_low_in_both_fields(array: TransducerArray) -> None:
    """A null in the middle of a circle of 2 cm, where both halves' side lobes would meet."""
    circle = parse_shape("circle:radius=0.02").sample().positions
    points = ControlPoints(np.vstack([circle, [0, 0, 0.2]]), [1.0] * len(circle) + [0.0])
    result = two_sided(array, points)
    for drive in result.modulation.slots()[0]:
        felt = np.abs(pressure(array, drive, points.positions))
        assert felt[-1] < 0.05 * felt.max()
    assert len(result.gain.two_sided) == len(circle)
    bare = two_sided(array, ControlPoints(circle))
    assert max(abs(pressure(array, drive, [[0, 0, 0.2]])[0]) for drive in bare.modulation.slots()[0]) > 100


@pytest.mark.parametrize("nulls", [0, 2])
def test_one_point_is_modulated_one_sidedly(array: TransducerArray, nulls: int) -> None:
    points = ControlPoints([[0, 0, 0.2], *[[0.03, 0.01 * i, 0.2] for i in range(nulls)]], [1.0] + [0.0] * nulls)
    result = two_sided(array, points)
    assert result.second is None
    frames, slots = result.modulation.slots()
    assert slots == ((0, 100), (1, 100))
    assert not frames[1].any()
    assert result.gain.mean == result.gain.weakest == 1


def test_the_next_frame_keeps_the_split_and_the_frequency_is_the_modulation_s(array: TransducerArray) -> None:
    points = parse_shape("circle").sample()
    solver = TwoSidedSolver(array, frequency=250)
    before = solver.solve(points)
    turned = ControlPoints(points.positions[:, [1, 0, 2]])
    after = solver.solve(turned)
    np.testing.assert_array_equal(after.split.axis, before.split.axis)
    np.testing.assert_array_equal(after.split.mask, split(turned, before.split).mask)
    assert before.modulation.slots()[1] == ((0, 80), (1, 80))
    assert before.one_sided.true_frequency == 250
    solver.forget()
    again = solver.solve(points)
    assert again.modulation.drives.tobytes() == before.modulation.drives.tobytes()


def test_the_summary_states_the_gain(array: TransducerArray) -> None:
    result = two_sided(array, parse_shape("asterisk").sample())
    assert result.summary().startswith("11 + 10 points at 200 Hz: the intensity changes by ")
    assert f"{result.gain.mean:.2f} times as much as one-sided" in result.summary()


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_only_the_ratio_of_amplitudes_matters(array: TransducerArray, scale: float) -> None:
    positions = [[-0.03, 0, 0.2], [0.03, 0, 0.2], [0.03, 0.02, 0.2]]
    scaled, plain = (two_sided(array, ControlPoints(positions, np.array([1, 0.5, 1]) * s)) for s in (scale, 1))
    np.testing.assert_allclose(scaled.modulation.weights, plain.modulation.weights, rtol=1e-6)
    np.testing.assert_allclose(scaled.modulation.drives, plain.modulation.drives, atol=1e-6)
