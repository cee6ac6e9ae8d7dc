from __future__ import annotations

import math

import numpy as np
import pytest
from phasewire.solver.contact.mesh import Mesh
from phasewire.solver.contact.solids import SOLIDS

from .cuts import in_trimesh

ALTITUDE = math.sqrt(0.75)
EXACT = {
    "cone": (math.pi / 12, (math.pi / 4) * (1 + math.sqrt(5)), (1, 1, 1)),
    "sphere": (math.pi / 6, math.pi, (1, 1, 1)),
    "pyramid": (1 / 3, 1 + math.sqrt(5), (1, 1, 1)),
    "horizontal_prism": (ALTITUDE / 2, 3 + ALTITUDE, (1, 1, ALTITUDE)),
    "vertical_prism": (ALTITUDE / 2, 3 + ALTITUDE, (1, ALTITUDE, 1)),
    "cube": (1, 6, (1, 1, 1)),
}
"""Volume, area and extents of each at size 1."""


@pytest.mark.parametrize("name", SOLIDS)
def test_it_is_closed_and_as_large_as_geometry_says(name: str) -> None:
    shape = in_trimesh(getattr(Mesh, name)())
    volume, area, extents = EXACT[name]
    rough = 2.5e-3 if name in ("cone", "sphere") else 1e-12
    assert shape.is_watertight
    assert shape.is_winding_consistent
    assert shape.euler_number == 2
    assert shape.volume == pytest.approx(volume * 1e-3, rel=rough)
    assert shape.area == pytest.approx(area * 1e-2, rel=rough)
    np.testing.assert_allclose(shape.extents, np.array(extents) * 0.1, rtol=1e-12)
    np.testing.assert_allclose(shape.bounds.mean(axis=0), [0, 0, 0.17], atol=1e-15)


def test_solids_have_their_orientation() -> None:
    assert in_trimesh(Mesh.cone()).center_mass[2] == pytest.approx(0.12 + 0.025, abs=1e-9)
    assert in_trimesh(Mesh.pyramid()).center_mass[2] == pytest.approx(0.12 + 0.025, abs=1e-12)
    roof = Mesh.horizontal_prism().vertices
    ridge = roof[roof[:, 2] > 0.2]
    np.testing.assert_allclose(sorted(ridge.tolist()), [[-0.05, 0, ridge[0, 2]], [0.05, 0, ridge[0, 2]]], atol=1e-15)
    column = Mesh.vertical_prism().vertices
    assert np.isclose(column[:, 1], column[:, 1].min()).sum() == 4  # a side faces -y


def test_curves_are_met_to_a_tenth_of_a_millimetre() -> None:
    sphere = in_trimesh(Mesh.sphere())
    distances = np.linalg.norm(sphere.triangles_center - [0, 0, 0.17], axis=1)
    assert 0 < 0.05 - distances.min() < 1e-4
    assert 0.05 * (1 - math.cos(math.pi / 64)) < 1e-4
    assert len(sphere.faces) == 5120
    assert np.degrees(sphere.face_angles.min()) > 45


def test_size_and_centre() -> None:
    mesh = Mesh.sphere(size=0.04, centre=(0.01, -0.02, 0.3))
    np.testing.assert_allclose(in_trimesh(mesh).bounds, [[-0.01, -0.04, 0.28], [0.03, 0, 0.32]], atol=1e-15)
