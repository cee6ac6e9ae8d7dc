from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import ControlPoints, Medium, TransducerArray, pressure
from phasewire.solver import Solver, TwoSidedSolver
from phasewire.solver.acoustics.propagation import Precision
from phasewire.solver.methods.compiled_pair import CompiledPair
from phasewire.solver.methods.methods import options_of
from phasewire.solver.methods.paired import EnginePair
from phasewire.solver.methods.solve import engine_for
from phasewire.solver.methods.two_sided import pair_engine

ARRAY = TransducerArray.grid()


def pairs(method: str) -> tuple[CompiledPair, EnginePair]:
    """The one call, and the same engines step by step."""
    options = options_of(method)
    one = pair_engine(ARRAY, Medium(), method, options)
    assert isinstance(one, CompiledPair)
    first, second = (engine_for(ARRAY, Medium(), method, options, "single") for _ in range(2))
    return one, EnginePair(first, second, len(ARRAY))


@pytest.mark.parametrize("method", ["wgs", "tikhonov"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_one_call_equals_its_steps(method: str, seed: int) -> None:
    """Over frames whose points move, come, go and change places, with nulls; the axis turns now and then."""
    rng = np.random.default_rng(seed)
    one, steps = pairs(method)
    positions = rng.uniform(-0.05, 0.05, (30, 3)) + np.array([0, 0, 0.2])
    amplitudes = rng.choice([0, 0.3, 1], 30, p=[0.1, 0.4, 0.5])
    ids = np.arange(8)
    for _ in range(12):
        positions += rng.normal(0, 2e-3, positions.shape)
        if rng.random() < 0.5:
            ids = rng.permutation(30)[: rng.integers(1, 20)]
        wanted = amplitudes[ids]
        wanted[0] = 1
        points = ControlPoints(positions[ids], wanted)
        fast, slow = one.solve(points, ids), steps.solve(points, ids)
        np.testing.assert_array_equal(fast.split.mask, slow.split.mask)
        np.testing.assert_allclose(fast.split.axis, slow.split.axis, atol=1e-12)
        np.testing.assert_allclose(fast.levels, slow.levels, rtol=1e-3)
        np.testing.assert_allclose(fast.drives, slow.drives, atol=1e-3)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_a_point_begins_with_the_phase_that_its_identity_ended_with(precision: Precision) -> None:
    """Without a step of the iteration the phases stay. Points change places, one comes, one goes."""
    positions = np.random.default_rng(5).uniform(-0.05, 0.05, (7, 3)) + np.array([0, 0, 0.2])
    first, second = np.array([0, 1, 2, 3, 4, 5]), np.array([4, 6, 1, 0, 3, 2])

    def phases(named: bool) -> NDArray[np.float64]:
        """How far each of the five has turned against the first of them, in radians."""
        solver = Solver(ARRAY, "tikhonov", precision=precision, phase_steps=0, mu=1e-3)
        fields = []
        for ids in (first, second):
            drive = solver.solve(positions[ids], ids if named else None).drive
            fields.append(pressure(ARRAY, drive, positions[:5]))
        turned = fields[1] / fields[0]
        return np.asarray(np.abs(np.angle(turned / turned[0])))

    assert phases(named=True).max() < 0.1
    assert phases(named=False).max() > 1


def test_a_refused_frame_leaves_both_halves_as_they_were() -> None:
    array, ids = TransducerArray.grid(8, 8), np.arange(6)
    places = np.random.default_rng(2).uniform([-0.04, -0.04, 0.1], [0.04, 0.04, 0.2], (6, 3))
    plain, refused = TwoSidedSolver(array), TwoSidedSolver(array)
    for solver in (plain, refused):
        solver.solve(places, ids)
    with pytest.raises(ValueError, match="on the array or behind it"):
        refused.solve(places * [1, 1, -1], ids)
    after = [solver.solve(places + 1e-3, ids).drives.tobytes() for solver in (plain, refused)]
    assert after[0] == after[1]


def test_identities_must_be_as_many_as_the_points() -> None:
    for solver in (Solver(ARRAY), TwoSidedSolver(ARRAY)):
        with pytest.raises(ValueError, match=r"ids have the shape \(2,\), but there are 1 control points"):
            solver.solve(ControlPoints([[0, 0, 0.2]]), np.array([1, 2]))
