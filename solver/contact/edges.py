"""Edges of triangle meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry import frozen

__all__ = ["edge_tables"]

Indices = NDArray[np.int64]


def edge_tables(faces: Indices, vertices: int) -> tuple[Indices, Indices, Indices]:
    """The edges of (f, 3) faces over a number of vertices, and which face has which.

    Returns the edges (e, 2), sorted, each once, with the smaller vertex first; the edges of each face, (f, 3), from its
    first vertex to its second, from its second to its third, and back; and the faces at each edge, (e, 2), -1 if there
    is no second one, the first and the last if there are more.
    """
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    keys = ends.min(axis=1) * vertices + ends.max(axis=1)
    order = np.argsort(keys, kind="stable")
    begins = np.flatnonzero(np.diff(keys[order], prepend=-1))  # of each edge's run in the order
    uses = np.diff(begins, append=len(keys))
    face_edges = np.empty(len(keys), dtype=np.int64)
    face_edges[order] = np.repeat(np.arange(len(begins)), uses)
    edges = np.stack(np.divmod(keys[order[begins]], vertices), axis=1)
    second = np.where(uses > 1, order[begins + uses - 1] // 3, -1)
    edge_faces = np.stack([order[begins] // 3, second], axis=1)
    return frozen(edges), frozen(face_edges.reshape(-1, 3)), frozen(edge_faces)
