"""Objects: triangle meshes, their poses, and the tables that are prepared once for all cuts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, flag, length
from ..geometry import as_points, as_position, as_scale, extent, frozen, place, rotation_matrix
from .curvature import edge_curvature
from .edges import edge_tables
from .repair import repair
from .solids import SOLIDS
from .tables import SolidTables

if TYPE_CHECKING:
    from .bvh import Bvh

__all__ = ["MOST_FACES", "Mesh", "Solid"]

MOST_FACES = 1_000_000
"""Faces that a mesh may have. A tree over them takes seconds and hundreds of megabytes."""
SIZE = 0.1
"""Side in metres of the cube that the paper's shapes fit (Figure 10)."""
CENTRE = (0.0, 0.0, 0.17)
"""Centre of the paper's shapes in metres: 17 cm above the array's middle."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh in its own coordinates, shared by all meshes that are moved or rotated copies of it.

    Parameters
    ----------
    vertices : (v, 3) float
        Vertices in metres.
    faces : (f, 3) int
        Vertices of each triangle, counterclockwise as seen from outside; f from 1 to `MOST_FACES`.
    repairs : tuple of str
        What was repaired (`Mesh.repaired`), for people to read.

    Raises
    ------
    ValueError
        If a coordinate is not finite or too large, there is no face or too many, or a face names a vertex that does not
        exist.

    Notes
    -----
    Triangles without area, duplicate triangles and open surfaces are possible; `Mesh.repaired` removes them or refuses.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    repairs: tuple[str, ...]

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, repairs: tuple[str, ...] = ()) -> None:
        points = as_points(vertices, "vertex", "vertices")
        object.__setattr__(self, "vertices", frozen(points))
        object.__setattr__(self, "faces", frozen(_as_faces(faces, len(points))))
        object.__setattr__(self, "repairs", repairs)

    def __repr__(self) -> str:
        return f"Solid({len(self.faces)} faces, {extent(self.vertices)})"

    @cached_property
    def centre(self) -> NDArray[np.float64]:
        """(3,) centre of the bounding box in metres, in the solid's coordinates."""
        return frozen((self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2)

    @property
    def edges(self) -> NDArray[np.int64]:
        """(e, 2) edges, the vertex with the smaller number first, sorted, each once."""
        return self._edges[0]

    @property
    def face_edges(self) -> NDArray[np.int64]:
        """(f, 3) edges of each face: from its first vertex to its second, from its second to its third, and back."""
        return self._edges[1]

    @property
    def edge_faces(self) -> NDArray[np.int64]:
        """(e, 2) faces at each edge; -1 if there is no second one, the first and the last if there are more."""
        return self._edges[2]

    @cached_property
    def bvh(self) -> Bvh:
        """The tree by which cuts find faces."""
        from .bvh import build  # imports numba

        return build(self.vertices, self.faces)

    @cached_property
    def tables(self) -> SolidTables:
        """The triangles as cuts read them."""
        return SolidTables.of(self.bvh, self.vertices, self.faces, self.face_edges)

    @cached_property
    def edge_curvature(self) -> NDArray[np.float64]:
        """(e, 2) curvature in radians at both ends of each edge: see `curvature.edge_curvature`."""
        return edge_curvature(self.vertices, self.faces, self.edges, self.edge_faces)

    @cached_property
    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        return edge_tables(self.faces, len(self.vertices))


def _as_faces(values: ArrayLike, vertices: int) -> NDArray[np.int64]:
    try:
        given = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"faces must be (f, 3) whole numbers: {error}") from error
    if given.ndim != 2 or given.shape[1] != 3 or not len(given):
        raise ValueError(f"faces must have the shape (f, 3) with f of at least 1, not {given.shape}")
    if given.dtype.kind not in "iu":
        raise ValueError(f"faces must be whole numbers, the vertices of each triangle, not {given.dtype}")
    if len(given) > MOST_FACES:
        raise ValueError(f"a mesh of {len(given)} faces is too large; at most {MOST_FACES} are possible: simplify it")
    if (bad := np.flatnonzero(((given < 0) | (given >= vertices)).any(axis=1))).size:
        raise ValueError(f"face {bad[0]} is {given[bad[0]].tolist()}; there are vertices 0 to {vertices - 1}")
    return np.array(given, dtype=np.int64, order="C")


@dataclass(frozen=True, eq=False)
class Mesh:
    """An object that can be felt: a `Solid` and its pose.

    `Mesh.of` makes one from triangles; `Mesh.cube` and its sisters are the paper's. Files are read one floor above, by
    `objects.mesh_files.read_mesh` and `objects.volumes.read_volume_mesh`.

    Parameters
    ----------
    solid : Solid
        The triangles.
    rotation : (3, 3) float
        Turns the solid's coordinates into the array's.
    offset : (3,) float
        Offset in metres, added after the rotation.

    Raises
    ------
    ValueError
        If the matrix is not a rotation, or the offset is not finite or too large.
    """

    solid: Solid
    rotation: NDArray[np.float64]
    offset: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the pose."""
        rotation, offset = array_of("rotation", self.rotation, np.float64), as_position(self.offset, "offset")
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=1e-9):
            raise ValueError(f"{rotation.tolist()} is no rotation: its rows must be perpendicular unit vectors")
        if np.linalg.det(rotation) < 0:
            raise ValueError(f"{rotation.tolist()} is no rotation but a reflection, which turns the object inside out")
        object.__setattr__(self, "rotation", frozen(rotation))
        object.__setattr__(self, "offset", frozen(offset))

    def __repr__(self) -> str:
        return f"Mesh({len(self.faces)} faces, {extent(self.vertices)} about {place(self.centre)})"

    @classmethod
    def of(cls, vertices: ArrayLike, faces: ArrayLike) -> Self:
        """A mesh of triangles whose vertices are given in the array's coordinates; parameters and errors as `Solid`."""
        return cls(Solid(vertices, faces), np.eye(3), np.zeros(3))

    @cached_property
    def vertices(self) -> NDArray[np.float64]:
        """(v, 3) vertices in metres, in the array's coordinates."""
        return frozen(self.solid.vertices @ self.rotation.T + self.offset)

    @property
    def faces(self) -> NDArray[np.int64]:
        """(f, 3) vertices of each triangle."""
        return self.solid.faces

    @property
    def repairs(self) -> tuple[str, ...]:
        """What was repaired or looks wrong, a clause each, such as "2 duplicate faces removed"; empty if nothing."""
        return self.solid.repairs

    @property
    def centre(self) -> NDArray[np.float64]:
        """(3,) centre of the solid's bounding box in metres, in the array's coordinates."""
        return self.rotation @ self.solid.centre + self.offset

    def moved(self, offset: ArrayLike) -> Self:
        """The same object, moved by (3,) metres."""
        return type(self)(self.solid, self.rotation, self.offset + as_position(offset, "offset"))

    def rotated(self, degrees: float, axis: ArrayLike = (0, 0, 1)) -> Self:
        """The same object, turned about an axis through its `centre`, counterclockwise as seen from the axis' tip.

        Raises
        ------
        ValueError
            If the angle is not finite, or the axis has no direction.
        """
        turn = rotation_matrix(degrees, axis)
        return type(self)(self.solid, turn @ self.rotation, self.centre - turn @ (self.centre - self.offset))

    def scaled(self, factor: float) -> Self:
        """An object ``factor`` times as large, with the same `centre`.

        Raises
        ------
        ValueError
            If the factor is not positive, or the object becomes too large.
        """
        factor = as_scale(factor)
        solid = Solid((self.solid.vertices - self.solid.centre) * factor, self.faces, self.repairs)
        return type(self)(solid, self.rotation, self.centre)

    def repaired(self, *, may_be_open: bool = False) -> Self:
        """The same object with a closed surface; `repairs` lists the repairs that this took.

        With ``may_be_open`` wide holes stay: a cut needs no closed body.

        Raises
        ------
        ValueError
            If a repair is not safe; the message says what is wrong with the mesh. The rules are those of
            `repair.repair`.
        """
        vertices, faces, repairs = repair(self.solid.vertices, self.faces, may_be_open=flag("may_be_open", may_be_open))
        return type(self)(Solid(vertices, faces, self.repairs + repairs), self.rotation, self.offset)

    @classmethod
    def cone(cls, size: float = SIZE, centre: ArrayLike = CENTRE) -> Self:
        """The paper's cone, its tip upwards; parameters and errors as `cube`."""
        return cls._paper("cone", size, centre)

    @classmethod
    def sphere(cls, size: float = SIZE, centre: ArrayLike = CENTRE) -> Self:
        """The paper's sphere; parameters and errors as `cube`."""
        return cls._paper("sphere", size, centre)

    @classmethod
    def pyramid(cls, size: float = SIZE, centre: ArrayLike = CENTRE) -> Self:
        """The paper's pyramid, its tip upwards, over a square; parameters and errors as `cube`."""
        return cls._paper("pyramid", size, centre)

    @classmethod
    def horizontal_prism(cls, size: float = SIZE, centre: ArrayLike = CENTRE) -> Self:
        """The paper's lying prism, a roof with its ridge along x; parameters and errors as `cube`."""
        return cls._paper("horizontal_prism", size, centre)

    @classmethod
    def vertical_prism(cls, size: float = SIZE, centre: ArrayLike = CENTRE) -> Self:
        """The paper's standing prism over an equilateral triangle; parameters and errors as `cube`."""
        return cls._paper("vertical_prism", size, centre)

    @classmethod
    def cube(cls, size: float = SIZE, centre: ArrayLike = CENTRE) -> Self:
        """The paper's cube.

        Parameters
        ----------
        size : float
            Side in metres of the cube that the shape just fits.
        centre : (3,) float
            Centre of the shape's bounding box, in metres.

        Raises
        ------
        ValueError
            If the size is not positive, or a coordinate is not finite or too large.
        """
        return cls._paper("cube", size, centre)

    @classmethod
    def _paper(cls, name: str, size: float, centre: ArrayLike) -> Self:
        size = length("size", size)
        vertices, faces = SOLIDS[name]()
        return cls(Solid(vertices * size, faces), np.eye(3), as_position(centre, "centre"))
