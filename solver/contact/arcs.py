"""Arcs: the contiguous lines along which hands meet objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

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
        Vertices of all arcs in metres, one arc after the other. A closed arc repeats its first vertex at its end.
    along : (k,) float
        Place of each vertex on its mesh edge, from 0 at the edge's first mesh vertex to 1 at its second; 0 if it is on
        no edge.
    names : (k, 3) int
        What `faces`, `quads` and `edges` say of each vertex.
    rows : (a + 1, 3) int
        First vertex of each arc, and what `closed` and `objects` say; then the number of vertices, -1 and -1.

    Notes
    -----
    The piece that bridges a knuckle is a straight line that lies neither on the object nor in the hand, and has no
    control points. It has no face, and the quadrilateral of the piece before it. Neighbours may coincide: a cut through
    a vertex of the mesh crosses several edges there, and each of them is named.
    """

    vertices: NDArray[np.float64]
    along: NDArray[np.float64]
    names: NDArray[np.int64]
    rows: NDArray[np.int64]

    def __repr__(self) -> str:
        return f"Arcs({len(self)} arcs, {len(self.vertices)} vertices)"

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The arcs of several objects, which become objects 0, 1 and so on."""
        before = np.cumsum([0, *(len(part.vertices) for part in parts)])
        rows = [part.rows[:-1] * [1, 1, 0] + [before[i], 0, i] for i, part in enumerate(parts)]
        return cls(
            np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)]),
            np.concatenate([np.empty(0), *(part.along for part in parts)]),
            np.concatenate([np.empty((0, 3), np.int64), *(part.names for part in parts)]),
            np.concatenate([*rows, [[before[-1], -1, -1]]]),
        )

    def __len__(self) -> int:
        return len(self.rows) - 1

    @property
    def starts(self) -> NDArray[np.int64]:
        """(a + 1,) arc i has the vertices ``starts[i]`` to ``starts[i + 1] - 1``."""
        return self.rows[:, 0]

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(a,) which arcs are closed."""
        return np.asarray(self.rows[:-1, 1] == 1)

    @property
    def objects(self) -> NDArray[np.int64]:
        """(a,) the object that each arc lies on."""
        return self.rows[:-1, 2]

    @property
    def faces(self) -> NDArray[np.int64]:
        """(k,) the mesh face of the piece that begins at each vertex; -1 for a bridge, and at an arc's last vertex."""
        return self.names[:, 0]

    @property
    def quads(self) -> NDArray[np.int64]:
        """(k,) the quadrilateral of that piece, hand · 16 + quad; -1 at the last vertex of an arc."""
        return self.names[:, 1]

    @property
    def edges(self) -> NDArray[np.int64]:
        """(k,) the mesh edge that each vertex lies on; -1 if a quadrilateral's border ends it inside a face."""
        return self.names[:, 2]

    def polylines(self) -> list[NDArray[np.float64]]:
        """The vertices of each arc, (k, 3)."""
        return [self.vertices[start:stop] for start, stop in zip(self.starts[:-1], self.starts[1:], strict=True)]
