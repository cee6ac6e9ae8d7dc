"""Chains: the segments that quadrilaterals cut out of faces, joined to contiguous arcs. Compiled.

Segments are joined by the numbers of the mesh edges on which they end, never by places. A segment has two ends: end
2 i is where segment i starts, end 2 i + 1 where it stops, so that the other end of a segment is ``end ^ 1``.

This module imports numba, so it is imported when something is cut for the first time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiling import kernel, part
from .hand import QUADS

__all__ = ["ALONG", "chain"]

ALONG = 3
"""Column of places after three coordinates: the place on the mesh edge."""

MOST_FREE = 4096
"""Ends of arcs among which bridges are looked for, each with each: a closed mesh leaves some tens."""

BASE, TIP = 0, 2  # sides of a finger's quadrilaterals


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
def _bridge(pieces: Any, ends: Any, places: Any, links: Any, knuckle: float) -> None:
    """Link ends that are left at the palm's borders to ends at the fingers' bases, and others of one joint.

    A stop goes on at the nearest start, and a start at the nearest stop, within ``knuckle`` metres, if each is the
    other's nearest. Ends of one joint that are left differ in the last bits only, which put them in different faces. A
    mesh so torn that more than `MOST_FREE` ends are left is not bridged.
    """
    free = np.empty(len(ends), np.int64)
    n = 0
    for end in range(len(ends)):
        if links[end] < 0 and ends[end, 1] >= 0:
            free[n] = end
            n += 1
    if n > MOST_FREE:
        return
    nearest, distance = np.full(n, -1), np.full(n, knuckle * knuckle)
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
def _walk(pieces: Any, ends: Any, places: Any, links: Any, same: float) -> Any:
    """Follow the links from end to end: arcs as `Arcs` has them, by the first piece of each, which gives the direction.

    An arc without length is left out: it touches the mesh in one point. Ends that are within ``same`` metres of each
    other become one vertex.
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
            if here >= 0 and _apart2(places, stop, here) <= same * same:
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
def chain(pieces: Any, ends: Any, places: Any, hands: bool, quads: int, faces: int, edges: int, knuckle: float,
          same: float, rotation: Any, offset: Any) -> Any:  # fmt: skip
    """Join what `cut.segments` found to arcs. ``knuckle`` and ``same`` are those of `arcs`.

    Returns
    -------
    vertices, starts, closed, faces, quads, edges, along
        As `Arcs` has them.
    """
    links = _link(pieces, ends, hands, quads, faces, edges)
    if hands:
        _bridge(pieces, ends, places, links, knuckle)
    found = _walk(pieces, ends, places, links, same)
    points = found[0]
    for i in range(len(points)):
        x, y, z = points[i]
        for k in range(3):
            points[i, k] = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + offset[k]
    return found
