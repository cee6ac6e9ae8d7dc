"""The resonator against scipy's discretisation of its transfer function, against Fourier, and against finer steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire.solver.acoustics.resonator import Resonator
from scipy import signal

TICK = 0.5e-6
CARRIER = 40e3
RESONATORS = st.builds(Resonator, st.floats(38e3, 42e3), st.floats(0.2e-3, 0.5e-3))


def band_pass(resonator: Resonator) -> tuple[list[float], list[float]]:
    """Numerator and denominator of (2/τ)·s/(s² + (2/τ)·s + ω₀²)."""
    rate = 2 / resonator.time_constant
    return [rate, 0], [1, rate, (2 * np.pi * resonator.frequency) ** 2]


@given(RESONATORS, st.integers(0, 2**32 - 1), st.floats(0.05e-6, 5e-6))
def test_it_is_the_zero_order_hold_of_a_band_pass(resonator: Resonator, seed: int, step: float) -> None:
    drive = np.random.default_rng(seed).normal(size=200)
    a, b, c, d, _ = signal.cont2discrete(signal.tf2ss(*band_pass(resonator)), step, method="zoh")
    state, expected = np.zeros((2, 1)), []
    for value in drive:
        expected.append((c @ state).item() + d.item() * value)
        state = a @ state + b * value
    found = resonator.sampled(step).ring(drive).real
    np.testing.assert_allclose(found[:-1], expected, atol=1e-9 * np.abs(expected).max())
    assert found[-1] == pytest.approx((c @ state).item(), abs=1e-9)


@given(RESONATORS, st.floats(1e3, 200e3))
def test_its_response_is_that_of_the_band_pass(resonator: Resonator, frequency: float) -> None:
    _, expected = signal.freqs(*band_pass(resonator), worN=[2 * np.pi * frequency])
    assert resonator.response(frequency) == pytest.approx(np.conj(expected[0]))  # time factor e^{-iωt}


@given(RESONATORS, st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_interpolation_between_steps_equals_finer_steps(resonator: Resonator, parts: int, seed: int) -> None:
    drive = np.random.default_rng(seed).normal(size=(20, 2))
    coarse = resonator.sampled(TICK)
    states = coarse.ring(drive)
    finer = resonator.sampled(TICK / parts).ring(np.repeat(drive, parts, axis=0))
    weight = coarse.between(np.arange(parts) / parts)[:, None]
    found = (1 - weight) * states[:-1, None] + weight * states[1:, None]
    np.testing.assert_allclose(found.reshape(-1, 2), finer[:-1], atol=1e-10)


@given(RESONATORS)
def test_an_envelope_settles_to_the_response_and_fades_with_the_time_constant(resonator: Resonator) -> None:
    one = resonator.enveloped(CARRIER, 1 / CARRIER)
    up = one.ring(np.full(2000, 0.5j))
    assert up[-1] == pytest.approx(0.5j * resonator.response(CARRIER))
    down = np.abs(one.ring(np.zeros(100), up[-1]))
    np.testing.assert_allclose(down, down[0] * np.exp(-np.arange(101) / CARRIER / resonator.time_constant))


SPEED, PITCH = 343.0, 0.0123


def placed(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.complex64], NDArray[np.float64]]:
    """Points, sources, arriving waves, and the ways between them."""
    rng = np.random.default_rng(seed)
    points, sources = rng.uniform(-1, 1, (4, 3)), rng.uniform(-1, 1, (6, 3))
    arrival = (rng.normal(size=(4, 6, 2)) @ [1, 1j]).astype(np.complex64)
    arrival[0] = arrival[0].real
    arrival[1, 0] = 0
    return points, sources, arrival, np.linalg.norm(points[:, None] - sources, axis=2)


@given(RESONATORS, st.floats(0.1e-6, 11.9e-6))
def test_a_part_of_a_step_as_a_polynomial(resonator: Resonator, step: float) -> None:
    one, part = resonator.sampled(step), np.linspace(0, 1, 20)
    found = np.polynomial.polynomial.polyval(part, one.between_series())
    np.testing.assert_allclose(found, one.between(part), rtol=1e-12, atol=1e-14)
