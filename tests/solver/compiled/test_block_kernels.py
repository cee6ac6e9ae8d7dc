"""The blocked path of big problems against complex128, on small ones: the switch to it is turned down."""

from __future__ import annotations

import tracemalloc
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire import ControlPoints, Medium, Solver, Transducer, TransducerArray, pressure, solve, solve_frames
from phasewire.solver.acoustics.tables import aligned, tables_of
from phasewire.solver.compiled import block_kernels, layout
from phasewire.solver.compiled.simd import LANES
from phasewire.solver.methods import engine
from phasewire.solver.methods.engine import CompiledEngine
from phasewire.solver.methods.methods import options_of
from phasewire.solver.methods.reference import misfit
from phasewire.solver.shapes.points import check_reachable

from tests.strategies import arrays_and_points

pytestmark = pytest.mark.slow  # blocks of every model and method against the small kernels

FEW = settings(max_examples=15)
BIG = TransducerArray.grid(128, 128)


def in_blocks(array: TransducerArray, points: ControlPoints, method: str, threads: int = 1, **options: Any) -> Any:
    """Drives of the blocked path."""
    medium = options.pop("medium", Medium())
    with patch.object(block_kernels, "BLOCKED_PAIRS", 1):
        return CompiledEngine(array, medium, method, options_of(method, options), threads).drive(points)


def error_of(array: TransducerArray, points: ControlPoints, drive: Any, medium: Medium | None = None) -> float:
    return misfit(pressure(array, drive, points.positions, medium), points.amplitudes)[1]


@given(m=st.integers(1, 150), n=st.integers(1, 1200), threads=st.integers(2, 5), seed=st.integers(0, 2**32 - 1))
@FEW
def test_the_gram_matrix_is_that_of_complex128(m: int, n: int, threads: int, seed: int) -> None:
    """Of any number of rows and columns, with the same bits for any number of threads."""
    rng = np.random.default_rng(seed)
    columns = -(-n // LANES) * LANES
    transfer = rng.normal(size=(m, n)) + 1j * rng.normal(size=(m, n))
    grams = []
    for shared in (1, threads):
        work, u = aligned(layout.work_size(m, columns)), aligned(2, -(-m // LANES) * LANES)
        work[:] = rng.normal(size=work.shape)  # of the last frame
        parts = layout.carve(work, m, columns)
        parts.re[:m], parts.im[:m], parts.vectors[layout.WANTED] = 0, 0, 1
        parts.re[:m, :n], parts.im[:m, :n] = transfer.real, transfer.imag
        parts.spans[layout.REACH][:] = 1
        block_kernels.begin(m, columns, np.float32(0), 3, False, u, work, threads=shared)
        grams.append((parts.gram_re + 1j * parts.gram_im).copy())
    exact = transfer @ transfer.conj().T
    np.testing.assert_allclose(grams[0][:m, :m], exact, atol=1e-5 * np.abs(exact).max())
    assert not grams[0][m:].any()
    assert not grams[0][:, m:].any()
    np.testing.assert_array_equal(grams[0], grams[1])


@pytest.mark.parametrize("output", ["solved", "phase", "limited"])
@pytest.mark.parametrize("method", ["tikhonov", "wgs"])
@given(problem=arrays_and_points())
@FEW
def test_blocks_solve_as_well_as_other_ways(
    method: str, output: str, problem: tuple[TransducerArray, ControlPoints]
) -> None:
    """Any points, also more than transducers, and nulls; within the limits, and dead elements are silent."""
    array, points = problem
    limits = np.linspace(1, 0.3, len(array))
    array = array.calibrated(array.response, limits)
    drive = in_blocks(array, points, method, output=output)
    expected = max(  # rounding decides where a search among as many points as transducers ends
        error_of(array, points, solve(array, points, method, output=output, precision=precision).drive)
        for precision in ("single", "double")
    )
    assert error_of(array, points, drive) <= 1.3 * expected + 2e-3
    assert (np.abs(drive) <= limits).all()
    assert not drive[array.response == 0].any()


CLOUD = np.random.default_rng(1).uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.2], (70, 3))
SPECIAL: dict[str, tuple[Any, Any]] = {
    "one point": ([[0.0, 0.01, 0.15]], [1.0]),
    "one that is no null": (CLOUD[:9], np.eye(9)[4]),
    "repeated": (np.repeat([[0.0, 0.01, 0.15], [0.03, 0.0, 0.2]], 20, axis=0), np.ones(40)),
    "more than transducers": (CLOUD, np.ones(70)),
}


@pytest.mark.parametrize("side", [1, 6])
@pytest.mark.parametrize("name", SPECIAL)
@pytest.mark.parametrize("method", ["tikhonov", "wgs"])
def test_special_problems_have_the_small_kernels_drives(method: str, name: str, side: int) -> None:
    array, points = TransducerArray.grid(side, side), ControlPoints(*SPECIAL[name])
    np.testing.assert_allclose(in_blocks(array, points, method), solve(array, points, method).drive, atol=2e-3)


@pytest.mark.parametrize("method", ["tikhonov", "wgs", "polish"])
@pytest.mark.parametrize("transducer", [Transducer(), Transducer(model="rayleigh")], ids=lambda t: t.model)
def test_every_model_and_method_has_the_small_kernels_drives(method: str, transducer: Transducer) -> None:
    """In absorbing air."""
    array, air = TransducerArray.grid(9, 7, transducer=transducer), Medium(25, absorbing=True)
    points = ControlPoints([[0.02, 0.01, 0.12], [-0.02, 0, 0.1], [0.0, -0.02, 0.11]], [1, 0.5, 0])
    drive = in_blocks(array, points, method, medium=air)
    np.testing.assert_allclose(drive, solve(array, points, method, medium=air).drive, atol=2e-3)


@pytest.mark.parametrize("options", [{"phases": "power"}, {"phase_seconds": 60.0}, {"gamma": 0.3, "mu": 0.1}], ids=str)
def test_options_reach_the_blocks(options: dict[str, Any]) -> None:
    array, points = TransducerArray.grid(9, 7), ControlPoints(*SPECIAL["repeated"])
    expected = solve(array, points, "tikhonov", **options).drive
    np.testing.assert_allclose(in_blocks(array, points, "tikhonov", **options), expected, atol=2e-3)


def test_frames_and_motion_go_through_the_blocks() -> None:
    """They are solved from scratch, or keep their phases, as small ones do."""
    array, rng = TransducerArray.grid(9, 7), np.random.default_rng(3)
    positions = rng.uniform([-0.04, -0.04, 0.1], [0.04, 0.04, 0.2], (1, 12, 3)) + np.zeros((3, 1, 1))
    positions += np.arange(3)[:, None, None] * 1e-4
    small = solve_frames(array, list(positions), "tikhonov"), Solver(array).follow(positions, np.ones(12))
    with patch.object(block_kernels, "BLOCKED_PAIRS", 1):
        blocks = solve_frames(array, list(positions), "tikhonov"), Solver(array).follow(positions, np.ones(12))
    for one, other in zip(small, blocks, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-3)


def test_a_point_behind_the_array_is_refused() -> None:
    with pytest.raises(ValueError, match=r"control point 1 at .* is on the array or behind it"):
        in_blocks(TransducerArray.grid(4, 4), ControlPoints([[0, 0, 0.1], [0, 0, -0.1]]), "wgs")


def test_rows_of_matrices_are_no_multiple_of_a_kilobyte() -> None:
    lengths = [layout.pad(rows) for rows in range(1, 4097)]
    assert lengths == sorted(lengths)  # the space of more points is enough for fewer
    assert all(length >= rows and length % LANES == 0 and length % 256 for rows, length in enumerate(lengths, 1))


def test_many_pairs_are_checked_and_modelled_in_parts() -> None:
    """For arrays that are too wide for the kernels' model."""
    wide = TransducerArray.joined(
        [TransducerArray.grid(4, 4), TransducerArray.grid(4, 4).placed(np.eye(3), [1.9, 0, 0])]
    )
    wide = TransducerArray.joined([wide, wide.placed(np.eye(3), [2.8, 0, 0])])
    points = ControlPoints([[0, 0, 0.2], [1.9, 0, 0.2], [2.8, 0, 0.2], [4.7, 0, 0.3]], [1, 0, 0.5, 1])
    whole = solve(wide, points).drive
    with patch.object(engine, "PAIRS_AT_A_TIME", 100), patch("phasewire.solver.shapes.points.PAIRS_AT_A_TIME", 100):
        np.testing.assert_allclose(solve(wide, points).drive, whole, atol=1e-4)
        with pytest.raises(ValueError, match=r"control point 3 at .* is out of reach"):
            check_reachable(wide, ControlPoints([*points.positions[:3], [0, 0, 5]]))


@pytest.mark.parametrize("method", ["tikhonov", "wgs"])
@pytest.mark.parametrize("shape", [(64, 64, 256), (40, 40, 512)], ids=str)
def test_big_problems_are_solved_as_well_as_in_double_precision(shape: tuple[int, int, int], method: str) -> None:
    columns, rows, m = shape
    array, rng = TransducerArray.grid(columns, rows), np.random.default_rng(4)
    assert m * columns * rows >= block_kernels.BLOCKED_PAIRS
    half = columns * 4e-3
    points = ControlPoints(rng.uniform([-half, -half, 0.15], [half, half, 0.4], (m, 3)), rng.uniform(0.2, 1, m))
    drives = [solve(array, points, method, precision=precision).drive for precision in ("single", "double")]
    single, double = (np.abs(pressure(array, drive, points.positions)) for drive in drives)
    assert misfit(single, points.amplitudes)[1] <= 1.1 * misfit(double, points.amplitudes)[1] + 1e-3
    assert single.mean() == pytest.approx(double.mean(), rel=0.02)


@pytest.mark.parametrize("height", [0.2, 1.5], ids=["usual", "looked at more closely"])
def test_the_largest_problem_is_solved_in_the_memory_that_is_stated(height: float) -> None:
    """16 384 transducers and 1024 points, of which the distant ones are checked one by one."""
    columns = tables_of(BIG, Medium()).elements.shape[1]
    half = 0.5
    points = ControlPoints(
        np.random.default_rng(5).uniform([-half, -half, height], [half, half, height + 0.3], (1024, 3))
    )
    tracemalloc.start()
    drive = solve(BIG, points).drive
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    work = 4 * layout.work_size(1024, columns)
    assert work <= peak <= work + 100e6
    felt = np.abs(pressure(BIG, drive, points.positions, precision="single"))
    assert misfit(felt, points.amplitudes)[1] < 0.02
