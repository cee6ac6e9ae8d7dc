"""Objects: triangle meshes, where they are, and what of them is prepared once for all cuts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import as_points, frozen

__all__ = ["Mesh", "Solid"]


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh in its own coordinates, shared by all meshes that are moved or rotated copies of it.

    Parameters
    ----------
    vertices : (v, 3) float
        In metres.
    faces : (f, 3) int
        Vertices of each triangle, counterclockwise as seen from outside.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """An object that can be felt: a `Solid` and where it is.

    Parameters
    ----------
    solid : Solid
        The triangles.
    rotation : (3, 3) float
        Turns the solid's coordinates into the array's.
    offset : (3,) float
        Is added after that, in metres.
    """

    solid: Solid
    rotation: NDArray[np.float64]
    offset: NDArray[np.float64]

    @classmethod
    def of(cls, vertices: ArrayLike, faces: ArrayLike) -> Self:
        """A mesh of triangles whose vertices are given in the array's coordinates."""
        solid = Solid(frozen(as_points(vertices, "vertex")), frozen(np.array(faces, dtype=np.int64)))
        return cls(solid, frozen(np.eye(3)), frozen(np.zeros(3)))

    @cached_property
    def vertices(self) -> NDArray[np.float64]:
        """(v, 3) vertices in metres, in the array's coordinates."""
        return frozen(self.solid.vertices @ self.rotation.T + self.offset)

    @property
    def faces(self) -> NDArray[np.int64]:
        """(f, 3) vertices of each triangle."""
        return self.solid.faces

    def moved(self, offset: ArrayLike) -> Self:
        """The same object, moved by (3,) metres."""
        return type(self)(self.solid, self.rotation, frozen(self.offset + np.asarray(offset, dtype=np.float64)))

    def rotated(self, degrees: float, axis: ArrayLike = (0, 0, 1)) -> Self:
        """The same object, turned about an axis through the centre of its bounding box, counterclockwise."""
        unit = np.asarray(axis, dtype=np.float64) / np.linalg.norm(np.asarray(axis, dtype=np.float64))
        x, y, z = unit
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = math.radians(degrees)
        turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        centre = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        return type(self)(self.solid, frozen(turn @ self.rotation), frozen(turn @ (self.offset - centre) + centre))

    @classmethod
    def cube(cls, size: float = 0.1, centre: ArrayLike = (0, 0, 0.17)) -> Self:
        """The paper's cube."""
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
        return cls.of(corners + np.asarray(centre), faces)
