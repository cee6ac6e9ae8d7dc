from __future__ import annotations

import numpy as np
import pytest
from phasewire import Medium
from phasewire.solver.fields.quantities import (
    air_density,
    intensity,
    radiation_pressure,
    relative_level,
    sound_pressure_level,
)

AIR = Medium()


@pytest.mark.parametrize(("celsius", "density"), [(0, 1.2929), (15, 1.2250), (20, 1.2041), (30, 1.1644)])
def test_density_is_that_of_tables(celsius: float, density: float) -> None:
    """Dry air at one atmosphere, which at 0 °C is 0.05 % denser than an ideal gas."""
    assert air_density(Medium(celsius)) == pytest.approx(density, rel=6e-4)


def test_94_decibels_are_one_pascal_rms_and_ten_milliwatts() -> None:
    """1 Pa rms is 93.98 dB and, with ρc = 413 Pa·s/m, 2.42 mW/m²."""
    one = np.sqrt(2)
    assert sound_pressure_level(one) == pytest.approx(93.98, abs=0.01)
    assert intensity(one, AIR) == pytest.approx(1 / 413.2, rel=1e-3)
    assert (intensity(one), radiation_pressure(one)) == (intensity(one, AIR), radiation_pressure(one, AIR))


def test_radiation_pressure_is_the_momentum_of_the_wave() -> None:
    """An absorber takes I/c, the mean energy density p_rms²/(ρc²); a mirror turns the momentum round."""
    rms = 1000.0
    density = rms**2 / (air_density(AIR) * AIR.speed_of_sound**2)
    assert radiation_pressure(np.sqrt(2) * rms, AIR, reflection=1) == pytest.approx(density)
    assert radiation_pressure(np.sqrt(2) * rms, AIR) == pytest.approx(2 * density)
    assert density == pytest.approx(7.05, rel=1e-3)


def test_levels_are_relative_to_the_strongest() -> None:
    np.testing.assert_allclose(relative_level([10, 5j, -1, 0]), [0, -6.0206, -20, -np.inf], atol=1e-4)
    assert relative_level(2.0, reference=1.0) == pytest.approx(6.0206, abs=1e-4)
    with pytest.raises(ValueError, match=r"a level relative to silence has no meaning"):
        relative_level([0, 0])
