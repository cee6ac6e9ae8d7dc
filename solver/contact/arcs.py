"""Arcs: the contiguous lines along which hands meet objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Arcs"]


@dataclass(frozen=True, eq=False)
class Arcs:
    """Contiguous polylines, all in one set of arrays, with what they are made of.

    Parameters
    ----------
    vertices : (k, 3) float
        Vertices of all arcs, one arc after the other, in metres, in the array's coordinates. A closed arc repeats its
        first vertex at its end.
    starts : (a + 1,) int
        Arc i has the vertices from ``starts[i]`` to before ``starts[i + 1]``.
    closed : (a,) bool
        Which arcs are closed.
    objects : (a,) int
        The object that each arc lies on.
    faces : (k,) int
        The mesh face of the piece that begins at each vertex; -1 at the last vertex of an arc.
    quads : (k,) int
        The quadrilateral of the piece that begins at each vertex, hand · 16 + quad; -1 at the last vertex of an arc.
    edges : (k,) int
        The mesh edge that each vertex lies on, -1 where the vertex is an end that a quadrilateral's border cuts off
        inside a face.
    along : (k,) float
        The place of each vertex on its mesh edge, from 0 at the edge's first mesh vertex to 1 at its second; 0 where
        there is no edge.
    """

    vertices: NDArray[np.float64]
    starts: NDArray[np.int64]
    closed: NDArray[np.bool_]
    objects: NDArray[np.int64]
    faces: NDArray[np.int64]
    quads: NDArray[np.int64]
    edges: NDArray[np.int64]
    along: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.closed)

    def polylines(self) -> list[NDArray[np.float64]]:
        """The vertices of each arc, (k, 3)."""
        return [self.vertices[start:stop] for start, stop in zip(self.starts[:-1], self.starts[1:], strict=True)]
