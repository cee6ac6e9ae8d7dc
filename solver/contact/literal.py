"""The same cuts as `cut` and `chain` make, as plainly as possible: every face is tried, and dictionaries join segments.

This is what the compiled ones are tested against. It takes a hundred times as long.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arcs import KNUCKLE, SAME, Arcs
from .hand import QUADS
from .mesh import Mesh, Solid

__all__ = ["cut"]

Vector: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class End:
    """An end of a segment: a mesh edge and the place on it, or a side of the quadrilateral."""

    place: Vector
    edge: int = -1
    along: float = 0.0
    side: int = -1


@dataclass(frozen=True, eq=False)
class CutSegment:
    """What a quadrilateral cuts out of a face."""

    quad: int
    face: int
    ends: tuple[End, End]


Half: TypeAlias = tuple[int, int]  # a segment, and 0 for its start or 1 for its stop


def cut(quads: ArrayLike, meshes: Sequence[Mesh], hands: bool = False) -> Arcs:
    """The `cut.cut` of several meshes."""
    return Arcs.joined([_cut_mesh(np.array(quads, dtype=np.float64), mesh, hands) for mesh in meshes])


def _cut_mesh(quads: Vector, mesh: Mesh, hands: bool) -> Arcs:
    turned = (quads - mesh.offset) @ mesh.rotation
    faces = _proper(mesh.faces)
    segments = [
        segment
        for number, quad in enumerate(turned)
        if _has_area(quad)
        for face, heights in _crossed(quad, mesh.solid, faces)
        if (segment := _segment(number, quad, mesh.solid, face, heights)) is not None
    ]
    links = _links(segments, hands)
    if hands:
        links |= _bridges(segments, links)
    vertices, starts, closed, rows = [], [0], [], []
    for halves in _walks(segments, links):
        loop = links.get(halves[0]) == _other(halves[-1])
        for half, following in zip(halves, [*halves[1:], halves[0] if loop else None], strict=True):
            segment, stop = segments[half[0]], segments[half[0]].ends[1 - half[1]]
            entered = [segment.ends[half[1]]]
            if following is not None and _distance(stop, segments[following[0]].ends[following[1]]) > SAME:
                entered.append(stop)
            for end, face in zip(entered, (segment.face, -1), strict=False):
                vertices.append(end.place)
                rows.append((face, segment.quad, end.edge, end.along))
        last = segments[halves[0][0]].ends[halves[0][1]] if loop else stop
        vertices.append(last.place)
        rows.append((-1, -1, last.edge, last.along))
        starts.append(len(vertices))
        closed.append(loop)
    *names, along = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    return Arcs(
        np.array(vertices).reshape(-1, 3) @ mesh.rotation.T + mesh.offset,
        along,
        np.stack(names, axis=1).astype(np.int64),
        np.stack([starts, [*closed, -1], [*(0 for _ in closed), -1]], axis=1),
    )


def _proper(faces: NDArray[np.int64]) -> list[int]:
    """The faces with three vertices, of those with the same three the first."""
    seen: dict[frozenset[int], int] = {}
    for number, face in enumerate(faces):
        corners = frozenset(face.tolist())
        if len(corners) == 3:
            seen.setdefault(corners, number)
    return sorted(seen.values())


def _normal(quad: Vector) -> Vector:
    return np.cross(quad[2] - quad[0], quad[3] - quad[1])


def _has_area(quad: Vector) -> bool:
    squares = np.sum((quad[2] - quad[0]) ** 2) + np.sum((quad[3] - quad[1]) ** 2)
    return bool(np.linalg.norm(_normal(quad)) > 1e-12 * squares)


def _crossed(quad: Vector, solid: Solid, faces: list[int]) -> Iterator[tuple[int, Vector]]:
    """The faces that have corners above and below the plane, and how high these are."""
    normal = _normal(quad)
    heights = (solid.vertices[solid.faces[faces]] - quad[0]) @ normal
    heights[np.abs(heights) <= 1e-12 * np.abs(quad).max() * np.linalg.norm(normal)] = 0
    above = heights >= 0
    for i in np.flatnonzero(above.any(axis=1) & ~above.all(axis=1)):
        yield faces[i], heights[i]


def _segment(number: int, quad: Vector, solid: Solid, face: int, heights: Vector) -> CutSegment | None:
    """Two edges of a face cross the plane: one goes down, which starts the segment, and one goes up."""
    corners, above = solid.faces[face], heights >= 0
    down = next(k for k in range(3) if above[k] and not above[(k + 1) % 3])
    up = next(k for k in range(3) if not above[k] and above[(k + 1) % 3])
    crossings = []
    for k in (down, up):
        (i, di), (j, dj) = sorted(zip(corners[[k, (k + 1) % 3]], heights[[k, (k + 1) % 3]], strict=True))
        share = di / (di - dj)
        place = (1 - share) * solid.vertices[i] + share * solid.vertices[j]
        off = [_off(quad, side, solid.vertices[i], solid.vertices[j], di, dj) for side in range(4)]
        crossings.append((End(place, int(solid.face_edges[face, k]), float(share)), off))
    (start, start_off), (stop, stop_off) = crossings
    entry, leave = (0.0, -1), (1.0, -1)
    for side, ((a, a_inside), (b, b_inside)) in enumerate(zip(start_off, stop_off, strict=True)):
        if not a_inside and not b_inside:
            return None
        if a_inside != b_inside:
            share = a / (a + b) if a + b > 0 else 0.5
            if b_inside and share >= entry[0]:
                entry = share, side
            elif a_inside and share <= leave[0]:
                leave = share, side
    if entry[0] > leave[0] or (entry[0] == leave[0] and entry[1] >= 0 and leave[1] >= 0):
        return None
    ends = tuple(
        whole if side < 0 else End((1 - share) * start.place + share * stop.place, side=side)
        for whole, (share, side) in ((start, entry), (stop, leave))
    )
    return CutSegment(number, face, (ends[0], ends[1]))


def _off(quad: Vector, side: int, u: Vector, v: Vector, du: float, dv: float) -> tuple[float, bool]:
    """Distance of a mesh edge's crossing from a border, times the border's length, and whether it is inside."""
    a, b = quad[side], quad[(side + 1) % 4]
    if (a == b).all():
        return np.inf, True
    first, second = sorted([a, b], key=tuple)
    volume = np.dot(second - first, np.cross(u - first, v - first))
    inside = (volume >= 0) == (first is a)
    return abs(volume / (du - dv)), bool(inside == (du < 0))


def _node(segment: CutSegment, end: End, hands: bool) -> Hashable:
    """Node at which ends meet: a mesh edge in a quadrilateral, a face at the border of two of a finger, or None."""
    if end.side < 0:
        return "edge", segment.quad, end.edge
    joint = _joint(segment.quad, end.side) if hands else None
    return None if joint is None else ("joint", joint, segment.face)


def _joint(quad: int, side: int) -> int | None:
    """The quadrilateral of a finger whose base a side is."""
    local = quad % QUADS
    if local == 0:
        return None
    if side == 0:
        return quad
    return quad + 1 if side == 2 and local % 3 != 0 else None


def _links(segments: list[CutSegment], hands: bool) -> dict[Half, Half]:
    """The end that follows each end: at each node starts and stops are paired in order, then those that are left."""
    nodes = defaultdict(list)
    for i, segment in enumerate(segments):
        for which in range(2):
            nodes[_node(segment, segment.ends[which], hands)].append((i, which))
    nodes.pop(None, None)
    links = {}
    for met in nodes.values():
        starts, stops = ([half for half in met if half[1] == which] for which in range(2))
        left = starts[len(stops) :] + stops[len(starts) :]
        for one, other in [*zip(starts, stops, strict=False), *zip(left[::2], left[1::2], strict=False)]:
            links[one], links[other] = other, one
    return links


def _bridges(segments: list[CutSegment], links: dict[Half, Half]) -> dict[Half, Half]:
    """Ends at the bases of fingers, with the end next to each if each is the other's nearest."""

    def end(half: Half) -> End:
        return segments[half[0]].ends[half[1]]

    free = [(i, which) for i in range(len(segments)) for which in range(2)]
    free = [half for half in free if half not in links and end(half).side >= 0]
    bases = [half for half in free if end(half).side == 0 and segments[half[0]].quad % QUADS != 0]
    near = defaultdict(list)
    for base in bases:
        finger = segments[base[0]].quad
        for half in free:
            quad, side = segments[half[0]].quad, end(half).side
            of_palm = quad == finger - finger % QUADS and side != 0 and finger % QUADS % 3 == 1
            of_finger = quad == finger - 1 and side == 2 and finger % QUADS % 3 != 1
            distance = _distance(end(base), end(half))
            if half[1] != base[1] and (of_palm or of_finger) and distance < KNUCKLE:
                near[base].append((distance, half))
                near[half].append((distance, base))
    nearest = {half: min(others)[1] for half, others in near.items()}
    return {half: other for half, other in nearest.items() if nearest[other] == half}


def _distance(one: End, other: End) -> float:
    return float(np.linalg.norm(one.place - other.place))


def _other(half: Half) -> Half:
    return half[0], 1 - half[1]


def _walks(segments: list[CutSegment], links: dict[Half, Half]) -> Iterator[list[Half]]:
    """The segments of each arc, each as the end by which it is entered; not those of arcs without length."""
    visited: set[int] = set()
    for first in range(len(segments)):
        if first in visited:
            continue
        half = (first, 0)
        while half in links and links[half][0] != first:
            half = _other(links[half])
        enter = (first, 0) if half in links else half
        walk = [enter]
        while (following := links.get(_other(walk[-1]))) is not None and following != enter:
            walk.append(following)
        visited |= {i for i, _ in walk}
        if any(_distance(*segments[i].ends) > 0 for i, _ in walk):
            yield walk
