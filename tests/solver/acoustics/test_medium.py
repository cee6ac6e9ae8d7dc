from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Medium


@pytest.mark.parametrize(("temperature", "speed"), [(0, 331.3), (20, 343.2), (25, 346.1)])
def test_speed_of_sound_is_the_textbook_s(temperature: float, speed: float) -> None:
    assert Medium(temperature).speed_of_sound == pytest.approx(speed, abs=0.05)


@pytest.mark.parametrize(
    ("temperature", "humidity", "printed"),
    [
        (10, 70, [0.1, 0.4, 1.0, 1.9, 3.7, 9.7, 32.8, 117]),
        (20, 70, [0.1, 0.3, 1.1, 2.8, 5.0, 9.0, 22.9, 76.6]),
        (30, 70, [0.1, 0.3, 1.0, 3.1, 7.4, 12.7, 23.1, 59.3]),
        (15, 20, [0.3, 0.6, 1.2, 2.7, 8.2, 28.2, 88.8, 202]),
        (15, 50, [0.1, 0.5, 1.2, 2.2, 4.2, 10.8, 36.2, 129]),
        (15, 80, [0.1, 0.3, 1.1, 2.4, 4.1, 8.3, 23.7, 82.8]),
    ],
)
def test_absorption_is_what_iso_9613_2_prints_in_its_table_2(
    temperature: float, humidity: float, printed: list[float]
) -> None:
    """In dB/km, at the exact midband frequencies of the octaves from 63 Hz to 8 kHz."""
    for octave, expected in enumerate(printed, start=-4):
        computed = Medium(temperature, 1000 * 10 ** (0.3 * octave), humidity=humidity).absorption * 1000
        # One digit after the point, or none: the print rounds 0.65, 4.15 and 12.75 down.
        assert computed == pytest.approx(expected, abs=0.055 if expected < 100 else 0.55)


def test_absorption_at_the_carrier() -> None:
    """1.318 dB/m, of which oxygen's relaxation is the larger part; in nepers that is 0.152 per metre."""
    air = Medium(absorbing=True)
    assert air.absorption == pytest.approx(1.318, abs=5e-4)
    assert 20 * math.log10(math.exp(air.attenuation)) == pytest.approx(air.absorption)


@given(st.floats(-20, 50), st.floats(1e3, 1e5), st.floats(0, 60), st.floats(0.5, 1.5))
def test_absorption_scales_with_pressure(temperature: float, frequency: float, humidity: float, factor: float) -> None:
    """Frequency, pressure and absorption scale together at a constant share of water, as binary collisions demand."""
    # The water's share is humidity over pressure, so that humidity has to scale too.
    one = Medium(temperature, frequency, humidity=humidity)
    other = Medium(temperature, frequency * factor, humidity=humidity * factor, ambient_pressure=101_325 * factor)
    assert other.absorption == pytest.approx(one.absorption * factor, rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"temperature": -300}, "temperature -300"),
        ({"temperature": 293.15}, "from -50 to 60 °C; it looks like kelvin: 293.15 K is 20 °C"),
        ({"temperature": 72}, "it looks like fahrenheit: 72 °F is 22.22 °C"),
        ({"frequency": 0}, "frequency 0"),
        ({"humidity": 101}, "humidity 101 % must be from 0 to 100 %"),
        ({"ambient_pressure": 0}, "ambient_pressure 0 Pa must be from 1000 to"),
    ],
)
def test_impossible_air_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Medium(**arguments)
