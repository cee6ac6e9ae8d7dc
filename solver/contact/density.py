"""Compiled kernels that divide arcs into control points, densely at edges and corners (section 4.2 of the paper).

Along an arc, points stand at equal steps of the integral of their density. Without corners the density is one point for
each spacing. With corners, equation (13) raises it towards the mesh's edges by their curvature κ:

    κ(t) = κ₀·e^{-c(t - t₀)} + κ₁·e^{-c(t₁ - t)}

on each piece between two edges that have a curvature, with t the arc length; the end that a quadrilateral's border cuts
off has none. Edges inside flat faces have none either and end no piece, so the triangulation of a face is not felt.
The density grows linearly with κ, from its minimum at 0 to one point for each `CLOSEST` at `FULL`. If the values at
the ends of a piece are so large that κ exceeds `FULL` there, both are lowered alike.

A crossing of a sharp edge carries a point itself, an anchor, unless it is within `SLIGHT` of an arc's end, at which its
curvature fades. So an arc falls into stretches between anchors and ends:

- between two anchors, steps are whole;
- an end is half a step away from its nearest point, so that each point stands for one step of arc, and arcs that end
  side by side at the border of two quadrilaterals do not crowd there;
- on a closed arc without an anchor, steps are whole, and the point that they begin with is free.

Kernels see arrays that the caller has checked; they do not check indices.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...base.compiling import part
from .curvature import SHARP

__all__ = ["CLOSEST", "FULL", "SLIGHT", "arrange", "counts", "locate", "measure", "strength", "stretches"]

CLOSEST = 6e-3
"""Least mean distance in metres between points on a stretch: where points crowd under some 6 mm, solving needs
regularisation (docs/explanation/reproduction.md), and a focus of the paper's array is wider."""

SLIGHT = 3e-3
"""Length in metres that an arc must have to be felt, and by which a sharp edge must be inside an arc's end to be an
anchor: what the border of a quadrilateral just reaches would come and go as a hand trembles."""

FULL = math.pi / 2
"""Curvature in radians from which a point is as near to the next as it may be: that of a cube's edges and corners."""

FADING = 0.5  # of the spacing: the length in which κ falls to 1/e, so that it is 0.3 % in the middle of a 10 cm face
SHARPER = 1.05  # of two crossings too close for two points the first is taken, unless the second is this much sharper
HOLD = 0.5  # of a step: by how much more than half a step a stretch must change before its number of points does
SLACK = 1.5  # by how much steps may be longer or shorter than the density says before their number changes
CROWDED = 1 / 3  # of `CLOSEST`: how near to each other points may come that are there already
ROUNDING = 1e-6  # of a step: an exact fit is one
HALVINGS = 24  # of the interval in which `counts` looks for the density that the room allows
ROUNDS = 60  # at most of Newton's iteration in `locate`
NOBODY = -1
OUTWARD = (0.83, 0.49, 0.27)  # a closed arc begins at its farthest vertex in this direction, which no usual face has


@part
def arrange(vertices: Any, names: Any, rows: Any, curvature: Any) -> Any:
    """The arcs without their bridges, which divide them into open ones, and with their lengths.

    A closed arc without a bridge begins at a place that no triangulation decides: at a sharp crossing, if it has one;
    if there are several vertices to begin with, at the farthest in the direction `OUTWARD`.

    Returns of each vertex: its place; the quadrilateral of the piece that begins there, at the last vertex the one that
    ends there; curvature; and arc length from the arc's first vertex, in metres. Then the first vertex of each of these
    arcs, (a + 1,), whether it is closed, and its object.
    """
    points, owners, values = np.empty_like(vertices), np.empty(curvature.size, np.int64), np.empty_like(curvature)
    reached, pieces = np.zeros(curvature.size), len(rows)
    for i in range(curvature.size):
        pieces += names[i, 0] < 0
    starts, closed, objects = np.zeros(pieces, np.int64), np.zeros(pieces, np.bool_), np.empty(pieces, np.int64)
    at = arcs = 0
    for arc in range(len(rows) - 1):
        begin, cycle = rows[arc, 0], rows[arc + 1, 0]
        source, count = begin, cycle - begin
        if rows[arc, 1] == 1:
            cycle -= 1
            source, closed[arcs] = _first_vertex(vertices, curvature, begin, cycle), True
            for i in range(begin, cycle):
                if names[i, 0] < 0:
                    source, count, closed[arcs] = begin if i + 1 == cycle else i + 1, cycle - begin, False
        objects[arcs] = rows[arc, 2]
        for left in range(count - 1, -1, -1):
            for k in range(3):
                points[at, k] = vertices[source, k]
            values[at], owners[at] = curvature[source], names[source, 1]
            if at > starts[arcs]:
                x, y, z = (points[at, 0] - points[at - 1, 0], points[at, 1] - points[at - 1, 1],
                           points[at, 2] - points[at - 1, 2])  # fmt: skip
                reached[at] = reached[at - 1] + math.sqrt(x * x + y * y + z * z)
            at += 1
            if left == 0 or names[source, 0] < 0:
                if at - starts[arcs] > 1:
                    owners[at - 1] = owners[at - 2]
                arcs += 1
                starts[arcs] = at
                if left > 0:
                    objects[arcs] = rows[arc, 2]
            source += 1
            if source == cycle:
                source = begin
    return (points[:at], owners[:at], values[:at], reached[:at],
            starts[: arcs + 1].copy(), closed[:arcs].copy(), objects[:arcs].copy())  # fmt: skip


@part
def _first_vertex(vertices: Any, curvature: Any, begin: int, end: int) -> Any:
    first, farthest, is_sharp = begin, -np.inf, False
    for i in range(begin, end):
        sharp = curvature[i] >= SHARP
        distance = vertices[i, 0] * OUTWARD[0] + vertices[i, 1] * OUTWARD[1] + vertices[i, 2] * OUTWARD[2]
        if (sharp and not is_sharp) or (sharp == is_sharp and distance > farthest):
            first, farthest, is_sharp = i, distance, sharp
    return first


@part
def measure(starts: Any, closed: Any, curvature: Any, reached: Any, spacing: Any) -> Any:
    """The integral of the density along arcs: steps from the arc's first vertex to each, (k,).

    Then, (k, 4), of the piece that each vertex begins or is inside: κ₀ and κ₁ in units of `FULL`, lowered if needed,
    and the arc lengths t₀ and t₁ in metres.
    """
    steps, pieces = np.zeros(reached.size), np.zeros((reached.size, 4))
    fade = 1 / (FADING * spacing)
    rise = _gain(spacing) * FADING
    for arc in range(starts.size - 1):
        begin, end = starts[arc], starts[arc + 1] - 1
        while begin < end:
            stop = begin + 1
            while stop < end and curvature[stop] == 0:
                stop += 1
            near = min(curvature[begin] / FULL, 1.0) * _weight(begin, arc, starts, closed, reached)
            far = min(curvature[stop] / FULL, 1.0) * _weight(stop, arc, starts, closed, reached)
            length = reached[stop] - reached[begin]
            lost = -math.expm1(-fade * length) if near + far > 0 else 1.0
            peak = max(near + far * (1 - lost), far + near * (1 - lost), 1.0)
            near, far = near / peak, far / peak
            for i in range(begin, stop + 1):  # the next piece overwrites the last row
                pieces[i, 0], pieces[i, 1] = near, far
                pieces[i, 2], pieces[i, 3] = reached[begin], reached[stop]
            for i in range(begin + 1, stop):
                steps[i] = steps[begin] + _within(pieces[i], reached[i], spacing)
            steps[stop] = steps[begin] + length / spacing + rise * (near + far) * lost
            begin = stop
    return steps, pieces


@part
def _weight(i: Any, arc: Any, starts: Any, closed: Any, reached: Any) -> Any:
    """By how much the curvature at a vertex counts: near to the end of an arc, it fades in with the distance."""
    begin, end = starts[arc], starts[arc + 1] - 1
    if closed[arc] or i in (begin, end):
        return 1.0
    return min(min(reached[i] - reached[begin], reached[end] - reached[i]) / SLIGHT, 1.0)


@part
def _within(piece: Any, place: Any, spacing: Any) -> Any:
    """Steps from the beginning of a piece to a place on it: the integral of the density, in closed form."""
    near, far, begin, end = piece[0], piece[1], piece[2], piece[3]
    steps = (place - begin) / spacing
    if near + far > 0:
        length = FADING * spacing
        rise = near * -math.expm1((begin - place) / length)
        rise += far * (math.exp((place - end) / length) - math.exp((begin - end) / length))
        steps += _gain(spacing) * length / spacing * rise
    return steps


@part
def _gain(spacing: Any) -> Any:
    """By how much the density rises at `FULL`, relative to its minimum."""
    return max(spacing / CLOSEST - 1, 0.0)


@part
def strength(piece: Any, place: Any, spacing: Any) -> Any:
    """κ at a place on a piece, in units of `FULL`, by equation (13)."""
    if piece[0] + piece[1] == 0:
        return 0.0
    length = FADING * spacing
    return piece[0] * math.exp((piece[2] - place) / length) + piece[1] * math.exp((place - piece[3]) / length)


@part
def stretches(starts: Any, closed: Any, curvature: Any, reached: Any, felt: Any, held: Any, spacing: Any) -> Any:
    """Divide the arcs that are felt at their anchors: sharp crossings, the sharper of two too close for two points.

    No sharp crossing that may be an anchor is farther than `CLOSEST` from one. The arcs are as from `arrange`; ``felt``
    (a,) says which have points, and ``held`` (k,) which vertices may be anchors although they are nearer than `SLIGHT`
    to the end of their arc.

    Returns arc, first vertex and last vertex of each stretch, (s, 3), and the distance from each of its ends to the
    point nearest to it, (s, 2), in steps: 1 at an anchor, ½ at an end, 0 at both ends of a closed arc without anchors.
    """
    spans, gaps = np.empty((reached.size + closed.size, 3), np.int64), np.empty((reached.size + closed.size, 2))
    anchors = np.empty(reached.size, np.int64)
    closest, total = min(CLOSEST, spacing), 0
    for arc in range(closed.size):
        if not felt[arc]:
            continue
        begin, end = starts[arc], starts[arc + 1] - 1
        kept, displaced = 0, NOBODY
        for i in range(begin, end if closed[arc] else end + 1):
            margin = min(reached[i] - reached[begin], reached[end] - reached[i])
            inside = closed[arc] or i in (begin, end) or margin >= SLIGHT
            if not (curvature[i] >= SHARP and (inside or held[i])):
                continue
            if kept == 0 or reached[i] - reached[anchors[kept - 1]] >= closest:
                anchors[kept], displaced = i, NOBODY
                kept += 1
            elif curvature[i] > SHARPER * curvature[anchors[kept - 1]] and not (closed[arc] and kept == 1):
                if displaced == NOBODY:
                    displaced, anchors[kept - 1] = anchors[kept - 1], i
                elif reached[i] - reached[displaced] < closest:
                    anchors[kept - 1] = i
                else:  # the one that had displaced it goes, so there is room for it again
                    anchors[kept - 1], anchors[kept], displaced = displaced, i, NOBODY
                    kept += 1
        if closed[arc] and kept > 1 and reached[end] - reached[anchors[kept - 1]] < closest:
            kept -= 1
            if displaced != NOBODY and reached[end] - reached[displaced] >= closest:
                anchors[kept], kept = displaced, kept + 1
        gap, last = (0.0 if closed[arc] else 0.5), begin
        for j in range(kept):
            if anchors[j] > begin:
                spans[total] = arc, last, anchors[j]
                gaps[total] = gap, 1.0
                total += 1
            gap, last = 1.0, anchors[j]
        if last < end or kept == 0:
            spans[total] = arc, last, end
            gaps[total] = gap, (gap if closed[arc] else 0.5)
            total += 1
    return spans[:total].copy(), gaps[:total].copy()


@part
def counts(lengths: Any, steps: Any, gaps: Any, before: Any, room: Any, spacing: Any) -> Any:
    """How many points (s,) are on each stretch between its ends, anchors not counted; at least one without an anchor.

    Of the stretches (s,), ``lengths`` are arc lengths in metres, ``steps`` integrals of the density, ``gaps`` as from
    `stretches`, and ``before`` how many points were there in the frame before, -1 on an arc that is new. That many stay
    as long as they fit within `HOLD` or `SLACK`; else their number becomes the nearest that does. If more are wanted
    than there is ``room`` for, the density of all is lowered alike.
    """
    wanted = np.empty(steps.size, np.int64)
    if _fill(1.0, lengths, steps, gaps, before, spacing, wanted) <= room:
        return wanted
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if _fill(middle, lengths, steps, gaps, before, spacing, wanted) <= room:
            low = middle
        else:
            high = middle
    _fill(low, lengths, steps, gaps, before, spacing, wanted)
    return wanted


@part
def _fill(share: Any, lengths: Any, steps: Any, gaps: Any, before: Any, spacing: Any, wanted: Any) -> Any:
    """Write the counts with a share of the density, and return how many they are together."""
    total, closest = 0, min(CLOSEST, spacing)
    for i in range(steps.size):
        both, mass = gaps[i, 0] + gaps[i, 1], share * steps[i]
        extra = both - 1 if both > 0 else 0.0  # steps that a stretch has more than points
        least = 0 if both > 1 else 1
        count, most = math.floor(mass - extra + 0.5), int(lengths[i] / closest - extra + ROUNDING)
        if before[i] >= 0:
            most = max(most, min(before[i], int(lengths[i] / (CROWDED * closest) - extra)))
            fewest = math.ceil(min(mass - 0.5 - HOLD, mass / SLACK) - extra)
            count = max(fewest, min(before[i], math.floor(max(mass + 0.5 + HOLD, mass * SLACK) - extra)))
        wanted[i] = max(least, min(count, most))
        total += wanted[i]
    return total


@part
def locate(step: Any, first: Any, last: Any, steps: Any, reached: Any, pieces: Any, spacing: Any) -> Any:
    """The arc length at which the integral of the density has a value, between two vertices of an arc."""
    vertex = first + np.searchsorted(steps[first : last + 1], step, side="right") - 1
    vertex = max(first, min(vertex, last - 1))
    low, high = reached[vertex], reached[min(vertex + 1, last)]
    rise = steps[min(vertex + 1, last)] - steps[vertex]
    if rise <= 0:
        return low
    piece, wanted = pieces[vertex], step - steps[vertex]
    place = low + (high - low) * min(max(wanted / rise, 0.0), 1.0)
    if piece[0] + piece[1] == 0:
        return place
    start = _within(piece, low, spacing)
    for _ in range(ROUNDS):
        miss = _within(piece, place, spacing) - start - wanted
        if miss > 0:
            high = place
        else:
            low = place
        better = place - miss * spacing / (1 + _gain(spacing) * strength(piece, place, spacing))
        if not low <= better <= high:
            better = (low + high) / 2
        if abs(better - place) <= 1e-14:
            return better
        place = better
    return place
