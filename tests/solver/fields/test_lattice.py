"""Fields by FFT against the direct sum in double precision, and the choice between them."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire import Medium, Transducer, TransducerArray, pressure, sample_plane
from phasewire.solver.acoustics import tables
from phasewire.solver.fields import field
from phasewire.solver.fields.field import sample_cut, sample_volume
from phasewire.solver.fields.grid import Grid
from phasewire.solver.fields.lattice import lattice_of, shifts_over

CLOSE = 2e-4  # of the strongest sample, as documented

always_by_fft = patch.object(field, "PAIRS_PER_SAMPLE", 0)
never_by_fft = patch.object(field, "MAX_SPECTRUM", 0)
shifting = patch.object(field, "shifts_over", side_effect=shifts_over)


def sample(array: TransducerArray, drive: np.ndarray, grid: Grid, medium: Medium | None = None) -> Any:
    return (sample_volume if grid.kind == "box" else sample_cut)(array, drive, grid, medium).pressure


@given(
    columns=st.integers(1, 6),
    rows=st.integers(1, 6),
    per_pitch=st.integers(1, 5),
    extents=st.tuples(st.floats(0.03, 0.09), st.floats(0.03, 0.09), st.floats(0.025, 0.04)),
    centre=st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(0.1, 0.2)),
    letters=st.sampled_from(["xy", "xyz"]),
    look=st.sampled_from([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]),
    model=st.sampled_from(["piston", "rayleigh"]),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=20)
def test_planes_and_boxes_by_fft_are_the_direct_sum(
    columns: int, rows: int, per_pitch: int, extents: Any, centre: Any, letters: str, look: Any, model: str, seed: int
) -> None:
    """Of calibrated arrays with holes and dead elements, anywhere below grids of any sides, in absorbing air."""
    rng, air = np.random.default_rng(seed), Medium(28, absorbing=True)
    whole = TransducerArray.grid(columns + 1, rows)
    chosen = np.append(rng.permutation(np.arange(2, len(whole)))[: len(whole) * 3 // 4], [0, 1])  # neighbours
    response = rng.normal(size=len(chosen)) + 1j * rng.normal(size=len(chosen))
    response[1] = 0
    normals = np.tile(look, (len(chosen), 1))
    array = TransducerArray(whole.positions[chosen] + [0.02, 0, 0.01], normals, Transducer(model=model))
    array = array.calibrated(response)
    drive = rng.random(len(chosen)) * np.exp(2j * np.pi * rng.random(len(chosen)))
    grid = Grid.along(letters, centre, extents[: len(letters)], lattice_of(array).pitch / per_pitch)
    with always_by_fft, shifting as used:
        found = sample(array, drive, grid, air)
    assert used.call_count == (grid.counts[2] if letters == "xyz" else 1)
    exact = pressure(array, drive, grid.positions().reshape(-1, 3), air).reshape(grid.shape)
    np.testing.assert_allclose(found, exact, atol=CLOSE * np.abs(exact).max())


ARRAY = TransducerArray.grid(6, 5)
DRIVE = np.exp(1j * np.arange(30) ** 2)
PITCH = 10.3e-3
BESIDE = TransducerArray(ARRAY.positions + np.eye(30)[:, :1] * [1e-6, 0, 0], ARRAY.normals)
IMPOSSIBLE = {
    "a step that does not divide the pitch": (ARRAY, Grid.along("xy", (0, 0, 0.1), 0.05, 3.1e-3)),
    "a step that is longer than the pitch": (ARRAY, Grid.along("xy", (0, 0, 0.1), 0.05, 2 * PITCH)),
    "a plane that stands": (ARRAY, Grid.along("xz", (0, 0, 0.1), 0.05, PITCH / 2)),
    "axes in another order": (ARRAY, Grid.along("yx", (0, 0, 0.1), 0.05, PITCH / 2)),
    "a transducer beside the grid": (BESIDE, Grid.along("xy", (0, 0, 0.1), 0.05, PITCH / 2)),
    "a plane next to the array": (ARRAY, Grid.along("xy", (0.1, 0.1, 0.004), 0.05, PITCH / 2)),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_other_planes_are_summed(name: str) -> None:
    array, grid = IMPOSSIBLE[name]
    with always_by_fft, shifting as used:
        found = sample(array, DRIVE, grid)
    assert used.call_count == 0
    exact = pressure(array, DRIVE, grid.positions().reshape(-1, 3)).reshape(grid.shape)
    np.testing.assert_allclose(found, exact, atol=CLOSE * np.abs(exact).max())


def test_the_faster_way_is_taken() -> None:
    """The direct sum for a few transducers or samples, the FFT for many of both."""
    large, drive = TransducerArray.grid(32, 32), np.exp(1j * np.arange(1024))
    with shifting as used:
        sample_plane(large, drive, 0.2, extent=0.05, step=PITCH / 4)
        assert used.call_count == 0
        found = sample_plane(large, drive, 0.2, extent=0.4, step=PITCH / 4)
        assert used.call_count == 1
    with never_by_fft:
        direct = sample_plane(large, drive, 0.2, extent=0.4, step=PITCH / 4).pressure
    np.testing.assert_allclose(found.pressure, direct, atol=CLOSE * np.abs(direct).max())


def test_bad_drives_are_named_on_either_way() -> None:
    with always_by_fft, pytest.raises(ValueError, match=r"drive has the shape \(29,\), but the array has 30"):
        sample_plane(ARRAY, DRIVE[:29], 0.1, 0.05, PITCH / 2)
    with always_by_fft, pytest.raises(ValueError, match=r"drive of transducer 0 is .*nan"):
        sample_plane(ARRAY, DRIVE * np.nan, 0.1, 0.05, PITCH / 2)


@pytest.mark.slow
def test_a_plane_of_more_pairs_than_a_direct_sum_may_have() -> None:
    """16 384 transducers and 1.6 million samples, 27 billion pairs, in seconds; some samples against the direct sum."""
    array = TransducerArray.grid(128, 128)
    drive = np.exp(1j * np.arange(len(array)) ** 2)
    plane = sample_plane(array, drive, 0.3, extent=1.32, step=PITCH / 10)
    some = np.random.default_rng(1).integers(0, plane.pressure.shape[0], (50, 2))
    exact = pressure(array, drive, plane.grid.positions()[some[:, 0], some[:, 1]])
    np.testing.assert_allclose(plane.pressure[some[:, 0], some[:, 1]], exact, atol=CLOSE * np.abs(plane.pressure).max())


@pytest.mark.parametrize("model", ["piston", "rayleigh"])
@given(samples=st.integers(1, 1500), threads=st.integers(2, 4))
@settings(max_examples=15)
def test_threads_do_not_change_a_bit_of_a_pressure(model: str, samples: int, threads: int) -> None:
    array = TransducerArray.grid(6, 5, transducer=Transducer(model=model))
    at = np.random.default_rng(samples).uniform([-0.1, -0.1, 0.1], [0.1, 0.1, 0.3], (samples, 3))
    alone = pressure(array, DRIVE, at, precision="single")
    with patch.object(tables, "SHARED_PAIRS", 1), patch.object(tables, "THREADS", threads):
        np.testing.assert_array_equal(pressure(array, DRIVE, at, precision="single"), alone)
