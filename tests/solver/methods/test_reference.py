"""The readable algorithms against their equations taken literally, and against their promises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Medium, TransducerArray
from phasewire.solver.acoustics.propagation import transfer_matrix
from phasewire.solver.methods import reference
from phasewire.solver.methods.reference import Regularised, cold_start, misfit, phase_iteration, unit

seeds = st.integers(0, 2**32 - 1)


def points_above(seed: int, m: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-0.05, -0.05, 0.15], [0.05, 0.05, 0.25], size=(m, 3))


def random_system(seed: int, m: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(m, n)) + 1j * rng.normal(size=(m, n)), rng.uniform(0.1, 1, m)


def test_multiplexing_is_the_sum_of_times_of_flight(array: TransducerArray) -> None:
    """(12): arg Σ_i e^{−ik·r_iq}, the distances by hand."""
    points = points_above(1, 5)
    k = Medium().wavenumber
    by_hand = np.array(
        [sum(np.exp(-1j * k * np.linalg.norm(point - place)) for point in points) for place in array.positions]
    )
    drive = reference.limit_drive(
        reference.multiplex(transfer_matrix(array, points), np.ones(5)), np.ones(320), "phase"
    )
    np.testing.assert_allclose(drive, by_hand / np.abs(by_hand), atol=1e-9)


@pytest.mark.parametrize("gamma", [0.0, 0.5, 1.0])
@given(seed=seeds, m=st.integers(1, 30))
def test_woodbury_is_the_augmented_least_squares_problem(gamma: float, seed: int, m: int) -> None:
    """The paper's (10) solved literally: [A; √μ·diag(σ^γ)]·x = [b; 0], also with more points than transducers."""
    n = 12
    matrix, wanted = random_system(seed, m, n)
    sigma = np.sqrt(sum(abs(matrix[i]) * wanted[i] for i in range(m)) / m)
    weighted = matrix @ np.diag(sigma ** (-2 * gamma)) @ matrix.conj().T
    mu = 0.03 * np.trace(weighted).real / m
    b = wanted * cold_start(m)
    augmented = np.vstack([matrix, np.sqrt(mu) * np.diag(sigma**gamma)])
    expected = np.linalg.lstsq(augmented, np.concatenate([b, np.zeros(n)]), rcond=None)[0]
    solved = Regularised(matrix, wanted, gamma, 0.03).solve(b)
    np.testing.assert_allclose(solved, expected, atol=1e-9 * abs(expected).max())


@given(seed=seeds, m=st.integers(1, 20), gamma=st.floats(0, 1))
def test_the_paper_s_system_is_tikhonov_with_mu_1_in_pascals(seed: int, m: int, gamma: float) -> None:
    matrix, wanted = random_system(seed, m, 15)
    system = Regularised(matrix, wanted, gamma, 1.0)
    mu = m / np.trace(system.gram).real  # so that mu·tr(G)/m = 1
    expected = Regularised(matrix, wanted, gamma, mu).solve(wanted * cold_start(m))
    literal = reference.augmented(matrix, wanted, cold_start(m), gamma)
    np.testing.assert_allclose(literal, expected, atol=1e-8 * abs(expected).max())


@given(seed=seeds, m=st.integers(1, 30))
def test_min_norm_is_the_pseudo_inverse(seed: int, m: int) -> None:
    """The smallest exact drive for fewer points than transducers, least squares for more."""
    matrix, wanted = random_system(seed, m, 12)
    b = wanted * cold_start(m)
    np.testing.assert_allclose(reference.min_norm(matrix, wanted, cold_start(m)), np.linalg.pinv(matrix) @ b, atol=1e-8)


@pytest.mark.parametrize("method", ["unit", "power"])
def test_phases_follow_equation_9_literally(array: TransducerArray, method: Any) -> None:
    """Column j of R is the field, at all points, of the drive that (8) gives for point j alone at its amplitude."""
    matrix = transfer_matrix(array, points_above(9, 7))
    wanted = np.random.default_rng(9).uniform(0.1, 1, 7)
    response = np.empty((7, 7), complex)
    for j in range(7):
        drive = np.conj(matrix[j]) * wanted[j] / np.sum(np.abs(matrix[j]) ** 2)
        response[:, j] = matrix @ drive
    u = cold_start(7)
    for _ in range(20):
        u = response @ u
        u /= np.abs(u) if method == "unit" else np.linalg.norm(u)
    np.testing.assert_allclose(
        phase_iteration(matrix @ matrix.conj().T, wanted, cold_start(7), 20, method), u, atol=1e-9
    )


@given(seed=seeds, output=st.sampled_from(["solved", "phase", "limited"]))
def test_drives_stay_within_their_limits(seed: int, output: Any) -> None:
    rng = np.random.default_rng(seed)
    drive = rng.normal(size=20) * 10.0 ** rng.uniform(-3, 3) * np.exp(2j * np.pi * rng.uniform(size=20))
    limits = rng.choice([0.0, 0.25, 1.0], 20)
    limits[0] = 0.5
    limited = reference.limit_drive(drive, limits, output)
    assert (np.abs(limited) <= limits * (1 + 1e-12)).all()
    able = limits > 0
    np.testing.assert_allclose(np.angle(limited[able] * drive[able].conj()), 0, atol=1e-9)
    reached = np.abs(limited[able]) / limits[able]
    assert reached.max() == pytest.approx(1)
    if output == "phase":
        np.testing.assert_allclose(reached, 1)
    if output == "solved":
        scale = np.abs(limited[able]) / np.abs(drive[able])
        np.testing.assert_allclose(scale, scale[0])


def test_limited_drives_below_the_limit_are_all_scaled_alike() -> None:
    drive = np.array([0.1, 0.2, 4.0, 5.0j])
    limited = np.abs(reference.limit_drive(drive, np.ones(4), "limited"))
    assert limited[1] == pytest.approx(2 * limited[0])
    np.testing.assert_allclose(limited[2:], 1)
    assert limited[0] == pytest.approx(0.1 * 2 * 2 / np.linalg.norm(drive))  # 2 × the root mean square


@pytest.fixture
def exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Conjugate gradients until nothing is left to do."""
    monkeypatch.setattr(reference, "GRADIENTS", 60)
    monkeypatch.setattr(reference, "FLAT", 1e-8)


def test_a_step_is_gauss_newton_by_finite_differences(exactly: None) -> None:
    """Derivatives of |p|, and of a null both parts of p, by turning one drive after the other a little."""
    matrix, wanted = random_system(3, 5, 16)
    wanted[[1, 4]] = 0
    rng = np.random.default_rng(3)
    drive = np.linalg.pinv(matrix) @ (wanted * cold_start(5)) + 0.01 * rng.normal(size=16)
    start = matrix @ drive
    scale = wanted @ np.abs(start) / (wanted @ wanted)
    rows, little = [*range(5), 1, 4], 1e-6

    def parts(x: np.ndarray) -> np.ndarray:
        turned = matrix @ x * np.exp(-1j * np.angle(start))
        return np.concatenate([np.abs(turned)[:5] * np.sign(turned.real), turned.imag[[1, 4]]])

    turns = np.exp(1j * little * np.eye(16))
    slopes = np.stack([(parts(drive * turn) - parts(drive / turn)) / (2 * little) for turn in turns], axis=1)
    missing = np.concatenate([scale * wanted - np.abs(start), [0, 0]])
    across = np.eye(7) - np.outer(wanted[rows], wanted[rows]) / (wanted @ wanted)
    angles = np.linalg.pinv(across @ slopes) @ missing
    expected = drive * np.exp(2j * np.arctan(angles / 2))  # a turn of any size stays below half of one
    found = reference.correct(matrix, wanted, drive, 1)
    assert misfit(matrix @ found, wanted)[1] < misfit(start, wanted)[1]
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(drive).max())


@given(seed=seeds, m=st.integers(2, 40), output=st.sampled_from(["solved", "phase", "limited"]))
def test_corrections_keep_the_magnitudes_and_never_end_worse_than_they_began(seed: int, m: int, output: Any) -> None:
    array = TransducerArray.grid(8, 8)
    matrix = transfer_matrix(array, points_above(seed, m))
    wanted = np.random.default_rng(seed).uniform(0.2, 1, m)
    system = Regularised(matrix, wanted, 1.0, 0.03)
    phases = unit(phase_iteration(system.gram, wanted, cold_start(m), 20))
    begin = reference.limit_drive(system.solve(wanted * phases), np.ones(64), output)
    drives = [reference.correct(matrix, wanted, begin, steps) for steps in (0, 5, 10)]
    np.testing.assert_array_equal(drives[0], begin)
    np.testing.assert_allclose(np.abs(drives[2]), np.abs(begin))
    errors = [misfit(matrix @ drive, wanted)[1] for drive in drives]
    assert errors[2] <= errors[1] <= errors[0]


@pytest.mark.parametrize("levels", [8, 100])
@given(seed=seeds)
def test_polishing_quantises_and_never_makes_the_fit_worse(levels: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, wanted = random_system(seed, 6, 24)
    drive = rng.uniform(0.1, 1, 24) * np.exp(2j * np.pi * rng.uniform(size=24))
    coarse = reference.polish(matrix, wanted, drive, levels, sweeps=0)
    fine = reference.polish(matrix, wanted, drive, levels, sweeps=3)
    step = 2 * np.pi / levels
    np.testing.assert_allclose(np.abs(np.angle(coarse / drive)), 0, atol=step / 2 + 1e-9)
    for polished in (coarse, fine):
        np.testing.assert_allclose(np.abs(polished), np.abs(drive))
        turns = np.angle(polished) / step
        np.testing.assert_allclose(turns, np.rint(turns), atol=1e-6)
    assert misfit(matrix @ fine, wanted)[1] <= misfit(matrix @ coarse, wanted)[1]


def test_misfit_is_the_relative_deviation_from_the_best_scale() -> None:
    exact = misfit(np.array([2.0, 1.0j, 0.0]), np.array([1.0, 0.5, 0.0]))
    np.testing.assert_allclose(exact, (2, 0), atol=1e-12)
    uneven = misfit(np.array([3.0 + 0j, 1.0]), np.array([1.0, 1.0]))
    np.testing.assert_allclose(uneven, (2, 0.5))
