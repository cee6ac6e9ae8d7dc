from __future__ import annotations

import numpy as np
import pytest
from phasewire import Medium, TransducerArray, pressure, sample_plane
from phasewire.solver.fields.field import PlaneField, VolumeField, sample_cut, sample_volume
from phasewire.solver.fields.grid import Grid


def test_too_many_samples_for_a_large_array_are_refused() -> None:
    large = TransducerArray.grid(100, 100, 1e-3)
    with pytest.raises(ValueError, match="10000 transducers are too many"):
        sample_plane(large, np.ones(10_000), 0.2, step=2.3e-4)  # a plane of 2e-4 has an FFT


SMALL = TransducerArray.grid(4, 3)
DRIVE = np.exp(1j * np.arange(12) ** 2)
GRIDS = {
    "standing": Grid.along("xz", (0, 0.01, 0.1), [0.04, 0.1], 0.01),
    "oblique": Grid((0, 0, 0.2), [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]], (5, 3), 0.01),
    "box": Grid.along("xyz", (0, 0, 0.2), [0.02, 0.04, 0.06], 0.01),
}


@pytest.mark.parametrize("name", GRIDS)
def test_any_grid_holds_the_pressure_at_its_samples(name: str) -> None:
    grid, air = GRIDS[name], Medium(30)
    field = (sample_volume if name == "box" else sample_cut)(SMALL, DRIVE, grid, air)
    assert field.medium == air
    for index in np.ndindex(grid.shape):
        expected = pressure(SMALL, DRIVE, [grid.positions()[index]], air)[0]
        assert field.pressure[index] == pytest.approx(expected, abs=1e-4 * np.abs(field.pressure).max())


@pytest.mark.parametrize("name", GRIDS)
def test_the_strongest_sample_is_found(name: str) -> None:
    field = (sample_volume if name == "box" else sample_cut)(SMALL, DRIVE, GRIDS[name])
    strongest, where = field.strongest()
    assert strongest == np.abs(field.pressure).max()
    assert abs(pressure(SMALL, DRIVE, [where])[0]) == pytest.approx(strongest, rel=1e-4)


def test_a_plane_has_coordinates_along_its_own_axes_only() -> None:
    field = sample_cut(SMALL, DRIVE, GRIDS["standing"])
    np.testing.assert_allclose(field.x, [-0.02, -0.01, 0, 0.01, 0.02])
    np.testing.assert_allclose(field.z[[0, -1]], [0.05, 0.15])
    with pytest.raises(ValueError, match="no axis of this plane is along y"):
        _ = field.y


def test_a_grid_of_the_wrong_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="the grid is a box, with 3 axes; it must be a plane"):
        sample_cut(SMALL, DRIVE, GRIDS["box"])
    with pytest.raises(ValueError, match="the grid is a plane, with 2 axes; it must be a box"):
        sample_volume(SMALL, DRIVE, GRIDS["standing"])
    with pytest.raises(ValueError, match="it must be a plane"):
        PlaneField(GRIDS["box"], np.zeros((7, 5, 3), complex), Medium())
    with pytest.raises(ValueError, match=r"pressure has the shape \(3, 5, 7\), but the grid has \(7, 5, 3\)"):
        VolumeField(GRIDS["box"], np.zeros((3, 5, 7), complex), Medium())


def test_the_strongest_plane_of_a_box_is_sampled_where_it_says() -> None:
    array = TransducerArray.grid(4, 3)
    drive = np.exp(1j * np.arange(12))
    box = sample_volume(array, drive, Grid.along("xyz", (0, 0.01, 0.1), [0.04, 0.03, 0.05], 5e-3))
    plane = box.strongest_plane()
    assert plane.strongest()[0] == box.strongest()[0]
    again = sample_cut(array, drive, plane.grid)
    np.testing.assert_allclose(plane.pressure, again.pressure, atol=1e-3 * box.strongest()[0])


def test_a_plane_is_known_by_the_name_of_its_axes() -> None:
    array = TransducerArray([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])  # which look to +z
    named = sample_cut(array, [1, 1], "xz")
    assert (named.x[[0, -1]].tolist(), named.z[[0, -1]].tolist()) == ([-0.1, 0.1], pytest.approx([0.05, 0.25]))
    whole = sample_cut(array, [1, 1], Grid.along("xz", (0, 0, 0.15), 0.2, 1e-3))
    np.testing.assert_array_equal(named.pressure, whole.pressure)
    with pytest.raises(ValueError, match="axes 'xx' must be two or all of x, y and z"):
        sample_cut(array, [1, 1], "xx")
