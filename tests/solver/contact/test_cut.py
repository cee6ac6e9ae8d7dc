from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from phasewire.solver.contact.arcs import Arcs
from phasewire.solver.contact.cut import cut
from phasewire.solver.contact.mesh import Mesh

BIG = np.array([[[-1, -1, 0.17], [1, -1, 0.17], [1, 1, 0.17], [-1, 1, 0.17]]])


def lengths(arcs: Arcs) -> NDArray[np.float64]:
    return np.array([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in arcs.polylines()])


def ball(subdivisions: int, radius: float = 0.05) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Mesh.of(made.vertices, made.faces)


def test_a_cube_at_mid_height_is_one_closed_loop_of_400_mm() -> None:
    arcs = cut(BIG, Mesh.cube())
    assert arcs.closed.tolist() == [True]
    np.testing.assert_allclose(lengths(arcs), 0.4, rtol=1e-12)
    np.testing.assert_array_equal(arcs.vertices[0], arcs.vertices[-1])
    x, y, _ = arcs.vertices.T
    assert 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) == pytest.approx(0.01)  # counterclockwise as seen from above


def test_spheres_converge_to_their_circumference_at_second_order() -> None:
    quad = BIG - [0, 0, 0.16]  # a height at which no symmetry of the icosahedron helps
    exact = 2 * math.pi * math.sqrt(0.05**2 - 0.01**2)
    errors = [exact - lengths(cut(quad, ball(k))).sum() for k in (2, 3, 4, 5)]
    order = -np.polyfit(range(4), np.log2(errors), 1)[0]
    assert 1.8 < order < 2.2
