"""Control points on arcs: against a literal version, closed forms, and other triangulations of the same object."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Mesh
from phasewire.solver.contact.arcs import Arcs
from phasewire.solver.contact.cut import cut
from phasewire.solver.contact.density import CLOSEST, FADING, FULL, SLIGHT
from phasewire.solver.contact.feeling import curvature_of
from phasewire.solver.contact.scene import Scene
from phasewire.solver.contact.tracking import follow

from tests.solver.contact.literal_density import lines

SPACING = 0.015
SHAPES = ["cone", "sphere", "pyramid", "horizontal_prism", "vertical_prism", "cube"]
Floats = NDArray[np.float64]


def place(arcs: Arcs, curvature: Floats, spacing: float = SPACING, most: int = 4096) -> tuple[Floats, Floats, Floats]:
    """Positions, amplitudes and which are anchors, in a first frame."""
    hands = 1 + arcs.quads.max(initial=0) // 16
    objects = 1 + arcs.objects.max(initial=0)
    given = (arcs.vertices, arcs.names, arcs.rows, curvature, spacing, most)
    before = (np.empty((0, 3)), np.empty((5, 0), np.int64), 0, 0)
    positions, amplitudes, marks, fresh = follow(*given, np.full((objects, hands), np.inf), *before)
    assert marks[0].tolist() == list(range(fresh))
    return positions, amplitudes, marks[3]


def curvature_on(arcs: Arcs, mesh: Mesh, corners: bool = True) -> Floats:
    """Of the mesh, at the vertices of arcs."""
    return np.asarray(curvature_of(Scene.of((mesh,), corners), arcs.along, arcs.names, arcs.rows))


def line(lengths: list[float], curvature: list[float], closed: bool = False) -> tuple[Arcs, Floats]:
    """An arc along x whose pieces have these lengths; if it is closed, it is a square of such sides."""
    count = len(curvature)
    vertices = np.zeros((count, 3))
    if closed:
        side = lengths[0]
        vertices[:, :2] = np.array([[0, 0], [side, 0], [side, side], [0, side], [0, 0]])
    else:
        vertices[1:, 0] = np.cumsum(lengths)
    names = np.zeros((count, 3), np.int64)
    names[:, 2] = np.where(np.array(curvature) > 0, 0, -1)
    arcs = Arcs(vertices, np.zeros(count), names, np.array([(0, closed, 0), (count, -1, -1)]))
    return arcs, np.array(curvature, dtype=np.float64)


def mesh_of(mesh: trimesh.Trimesh) -> Mesh:
    return Mesh.of(mesh.vertices, mesh.faces)


def divided(mesh: Mesh, times: int) -> Mesh:
    """The same surface of more triangles."""
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    for _ in range(times):
        other = other.subdivide()
    return mesh_of(other)


def random_quads(rng: np.random.Generator, count: int = 4) -> Floats:
    """Squares of 4 to 30 cm, somewhere in the paper's objects, at any angle."""
    quads = []
    for _ in range(count):
        frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        half = rng.uniform(0.02, 0.15)
        corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ frame[:2]
        quads.append(corners + rng.uniform(-0.03, 0.03, 3) + [0, 0, 0.17])
    return np.array(quads)


@pytest.mark.parametrize("corners", [True, False])
@pytest.mark.parametrize("shape", SHAPES)
@given(seed=st.integers(0, 2**32 - 1), spacing=st.floats(0.004, 0.04))
@settings(max_examples=8, deadline=None)
def test_it_is_the_literal_division(shape: str, corners: bool, seed: int, spacing: float) -> None:
    mesh = getattr(Mesh, shape)()
    arcs = cut(random_quads(np.random.default_rng(seed), 2), mesh)
    curvature = curvature_on(arcs, mesh, corners)
    positions, _, anchors = place(arcs, curvature, spacing)
    literal = lines(arcs, curvature, spacing)
    expected = [line.at(t) for line in literal for t in sorted(line.places)]
    np.testing.assert_allclose(positions, np.reshape(expected, (-1, 3)), rtol=0, atol=1e-9)
    assert anchors.sum() == sum(len(line.anchors) for line in literal)


def test_points_stand_at_equal_steps_of_the_integral_of_13() -> None:
    """On the face of a cube: in closed form."""
    length, fade = 0.1, FADING * SPACING
    positions, amplitudes, anchors = place(*line([length], [FULL, FULL]))
    gain, end = SPACING / CLOSEST - 1, math.exp(-length / fade)
    highest = 1 + end

    def integral(t: Any) -> Any:
        rise = fade * (1 - np.exp(-t / fade) + np.exp((t - length) / fade) - end) / highest
        return (t + gain * rise) / SPACING

    steps = np.diff(integral(positions[:, 0]))
    assert len(steps) == round(integral(length)) == 8
    np.testing.assert_allclose(steps, integral(length) / 8, rtol=1e-12)
    assert anchors.tolist() == [1, 0, 0, 0, 0, 0, 0, 0, 1]
    kappa = (np.exp(-positions[:, 0] / fade) + np.exp((positions[:, 0] - length) / fade)) / highest
    np.testing.assert_allclose(amplitudes**2, 1 + kappa, rtol=1e-12)
    assert amplitudes[[0, -1]] == pytest.approx(math.sqrt(2))
    assert amplitudes[4] < 1.002
    gaps = np.diff(positions[:, 0])
    assert gaps[0] < 0.6 * gaps[3]
    assert gaps[3] == pytest.approx(SPACING, rel=0.05)


@pytest.mark.parametrize(
    ("length", "expected"),
    [(0.0029, 0), (0.0031, 1), (0.0149, 1), (0.0224, 1), (0.0226, 2), (0.15, 10), (0.157, 10), (0.158, 11)],
)
def test_an_open_arc_has_a_point_for_each_spacing(length: float, expected: int) -> None:
    positions, amplitudes, _ = place(*line([length], [0.0, 0.0]))
    np.testing.assert_allclose(positions[:, 0], length * (np.arange(expected) + 0.5) / expected, atol=1e-12)
    assert (amplitudes == 1).all()


@given(st.lists(st.floats(1e-4, 0.05), min_size=1, max_size=12), st.integers(0, 2**32 - 1))
@example([0.00390625, 0.00390625], 32104332)  # ever sharper crossings, the last with room for the first
@settings(max_examples=200, deadline=None)
def test_points_of_a_stretch_do_not_crowd(lengths: list[float], seed: int) -> None:
    """The mean distance between anchors that are kept and the points between them."""
    curvature = np.random.default_rng(seed).choice([0, 0.1, 0.6, FULL, 3.0], len(lengths) + 1)
    arcs, values = line(lengths, curvature.tolist())
    positions, amplitudes, anchors = place(arcs, values)
    assert (len(positions) > 0) == (sum(lengths) >= SLIGHT)
    assert ((amplitudes >= 1) & (amplitudes <= math.sqrt(2) + 1e-12)).all()
    at = np.flatnonzero(anchors)
    x = positions[:, 0]
    assert (np.diff(x) > 0).all()
    for i, j in itertools.pairwise(at):
        assert (x[j] - x[i]) / (j - i) >= CLOSEST - 1e-12
    places = arcs.vertices[:, 0]
    ends = np.arange(len(places)) % (len(places) - 1) == 0
    inside = np.where(ends, np.inf, np.minimum(places, places[-1] - places)) - SLIGHT
    sharp = values >= math.pi / 6
    for crossing in places[sharp & (inside > 1e-12)][: len(places) * (len(x) > 0)]:
        assert np.abs(crossing - x[at]).min() < CLOSEST
    assert np.isin(x[at], places[sharp & (inside > -1e-12)]).all()


@pytest.mark.parametrize("shape", SHAPES)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_the_triangulation_does_not_matter(shape: str, seed: int) -> None:
    mesh = getattr(Mesh, shape)()
    quads = random_quads(np.random.default_rng(seed))
    found = []
    for version in (mesh, divided(mesh, 1), divided(mesh, 2)):
        arcs = cut(quads, version)
        positions, amplitudes, _ = place(arcs, curvature_on(arcs, version))
        order = np.lexsort(np.round(positions, 7).T)
        found.append((positions[order], amplitudes[order]))
    for positions, amplitudes in found[1:]:
        np.testing.assert_allclose(positions, found[0][0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(amplitudes, found[0][1], rtol=0, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), most=st.integers(1, 60))
@settings(max_examples=60, deadline=None)
def test_a_cap_keeps_corners_and_thins_the_rest_alike(seed: int, most: int) -> None:
    mesh = Mesh.cube()
    arcs = cut(random_quads(np.random.default_rng(seed), 3), mesh)
    curvature = curvature_on(arcs, mesh)
    whole, _, all_anchors = place(arcs, curvature)
    positions, _, anchors = place(arcs, curvature, most=most)
    assert len(positions) <= min(most, len(whole))
    if len(whole) <= most:
        np.testing.assert_array_equal(positions, whole)
    corners, kept = whole[all_anchors == 1], positions[anchors == 1]
    assert len(kept) == min(len(corners), most)
    assert all((kept == corner).all(axis=1).any() for corner in corners) or len(corners) > most


def test_thinning_lowers_the_density_of_all_stretches_by_the_same_share() -> None:
    """Three lines of 30, 60 and 120 cm with half of the points that they would have."""
    parts = [line([length], [0.0, 0.0])[0] for length in (0.3, 0.6, 1.2)]
    vertices = np.concatenate([part.vertices + np.array([0, y, 0]) for y, part in enumerate(parts)])
    rows = np.array([(0, 0, 0), (2, 0, 0), (4, 0, 0), (6, -1, -1)])
    arcs = Arcs(vertices, np.zeros(6), np.tile(np.array([0, 0, -1]), (6, 1)), rows)
    positions, _, _ = place(arcs, np.zeros(6), most=70)
    assert [int((positions[:, 1] == y).sum()) for y in range(3)] == [10, 20, 40]


def test_arcs_without_length_and_no_arcs_at_all() -> None:
    assert len(place(*line([0.0], [0.0, 0.0]))[0]) == 0
    assert len(place(*line([0.0, 0.0], [FULL, FULL, FULL]))[0]) == 0
    assert len(place(Arcs.joined(()), np.empty(0))[0]) == 0
