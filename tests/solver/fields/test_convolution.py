from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire import Transducer, TransducerArray
from phasewire.solver.acoustics.propagation import transfer_matrix
from phasewire.solver.fields.convolution import PlanePropagator

CLOSE = 1e-5  # of the strongest sample, as documented


def assert_the_direct_sum(array: TransducerArray, drive: np.ndarray, propagator: PlanePropagator, every: int) -> None:
    field = propagator(drive)
    some = field.grid.positions()[::every, ::every]
    direct = (transfer_matrix(array, some.reshape(-1, 3), field.medium) @ drive).reshape(some.shape[:2])
    error = np.abs(field.pressure[::every, ::every] - direct).max()
    assert error <= CLOSE * np.abs(field.pressure).max()


@settings(max_examples=25)
@given(
    columns=st.integers(1, 6),
    rows=st.integers(1, 6),
    per_pitch=st.integers(1, 7),
    extent=st.floats(0.11, 0.14),
    shift=st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)),
    seed=st.integers(0, 2**32 - 1),
)
def test_it_is_the_direct_sum(
    columns: int, rows: int, per_pitch: int, extent: float, shift: tuple[float, float, float], seed: int
) -> None:
    """Any calibrated grid of transducers, in any order and with holes, anywhere below the plane."""
    rng = np.random.default_rng(seed)
    whole = TransducerArray.grid(columns + 1, rows, 10.3e-3)
    chosen = rng.permutation(len(whole))[: max(2, len(whole) * 3 // 4)]
    drive = rng.random(len(chosen)) * np.exp(2j * np.pi * rng.random(len(chosen)))
    response = rng.normal(size=len(chosen)) + 1j * rng.normal(size=len(chosen))
    response[1] = 0
    array = TransducerArray(whole.positions[chosen] + shift, whole.normals[chosen]).calibrated(response)
    assert_the_direct_sum(array, drive, PlanePropagator(array, 0.1, extent, per_pitch), every=1)


def test_transducers_may_be_tilted_alike_and_of_any_kind() -> None:
    whole = TransducerArray.grid(4, 3)
    array = TransducerArray(whole.positions, np.tile([0.6, 0, 0.8], (12, 1)), Transducer(radius=4e-3, strength=2.0))
    assert_the_direct_sum(array, np.exp(1j * np.arange(12)), PlanePropagator(array, 0.1, 0.05, 3), every=1)


def test_one_propagator_serves_many_drives(array: TransducerArray) -> None:
    propagator = PlanePropagator(array, 0.2, 0.1, 4)
    first = propagator(np.ones(320)).pressure.copy()
    assert np.abs(propagator(np.exp(1j * np.arange(320))).pressure - first).max() > 1
    np.testing.assert_array_equal(propagator(np.ones(320)).pressure, first)


GRID = TransducerArray.grid(4, 3)
UP = [0.0, 0.0, 1.0]
UNEVEN = [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.015, 0.0]]
HUGE = [[0.0, 0.0, 0.0], [5e-4, 0.0, 0.0], [4.5, 4.5, 0.0]]


def moved(transducer: int, *, by: tuple[float, float, float]) -> TransducerArray:
    positions = GRID.positions.copy()
    positions[transducer] += by
    return TransducerArray(positions, GRID.normals)


TURN = [[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]]
TILTED = TransducerArray(GRID.positions @ TURN, GRID.normals @ TURN)


@pytest.mark.parametrize(
    ("array", "arguments", "message"),
    [
        (TILTED, {}, "transducer 1 is not at the height of transducer 0: the array must be flat and horizontal"),
        (moved(7, by=(0, 0, 1e-6)), {}, "transducer 7 is not at the height"),
        (TransducerArray(GRID.positions, [*[UP] * 11, [0.0, 0.6, 0.8]]), {}, "transducer 11 looks another way"),
        (moved(5, by=(1e-6, 0, 0)), {}, "transducer 5 stands 0.001 mm beside a square grid of 10.3 mm"),
        (TransducerArray([[0, 0, 0]], [UP]), {}, "a single transducer has no pitch"),
        (TransducerArray(UNEVEN, [UP] * 3), {}, "transducer 2 stands 5 mm beside"),
        (GRID, {"per_pitch": 0}, "per_pitch 0 must be a whole number"),
        (GRID, {"per_pitch": 1.5}, "per_pitch 1.5 must be a whole number"),
        (GRID, {"height": -1}, "height -1 m must be positive"),
        (GRID, {"height": 1e-3}, "the model 'piston' needs at least 4.50 mm"),
        (GRID, {"extent": 0.01, "per_pitch": 1}, "is too long for a plane of 0.01 m"),
        (GRID, {"per_pitch": 90, "extent": 0.22}, "needs more than 4000000 samples"),
        (TransducerArray(HUGE, [UP] * 3), {}, "needs more than 4000000 samples"),
    ],
)
def test_impossible_propagators_are_refused(array: TransducerArray, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PlanePropagator(array, **({"height": 0.2, "extent": 0.05} | arguments))


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (np.ones(11), r"drive has the shape \(11,\), but the array has 12 transducers"),
        (np.full(12, 1e300), "drive of transducer 0 has magnitude 1e.300"),
    ],
)
def test_bad_drives_are_named(drive: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PlanePropagator(GRID, 0.2, 0.05, 2)(drive)
