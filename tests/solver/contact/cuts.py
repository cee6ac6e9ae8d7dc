"""Meshes, quadrilaterals and measures that the tests of cuts share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from phasewire.solver.contact.arcs import Arcs
from phasewire.solver.contact.mesh import Mesh

Floats = NDArray[np.float64]

BIG = np.array([[[-1, -1, 0.17], [1, -1, 0.17], [1, 1, 0.17], [-1, 1, 0.17]]])
"""One quadrilateral through the middle of the paper's objects."""


def parallelogram(corner: ArrayLike, along: ArrayLike, across: ArrayLike) -> Floats:
    """(4, 3) corners."""
    a, u, v = (np.asarray(value, dtype=np.float64) for value in (corner, along, across))
    return np.array([a, a + u, a + u + v, a + v])


def lengths(arcs: Arcs) -> Floats:
    """Length of each arc in metres."""
    return np.array([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in arcs.polylines()])


def in_trimesh(mesh: Mesh) -> Any:
    """The mesh as trimesh sees it, unchanged."""
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def ball(subdivisions: int, radius: float = 0.05) -> Mesh:
    """An icosphere about the origin."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Mesh.of(made.vertices, made.faces)


def blob(rng: np.random.Generator) -> Mesh:
    """A closed mesh of a few hundred faces, about 10 cm large, dented and posed at random."""
    made = trimesh.creation.icosphere(subdivisions=int(rng.integers(0, 3)), radius=0.05)
    mesh = Mesh.of(made.vertices * rng.uniform(0.5, 1, (len(made.vertices), 1)), made.faces)
    return mesh.rotated(rng.uniform(0, 360), rng.normal(size=3)).moved(rng.uniform(-0.03, 0.03, 3))


def hand(rng: np.random.Generator) -> Floats:
    """(16, 4, 3) quadrilaterals of a palm and five bent fingers, which share borders, near the origin."""
    made = [parallelogram([-0.04, -0.09, 0], [0.08, 0, 0], [0, 0.09, 0])]
    for finger in range(5):
        left, right = np.array([-0.04 + 0.016 * finger, 0, 0]), np.array([-0.026 + 0.016 * finger, 0, 0])
        angle = 0.0
        for _ in range(3):
            angle += rng.choice([0.0, rng.uniform(-0.8, 0.3)])
            way = 0.025 * np.array([0, np.cos(angle), np.sin(angle)])
            made.append(np.array([left, right, right + way, left + way]))
            left, right = left + way, right + way
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    moved: Floats = np.array(made) @ turn + rng.uniform(-0.04, 0.04, 3)
    return moved


def lattice_case(rng: np.random.Generator) -> tuple[Floats, list[Mesh]]:
    """Quadrilaterals and triangles with corners on a coarse lattice: everything that can coincide does.

    All that decides is exact in floating point. Some triangles have no area, some occur twice, turned around or not.
    """
    vertices = rng.integers(-2, 3, (int(rng.integers(4, 12)), 3)) / 16
    faces: list[Sequence[int]] = [rng.permutation(len(vertices))[:3].tolist() for _ in range(rng.integers(1, 6))]
    for _ in range(rng.integers(4)):
        a, b, c, d = rng.integers(len(vertices), size=4).tolist()  # a tetrahedron, if they differ
        faces += [(a, b, c), (a, c, d), (a, d, b), (b, d, c)]
    faces += [rng.permutation(faces[i]).tolist() for i in rng.integers(len(faces), size=3)]
    mesh = Mesh.of(vertices, np.array(faces))
    quads = [parallelogram(*rng.integers(-2, 3, (3, 3)) * [[1], [2], [2]]) / 16 for _ in range(6)]
    return np.array(quads), [mesh, mesh.moved(rng.integers(-1, 2, 3) / 16)]
