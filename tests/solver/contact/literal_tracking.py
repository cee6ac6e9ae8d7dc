"""The points of a frame, given those of the frame before, as `tracking` documents it: in readable Python."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from phasewire.solver.contact.curvature import SHARP
from phasewire.solver.contact.density import CLOSEST, CROWDED, HOLD, SLACK, SLIGHT
from phasewire.solver.contact.placing import FRESH
from phasewire.solver.contact.tracking import FOLLOW, JUMP, PATIENCE, SETTLE, STRANGE, STRAY

from tests.solver.contact.literal_density import Floats, Line


@dataclass(frozen=True)
class Point:
    """A control point; it is felt if it waits no longer."""

    identity: int
    position: Floats
    object: int
    quad: int
    anchor: bool
    wait: int


@dataclass
class Target:
    """A place for a point: a line, an arc length on it, and the index of the earlier point that takes it."""

    line: int
    place: float
    anchor: bool
    source: int = -1


Place = tuple[int, float]  # of an earlier point: its line, and the arc length there
Stretch = tuple[int, float, float, float, float]  # line, arc lengths of its ends, steps to the nearest point at each


def follow(
    lines: list[Line], moved: Floats, before: Sequence[Point], fresh: int, elapsed: int, spacing: float
) -> list[Point]:
    """The points of the next frame, without a limit to their number, ordered by identity."""
    places = {i: found for i, point in enumerate(before) if (found := _projected(point, lines, moved)) is not None}
    felt = {i: place for i, place in places.items() if before[i].wait == 0}
    contacts = {_contact(lines[line]) for line, _ in felt.values()}
    anchors, stretches = _divided(lines, contacts, places, before)
    _pair(anchors, felt, lines, spacing)
    _pair(anchors, places, lines, spacing)
    free = {i: place for i, place in places.items() if i not in {anchor.source for anchor in anchors}}
    targets = []
    for i, stretch in enumerate(stretches):
        begins = [each for each in anchors if stretch[3] == 1 and (each.line, each.place) == (stretch[0], stretch[1])]
        count = _count(lines[stretch[0]], stretch, _on(stretch, stretches[:i], free, places))
        targets += begins + _spread(lines, stretch, count, places, before)
        if stretch[4] == 1 and not lines[stretch[0]].closed:  # the last of its line
            targets += [
                each
                for each in anchors
                if (each.line, each.place) == (stretch[0], stretch[2])
                and all(other[0] != stretch[0] for other in stretches[i + 1 :])
            ]
    _pair(targets, felt, lines, spacing)
    _shift(targets, felt, lines)
    _pair(targets, places, lines, spacing)
    points = []
    for target in targets:
        line, place, reached = lines[target.line], target.place, True
        if target.source >= 0:
            old, origin = before[target.source], places[target.source][1]
            apart = _apart(line, origin, target.place)
            reach = SETTLE + FOLLOW * moved[line.object, line.quads[0] // 16]
            reached = abs(apart) <= reach
            if not reached:
                place = origin + math.copysign(reach, apart)
                place = place % line.reached[-1] if line.closed else place
            identity, wait = old.identity, max(old.wait - elapsed, 0)
        else:
            identity, wait = fresh, PATIENCE if _contact(line) in contacts else 0
            fresh += 1
        vertex = max(0, min(int(np.searchsorted(line.reached, place, side="right")) - 1, len(line.reached) - 2))
        quad = int(line.quads[vertex])
        points.append(Point(identity, line.at(place), int(line.object), quad, target.anchor and reached, wait))
    return sorted(points, key=lambda point: point.identity)


def _contact(line: Line) -> tuple[int, int]:
    """The object and the hand of a line."""
    return int(line.object), int(line.quads[0]) // 16


def _projected(point: Point, lines: list[Line], moved: Floats) -> Place | None:
    """The nearest place on the lines of its object, of an anchor the nearest sharp crossing, if one is near enough."""
    for crossings in (True, False) if point.anchor else (False,):
        found = []
        for number, line in enumerate(lines):
            hand = moved[line.object, line.quads[0] // 16]
            farthest = min(JUMP + STRAY * hand, line.spacing + hand)
            if line.object != point.object or farthest == math.inf:
                continue
            at, on = _candidates(point.position, line, crossings)
            for place, position, quad in zip(at, on, line.quads if crossings else line.quads[:-1], strict=True):
                distance = float(np.linalg.norm(position - point.position))
                if distance <= farthest and not (crossings and line.curvature[line.reached == place].max() < SHARP):
                    found.append((distance + STRANGE * (quad % 16 != point.quad % 16), (number, float(place))))
        if found:
            return min(found, key=lambda each: each[0])[1]
    return None


def _candidates(position: Floats, line: Line, crossings: bool) -> tuple[Floats, Floats]:
    """Arc lengths and positions: all vertices, or the nearest place on each piece."""
    if crossings:
        return line.reached, line.vertices
    step, length = np.diff(line.vertices, axis=0), np.diff(line.reached)
    along = ((position - line.vertices[:-1]) * step).sum(axis=1) / np.where(length > 0, length, 1) ** 2
    along = np.clip(along, 0, 1)
    return line.reached[:-1] + along * length, line.vertices[:-1] + along[:, None] * step


def _divided(
    lines: list[Line], contacts: set[tuple[int, int]], places: dict[int, Place], before: Sequence[Point]
) -> tuple[list[Target], list[Stretch]]:
    """Anchors and stretches of the lines that are long enough."""
    anchors, stretches = [], []
    for number, line in enumerate(lines):
        mine = {i: place for i, (on, place) in places.items() if on == number}
        least = max(SLIGHT, FRESH * line.spacing) if _contact(line) in contacts else SLIGHT
        if not mine and line.reached[-1] < least:
            continue
        near = [place for i, place in mine.items() if before[i].anchor]
        held = frozenset(k for k, at in enumerate(line.reached) if any(abs(at - place) <= SLIGHT for place in near))
        sharp = replace(line, held=held).anchors
        anchors += [Target(number, float(line.reached[k]), True) for k in sharp]
        last = len(line.reached) - 1
        if line.closed:
            ends = [*sharp, last] if sharp else [0, last]
        else:
            ends = [*([] if 0 in sharp else [0]), *sharp, *([] if last in sharp else [last])]
        for one, other in itertools.pairwise(ends):
            lead = 1.0 if one in sharp else 0.0 if line.closed else 0.5
            trail = lead if line.closed else 1.0 if other in sharp else 0.5
            stretches.append((number, float(line.reached[one]), float(line.reached[other]), lead, trail))
    return anchors, stretches


def _on(stretch: Stretch, earlier: list[Stretch], free: dict[int, Place], places: dict[int, Place]) -> int:
    """How many earlier points are on a stretch, -1 if its line has none at all."""
    if all(line != stretch[0] for line, _ in places.values()):
        return -1
    begin = max((other[2] for other in earlier if other[0] == stretch[0]), default=-1.0)
    return sum(line == stretch[0] and begin < place <= stretch[2] for line, place in free.values())


def _count(line: Line, stretch: Stretch, before: int) -> int:
    """As many as before, or the nearest number that the steps, which are wider or narrower by so much, allow."""
    _, start, stop, lead, trail = stretch
    extra = lead + trail - 1 if lead else 0.0
    mass, closest = line.until(stop) - line.until(start), min(CLOSEST, line.spacing)
    fit, most = mass - extra, int((stop - start) / closest - extra + 1e-6)
    count = math.floor(fit + 0.5)
    if before >= 0:
        allowed = [
            n
            for n in range(before + math.ceil(mass) + 9)
            if fit - 0.5 - HOLD <= n <= fit + 0.5 + HOLD or mass / SLACK <= n + extra <= mass * SLACK
        ] or [0]
        count = min(allowed, key=lambda n: abs(n - before))
        most = max(most, min(before, int((stop - start) / (CROWDED * closest) - extra)))
    return max(1 if lead + trail <= 1 else 0, min(count, most))


def _spread(
    lines: list[Line], stretch: Stretch, count: int, places: dict[int, Place], before: Sequence[Point]
) -> list[Target]:
    """Targets at equal steps; those of a closed line without anchors turn with the earlier points."""
    number, start, stop, lead, trail = stretch
    line, extra = lines[number], lead + trail - 1
    if lead == 0 and count > 0:
        extra, step = 0.0, line.until(stop) / count
        turns = [line.until(place) for i, (on, place) in places.items() if on == number and not before[i].anchor]
        mean = sum(np.exp(2j * np.pi * turn / step) for turn in turns)
        lead = float(np.angle(mean)) / (2 * np.pi) % 1 if turns else 0.0
    return [Target(number, place, False) for place in line.spread(start, stop, count, lead, extra)]


def _apart(line: Line, one: float, other: float) -> float:
    """The arc length from one place to another, the shorter way round."""
    length = line.reached[-1]
    return (other - one + length / 2) % length - length / 2 if line.closed else other - one


def _pair(targets: list[Target], places: dict[int, Place], lines: list[Line], reach: float) -> None:
    """Pair what is nearest to each other first, among the free."""
    pairs = []
    for k, target in enumerate(targets):
        for i, (line, place) in places.items():
            if line == target.line and (apart := abs(_apart(lines[line], place, target.place))) <= reach:
                pairs.append((apart, k, i))
    for _, k, i in sorted(pairs):
        if targets[k].source < 0 and all(target.source != i for target in targets):
            targets[k].source = i


def _shift(targets: list[Target], places: dict[int, Place], lines: list[Line]) -> None:
    """Points that are left take the way to the nearest free target of their line, and those on it move on by one."""
    for i, (line, place) in places.items():
        here = [(target, _apart(lines[line], place, target.place)) for target in targets if target.line == line]
        free = [(target, apart) for target, apart in here if target.source < 0]
        if not free or any(target.source == i for target in targets):
            continue
        goal, way = min(free, key=lambda each: abs(each[1]))
        sign = math.copysign(1, way)
        between = [(apart * sign, k) for k, (_, apart) in enumerate(here) if 0 <= apart * sign < way * sign]
        passed = [here[k][0] for _, k in sorted(between) if here[k][0].source >= 0]
        chain = [*passed, goal]
        for target, source in zip(chain, [i, *(target.source for target in passed)], strict=True):
            target.source = source
