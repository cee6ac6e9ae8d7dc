from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Medium, Transducer
from phasewire.solver import MODELS, residual
from phasewire.solver.acoustics.diffraction import KERNELS
from phasewire.solver.acoustics.models import directivity
from scipy.special import j1

from tests.oracles import piston_wave

AIR = Medium()
K = AIR.wavenumber
A = 4.5e-3
PISTON = {name: Transducer(A, model=name) for name in MODELS}
SINES, DISTANCES = st.floats(0, 1), st.floats(2 * A, 10)


def test_as_printed_it_agrees_at_the_data_sheet_s_30_centimetres() -> None:
    apart = residual(PISTON["as-printed"], 0, 0.3) - residual(PISTON["rayleigh"], 0, 0.3)
    assert abs(apart) < 1e-3


@pytest.mark.parametrize("name", ["rayleigh", "rayleigh-1"])
@given(SINES, DISTANCES)
def test_a_rayleigh_integral_is_the_wave_from_the_rim(name: str, sine: float, distance: float) -> None:
    expected = piston_wave(name, sine, distance, A, K)
    assert abs(residual(PISTON[name], sine, distance) - expected) < 1e-9


@pytest.mark.parametrize("name", ["rayleigh", "rayleigh-1", "as-printed"])
def test_the_kernel_and_the_integral_are_the_same(name: str) -> None:
    """The readable sum of `Kernel.wave` over a fine disc, at a few points near and far."""
    rng = np.random.default_rng(3)
    rho, azimuth = np.meshgrid(A * np.sqrt((np.arange(200) + 0.5) / 200), 2 * np.pi * (np.arange(60) + 0.5) / 60)
    for sine, r in zip(rng.uniform(0, 1, 6), np.geomspace(2 * A, 1, 6), strict=True):
        z = r * np.sqrt(1 - sine**2)
        distance = np.sqrt((r * sine - rho * np.cos(azimuth)) ** 2 + (rho * np.sin(azimuth)) ** 2 + z**2)
        literal = KERNELS[name].wave(z, distance, K).mean()
        assert residual(PISTON[name], sine, r) * np.exp(1j * K * r) / r == pytest.approx(literal, rel=1e-4)


@given(SINES)
def test_far_away_a_rayleigh_integral_has_the_directivity_of_bessel(sine: float) -> None:
    bessel = 1.0 if K * A * sine < 1e-6 else 2 * j1(K * A * sine) / (K * A * sine)
    assert directivity(sine, A, AIR) == pytest.approx(bessel, abs=1e-12)
    assert abs(residual(PISTON["rayleigh"], sine, 1e5) - bessel) < 1e-6
    assert abs(residual(PISTON["rayleigh-1"], sine, 1e5) - bessel * np.sqrt(1 - sine**2)) < 1e-6


def test_as_printed_it_falls_as_one_over_the_root_of_distance() -> None:
    """The exponent of (2) is that of two dimensions; the paper's own section 7, and air, say 1/r."""
    r = np.geomspace(0.05, 10, 20)
    printed, true = (np.abs(residual(PISTON[name], 0.3, r)) / r for name in ("as-printed", "rayleigh-1"))
    slope, true_slope = (np.polyfit(np.log(r), np.log(pressure), 1)[0] for pressure in (printed, true))
    assert slope == pytest.approx(-0.5, abs=2e-3)
    assert true_slope == pytest.approx(-1, abs=2e-3)


def test_a_long_list_is_the_same_as_its_parts() -> None:
    sine = np.linspace(0, 1, 40_000)
    whole = residual(PISTON["rayleigh"], sine, 0.1)
    np.testing.assert_allclose(whole[::7777], residual(PISTON["rayleigh"], sine[::7777], 0.1))
