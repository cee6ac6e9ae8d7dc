from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import ControlPoints, Medium, Sphere, TransducerArray, pressure, solve
from phasewire.solver.propagation import transfer_matrix
from phasewire.solver.solve import control_point_phases, tikhonov


def test_a_single_point_is_equation_8(array: TransducerArray) -> None:
    """x_q = conj(a_q)·A_C / Σ|a_q|²: for one point, without the preference for equal drives, up to one scale."""
    points = ControlPoints([[0.01, -0.02, 0.2]])
    a = np.array([transfer_matrix(array, points.positions)[0, q] for q in range(320)])
    by_hand = np.conj(a) / sum(abs(a) ** 2)
    assert a @ by_hand == pytest.approx(1)  # equation (8) makes the amplitude it is asked for
    drive = solve(array, points, gamma=0.0).drive
    scale = drive[0] / by_hand[0]
    assert scale.imag == pytest.approx(0, abs=1e-9 * abs(scale))
    assert scale.real > 0
    np.testing.assert_allclose(drive, scale.real * by_hand, rtol=1e-9)


def test_a_single_point_is_the_time_of_flight_by_hand(array: TransducerArray) -> None:
    """Every wave arrives with the same phase: the drive's phase is −k·r."""
    point = np.array([0.03, 0.01, 0.15])
    drive = solve(array, ControlPoints([point])).drive
    distance = np.linalg.norm(array.positions - point, axis=1)
    arriving = drive * np.exp(1j * Medium().wavenumber * distance)
    np.testing.assert_allclose(np.angle(arriving / arriving[0]), 0, atol=1e-9)


def test_gamma_1_drives_all_transducers_equally_for_one_point(array: TransducerArray) -> None:
    drive = solve(array, ControlPoints([[0.02, 0.03, 0.2]]), gamma=1.0).drive
    np.testing.assert_allclose(np.abs(drive), 1)


@pytest.mark.parametrize("gamma", [0.0, 0.5, 1.0])
@given(seed=st.integers(0, 2**32 - 1), m=st.integers(1, 30))
def test_tikhonov_is_the_augmented_least_squares_problem(gamma: float, seed: int, m: int) -> None:
    """The paper's (10) solved literally: [A; √μ·diag(σ^γ)]·x = [b; 0], also with more points than transducers."""
    rng = np.random.default_rng(seed)
    n = 12
    matrix = rng.normal(size=(m, n)) + 1j * rng.normal(size=(m, n))
    amplitudes = rng.uniform(0.1, 1, m)
    sigma = np.sqrt(sum(abs(matrix[i]) * amplitudes[i] for i in range(m)) / m)
    weighted = matrix @ np.diag(sigma ** (-2 * gamma)) @ matrix.conj().T
    mu = 0.03 * np.trace(weighted).real / m
    wanted = amplitudes * control_point_phases(matrix, amplitudes)
    augmented = np.vstack([matrix, np.sqrt(mu) * np.diag(sigma**gamma)])
    expected = np.linalg.lstsq(augmented, np.concatenate([wanted, np.zeros(n)]), rcond=None)[0]
    np.testing.assert_allclose(tikhonov(matrix, amplitudes, gamma=gamma), expected / abs(expected).max(), atol=1e-8)


def test_phases_are_those_of_the_dominant_eigenvector_where_it_is_spread_out(array: TransducerArray) -> None:
    """Two points half a wavelength apart: by symmetry the eigenvector is (1, ±1)/√2, its sign that of the coupling."""
    matrix = transfer_matrix(array, [[-0.002, 0, 0.2], [0.002, 0, 0.2]])
    response = matrix @ matrix.conj().T
    values, vectors = np.linalg.eigh(response)
    dominant = vectors[:, values.argmax()]
    u = control_point_phases(matrix, np.ones(2))
    np.testing.assert_allclose(u[1] / u[0], dominant[1] / dominant[0], atol=1e-6)


def test_phases_follow_equation_9_literally(array: TransducerArray) -> None:
    """Column j of R is the field, at all points, of the drive that (8) gives for point j alone at its amplitude."""
    rng = np.random.default_rng(9)
    points = rng.uniform([-0.05, -0.05, 0.15], [0.05, 0.05, 0.25], size=(7, 3))
    amplitudes = rng.uniform(0.1, 1, 7)
    matrix = transfer_matrix(array, points)
    response = np.empty((7, 7), complex)
    for j in range(7):
        drive = np.conj(matrix[j]) * amplitudes[j] / np.sum(np.abs(matrix[j]) ** 2)
        response[:, j] = matrix @ drive
    u = np.exp(2j * np.pi * 0.6180339887 * np.arange(7) ** 2)
    for _ in range(20):
        u = response @ u
        u /= np.abs(u)
    np.testing.assert_allclose(control_point_phases(matrix, amplitudes), u, atol=1e-9)


def test_the_start_does_not_stall_on_symmetric_shapes(array: TransducerArray) -> None:
    """Two points whose fields work against each other must end in antiphase, which equal phases never leave for."""
    matrix = transfer_matrix(array, [[-0.006, 0, 0.2], [0.006, 0, 0.2]])
    assert (matrix @ matrix.conj().T)[0, 1].real < 0
    u = control_point_phases(matrix, np.ones(2))
    assert u[1] / u[0] == pytest.approx(-1, abs=0.02)


def test_the_default_prefers_equal_drives(array: TransducerArray) -> None:
    points = Sphere().sample()
    np.testing.assert_array_equal(solve(array, points).drive, solve(array, points, gamma=1.0).drive)


@given(st.integers(0, 2**32 - 1))
def test_phases_gain_on_equal_ones(seed: int) -> None:
    """The point of section 3.2: the quadratic form uᴴ·R·u is larger than with all phases equal, or with random ones."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.05, -0.05, 0.15], [0.05, 0.05, 0.25], size=(16, 3))
    matrix = transfer_matrix(TransducerArray.grid(), points)
    gram = matrix @ matrix.conj().T / np.einsum("mn,mn->m", matrix, matrix.conj()).real
    chosen, equal = control_point_phases(matrix, np.ones(16)), np.ones(16)
    random = np.exp(2j * np.pi * rng.uniform(size=16))
    gains = [(u.conj() @ gram @ u).real for u in (chosen, equal, random)]
    assert gains[0] > max(gains[1:])


def test_the_sphere_is_felt_evenly(array: TransducerArray) -> None:
    points = Sphere().sample()
    solution = solve(array, points)
    felt = np.abs(pressure(array, solution.drive, points.positions))
    assert felt.std() / felt.mean() < 0.02
    away = np.abs(pressure(array, solution.drive, [[0, 0, 0.2], [0.09, 0.09, 0.2]]))
    assert away.max() < 0.25 * felt.min()


def test_mixed_amplitudes_and_nulls_are_met(array: TransducerArray) -> None:
    points = ControlPoints([[-0.03, 0, 0.2], [0.03, 0, 0.2], [0, 0.03, 0.2]], [1.0, 0.5, 0.0])
    felt = np.abs(pressure(array, solve(array, points).drive, points.positions))
    assert felt[1] / felt[0] == pytest.approx(0.5, abs=0.05)
    assert felt[2] / felt[0] < 0.05


def test_only_the_ratio_of_amplitudes_matters(array: TransducerArray) -> None:
    positions = [[-0.03, 0, 0.2], [0.03, 0, 0.2]]
    quiet, loud = (solve(array, ControlPoints(positions, [s, s / 2])).drive for s in (1e-200, 1e200))
    np.testing.assert_allclose(quiet, loud)


def test_the_same_input_gives_the_same_bits(array: TransducerArray) -> None:
    first, second = (solve(array, Sphere().sample()).drive for _ in range(2))
    assert first.tobytes() == second.tobytes()


@given(
    st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.01, 1.0)), min_size=1, max_size=40),
    st.floats(0, 1),
)
def test_any_reachable_points_give_a_usable_drive(points: list[tuple[float, float, float]], gamma: float) -> None:
    """Crowded and repeated points included."""
    drive = solve(TransducerArray.grid(8, 8), ControlPoints(points), gamma=gamma).drive
    assert np.isfinite(drive).all()
    assert np.abs(drive).max() == pytest.approx(1)


def test_a_transducer_that_looks_away_stays_silent() -> None:
    array = TransducerArray([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]], [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    drive = solve(array, ControlPoints([[0, 0, 0.2]])).drive
    assert abs(drive[0]) == pytest.approx(1)
    assert drive[1] == 0


def test_too_large_a_problem_is_refused_before_it_fills_the_memory() -> None:
    with pytest.raises(
        ValueError, match="4000 control points with 40000 transducers are too many; at most 4096 points"
    ):
        solve(TransducerArray.grid(200, 200), ControlPoints(np.full((4000, 3), 0.2)))
    with pytest.raises(ValueError, match="4097 control points with 4 transducers are too many"):
        solve(TransducerArray.grid(2, 2), ControlPoints(np.full((4097, 3), 0.2)))


def test_repeated_points_without_regularisation_are_refused(array: TransducerArray) -> None:
    with pytest.raises(ValueError, match="mu 1e-30 is too small for points as close together as these"):
        solve(array, ControlPoints([[0, 0, 0.2]] * 3), mu=1e-30)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "unknown method 'magic'; known are tikhonov"),
        ({"gamma": 1.5}, "gamma 1.5 must lie between 0 and 1"),
        ({"gamma": np.nan}, "gamma nan"),
        ({"mu": 0.0}, "mu 0.0 must be positive and at most 1e.06"),
        ({"mu": 1e308}, "mu 1e.308 must be"),
        ({"phase_steps": -1}, "phase_steps -1 must be a whole number"),
    ],
)
def test_bad_options_are_named(array: TransducerArray, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        solve(array, ControlPoints([[0, 0, 0.2]]), **options)
