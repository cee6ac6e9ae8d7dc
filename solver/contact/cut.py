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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...compiling import kernel, part
from .arcs import Arcs
from .hand import QUADS
from .mesh import Mesh

__all__ = ["KNUCKLE", "cut"]

KNUCKLE = 6e-3
"""Distance in metres within which an arc of the palm goes on in a finger's base."""
SAME = 1e-9  # metres within which two ends of arcs are one point
FLAT = 1e-12  # area of a quadrilateral, relative to the square of its diagonals, that is none

ALONG = 3  # after three coordinates: the place on the mesh edge
BASE, TIP = 0, 2  # sides of a finger's quadrilaterals
NONE, ALONG_ORDER, AGAINST_ORDER = range(3)  # a border without length; its corners in the order of coordinates or not


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
        next of a finger, and from the palm to the fingers if their ends are within `KNUCKLE` of each other.

    Returns
    -------
    Arcs
        By object, then by the first quadrilateral and face of each. They run counterclockwise around the inside of the
        object as seen from the side from which the corners of the quadrilateral are counterclockwise.

    Raises
    ------
    ValueError
        If the quadrilaterals have another shape or are not finite.
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
    found: tuple[NDArray[Any], ...] = _cut(
        corners, hands, mesh.rotation, mesh.offset, solid.vertices, solid.faces, solid.face_edges, len(solid.edges),
        *solid.bvh,
    )  # fmt: skip
    return found


@part
def _volume(a: Any, b: Any, u: Any, v: Any) -> Any:
    """Six times the volume of a tetrahedron."""
    px, py, pz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    qx, qy, qz = u[0] - a[0], u[1] - a[1], u[2] - a[2]
    rx, ry, rz = v[0] - a[0], v[1] - a[1], v[2] - a[2]
    return px * (qy * rz - qz * ry) + py * (qz * rx - qx * rz) + pz * (qx * ry - qy * rx)


@part
def _comes_first(a: Any, b: Any) -> bool:
    """Whether point a is before b in the order of their coordinates."""
    for k in range(3):
        if a[k] != b[k]:
            return bool(a[k] < b[k])
    return True


@part
def _plane(quad: Any, plane: Any) -> bool:
    """Write normal, lowest and highest coordinates of a quadrilateral, and a margin. False if it has no area."""
    ax, ay, az = quad[2, 0] - quad[0, 0], quad[2, 1] - quad[0, 1], quad[2, 2] - quad[0, 2]
    bx, by, bz = quad[3, 0] - quad[1, 0], quad[3, 1] - quad[1, 1], quad[3, 2] - quad[1, 2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = np.sqrt(x * x + y * y + z * z)
    if not size > FLAT * (ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz):
        return False
    plane[0], plane[1], plane[2] = x / size, y / size, z / size
    largest = 0.0
    for k in range(3):
        a, b, c, d = quad[0, k], quad[1, k], quad[2, k], quad[3, k]
        plane[3 + k], plane[6 + k] = min(a, b, c, d), max(a, b, c, d)
        largest = max(largest, abs(a), abs(b), abs(c), abs(d))
    plane[9] = FLAT * largest
    return True


@part
def _height(plane: Any, corner: Any, x: float, y: float, z: float) -> Any:
    """Distance above the plane."""
    return plane[0] * (x - corner[0]) + plane[1] * (y - corner[1]) + plane[2] * (z - corner[2])


@part
def _meets(plane: Any, corner: Any, box: Any) -> bool:
    """Whether a quadrilateral may meet what is in a box."""
    reach = 0.0
    for k in range(3):
        if plane[3 + k] > box[3 + k] + plane[9] or plane[6 + k] < box[k] - plane[9]:
            return False
        reach += abs(plane[k]) * (box[3 + k] - box[k])
    x, y, z = (box[0] + box[3]) / 2, (box[1] + box[4]) / 2, (box[2] + box[5]) / 2
    return bool(abs(_height(plane, corner, x, y, z)) <= reach / 2 + plane[9])


@part
def _crossing(quad: Any, borders: Any, i: int, j: int, u: Any, v: Any, du: float, dv: float, at: Any, off: Any) -> None:
    """Where the mesh edge from vertex i to j, at distances du and dv, crosses the plane; how far it is inside borders.

    Writes ``at``, place and share of the edge, and ``off``, (4,) distances times the borders' lengths, with the sign of
    the inside even if they are 0.
    """
    if i > j:
        u, v, du, dv = v, u, dv, du
    along = du / (du - dv)
    at[ALONG] = along
    for k in range(3):
        at[k] = (1 - along) * u[k] + along * v[k]
    for side in range(4):
        if borders[side] == NONE:
            off[side] = np.inf
            continue
        a, b = quad[side], quad[(side + 1) % 4]
        volume = _volume(a, b, u, v) if borders[side] == ALONG_ORDER else _volume(b, a, u, v)
        inside = ((volume >= 0) == (borders[side] == ALONG_ORDER)) == (du < 0)
        distance = abs(volume) / abs(du - dv)
        off[side] = distance if inside else -distance


@part
def _clip(start: Any, stop: Any) -> Any:
    """Cyrus and Beck: from where to where of a segment is inside all borders, and the borders there or -1.

    ``start`` and ``stop`` are the (4,) distances inside of its ends; a sign also belongs to 0.
    """
    first, last, entry, leave = 0.0, 1.0, -1, -1
    for side in range(4):
        a, b = start[side], stop[side]
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


@part
def _segments(quads: Any, vertices: Any, faces: Any, face_edges: Any, boxes: Any, after: Any, firsts: Any,
              counts: Any, order: Any) -> Any:  # fmt: skip
    """What the quadrilaterals cut out of each face.

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
    plane, borders = np.empty(10), np.empty(4, np.int64)
    at, off, height = np.empty((2, 4)), np.empty((2, 4)), np.empty(3)
    for q in range(len(quads)):
        quad = quads[q]
        if not _plane(quad, plane):
            continue
        for side in range(4):
            a, b = quad[side], quad[(side + 1) % 4]
            same = a[0] == b[0] and a[1] == b[1] and a[2] == b[2]
            borders[side] = NONE if same else ALONG_ORDER if _comes_first(a, b) else AGAINST_ORDER
        node = 0
        while node < len(after):
            if not _meets(plane, quad[0], boxes[node]):
                node = after[node]
                continue
            for at_leaf in range(firsts[node], firsts[node] + counts[node]):
                face = order[at_leaf]
                above = 0
                for k in range(3):
                    v = vertices[faces[face, k]]
                    height[k] = _height(plane, quad[0], v[0], v[1], v[2])
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
                    _crossing(
                        quad, borders, i, j, vertices[i], vertices[j], height[k], height[m], at[which], off[which]
                    )
                first, last, entry, leave = _clip(off[0], off[1])
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


@part
def _joint(quad: int, side: int) -> int:
    """The quadrilateral of a finger whose base a border is; -1 if it is none."""
    local = quad % QUADS
    if local == 0:
        return -1
    if side == BASE:
        return quad
    if side == TIP and (local - 1) % 3 < 2:
        return quad + 1
    return -1


@part
def _link(pieces: Any, ends: Any, hands: bool, quads: int, faces: int, edges: int) -> Any:
    """Which end goes on at which, (2 n,) int; -1 if an arc ends there.

    Ends meet if they are on the same mesh edge in the same quadrilateral, or in the same face at the border that two
    quadrilaterals of a finger share. A stop goes on at a start. If more than two faces meet at an edge, they are paired
    in the order of their numbers, and only what is left pairs starts with starts.
    """
    links, following = np.full(len(ends), -1), np.full(len(ends), -1)
    size = 4
    while size < 2 * len(ends):
        size *= 2
    keys, heads, tails = np.full(size, -1), np.full(size, -1), np.full(size, -1)  # of queues of ends that wait
    for end in range(len(ends)):
        quad, face = pieces[end // 2]
        if ends[end, 0] >= 0:
            key = quad * edges + ends[end, 0]
        else:
            joint = _joint(quad, ends[end, 1]) if hands else -1
            if joint < 0:
                continue
            key = quads * edges + joint * faces + face
        slot = (key * 0x9E3779B97F4A7C1 >> 20) & (size - 1)
        while keys[slot] >= 0 and keys[slot] != key:
            slot = (slot + 1) & (size - 1)
        keys[slot] = key
        other = heads[slot]
        if other >= 0 and other % 2 != end % 2:
            links[end], links[other], heads[slot] = other, end, following[other]
        elif other >= 0:
            following[tails[slot]], tails[slot] = end, end
        else:
            heads[slot] = tails[slot] = end
    for slot in range(size):
        end = heads[slot]
        while end >= 0 and following[end] >= 0:
            links[end], links[following[end]] = following[end], end
            end = following[following[end]]
    return links


@part
def _bridge(pieces: Any, ends: Any, places: Any, links: Any) -> None:
    """Link ends that are left at the palm's borders to ends at the fingers' bases, and others of one joint.

    A stop goes on at the nearest start, or a start at the nearest stop, within `KNUCKLE`, if each is the other's
    nearest. Ends of one joint that are left differ in the last bits only, which put them in different faces.
    """
    free = np.empty(len(ends), np.int64)
    n = 0
    for end in range(len(ends)):
        if links[end] < 0 and ends[end, 1] >= 0:
            free[n] = end
            n += 1
    nearest, distance = np.full(n, -1), np.full(n, KNUCKLE * KNUCKLE)
    for i in range(n):
        if ends[free[i], 1] != BASE or pieces[free[i] // 2, 0] % QUADS == 0:
            continue
        for j in range(n):
            if (free[i] - free[j]) % 2 == 0 or not _adjoins(pieces, ends, free[i], free[j]):
                continue
            apart = _apart2(places, free[i], free[j])
            if apart < distance[i]:
                nearest[i], distance[i] = j, apart
            if apart < distance[j]:
                nearest[j], distance[j] = i, apart
    for i in range(n):
        j = nearest[i]
        if j > i and nearest[j] == i:
            links[free[i]], links[free[j]] = free[j], free[i]


@part
def _adjoins(pieces: Any, ends: Any, base: int, end: int) -> bool:
    """Whether an end is at the border to which a finger's quadrilateral adjoins by its base."""
    finger, quad, side = pieces[base // 2, 0], pieces[end // 2, 0], ends[end, 1]
    if (finger - 1) % QUADS % 3 == 0:
        return bool(quad == finger - finger % QUADS and side != BASE)
    return bool(quad == finger - 1 and side == TIP)


@part
def _apart2(places: Any, one: int, other: int) -> Any:
    """Square of the distance between two ends."""
    x, y, z = places[one, 0] - places[other, 0], places[one, 1] - places[other, 1], places[one, 2] - places[other, 2]
    return x * x + y * y + z * z


@part
def _walk(pieces: Any, ends: Any, places: Any, links: Any) -> Any:
    """Follow the links from end to end: arcs as `Arcs` has them, by the first piece of each, which gives the direction.

    An arc without length is left out: it touches the mesh in one point.
    """
    n = len(pieces)
    visited = np.zeros(n, np.bool_)
    enters, closed = np.empty(n, np.int64), np.empty(n, np.bool_)  # of each arc, its first end
    room = arcs = 0
    for piece in range(n):
        if visited[piece]:
            continue
        enter = 2 * piece
        while links[enter] >= 0 and links[enter] // 2 != piece:  # back to the beginning
            enter = links[enter] ^ 1
        loop = links[enter] >= 0
        if loop:
            enter = 2 * piece
        here, steps, long = enter, 0, False
        while True:
            visited[here // 2] = True
            steps += 2
            long = long or _apart2(places, here, here ^ 1) > 0
            here = links[here ^ 1]
            if here < 0 or here == enter:
                break
        if long:
            enters[arcs], closed[arcs] = enter, loop
            arcs += 1
            room += steps + 1
    vertices, along = np.empty((room, 3)), np.empty(room)
    whole = np.empty((room, 3), np.int64)
    starts = np.empty(arcs + 1, np.int64)
    k = 0
    for arc in range(arcs):
        starts[arc] = k
        here = enters[arc]
        while True:
            piece = here // 2
            _enter(places, ends, here, vertices, along, whole, k)
            whole[k, 0], whole[k, 1] = pieces[piece, 1], pieces[piece, 0]
            k += 1
            stop = here ^ 1
            here = links[stop]
            if here >= 0 and _apart2(places, stop, here) <= SAME * SAME:
                if here == enters[arc]:
                    break
                continue
            _enter(places, ends, stop, vertices, along, whole, k)
            if here < 0:
                break
            whole[k, 0], whole[k, 1] = pieces[piece, 1], pieces[piece, 0]
            k += 1
            if here == enters[arc]:
                break
        if closed[arc]:
            _enter(places, ends, enters[arc], vertices, along, whole, k)
        whole[k, 0] = whole[k, 1] = -1
        k += 1
    starts[arcs] = k
    return vertices[:k], starts, closed[:arcs], whole[:k, 0].copy(), whole[:k, 1].copy(), whole[:k, 2].copy(), along[:k]


@part
def _enter(places: Any, ends: Any, end: int, vertices: Any, along: Any, whole: Any, k: int) -> None:
    vertices[k] = places[end, :3]
    along[k], whole[k, 2] = places[end, ALONG], ends[end, 0]


@kernel
def _cut(quads: Any, hands: bool, rotation: Any, offset: Any, vertices: Any, faces: Any, face_edges: Any, edges: int,
         boxes: Any, after: Any, firsts: Any, counts: Any, order: Any) -> Any:  # fmt: skip
    """Cut a solid that is turned and moved: what `Arcs` holds but for the objects."""
    turned = np.empty(quads.shape)
    for q in range(len(quads)):
        for corner in range(4):
            for k in range(3):
                turned[q, corner, k] = 0.0
                for m in range(3):
                    turned[q, corner, k] += (quads[q, corner, m] - offset[m]) * rotation[m, k]
    pieces, ends, places = _segments(turned, vertices, faces, face_edges, boxes, after, firsts, counts, order)
    links = _link(pieces, ends, hands, len(quads), len(faces), edges)
    if hands:
        _bridge(pieces, ends, places, links)
    found = _walk(pieces, ends, places, links)
    points = found[0]
    for i in range(len(points)):
        x, y, z = points[i]
        for k in range(3):
            points[i, k] = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + offset[k]
    return found
