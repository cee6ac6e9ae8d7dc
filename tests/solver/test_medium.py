from __future__ import annotations

import math

import pytest
from phasewire import Medium


@pytest.mark.parametrize(("temperature", "speed"), [(0, 331.3), (20, 343.2), (25, 346.1)])
def test_speed_of_sound_is_the_textbook_s(temperature: float, speed: float) -> None:
    assert Medium(temperature).speed_of_sound == pytest.approx(speed, abs=0.05)


def test_wavelength_and_wavenumber_agree() -> None:
    air = Medium(20)
    assert air.wavelength == pytest.approx(8.58e-3, abs=1e-5)
    assert air.wavelength * air.wavenumber == pytest.approx(2 * math.pi)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-300,), "temperature -300"),
        ((math.nan,), "temperature nan"),
        ((20, 0), "frequency 0"),
        ((20, math.inf), "inf"),
    ],
)
def test_impossible_air_is_refused(arguments: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Medium(*arguments)
