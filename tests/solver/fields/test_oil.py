from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from phasewire import Medium
from phasewire.solver.fields.field import PlaneField, sample_cut
from phasewire.solver.fields.grid import Grid
from phasewire.solver.fields.oil import Oil, oil_surface
from phasewire.solver.fields.quantities import radiation_pressure

OIL = Oil()
WEIGHT = OIL.density * 9.80665


@pytest.mark.parametrize(("along_x", "along_y"), [(3, 0), (0, 5), (4, 7)])
def test_a_cosine_stays_one_and_tension_makes_it_smaller(along_x: int, along_y: int) -> None:
    """(ρg + σk²)·h = −P for every cosine that is level at the edges."""
    rows, columns, step = 40, 60, 5e-4
    kx, ky = np.pi * along_x / (columns * step), np.pi * along_y / (rows * step)
    x, y = (np.arange(columns) + 0.5) * step, (np.arange(rows)[:, None] + 0.5) * step
    push = np.cos(kx * x) * np.cos(ky * y)
    expected = -push / (WEIGHT + OIL.surface_tension * (kx**2 + ky**2))
    np.testing.assert_allclose(OIL.surface(push, step), expected, atol=1e-12)


def test_without_tension_the_surface_is_the_radiation_pressure() -> None:
    grid, rng = Grid.along("xy", (0, 0, 0.2), 0.02, 1e-3), np.random.default_rng(1)
    field = PlaneField(grid, 1000 * (rng.normal(size=grid.shape) + 1j * rng.normal(size=grid.shape)), Medium(25))
    oil = Oil(density=900, surface_tension=0, reflection=1.5)
    expected = -radiation_pressure(field.pressure, Medium(25), 1.5) / (900 * 9.80665)
    np.testing.assert_allclose(oil_surface(field, oil), expected, atol=1e-12)


def test_capillary_length_of_light_oil() -> None:
    assert pytest.approx(1.9e-3, rel=0.01) == OIL.capillary_length


def test_oil_needs_a_horizontal_plane(array: Any) -> None:
    field = sample_cut(array, np.ones(320), Grid.along("xz", (0, 0, 0.2), 0.02, 0.01))
    with pytest.raises(ValueError, match=r"the plane must be horizontal, but its normal is \[0.0, -1.0, 0.0\]"):
        oil_surface(field)
