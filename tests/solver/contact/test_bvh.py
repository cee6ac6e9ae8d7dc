from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from phasewire.solver.contact.bvh import DEEPEST, LEAF, Bvh, build

from .cuts import Floats


def overlap(bvh: Bvh, low: Floats, high: Floats) -> list[int]:
    """Faces in the leaves that a box meets."""
    node, found = 0, list[int]()
    while node < len(bvh.boxes):
        after, first = bvh.links[node].tolist()
        if (bvh.boxes[node, :3] > high).any() or (bvh.boxes[node, 3:] < low).any():
            node = after
            continue
        node += 1
        if after == node:
            found += bvh.faces[first : bvh.links[after, 1]].tolist()
    return found


def leaves(bvh: Bvh) -> np.ndarray:
    """Faces in each leaf, 0 in other nodes."""
    after, first = bvh.links.T
    return np.where(after[:-1] == np.arange(1, len(after)), np.diff(first), 0)


def soup(rng: np.random.Generator) -> tuple[Floats, np.ndarray]:
    """Triangles anywhere, small or large, some of them in one place."""
    count = int(rng.integers(1, 400))
    size, spread = 10.0 ** rng.uniform(-4, 0, 2) * [1, rng.integers(2)]
    vertices = rng.normal(size=(count, 1, 3)) * spread + rng.normal(size=(count, 3, 3)) * size
    return vertices.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


@given(st.integers(0, 2**32 - 1))
def test_it_finds_what_brute_force_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, faces = soup(rng)
    bvh = build(vertices, faces)
    lowest, highest = vertices[faces].min(axis=1), vertices[faces].max(axis=1)
    for _ in range(10):
        low, high = np.sort(rng.normal(size=(2, 3)) * np.abs(vertices).max(), axis=0)
        found = overlap(bvh, low, high)
        assert len(set(found)) == len(found)
        assert set(np.flatnonzero(((lowest <= high) & (highest >= low)).all(axis=1))) <= set(found)
    assert sorted(bvh.faces.tolist()) == list(range(len(faces)))
    assert leaves(bvh).max() <= LEAF
    assert leaves(bvh).sum() == len(faces)


def test_it_tries_few_faces_of_a_large_mesh() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    bvh = build(ball.vertices, ball.faces)
    low, high = np.array([0.02, 0.02, 0.0]), np.array([0.03, 0.03, 0.1])
    lowest, highest = ball.vertices[ball.faces].min(axis=1), ball.vertices[ball.faces].max(axis=1)
    needed = ((lowest <= high) & (highest >= low)).all(axis=1).sum()
    assert 0 < needed <= len(overlap(bvh, low, high)) < 1.5 * needed + 10


@pytest.mark.parametrize("ratio", [1.0, 0.5, 1e-3])
def test_no_mesh_makes_the_tree_degenerate(ratio: float) -> None:
    """Triangles in one place, or each next to the next at a fraction of the way to the origin."""
    count = 20_000
    places = ratio ** np.arange(count, dtype=np.float64) * 1000
    vertices = (places[:, None, None] * [1, 1, 1] + places[:, None, None] * np.eye(3) / 1e3).reshape(-1, 3)
    bvh = build(vertices, np.arange(3 * count).reshape(-1, 3))
    depth = np.zeros(len(bvh.boxes), dtype=np.int64)
    for node in np.flatnonzero(leaves(bvh) == 0):
        depth[node + 1] = depth[bvh.links[node + 1, 0]] = depth[node] + 1
    assert depth.max() <= DEEPEST + np.ceil(np.log2(count))
    assert leaves(bvh).sum() == count


def test_a_face_that_occurs_twice_or_has_no_three_vertices_is_left_out() -> None:
    faces = np.array([(1, 1, 2), (0, 1, 2), (2, 1, 0), (0, 1, 3), (1, 2, 0), (3, 3, 3)])
    vertices = np.eye(4, 3)
    assert build(vertices, faces).faces.tolist() == [1, 3]
    empty = build(vertices, faces[[0, 5]])
    assert len(empty.boxes) == 0
    assert overlap(empty, np.full(3, -1.0), np.ones(3)) == []
