"""One frame in one compiled call: from quadrilaterals and solids to arcs and control points.

Between the parts of a frame Python would take longer than they do. This module imports numba, so it is imported when
something is touched for the first time.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ...base.compiling import kernel, part
from .cut import cut_all
from .placing import WAIT
from .scene import Scene
from .tracking import carry, follow

__all__ = ["curvature_of", "feel"]


@partial(kernel, error_model="numpy")
def feel(
    boxes: Any,
    links: Any,
    corners: Any,
    names: Any,
    curvature: Any,
    begins: Any,
    which: Any,
    poses: Any,
    quads: Any,
    known: Any,
    poses_before: Any,
    quads_before: Any,
    positions: Any,
    marks: Any,
    fresh: int,
    elapsed: int,
    spacing: float,
    most: int,
) -> Any:
    """What hands feel.

    Parameters
    ----------
    boxes, links, corners, names, curvature, begins, which
        A `Scene`; numba takes arrays one by one much faster.
    poses : (o, 4, 3) float
        Poses of the objects: see `scene.poses`.
    quads : (q, 4, 3) float
        Quadrilaterals of the hands, in metres.
    known, poses_before, quads_before
        What was before: see `tracking.carry`.
    positions, marks, fresh, elapsed, spacing, most
        The last points, and how new ones are placed: see `tracking.follow`.

    Returns
    -------
    vertices, along, names, rows
        The arcs: see `Arcs`.
    positions, amplitudes, marks
        The points that are felt: see `tracking.follow`.
    tracked
        Positions, marks and the next identity of all points, also those that wait.
    """
    scene = Scene(boxes, links, corners, names, curvature, begins, which)
    vertices, along, made_of, rows = cut_all(scene, poses, quads, True)
    curved = curvature_of(scene, along, made_of, rows)
    carried, moved = carry(poses, quads, known, poses_before, quads_before, positions, marks)
    points, amplitudes, marked, fresh = follow(
        vertices=vertices, names=made_of, rows=rows, curvature=curved, spacing=spacing, most=most,
        moved=moved, positions=carried, marks=marks, fresh=fresh, elapsed=elapsed,
    )  # fmt: skip
    shown = np.flatnonzero(marked[WAIT] == 0)
    tracked = points, marked, fresh
    return vertices, along, made_of, rows, points[shown], amplitudes[shown], marked[:WAIT, shown], tracked


@part
def curvature_of(scene: Any, along: Any, names: Any, rows: Any) -> Any:
    """(k,) radians at the vertices of arcs; 0 for a vertex on no edge, and everywhere if the scene has no curvature."""
    curvature = np.zeros(along.size)
    for arc in range(len(rows) - 1 if len(scene.curvature) > 0 else 0):
        first = scene.begins[scene.which[rows[arc, 2]], 2]
        for i in range(rows[arc, 0], rows[arc + 1, 0]):
            if names[i, 2] >= 0:
                edge = first + names[i, 2]
                low, high = scene.curvature[edge, 0], scene.curvature[edge, 1]
                curvature[i] = low + along[i] * (high - low)
    return curvature
