"""The half-space against closed forms: Boussinesq, Rayleigh, Cole and Huth, and an integral that is not the code's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire.feel.skin import Skin, displaced, displacement
from scipy.integrate import quad
from scipy.special import j0

ELASTIC = Skin(stiffness=50e3, viscosity=0.0, density=1000.0)
SPACING = 1e-3


def distances(rows: int, columns: int, row: float, column: float) -> NDArray[np.float64]:
    """Of the cells of a grid from a place in it, in metres."""
    y, x = np.indices((rows, columns))
    return np.asarray(np.hypot(y - row, x - column) * SPACING)


def steady(skin: Skin, pressure: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(displacement(skin, pressure[None], 1000.0, SPACING)[0])


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
def test_a_steady_force_makes_boussinesq_s_dimple(poisson: float) -> None:
    skin, width = Skin(50e3, poisson=poisson), 1.5 * SPACING
    r = distances(50, 70, 20, 10)
    pressure = 3.0 / (2 * np.pi * width**2) * np.exp(-(r**2) / (2 * width**2))  # 3 N
    far = r > 12 * SPACING
    expected = (1 - poisson) * 3.0 / (2 * np.pi * 50e3 * r[far])
    np.testing.assert_allclose(steady(skin, pressure)[far], expected, rtol=0.01)


@pytest.mark.parametrize(("poisson", "ratio"), [(0.0, 0.8740), (0.25, 0.9194), (0.33, 0.9320), (0.5, 0.9553)])
def test_the_surface_wave_has_rayleigh_s_speed_and_is_the_pole_of_the_response(poisson: float, ratio: float) -> None:
    skin = Skin(50e3, 0.0, 1000.0, poisson)
    assert skin.surface_speed(200.0) / skin.shear_speed(200.0) == pytest.approx(ratio, abs=5e-5)
    wavenumber = skin.surface_wavenumber(200.0)
    near, far = np.abs(skin.response(wavenumber.real * np.array([1 + 1e-9, 1.1]), 200.0))
    assert near > 1e6 * far


def test_losses_make_the_surface_wave_decay() -> None:
    """Zhang 2011 measured 3.25 ± 0.19 m/s at 200 Hz on forearms, to which their two constants belong."""
    skin = Skin.forearm()
    assert skin.surface_speed(200.0) == pytest.approx(3.25, abs=0.19)
    assert np.abs(skin.response(skin.surface_wavenumber(200.0).real, 200.0)) < 1e-3
    shear = np.sqrt(1100 * (400 * np.pi) ** 2 / (7.86e3 - 5.03j * 400 * np.pi))
    assert skin.surface_wavenumber(200.0) == pytest.approx(shear / 0.955313, rel=1e-5)


def test_a_pressure_everywhere_meets_the_impedance_of_a_compressional_wave() -> None:
    skin = Skin(50e3, 0.0, 1000.0, poisson=0.4)
    speed = np.sqrt(50e3 / 1000.0 * (2 - 0.8) / (1 - 0.8))
    assert skin.response(0.0, 100.0) == pytest.approx(1j / (1000.0 * speed * 200 * np.pi))
    assert Skin().response(0.0, 100.0) == 0  # which cannot be compressed


@given(st.floats(1.0, 5e3), st.floats(0.1, 800.0), st.floats(0.0, 0.5), st.floats(0.0, 30.0))
def test_skin_takes_energy_and_gives_none(wavenumber: float, frequency: float, poisson: float, loss: float) -> None:
    """The mean power of p·du/dt is ω·Im(H)/2 per square pascal."""
    response = Skin(20e3, loss, 1100.0, poisson).response(wavenumber, frequency)
    assert response.imag >= -1e-9 * abs(response)


@pytest.mark.parametrize(("skin", "frequency"), [(Skin(), 200.0), (Skin.forearm(), 60.0), (Skin.forearm(), 400.0)])
def test_a_grid_is_moved_as_by_the_integral_over_wavenumbers(skin: Skin, frequency: float) -> None:
    """u = ∫ H·P·J₀(kr)·k dk/2π of a pressure with a Gaussian profile, along the real axis."""
    width = 2.5e-3
    spot = np.exp(-(distances(60, 40, 15, 20) ** 2) / (2 * width**2))
    moved = displaced(skin, spot[None].astype(complex), np.array([frequency]), SPACING)[0]

    def part(k: float, r: float, of: str) -> float:
        value = skin.response(k, frequency) * width**2 * np.exp(-((k * width) ** 2) / 2) * j0(k * r) * k
        return float(getattr(value, of))

    pole = float(skin.surface_wavenumber(frequency).real)
    for row, column in ((15, 20), (15, 30), (59, 0)):
        r = np.hypot(row - 15, column - 20) * SPACING
        expected = complex(
            *(quad(part, 0, 8 / width, (r, of), points=[pole], limit=400, epsabs=1e-13)[0] for of in ("real", "imag"))
        )
        assert moved[row, column] == pytest.approx(expected, rel=2e-3, abs=1e-12)


def test_waves_leave_a_grid_even_if_nothing_damps_them() -> None:
    """A larger grid, with more free skin around the load, sees the same."""
    spot = np.exp(-(distances(24, 24, 12, 12) ** 2) / (2 * (3 * SPACING) ** 2))
    larger = np.pad(spot, 40)
    frequencies = np.array([1.0, 20.0, 150.0, 600.0])
    small, large = (displaced(ELASTIC, np.stack([p] * 4).astype(complex), frequencies, SPACING) for p in (spot, larger))
    error = np.abs(small - large[:, 40:-40, 40:-40]).max(axis=(1, 2)) / np.abs(large).max(axis=(1, 2))
    assert error.max() < 1e-3


def pushed_once(skin: Skin) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """A short push at a place; the displacement along a line from there, (t, x), the times and the rate."""
    rate, samples = 4000.0, 512
    times = np.arange(samples) / rate
    pressure = np.zeros((samples, 5, 90))
    pressure[:, 2, 4] = 1e5 * np.exp(-(((times - 0.02) / 1e-3) ** 2))
    return displacement(skin, pressure, rate, SPACING)[:, 2, 4:], times, rate


def test_nothing_moves_before_it_is_pushed_nor_long_after() -> None:
    moved, times, _ = pushed_once(Skin(20e3, 2.0))
    peak = np.abs(moved).max(axis=0)
    assert (np.abs(moved[times < 0.0165]) < 1e-3 * peak).all()
    assert (np.abs(moved[times > 0.06]) < 0.01 * peak).all()


def test_a_push_goes_out_with_the_surface_wave_s_speed_and_decay() -> None:
    skin = Skin(20e3, 2.0)
    moved, times, rate = pushed_once(skin)
    near, far = 40, 80  # more than a wavelength away
    some = slice(26, 50)  # 200 to 380 Hz
    spectra = np.fft.rfft(moved[:, [near, far]], axis=0).conj()[some]
    wave = skin.surface_wavenumber(np.fft.rfftfreq(len(times), 1 / rate)[some])
    found = spectra[:, 1] / spectra[:, 0] / np.sqrt(near / far)  # a wave on a surface spreads over a circle's length
    way = (far - near) * SPACING
    late = np.angle(found * np.exp(-1j * wave.real * way)) / (wave.real * way)
    assert np.abs(late).max() < 0.03
    decay = -np.log(np.abs(found)) / way / wave.imag  # waves within the body still interfere
    assert np.abs(decay - 1).max() < 0.2
    assert decay.mean() == pytest.approx(1, abs=0.05)


def under_a_moving_force(skin: Skin, speed: float) -> NDArray[np.float64]:
    """Displacement around 1 N that has always moved along x with a steady speed; it is in the middle, on a torus."""
    count = 512
    along = 2 * np.pi * np.fft.fftfreq(count, SPACING)
    k = np.hypot(along[:, None], along)
    spot = np.exp(-((k * 1.5 * SPACING) ** 2) / 2)
    response = np.zeros(k.shape, dtype=complex)
    ahead = np.broadcast_to(along, k.shape)
    moving = (ahead > 0) & (k > 0)
    response[moving] = skin.response(k[moving], ahead[moving] * speed / (2 * np.pi))
    response += np.roll(np.flip(response), 1, axis=(0, 1)).conj()
    across = (ahead == 0) & (k > 0)
    response[across] = skin.response(k[across], 0.0)
    return np.fft.fftshift(np.fft.ifft2(response * spot).real) / SPACING**2


def test_a_slow_load_makes_the_dimple_of_cole_and_huth() -> None:
    """J. Appl. Mech. 25, 433, 1958: the steady motion below the wave speed, there of a line.

    A force at a point is a sum of lines in all directions. A line whose normal makes the angle θ with the way moves
    by V·cos θ along its normal, and the lines that reach a place are those that run through it: beside the force they
    run across the way, before and after it they run along the way and stand still.
    """
    skin = Skin(50e3, 1e-3, 1000.0)
    mach = 0.75
    dimple = under_a_moving_force(skin, mach * float(skin.shear_speed(0.0)))

    def factor(m: float) -> float:  # of an incompressible body, relative to a load that stands still
        return 2 * m**2 / (4 * np.sqrt(1 - m * m) - (2 - m * m) ** 2) if m else 1.0

    still = 0.5 / (2 * np.pi * 50e3)
    for angle in np.radians([0, 30, 60, 90, 135]):
        away = np.array([12, 24]) * SPACING
        places = np.rint(256 + away / SPACING * np.array([np.sin(angle), np.cos(angle)])[:, None]).astype(int)
        r = np.hypot(*(places - 256)) * SPACING
        m = mach * abs(np.sin(np.arctan2(*(places - 256))))
        expected = [still * factor(each) / distance for each, distance in zip(m, r, strict=True)]
        found = dimple[tuple(places)]
        # All is up to a constant, because the torus repeats the force.
        assert found[0] - found[1] == pytest.approx(expected[0] - expected[1], rel=0.04)


def test_displacement_is_linear_and_has_the_sign_of_the_push() -> None:
    rng = np.random.default_rng(4)
    one, two = rng.random((2, 16, 6, 9))
    first, second = (displacement(Skin(), p, 1000.0, SPACING) for p in (one, two))
    np.testing.assert_allclose(displacement(Skin(), 2 * one - two, 1000.0, SPACING), 2 * first - second, atol=1e-12)
    assert (first.mean(axis=0) > 0).all()
