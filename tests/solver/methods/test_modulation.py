from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from phasewire import Medium, TransducerArray, pressure
from phasewire.solver.methods.modulation import Modulation, intensity_component

WEIGHTS = hnp.arrays(np.float64, st.tuples(st.integers(1, 12), st.just(2)), elements=st.sampled_from([0, 0.25, 0.5]))
AT = [[0.01, -0.01, 0.12], [0.0, 0.02, 0.2]]


@pytest.fixture(scope="module")
def small() -> TransducerArray:
    return TransducerArray.grid(4, 3)


def random_drives(seed: int) -> NDArray[np.complex128]:
    rng = np.random.default_rng(seed)
    return np.asarray(np.exp(2j * np.pi * rng.uniform(size=(2, 12))) * rng.uniform(0, 1, (2, 12)))


@given(st.floats(0.5, 20_000), st.sampled_from([25_000.0, 40_000.0]), st.integers(1, 50))
def test_a_sample_lasts_the_nearest_whole_number_of_carrier_periods(
    frequency: float, carrier: float, samples: int
) -> None:
    if frequency * samples > carrier:
        with pytest.raises(ValueError, match="modulation frequency"):
            Modulation.sampled([1], np.ones(samples), frequency, carrier=carrier)
        return
    modulation = Modulation.sampled([1], np.ones(samples), frequency, carrier=carrier)
    wanted = carrier / frequency / samples
    assert modulation.periods >= 1
    assert all(abs(modulation.periods - wanted) <= abs(other - wanted) for other in range(1, int(wanted) + 2))
    assert modulation.true_frequency * modulation.periods * samples == pytest.approx(carrier)
    assert modulation.frequency == frequency


@given(WEIGHTS, st.integers(0, 99))
def test_slots_follow_the_weights(weights: NDArray[np.float64], seed: int) -> None:
    """Expanded to carrier periods, and put together from the weights one by one."""
    modulation = Modulation(random_drives(seed), weights, frequency=500)
    frames, slots = modulation.slots()
    played = [frames[frame] for frame, periods in slots for _ in range(periods)]
    expected = [sum(w * d for w, d in zip(row, modulation.drives, strict=True)) for row in weights]
    np.testing.assert_allclose(played, np.repeat(expected, modulation.periods, axis=0), atol=1e-12)
    assert all(a[0] != b[0] for a, b in pairwise(slots))
    assert list(dict.fromkeys(frame for frame, _ in slots)) == list(range(len(frames)))
    assert len(frames) == len({tuple(row) for row in weights.tolist()})


@pytest.mark.parametrize(("depth", "samples"), [(1.0, 50), (1.0, 7), (0.4, 20), (0.0, 10)])
def test_a_cosine_makes_half_of_the_intensity(small: TransducerArray, depth: float, samples: int) -> None:
    """(1 - d/2 + d/2·cos)² has the harmonics d·(1 - d/2) and d²/8; steps take sinc(harmonic/samples) of them."""
    drive = random_drives(2)[0]
    modulation = Modulation.sine(drive, depth=depth, samples=samples)
    loud = np.abs(pressure(small, drive, AT)) ** 2
    for harmonic, share in ((1, depth * (1 - depth / 2)), (2, depth**2 / 8)):
        steps = math.sin(math.pi * harmonic / samples) / (math.pi * harmonic / samples)
        felt = intensity_component(small, modulation, AT, harmonic)
        np.testing.assert_allclose(felt, share * steps * loud, atol=1e-9 * loud.max())
    np.testing.assert_allclose(modulation.weights, modulation.weights[::-1])  # the cosine's value at each middle
    assert modulation.weights.max() <= 1
    assert modulation.weights.min() >= 1 - depth - 1e-12


@given(WEIGHTS, st.integers(0, 4), st.integers(0, 99))
def test_components_are_the_fourier_integral(weights: NDArray[np.float64], harmonic: int, seed: int) -> None:
    """Compared with a sum over 2000 instants of every sample; fields add as pressures, not as intensities."""
    array = TransducerArray.grid(4, 3)
    modulation = Modulation(random_drives(seed), weights)
    s = len(weights)
    t = (np.arange(2000 * s) + 0.5) / (2000 * s)
    emitted = [weights[j, 0] * modulation.drives[0] + weights[j, 1] * modulation.drives[1] for j in range(s)]
    intensity = np.repeat([np.abs(pressure(array, drive, AT[:1])[0]) ** 2 for drive in emitted], 2000)
    cosine, sine = (2 * np.mean(intensity * wave(2 * np.pi * harmonic * t)) for wave in (np.cos, np.sin))
    expected = math.hypot(cosine, sine) / (2 if harmonic == 0 else 1)
    felt = intensity_component(array, modulation, AT[:1], harmonic)
    np.testing.assert_allclose(felt, expected, rtol=1e-5, atol=1e-5 * max(1.0, intensity.max()))


def test_the_air_of_a_component_can_be_chosen(small: TransducerArray) -> None:
    drive = random_drives(3)[0]
    warm = Medium(30)
    felt = intensity_component(small, Modulation.on_off(drive), AT, medium=warm)
    np.testing.assert_allclose(felt, 2 / math.pi * np.abs(pressure(small, drive, AT, warm)) ** 2)
    slow = Modulation.on_off(drive, carrier=25_000)
    at_25_khz = np.abs(pressure(small, drive, AT, Medium(frequency=25_000))) ** 2
    np.testing.assert_allclose(intensity_component(small, slow, AT), 2 / math.pi * at_25_khz)
    with pytest.raises(ValueError, match="a medium for 40000 Hz does not fit a carrier of 25000 Hz"):
        intensity_component(small, slow, AT, medium=warm)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 1], [[1]]), r"drives must have the shape \(f, n\), not \(2,\)"),
        (([[1, 1]], [1]), r"weights must have the shape \(s, 1\), not \(1,\)"),
        (([[1, 1]], [[1, 1]]), r"weights must have the shape \(s, 1\), not \(1, 2\)"),
        (([[1, 1]], [[1], [-0.5]]), "weight -0.5 of drive 0 in sample 1 must be finite and not negative"),
        (([[0, 0.6], [0, 0.6]], [[1, 0], [1, 1]]), "sample 1 drives transducer 1 beyond 1, which is full drive"),
        (([[1]], [[1]], 0.0), "modulation frequency 0.0 Hz must be from 0.01 to 40000 Hz"),
        (([[1]], [[1], [0]], 30_000), "to 20000 Hz: each of 2 samples lasts a carrier period or more"),
    ],
)
def test_bad_modulations_are_named(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Modulation(*arguments)
