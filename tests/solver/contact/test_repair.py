from __future__ import annotations

from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.solver.contact import repair
from phasewire.solver.contact.mesh import Mesh
from phasewire.solver.contact.repair import MOST_BODIES, MOST_OPEN_EDGES, TRIED, WIDEST_CRACK

from .cuts import in_trimesh

CUBE = Mesh.cube()
BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.05)


def sound(mesh: Mesh, volume: float, rel: float = 1e-9) -> Mesh:
    """The repaired mesh, which trimesh finds closed, oriented outward and of this volume."""
    repaired = mesh.repaired()
    shape = in_trimesh(repaired)
    assert shape.is_watertight
    assert shape.is_winding_consistent
    assert shape.volume == pytest.approx(volume, rel=rel)
    return repaired


@pytest.mark.parametrize("mesh", [CUBE, Mesh.sphere(), Mesh.cone(), Mesh.of(BALL.vertices, BALL.faces)])
def test_a_sound_mesh_stays_as_it_is(mesh: Mesh) -> None:
    repaired = sound(mesh, in_trimesh(mesh).volume)
    assert repaired.repairs == ()
    assert len(repaired.faces) == len(mesh.faces)
    assert len(repaired.vertices) == len(mesh.vertices)


def test_separate_triangles_are_joined_without_a_note() -> None:
    repaired = sound(Mesh.of(CUBE.vertices[CUBE.faces].reshape(-1, 3), np.arange(36).reshape(12, 3)), 1e-3)
    assert len(repaired.vertices) == 8
    assert repaired.repairs == ()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_triangles_that_miss_each_other_by_rounding_are_joined(seed: int) -> None:
    triangles = CUBE.vertices[CUBE.faces].reshape(-1, 3)
    noise = np.random.default_rng(seed).uniform(-4e-8, 4e-8, triangles.shape)
    with patch.multiple(repair, TRIED=11, MOST_OPEN_EDGES=0):  # so that the first look counts every edge
        repaired = sound(Mesh.of(triangles + noise, np.arange(36).reshape(12, 3)), 1e-3, rel=1e-5)
    assert len(repaired.vertices) == 8
    assert repaired.repairs == ("28 vertices merged with others within 1e-07 m",)


def test_zeros_of_both_signs_are_equal() -> None:
    tetrahedron = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    triangles = tetrahedron[[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]].reshape(-1, 3)
    triangles[triangles == 0] = np.where(np.arange((triangles == 0).sum()) % 2, 0.0, -0.0)
    assert len(sound(Mesh.of(triangles, np.arange(12).reshape(4, 3)), 1e-3 / 6).vertices) == 4


def test_faces_without_area_and_duplicates_are_removed() -> None:
    faces = [*CUBE.faces.tolist(), [0, 0, 1], [2, 2, 2], CUBE.faces[3].tolist(), np.roll(CUBE.faces[4], 1).tolist()]
    repaired = sound(Mesh.of(CUBE.vertices, faces), 1e-3)
    assert repaired.repairs == ("2 faces without area removed", "2 duplicate faces removed")


def test_a_wall_between_two_rooms_is_removed() -> None:
    mirrored = CUBE.vertices * [-1, 1, 1] + [0.1, 0, 0]
    both = Mesh.of(np.concatenate([CUBE.vertices, mirrored]), np.concatenate([CUBE.faces, CUBE.faces[:, ::-1] + 8]))
    repaired = sound(both, 2e-3)
    assert repaired.repairs == ("4 duplicate faces removed",)
    assert len(repaired.faces) == 20


def test_a_body_with_two_sided_faces_keeps_one_side() -> None:
    repaired = sound(Mesh.of(CUBE.vertices, np.concatenate([CUBE.faces, CUBE.faces[:, ::-1]])), 1e-3)
    assert repaired.repairs[0] == "12 duplicate faces removed"


@given(turned=st.sets(st.integers(0, len(BALL.faces) - 1), min_size=1, max_size=len(BALL.faces) // 2 - 1))
@settings(max_examples=20)
def test_faces_with_opposite_winding_are_turned(turned: set[int]) -> None:
    faces = BALL.faces.copy()
    faces[list(turned)] = faces[list(turned), ::-1]
    repaired = sound(Mesh.of(BALL.vertices, faces), BALL.volume)
    many = "faces" if len(turned) > 1 else "face"
    assert repaired.repairs == (f"{len(turned)} {many} turned to agree with the others",)


def test_a_body_inside_out_is_turned() -> None:
    assert sound(Mesh.of(CUBE.vertices, CUBE.faces[:, ::-1]), 1e-3).repairs == (
        "1 body turned, having been inside out",
    )


def test_a_cavity_stays_and_an_inside_out_neighbour_is_turned() -> None:
    inner, beside = Mesh.cube(size=0.05), Mesh.cube(size=0.05, centre=(0.2, 0, 0.17))
    for other, volume, repairs in ((inner, 0.875e-3, 0), (beside, 1.125e-3, 1)):
        vertices = np.concatenate([CUBE.vertices, other.vertices])
        both = Mesh.of(vertices, np.concatenate([CUBE.faces, CUBE.faces[:, ::-1] + 8]))
        assert len(sound(both, volume).repairs) == repairs


def test_bodies_that_share_an_edge_are_sound() -> None:
    beside = CUBE.moved((0.1, 0.1, 0))
    both = Mesh.of(np.concatenate([CUBE.vertices, beside.vertices]), np.concatenate([CUBE.faces, CUBE.faces + 8]))
    repaired = both.repaired()
    assert repaired.repairs == ()
    assert len(repaired.vertices) == 14
    assert in_trimesh(repaired).volume == pytest.approx(2e-3)


def test_a_narrow_hole_is_closed() -> None:
    ball = Mesh.sphere()
    faces = ball.faces[~(ball.faces == np.argmax(ball.vertices[:, 2])).any(axis=1)]
    repaired = sound(Mesh.of(ball.vertices, faces), in_trimesh(ball).volume, rel=1e-3)
    assert repaired.repairs[0].startswith("1 hole closed, up to ")
    assert in_trimesh(repaired).euler_number == 2
    one = sound(Mesh.of(BALL.vertices, BALL.faces[1:]), BALL.volume)
    assert len(one.faces) == len(BALL.faces)


def test_two_holes_that_meet_in_a_vertex_are_closed() -> None:
    corner = BALL.faces[0, 0]
    around = np.flatnonzero((BALL.faces == corner).any(axis=1))
    first = around[0]
    apart = next(face for face in around if len(set(BALL.faces[face]) & set(BALL.faces[first])) == 1)
    repaired = sound(Mesh.of(BALL.vertices, np.delete(BALL.faces, [first, apart], axis=0)), BALL.volume)
    assert repaired.repairs[0].startswith("2 holes closed")


def test_a_long_crack_is_closed_because_it_is_narrow() -> None:
    """A vertex in the middle of an edge of one of its two faces: the two halves do not meet the whole."""
    middle = (CUBE.vertices[CUBE.faces[0, 0]] + CUBE.vertices[CUBE.faces[0, 1]]) / 2
    (a, b, c), rest = CUBE.faces[0], CUBE.faces[1:]
    split = np.concatenate([rest, [[a, 8, c], [8, b, c]]])
    repaired = sound(Mesh.of(np.concatenate([CUBE.vertices, [middle]]), split), 1e-3)
    assert repaired.repairs == ("1 hole closed, up to 0 mm wide",)


def test_a_wide_hole_is_refused_with_its_place() -> None:
    top = np.isclose(CUBE.vertices[CUBE.faces][:, :, 2], 0.22).all(axis=1)
    message = r"it has 1 hole; the widest has 4 open edges, is 100 mm wide and lies around \(0, 0, 0.22\) m"
    with pytest.raises(ValueError, match=message):
        Mesh.of(CUBE.vertices, CUBE.faces[~top]).repaired()


@pytest.mark.parametrize(("factor", "closed"), [(0.99, True), (1.01, False)])
def test_holes_up_to_a_wavelength_are_closed(factor: float, closed: bool) -> None:
    cube = Mesh.cube(size=factor * WIDEST_CRACK)
    top = np.isclose(cube.vertices[cube.faces][:, :, 2], cube.vertices[:, 2].max()).all(axis=1)
    lidless = Mesh.of(cube.vertices, cube.faces[~top])
    if closed:
        sound(lidless, (factor * WIDEST_CRACK) ** 3)
        return
    with pytest.raises(ValueError, match=r"only holes up to 8\.6 mm are closed here"):
        lidless.repaired()


def moebius() -> Mesh:
    count = 24
    angle = 2 * np.pi * np.arange(count) / count
    offset = 0.001 * np.array([-1, 1])[:, None]
    radius = 0.05 + offset * np.cos(angle / 2)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), offset * np.sin(angle / 2)], axis=2)
    faces = []
    for here in range(count):
        low, high = here, count + here
        next_low, next_high = (here + 1, count + here + 1) if here + 1 < count else (count, 0)
        faces += [[low, next_low, high], [high, next_low, next_high]]
    return Mesh.of(rim.reshape(-1, 3), faces)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (moebius(), "it has one side only"),
        (Mesh.of([[0.0, 0, 0], [0.001, 0, 0], [0, 0.001, 0]], [[0, 1, 2]]), "encloses no volume"),
        (Mesh.of([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 1]]), "encloses no volume"),
        (Mesh.of([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 1], [0, 0, 0]]), "none of its faces has an area"),
        (Mesh.of([[0.1, 0.1, 0.1]] * 3, [[0, 1, 2]]), "it is 0 m large, too small to be felt"),
        (CUBE.scaled(9e-6), "it is 9e-07 m large, too small"),
    ],
)
def test_triangles_that_enclose_no_volume_are_refused(mesh: Mesh, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        mesh.repaired()


def test_loose_triangles_are_refused_at_once() -> None:
    corners = np.random.default_rng(0).uniform(0, 0.004, (3 * (MOST_OPEN_EDGES // 3 + 1), 3))
    with pytest.raises(ValueError, match=r"it is not closed: 10002 edges are open; at most 10000 may be"):
        Mesh.of(corners, np.arange(len(corners)).reshape(-1, 3)).repaired()


def test_a_large_mesh_of_loose_triangles_is_refused_before_any_repair() -> None:
    corners = np.random.default_rng(0).uniform(0, 0.1, (3 * (TRIED + 1), 3))
    with (
        patch.object(repair, "_compact", side_effect=AssertionError),
        pytest.raises(
            ValueError, match="of 90000 edges that were looked at, 90000 are open; at most 10000 of all may be"
        ),
    ):
        Mesh.of(corners, np.arange(len(corners)).reshape(-1, 3)).repaired()


def test_too_many_bodies_are_refused() -> None:
    small = Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    copies = np.arange(MOST_BODIES + 1)
    vertices = (small.vertices * 4e-4 + 8e-4 * copies[:, None, None] * [1, 0, 0]).reshape(-1, 3)
    faces = (small.faces + 4 * copies[:, None, None]).reshape(-1, 3)
    with pytest.raises(ValueError, match="10001 separate bodies; at most 10000 are possible"):
        Mesh.of(vertices, faces).repaired()
    assert Mesh.of(vertices[:-4], faces[:-4]).repaired().repairs == ()


@given(
    vertices=st.lists(st.tuples(*[st.sampled_from([0.0, 1e-300, 1e-9, 1e-3, 0.005, 0.1])] * 3), min_size=3, max_size=8),
    data=st.data(),
)
def test_any_triangles_become_a_closed_body_or_are_refused(vertices: list[tuple[float, ...]], data: Any) -> None:
    corner = st.integers(0, len(vertices) - 1)
    faces = data.draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=14))
    try:
        repaired = Mesh.of(vertices, faces).repaired()
    except ValueError:
        return
    faces, edges = repaired.faces, repaired.solid.face_edges
    forward = np.where(faces < np.roll(faces, -1, axis=1), 1, -1)
    assert not np.bincount(edges.ravel(), weights=forward.ravel()).any()
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(repaired.vertices)))
