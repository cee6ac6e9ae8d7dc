"""Chains: the segments that quadrilaterals cut out of faces, joined to contiguous arcs. Compiled.

Segments are joined by the numbers of the mesh edges on which they end, never by places. A segment has two ends: end
2 i is the start of segment i, end 2 i + 1 its stop, so that the other end of a segment is ``end ^ 1``.

This module imports numba, so it is imported when something is cut for the first time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.compiling import part
from .arcs import KNUCKLE, SAME
from .hand import QUADS

__all__ = ["ALONG", "append_arcs"]

ALONG = 3
"""Column of places after three coordinates: the place on the mesh edge."""

MOST_FREE = 4096
"""Ends of arcs among which bridges are looked for, each with each: a closed mesh leaves some tens."""

BASE, TIP = 0, 2  # sides of a finger's quadrilaterals
NOWHERE = -1  # node of an end that meets no other


@part
def append_arcs(pieces: Any, ends: Any, places: Any, hands: bool, pose: Any, number: int, vertices: Any, along: Any,
                names: Any, rows: Any, arcs: int) -> Any:  # fmt: skip
    """Join what `cut.segments` found of an object to arcs, and append them to those of other objects.

    Returns vertices, along, names and rows as `Arcs` has them, with room for more, and how many arcs there are.
    """
    nodes = _nodes(pieces, ends, hands)
    links, paired = _paired(nodes)
    if not paired:  # more than two faces meet at an edge: their order decides
        order = np.argsort(np.int64(1 << 32) * pieces[:, 0] + pieces[:, 1])
        both = np.empty(2 * len(order), np.int64)
        both[::2], both[1::2] = 2 * order, 2 * order + 1
        pieces, ends, places, nodes = pieces[order], ends[both], places[both], nodes[both]
        links = _queued(nodes)
    if hands:
        _bridge(pieces, ends, places, links)
    return _walk(pieces, ends, places, links, pose, number, vertices, along, names, rows, arcs)


@part
def _nodes(pieces: Any, ends: Any, hands: bool) -> Any:
    """(2 n,) node of each end: a mesh edge in a quadrilateral, or a face at the border of two of a finger."""
    nodes = np.empty(len(ends), np.int64)
    for end in range(len(ends)):
        quad, face = pieces[end >> 1, 0], pieces[end >> 1, 1]
        side, local = ends[end, 1], quad % QUADS
        if side < 0:
            nodes[end] = 2 * quad << 32 | ends[end, 0]
        elif hands and local > 0 and side == BASE:
            nodes[end] = (2 * quad + 1) << 32 | face
        elif hands and side == TIP and local % 3 != 0:
            nodes[end] = (2 * quad + 3) << 32 | face
        else:
            nodes[end] = NOWHERE
    return nodes


@part
def _table(ends: int) -> Any:
    """An empty hash table for so many ends."""
    size = 4
    while size < 2 * ends:
        size *= 2
    return np.full(size, -1, np.int32)


@part
def _slot(table: Any, nodes: Any, end: int) -> Any:
    """The slot of an end's node: that of the first end there, or a free one."""
    slot = (nodes[end] * 0x9E3779B97F4A7C1 >> 20) & (table.size - 1)
    while table[slot] >= 0 and nodes[table[slot]] != nodes[end]:
        slot = (slot + 1) & (table.size - 1)
    return slot


@part
def _paired(nodes: Any) -> Any:
    """The end that follows each end, (2 n,) int, -1 if an arc ends there; and whether at most a start and a stop meet.

    If more meet, the links are wrong and `_queued` must find them.
    """
    links, table = np.full(nodes.size, -1), _table(nodes.size)
    for end in range(nodes.size):
        if nodes[end] == NOWHERE:
            continue
        slot = _slot(table, nodes, end)
        other = table[slot]
        if other < 0:
            table[slot] = end
        elif links[other] < 0 and (other ^ end) & 1:
            links[end], links[other] = other, end
        else:
            return links, False
    return links, True


@part
def _queued(nodes: Any) -> Any:
    """The links of `_paired`, for any mesh.

    A stop goes on at a start. If more than two faces meet at an edge, they are paired in their order, and only what is
    left pairs starts with starts.
    """
    links, following, table = np.full(nodes.size, -1), np.full(nodes.size, -1), _table(nodes.size)
    heads, tails = np.full(table.size, -1), np.full(table.size, -1)  # of queues of ends that wait
    for end in range(nodes.size):
        if nodes[end] == NOWHERE:
            continue
        slot = _slot(table, nodes, end)
        table[slot] = end
        other = heads[slot]
        if other >= 0 and (other ^ end) & 1:
            links[end], links[other], heads[slot] = other, end, following[other]
        elif other >= 0:
            following[tails[slot]], tails[slot] = end, end
        else:
            heads[slot] = tails[slot] = end
    for slot in range(table.size):
        end = heads[slot]
        while end >= 0 and following[end] >= 0:
            links[end], links[following[end]] = following[end], end
            end = following[following[end]]
    return links


@part
def _bridge(pieces: Any, ends: Any, places: Any, links: Any) -> None:
    """Link ends that are left at the palm's borders to ends at the fingers' bases, and others of one joint.

    A stop goes on at the nearest start, and a start at the nearest stop, within `KNUCKLE`, if each is the other's
    nearest. Ends of one joint that are left differ in the last bits only, which put them in different faces. A mesh so
    torn that more than `MOST_FREE` ends are left is not bridged.
    """
    free, keys = np.empty(MOST_FREE, np.int64), np.empty(MOST_FREE, np.int64)
    n = 0
    for end in range(len(ends)):
        if links[end] < 0 and ends[end, 1] >= 0:
            if n == MOST_FREE:
                return
            free[n], keys[n] = end, pieces[end >> 1, 0] << 32 | pieces[end >> 1, 1] << 1 | (end & 1)
            n += 1
    free = free[:n][np.argsort(keys[:n])]  # of ends at the same distance the first counts
    nearest, distance = np.full(n, -1), np.full(n, KNUCKLE * KNUCKLE)
    for i in range(n):
        base = free[i]
        finger = pieces[base >> 1, 0]
        local = finger % QUADS
        if ends[base, 1] != BASE or local == 0:
            continue
        for j in range(n):
            end = free[j]
            quad, side = pieces[end >> 1, 0], ends[end, 1]
            if (base ^ end) & 1 == 0:
                continue
            if local % 3 == 1:
                if quad != finger - local or side == BASE:
                    continue
            elif quad != finger - 1 or side != TIP:
                continue
            apart = _apart2(places, base, end)
            if apart < distance[i]:
                nearest[i], distance[i] = j, apart
            if apart < distance[j]:
                nearest[j], distance[j] = i, apart
    for i in range(n):
        j = nearest[i]
        if j > i and nearest[j] == i:
            links[free[i]], links[free[j]] = free[j], free[i]


@part
def _apart2(places: Any, one: int, other: int) -> Any:
    """Square of the distance between two ends."""
    x, y, z = places[one, 0] - places[other, 0], places[one, 1] - places[other, 1], places[one, 2] - places[other, 2]
    return x * x + y * y + z * z


@part
def _found(pieces: Any, places: Any, links: Any) -> Any:
    """The arcs, by the first quadrilateral and face of each, whose segment gives the direction.

    An arc without length is left out: it touches the mesh in one point. Returns the end at which each begins, whether
    it is closed, and an upper bound of the number of their vertices.
    """
    n = len(pieces)
    visited = np.zeros(n, np.bool_)
    enters, firsts, closed = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.bool_)
    arcs = room = 0
    for piece in range(n):
        if visited[piece]:
            continue
        enter = 2 * piece
        while links[enter] >= 0 and links[enter] >> 1 != piece:  # back to the beginning
            enter = links[enter] ^ 1
        loop = links[enter] >= 0
        if loop:
            enter = 2 * piece
        here, steps, long = enter, 0, False
        first, key = here, pieces[here >> 1, 0] << 32 | pieces[here >> 1, 1]
        while True:
            at = here >> 1
            visited[at] = True
            steps += 2
            long = long or _apart2(places, here, here ^ 1) > 0
            mine = pieces[at, 0] << 32 | pieces[at, 1]
            if mine < key:
                first, key = here, mine
            stop = here ^ 1
            here = links[stop]
            if here < 0 or here == enter:
                break
        if long:
            if loop:
                enter = first & -2
            elif first & 1:  # its first segment would run backwards
                enter = stop
            enters[arcs], firsts[arcs], closed[arcs] = enter, key, loop
            arcs += 1
            room += steps + 1
    order = np.argsort(firsts[:arcs])
    return enters[order], closed[order], room


@part
def _walk(pieces: Any, ends: Any, places: Any, links: Any, pose: Any, number: int, vertices: Any, along: Any,
          names: Any, rows: Any, arcs: int) -> Any:  # fmt: skip
    """Follow the links from end to end, and write the arcs; as `append_arcs`.

    Ends that are within `SAME` of each other become one vertex.
    """
    enters, closed, room = _found(pieces, places, links)
    k = rows[arcs, 0]
    if k + room > along.size:
        size = 2 * (k + room)
        wider, longer, more = np.empty((size, 3)), np.empty(size), np.empty((size, 3), np.int64)
        wider[:k], longer[:k], more[:k] = vertices[:k], along[:k], names[:k]
        vertices, along, names = wider, longer, more
    if arcs + enters.size >= len(rows):
        lines = np.empty((2 * (arcs + enters.size) + 1, 3), np.int64)
        lines[: arcs + 1] = rows[: arcs + 1]
        rows = lines
    at, owner = np.empty(room, np.int64), np.empty(room, np.int64)  # of each vertex, the end and the segment after it
    bridges = np.zeros(room, np.bool_)
    n = 0
    for arc in range(enters.size):
        rows[arcs, 1], rows[arcs, 2] = closed[arc], number
        here = enters[arc]
        while True:
            at[n], owner[n] = here, here >> 1
            n += 1
            stop = here ^ 1
            here = links[stop]
            if here < 0 or _apart2(places, stop, here) > SAME * SAME:
                at[n], owner[n], bridges[n] = stop, -1 if here < 0 else stop >> 1, here >= 0
                n += 1
            if here < 0 or here == enters[arc]:
                break
        if closed[arc]:
            at[n], owner[n] = here, -1
            n += 1
        arcs += 1
        rows[arcs, 0] = k + n
    for i in range(n):
        end, piece = at[i], owner[i]
        x, y, z = places[end, 0], places[end, 1], places[end, 2]
        for j in range(3):
            vertices[k + i, j] = pose[j, 0] * x + pose[j, 1] * y + pose[j, 2] * z + pose[3, j]
        along[k + i] = places[end, ALONG]
        names[k + i, 0] = pieces[piece, 1] if piece >= 0 and not bridges[i] else -1
        names[k + i, 1] = pieces[piece, 0] if piece >= 0 else -1
        names[k + i, 2] = ends[end, 0]
    return vertices, along, names, rows, arcs
