"""Levels at ears, against the data sheet of one transducer and the solver's steady field."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Medium, TransducerArray, pressure, sound_pressure_level
from phasewire.feel.arriving import arriving, responses
from phasewire.feel.exposure import LIMITS, TRANSITION_DB, exposure_at, exposure_limit, scattered, seated
from phasewire.solver import TRANSDUCERS
from phasewire.solver.acoustics.models import directivity
from phasewire.solver.acoustics.resonator import Resonator

MEDIUM = Medium()
AT = [[0.1, -0.2, 0.3], [0, 0, 0.25]]


def some_drives(rows: int, seed: int = 1) -> NDArray[np.complex128]:
    rng = np.random.default_rng(seed)
    return np.asarray(rng.uniform(0, 1, (rows, 320)) * np.exp(2j * np.pi * rng.random((rows, 320))))


def test_one_transducer_is_as_loud_as_its_data_sheet_says() -> None:
    array = TransducerArray([[0, 0, 0]], [[0, 0, 1]], transducer=TRANSDUCERS["MA40S4S-10Vrms"])
    found = exposure_at(array, np.ones((8, 1)), [[0, 0, 0.3]])
    assert found.greatest_db[0] == pytest.approx(120.0, abs=0.02)  # 20 Pa rms at 30 cm
    assert found.mean_db[0] == pytest.approx(120.0, abs=0.02)
    assert not found.bounded[0]
    assert [limit.level_db for limit in found.exceeded] == [100, 110, 110, 115]
    assert "120.0 dB SPL at most" in str(found)


def test_half_of_the_time_is_three_decibels_less_on_average(array: TransducerArray) -> None:
    waves = np.repeat([[1.0], [0.0]], 500, axis=0) * np.ones(320)
    found, whole = exposure_at(array, waves, AT), exposure_at(array, waves[:1], AT)
    np.testing.assert_allclose(whole.mean_db - found.mean_db, 10 * math.log10(2), atol=0.05)
    assert (found.greatest_db >= whole.greatest_db - 1e-4).all()


def test_waves_that_stay_are_the_solvers_field(array: TransducerArray) -> None:
    drive = some_drives(1)[0]
    field = arriving(array, np.tile(drive, (3, 1)), AT, MEDIUM)
    np.testing.assert_allclose(field, np.tile(pressure(array, drive, AT)[:, None], 3), rtol=2e-4, atol=0.02)


def test_waves_arrive_one_by_one_and_repeat(array: TransducerArray) -> None:
    waves = some_drives(700)  # more than two blocks of the kernel, and a part of one
    distance = np.linalg.norm(np.array(AT)[:, None] - array.positions, axis=2) / MEDIUM.wavelength
    expected = np.zeros((2, 700), complex)
    response = responses(array, AT, MEDIUM)
    for j in range(2):
        for q in range(320):
            whole = math.ceil(distance[j, q])
            ahead = Resonator().enveloped(40e3, 25e-6).between(whole - distance[j, q])
            here, following = np.roll(waves[:, q], whole), np.roll(waves[:, q], whole - 1)
            expected[j] += response[j, q] * ((1 - ahead) * here + ahead * following)
    np.testing.assert_allclose(arriving(array, waves, AT, MEDIUM), expected, atol=2e-5 * np.abs(expected).max())


def test_behind_the_baffle_there_is_a_bound_and_not_silence() -> None:
    array = TransducerArray([[0, 0, 0]], [[0, 0, 1]])
    places = np.array([[1, 0, 1e-9], [1, 0, 0], [0.6, 0, -0.8], [0, 0, -1]])
    found = exposure_at(array, np.ones((1, 1)), places)
    grazing = 20 * math.log10(5.73 * float(directivity(1.0, 4.5e-3, MEDIUM)) / math.sqrt(2) / 20e-6)
    np.testing.assert_allclose(found.greatest_db, grazing, atol=1e-3)
    assert found.bounded.tolist() == [False, True, True, True]
    assert "a bound: transducers look away" in str(exposure_at(array, np.ones((1, 1)), places[1:]))


def test_a_person_sits_before_the_array_wherever_it_lies() -> None:
    array = TransducerArray.grid().moved((1, 2, 0.1))
    places = seated(array) - (1, 2, 0.1)
    np.testing.assert_allclose(places, [[-0.0725, -0.4, 0.47], [0.0725, -0.4, 0.47], [0, -0.28, 0.47]], atol=1e-12)
    np.testing.assert_array_equal(exposure_at(array, np.ones((1, 320))).at, seated(array))


@given(st.floats(60, 140), st.integers(0, 5))
def test_a_gain_keeps_its_limit_while_drives_change(limit: float, seed: int) -> None:
    """The loudest mixture of new waves, which arrive from the nearest transducers first, with old ones, or none."""
    array, drives = TransducerArray.grid(4, 3), some_drives(3, seed)[:, :12]
    places, loudest = np.add(seated(array), (0.013, 0.007, 0)), 0.0  # no two transducers are as near
    gain = exposure_limit(array, places, limit)(drives)
    matrix = responses(array, places, Medium())
    way = np.linalg.norm(places[:, None] - array.positions, axis=2)
    for place, row in enumerate(matrix):
        for new, old in (
            [*zip(drives, np.roll(drives, 1, axis=0), strict=True)]
            + [(0 * d, d) for d in drives]
            + [(d, 0 * d) for d in drives]
        ):
            for horizon in [0.0, *way[place]]:
                loudest = max(loudest, abs(row @ np.where(way[place] <= horizon, new, old)))
    kept = sound_pressure_level(gain * loudest) + TRANSITION_DB
    assert gain <= 1
    assert kept == pytest.approx(limit, abs=1e-2) if gain < 1 else kept <= limit + 1e-2


def test_what_a_hand_scatters_is_power_over_a_half_sphere() -> None:
    # 1 W over 2π·(0.5 m)² is 0.64 W/m², 118 dB re 1e-12 W/m², and 0.14 dB more in pressure at 413 Pa·s/m against 400.
    assert scattered(1.0, 0.5) == pytest.approx(
        10 * math.log10(0.6366 / 1e-12) + 10 * math.log10(413.2 / 400), abs=0.01
    )


def test_limits_go_up_and_hold_those_of_1984() -> None:
    levels = [limit.level_db for limit in LIMITS]
    assert levels == sorted(levels)
    assert [limit.level_db for limit in LIMITS if "1984" in limit.source] == [100, 110]


def test_what_does_not_fit_is_refused(array: TransducerArray) -> None:
    with pytest.raises(ValueError, match=r"waves have the shape \(2,\); \(t, 320\) is needed"):
        exposure_at(array, [1, 1])
    with pytest.raises(ValueError, match=r"drives have the shape \(1, 2\); \(t, 320\) is needed"):
        exposure_limit(array, None, 110)([[1, 1]])
    with pytest.raises(ValueError, match="exposure limit nan dB must be from 0 to 200"):
        exposure_limit(array, None, math.nan)(np.ones((1, 320)))
