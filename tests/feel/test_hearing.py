"""What is heard, against the table of the A-curve, closed forms of tones, the transform of every edge, and a sum over
all of a field's sources.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Medium, Pulses, TransducerArray
from phasewire.feel.hearing import Audible, a_weighting, audible, square_pulses
from phasewire.feel.power import full_power
from phasewire.solver.acoustics.resonator import Resonator
from phasewire.solver.fields.validity import aperture_radius

MEDIUM = Medium()
C, CARRIER, STRENGTH = MEDIUM.speed_of_sound, 40_000.0, 5.73
ONE = TransducerArray([[0, 0, 0]], [[0, 0, 1]])

# IEC 61672-1, table 3: third octaves from 10 Hz to 20 kHz.
TABLE = """-70.4 -63.4 -56.7 -50.5 -44.7 -39.4 -34.6 -30.2 -26.2 -22.5 -19.1 -16.1 -13.4 -10.9 -8.6 -6.6 -4.8 -3.2 -1.9
-0.8 0.0 0.6 1.0 1.2 1.3 1.2 1.0 0.5 -0.1 -1.1 -2.5 -4.3 -6.6 -9.3"""


def test_the_a_curve_is_that_of_the_table() -> None:
    exact = 1000 * 10 ** (np.arange(-20, 14) / 10)
    np.testing.assert_allclose(a_weighting(exact), [float(level) for level in TABLE.split()], atol=0.0501)
    assert abs(a_weighting(1000.0)) < 1e-3
    assert a_weighting(0.0) == -np.inf


@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 25)), min_size=1, max_size=20))
def test_pulses_of_drives_are_those_of_their_bits(given_pulses: list[tuple[int, int]]) -> None:
    pulses = Pulses(*np.array(given_pulses).T)
    ticks = np.arange(50)[:, None]
    high = (ticks - pulses.start) % 50 < pulses.width
    moments = high.T @ ((np.arange(50) + 0.5) / 50 - 0.5) / 50
    np.testing.assert_allclose(square_pulses(pulses.to_drive()), high.mean(axis=0) + 1j * moments, atol=1e-6)


def tone(series: np.ndarray, frequency: float) -> np.ndarray:
    """Amplitude of a tone in whole cycles, (j, t) to (j,)."""
    turns = np.exp(2j * np.pi * frequency / CARRIER * np.arange(series.shape[-1]))
    return np.asarray(2 * np.abs(series @ turns) / series.shape[-1])


@pytest.mark.parametrize("frequency", [200.0, 2000.0, 10_000.0])
def test_a_duty_that_swings_is_a_tone_far_below_the_resonance(frequency: float) -> None:
    swing = np.cos(2 * np.pi * frequency / CARRIER * np.arange(400))
    at = [[0, 0, 0.3], [0.4, 0, 0]]  # in all directions alike
    found = audible(ONE, np.ones((400, 1)), (0.25 + 0.1 * swing)[:, None], at)
    response = abs(Resonator().response(frequency))
    expected = math.pi / 2 * 0.1 * STRENGTH / np.linalg.norm(at, axis=1) * frequency / CARRIER * response
    expected *= np.sinc(frequency / CARRIER)  # of a pulse somewhere in its period
    np.testing.assert_allclose(tone(found.linear, frequency), expected, rtol=1e-5)
    if frequency == 200:  # a stiff plate: its acceleration goes as f², over the quality factor
        assert response * frequency / CARRIER == pytest.approx(
            (frequency / CARRIER) ** 2 / Resonator().quality, rel=1e-3
        )
    assert np.abs(found.demodulated).max() < 1e-6


def test_the_linear_part_is_the_transform_of_every_edge() -> None:
    array, at = TransducerArray.grid(3, 2, pitch=0.04), np.array([[0.1, -0.3, 0.4]])
    rng = np.random.default_rng(5)
    few = [Pulses(rng.integers(0, 100, 6), rng.integers(5, 26, 6)) for _ in range(4)]
    played = np.repeat(np.arange(4), 50)
    ticks = np.arange(50)[:, None]
    bits = np.concatenate([(ticks - few[k].start) % 50 < few[k].width for k in played]).astype(float)
    drives = np.array([few[k].to_drive() for k in played])
    frequency = np.arange(1, 101) * 200.0
    spectrum = np.conj(scipy.fft.rfft(bits, axis=0)[1:101].T) * 2 / len(bits) * np.sinc(frequency / 2e6)
    delay = np.linalg.norm(at - array.positions, axis=1)[:, None] / C + 0.25e-6  # from a tick's middle
    response = np.array([Resonator().response(f) for f in frequency])
    path = STRENGTH / (delay * C) * np.exp(2j * np.pi * frequency * delay)
    expected = np.abs((path * math.pi / 2 * spectrum).sum(axis=0) * response * frequency / CARRIER)
    found = audible(array, drives, square_pulses(drives), at)
    heard = np.array([tone(found.linear, f)[0] for f in frequency[:99]])
    for band, error in ((slice(0, 25), 0.06), (slice(25, 50), 0.15)):  # up to 5 and 10 kHz
        assert np.linalg.norm(heard[band] - expected[band]) < error * np.linalg.norm(expected[band])
    levels = [
        10 * np.log10(np.sum((part * 10 ** (a_weighting(frequency[:99]) / 20)) ** 2)) for part in (heard, expected[:99])
    ]
    assert levels[0] == pytest.approx(levels[1], abs=1.5)


@pytest.mark.parametrize("frequency", [200.0, 1000.0, 5000.0])
def test_power_that_swings_is_demodulated(array: TransducerArray, frequency: float) -> None:
    intensity = 0.5 + 0.4 * np.cos(2 * np.pi * frequency / CARRIER * np.arange(400))
    at = np.array([0.2, -0.4, 0.47])
    found = audible(array, np.sqrt(intensity)[:, None] * np.ones(320), None, [at], reach=0.25)
    aside, k, a = math.hypot(*at[:2]), 2 * np.pi * frequency / C, aperture_radius(array)

    def source(s: float) -> complex:
        way = math.hypot(aside, at[2] - s)
        x = k * a * aside / way
        return complex(np.exp(1j * k * (s + way)) / way * 2 * scipy.special.j1(x) / x)

    integral, _ = scipy.integrate.quad(source, 0, 0.25, complex_func=True)
    swing = 320 * full_power(array.transducer) * 0.4
    expected = 1.2 / (4 * np.pi * C**3) * (2 * np.pi * frequency) ** 2 * swing * abs(integral)
    np.testing.assert_allclose(tone(found.demodulated, frequency), expected, rtol=2e-3)
    assert not found.linear.any()


def test_sound_of_the_beam_arrives_after_its_way() -> None:
    """A step of power far away: nothing before, and the second derivative of it when it arrives."""
    steps = np.zeros((4000, 1))
    steps[1000:] = 1
    found = audible(ONE, steps, None, [[6.86, 0, 0]], reach=0.01).demodulated[0]  # 20 ms
    assert abs(int(np.abs(found).argmax()) - 1800) < 20


def test_a_tone_has_its_level() -> None:
    time = np.arange(20_011) / CARRIER  # no whole number of cycles
    series = [math.sqrt(2) * np.sin(2 * np.pi * f * time) for f in (1000.0, 201.3, 15.0, 19_900.0)]
    found = Audible(np.array(series), np.zeros((4, len(time))), CARRIER)
    expected = 20 * math.log10(1 / 20e-6) + a_weighting([1000.0, 201.3, 15.0, 19_900.0])
    np.testing.assert_allclose(found.weighted("linear")[[0, 1, 3]], expected[[0, 1, 3]], atol=0.02)
    assert found.weighted("linear")[2] < 20  # below what is heard
    assert found.weighted("demodulated")[0] == -np.inf
    frequency, part, level = found.strongest(1)[0]
    assert part == "linear"
    assert frequency == pytest.approx(201.3, abs=2)
    assert level == pytest.approx(expected[1], abs=0.1)
    twice = Audible(np.array(series), np.array(series), CARRIER)
    np.testing.assert_allclose(twice.levels_dba - found.levels_dba, 10 * math.log10(2), atol=1e-6)
    assert "dB(A) at the loudest place: linear 94" in str(found)
