"""Compiled kernels that keep control points the same ones from frame to frame.

A point is known by its last place: it is projected on the new arcs of its object, preferably those of its
quadrilateral. The places that the density gives are then shared among the projected points: anchors first, then all
others, the nearest ones first. A plain point may become an anchor, and an anchor a plain one. If points are left and
places are free on the same arc, those between them move on by one. A point then moves along its arc towards its place,
by no more than `FOLLOW` times the motion of its hand since the last frame, plus `SETTLE`. All this is relative to the
object: points on an object that moves are moved with it first. So points follow a hand without delay, while a place
that jumps, because their number on an arc changed or two anchors became one, is reached step by step. A point that
finds no place ends, and a place without a point begins a new one, with a new identity.

Points neither come nor go because a hand trembles. Their number on a stretch stays while it fits nearly
(`density.counts`), an arc without points needs more length than one that has some (`placing.felt`), and a new point of
a hand that feels the object already waits for `PATIENCE`, tracked but not felt: what an arc wants for a shorter time
makes no point.

A surviving point thus moves by at most: its distance from the new arcs, which is what the arcs moved; plus that limit.
The first frame, and arcs without earlier points, have their points exactly at the places of the density.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...base.compiling import kernel, part
from . import density, placing
from .curvature import SHARP
from .hand import QUADS
from .placing import ANCHOR, ID, OBJECT, QUAD, WAIT

__all__ = ["FOLLOW", "SETTLE", "carry", "follow"]

FOLLOW = 2.0
"""How far a point may move along its arc, relative to how far its hand has moved."""

SETTLE = 0.5e-3
"""How far a point may move along its arc in each frame if nothing else moves, in metres."""

STRAY = 4.0
"""How far a point may be from the new arcs, relative to how far its hand has moved, but no farther than that and the
spacing; farther ones end. An arc moves this much faster than its hand if the two surfaces meet at 15°."""

JUMP = 2e-3
"""How far a point may be from the new arcs in any case, in metres: a quarter of a wavelength."""

PATIENCE = 30_000
"""Time in µs after which a new point is felt if its hand felt its object before."""

STRANGE = 8e-3  # metres: by how much an arc of the same quadrilateral may be farther away than one of another
LOST = 0.05  # metres: a hand that has moved farther in one frame is another one


@part
def _motion(new: Any, old: Any, turn: Any, shift: Any) -> Any:
    """How far each hand has moved, (h,): the largest motion of a corner in metres, to the nearest of the earlier hands.

    ``new`` and ``old`` (q, 4, 3) are quadrilaterals of the hands; ``turn`` and ``shift`` are applied to the earlier
    ones first. A hand that was not there before has moved infinitely far.
    """
    hands, others = len(new) // QUADS, len(old) // QUADS
    moved, carried = np.full(hands, np.inf), np.empty(old.shape)
    for quad in range(len(old)):
        for corner in range(4):
            x, y, z = old[quad, corner, 0], old[quad, corner, 1], old[quad, corner, 2]
            for k in range(3):
                carried[quad, corner, k] = turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z + shift[k]
    for hand in range(hands):
        for other in range(others):
            largest = 0.0
            for quad in range(QUADS):
                for corner in range(4):
                    square = 0.0
                    for k in range(3):
                        apart = new[hand * QUADS + quad, corner, k] - carried[other * QUADS + quad, corner, k]
                        square += apart * apart
                    largest = max(largest, square)
            moved[hand] = min(moved[hand], math.sqrt(largest))
        if moved[hand] > LOST:
            moved[hand] = np.inf
    return moved


@part
def carry(poses: Any, quads: Any, known: Any, poses_before: Any, quads_before: Any, positions: Any, marks: Any) -> Any:
    """Move the last points with their objects, and say how far hands have moved since, as seen from each object.

    ``poses`` (o, 4, 3) are the objects', see `scene.poses`; ``quads`` (q, 4, 3) the hands', in metres; ``known`` (o,)
    says which objects have the same solid as the one at their place before.

    Returns positions (m, 3), and motions (o, h), infinite if the hand or the object is another one.
    """
    carried = positions.copy()
    moved = np.full((len(poses), len(quads) // QUADS), np.inf)
    turn, shift = np.eye(3), np.zeros(3)
    for number in range(len(poses)):
        if not known[number]:
            continue
        now, then = poses[number], poses_before[number]
        still = True
        for k in range(4):
            for j in range(3):
                still = still and now[k, j] == then[k, j]
        for k in range(3):
            shift[k] = 0.0 if still else now[3, k]
            for j in range(3):
                turn[k, j] = k == j
                if not still:
                    turn[k, j] = now[k, 0] * then[j, 0] + now[k, 1] * then[j, 1] + now[k, 2] * then[j, 2]
                    shift[k] -= turn[k, j] * then[3, j]
        moved[number] = _motion(quads, quads_before, turn, shift)
        for old in range(0 if still else len(positions)):
            if marks[OBJECT, old] == number:
                x, y, z = positions[old]
                for k in range(3):
                    carried[old, k] = turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z + shift[k]
    return carried, moved


@kernel
def follow(
    vertices: Any,
    names: Any,
    rows: Any,
    curvature: Any,
    spacing: float,
    most: int,
    moved: Any,
    positions: Any,
    marks: Any,
    fresh: int,
    elapsed: int,
) -> Any:
    """Place control points on the arcs of a frame, see `Arcs`.

    ``curvature`` (k,) at the vertices is in radians; all 0 for even spacing. ``spacing`` is the arc length between
    points where nothing is curved, in metres, and ``most`` the largest number of points. ``moved`` (o, h) is how far
    each hand has moved since the last frame, as seen from each object; infinite if either is new. ``positions`` (m, 3)
    of the last frame's points are moved with their objects since, and ``marks`` (5, m) are as in `placing`. ``fresh``
    is the next new identity, and ``elapsed`` the time since the last frame in µs.

    Returns positions, amplitudes, marks and fresh of this frame, with points that wait. A point keeps its index as long
    as no point before it ends unreplaced.
    """
    points, owners, values, reached, starts, closed, objects = density.arrange(vertices, names, rows, curvature)
    steps, pieces = density.measure(starts, closed, values, reached, spacing)
    olds, places = _project(points, owners, values, reached, starts, objects, positions, marks, moved, spacing)
    cycles = np.zeros(closed.size)
    for arc in range(closed.size):
        if closed[arc]:
            cycles[arc] = reached[starts[arc + 1] - 1]
    seen, contacts = olds.copy(), np.zeros(moved.shape, np.bool_)  # those that are felt, and what they touch
    for old in range(olds.size):
        if marks[WAIT, old] > 0:
            seen[old] = -1
        elif olds[old] >= 0:
            contacts[objects[olds[old]], owners[starts[olds[old]]] // QUADS] = True
    touched = np.empty(closed.size, np.bool_)
    for arc in range(closed.size):
        touched[arc] = contacts[objects[arc], owners[starts[arc]] // QUADS]
    felt, held = placing.felt(starts, reached, touched, olds, places, marks, spacing)
    spans, gaps = density.stretches(starts, closed, values, reached, felt, held, spacing)
    anchor_arcs, anchor_places = placing.anchors(spans, gaps, closed, reached)
    anchored = np.full(anchor_arcs.size, -1)
    _pair(anchored, anchor_arcs, anchor_places, seen, places, cycles, spacing)
    _pair(anchored, anchor_arcs, anchor_places, olds, places, cycles, spacing)
    before = placing.before(spans, closed.size, reached, olds, places, anchored)
    lengths = reached[spans[:, 2]] - reached[spans[:, 1]]
    masses = steps[spans[:, 2]] - steps[spans[:, 1]]
    wanted = density.counts(lengths, masses, gaps, before, most - anchored.size, spacing)
    targets, marked = placing.targets(
        spans, gaps, wanted, anchored.size, closed, steps, reached, pieces, olds, places, marks, spacing
    )
    sources = np.full(len(marked), -1)
    sources[marked[:, 1] == 1] = anchored
    kept = placing.thinned(marked, most)
    arcs, goals, sharp, source = marked[kept, 0], targets[kept], marked[kept, 1], sources[kept]
    _pair(source, arcs, goals, seen, places, cycles, spacing)
    _shift(source, arcs, goals, seen, places, cycles)
    _pair(source, arcs, goals, olds, places, cycles, spacing)
    slots = _slots(source, len(positions))
    count = slots.size
    new_positions, amplitudes, new_marks = np.empty((count, 3)), np.empty(count), np.empty((5, count), np.int64)
    for slot in range(count):
        target = slots[slot]
        arc, place, old = arcs[target], goals[target], source[target]
        begin, end = starts[arc], starts[arc + 1] - 1
        if old >= 0:
            reach = SETTLE + FOLLOW * moved[objects[arc], owners[begin] // QUADS]
            place = _towards(places[old], place, reach, cycles[arc])
            new_marks[ID, slot], new_marks[WAIT, slot] = marks[ID, old], max(marks[WAIT, old] - elapsed, 0)
        else:
            new_marks[ID, slot], new_marks[WAIT, slot] = fresh, PATIENCE if touched[arc] else 0
            fresh += 1
        vertex = begin + np.searchsorted(reached[begin : end + 1], place, side="right") - 1
        vertex = max(begin, min(vertex, end - 1))
        length = reached[min(vertex + 1, end)] - reached[vertex]
        share = (place - reached[vertex]) / length if length > 0 else 0.0
        for axis in range(3):
            step = points[min(vertex + 1, end), axis] - points[vertex, axis]
            new_positions[slot, axis] = points[vertex, axis] + share * step
        amplitudes[slot] = math.sqrt(1 + density.strength(pieces[vertex], place, spacing))
        new_marks[OBJECT, slot], new_marks[QUAD, slot] = objects[arc], owners[vertex]
        new_marks[ANCHOR, slot] = sharp[target] and place == goals[target]
    return new_positions, amplitudes, new_marks, fresh


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

    For an anchor, which stays on its edge whichever arcs meet there, that is the nearest crossing of a sharp edge, if
    there is one.
    """
    olds, places = np.full(len(positions), -1), np.zeros(len(positions))
    for old in range(len(positions)):
        best, anchored = np.inf, marks[ANCHOR, old] == 1
        px, py, pz, quad = positions[old, 0], positions[old, 1], positions[old, 2], marks[QUAD, old] % QUADS
        arc = 0
        while arc < objects.size:
            hand = moved[objects[arc], owners[starts[arc]] // QUADS]
            farthest = min(JUMP + STRAY * hand, spacing + hand)
            begin, end = starts[arc], starts[arc + 1] - 1
            i = begin
            if objects[arc] != marks[OBJECT, old] or farthest == np.inf:
                i = end + 1
            while i < end or i == begin or (i == end and anchored):
                x, y, z = px - points[i, 0], py - points[i, 1], pz - points[i, 2]
                strange = STRANGE if owners[i] % QUADS != quad else 0.0
                if anchored:
                    if values[i] >= SHARP:
                        distance = math.sqrt(x * x + y * y + z * z)
                        if distance <= farthest and distance + strange < best:
                            best, olds[old], places[old] = distance + strange, arc, reached[i]
                    i += 1
                    continue
                # The nearest place on the straight line to the next vertex.
                j, along = min(i + 1, end), 0.0
                length = reached[j] - reached[i]
                if length > 0:
                    ux, uy, uz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
                    along = min(max((ux * x + uy * y + uz * z) / (length * length), 0.0), 1.0)
                    x, y, z = x - along * ux, y - along * uy, z - along * uz
                distance, place = math.sqrt(x * x + y * y + z * z), reached[i] + along * length
                if distance <= farthest and distance + strange < best:
                    best, olds[old], places[old] = distance + strange, arc, place
                i += 1
                ahead = place + distance - min(best, farthest)
                while i < end and reached[i + 1] < ahead:  # nothing on the arc before that can be nearer
                    i += 1
            arc += 1
            if arc == objects.size and anchored and olds[old] < 0:  # its crossing is gone
                arc, anchored = 0, False
    return olds, places


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
def _pair(source: Any, arcs: Any, goals: Any, olds: Any, places: Any, cycles: Any, reach: Any) -> None:
    """Give each target that has none an earlier point to take over: the nearest on its arc that is free, within reach.

    ``source`` names the earlier point of each target, -1 for none.
    """
    free = olds >= 0
    for target in range(source.size):
        if source[target] >= 0:
            free[source[target]] = False
    open_targets, open_olds = np.flatnonzero(source < 0), np.flatnonzero(free)
    nearest, chosen = np.empty(arcs.size, np.int64), np.empty(olds.size, np.int64)
    shortest = np.empty(olds.size)
    wanting, having, found = open_targets.size, open_olds.size, True
    while found:  # each round pairs at least the two that are nearest to each other
        found = False
        for j in range(having):
            chosen[open_olds[j]], shortest[open_olds[j]] = -1, np.inf
        for i in range(wanting):
            target = open_targets[i]
            nearest[target], least = -1, np.inf
            for j in range(having):
                old = open_olds[j]
                if olds[old] != arcs[target]:
                    continue
                apart = abs(_apart(places[old], goals[target], cycles[arcs[target]]))
                if apart > reach:
                    continue
                if apart < least:
                    least, nearest[target] = apart, old
                if apart < shortest[old]:
                    shortest[old], chosen[old] = apart, target
        left = 0
        for i in range(wanting):
            target = open_targets[i]
            old = nearest[target]
            if old >= 0 and chosen[old] == target:
                source[target], found = old, True
                olds_left = 0
                for j in range(having):
                    if open_olds[j] != old:
                        open_olds[olds_left] = open_olds[j]
                        olds_left += 1
                having = olds_left
            elif old >= 0:  # one without an earlier point within reach finds none later either
                open_targets[left] = target
                left += 1
        wanting = left


@part
def _shift(source: Any, arcs: Any, goals: Any, olds: Any, places: Any, cycles: Any) -> None:
    """Let earlier points that are left make room on their arc: all points on the way to a free target move on by one.

    So no point passes others, and none ends while another begins on its arc. The nearest free target counts.
    """
    left = olds >= 0
    for target in range(source.size):
        if source[target] >= 0:
            left[source[target]] = False
    for old in range(olds.size):
        if not left[old]:
            continue
        cycle, free, way = cycles[olds[old]], -1, np.inf
        for target in range(source.size):
            if source[target] < 0 and arcs[target] == olds[old]:
                apart = _apart(places[old], goals[target], cycle)
                if abs(apart) < abs(way):
                    free, way = target, apart
        while free >= 0:
            ahead, farthest = -1, 0.0  # the last target before the free one
            for target in range(source.size):
                apart = _apart(places[old], goals[target], cycle) * np.sign(way)
                if arcs[target] == olds[old] and source[target] >= 0 and farthest <= apart < abs(way):
                    ahead, farthest = target, apart
            source[free] = old if ahead < 0 else source[ahead]
            free, way = ahead, math.copysign(farthest, way)


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
