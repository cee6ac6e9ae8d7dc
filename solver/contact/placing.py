"""Compiled kernels that place the control points of a frame on its arcs, given the points of the frame before.

The places are those of `density`, but earlier points count: a stretch keeps their number as long as it nearly fits, an
anchor stays although its arc became a little shorter, and the even steps of a closed arc turn with them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...base.compiling import part
from . import density

__all__ = ["ANCHOR", "ID", "OBJECT", "QUAD", "WAIT", "anchors", "before", "felt", "targets", "thinned"]

ID, OBJECT, QUAD, ANCHOR, WAIT = range(5)
"""Rows of marks: identity, object, quadrilateral (hand · 16 + quad), 1 for an anchor and 0 for other points, and the
time in µs after which a new point is felt."""

FRESH = 2 / 3
"""Length of an arc, relative to the spacing, from which it has a point if its hand feels its object elsewhere."""


@part
def felt(starts: Any, reached: Any, touched: Any, olds: Any, places: Any, marks: Any, spacing: float) -> Any:
    """Which arcs have points, and which vertices are near to an anchor of the last frame.

    An arc that has points keeps them. Another one needs the length `density.SLIGHT`; if its hand feels its object
    already, `FRESH` of the spacing.
    """
    long, held = np.empty(starts.size - 1, np.bool_), np.zeros(reached.size, np.bool_)
    for arc in range(long.size):
        least = max(density.SLIGHT, FRESH * spacing) if touched[arc] else density.SLIGHT
        long[arc] = reached[starts[arc + 1] - 1] >= least
    for old in range(olds.size):
        if olds[old] < 0:
            continue
        begin, end = starts[olds[old]], starts[olds[old] + 1]
        long[olds[old]] = True
        if marks[ANCHOR, old]:
            for i in range(begin, end):
                held[i] |= abs(reached[i] - places[old]) <= density.SLIGHT
    return long, held


@part
def before(spans: Any, arcs: Any, reached: Any, olds: Any, places: Any, taken: Any) -> Any:
    """How many earlier points are on each stretch that no anchor takes; -1 on an arc without any earlier points."""
    known, free = np.zeros(arcs, np.bool_), np.ones(olds.size, np.bool_)
    for old in range(olds.size):
        if olds[old] >= 0:
            known[olds[old]] = True
    for anchor in range(taken.size):
        if taken[anchor] >= 0:
            free[taken[anchor]] = False
    earlier = np.zeros(len(spans), np.int64)
    for i in range(len(spans)):
        if not known[spans[i, 0]]:
            earlier[i] = -1
    for old in range(olds.size):
        if olds[old] < 0 or not free[old]:
            continue
        for i in range(len(spans)):
            if spans[i, 0] == olds[old] and places[old] <= reached[spans[i, 2]]:
                earlier[i] += 1
                break
    return earlier


@part
def anchors(spans: Any, gaps: Any, closed: Any, reached: Any) -> Any:
    """The arcs and arc lengths of the anchors, in their order.

    There is one before each stretch that begins with one, and those at the ends of open arcs.
    """
    arcs, places, total = np.empty(2 * len(spans), np.int64), np.empty(2 * len(spans)), 0
    for i in range(len(spans)):
        arc = spans[i, 0]
        if gaps[i, 0] == 1:
            arcs[total], places[total], total = arc, reached[spans[i, 1]], total + 1
        final = i + 1 == len(spans) or spans[i + 1, 0] != arc
        if final and gaps[i, 1] == 1 and not closed[arc]:
            arcs[total], places[total], total = arc, reached[spans[i, 2]], total + 1
    return arcs[:total], places[:total]


@part
def targets(
    spans: Any,
    gaps: Any,
    wanted: Any,
    anchored: Any,
    closed: Any,
    steps: Any,
    reached: Any,
    pieces: Any,
    olds: Any,
    places: Any,
    marks: Any,
    spacing: Any,
) -> Any:
    """Arc lengths of all points of all stretches, in order; and of each, its arc and whether it is an anchor."""
    total = wanted.sum() + anchored
    places_of, marked, at = np.empty(total), np.empty((total, 2), np.int64), 0
    for i in range(len(spans)):
        arc, first, last = spans[i]
        lead, trail, count = gaps[i, 0], gaps[i, 1], wanted[i]
        if lead == 1:
            places_of[at], marked[at, 0], marked[at, 1] = reached[first], arc, 1
            at += 1
        mass = steps[last] - steps[first]
        step, shift = mass / (count - 1 + lead + trail) if lead > 0 and count > 0 else 0.0, lead
        if lead == 0:
            step = mass / count
            shift = _phase(arc, first, last, step, steps, reached, pieces, olds, places, marks, spacing)
        for j in range(count):
            goal = steps[first] + step * (j + shift)
            places_of[at] = density.locate(goal, first, last, steps, reached, pieces, spacing)
            marked[at, 0], marked[at, 1] = arc, 0
            at += 1
        final = i + 1 == len(spans) or spans[i + 1, 0] != arc
        if final and trail == 1 and not closed[arc]:
            places_of[at], marked[at, 0], marked[at, 1] = reached[last], arc, 1
            at += 1
    return places_of, marked


@part
def _phase(
    arc: Any,
    first: Any,
    last: Any,
    step: Any,
    steps: Any,
    reached: Any,
    pieces: Any,
    olds: Any,
    places: Any,
    marks: Any,
    spacing: Any,
) -> Any:
    """The mean phase, 0 to 1, of the earlier points in the even steps of a closed arc; 0 without any."""
    sine, cosine = 0.0, 0.0
    for old in range(olds.size):
        if olds[old] == arc and marks[ANCHOR, old] == 0 and step > 0:
            vertex = first + np.searchsorted(reached[first : last + 1], places[old], side="right") - 1
            vertex = max(first, min(vertex, last - 1))
            base = density._within(pieces[vertex], reached[vertex], spacing)
            turn = steps[vertex] + density._within(pieces[vertex], places[old], spacing) - base - steps[first]
            sine += math.sin(2 * math.pi * turn / step)
            cosine += math.cos(2 * math.pi * turn / step)
    phase = math.atan2(sine, cosine) / (2 * math.pi)
    return phase if phase >= 0 else phase + 1


@part
def thinned(marked: Any, most: Any) -> Any:
    """Indices of the targets that stay if there are more than the most: the anchors first, then the others, evenly."""
    total, sharp = len(marked), marked[:, 1].sum()
    kept, at = np.empty(min(total, most), np.int64), 0
    among = sharp if sharp > most else total - sharp
    room = most if sharp > most else most - sharp
    passed = 0
    for i in range(total):
        concerned = (marked[i, 1] == 1) == (sharp > most)
        stays = not concerned and sharp <= most
        if concerned:
            stays = among <= room or (passed + 1) * room // among > passed * room // among
            passed += 1
        if stays:
            kept[at] = i
            at += 1
    return kept[:at]
