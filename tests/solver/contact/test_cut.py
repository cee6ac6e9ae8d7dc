from __future__ import annotations

import math
from time import process_time

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from phasewire.solver.contact import literal
from phasewire.solver.contact.arcs import KNUCKLE, Arcs
from phasewire.solver.contact.cut import cut
from phasewire.solver.contact.hand import Hand
from phasewire.solver.contact.mesh import Mesh

from .cuts import BIG, Floats, blob, hand, lattice_case, lengths, parallelogram

SEEDS = st.integers(0, 2**32 - 1)


def assert_same(one: Arcs, other: Arcs) -> None:
    for name in ("starts", "closed", "objects", "faces", "quads", "edges"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    np.testing.assert_allclose(one.vertices, other.vertices, rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.along, other.along, rtol=0, atol=1e-6)


def by_trimesh(quad: Floats, mesh: Mesh) -> float:
    """Length that trimesh cuts with the quadrilateral's plane, within its borders."""
    normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
    found = trimesh.intersections.mesh_plane(  # type: ignore[no-untyped-call]  # it has no types
        trimesh.Trimesh(mesh.vertices, mesh.faces, process=False), normal / np.linalg.norm(normal), quad[0]
    )
    total = 0.0
    for start, stop in found:
        first, last = 0.0, 1.0
        for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True):
            inward = np.cross(normal, b - a)
            here, there = (start - a) @ inward, (stop - a) @ inward
            if here < 0 and there < 0:
                last = first
            elif here < 0:
                first = max(first, here / (here - there))
            elif there < 0:
                last = min(last, here / (here - there))
        total += max(last - first, 0) * float(np.linalg.norm(stop - start))
    return total


def nearly_touched(quad: Floats, mesh: Mesh) -> bool:
    """Whether the plane is so near a vertex that trimesh takes it for one in the plane: within 1e-8 m."""
    normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
    heights = (mesh.vertices - quad[0]) @ normal / np.linalg.norm(normal)
    return bool(np.abs(heights).min() < 1e-7)


def test_a_cube_at_mid_height_is_one_closed_loop_of_400_mm() -> None:
    arcs = cut(BIG, Mesh.cube())
    assert arcs.closed.tolist() == [True]
    np.testing.assert_allclose(lengths(arcs), 0.4, rtol=1e-12)
    np.testing.assert_array_equal(arcs.vertices[0], arcs.vertices[-1])
    x, y, _ = arcs.vertices.T
    assert 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) == pytest.approx(0.01)  # counterclockwise as seen from above


@given(SEEDS)
def test_lengths_are_those_of_trimesh(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = blob(rng)
    quads = [parallelogram(*rng.uniform(-0.08, 0.08, (3, 3))) for _ in range(6)]
    quads = [quad for quad in quads if not nearly_touched(quad, mesh)]
    expected = [by_trimesh(quad, mesh) for quad in quads]
    assert [lengths(cut([quad], mesh)).sum() for quad in quads] == pytest.approx(expected, rel=0, abs=1e-9)
    assert lengths(cut(quads, mesh)).sum() == pytest.approx(sum(expected), rel=0, abs=1e-9)


@settings(max_examples=10)
@given(SEEDS)
def test_it_is_the_literal_version(seed: int) -> None:
    rng = np.random.default_rng(seed)
    meshes = [blob(rng), Mesh.cube(centre=rng.uniform(-0.05, 0.05, 3))]
    quads = np.concatenate([hand(rng), hand(rng)])
    for hands in (False, True):
        assert_same(cut(quads, meshes, hands), literal.cut(quads, meshes, hands))


@settings(max_examples=100)
@given(SEEDS)
def test_it_is_the_literal_version_if_everything_coincides(seed: int) -> None:
    quads, meshes = lattice_case(np.random.default_rng(seed))
    assert_same(cut(quads, meshes), literal.cut(quads, meshes))


@given(SEEDS)
def test_a_moved_mesh_is_cut_as_its_vertices_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh, quads = blob(rng), hand(rng)
    assert_same(cut(quads, mesh, hands=True), cut(quads, Mesh.of(mesh.vertices, mesh.faces), hands=True))


@given(SEEDS)
def test_the_section_of_a_tetrahedron_is_one_closed_arc(seed: int) -> None:
    """Also if it goes through one, two or three of its corners, which are on a coarse lattice."""
    rng = np.random.default_rng(seed)
    while True:
        corners, (a, u, v) = rng.integers(-2, 3, (4, 3)), rng.integers(-2, 3, (3, 3))
        if np.linalg.det(corners[1:] - corners[0]) > 0.5 and np.any(normal := np.cross(u, v)):
            break
    arcs = cut(
        [parallelogram(a - 50 * (u + v), 100 * u, 100 * v)],
        Mesh.of(corners, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]),
    )
    heights = (corners - a) @ normal
    below = heights < 0
    touched = (heights == 0).sum() == 1 and below.sum() == 3
    assert arcs.closed.tolist() == [True] * bool(below.any() and not below.all() and not touched)


CUBE = Mesh.cube(size=1 / 8, centre=(0, 0, 0))  # of numbers that are exact


@given(SEEDS)
def test_rounding_makes_no_arc_inside_a_face_in_the_plane(seed: int) -> None:
    """A cube of many triangles, turned in any way, and a quadrilateral turned alike along one of its faces."""
    rng = np.random.default_rng(seed)
    made = trimesh.creation.box((0.1, 0.1, 0.1)).subdivide().subdivide()
    mesh = Mesh.of(made.vertices, made.faces).rotated(rng.uniform(0, 360), rng.normal(size=3)).moved(rng.random(3))
    quad = parallelogram([-0.1, -0.1, 0.05], [0.2, 0, 0], [0, 0.2, 0]) @ mesh.rotation.T + mesh.offset
    for found in (cut([quad], mesh), literal.cut([quad], [mesh])):
        assert found.closed.tolist() == [True]
        np.testing.assert_allclose(lengths(found), 0.4, rtol=1e-9)
    assert len(cut([quad[::-1]], mesh)) == 0


def test_a_torn_mesh_is_joined_quickly() -> None:
    """A hundred thousand triangles that share no edge: each leaves an arc of its own, thousands of them at borders."""
    rng = np.random.default_rng(16)
    corners = rng.uniform([-0.1, -0.1, 0.12], [0.1, 0.1, 0.22], (100_000, 1, 3)) + rng.normal(0, 0.12, (100_000, 3, 3))
    torn = Mesh.of(corners.reshape(-1, 3), np.arange(300_000).reshape(-1, 3))
    quads = Hand.flat((0, 0, 0.17)).quads
    cut(quads[:1], torn, hands=False)  # the tree is made once
    began = process_time()
    alone = cut(quads, torn)
    seconds = process_time() - began
    began = process_time()
    joined = cut(quads, torn, hands=True)
    assert process_time() - began < 3 * seconds + 0.5
    assert 4000 < len(joined) <= len(alone)


@pytest.mark.parametrize("border", [-1 / 16, 0, 1 / 16, 1 / 32])
@pytest.mark.parametrize("turned", [False, True])
def test_a_border_on_mesh_edges_or_in_faces_gives_one_closed_arc(border: float, turned: bool) -> None:
    """Two quadrilaterals of a finger, whose common border is in a face of the cube, or meets its diagonals."""
    quads = np.zeros((16, 4, 3))
    quads[1] = parallelogram([-1, -1, 0], [2, 0, 0], [0, 1 + border, 0])
    quads[2] = parallelogram([-1, border, 0], [2, 0, 0], [0, 1 - border, 0])
    if turned:
        quads = quads[..., [1, 2, 0]]
    arcs = cut(quads, CUBE, hands=True)
    assert arcs.closed.tolist() == [True]
    assert lengths(arcs).tolist() == [0.5]
    assert lengths(cut(quads, CUBE)).sum() == 0.5


def test_an_arc_goes_on_over_the_joint_of_bent_quadrilaterals() -> None:
    quads = np.zeros((16, 4, 3))
    quads[4] = parallelogram([-0.01, -0.03, 0.005], [0.02, 0, 0], [0, 0.03, 0])
    quads[5] = parallelogram([-0.01, 0, 0.005], [0.02, 0, 0], [0, 0.02, 0.02])
    quads[6] = parallelogram([-0.01, 0.02, 0.025], [0.02, 0, 0], [0, 0.05, 0.02])
    long = Mesh.cube(size=0.01, centre=(0, 0, 0))
    bar = Mesh.of(long.vertices * [1, 100, 100], long.faces)  # 1 cm thick
    arcs = cut(quads, bar, hands=True)
    length = 0.03 + 0.02 * math.sqrt(2) + math.hypot(0.05, 0.02)
    np.testing.assert_allclose(lengths(arcs), [length, length], rtol=1e-12)
    assert not arcs.closed.any()
    for line, quads_of in ((arcs.polylines()[i], arcs.quads[arcs.starts[i] : arcs.starts[i + 1] - 1]) for i in (0, 1)):
        assert (np.linalg.norm(np.diff(line, axis=0), axis=1) > 0).all()  # each joint is one vertex
        assert sorted(set(quads_of.tolist())) == [4, 5, 6]
    assert lengths(cut(quads, bar)).sum() == pytest.approx(2 * length)


@pytest.mark.parametrize(("gap", "count"), [(0.0, 2), (KNUCKLE - 1e-5, 2), (KNUCKLE + 1e-5, 4)])
def test_the_palm_goes_on_in_a_finger_that_is_near(gap: float, count: int) -> None:
    quads = np.zeros((32, 4, 3))
    quads[16] = parallelogram([-0.04, -0.09, 0.005], [0.08, 0, 0], [0, 0.09, 0])
    quads[16 + 7] = parallelogram([-0.01, gap, 0.005], [0.02, 0, 0], [0, 0.04, 0])
    bar = Mesh.of(Mesh.cube(size=0.01, centre=(0, 0, 0)).vertices * [1, 100, 100], Mesh.cube().faces)
    arcs = cut(quads, bar, hands=True)
    assert len(arcs) == count
    assert lengths(arcs).sum() == pytest.approx(2 * (0.09 + 0.04 + (gap if count == 2 else 0)))
    assert set(arcs.quads.tolist()) == {-1, 16, 23}


@pytest.mark.parametrize("first", [0, 1])
def test_of_two_arcs_of_the_palm_the_nearer_goes_on_in_the_finger(first: int) -> None:
    """A bar that the finger cuts too, and beside it one that only the palm cuts, in either order of their faces."""
    quads = np.zeros((16, 4, 3))
    quads[0] = parallelogram([-0.04, -0.09, 0.005], [0.08, 0, 0], [0, 0.09, 0])
    quads[7] = parallelogram([-0.008, 0.005, 0.005], [0.016, 0, 0], [0, 0.04, 0])
    bar = Mesh.of(Mesh.cube(size=0.005, centre=(0, 0, 0)).vertices * [1, 200, 200], Mesh.cube().faces)
    pair = [bar, bar.moved((0.011, 0, 0))][:: 1 if first == 0 else -1]
    faces = np.concatenate([bar.faces, bar.faces + len(bar.vertices)])
    arcs = cut(quads, Mesh.of(np.concatenate([each.vertices for each in pair]), faces), hands=True)
    np.testing.assert_allclose(np.sort(lengths(arcs)), [0.09, 0.09, 0.135, 0.135])
    for line, length in zip(arcs.polylines(), lengths(arcs), strict=True):
        assert np.ptp(line[:, 0]) < 1e-12
        assert (abs(line[0, 0]) < 0.005) == (length > 0.1)


def test_fingers_of_different_hands_are_not_joined() -> None:
    quads = np.zeros((32, 4, 3))
    quads[0] = parallelogram([-0.04, -0.09, 0.005], [0.08, 0, 0], [0, 0.09, 0])
    quads[16 + 7] = parallelogram([-0.01, 0, 0.005], [0.02, 0, 0], [0, 0.04, 0])
    bar = Mesh.of(Mesh.cube(size=0.01, centre=(0, 0, 0)).vertices * [1, 100, 100], Mesh.cube().faces)
    assert len(cut(quads, bar, hands=True)) == 4


def test_triangles_without_area_carry_the_line_on() -> None:
    """A face of the tetrahedron has a vertex more on one edge, closed by a triangle of three vertices on one line."""
    corners = np.array([[0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0], [1 / 2, 0, 1 / 2]]) / 16
    mesh = Mesh.of(corners, [(4, 1, 2), (0, 4, 2), (0, 1, 4), (0, 2, 3), (0, 3, 1), (1, 3, 2), (1, 1, 2), (3, 3, 3)])
    plain = Mesh.of(corners, [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
    for z in (1 / 64, 1 / 32, 3 / 64):
        quad = parallelogram([-1, -1, z], [2, 0, 0], [0, 2, 0])
        arcs = cut([quad], mesh)
        assert arcs.closed.tolist() == [True]
        np.testing.assert_allclose(lengths(arcs), lengths(cut([quad], plain)), rtol=1e-15)


@pytest.mark.parametrize("again", [(0, 1, 2), (1, 2, 0), (2, 1, 0)])
def test_a_triangle_that_occurs_twice_is_cut_once(again: tuple[int, int, int]) -> None:
    faces = np.concatenate([CUBE.faces, CUBE.faces[:, again], CUBE.faces[:5]])
    quad = parallelogram([-1, -1, 1 / 64], [2, 0, 0], [0, 2, 0])
    arcs = cut([quad], Mesh.of(CUBE.vertices, faces))
    assert arcs.closed.tolist() == [True]
    assert lengths(arcs).tolist() == [0.5]
    assert arcs.faces.max() < 12


def test_two_cubes_with_a_common_edge_are_two_loops() -> None:
    other = CUBE.moved([1 / 8, 1 / 8, 0])
    both = trimesh.Trimesh(
        np.concatenate([CUBE.vertices, other.vertices]), np.concatenate([CUBE.faces, other.faces + 8])
    )
    assert len(both.vertices) == 14
    arcs = cut([parallelogram([-1, -1, 1 / 64], [2, 0, 0], [0, 2, 0])], Mesh.of(both.vertices, both.faces))
    assert arcs.closed.all()
    assert lengths(arcs).sum() == 1.0


def test_a_triangle_is_a_quadrilateral_with_a_border_without_length() -> None:
    a, b, c = [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]
    whole = lengths(cut([[a, b, c, [-0.5, 0.0, 0.0]]], CUBE))
    assert lengths(cut([[a, a, b, c]], CUBE)) == pytest.approx(whole)
    assert lengths(cut([[a, b, c, c]], CUBE)) == pytest.approx(whole)


def test_each_of_several_objects_has_its_arcs() -> None:
    arcs = cut(BIG - [0, 0, 0.17], [CUBE, CUBE.moved([0, 0, 1]), CUBE.moved([0.2, 0, 0.01])])
    assert arcs.objects.tolist() == [0, 2]
    np.testing.assert_allclose(lengths(arcs), [0.5, 0.5])
    assert arcs.vertices[arcs.starts[1] :, 0].min() == pytest.approx(0.2 - 1 / 16)
    assert len(cut(BIG, [])) == 0
    assert len(cut(np.empty((0, 4, 3)), CUBE)) == 0


ANY = st.floats(allow_nan=False, allow_infinity=False)


@given(hnp.arrays(np.float64, (16, 4, 3), elements=ANY), hnp.arrays(np.float64, (5, 3), elements=st.floats(-10, 10)))
def test_no_finite_input_breaks_the_kernels(quads: Floats, vertices: Floats) -> None:
    mesh = Mesh.of(vertices, [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2), (1, 2, 4)])
    for hands in (False, True):
        arcs = cut(quads, mesh, hands)
        assert arcs.starts[-1] == len(arcs.vertices) == len(arcs.faces)


@pytest.mark.parametrize(
    ("quads", "hands", "message"),
    [
        (np.zeros((4, 3)), False, r"quadrilaterals must have the shape \(q, 4, 3\), not \(4, 3\)"),
        (np.zeros((15, 4, 3)), True, "hands have 16 quadrilaterals each; 15 are no whole number of hands"),
        (np.full((2, 4, 3), np.nan), False, "quadrilateral 0 is .*; its coordinates must be finite numbers"),
    ],
)
def test_invalid_quadrilaterals_are_refused(quads: Floats, hands: bool, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cut(quads, CUBE, hands)
