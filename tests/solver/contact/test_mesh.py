from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.arguments import FARTHEST
from phasewire.solver.contact.mesh import MOST_FACES, Mesh, Solid
from scipy.spatial.transform import Rotation

TRIANGLE = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]
WEDGE = Mesh.of([*TRIANGLE, [0.0, 0.0, 0.3]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: math.hypot(*axis) > 0.1)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([*TRIANGLE, [0, 1e9, 0]], [[0, 1, 2]], f"vertex 3 is .* metres, at most {FARTHEST:g}"),
        ([], [[0, 1, 2]], r"vertices must have the shape \(m, 3\)"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], r"vertices must have the shape \(m, 3\)"),
        (TRIANGLE, [], r"faces must have the shape \(f, 3\) with f of at least 1, not \(0,\)"),
        (TRIANGLE, np.zeros((0, 3), int), r"with f of at least 1, not \(0, 3\)"),
        (TRIANGLE, [[0, 1, 2, 0]], r"faces must have the shape \(f, 3\)"),
        (TRIANGLE, [[0, 1], [0]], r"faces must be \(f, 3\) whole numbers"),
        (TRIANGLE, [[0.0, 1, 2]], "faces must be whole numbers, .* not float64"),
        (TRIANGLE, [[0, 1, 2], [0, 1, 3]], r"face 1 is \[0, 1, 3\]; there are vertices 0 to 2"),
        (TRIANGLE, [[0, -1, 2]], r"face 0 is \[0, -1, 2\]"),
        (TRIANGLE, np.full((1, 3), 2**63, np.uint64), "face 0 is"),
        (TRIANGLE, np.zeros((MOST_FACES + 1, 3), int), "1000001 faces is too large; at most 1000000"),
    ],
)
def test_invalid_meshes_are_refused(vertices: Any, faces: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Mesh.of(vertices, faces)


def test_a_million_faces_are_possible() -> None:
    assert len(Solid(TRIANGLE, np.zeros((MOST_FACES, 3), int)).faces) == MOST_FACES


@pytest.mark.parametrize(
    "shape",
    [trimesh.creation.icosphere(subdivisions=2), trimesh.creation.annulus(0.1, 0.2, 0.1), trimesh.creation.box()],
)
def test_edges_equal_trimesh_s(shape: Any) -> None:
    solid = Solid(shape.vertices, shape.faces)
    assert (solid.edges[:, 0] < solid.edges[:, 1]).all()
    assert set(map(tuple, solid.edges.tolist())) == set(map(tuple, np.sort(shape.edges_unique, axis=1).tolist()))
    assert len(solid.edges) == len(shape.edges_unique)
    theirs = np.sort(shape.edges, axis=1).reshape(-1, 3, 2)
    np.testing.assert_array_equal(solid.edges[solid.face_edges], theirs)
    pairs = {
        (*sorted(pair), *edge)
        for pair, edge in zip(shape.face_adjacency.tolist(), shape.face_adjacency_edges.tolist(), strict=True)
    }
    assert {
        (*sorted(pair), *edge) for pair, edge in zip(solid.edge_faces.tolist(), solid.edges.tolist(), strict=True)
    } == pairs


def test_edges_of_an_open_surface_have_one_face() -> None:
    solid = Solid([*TRIANGLE, [0.1, 0.1, 0.0]], [[0, 1, 2], [1, 3, 2]])
    np.testing.assert_array_equal(solid.edges, [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]])
    np.testing.assert_array_equal(solid.face_edges, [[0, 2, 1], [3, 4, 2]])
    np.testing.assert_array_equal(solid.edge_faces, [[0, -1], [0, -1], [0, 1], [1, -1], [1, -1]])


def test_an_edge_of_three_faces_keeps_the_first_and_the_last() -> None:
    solid = Solid([*TRIANGLE, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], [[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    np.testing.assert_array_equal(solid.edge_faces[0], [0, 2])


def test_edges_of_a_hundred_thousand_faces_are_quick() -> None:
    shape = trimesh.creation.icosphere(subdivisions=6)  # 81 920 faces
    solid = Solid(shape.vertices, shape.faces)
    begin = time.process_time()
    assert len(solid.edges) == 122_880
    assert time.process_time() - begin < 0.5  # 0.05 s on a quiet core; the processor's time does not count the load


@given(degrees=st.floats(-720, 720), axis=directions, offset=st.tuples(*[st.floats(-1, 1)] * 3))
def test_poses_are_rigid(degrees: float, axis: tuple[float, ...], offset: tuple[float, ...]) -> None:
    moved = WEDGE.moved(offset).rotated(degrees, axis)
    turn = Rotation.from_rotvec(math.radians(degrees) * np.array(axis) / math.hypot(*axis))
    expected = turn.apply(WEDGE.vertices - WEDGE.centre) + WEDGE.centre + offset
    np.testing.assert_allclose(moved.vertices, expected, atol=1e-12)
    np.testing.assert_allclose(moved.centre, WEDGE.centre + offset, atol=1e-12)
    assert moved.solid is WEDGE.solid


def test_a_scaled_object_keeps_its_centre_and_pose() -> None:
    turned = WEDGE.moved((1, 2, 3)).rotated(40, (1, 1, 0))
    larger = turned.scaled(3)
    np.testing.assert_allclose(larger.centre, turned.centre)
    np.testing.assert_allclose(larger.vertices - larger.centre, 3 * (turned.vertices - turned.centre), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: WEDGE.moved((0, 0)), r"offset \[0.0, 0.0\] must be three numbers"),
        (lambda: WEDGE.moved((0, 0, 6)).moved((0, 0, 6)), "offset .* at most 10 each"),
        (lambda: WEDGE.rotated(10, (0, 0, 0)), "axis .* not all of them 0"),
        (lambda: WEDGE.scaled(0), "scale 0 must be from 1e-06"),
        (lambda: WEDGE.scaled(1e6), "vertex 0 is .* at most 10"),
        (lambda: Mesh(WEDGE.solid, np.ones((3, 3)), np.zeros(3)), "is no rotation: its rows"),
        (lambda: Mesh(WEDGE.solid, np.diag([1.0, 1, -1]), np.zeros(3)), "is no rotation but a reflection"),
    ],
)
def test_invalid_poses_are_refused(change: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        change()
