"""Curvature of a mesh's edges: the indicator that the density of control points follows (section 4.2 of the paper).

The paper takes the angular defects of vertices and interpolates them along edges. That alone depends on the
triangulation: a vertex in the middle of a cube's edge has no defect, so a divided edge would seem flat there; and each
of the many edges that lead to the tip of a cone would seem sharp along half of its length. So the indicator of an edge
is its dihedral angle, the angle by which the surface turns across it, which no division changes. If that angle is
sharp, the paper's defects raise it towards true corners. On a tessellation of a smooth surface all values tend to zero
as it is refined. Edges inside flat faces have none, however the faces are divided.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry import frozen

__all__ = ["FLAT", "SHARP", "angular_defects", "dihedral_angles", "edge_curvature"]

FLAT = 1e-3
"""Dihedral angle in radians below which two faces are one: more than what float32 files make of coplanar faces."""

SHARP = np.pi / 6
"""Dihedral angle in radians from which an edge is a feature of the shape and not of its tessellation; 30° is the usual
feature angle of programs for meshes."""

STRAIGHT = 1e-3
"""Angle in radians by which a divided edge may turn at a vertex and still be one edge."""

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def edge_curvature(vertices: Floats, faces: Indices, edges: Indices, edge_faces: Indices) -> Floats:
    """The curvature indicator (e, 2) at both ends of each edge, in radians; between them it is linear.

    ``edges`` (e, 2) are vertices, and ``edge_faces`` (e, 2) faces at each edge, -1 if there is no second one. The
    indicator is 0 for edges inside flat faces, whose dihedral angle is less than `FLAT`, and the dihedral angle for
    edges of less than `SHARP`. Sharp edges that continue each other in a straight line are one edge between two
    corners: at a corner the value is the dihedral angle or the magnitude of the corner's angular defect, whichever is
    more, and along the line it is linear.
    """
    angles = dihedral_angles(vertices, faces, edge_faces)
    values = np.repeat(np.where(angles < FLAT, 0, angles)[:, None], 2, axis=1)
    sharp = np.flatnonzero(angles >= SHARP)
    if sharp.size:
        defects = np.abs(angular_defects(vertices, faces, edges, edge_faces))
        values[sharp] = _along_lines(vertices, edges[sharp], angles[sharp], defects)
    return frozen(values)


def dihedral_angles(vertices: Floats, faces: Indices, edge_faces: Indices) -> Floats:
    """(e,) angles in radians, 0 to π, between the normals of the faces at each edge; π at the border of a surface."""
    corners = vertices[faces]
    normals = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    one, other = normals[edge_faces[:, 0]], normals[edge_faces[:, 1]]
    angles = np.arctan2(np.linalg.norm(_cross(one, other), axis=1), np.einsum("ek,ek->e", one, other))
    angles[edge_faces[:, 1] < 0] = np.pi
    return np.asarray(angles)


def angular_defects(vertices: Floats, faces: Indices, edges: Indices, edge_faces: Indices) -> Floats:
    """(v,) radians by which the angles of the faces around each vertex fall short of 2π, or of π on a border.

    Those of a closed surface sum to 2π times its Euler characteristic (Descartes), 4π if it is like a ball.
    """
    around = np.zeros(len(vertices))
    corners = vertices[faces]
    for corner in range(3):
        to_next = corners[:, (corner + 1) % 3] - corners[:, corner]
        to_last = corners[:, (corner + 2) % 3] - corners[:, corner]
        sine, cosine = np.linalg.norm(_cross(to_next, to_last), axis=1), np.einsum("fk,fk->f", to_next, to_last)
        around += np.bincount(faces[:, corner], np.arctan2(sine, cosine), len(vertices))
    whole = np.full(len(vertices), 2 * np.pi)
    whole[edges[edge_faces[:, 1] < 0]] = np.pi
    whole[np.bincount(faces.ravel(), minlength=len(vertices)) == 0] = 0  # a vertex that no face uses
    return np.asarray(whole - around)


def _along_lines(vertices: Floats, edges: Indices, angles: Floats, defects: Floats) -> Floats:
    """(s, 2) values of sharp edges: linear between the corners at both ends of the straight line that each is part of.

    Each edge is walked along in both directions at once, and each step is as long as all the steps before it together.
    """
    count = len(edges)
    ends = np.concatenate([edges[:, 1], edges[:, 0]])  # of 2s directed edges: first as they are, then reversed
    reverse = np.concatenate([np.arange(count, 2 * count), np.arange(count)])
    offset = vertices[ends] - vertices[ends[reverse]]
    lengths = np.linalg.norm(offset, axis=1)
    following = _continuations(len(vertices), ends, reverse, offset / np.maximum(lengths, 1e-300)[:, None])
    here = np.arange(2 * count)
    beyond = np.zeros(2 * count)  # metres from the end of each directed edge to the corner
    last = np.where(following < 0, here, following)
    beyond[following >= 0] = lengths[following[following >= 0]]
    for _ in range(int(2 * count).bit_length()):  # a line that never ends is a loop; its angles alone count then
        if not (following[last] >= 0).any():
            break
        beyond += beyond[last]
        last = last[last]
    endless = following[last] >= 0
    peaks = np.maximum(np.tile(angles, 2), np.where(endless, 0, defects[ends[last]]))
    forward, back = slice(0, count), slice(count, 2 * count)
    whole = beyond[back] + lengths[forward] + beyond[forward]
    slope = (peaks[forward] - peaks[back]) / np.maximum(whole, 1e-300)
    return np.stack(
        [peaks[back] + slope * beyond[back], peaks[back] + slope * (beyond[back] + lengths[forward])], axis=1
    )


def _continuations(vertices: int, ends: Indices, reverse: Indices, directions: Floats) -> Indices:
    """The directed edge that continues each one straight on, -1 if it ends at a corner.

    A straight line goes on at a vertex if just two sharp edges meet there, in opposite directions.
    """
    passes = np.flatnonzero(np.bincount(ends, minlength=vertices)[ends] == 2)
    order = passes[np.argsort(ends[passes], kind="stable")]  # the two that arrive at each vertex, side by side
    one, other = order[0::2], order[1::2]
    straight = np.linalg.norm(directions[one] + directions[other], axis=1) < STRAIGHT
    one, other = one[straight], other[straight]
    following = np.full(len(ends), -1)
    following[one], following[other] = reverse[other], reverse[one]
    return following


def _cross(one: Floats, other: Floats) -> Floats:
    """The cross product of (k, 3) vectors, three times as fast as `numpy.cross`."""
    x, y, z = one.T
    a, b, c = other.T
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=1)
