"""The resonator against scipy's discretisation of its transfer function, against Fourier, and against finer steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Transducer
from phasewire.solver.acoustics.resonator import Resonator
from phasewire.solver.compiled.simd import LANES
from phasewire.solver.compiled.time_kernels import POINTS_AT_ONCE, place_envelopes, place_waves, ring, sum_bursts
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


def test_it_answers_its_own_frequency_unchanged_and_no_direct_voltage() -> None:
    resonator = Resonator()
    assert resonator.response(CARRIER) == pytest.approx(1)
    assert abs(resonator.response(3 * CARRIER)) < 0.01
    assert abs(resonator.sampled(TICK).ring(np.ones(30_000)).real[-1]) < 1e-12
    assert resonator.quality == pytest.approx(37.7, abs=0.01)
    assert Resonator.of(Transducer(resonance=41e3, time_constant=0.2e-3)) == Resonator(41e3, 0.2e-3)
    assert Resonator.of(Transducer()) == resonator


@given(st.integers(0, 25), st.integers(0, 49), st.floats(0.2e-3, 0.5e-3))
def test_a_square_pulse_settles_to_the_phasor_model(width: int, start: int, time_constant: float) -> None:
    """Driven by π/2 for w of 50 ticks it emits sin(πw/50) with the phase of the pulse's centre."""
    one = Resonator(CARRIER, time_constant).sampled(TICK)
    drive = np.pi / 2 * ((np.arange(50) - start) % 50 < width)
    settled = one.ring(drive)[-1] / (1 - one.decay**50)  # z = decay⁵⁰·z + the sum of one period
    states = one.ring(drive, settled)
    assert states[-1] == pytest.approx(settled)
    fine = (np.arange(40) + 0.5) / 40  # between the ticks too: a sum over ticks would fold the 49th harmonic back
    weight = one.between(fine)
    wave = ((1 - weight) * states[:-1, None] + weight * states[1:, None]).real.ravel()
    time = (np.arange(50)[:, None] + fine).ravel()
    fundamental = 2 * np.mean(wave * np.exp(2j * np.pi * time / 50))
    expected = math.sin(math.pi * width / 50) * np.exp(2j * np.pi * (start + width / 2) / 50)
    assert fundamental == pytest.approx(expected, abs=1e-7)


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


@given(RESONATORS)
def test_an_envelope_follows_the_wave(resonator: Resonator) -> None:
    """A carrier that is switched on, wave by wave and as an envelope: alike to 1/Q."""
    ticks = np.arange(200 * 50)
    one = resonator.sampled(TICK)
    wave = one.ring(np.cos(2 * np.pi * (ticks + 0.5) / 50)).real
    turns = np.exp(2j * np.pi * np.arange(50) / 50) / 25
    phasors = np.lib.stride_tricks.sliding_window_view(wave, 50)[25:-25:50] @ turns * np.exp(1j * np.pi)
    envelope = resonator.enveloped(CARRIER, 1 / CARRIER).ring(np.ones(200))
    assert np.abs(phasors - envelope[1 : len(phasors) + 1]).max() < 1 / resonator.quality
    assert abs(phasors[-1] - envelope[-1]) < 2e-3


@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.integers(0, 60), RESONATORS)
def test_the_kernel_rings_every_bit_as_the_readable_one(
    seed: int, words: int, steps: int, resonator: Resonator
) -> None:
    rng = np.random.default_rng(seed)
    levels = rng.integers(0, 2**32, (steps + 1, words), dtype=np.uint32)
    drives, start = rng.normal(size=(2, 2)), rng.normal(size=32 * words) + 1j
    bits = np.array([[[word >> b & 1 for b in range(32)] for word in row] for row in levels.tolist()])
    bits = bits.reshape(steps + 1, 32 * words)
    one = resonator.sampled(TICK)
    expected = one.ring(drives[bits[:-1], bits[1:]], start)
    state, states = start.copy(), np.empty((32 * words, steps + 1), np.complex64)
    ring(levels[1:], drives, one.decay, (1 - one.decay) * one.gain, levels[0], state, states)
    np.testing.assert_allclose(states, expected.T, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(state, expected[-1], rtol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(1, 2), st.integers(0, 40), st.integers(1, 2))
def test_the_kernel_adds_up_bursts_of_waves(seed: int, sets: int, steps: int, groups: int) -> None:
    rng = np.random.default_rng(seed)
    points, sources, filled = groups * POINTS_AT_ONCE, 5, -(-steps // LANES) * LANES
    states = (rng.normal(size=(sets, sources, steps + 1)) + 1j * rng.normal(size=(sets, sources, steps + 1))).astype(
        np.complex64
    )
    lag = rng.integers(0, 30, (points, sources))
    here, following = (rng.normal(size=(2, points, sources, 2)) @ [1, 1j]).astype(np.complex64)
    waves = np.zeros((4, sets, sources, filled), np.float32)
    waves[:2, :, :, :steps] = states.real[..., :-1], states.imag[..., :-1]
    waves[2:, :, :, :steps] = states.real[..., 1:], states.imag[..., 1:]
    total = np.full((points * sets, 30 + filled), 7, np.float32)
    sum_bursts(waves.reshape(4, sets * sources, filled), lag, here, following, total)
    expected = np.zeros((points, sets, 30 + filled))
    for i, r, q in np.ndindex(points, sets, sources):
        heard = here[i, q] * states[r, q, :-1] + following[i, q] * states[r, q, 1:]
        expected[i, r, lag[i, q] : lag[i, q] + steps] += heard.real
    np.testing.assert_allclose(total, expected.reshape(total.shape), atol=1e-5)


SPEED, PITCH = 343.0, 0.0123


def placed(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.complex64], NDArray[np.float64]]:
    """Points, sources, arriving waves, and the ways between them."""
    rng = np.random.default_rng(seed)
    points, sources = rng.uniform(-1, 1, (4, 3)), rng.uniform(-1, 1, (6, 3))
    arrival = (rng.normal(size=(4, 6, 2)) @ [1, 1j]).astype(np.complex64)
    arrival[0] = arrival[0].real
    arrival[1, 0] = 0
    return points, sources, arrival, np.linalg.norm(points[:, None] - sources, axis=2)


@given(st.integers(0, 2**32 - 1), RESONATORS)
def test_the_kernel_places_waves_with_their_signs_and_delays(seed: int, resonator: Resonator) -> None:
    """A steady carrier is heard as the wave that arrives, with the phase of its way."""
    points, sources, arrival, way = placed(seed)
    one = resonator.sampled(TICK)
    lag, (here, following) = np.empty((4, 6), np.int64), np.empty((2, 4, 6), np.complex64)
    rate, per_radian = 1 / (SPEED * TICK), 1 / (2 * np.pi * CARRIER * TICK)
    place_waves(points, sources, arrival, rate, per_radian, one.between_series(), lag, here, following)
    sign = np.where(arrival.real < 0, -1, 1)
    delay = way * rate + np.angle(sign * arrival) * per_radian
    np.testing.assert_array_equal(lag, np.ceil(delay))
    expected = sign * np.abs(arrival) * one.between(lag - delay)
    np.testing.assert_allclose(following, expected, atol=1e-5)
    np.testing.assert_allclose(here + following, sign * np.abs(arrival), atol=1e-5)


@given(st.integers(0, 2**32 - 1), RESONATORS, st.integers(1, 3))
def test_the_kernel_places_envelopes(seed: int, resonator: Resonator, count: int) -> None:
    points, sources, arrival, way = placed(seed)
    one = resonator.enveloped(CARRIER, 1 / CARRIER)
    fields = np.random.default_rng(seed).normal(size=(2, 6, count)).astype(np.float32)
    first, lags = -1, math.ceil(way.max() / PITCH) + 3
    re, im = np.full((2, 4, lags, count), 7, np.float32)
    place_envelopes(points, sources, arrival, 1 / PITCH, one.between_series(), fields, first, re, im)
    expected = np.zeros((4, lags, count), np.complex128)
    for i, q in np.ndindex(4, 6):
        whole = math.ceil(way[i, q] / PITCH)
        wave = arrival[i, q] * np.exp(2j * np.pi * way[i, q] / PITCH) * (fields[0, q] + 1j * fields[1, q])
        ahead = one.between(whole - way[i, q] / PITCH)
        expected[i, whole - first] += wave * (1 - ahead)
        expected[i, whole - 1 - first] += wave * ahead
    np.testing.assert_allclose(re + 1j * im, expected, atol=1e-4)


@given(RESONATORS, st.floats(0.1e-6, 11.9e-6))
def test_a_part_of_a_step_as_a_polynomial(resonator: Resonator, step: float) -> None:
    one, part = resonator.sampled(step), np.linspace(0, 1, 20)
    found = np.polynomial.polynomial.polyval(part, one.between_series())
    np.testing.assert_allclose(found, one.between(part), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Resonator(frequency=0), "resonator frequency 0 Hz must be positive"),
        (lambda: Resonator(40e3, 1e-6), r"has the quality factor 0\.126; it oscillates only above 0\.5"),
        (lambda: Resonator().sampled(13e-6), r"a step of 1\.3e-05 s must be positive and less than half a period"),
        (lambda: Resonator().sampled(0), r"a step of 0\.0 s"),
        (lambda: Resonator().enveloped(CARRIER, -1), r"a step of -1\.0 s must be positive"),
        (lambda: Resonator(80e3).enveloped(CARRIER, 25e-6), "80000 and 40000 Hz, part by less than half a period"),
    ],
)
def test_impossible_resonators_are_refused(call: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()
