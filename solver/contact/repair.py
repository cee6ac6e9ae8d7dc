"""Checks and repairs of a triangle mesh, so that it is the surface of an object.

The surface must be closed: each edge is run along as often one way as the other. Bodies may touch, and be hollow.
Repairs leave the shape as it can be felt: none moves a surface by more than a rounding error, except that cracks
narrower than a wavelength are closed.
"""

from __future__ import annotations

import itertools
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .edges import edge_tables

__all__ = ["WIDEST_CRACK", "OpenSurfaceError", "repair"]

WIDEST_CRACK = 8.6e-3
"""Width in metres up to which holes are closed: the wavelength of 40 kHz in air, below which nothing can be felt."""
ROUNDING = 1e-6
"""Of the mesh's extent: vertices this close together are one, if the mesh is open otherwise. Files hold 32 bits."""
SMALLEST = 1e-6
"""Extent of a mesh in metres."""
FLAT = 1e-9
"""Of the area to the power 3/2: a smaller volume counts as none."""
MOST_OPEN_EDGES = 10_000
"""Of all holes together; a mesh with more is not a surface with holes, but many pieces of one."""
TRIED = 30_000
"""Faces of a large mesh that are looked at before any repair is tried, which takes a minute for a million faces."""
CHUNK = 100_000
"""Faces that are looked at together, so that it takes little memory."""
NEAR = 16 * ROUNDING
"""Of the mesh's extent: edges whose middles are farther apart do not become one."""
MOST_BODIES = 10_000
"""Separate surfaces of a mesh; more are noise."""
SHEET = "it encloses no volume: it is a sheet, and an object must have an inside"

Points: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]


class OpenSurfaceError(ValueError):
    """A surface that bounds no body, but can be felt if it may be open."""


def repair(vertices: Points, faces: Indices, *, may_be_open: bool = False) -> tuple[Points, Indices, tuple[str, ...]]:
    """Make a closed surface of triangles, its faces counterclockwise as seen from outside.

    Identical vertices become one, and what no face uses is left out, as any list of separate triangles needs. Beyond
    that, each of these repairs is reported:

    - faces without a third corner, and all but one of the faces with the same corners, are removed;
    - if the mesh is open, vertices that are closer together than `ROUNDING` times its extent become one;
    - faces are turned so that neighbours agree, and bodies so that they are not inside out; a body inside another one
      is a cavity and may be;
    - holes that are no wider than `WIDEST_CRACK` are closed by a fan of triangles. The width of a hole is its second
      extent: that of a crack is small, however long it is.

    Parameters
    ----------
    vertices : (v, 3) float
        Vertices in metres.
    faces : (f, 3) int
        Vertices of each triangle.
    may_be_open : bool
        Whether a surface with wide holes, or a sheet without an inside, is left as it is.

    Returns
    -------
    vertices, faces
        The surface.
    repairs : tuple of str
        A clause for each kind of repair, such as "2 duplicate faces removed".

    Raises
    ------
    ValueError
        If the surface is open otherwise, has no inside, or falls into too many bodies; the message says where and how
        much.
    """
    notes: list[str] = []
    extent = float(np.ptp(vertices, axis=0).max())
    if extent < SMALLEST:
        raise ValueError(f"it is {extent:.3g} m large, too small to be felt; is its unit the metre?")
    _refuse_loose(vertices, faces, NEAR * extent)
    vertices, faces = _compact(vertices, faces, vertices + 0.0)  # +0: minus zero is zero
    faces = _without_doubles(faces, len(vertices), notes)
    if _unbalanced(faces, len(vertices)).size:
        faces = _oriented(faces, len(vertices), notes)
    if (loose := _unbalanced(faces, len(vertices))).size:
        before = len(vertices)
        vertices, faces = _welded(vertices, faces, np.unique(loose), ROUNDING * extent)
        if len(vertices) < before:
            notes.append(f"{before - len(vertices)} vertices merged with others within {ROUNDING * extent:.2g} m")
            faces = _oriented(_without_doubles(faces, len(vertices), notes), len(vertices), notes)
    try:
        if (open_edges := _unbalanced(faces, len(vertices))).size:
            vertices, faces = _closed(vertices, faces, open_edges, notes)
            faces = _without_doubles(faces, len(vertices), notes)  # a lid on a single face is its other side
        if _unbalanced(faces, len(vertices)).size:
            raise OpenSurfaceError("its faces overlap in a way that bounds no body")
        vertices, faces = _used(vertices, faces)
        return vertices, _outward(vertices, faces, notes), tuple(notes)
    except OpenSurfaceError:
        if not may_be_open:
            raise
        notes.append(f"{_counted(len(_unbalanced(faces, len(vertices))), 'open edge')} left: it is a surface, no body")
        return *_used(vertices, faces), tuple(notes)


def _refuse_loose(vertices: Points, faces: Indices, near: float) -> None:
    """Raise `ValueError` if so many edges lie near no other that `_closed` would refuse the mesh."""
    if len(faces) <= TRIED:
        return
    tried = faces[np.linspace(0, len(faces) - 1, TRIED, dtype=np.int64)]
    long = np.ptp(vertices[tried], axis=1).max(axis=1) > near
    lowest, size = vertices.min(axis=0), 2 * near
    mine = _middles(vertices, tried[long], lowest) / size
    # Another middle that is near is in one of the eight cells around the corner of cells that is nearest to this one.
    corner = np.floor(mine + 0.5).astype(np.int64)
    around = np.array(list(itertools.product((-1, 0), repeat=3)))
    wanted, edge = np.unique(_cells(corner[:, None] + around), return_inverse=True)
    held = np.zeros(len(wanted), dtype=np.int64)
    for part in np.array_split(faces, math.ceil(len(faces) / CHUNK)):
        cells = _cells(np.floor(_middles(vertices, part, lowest) / size).astype(np.int64))
        at = np.minimum(np.searchsorted(wanted, cells), len(wanted) - 1)
        held += np.bincount(at[wanted[at] == cells], minlength=len(wanted))
    alone = int((held[edge.reshape(len(mine), 8)].sum(axis=1) < 2).sum())
    if alone > MOST_OPEN_EDGES:
        raise ValueError(
            f"it is not closed: of {len(mine)} edges that were looked at, {alone} are open; at most "
            f"{MOST_OPEN_EDGES} of all may be: it is a set of loose triangles"
        )


def _middles(vertices: Points, faces: Indices, origin: Points) -> Points:
    """(3 f, 3) middles of the edges of faces, as seen from an origin."""
    corners = vertices[faces] - origin
    middles: Points = ((corners + np.roll(corners, -1, axis=1)) / 2).reshape(-1, 3)
    return middles


def _cells(places: Indices) -> Indices:
    """A number for each (…, 3) cell of a grid, of fewer than 2²⁰ each way."""
    numbers: Indices = places @ np.array([1 << 42, 1 << 21, 1])
    return numbers.ravel()


def _counted(count: int, one: str, many: str | None = None) -> str:
    return f"{count} {one}" if count == 1 else f"{count} {many or one + 's'}"


def _rows(keys: NDArray[np.generic]) -> NDArray[np.generic]:
    """Each row as one value, which sorts much faster than rows do."""
    return np.ascontiguousarray(keys).view(np.dtype((np.void, keys.dtype.itemsize * keys.shape[1]))).ravel()


def _compact(vertices: Points, faces: Indices, keys: NDArray[np.generic]) -> tuple[Points, Indices]:
    """Vertices with the same row of keys become the first of them."""
    _, first, which = np.unique(_rows(keys), return_index=True, return_inverse=True)
    return _used(vertices, first[which][faces])


def _used(vertices: Points, faces: Indices) -> tuple[Points, Indices]:
    """The vertices that faces use, and the faces with these."""
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def _without_doubles(faces: Indices, vertices: int, notes: list[str]) -> Indices:
    """The faces with three different corners, each set of corners once; none of a set that is a wall inside a body."""
    corners = np.sort(faces, axis=1)
    proper = (corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2])
    if not proper.any():
        raise ValueError("none of its faces has an area")
    if removed := int((~proper).sum()):
        notes.append(f"{_counted(removed, 'face')} without area removed")
        faces, corners = faces[proper], corners[proper]
    _, first, which, uses = np.unique(_rows(corners), return_index=True, return_inverse=True, return_counts=True)
    if len(first) == len(faces):
        return faces
    turned = np.linalg.det(np.eye(3)[np.argsort(np.argsort(faces, axis=1), axis=1)]) < 0
    net = np.bincount(which, weights=np.where(turned, -1, 1))
    single = faces[first]
    _, face_edges, _ = edge_tables(single, vertices)
    odd = (np.bincount(face_edges.ravel()) % 2 == 1)[face_edges].any(axis=1)
    kept: Indices = single[~((uses > 1) & (net == 0) & odd)]
    if not len(kept):
        raise OpenSurfaceError(SHEET)
    notes.append(f"{_counted(len(faces) - len(kept), 'duplicate face')} removed")
    return kept


def _unbalanced(faces: Indices, vertices: int) -> Indices:
    """(k, 2) directed edges, from and to, that faces run along more often than the other way; repeated as often."""
    edges, face_edges, _ = edge_tables(faces, vertices)
    forward = np.where(faces < np.roll(faces, -1, axis=1), 1, -1)
    surplus = np.bincount(face_edges.ravel(), weights=forward.ravel(), minlength=len(edges)).astype(np.int64)
    directed = np.where((surplus < 0)[:, None], edges[:, ::-1], edges)
    return np.repeat(directed, np.abs(surplus), axis=0)


def _oriented(faces: Indices, vertices: int, notes: list[str]) -> Indices:
    """The faces, turned so that neighbours run along their common edge in opposite directions.

    Each face stands twice in a graph, as it is and turned, and each edge of two faces joins what agrees. A connected
    part then is a surface with one orientation; of its two orientations the one that turns fewer faces is chosen.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(faces)
    _, face_edges, edge_faces = edge_tables(faces, vertices)
    forward = (faces < np.roll(faces, -1, axis=1)).ravel()
    signed = np.bincount(face_edges.ravel(), weights=np.where(forward, 1, -1))
    pairs = np.bincount(face_edges.ravel()) == 2
    (one, other), turned = edge_faces[pairs].T, signed[pairs] != 0
    joined = np.where(turned, other + count, other), np.where(turned, other, other + count)
    ends = np.concatenate([one, one + count]), np.concatenate(joined)
    _, part = connected_components(coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(2 * count, 2 * count)))
    as_is, mirrored = part[:count], part[count:]
    if (as_is == mirrored).any():
        raise ValueError("its faces cannot be turned so that neighbours agree: it has one side only, as a Möbius strip")
    faces_of_part = np.bincount(as_is, minlength=2 * count)
    difference = faces_of_part[as_is] - faces_of_part[mirrored]
    turn = (difference < 0) | ((difference == 0) & (mirrored < as_is))
    if turn.any():
        notes.append(f"{_counted(int(turn.sum()), 'face')} turned to agree with the others")
    agreeing: Indices = np.where(turn[:, None], faces[:, ::-1], faces)
    return agreeing


def _welded(vertices: Points, faces: Indices, loose: Indices, distance: float) -> tuple[Points, Indices]:
    """Vertices of a list that share a cell of one of eight grids, shifted by half a cell each way, become one."""
    which, places = np.arange(len(vertices)), (vertices - vertices.min(axis=0)) / (2 * distance)
    for shift in itertools.product((0.0, 0.5), repeat=3):
        cells = np.floor(places[which[loose]] + shift).astype(np.int64)
        _, first, cell = np.unique(_cells(cells), return_index=True, return_inverse=True)
        target = np.arange(len(vertices))
        target[which[loose]] = which[loose][first][cell]
        which = target[which]
    return _compact(vertices, faces, which[:, None])


def _closed(vertices: Points, faces: Indices, open_edges: Indices, notes: list[str]) -> tuple[Points, Indices]:
    """The mesh with its narrow holes closed; `ValueError` if there are wide ones."""
    if len(open_edges) > MOST_OPEN_EDGES:
        raise OpenSurfaceError(f"it is not closed: {len(open_edges)} edges are open; at most {MOST_OPEN_EDGES} may be")
    loops = _loops(open_edges)
    widths = [_width(vertices[loop]) for loop in loops]
    if max(widths) > WIDEST_CRACK:
        wide = [(width, loop) for width, loop in zip(widths, loops, strict=True) if width > WIDEST_CRACK]
        width, loop = max(wide, key=lambda hole: hole[0])
        x, y, z = np.round(vertices[loop].mean(axis=0), 4)
        raise OpenSurfaceError(
            f"it is not closed: it has {_counted(len(wide), 'hole')}; the widest has {len(loop)} open edges, is "
            f"{1000 * width:.3g} mm wide and lies around ({x:g}, {y:g}, {z:g}) m (only holes up to "
            f"{1000 * WIDEST_CRACK:g} mm are closed here)"
        )
    new_vertices, new_faces, count = [vertices], [faces], len(vertices)
    for loop in loops:
        if len(loop) == 3:
            new_faces.append(loop[None, ::-1])
            continue
        new_vertices.append(vertices[loop].mean(axis=0, keepdims=True))
        new_faces.append(np.stack([np.roll(loop, -1), loop, np.full(len(loop), count)], axis=1))
        count += 1
    notes.append(f"{_counted(len(loops), 'hole')} closed, up to {1000 * max(widths):.2g} mm wide")
    return np.concatenate(new_vertices), np.concatenate(new_faces)


def _loops(directed: Indices) -> list[Indices]:
    """Simple loops of (k, 2) directed edges; as many of them begin at each vertex as end there."""
    onward: dict[int, list[int]] = {}
    for begin, end in directed.tolist():
        onward.setdefault(begin, []).append(end)
    loops = []
    for start in onward:
        path, place = [start], {start: 0}
        while onward[path[-1]]:
            vertex = onward[path[-1]].pop()
            if vertex in place:  # a loop is complete: it leaves the path
                loops.append(np.array(path[place[vertex] :], dtype=np.int64))
                for passed in path[place[vertex] + 1 :]:
                    del place[passed]
                del path[place[vertex] + 1 :]
            else:
                place[vertex] = len(path)
                path.append(vertex)
    return loops


def _width(corners: Points) -> float:
    """The extent in metres of (k, 3) corners along the second of their principal axes."""
    centred = corners - corners.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return float(np.ptp(centred @ axes[:, 1]))


def _outward(vertices: Points, faces: Indices, notes: list[str]) -> Indices:
    """The faces, turned so that every body that lies in no other has a positive volume."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    links = coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(len(vertices), len(vertices)))
    bodies, part = connected_components(links, directed=False)
    if bodies > MOST_BODIES:
        raise ValueError(f"it falls into {bodies} separate bodies; at most {MOST_BODIES} are possible: remove specks")
    body = part[faces[:, 0]]
    triangles = (vertices - vertices.mean(axis=0))[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2
    volumes = np.bincount(body, weights=(triangles[:, 0] * normals).sum(axis=1) / 3)
    if np.abs(volumes).sum() <= FLAT * np.linalg.norm(normals, axis=1).sum() ** 1.5:
        raise OpenSurfaceError(SHEET)
    low, high = (np.full((bodies, 3), bound) for bound in (np.inf, -np.inf))
    np.minimum.at(low, part, vertices)
    np.maximum.at(high, part, vertices)
    inverted = [
        which
        for which in np.flatnonzero(volumes < 0)
        if not ((low < low[which]) & (high > high[which])).all(axis=1).any()
    ]
    if not inverted:
        return faces
    notes.append(f"{_counted(len(inverted), 'body', 'bodies')} turned, having been inside out")
    return np.where(np.isin(body, inverted)[:, None], faces[:, ::-1], faces)
