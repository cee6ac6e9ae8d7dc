"""Cuts: the lines along which quadrilaterals meet meshes, as contiguous arcs. Compiled.

It is tested against `literal`, which does the same in readable NumPy.

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
from numpy.typing import ArrayLike

from ...base.compiling import kernel, part
from .arcs import Arcs
from .chain import ALONG, append_arcs
from .hand import QUADS
from .mesh import Mesh
from .scene import Scene, poses

__all__ = ["cut", "cut_all"]

FLAT = 1e-12  # area of a quadrilateral, relative to the square of its diagonals, below which it counts as 0
SURE = 1e-9
"""Of the coordinates: what is farther than this from a border is surely on that side of it, whatever is rounded."""
ROOM = 1536
"""Segments for which there is room at once: what a hand cuts out of an object of 100 000 faces."""
GRAZING = 1e-5
"""Of the coordinates: the least difference of the heights of an edge's ends with which that holds."""
NORMAL, CORNER, LOW, HIGH, BLUR, SLACK, LENGTH, PLANE_NUMBERS = 0, 3, 6, 9, 12, 13, 14, 15
"""In what `_prepare` says of a plane: its normal of any length, first corner, lowest and highest coordinates; margins
for rounding of coordinates and of heights; the normal's length."""


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
        The arcs by object, then by the first quadrilateral and face of each. They run counterclockwise around the
        inside of the object as seen from the side from which the corners of the quadrilateral are counterclockwise.

    Raises
    ------
    ValueError
        If the quadrilaterals have another shape or are not finite.

    Notes
    -----
    What is exactly in the plane is cut as the plane just below would cut it: a face of an object below is outlined, a
    face of an object above is not cut, an edge is followed there and back, and a point makes no arc. Of triangles with
    the same three vertices the first is cut. A triangle without area joins the lines on both sides of it. Arcs end at a
    mesh's open edges.
    """
    corners = np.array(quads, dtype=np.float64, order="C")
    if corners.ndim != 3 or corners.shape[1:] != (4, 3):
        raise ValueError(f"quadrilaterals must have the shape (q, 4, 3), not {corners.shape}")
    if hands and len(corners) % QUADS:
        raise ValueError(f"hands have {QUADS} quadrilaterals each; {len(corners)} are no whole number of hands")
    if not np.isfinite(corners).all():
        bad = int(np.flatnonzero(~np.isfinite(corners).all(axis=(1, 2)))[0])
        raise ValueError(f"quadrilateral {bad} is {corners[bad].tolist()}; its coordinates must be finite numbers")
    objects = (meshes,) if isinstance(meshes, Mesh) else tuple(meshes)
    return Arcs(*_cut(*Scene.of(objects, corners=False), poses(objects), corners, hands))


@partial(kernel, error_model="numpy")
def _cut(boxes: Any, links: Any, corners: Any, names: Any, curvature: Any, begins: Any, which: Any, poses: Any,
         quads: Any, hands: bool) -> Any:  # fmt: skip
    """`cut_all` as a kernel of its own."""
    return cut_all(Scene(boxes, links, corners, names, curvature, begins, which), poses, quads, hands)


@part
def cut_all(scene: Any, poses: Any, quads: Any, hands: bool) -> Any:
    """Cut all objects of a `Scene` at their ``poses`` (o, 4, 3), see `scene.poses`; the rest is as in `cut`.

    Returns vertices, along, names and rows, as `Arcs` has them.
    """
    vertices, along = np.empty((64, 3)), np.empty(64)
    names, rows = np.empty((64, 3), np.int64), np.empty((17, 3), np.int64)
    rows[0, 0] = 0
    pieces, ends, places = _room(ROOM)
    arcs = 0
    for number in range(scene.which.size):
        solid = scene.which[number]
        node, face = scene.begins[solid, 0], scene.begins[solid, 1]
        end, last = scene.begins[solid + 1, 0], scene.begins[solid + 1, 1]
        boxes, links = scene.boxes[node:end], scene.links[node + solid : end + solid + 1]
        corners, numbers = scene.corners[face:last], scene.names[face:last]
        n = segments(quads, poses[number], boxes, links, corners, numbers, pieces, ends, places)
        if n > len(pieces):
            pieces, ends, places = _room(2 * n)
            segments(quads, poses[number], boxes, links, corners, numbers, pieces, ends, places)
        if n > 0:
            found = pieces[:n], ends[: 2 * n], places[: 2 * n]
            vertices, along, names, rows, arcs = append_arcs(
                *found, hands, poses[number], number, vertices, along, names, rows, arcs
            )
    count = rows[arcs, 0]
    rows[arcs, 1] = rows[arcs, 2] = -1
    return vertices[:count], along[:count], names[:count], rows[: arcs + 1]


@part
def _room(count: int) -> Any:
    """Arrays for so many segments; see `segments`."""
    return np.empty((count, 2), np.int32), np.empty((2 * count, 2), np.int32), np.empty((2 * count, 4))


@part
def _near(quad: Any, boxes: Any) -> bool:
    """Whether the box of a quadrilateral meets that of the whole solid, which most fingers and many objects miss."""
    if len(boxes) == 0:
        return False
    for k in range(3):
        a, b, c, d = quad[0, k], quad[1, k], quad[2, k], quad[3, k]
        middle, half = boxes[0, k], boxes[0, 3 + k]
        reach = half + FLAT * (abs(middle) + half)
        if min(a, b, c, d) - middle > reach or middle - max(a, b, c, d) > reach:
            return False
    return True


@part
def _prepare(quad: Any, plane: Any, borders: Any, walls: Any) -> bool:
    """Write what all faces share. False if the quadrilateral has no area.

    ``plane`` has `PLANE_NUMBERS` numbers, see `NORMAL`. Of each border ``borders`` has the corner that comes first in
    the order of coordinates, the way to the other one, and 1 if this is the way around the quadrilateral, -1 if not, 0
    if the border has no length. ``walls`` are the planes through the borders that are perpendicular to it: unit normals
    to the inside, and offsets.
    """
    ax, ay, az = quad[2, 0] - quad[0, 0], quad[2, 1] - quad[0, 1], quad[2, 2] - quad[0, 2]
    bx, by, bz = quad[3, 0] - quad[1, 0], quad[3, 1] - quad[1, 1], quad[3, 2] - quad[1, 2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = np.sqrt(x * x + y * y + z * z)
    if not size > FLAT * (ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz):
        return False
    plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2], plane[LENGTH] = x, y, z, size
    largest = 0.0
    for k in range(3):
        a, b, c, d = quad[0, k], quad[1, k], quad[2, k], quad[3, k]
        plane[CORNER + k], plane[LOW + k], plane[HIGH + k] = a, min(a, b, c, d), max(a, b, c, d)
        largest = max(largest, abs(a), abs(b), abs(c), abs(d))
    plane[BLUR], plane[SLACK] = FLAT * largest, FLAT * largest * size
    for side in range(4):
        one, other, way = side, (side + 1) % 4, 0
        for k in range(3):
            if way == 0 and quad[one, k] != quad[other, k]:
                way = 1 if quad[one, k] < quad[other, k] else -1
        u, v, w = quad[other, 0] - quad[one, 0], quad[other, 1] - quad[one, 1], quad[other, 2] - quad[one, 2]
        if way < 0:
            one, other = other, one
        for k in range(3):
            borders[side, k], borders[side, 3 + k] = quad[one, k], quad[other, k] - quad[one, k]
        borders[side, 6] = way
        p, q, r = y * w - z * v, z * u - x * w, x * v - y * u
        length = np.sqrt(p * p + q * q + r * r)
        if length > 0:
            p, q, r = p / length, q / length, r / length
        walls[side, 0], walls[side, 1], walls[side, 2] = p, q, r
        walls[side, 3] = -(p * quad[one, 0] + q * quad[one, 1] + r * quad[one, 2])
    return True


@part
def segments(
    quads: Any, pose: Any, boxes: Any, links: Any, corners: Any, names: Any, pieces: Any, ends: Any, places: Any
) -> int:
    """Number of segments that the quadrilaterals (q, 4, 3) cut out of the faces of a solid, in its coordinates.

    ``pose`` (4, 3) is the object's, see `scene.poses`; ``boxes``, ``links``, ``corners`` and ``names`` are those of
    `tables.SolidTables`. Three arrays are written as far as they have room. ``pieces`` (room, 2): quadrilateral and
    face of each segment, by quadrilateral and then by leaf. Of the segments' starts and stops in turn, ``ends`` (2
    room, 2): mesh edge, or -1, and side of the quadrilateral, or -1; and ``places`` (2 room, 4): coordinates, and place
    on the mesh edge.

    The loops are one function, and no name of an array gets another array in them: numba counts references, and each
    count costs as much as a node or a face.
    """
    n, room = 0, len(pieces)
    quad, plane, borders, walls = np.empty((4, 3)), np.empty(PLANE_NUMBERS), np.empty((4, 7)), np.empty((4, 4))
    height, at, sides = np.empty(3), np.empty((2, 4)), np.empty((2, 3), np.int64)
    off, inside = np.empty(2), np.empty(2, np.bool_)
    nodes = len(boxes)
    extent = 0.0  # the largest coordinate of the solid
    for k in range(3 if nodes > 0 else 0):
        extent = max(extent, abs(boxes[0, k]) + boxes[0, 3 + k])
    for q in range(len(quads)):
        for corner in range(4):
            for k in range(3):
                quad[corner, k] = 0.0
                for j in range(3):
                    quad[corner, k] += (quads[q, corner, j] - pose[3, j]) * pose[j, k]
        if not _near(quad, boxes) or not _prepare(quad, plane, borders, walls):
            continue
        nx, ny, nz = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
        px, py, pz = plane[CORNER], plane[CORNER + 1], plane[CORNER + 2]
        low_x, low_y, low_z = plane[LOW], plane[LOW + 1], plane[LOW + 2]
        high_x, high_y, high_z = plane[HIGH], plane[HIGH + 1], plane[HIGH + 2]
        margin, slack, size = plane[BLUR] + FLAT * extent, plane[SLACK], plane[LENGTH]
        mx, my, mz = (low_x + high_x) / 2, (low_y + high_y) / 2, (low_z + high_z) / 2
        ex, ey, ez = high_x - mx + margin, high_y - my + margin, high_z - mz + margin
        rise, spare = nx * (mx - px) + ny * (my - py) + nz * (mz - pz), margin * size
        across_x, across_y, across_z = abs(nx), abs(ny), abs(nz)
        sure = SURE * (plane[BLUR] / FLAT + extent)
        steep = GRAZING / SURE * sure * size
        node = 0
        while node < nodes:
            dx, dy, dz = boxes[node, 0] - mx, boxes[node, 1] - my, boxes[node, 2] - mz
            hx, hy, hz = boxes[node, 3], boxes[node, 4], boxes[node, 5]
            reach = across_x * hx + across_y * hy + across_z * hz + spare
            apart = (abs(dx) > hx + ex) | (abs(dy) > hy + ey) | (abs(dz) > hz + ez)
            if apart | (abs(nx * dx + ny * dy + nz * dz + rise) > reach):
                node = links[node, 0]
                continue
            first_face, end_face = 0, 0
            if links[node, 0] == node + 1:
                first_face, end_face = links[node, 1], links[node + 1, 1]
            for face in range(first_face, end_face):
                above = 0
                for k in range(3):
                    ux, uy, uz = corners[face, 3 * k] - px, corners[face, 3 * k + 1] - py, corners[face, 3 * k + 2] - pz
                    level = nx * ux + ny * uy + nz * uz
                    if abs(level) <= slack:
                        level = 0.0  # rounding must not put one corner of a coplanar face above and another below
                    height[k] = level
                    above += (level >= 0) << k
                if above == 0 or above == 7:
                    continue
                # Two borders of the face leave one corner. A segment starts where the face's border goes down.
                alone = 0 if above == 1 or above == 6 else (1 if above == 2 or above == 5 else 2)
                begin = 0 if above == 1 or above == 2 or above == 4 else 1
                certain = True
                for leg in range(2):
                    which = leg ^ begin
                    i = alone if leg == 0 else (alone + 2) % 3
                    j = (i + 1) % 3
                    sides[which, 2] = names[face, 4 + i]
                    if names[face, 1 + i] > names[face, 1 + j]:
                        i, j = j, i
                    sides[which, 0], sides[which, 1] = i, j
                    share = height[i] / (height[i] - height[j])
                    for k in range(3):
                        at[which, k] = (1 - share) * corners[face, 3 * i + k] + share * corners[face, 3 * j + k]
                    at[which, 3] = share
                    certain = certain and abs(height[i] - height[j]) > steep
                # Cyrus and Beck: from where to where the segment is inside all borders, and the borders there or -1.
                first, last, entry, leave = 0.0, 1.0, -1, -1
                for side in range(4):
                    if borders[side, 6] == 0:
                        continue
                    if certain:
                        x, y, z, w = walls[side, 0], walls[side, 1], walls[side, 2], walls[side, 3]
                        one = x * at[0, 0] + y * at[0, 1] + z * at[0, 2] + w
                        other = x * at[1, 0] + y * at[1, 1] + z * at[1, 2] + w
                        if one > sure and other > sure:
                            continue
                        if one < -sure and other < -sure:
                            first, last = 1.0, 0.0
                            break
                    for which in range(2):
                        i, j = sides[which, 0], sides[which, 1]
                        u, v = 3 * i, 3 * j
                        x, y, z = borders[side, 0], borders[side, 1], borders[side, 2]
                        ux, uy, uz = corners[face, u] - x, corners[face, u + 1] - y, corners[face, u + 2] - z
                        vx, vy, vz = corners[face, v] - x, corners[face, v + 1] - y, corners[face, v + 2] - z
                        volume = (
                            borders[side, 3] * (uy * vz - uz * vy)
                            + borders[side, 4] * (uz * vx - ux * vz)
                            + borders[side, 5] * (ux * vy - uy * vx)
                        )
                        off[which] = abs(volume / (height[i] - height[j]))
                        inside[which] = ((volume >= 0) == (borders[side, 6] > 0)) == (height[i] < 0)
                    if not inside[0] and not inside[1]:
                        first, last = 1.0, 0.0
                        break
                    if inside[0] == inside[1]:
                        continue
                    length = off[0] + off[1]
                    share = off[0] / length if length > 0 else 0.5
                    if inside[1] and share >= first:
                        first, entry = share, side
                    elif inside[0] and share <= last:
                        last, leave = share, side
                if not first <= last or (first == last and entry >= 0 and leave >= 0):
                    continue
                n += 1
                if n > room:
                    continue
                pieces[n - 1, 0], pieces[n - 1, 1] = q, names[face, 0]
                for which in range(2):
                    row, side, share = 2 * n - 2 + which, entry if which == 0 else leave, first if which == 0 else last
                    ends[row, 0], ends[row, 1] = sides[which, 2] if side < 0 else -1, side
                    if side < 0:
                        for k in range(4):
                            places[row, k] = at[which, k]
                    else:
                        for k in range(3):
                            places[row, k] = (1 - share) * at[0, k] + share * at[1, k]
                        places[row, ALONG] = 0
            node += 1
    return n
