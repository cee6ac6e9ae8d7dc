"""The six shapes of the paper's Figure 10, each as large as fits a cube of side 1 around the origin.

They are scaled equally on all axes. The prisms are triangular, with an equilateral triangle: the horizontal one lies on
a side face with its ridge along x, the vertical one stands on a triangle, one side of which faces -y. Curved surfaces
are cut so finely that at 10 cm their radius is met to 0.07 mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .edges import edge_tables

__all__ = ["SOLIDS"]

Triangles: TypeAlias = tuple[NDArray[np.float64], NDArray[np.int64]]

RIM = 64
"""Corners of the cone's base."""
HALVINGS = 4
"""How often the edges of an icosahedron are halved to make the sphere."""


def _extruded(outline: NDArray[np.float64]) -> Triangles:
    """A prism of height 1 over (k, 2) corners of a convex outline, counterclockwise from above."""
    count = len(outline)
    vertices = np.concatenate([np.insert(outline, 2, height, axis=1) for height in (-0.5, 0.5)])
    this, after = np.arange(count), np.roll(np.arange(count), -1)
    sides = [np.stack([this, after, after + count], axis=1), np.stack([this, after + count, this + count], axis=1)]
    fan = np.stack([np.zeros(count - 2, dtype=np.int64), this[1:-1], this[2:]], axis=1)
    return vertices, np.concatenate([*sides, fan[:, ::-1], fan + count])


def _spire(outline: NDArray[np.float64]) -> Triangles:
    """A pyramid of height 1 over (k, 2) corners of a convex outline around the origin, counterclockwise from above."""
    count = len(outline)
    vertices = np.concatenate([np.insert(outline, 2, -0.5, axis=1), [[0, 0, 0.5], [0, 0, -0.5]]])
    this, after = np.arange(count), np.roll(np.arange(count), -1)
    sides = np.stack([this, after, np.full(count, count)], axis=1)
    base = np.stack([after, this, np.full(count, count + 1)], axis=1)
    return vertices, np.concatenate([sides, base])


def _square() -> NDArray[np.float64]:
    return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def _triangle() -> NDArray[np.float64]:
    """An equilateral triangle of side 1, its bounding box around the origin."""
    height = math.sqrt(0.75)
    return np.array([[-0.5, -height / 2], [0.5, -height / 2], [0, height / 2]])


def _cube() -> Triangles:
    return _extruded(_square())


def _pyramid() -> Triangles:
    return _spire(_square())


def _cone() -> Triangles:
    angle = 2 * np.pi * np.arange(RIM) / RIM
    return _spire(np.stack([np.cos(angle), np.sin(angle)], axis=1) / 2)


def _vertical_prism() -> Triangles:
    return _extruded(_triangle())


def _horizontal_prism() -> Triangles:
    vertices, faces = _vertical_prism()
    return vertices[:, [2, 0, 1]], faces  # rotated so that its axis z becomes x


def _sphere() -> Triangles:
    golden = (1 + math.sqrt(5)) / 2
    corners = [(0, a, b * golden) for a in (-1, 1) for b in (-1, 1)]
    vertices = np.concatenate([np.roll(corners, shift, axis=1) for shift in range(3)])
    # The faces of an icosahedron are the triples of neighbours, which are 2 apart.
    near = np.isclose(np.linalg.norm(vertices[:, None] - vertices, axis=2), 2)
    triples = [
        (a, b, c)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    outward = np.linalg.det(vertices[np.array(triples)]) > 0
    faces = np.where(outward[:, None], triples, np.array(triples)[:, ::-1])
    for _ in range(HALVINGS):
        edges, face_edges, _ = edge_tables(faces, len(vertices))
        (a, b, c), (ab, bc, ca) = faces.T, face_edges.T + len(vertices)
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
        corners_and_middle = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(quarter, axis=1) for quarter in corners_and_middle])
    return vertices / 2, faces


SOLIDS: dict[str, Callable[[], Triangles]] = {
    "cone": _cone,
    "sphere": _sphere,
    "pyramid": _pyramid,
    "horizontal_prism": _horizontal_prism,
    "vertical_prism": _vertical_prism,
    "cube": _cube,
}
"""Vertices and faces by name, in the paper's order."""
