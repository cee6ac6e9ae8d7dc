"""Where the linear model ends, against the wave that is drawn point by point, and sums along the axis."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from phasewire import ControlPoints, Medium, TransducerArray, sample_plane, solve
from phasewire.solver.fields.quantities import air_density, intensity
from phasewire.solver.fields.validity import aperture_radius, fundamental, shock_distance, validity

MEDIUM = Medium()
FOCUS = [0.0, 0.0, 0.2]


@pytest.mark.parametrize(("rms", "metres"), [(200, 0.571), (2000, 0.0571)])
def test_shocks_form_where_the_formula_says(rms: float, metres: float) -> None:
    assert shock_distance(rms * 2**0.5) == pytest.approx(metres, rel=2e-3)


def steepened(distortion: float) -> float:
    """The fundamental of a sine each of whose points has run ahead by its own pressure, up to its shock."""
    angle = np.linspace(0, np.pi, 2_000_001)
    place, wave = angle - distortion * np.sin(angle), np.sin(angle)
    kept = place >= 0  # before it the shock has taken what ran past
    kept &= angle >= angle[kept][0]
    return float(2 / np.pi * np.trapezoid(wave[kept] * np.sin(place[kept]), place[kept]))


@pytest.mark.parametrize("distortion", [1e-7, 0.3, 0.99, 1.0001, 1.2, 1.57, 2, 4, 10, 40])
def test_the_fundamental_is_that_of_the_drawn_wave(distortion: float) -> None:
    assert fundamental(distortion) == pytest.approx(steepened(distortion), rel=1e-4)


def on_axis(array: TransducerArray, peak: float) -> tuple[np.ndarray, np.ndarray]:
    """Pressure on the axis of a disc that focuses, up to the focus: p_m/√(1 + (G² − 1)(1 − z/F)²)."""
    gain = MEDIUM.wavenumber * aperture_radius(array) ** 2 / (2 * 0.2)
    z = np.linspace(0, 0.2, 20_001)
    return z, peak / np.sqrt(1 + (gain**2 - 1) * (1 - z / 0.2) ** 2)


def test_distortion_and_wind_add_up_along_the_axis(array: TransducerArray) -> None:
    z, pressure = on_axis(array, 3000.0)
    found = validity(array, 3000.0, FOCUS)
    c, rho = MEDIUM.speed_of_sound, air_density(MEDIUM)
    distortion = 1.2 * 2 * np.pi * 40e3 / (rho * c**3) * scipy.integrate.simpson(pressure, x=z)
    assert found.distortion == pytest.approx(distortion, rel=1e-4)
    pushed = 2 * MEDIUM.absorption / 8.686 * scipy.integrate.simpson(intensity(pressure), x=z) / c  # N/m²
    assert found.streaming == pytest.approx(np.sqrt(2 * pushed / rho), rel=1e-4)
    assert 0.1 < found.streaming < 3  # m/s; more than 0.4 m/s is measured at such foci (arXiv:2503.21271)


@given(st.floats(1, 1e6))
def test_no_drive_exceeds_the_bound(peak: float) -> None:
    found = validity(TransducerArray.grid(4, 4), peak, FOCUS)
    assert peak * found.remaining < found.bound
    assert found.linear == (found.distortion <= 0.5)
    assert 0 < found.remaining <= 1


def test_a_field_tells_its_own_validity(array: TransducerArray) -> None:
    solution = solve(array, ControlPoints([FOCUS]))
    found = validity(array, *sample_plane(array, solution.drive, height=0.2).strongest())
    assert 4000 < found.peak < 9000
    assert not found.linear
    assert f"{found.peak:.0f} Pa" in str(found)
    assert "the linear model holds" in str(validity(array, found.peak / 10, FOCUS))
    assert "waves are shocked" in str(validity(array, found.peak * 3, FOCUS))


def test_silence_is_linear_and_nonsense_refused(array: TransducerArray) -> None:
    found = validity(array, 0.0, FOCUS)
    assert (found.linear, found.remaining, found.shock_distance, found.streaming) == (True, 1.0, np.inf, 0.0)
    with pytest.raises(ValueError, match="focal pressure of nan Pa must be at least 0 and finite"):
        validity(array, float("nan"), FOCUS)


def test_nearer_than_its_radius_a_focus_is_judged_as_at_that_distance(array: TransducerArray) -> None:
    radius = aperture_radius(array)
    near, there = (validity(array, 3000.0, np.add(array.positions.mean(axis=0), (0, 0, z))) for z in (0.02, radius))
    assert near == there
