"""Arcs: the contiguous lines along which hands meet objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

__all__ = ["KNUCKLE", "SAME", "Arcs"]

KNUCKLE = 15e-3
"""Distance in metres within which an arc of the palm goes on at a finger's base. The palm's far border is straight and
the knuckles are not: of a large hand, the middle finger begins 12 mm beyond that border."""
SAME = 1e-9
"""Distance in metres within which the ends of two joined arcs are one vertex."""


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

    Notes
    -----
    The piece that bridges a knuckle has the face and the quadrilateral of the piece before it. Neighbours may coincide:
    a cut through a vertex of the mesh crosses several edges there, and each of them is named.
    """

    vertices: NDArray[np.float64]
    starts: NDArray[np.int64]
    closed: NDArray[np.bool_]
    objects: NDArray[np.int64]
    faces: NDArray[np.int64]
    quads: NDArray[np.int64]
    edges: NDArray[np.int64]
    along: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: Sequence[tuple[NDArray[Any], ...]]) -> Self:
        """The arcs of objects 0, 1, …: of each vertices, starts, closed, faces, quads, edges and along, as above."""
        if len(parts) == 1:
            vertices, starts, closed, *rest = parts[0]
            return cls(vertices, starts, closed, np.zeros(len(closed), np.int64), *rest)
        if not parts:
            none = np.empty(0, np.int64)
            return cls(np.empty((0, 3)), np.zeros(1, np.int64), none.astype(np.bool_), none, none, none, none, none / 1)
        vertices, starts, closed, *rest = zip(*parts, strict=True)
        before = np.cumsum([0, *(len(part) for part in vertices)])
        return cls(
            np.concatenate(vertices),
            np.concatenate([*(part[:-1] + shift for part, shift in zip(starts, before, strict=False)), before[-1:]]),
            np.concatenate(closed),
            np.repeat(np.arange(len(parts)), [len(part) for part in closed]),
            *(np.concatenate(part) for part in rest),
        )

    def __len__(self) -> int:
        return len(self.closed)

    def polylines(self) -> list[NDArray[np.float64]]:
        """The vertices of each arc, (k, 3)."""
        return [self.vertices[start:stop] for start, stop in zip(self.starts[:-1], self.starts[1:], strict=True)]
