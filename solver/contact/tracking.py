"""Compiled kernels that keep control points the same ones from frame to frame.

A point is known by where it was: it is projected on the new arcs, those of its object alone and rather those of its
quadrilateral, and the places that the density gives are shared among the points so found, the nearest ones first. A
point then moves along its arc towards its place, by no more than `FOLLOW` times the motion of its hand since the last
frame, plus `SETTLE`. All this is as seen from the object: points on an object that moves are moved with it first. So
points follow a hand without delay, while a place that jumps, because their number on an arc changed or two anchors
became one, is reached step by step. A point that finds no place ends, and a place without a point begins a new one,
with a new identity.

A surviving point thus moves by at most: its distance from the new arcs, which is what the arcs moved; plus that limit.
The first frame, and arcs without earlier points, have their points exactly where the density says.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...compiling import kernel, part
from . import density
from .curvature import SHARP

__all__ = ["FOLLOW", "SETTLE", "follow", "motion"]

FOLLOW = 2.0
"""How far a point may move along its arc, relative to how far its hand has moved."""

SETTLE = 0.5e-3
"""How far a point may move along its arc in each frame if nothing else moves, in metres."""

STRAY = 4.0
"""How far a point may be from the new arcs, relative to how far its hand has moved, but no farther than that and the
spacing; farther ones end. An arc moves this much faster than its hand if the two surfaces meet at 15°."""

JUMP = 2e-3
"""How far a point may be from the new arcs in any case, in metres: a quarter of a wavelength."""

GONE = 1e-3
"""Length in metres below which an arc that has points loses them; see `density.SLIGHT`."""

STRANGE = 8e-3  # metres: by how much an arc of the same quadrilateral may be farther away than one of another
LOST = 0.05  # metres: a hand that has moved farther in one frame is another one
QUADS = 16


@kernel
def motion(new: Any, old: Any) -> Any:
    """How far each hand has moved: the largest motion of a corner in metres, to the nearest of the earlier hands.

    Parameters
    ----------
    new, old : (h, 16, 4, 3) float
        Quadrilaterals of the hands.

    Returns
    -------
    (h,) float
        Inf for a hand that is none of the earlier ones.
    """
    moved = np.full(len(new), np.inf)
    for hand in range(len(new)):
        for other in range(len(old)):
            largest = 0.0
            for quad in range(QUADS):
                for corner in range(4):
                    largest = max(largest, density._square(new[hand, quad, corner], old[other, quad, corner]))
            moved[hand] = min(moved[hand], math.sqrt(largest))
        if moved[hand] > LOST:
            moved[hand] = np.inf
    return moved


@kernel
def follow(
    vertices: Any,
    starts: Any,
    closed: Any,
    objects: Any,
    quads: Any,
    curvature: Any,
    spacing: Any,
    most: Any,
    moved: Any,
    positions: Any,
    marks: Any,
    ids: Any,
    fresh: Any,
) -> Any:
    """Place control points on the arcs of a frame.

    Parameters
    ----------
    vertices, starts, closed, objects, quads
        Of the arcs: see `Arcs`.
    curvature : (k,) float
        At the vertices, in radians; all 0 for even spacing.
    spacing : float
        Arc length between points where nothing is curved, in metres.
    most : int
        Most points.
    moved : (o, h) float
        How far each hand has moved since the last frame, as seen from each object, in metres; inf if either is new.
    positions, marks, ids : (m, 3), (m, 3), (m,)
        The points of the last frame: where they were, moved with their objects since; object, quadrilateral and whether
        they were anchors; identities.
    fresh : int
        The next new identity.

    Returns
    -------
    positions, amplitudes, marks, ids, fresh
        Of this frame. A point keeps its index as long as no point before it ends unreplaced.
    """
    points, owners, values, reached = density.arrange(vertices, starts, closed, quads, curvature)
    steps, pieces = density.measure(starts, closed, values, reached, spacing)
    olds, places = _project(points, owners, values, reached, starts, objects, positions, marks, moved, spacing)
    felt, held = _felt(starts, reached, olds, places, marks)
    spans, gaps = density.stretches(starts, closed, values, reached, felt, held, spacing)
    before = _before(spans, starts.size - 1, reached, olds, places, marks)
    lengths = reached[spans[:, 2]] - reached[spans[:, 1]]
    masses = steps[spans[:, 2]] - steps[spans[:, 1]]
    anchors = _anchors(spans, gaps, closed)
    wanted = density.counts(lengths, masses, gaps, before, most - anchors, spacing)
    targets, marked = _targets(spans, gaps, wanted, closed, steps, reached, pieces, olds, places, marks, spacing)
    kept = _thinned(marked, most)
    arcs, goals, sharp = marked[kept, 0], targets[kept], marked[kept, 1]
    cycles = np.zeros(closed.size)
    for arc in range(closed.size):
        if closed[arc]:
            cycles[arc] = reached[starts[arc + 1] - 1]
    source = _pairs(arcs, goals, sharp, olds, places, marks, cycles, spacing)
    slots = _slots(source, len(ids))
    count = slots.size
    new_positions, amplitudes = np.empty((count, 3)), np.empty(count)
    new_marks, new_ids = np.empty((count, 3), np.int64), np.empty(count, np.int64)
    for slot in range(count):
        target = slots[slot]
        arc, place, old = arcs[target], goals[target], source[target]
        begin, end = starts[arc], starts[arc + 1] - 1
        if old >= 0:
            reach = SETTLE + FOLLOW * moved[objects[arc], owners[begin] // QUADS]
            place = _towards(places[old], place, reach, cycles[arc])
            new_ids[slot] = ids[old]
        else:
            new_ids[slot] = fresh
            fresh += 1
        vertex = begin + np.searchsorted(reached[begin : end + 1], place, side="right") - 1
        vertex = max(begin, min(vertex, end - 1))
        length = reached[min(vertex + 1, end)] - reached[vertex]
        share = (place - reached[vertex]) / length if length > 0 else 0.0
        for axis in range(3):
            step = points[min(vertex + 1, end), axis] - points[vertex, axis]
            new_positions[slot, axis] = points[vertex, axis] + share * step
        amplitudes[slot] = math.sqrt(1 + density.strength(pieces[vertex], place, spacing))
        new_marks[slot] = objects[arc], owners[vertex], sharp[target]
    return new_positions, amplitudes, new_marks, new_ids, fresh


@part
def _project(
    points: Any,
    owners: Any,
    values: Any,
    reached: Any,
    starts: Any,
    objects: Any,
    positions: Any,
    marks: Any,
    moved: Any,
    spacing: Any,
) -> Any:
    """The arc that each earlier point is on now, -1 for none, and the arc length of the place nearest to it.

    For an anchor, which stays on its edge whichever arcs meet there, that is the nearest crossing of a sharp edge.
    """
    olds, places = np.full(len(positions), -1), np.zeros(len(positions))
    for old in range(len(positions)):
        best = np.inf
        for arc in range(objects.size):
            hand = moved[objects[arc], owners[starts[arc]] // QUADS]
            farthest = min(JUMP + STRAY * hand, spacing + hand)
            if objects[arc] != marks[old, 0] or farthest == np.inf:
                continue
            begin, end = starts[arc], starts[arc + 1] - 1
            if marks[old, 2] == 1:
                for i in range(begin, end + 1):
                    distance = math.sqrt(density._square(points[i], positions[old])) if values[i] >= SHARP else np.inf
                    cost = distance + (STRANGE if owners[i] % QUADS != marks[old, 1] % QUADS else 0.0)
                    if distance <= farthest and cost < best:
                        best, olds[old], places[old] = cost, arc, reached[i]
                continue
            i = begin
            while i < end or i == begin:
                distance, place = _nearest(points, reached, i, min(i + 1, end), positions[old])
                other = owners[i] % QUADS != marks[old, 1] % QUADS
                cost = distance + (STRANGE if other else 0.0)
                if distance <= farthest and cost < best:
                    best, olds[old], places[old] = cost, arc, place
                i += 1
                ahead = place + distance - min(best, farthest)
                while i < end and reached[i + 1] < ahead:  # nothing on the arc before that can be nearer
                    i += 1
    return olds, places


@part
def _nearest(points: Any, reached: Any, i: Any, j: Any, position: Any) -> Any:
    """Distance of a position from the straight line between two vertices, and the arc length of its nearest place."""
    along, length = 0.0, reached[j] - reached[i]
    if length > 0:
        for axis in range(3):
            along += (points[j, axis] - points[i, axis]) * (position[axis] - points[i, axis])
        along = min(max(along / (length * length), 0.0), 1.0)
    square = 0.0
    for axis in range(3):
        square += (points[i, axis] + along * (points[j, axis] - points[i, axis]) - position[axis]) ** 2
    return math.sqrt(square), reached[i] + along * length


@part
def _felt(starts: Any, reached: Any, olds: Any, places: Any, marks: Any) -> Any:
    """Which arcs are long enough for points, and which vertices are near to an anchor of the last frame."""
    felt, held = np.empty(starts.size - 1, np.bool_), np.zeros(reached.size, np.bool_)
    for arc in range(felt.size):
        felt[arc] = reached[starts[arc + 1] - 1] >= density.SLIGHT
    for old in range(olds.size):
        if olds[old] >= 0:
            begin, end = starts[olds[old]], starts[olds[old] + 1]
            felt[olds[old]] |= reached[end - 1] >= GONE
            for i in range(begin, end):
                held[i] |= marks[old, 2] == 1 and abs(reached[i] - places[old]) <= density.SLIGHT
    return felt, held


@part
def _before(spans: Any, arcs: Any, reached: Any, olds: Any, places: Any, marks: Any) -> Any:
    """How many earlier points that are no anchors are on each stretch; -1 on an arc without any earlier points."""
    known = np.zeros(arcs, np.bool_)
    for old in range(olds.size):
        if olds[old] >= 0:
            known[olds[old]] = True
    before = np.zeros(len(spans), np.int64)
    for i in range(len(spans)):
        if not known[spans[i, 0]]:
            before[i] = -1
    for old in range(olds.size):
        if olds[old] < 0 or marks[old, 2]:
            continue
        for i in range(len(spans)):
            if spans[i, 0] == olds[old] and places[old] <= reached[spans[i, 2]]:
                before[i] += 1
                break
    return before


@part
def _anchors(spans: Any, gaps: Any, closed: Any) -> Any:
    """How many anchors there are: one before each stretch that begins with one, and those at the ends of open arcs."""
    total = 0
    for i in range(len(spans)):
        arc = spans[i, 0]
        final = i + 1 == len(spans) or spans[i + 1, 0] != arc
        total += (gaps[i, 0] == 1) + (final and gaps[i, 1] == 1 and not closed[arc])
    return total


@part
def _targets(
    spans: Any,
    gaps: Any,
    wanted: Any,
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
    total = wanted.sum() + _anchors(spans, gaps, closed)
    targets, marked, at = np.empty(total), np.empty((total, 2), np.int64), 0
    for i in range(len(spans)):
        arc, first, last = spans[i]
        lead, trail, count = gaps[i, 0], gaps[i, 1], wanted[i]
        if lead == 1:
            targets[at], marked[at, 0], marked[at, 1] = reached[first], arc, 1
            at += 1
        mass = steps[last] - steps[first]
        step, shift = mass / (count - 1 + lead + trail) if lead > 0 and count > 0 else 0.0, lead
        if lead == 0:
            step = mass / count
            shift = _phase(arc, first, last, step, steps, reached, pieces, olds, places, marks, spacing)
        for j in range(count):
            goal = steps[first] + step * (j + shift)
            targets[at] = density.locate(goal, first, last, steps, reached, pieces, spacing)
            marked[at, 0], marked[at, 1] = arc, 0
            at += 1
        final = i + 1 == len(spans) or spans[i + 1, 0] != arc
        if final and trail == 1 and not closed[arc]:
            targets[at], marked[at, 0], marked[at, 1] = reached[last], arc, 1
            at += 1
    return targets, marked


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
        if olds[old] == arc and marks[old, 2] == 0 and step > 0:
            vertex = first + np.searchsorted(reached[first : last + 1], places[old], side="right") - 1
            vertex = max(first, min(vertex, last - 1))
            base = density._within(pieces[vertex], reached[vertex], spacing)
            turn = steps[vertex] + density._within(pieces[vertex], places[old], spacing) - base - steps[first]
            sine += math.sin(2 * math.pi * turn / step)
            cosine += math.cos(2 * math.pi * turn / step)
    phase = math.atan2(sine, cosine) / (2 * math.pi)
    return phase if phase >= 0 else phase + 1


@part
def _thinned(marked: Any, most: Any) -> Any:
    """Indices of the targets that stay if there are more than the most: the anchors first, then the others, evenly."""
    total, anchors = len(marked), marked[:, 1].sum()
    kept, at = np.empty(min(total, most), np.int64), 0
    among = anchors if anchors > most else total - anchors
    room = most if anchors > most else most - anchors
    passed = 0
    for i in range(total):
        thinned = (marked[i, 1] == 1) == (anchors > most)
        stays = not thinned and anchors <= most
        if thinned:
            stays = among <= room or (passed + 1) * room // among > passed * room // among
            passed += 1
        if stays:
            kept[at] = i
            at += 1
    return kept[:at]


@part
def _apart(one: Any, other: Any, cycle: Any) -> Any:
    """The arc length from one place to another, the shorter way round on a closed arc."""
    apart = other - one
    if cycle > 0:
        apart -= cycle * math.floor(apart / cycle + 0.5)
    return apart


@part
def _towards(place: Any, goal: Any, reach: Any, cycle: Any) -> Any:
    """The goal, or the place on the way to it that is within reach."""
    apart = _apart(place, goal, cycle)
    if abs(apart) <= reach:
        return goal
    moved = place + math.copysign(reach, apart)
    return moved - cycle * math.floor(moved / cycle) if cycle > 0 else moved


@part
def _pairs(arcs: Any, goals: Any, sharp: Any, olds: Any, places: Any, marks: Any, cycles: Any, spacing: Any) -> Any:
    """The earlier point that each target takes over, -1 for none: the nearest on its arc, an anchor for an anchor.

    None farther along the arc than the spacing, so that no point passes others, and all have settled soon.
    """
    source, taken = np.full(arcs.size, -1), np.zeros(olds.size, np.bool_)
    nearest, chosen = np.empty(arcs.size, np.int64), np.empty(olds.size, np.int64)
    shortest = np.empty(olds.size)
    found = True
    while found:  # each round pairs at least the two that are nearest to each other
        found = False
        chosen[:], shortest[:] = -1, np.inf
        for target in range(arcs.size):
            nearest[target] = -1
            if source[target] >= 0:
                continue
            least = np.inf
            for old in range(olds.size):
                if taken[old] or olds[old] != arcs[target] or marks[old, 2] != sharp[target]:
                    continue
                apart = abs(_apart(places[old], goals[target], cycles[arcs[target]]))
                if apart > spacing:
                    continue
                if apart < least:
                    least, nearest[target] = apart, old
                if apart < shortest[old]:
                    shortest[old], chosen[old] = apart, target
        for target in range(arcs.size):
            old = nearest[target]
            if old >= 0 and chosen[old] == target:
                source[target], taken[old], found = old, True, True
    return source


@part
def _slots(source: Any, olds: Any) -> Any:
    """The targets in order: earlier points at their indices, new ones at those of ended points, then at the end."""
    slots = np.full(olds + source.size, -1)
    for target in range(source.size):
        if source[target] >= 0:
            slots[source[target]] = target
    free = 0
    for target in range(source.size):
        if source[target] < 0:
            while slots[free] >= 0:
                free += 1
            slots[free] = target
    return slots[slots >= 0]
