"""From waves to what is felt: spectra as theory says, a literal version, and what is published of modulation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from phasewire import Hand, Medium, TransducerArray
from phasewire.base.pictures import LANDSCAPE
from phasewire.feel.perception import FeltMap, feel, felt_map, radiation_pressures
from phasewire.feel.pictures import save_felt_picture
from phasewire.feel.receptors import TOUCH_CHANNELS
from phasewire.feel.skin import Skin, displacement
from phasewire.feel.unfolding import SkinPatch, SkinPlaces, Unfolded
from phasewire.solver import radiation_pressure, transfer_matrix
from phasewire.solver.acoustics.resonator import Resonator

from tests.pictures import faults_of

FOCUS = (0.0, 0.0, 0.2)
PATCH = SkinPatch(FOCUS, width=0.06, length=0.06, spacing=3e-3)
MIDDLE = 220
CARRIER = 40_000
RATE = 4000.0
WIDTH = 2.5e-3
"""σ of the radiation pressure of an ideal focus: 5.9 mm at half of its height."""


def rung(drives: NDArray[np.complex128]) -> NDArray[np.complex64]:
    """The waves of drives, one row a carrier period, that have always been repeated."""
    one = Resonator().enveloped(CARRIER, 1 / CARRIER)
    return one.ring(np.concatenate([drives, drives]))[1 + len(drives) :].astype(np.complex64)


def focused(array: TransducerArray, places: ArrayLike) -> NDArray[np.complex128]:
    """(k, n) full drives that focus on each of (k, 3) places."""
    matrix = transfer_matrix(array, places).conj()
    return np.asarray(matrix / np.abs(matrix))


def modulated(array: TransducerArray, frequency: float, periods: int) -> NDArray[np.complex64]:
    """Amplitude modulation by (1 − cos)/2."""
    envelope = (1 - np.cos(2 * np.pi * frequency * np.arange(periods) / CARRIER)) / 2
    return rung(envelope[:, None] * focused(array, [FOCUS]))


def circled(array: TransducerArray, frequency: float, radius: float, periods: int, hold: int) -> NDArray[np.complex64]:
    """A focus at full drive that runs around a circle, in steps of so many periods."""
    angle = 2 * np.pi * frequency * np.arange(0, periods, hold) / CARRIER
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1) + FOCUS
    return rung(np.repeat(focused(array, places), hold, axis=0)[:periods])


def spot(places: SkinPlaces, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
    """(t, k) pressure of an ideal focus of 20 Pa at (t,) places."""
    away = places.positions[None, :, :2] - np.stack(np.broadcast_arrays(x, y), axis=-1)[:, None]
    return np.asarray(20 * np.exp(-np.square(away).sum(axis=2) / (2 * WIDTH**2)))


def literal(array: TransducerArray, waves: NDArray[np.complex64], places: SkinPlaces) -> NDArray[np.float64]:
    """The radiation pressure in each carrier period: each transducer's wave by itself, with its cosine."""
    pushed = np.empty((len(waves), len(places.positions)))
    for k, (position, normal) in enumerate(zip(places.positions, places.normals, strict=True)):
        matrix = transfer_matrix(array, [position])[0]
        for t, wave in enumerate(waves):
            arrived = 0j
            for n in range(len(array)):
                way = array.positions[n] - position
                arrived += matrix[n] * wave[n] * max(way @ normal / np.linalg.norm(way), 0)
            pushed[t, k] = radiation_pressure(arrived)
    return pushed


def test_the_radiation_pressure_is_that_of_the_literal_version(array: TransducerArray) -> None:
    rng = np.random.default_rng(3)
    waves = (rng.standard_normal((5, 320)) + 1j * rng.standard_normal((5, 320))).astype(np.complex64)
    hand = Unfolded.of(Hand.flat((0.02, 0, 0.18), curl=0.4).rotated(20, (1, 0, 0)), spacing=0.03)
    expected = literal(array, waves, hand)
    for every in (1, 2):
        pushed = radiation_pressures(array, waves, hand, every=every)
        np.testing.assert_allclose(pushed, expected[::every], atol=1e-4 * expected.max())


def test_amplitude_modulation_is_felt_at_its_frequency_and_at_twice_that(array: TransducerArray) -> None:
    """|p|² ∝ (1 − cos ωt)²/4 = 3/8 − cos(ωt)/2 + cos(2ωt)/8, and the skin's response does not depend on time."""
    felt = feel(array, modulated(array, 20.0, 4000), PATCH)
    strong = np.abs(felt.spectra[:, MIDDLE])
    present = felt.frequencies[strong > 1e-3 * strong.max()]
    np.testing.assert_allclose(present, [20, 40])
    two, one = (strong[np.isclose(felt.frequencies, f)][0] for f in (40, 20))
    assert two / one == pytest.approx(1 / 4, rel=0.02)  # 20 Hz: the resonance and the skin hardly tell them apart


@pytest.mark.parametrize(("hold", "frequency"), [(1, 50.0), (10, 50.0), (40, 200.0)])
def test_few_samples_feel_as_all_of_them(array: TransducerArray, hold: int, frequency: float) -> None:
    waves = circled(array, frequency, 0.01, 4000, hold)
    few, all_ = (feel(array, waves, PATCH, every=every).intensity for every in (10, 1))
    np.testing.assert_allclose(few, all_, rtol=0.02)


def test_a_felt_map_has_the_displacement_of_the_skin() -> None:
    """Sparse spectra in single precision against all of them in double precision."""
    rng = np.random.default_rng(0)
    pushed = rng.random((64, 441))
    skin = Skin.forearm()
    felt = felt_map(pushed, PATCH, 1000.0, skin)
    moved = displacement(skin, pushed.reshape(64, 21, 21), 1000.0, PATCH.spacing).reshape(64, 441)
    spectra = np.fft.rfft(moved, axis=0).conj()[1:32] * 2 / 64
    np.testing.assert_allclose(felt.frequencies, np.arange(1, 32) * 1000 / 64)
    np.testing.assert_allclose(felt.spectra, spectra, atol=1e-5 * np.abs(spectra).max())


def vibrating(frequency: float, amplitude: float, radius: float) -> FeltMap:
    """Skin of which a disc moves by so many metres (peak)."""
    patch = SkinPatch(FOCUS, 0.06, 0.06, 1e-3)
    away = np.linalg.norm(patch.positions - FOCUS, axis=1)
    spectra = np.where(away <= radius, amplitude, 0)[None].astype(np.complex64)
    return FeltMap(patch, 1000.0, 1000, np.array([frequency]), spectra)


@pytest.mark.parametrize(("frequency", "channel"), [(2.0, 2), (30.0, 1), (250.0, 0)])
def test_a_contactor_at_the_threshold_has_the_intensity_1(frequency: float, channel: int) -> None:
    threshold = float(TOUCH_CHANNELS[channel].threshold(frequency))
    felt = vibrating(frequency, threshold, 0.012)
    middle = len(felt.intensity) // 2
    assert felt.intensity[middle] == pytest.approx(1, rel=1e-6)
    assert felt.levels[:, middle].argmax() == channel


def test_half_the_area_needs_3_db_more_for_the_pacinian_channel_alone() -> None:
    """Verrillo 1963: from 0.02 to 2.9 cm²."""
    whole = np.sqrt(2.9e-4 / np.pi)
    for frequency, share in ((250.0, 0.5), (25.0, 1.0)):
        large, half = (vibrating(frequency, 1e-5, radius) for radius in (whole, whole / np.sqrt(2)))
        middle = len(large.intensity) // 2
        assert (half.intensity[middle] / large.intensity[middle]) ** 2 == pytest.approx(share, rel=0.03)


def test_energy_adds_within_a_channel() -> None:
    one = vibrating(250.0, 1e-6, 0.02)
    both = FeltMap(one.places, 1000.0, 1000, np.array([250.0, 300.0]), np.repeat(one.spectra, 2, axis=0))
    assert both.intensity.max() == pytest.approx(np.sqrt(2) * one.intensity.max())


def test_intensity_over_time_is_that_of_the_whole_if_nothing_changes_and_knows_when_something_does() -> None:
    time = np.arange(800)[:, None] / RATE
    tone = (1 + np.cos(2 * np.pi * 200 * time)) * spot(PATCH, np.zeros(1), 0)
    felt = felt_map(tone, PATCH, RATE)
    np.testing.assert_allclose(felt.intensity_over_time(0.02), [felt.intensity] * 10, rtol=1e-3)
    burst = felt_map(tone * (abs(time - 0.125) < 0.02), PATCH, RATE)
    over_time = burst.intensity_over_time(0.01)[:, MIDDLE]
    assert over_time.shape == (20,)
    assert over_time[[11, 13]].min() > 10 * over_time[:9].max()
    mean = np.sqrt((burst.intensity_over_time(0.01) ** 2).mean(axis=0))
    np.testing.assert_allclose(mean[MIDDLE], burst.intensity[MIDDLE], rtol=1e-3)


def felt_by(frequency: float, radius: float, skin: Skin | None = None) -> FeltMap:
    """An ideal focus that runs around a circle."""
    samples = max(64, 2 ** int(np.ceil(np.log2(2.5 * 800 / frequency))))
    angle = 2 * np.pi * np.arange(samples) / samples
    places = SkinPatch(FOCUS, 0.1, 0.1, 2.5e-3)
    pushed = spot(places, radius * np.cos(angle), radius * np.sin(angle))
    return felt_map(pushed, places, samples * frequency, skin)


@pytest.mark.parametrize("frequency", [50.0, 80.0, 120.0, 200.0])
def test_lateral_modulation_is_felt_more_than_amplitude_modulation(frequency: float) -> None:
    """Takahashi, Hasegawa and Shinoda 2020, at the same largest pressure; the page on skin has what is below 40 Hz."""
    places = SkinPatch(FOCUS, 0.1, 0.1, 2.5e-3)
    swing = ((1 - np.cos(2 * np.pi * np.arange(64) / 64)) / 2) ** 2
    still = felt_map(swing[:, None] * spot(places, np.zeros(1), 0), places, 64 * frequency)
    assert felt_by(frequency, 5e-3).intensity.max() > 1.1 * still.intensity.max()


def test_a_felt_map_says_and_shows_what_it_is(array: TransducerArray) -> None:
    felt = feel(array, modulated(array, 200.0, 400), Unfolded.of(Hand.flat((0, 0, 0.2))), Medium())
    assert re.fullmatch(r"FeltMap\(1\d{3} places, at most [\d.]+ × threshold\)", repr(felt))
    assert np.linalg.norm(felt.places.positions[felt.strongest] - FOCUS) < 5e-3
    lines = felt.summary().splitlines()
    assert re.fullmatch(r"strongest [\d.]+ × threshold at \(.*\) mm \(P [\d.]+, NP I .*, NP III .*\)", lines[0])
    assert re.fullmatch(r"largest vibration there [\d.]+ µm at 200 Hz", lines[1])
    assert re.fullmatch(r"felt at \d+ % of 1\d{3} places", lines[2])
    axes = felt.plot(Figure().subplots(), title="here")
    assert axes.get_title() == "here"
    assert axes.images[0].get_clim() == pytest.approx((1.0, max(2.0, felt.intensity.max())))


def test_the_picture_of_a_felt_map_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    felt = felt_by(50.0, 0.02)
    saved: list[Figure] = []

    def save(figure: Figure, *_: object, **__: object) -> None:
        saved.append(figure)

    monkeypatch.setattr(Figure, "savefig", save)
    save_felt_picture(tmp_path / "felt.png", felt, "A circle of 4 cm")
    assert faults_of(saved[0], LANDSCAPE) == []
    _, spectrum = saved[0].axes[:2]
    (stems,) = (each for each in spectrum.collections if isinstance(each, LineCollection))
    shown = np.array([segment[1] for segment in stems.get_segments()])
    sizes = 1e6 * np.abs(felt.spectra[:, felt.strongest])
    kept = sizes > 1e-3 * sizes.max()
    np.testing.assert_allclose(shown, np.stack([felt.frequencies, sizes], axis=1)[kept])


def test_silence_is_not_felt(array: TransducerArray) -> None:
    felt = feel(array, np.zeros((400, 320), np.complex64), PATCH)
    assert not felt.intensity.any()
    assert not felt.intensity_over_time(0.005).any()
    assert felt.summary().endswith("felt at 0 % of 441 places")
