"""Scenes: the tables of all solids that are cut in one frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..geometry import Scalar, frozen
from .mesh import Mesh
from .tables import SolidTables

__all__ = ["Scene", "poses"]


class Scene(NamedTuple):
    """The solids of some objects.

    Parameters
    ----------
    boxes, links, corners, names
        `SolidTables` of all solids.
    curvature : (e, 2) float
        Curvature of their edges, as `Solid.edge_curvature`; no rows if corners are not to be felt.
    begins : (s + 1, 3) int
        The first node, face and edge of each solid among those of all, and their ends.
    which : (o,) int
        The solid of each object.
    """

    boxes: NDArray[np.float32]
    links: NDArray[np.int32]
    corners: NDArray[np.float64]
    names: NDArray[np.int32]
    curvature: NDArray[np.float64]
    begins: NDArray[np.int64]
    which: NDArray[np.int64]

    @classmethod
    def of(cls, meshes: Sequence[Mesh], corners: bool) -> Self:
        """Of some objects; a solid that several of them have is there once."""
        solids = list(dict.fromkeys(mesh.solid for mesh in meshes))
        tables = [solid.tables for solid in solids]
        curvature = [solid.edge_curvature if corners else _FLAT for solid in solids]
        sizes = [(len(of.boxes), len(of.names), len(values)) for of, values in zip(tables, curvature, strict=True)]
        boxes, links, corners_of, names = zip(*(tables or [_NOTHING]), strict=True)
        return cls(
            _joined(boxes),
            _joined(links),
            _joined(corners_of),
            _joined(names),
            _joined(curvature or [_FLAT]),
            frozen(np.cumsum([(0, 0, 0), *sizes], axis=0)),
            frozen(np.array([solids.index(mesh.solid) for mesh in meshes], dtype=np.int64)),
        )


def poses(meshes: Sequence[Mesh]) -> NDArray[np.float64]:
    """(o, 4, 3) of each object the three rows of its rotation, and its offset in metres."""
    return frozen(np.array([(*mesh.rotation, mesh.offset) for mesh in meshes]).reshape(-1, 4, 3))


def _joined(parts: Sequence[NDArray[Scalar]]) -> NDArray[Scalar]:
    return parts[0] if len(parts) == 1 else frozen(np.concatenate(parts))


_NOTHING = SolidTables(
    frozen(np.empty((0, 6), np.float32)),
    frozen(np.empty((0, 2), np.int32)),
    frozen(np.empty((0, 9))),
    frozen(np.empty((0, 7), np.int32)),
)
_FLAT = frozen(np.empty((0, 2)))
