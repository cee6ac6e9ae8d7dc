"""Cuts: the lines along which quadrilaterals meet meshes, as contiguous arcs. Compiled.

`literal` says the same in readable NumPy, and is what this is tested against.

A vertex at a distance d >= 0 from a quadrilateral's plane is above it. So each mesh edge crosses the plane or does not,
and a vertex in the plane makes neither a gap nor a duplicate. A crossing is computed from its edge alone, in the order
of the edge's vertices, so that both faces at the edge find the same bits. Whether a crossing is inside a border of the
quadrilateral follows from the sign of the volume that the border and the mesh edge span: two quadrilaterals that share
a border see the same volume with opposite signs, so each crossing on it belongs to one of them.

This module imports numba, so it is imported when something is cut for the first time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...compiling import kernel, part
from .arcs import KNUCKLE, SAME, Arcs
from .chain import ALONG, chain
from .hand import QUADS
from .mesh import Mesh

__all__ = ["cut", "segments"]

FLAT = 1e-12  # area of a quadrilateral, relative to the square of its diagonals, that is none


def cut(quads: ArrayLike, meshes: Mesh | Sequence[Mesh], hands: bool = False) -> Arcs:
    """Cut meshes with quadrilaterals, and join what is cut to arcs.

    Parameters
    ----------
    quads : (q, 4, 3) float
        Corners of planar convex quadrilaterals in metres, in order around each. One without area cuts nothing.
    meshes : Mesh or sequence of Mesh
        What is cut.
    hands : bool
        Whether each 16 quadrilaterals are those of a hand, as `Hand.quads` has them: arcs then go on from one to the
        next of a finger, and from the palm to the fingers if their ends are within `arcs.KNUCKLE` of each other.

    Returns
    -------
    Arcs
        By object, then by the first quadrilateral and face of each. They run counterclockwise around the inside of the
        object as seen from the side from which the corners of the quadrilateral are counterclockwise.

    Raises
    ------
    ValueError
        If the quadrilaterals have another shape or are not finite.

    Notes
    -----
    What is exactly in the plane is cut as the plane just below would cut it: a face of an object below is outlined, a
    face of an object above is not cut, an edge is followed there and back, and a point is no arc. Of triangles with the
    same three vertices the first is cut. A triangle without area joins the lines on both sides of it. Arcs end at a
    mesh's open edges.
    """
    corners = np.array(quads, dtype=np.float64, order="C")  # writable: kernels are compiled for one kind of array
    if corners.ndim != 3 or corners.shape[1:] != (4, 3):
        raise ValueError(f"quadrilaterals must have the shape (q, 4, 3), not {corners.shape}")
    if hands and len(corners) % QUADS:
        raise ValueError(f"hands have {QUADS} quadrilaterals each; {len(corners)} are no whole number of hands")
    if not np.isfinite(corners).all():
        bad = int(np.flatnonzero(~np.isfinite(corners).all(axis=(1, 2)))[0])
        raise ValueError(f"quadrilateral {bad} is {corners[bad].tolist()}; its coordinates must be finite numbers")
    objects = (meshes,) if isinstance(meshes, Mesh) else tuple(meshes)
    parts = [_cut_mesh(corners, mesh, hands) for mesh in objects]
    return Arcs.joined(parts)


def _cut_mesh(corners: NDArray[np.float64], mesh: Mesh, hands: bool) -> tuple[NDArray[Any], ...]:
    solid = mesh.solid
    pieces, ends, places = segments(
        corners, mesh.rotation, mesh.offset, solid.vertices, solid.faces, solid.face_edges, *solid.bvh
    )
    found: tuple[NDArray[Any], ...] = chain(
        pieces, ends, places, hands, len(corners), len(solid.faces), len(solid.edges), KNUCKLE, SAME, mesh.rotation,
        mesh.offset,
    )  # fmt: skip
    return found


@part
def _prepare(quad: Any, plane: Any, borders: Any) -> bool:
    """Write what is the same for all faces. False if the quadrilateral has no area.

    ``plane`` is its normal of any length, first corner, lowest and highest coordinates, and margins for rounding of
    coordinates and of heights, 14 numbers. Of each border ``borders`` has the corner that comes first in the order of
    coordinates, the way to the other one, and 1 if this is the way around the quadrilateral, -1 if not, 0 if the border
    has no length.
    """
    ax, ay, az = quad[2, 0] - quad[0, 0], quad[2, 1] - quad[0, 1], quad[2, 2] - quad[0, 2]
    bx, by, bz = quad[3, 0] - quad[1, 0], quad[3, 1] - quad[1, 1], quad[3, 2] - quad[1, 2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = np.sqrt(x * x + y * y + z * z)
    if not size > FLAT * (ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz):
        return False
    plane[0], plane[1], plane[2] = x, y, z
    largest = 0.0
    for k in range(3):
        a, b, c, d = quad[0, k], quad[1, k], quad[2, k], quad[3, k]
        plane[3 + k], plane[6 + k], plane[9 + k] = a, min(a, b, c, d), max(a, b, c, d)
        largest = max(largest, abs(a), abs(b), abs(c), abs(d))
    plane[12], plane[13] = FLAT * largest, FLAT * largest * size
    for side in range(4):
        one, other, way = side, (side + 1) % 4, 0
        for k in range(3):
            if way == 0 and quad[one, k] != quad[other, k]:
                way = 1 if quad[one, k] < quad[other, k] else -1
        if way < 0:
            one, other = other, one
        for k in range(3):
            borders[side, k], borders[side, 3 + k] = quad[one, k], quad[other, k] - quad[one, k]
        borders[side, 6] = way
    return True


@part
def _height(plane: Any, x: float, y: float, z: float) -> Any:
    """Distance above the plane times the length of its normal, which keeps what is exactly 0 so."""
    return plane[0] * (x - plane[3]) + plane[1] * (y - plane[4]) + plane[2] * (z - plane[5])


@part
def _meets(plane: Any, boxes: Any, node: int) -> bool:
    """Whether a quadrilateral may meet what is in a box."""
    reach = 0.0
    for k in range(3):
        low, high = boxes[node, k], boxes[node, 3 + k]
        if plane[6 + k] > high + plane[12] or plane[9 + k] < low - plane[12]:
            return False
        reach += abs(plane[k]) * (high - low)
    x, y, z = boxes[node, 0] + boxes[node, 3], boxes[node, 1] + boxes[node, 4], boxes[node, 2] + boxes[node, 5]
    return bool(abs(_height(plane, x / 2, y / 2, z / 2)) <= reach / 2 + plane[13])


@part
def _crossing(vertices: Any, i: int, j: int, di: float, dj: float, borders: Any, at: Any, off: Any, row: int) -> None:
    """Where the mesh edge from vertex i to j, at heights di and dj, crosses the plane; how far it is inside borders.

    Writes a row of ``at``, place and share of the edge, and of ``off``, distances from the borders times their lengths,
    negative outside; the sign also belongs to 0.
    """
    if i > j:
        i, j, di, dj = j, i, dj, di
    along = di / (di - dj)
    at[row, ALONG] = along
    for k in range(3):
        at[row, k] = (1 - along) * vertices[i, k] + along * vertices[j, k]
    for side in range(4):
        way = borders[side, 6]
        if way == 0:
            off[row, side] = np.inf
            continue
        x, y, z = borders[side, 0], borders[side, 1], borders[side, 2]
        ux, uy, uz = vertices[i, 0] - x, vertices[i, 1] - y, vertices[i, 2] - z
        vx, vy, vz = vertices[j, 0] - x, vertices[j, 1] - y, vertices[j, 2] - z
        volume = (
            borders[side, 3] * (uy * vz - uz * vy)
            + borders[side, 4] * (uz * vx - ux * vz)
            + borders[side, 5] * (ux * vy - uy * vx)
        )
        inside = ((volume >= 0) == (way > 0)) == (di < 0)
        distance = abs(volume / (di - dj))
        off[row, side] = distance if inside else -distance


@part
def _clip(off: Any) -> Any:
    """Cyrus and Beck: from where to where of a segment is inside all borders, and the borders there or -1.

    ``off`` is what `_crossing` writes of its start and its stop.
    """
    first, last, entry, leave = 0.0, 1.0, -1, -1
    for side in range(4):
        a, b = off[0, side], off[1, side]
        outside, beyond = np.signbit(a), np.signbit(b)
        if outside and beyond:
            return 1.0, 0.0, -1, -1
        if outside == beyond:
            continue
        length = abs(a) + abs(b)
        t = abs(a) / length if length > 0 else 0.5
        if outside and (t >= first):
            first, entry = t, side
        elif beyond and t <= last:
            last, leave = t, side
    return first, last, entry, leave


@part
def _grown(rows: Any) -> Any:
    """The same rows and room for as many more."""
    larger = np.empty((2 * len(rows), rows.shape[1]), rows.dtype)
    larger[: len(rows)] = rows
    return larger


@partial(kernel, error_model="numpy")  # no check at each division
def segments(quads: Any, rotation: Any, offset: Any, vertices: Any, faces: Any, face_edges: Any, boxes: Any,
             links: Any, order: Any) -> Any:  # fmt: skip
    """What the quadrilaterals cut out of each face of a solid, and in the solid's coordinates.

    Returns
    -------
    pieces : (n, 2) int
        Quadrilateral and face of each segment, in this order.
    ends : (2 n, 2) int
        Of the segments' starts and stops in turn: mesh edge, or -1, and side of the quadrilateral, or -1.
    places : (2 n, 4) float
        Of the same: coordinates, and place on the mesh edge.
    """
    pieces, ends, places = np.empty((64, 2), np.int64), np.empty((128, 2), np.int64), np.empty((128, 4))
    n = 0
    quad, plane, borders = np.empty((4, 3)), np.empty(14), np.empty((4, 7))
    at, off, height = np.empty((2, 4)), np.empty((2, 4)), np.empty(3)
    for q in range(len(quads)):
        for corner in range(4):
            x, y, z = quads[q, corner, 0] - offset[0], quads[q, corner, 1] - offset[1], quads[q, corner, 2] - offset[2]
            for k in range(3):
                quad[corner, k] = x * rotation[0, k] + y * rotation[1, k] + z * rotation[2, k]
        if not _prepare(quad, plane, borders):
            continue
        node = 0
        while node < len(boxes):
            if not _meets(plane, boxes, node):
                node = links[node, 0]
                continue
            is_leaf = links[node, 0] == node + 1
            for at_leaf in range(links[node, 1], links[node + 1, 1] if is_leaf else 0):
                face = order[at_leaf]
                above = 0
                for k in range(3):
                    i = faces[face, k]
                    height[k] = _height(plane, vertices[i, 0], vertices[i, 1], vertices[i, 2])
                    if abs(height[k]) <= plane[13]:
                        height[k] = 0.0  # rounding must not put one corner of a coplanar face above and another below
                    above += height[k] >= 0
                if above == 0 or above == 3:
                    continue
                if n == len(pieces):
                    pieces, ends, places = _grown(pieces), _grown(ends), _grown(places)
                for k in range(3):
                    m = (k + 1) % 3
                    if (height[k] >= 0) == (height[m] >= 0):
                        continue
                    which = 0 if height[k] >= 0 else 1  # a segment starts where the face's border goes down
                    i, j = faces[face, k], faces[face, m]
                    ends[2 * n + which, 0] = face_edges[face, k]
                    _crossing(vertices, i, j, height[k], height[m], borders, at, off, which)
                first, last, entry, leave = _clip(off)
                if not first <= last or (first == last and entry >= 0 and leave >= 0):
                    continue
                pieces[n, 0], pieces[n, 1] = q, face
                ends[2 * n, 1], ends[2 * n + 1, 1] = entry, leave
                for which in range(2):
                    t = first if which == 0 else last
                    if ends[2 * n + which, 1] < 0:
                        for k in range(4):
                            places[2 * n + which, k] = at[which, k]
                        continue
                    ends[2 * n + which, 0] = -1
                    places[2 * n + which, ALONG] = 0
                    for k in range(3):
                        places[2 * n + which, k] = (1 - t) * at[0, k] + t * at[1, k]
                n += 1
            node += 1
    rank = np.argsort(pieces[:n, 0] * len(faces) + pieces[:n, 1])
    both = np.empty(2 * n, np.int64)
    both[::2], both[1::2] = 2 * rank, 2 * rank + 1
    return pieces[rank], ends[both], places[both]
