"""Tables of a solid: what cuts read, in the order in which they read it.

Memory bounds the speed at which large meshes are cut. So the corners of a tree's faces lie one after the other, leaf
after leaf, and the boxes of its nodes have 32 bits, rounded outwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..geometry import frozen

if TYPE_CHECKING:
    from .bvh import Bvh  # imports numba

__all__ = ["SolidTables"]


class SolidTables(NamedTuple):
    """What cuts need of a solid; or of several, one after the other, each counted from 0.

    Parameters
    ----------
    boxes : (n, 6) float32
        Boxes of the tree's nodes: the middle, and half of the extent, in metres.
    links : (n + 1, 2) int32
        Links as in `Bvh.links`; each solid has one row more than nodes.
    corners : (f, 9) float
        Faces of the tree, leaf after leaf: the first vertex, the second, the third, in metres.
    names : (f, 7) int32
        Numbers of the same faces, of their vertices, and of their edges.
    """

    boxes: NDArray[np.float32]
    links: NDArray[np.int32]
    corners: NDArray[np.float64]
    names: NDArray[np.int32]

    @classmethod
    def of(
        cls, bvh: Bvh, vertices: NDArray[np.float64], faces: NDArray[np.int64], face_edges: NDArray[np.int64]
    ) -> Self:
        """The tables of one `Solid`, in the order of its tree."""
        boxes, links, order = bvh
        low, high = boxes[:, :3], boxes[:, 3:]
        middle = ((low + high) / 2).astype(np.float32)
        half = np.maximum(high - middle, middle - low).astype(np.float32)
        of_leaves = faces[order]
        return cls(
            frozen(np.concatenate([middle, np.nextafter(half, np.float32(np.inf))], axis=1)),
            links,
            frozen(vertices[of_leaves].reshape(-1, 9)),
            frozen(np.concatenate([order[:, None], of_leaves, face_edges[order]], axis=1).astype(np.int32)),
        )
