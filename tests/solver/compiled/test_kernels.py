"""The compiled float32 kernels against the readable complex128 versions, on fresh problems each time."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from phasewire import ControlPoints, Medium, Solver, Transducer, TransducerArray, pressure, solve
from phasewire.solver.acoustics import tables
from phasewire.solver.compiled import propagation
from phasewire.solver.methods.engine import CompiledEngine
from phasewire.solver.methods.methods import METHODS, options_of
from phasewire.solver.methods.reference import misfit

from tests.strategies import arrays_and_points

COMPILED = [name for name, method in METHODS.items() if method.kernels is not None]
FEW = settings(max_examples=25)


def reached(array: TransducerArray, points: ControlPoints, drive: np.ndarray, medium: Medium | None = None) -> Any:
    return pressure(array, drive, points.positions, medium)


@njit
def wave(turns: np.ndarray, out: np.ndarray) -> None:
    for i in range(len(turns)):
        out[0, i], out[1, i] = propagation._wave(turns[i])


@given(st.lists(st.floats(-1e5, 1e5, width=32), min_size=1, max_size=50))
def test_the_polynomial_wave_is_cosine_and_sine(turns: list[float]) -> None:
    given_turns = np.array(turns, dtype=np.float32)
    out = np.empty((2, len(turns)), dtype=np.float32)
    wave(given_turns, out)
    exact = np.exp(2j * np.pi * np.fmod(given_turns.astype(float), 1))
    np.testing.assert_allclose(out[0] + 1j * out[1], exact, atol=2e-6)


@pytest.mark.parametrize("options", [{}, {"gamma": 0.3, "mu": 0.3}, {"output": "limited"}], ids=str)
@given(seed=st.integers(0, 2**32 - 1), m=st.integers(1, 64))
@FEW
def test_tikhonov_is_the_double_one(options: dict[str, Any], seed: int, m: int) -> None:
    """With points on a lattice of 12 mm, ratios of |p| to 1e-3 of the strongest, and phases to 0.2 degrees rms.

    From the same phases of the points: iterations for nearly independent points can end elsewhere.
    """
    rng = np.random.default_rng(seed)
    lattice = np.stack(np.meshgrid(*[np.arange(-5, 6) * 0.012] * 2, [0.15, 0.2, 0.25]), axis=-1).reshape(-1, 3)
    points = ControlPoints(rng.permutation(lattice)[:m], rng.uniform(0.1, 1, m))
    array, options = TransducerArray.grid(), options | {"phase_steps": 0}
    single, double = (solve(array, points, "tikhonov", precision=p, **options).drive for p in ("single", "double"))
    felt, expected = (np.abs(reached(array, points, drive)) for drive in (single, double))
    assert felt.mean() == pytest.approx(expected.mean(), rel=0.01)  # which the one strongest transducer decides
    np.testing.assert_allclose(
        felt / felt.mean(), expected / expected.mean(), atol=1e-3 * expected.max() / expected.mean()
    )
    counts = np.abs(double) > 0.1
    assert np.degrees(np.sqrt(np.mean(np.angle(single * double.conj())[counts] ** 2))) < 0.2


@pytest.mark.parametrize(
    "options", [{}, {"phase_steps": 0}, {"gamma": 0.3, "mu": 0.3}, {"output": "limited"}, {"phases": "power"}], ids=str
)
@given(problem=arrays_and_points())
@FEW
def test_tikhonov_is_as_good_as_the_double_one_for_any_points(
    options: dict[str, Any], problem: tuple[TransducerArray, ControlPoints]
) -> None:
    """Crowded, repeated and contradicting ones, for which the phases may end elsewhere."""
    array, points = problem
    single, double = (solve(array, points, "tikhonov", precision=p, **options).drive for p in ("single", "double"))
    assert np.isfinite(single).all()
    felt, expected = (np.abs(reached(array, points, drive)) for drive in (single, double))
    assert felt.mean() == pytest.approx(expected.mean(), rel=0.02)
    assert misfit(felt, points.amplitudes)[1] <= 1.02 * misfit(expected, points.amplitudes)[1] + 1e-3


@given(problem=arrays_and_points())
@FEW
def test_multiplexing_is_the_double_one(problem: tuple[TransducerArray, ControlPoints]) -> None:
    array, points = problem
    single, double = (solve(array, points, "multiplex", precision=p).drive for p in ("single", "double"))
    felt, expected = (np.abs(reached(array, points, drive)) for drive in (single, double))
    np.testing.assert_allclose(felt, expected, atol=1e-3 * expected.max())


@pytest.mark.parametrize("output", ["solved", "phase", "limited"])
@given(problem=arrays_and_points())
@FEW
def test_corrections_are_as_good_as_the_double_ones(
    output: str, problem: tuple[TransducerArray, ControlPoints]
) -> None:
    """If points contradict each other, rounding decides where the search ends, but never worse than it began."""
    array, points = problem
    single, double = (solve(array, points, "wgs", precision=p, output=output).drive for p in ("single", "double"))
    begun = solve(array, points, "wgs", output=output, steps=0).drive
    error, expected, first = (
        misfit(reached(array, points, drive), points.amplitudes)[1] for drive in (single, double, begun)
    )
    assert error <= 2 * expected + 5e-3
    assert error <= first * (1 + 1e-4) + 1e-5


@pytest.mark.parametrize("output", ["solved", "phase", "limited"])
@given(seed=st.integers(0, 2**32 - 1), m=st.integers(2, 40))
@FEW
def test_a_correction_is_the_double_one(output: str, seed: int, m: int) -> None:
    """One step, from the same phases of the points, which are on a lattice of 12 mm, some of them nulls."""
    rng = np.random.default_rng(seed)
    lattice = np.stack(np.meshgrid(*[np.arange(-5, 6) * 0.012] * 2, [0.15, 0.2, 0.25]), axis=-1).reshape(-1, 3)
    amplitudes = rng.uniform(0.1, 1, m) * (rng.random(m) > 0.2)
    amplitudes[0] = 1
    array, points = TransducerArray.grid(), ControlPoints(rng.permutation(lattice)[:m], amplitudes)
    single, double = (
        solve(array, points, precision=p, output=output, phase_steps=0, steps=1).drive for p in ("single", "double")
    )
    plain = solve(array, points, "tikhonov", precision="double", output=output, phase_steps=0).drive
    turned, expected = np.angle(single * plain.conj()), np.angle(double * plain.conj())
    counts = np.abs(plain) > 0.1
    assert np.sqrt(np.mean((turned - expected)[counts] ** 2)) < 0.02 * np.sqrt(np.mean(expected[counts] ** 2)) + 5e-3


@given(seed=st.integers(0, 2**32 - 1))
@FEW
def test_polishing_is_as_good_as_the_double_one(seed: int) -> None:
    """Both stop in some local optimum, in far less than a per mille of the plain quantised error."""
    array = TransducerArray.grid(10, 10)
    positions = np.random.default_rng(seed).uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.3], (12, 3))
    points = ControlPoints(positions)
    errors = {}
    for precision, sweeps in itertools.product(("single", "double"), (0, 2)):
        drive = solve(array, points, "polish", precision=precision, sweeps=sweeps).drive  # type: ignore[arg-type]
        errors[precision, sweeps] = misfit(reached(array, points, drive), np.ones(12))[1]
    assert errors["single", 0] == pytest.approx(errors["double", 0], abs=2e-3)
    assert errors["single", 2] < errors["single", 0]
    assert errors["single", 2] < 1.5 * errors["double", 2] + 1e-3


@pytest.mark.parametrize("method", METHODS)
@given(problem=arrays_and_points())
@FEW
def test_drives_are_within_their_limits_and_dead_elements_silent(
    method: str, problem: tuple[TransducerArray, ControlPoints]
) -> None:
    array, points = problem
    limits = np.linspace(1, 0.2, len(array))
    limited = array.calibrated(array.response, limits)
    drive = solve(limited, points, method).drive
    assert (np.abs(drive) <= limits * (1 if method in COMPILED else 1 + 1e-12)).all()
    assert not drive[array.response == 0].any()
    assert (np.abs(drive) / limits).max() == pytest.approx(1, rel=1e-5)


@pytest.mark.parametrize("model", ["monopole", "piston"])
@pytest.mark.parametrize("absorbing", [False, True])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_pressure_is_the_double_one(model: str, absorbing: bool, seed: int) -> None:
    """For tilted panels, far from the origin, with flipped and weak elements, in warm and absorbing air."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn = axes * np.sign(np.linalg.det(axes))
    panel = TransducerArray.grid(7, 5, transducer=Transducer(model=model, polarity=-1))
    array = TransducerArray.joined([panel, panel.placed(turn, [0.1, 0.2, 0.3])]).placed(np.eye(3), [5, -3, 9])
    array = array.calibrated(rng.normal(size=70) + 1j * rng.normal(size=70))
    medium = Medium(33, absorbing=absorbing)
    drive = rng.uniform(0, 1, 70) * np.exp(2j * np.pi * rng.uniform(size=70))
    at = np.add(rng.uniform([-0.4, -0.4, 0.4], [0.4, 0.4, 0.9], (300, 3)), [5, -3, 9])
    exact = pressure(array, drive, at, medium)
    np.testing.assert_allclose(
        pressure(array, drive, at, medium, precision="single"), exact, atol=2e-4 * np.abs(exact).max()
    )


WIDE = Transducer(radius=0.02)
LOOKED_UP = [WIDE, *(Transducer(model=model, polarity=-1) for model in ("rayleigh", "rayleigh-1", "as-printed"))]


@pytest.mark.parametrize("transducer", LOOKED_UP, ids=lambda transducer: f"{transducer.model}-{transducer.radius}")
@pytest.mark.parametrize("absorbing", [False, True])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_tables_are_as_good_as_the_double_model(transducer: Transducer, absorbing: bool, seed: int) -> None:
    """Rayleigh integrals, and a piston of ka 15, whose nulls and side lobes no short polynomial can follow."""
    rng = np.random.default_rng(seed)
    medium = Medium(25, absorbing=absorbing)
    array = TransducerArray.grid(6, 4, 0.05, transducer).calibrated(rng.normal(size=24) + 1j * rng.normal(size=24))
    assert len(tables.tables_of(array, medium).wave) == 4
    drive = rng.uniform(0, 1, 24) * np.exp(2j * np.pi * rng.uniform(size=24))
    at = rng.uniform([-0.3, -0.3, 0.05], [0.3, 0.3, 0.6], (200, 3))
    exact = pressure(array, drive, at, medium)
    np.testing.assert_allclose(
        pressure(array, drive, at, medium, precision="single"), exact, atol=2e-4 * np.abs(exact).max()
    )
    points = ControlPoints(at[:5], [1, 0.5, 0.7, 0, 1])
    single, double = (solve(array, points, "tikhonov", medium=medium, precision=p).drive for p in ("single", "double"))
    felt, expected = (np.abs(reached(array, points, drive, medium)) for drive in (single, double))
    np.testing.assert_allclose(felt, expected, atol=2e-3 * expected.max())


def test_points_too_far_for_single_precision_are_computed_in_double(array: TransducerArray) -> None:
    drive, far = np.ones(320), [[3.0, 0, 9.0], [0, 8.0, 7.0]]
    assert pressure(array, drive, far, precision="single").tolist() == pressure(array, drive, far).tolist()
    wide = TransducerArray.joined([array, array.placed(np.eye(3), [4.7, 0, 0])])
    points = ControlPoints([[0, 0, 0.2], [4.7, 0, 0.2]])
    single, double = (solve(wide, points, "tikhonov", precision=p).drive for p in ("single", "double"))
    np.testing.assert_allclose(single, double, atol=1e-4)


def test_a_large_array_is_within_reach_of_the_kernels() -> None:
    """Of 64 × 64 transducers, 66 cm wide; the path by NumPy would be thirty times as slow."""
    assert CompiledEngine(TransducerArray.grid(64, 64), Medium(), "wgs", options_of("wgs"))._modelled
    wide = TransducerArray.joined([TransducerArray.grid(), TransducerArray.grid().placed(np.eye(3), [4.7, 0, 0])])
    assert not CompiledEngine(wide, Medium(), "wgs", options_of("wgs"))._modelled


def test_samples_among_facing_panels_are_checked_one_by_one_and_fast() -> None:
    """All of them lie in the array's box; the one on a transducer is named."""
    up = TransducerArray.grid(8, 8)
    pair = TransducerArray.joined([up, up.placed(np.diag([1.0, -1.0, -1.0]), [0, 0, 0.1])])
    inside = np.random.default_rng(0).uniform([-0.03, -0.03, 0.02], [0.03, 0.03, 0.08], (20_000, 3))
    np.testing.assert_allclose(
        pressure(pair, np.ones(128), inside, precision="single")[:50], pressure(pair, np.ones(128), inside[:50]), atol=1
    )
    inside[777] = pair.positions[70] + [0, 0, -0.004]
    with pytest.raises(ValueError, match=r"point 777 at .* is 4.00 mm from transducer 70"):
        pressure(pair, np.ones(128), inside, precision="single")


def test_strong_absorption_is_computed_without_the_kernel() -> None:
    """At 400 kHz air takes most of the sound on the way: 90 dB/m."""
    array = TransducerArray.grid(5, 5, 1e-3, Transducer(radius=0.45e-3))
    thick = Medium(frequency=400_000, absorbing=True)
    assert thick.attenuation * 2 > propagation.MAX_NEPERS
    points = ControlPoints([[0, 0, 0.05], [0.01, 0, 0.05]])
    felt = np.abs(reached(array, points, solve(array, points, medium=thick).drive, thick))
    assert felt[1] / felt[0] == pytest.approx(1, abs=0.01)


def test_compilations_are_counted() -> None:
    Solver(TransducerArray.grid(2, 2)).solve(ControlPoints([[0, 0, 0.1]]))
    counts = tables.compilation()
    assert "update" in counts
    assert all(loaded + built >= 1 for loaded, built in counts.values())


def test_reversed_polarity_reverses_the_drive() -> None:
    points = ControlPoints([[0.02, 0.01, 0.15], [-0.02, 0, 0.2]])
    for method in COMPILED:
        upright, reversed_ = (
            solve(TransducerArray.grid(8, 8, transducer=Transducer(polarity=sign)), points, method) for sign in (1, -1)
        )
        np.testing.assert_allclose(reversed_.drive, -upright.drive, atol=1e-5)
