"""Curvature of edges: closed forms, Descartes' theorem, and independence of the triangulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.solver.contact.curvature import FLAT, SHARP, angular_defects, dihedral_angles
from phasewire.solver.contact.mesh import Solid

RIGHT = math.pi / 2


def solid_of(mesh: trimesh.Trimesh) -> Solid:
    return Solid(mesh.vertices, mesh.faces)


def divided(mesh: trimesh.Trimesh, times: int) -> trimesh.Trimesh:
    """Each triangle in four, so many times."""
    for _ in range(times):
        mesh = mesh.subdivide()
    return mesh


def box(divisions: int = 0) -> trimesh.Trimesh:
    return divided(trimesh.creation.box((0.1, 0.1, 0.1)), divisions)


def pyramid(divisions: int = 0) -> trimesh.Trimesh:
    """A square one of 10 cm, with its apex at (0, 0, 0.1)."""
    corners = [[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0], [0, 0, 0.1]]
    faces = [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    return divided(trimesh.Trimesh(corners, faces), divisions)


@pytest.mark.parametrize("divisions", [0, 1, 3])
def test_a_cube_has_right_angles_along_its_edges_and_is_flat_elsewhere(divisions: int) -> None:
    solid = solid_of(box(divisions))
    on_edges = np.isclose(np.abs(solid.vertices[solid.edges].mean(axis=1)), 0.05).sum(axis=1) == 2
    assert on_edges.sum() == 12 * 2**divisions
    np.testing.assert_allclose(solid.edge_curvature[on_edges], RIGHT, atol=1e-9)
    assert not solid.edge_curvature[~on_edges].any()


def test_faces_that_a_file_of_float32_bends_are_flat() -> None:
    mesh = box(3)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.5, 0.7])))
    mesh.apply_translation((0.01, -0.02, 0.17))
    solid = Solid(mesh.vertices.astype(np.float32), mesh.faces)
    angles = dihedral_angles(solid.vertices, solid.faces, solid.edge_faces)
    inside = angles < 0.1
    assert 0 < angles[inside].max() < FLAT
    assert not solid.edge_curvature[inside].any()
    np.testing.assert_allclose(solid.edge_curvature[~inside], RIGHT, atol=1e-4)


@pytest.mark.parametrize("divisions", [1, 2])
def test_a_division_changes_nothing_along_an_edge(divisions: int) -> None:
    """Along the edges to the apex, where the corners' values differ."""
    whole = solid_of(pyramid())
    lateral = next(i for i, edge in enumerate(whole.edges.tolist()) if 4 in edge and 0 in edge)
    at_base, at_apex = whole.edge_curvature[lateral]
    base = 2 * math.pi - (RIGHT + 2 * math.atan(math.sqrt(5)))
    apex = 2 * math.pi - 4 * 2 * math.atan(1 / math.sqrt(5))
    assert (at_base, at_apex) == (pytest.approx(base), pytest.approx(apex))
    divided = solid_of(pyramid(divisions))
    height = divided.vertices[divided.edges][:, :, 2] / 0.1
    x, y = np.abs(divided.vertices[divided.edges][:, :, 0]), np.abs(divided.vertices[divided.edges][:, :, 1])
    on_lateral = (np.isclose(x, y) & np.isclose(x, 0.05 * (1 - height))).all(axis=1) & (np.ptp(height, axis=1) > 0)
    assert on_lateral.sum() == 4 * 2**divisions
    np.testing.assert_allclose(
        divided.edge_curvature[on_lateral], base + (apex - base) * height[on_lateral], rtol=0, atol=1e-9
    )


def test_defects_of_closed_surfaces_sum_to_their_euler_characteristic() -> None:
    """Descartes: 4π for a ball, 0 for a torus."""
    ball, torus = trimesh.creation.icosphere(3), trimesh.creation.torus(0.05, 0.02)
    for mesh, expected in [(ball, 4 * math.pi), (box(2), 4 * math.pi), (torus, 0.0)]:
        solid = solid_of(mesh)
        defects = angular_defects(solid.vertices, solid.faces, solid.edges, solid.edge_faces)
        assert defects.sum() == pytest.approx(expected, abs=1e-9)
        np.testing.assert_allclose(defects, mesh.vertex_defects, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_convex_polyhedra_have_the_dihedral_angles_that_trimesh_finds(seed: int) -> None:
    mesh = trimesh.Trimesh(np.random.default_rng(seed).normal(size=(20, 3))).convex_hull
    solid = solid_of(mesh)
    angles = dihedral_angles(solid.vertices, solid.faces, solid.edge_faces)
    theirs = {
        tuple(sorted(edge)): angle
        for edge, angle in zip(mesh.face_adjacency_edges.tolist(), mesh.face_adjacency_angles, strict=True)
    }
    np.testing.assert_allclose(angles, [theirs[tuple(edge)] for edge in solid.edges.tolist()], atol=1e-7)
    assert (solid.edge_curvature >= np.where(angles < FLAT, 0, angles)[:, None] - 1e-12).all()


def test_a_smooth_surface_is_flat_in_the_limit() -> None:
    highest = [solid_of(trimesh.creation.icosphere(level, 0.05)).edge_curvature.max() for level in range(2, 6)]
    assert highest[0] < SHARP
    ratios = np.array(highest[1:]) / highest[:-1]
    np.testing.assert_allclose(ratios, 0.5, atol=0.05)


def test_the_tip_of_a_cone_does_not_make_its_side_sharp() -> None:
    cone = trimesh.creation.cone(0.05, 0.1, sections=64)
    solid = solid_of(cone)
    tip = int(np.argmax(solid.vertices[:, 2]))
    to_tip = (solid.edges == tip).any(axis=1)
    assert solid.edge_curvature[to_tip].max() < 0.1
    on_rim = (solid.vertices[solid.edges][:, :, 2] < 1e-9).all(axis=1) & (solid.edge_curvature.max(axis=1) > 0)
    assert on_rim.sum() == 64
    assert solid.edge_curvature[on_rim].min() > RIGHT


def test_the_border_of_a_sheet_is_an_edge() -> None:
    sheet = Solid(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) / 10, [[0, 1, 2], [0, 2, 3]])
    values = {
        tuple(edge): value.tolist() for edge, value in zip(sheet.edges.tolist(), sheet.edge_curvature, strict=True)
    }
    assert values.pop((0, 2)) == [0, 0]
    np.testing.assert_allclose(list(values.values()), math.pi)


def test_triangles_without_area_and_doubles_do_no_harm() -> None:
    mesh = box()
    faces = np.concatenate([mesh.faces, mesh.faces[:2], [[0, 0, 1], [2, 2, 2]]])
    values = Solid(mesh.vertices, faces).edge_curvature
    assert np.isfinite(values).all()
    assert (values >= 0).all()


def test_a_loop_of_straight_edges_without_a_corner_ends() -> None:
    """The rim of a disc of so many sides that each continues the last one: there is no corner to begin at."""
    angle = np.arange(10_000) * 2 * np.pi / 10_000
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1) * 0.05
    low, high = (np.column_stack([rim, np.full(len(rim), z)]) for z in (0, 0.1))
    i = np.arange(len(rim))
    j = (i + 1) % len(rim)
    n = len(rim)
    sides = np.concatenate([np.stack([i, j, j + n], 1), np.stack([i, j + n, i + n], 1)])
    caps = np.concatenate([np.stack([j, i, np.full(n, 2 * n)], 1), np.stack([i + n, j + n, np.full(n, 2 * n + 1)], 1)])
    vertices = np.concatenate([low, high, [[0, 0, 0], [0, 0, 0.1]]])
    solid = Solid(vertices, np.concatenate([sides, caps]))
    on_rims = np.ptp(solid.edges // n, axis=1) == 0
    sharp = solid.edge_curvature.max(axis=1) > SHARP
    assert (sharp == on_rims).all()
    np.testing.assert_allclose(solid.edge_curvature[sharp], RIGHT, atol=1e-6)
