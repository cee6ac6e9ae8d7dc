"""Power and heat, against the closed form of a piston, the far field of a whole array, and a diffusion in steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy
from phasewire import Medium, Transducer, TransducerArray
from phasewire.feel.power import absorbed_share, full_power, power_over_time, radiated_power, warming
from phasewire.solver.fields.quantities import air_density
from phasewire.solver.fields.validity import aperture_radius

MEDIUM = Medium()
RHO_C = air_density(MEDIUM) * MEDIUM.speed_of_sound


@pytest.mark.parametrize("radius", [1e-3, 4.5e-3, 8e-3])
@pytest.mark.parametrize("model", ["piston", "rayleigh"])
def test_a_piston_radiates_what_its_radiation_resistance_says(radius: float, model: str) -> None:
    ka = MEDIUM.wavenumber * radius
    # W = ½|U|²·ρc·πa²·(1 − J₁(2ka)/(ka)), and the far field on its axis is P₁ = ρc·k·a²·U/2.
    speed = 2 * 5.73 / (RHO_C * MEDIUM.wavenumber * radius**2)
    expected = speed**2 / 2 * RHO_C * math.pi * radius**2 * (1 - scipy.special.j1(2 * ka) / ka)
    assert full_power(Transducer(radius=radius, model=model), MEDIUM) == pytest.approx(expected, rel=1e-3)


def test_power_is_that_of_the_calibrated_transducers() -> None:
    array = TransducerArray.grid(2, 1)
    dead = TransducerArray(array.positions, array.normals, response=[0, 0.5j])
    alone = full_power(array.transducer)
    assert power_over_time(dead, [[1, 1]])[0] == pytest.approx(alone / 4, rel=1e-5)
    found = radiated_power(array, np.array([[1, 1], [1j, 0]]))
    assert (found.acoustic, found.greatest) == pytest.approx((1.5 * alone, 2 * alone), rel=1e-5)
    assert found.switching == pytest.approx(1.5 * 2.55e-9 * 15**2 * 40e3)
    assert found.skin == pytest.approx(absorbed_share() * found.acoustic)
    assert f"{found.acoustic:.3g} W of sound" in str(found)


def test_the_radius_of_a_disc_is_its_own_however_it_lies() -> None:
    at = np.stack(np.meshgrid(np.arange(-15, 16), np.arange(-15, 16)), axis=-1).reshape(-1, 2) * 0.01
    disc = at[np.linalg.norm(at, axis=1) <= 0.15]
    array = TransducerArray(np.c_[disc, np.zeros(len(disc))], np.tile([0, 0, 1.0], (len(disc), 1)))
    assert aperture_radius(array) == pytest.approx(0.15, rel=0.02)
    assert aperture_radius(array.rotated(70, (1, 2, 0)).moved((1, 2, 3))) == pytest.approx(aperture_radius(array))
    assert aperture_radius(TransducerArray([[0, 0, 0]], [[0, 0, 1]])) == pytest.approx(4.5e-3)


def test_skin_keeps_about_one_per_cent() -> None:
    assert absorbed_share() == pytest.approx(0.0011 + 0.0076, abs=2e-4)  # body, and boundary layer of 12.9 µm
    assert absorbed_share(replace(MEDIUM, frequency=160e3)) == pytest.approx(0.0011 + 2 * 0.0076, abs=4e-4)


def test_warming_is_diffusion() -> None:
    cell, step = 20e-6, 1e-3
    flux = absorbed_share() * 2000**2 / (2 * RHO_C)
    depth = np.zeros(400)
    for _ in range(3000):
        rate = np.diff(depth, prepend=depth[0], append=0) * 1.1e-7 / cell**2
        depth += step * np.diff(rate)
        depth[0] += step * flux / 0.37 * 1.1e-7 / cell
    surface = depth[0] + flux / 0.37 * cell / 2  # from the first cell's middle
    assert warming(2000, 3.0) == pytest.approx(surface, rel=0.01)
    assert warming(2000, 12.0) == pytest.approx(2 * warming(2000, 3.0))
