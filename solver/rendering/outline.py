"""Outlines: the lines along which something is felt, and a walk along them at a constant speed.

Some ways of rendering let all control points sound at once, others lead one focus along the lines. An `Outline` has
both: strokes, and control points on them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import flag, real, whole
from ..contact.touch import Touch
from ..geometry import frozen
from ..methods.solve import Wanted, control_points
from ..shapes.curves import COINCIDENT, SPACING
from ..shapes.points import ControlPoints
from ..shapes.shapes import Drawn, Strokes

__all__ = ["Outline"]

STEP = 1e-3
"""Distance in metres between vertices of a curve: far less than a focus resolves."""
JUMP = 2.5
"""Points whose distance is more than this many times the usual one, and `SPACING`, are on different strokes."""
WIDEST_GAP = 3 * SPACING
"""Points farther apart than this, in metres, make no line."""
SAME = 1e-9
"""Distance in metres within which two vertices are one."""
ALONE = 5e-3
"""Length in metres of the line for which a focus would need as long as it rests at a point that is felt alone."""
MOST_STEPS = 10_000_000
"""Of a walk."""
CORNER = math.radians(30)
"""Turn of a stroke from which on it has a corner there."""

Line = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outline:
    """Lines along which something is felt, with control points on them.

    Parameters
    ----------
    strokes : tuple of (k, 3) float
        Polylines in metres; a closed one repeats its first vertex. A single vertex is a point that is felt alone.
    points : ControlPoints
        m points on them.
    ids : (m,) int64, optional
        Identities of the points, by which they keep their phases from frame to frame.
    """

    strokes: tuple[Line, ...]
    points: ControlPoints
    ids: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        """Leave out vertices that repeat the one before: they have no direction."""
        object.__setattr__(self, "strokes", tuple(_without_repeats(stroke) for stroke in self.strokes))

    @classmethod
    def of(cls, what: Wanted | Touch) -> Self:
        """The outline of a shape, of control points, or of what hands touch.

        Control points make strokes in their order: one ends where the distance to the next point is far above the
        usual one. It is closed if its ends are no farther apart than its points.

        Raises
        ------
        ValueError
            If there are no points, such as in a touch that touches nothing.
        """
        if isinstance(what, Touch):
            if what.points is None:
                raise ValueError("the hands touch nothing, so there is nothing to render")
            return cls(tuple(what.arcs), what.points, what.ids)
        if isinstance(what, Drawn):
            return cls(tuple(_strokes(what.parts)), what.sample())
        points = control_points(what)
        return cls(tuple(_chains(points)), points)

    def __repr__(self) -> str:
        return f"Outline({len(self.strokes)} strokes, {self.length * 1e3:.0f} mm, {len(self.points)} points)"

    @cached_property
    def length(self) -> float:
        """Of all strokes, in metres."""
        return float(sum(np.linalg.norm(np.diff(stroke, axis=0), axis=1).sum() for stroke in self.strokes))

    @cached_property
    def tangents(self) -> NDArray[np.float64]:
        """(m, 3) unit vectors along the stroke that is nearest to each point; +x if a stroke has no length."""
        begins, ends = (
            np.concatenate(parts) for parts in zip(*((stroke[:-1], stroke[1:]) for stroke in self.strokes), strict=True)
        )
        way = ends - begins
        length = np.linalg.norm(way, axis=1)
        begins, way = begins[length > 0], way[length > 0] / length[length > 0, None]
        if not len(way):
            return frozen(np.tile([1.0, 0.0, 0.0], (len(self.points), 1)))
        offset = self.points.positions[:, None] - begins
        along = np.clip(np.einsum("mki,ki->mk", offset, way), 0, length[length > 0])
        nearest = np.linalg.norm(offset - along[..., None] * way, axis=2).argmin(axis=1)
        return frozen(way[nearest])

    def walk(self, count: int, speed: float, pause: float = 0.0, *, back: bool = True) -> NDArray[np.float64]:
        """Positions at equal steps of time of a focus that goes once round, (count, 3) in metres.

        It passes every stroke once, from its beginning to its end, and jumps to the next. At a point that is felt alone
        it rests for as long as it needs for `ALONE` of a line.

        Parameters
        ----------
        count : int
            Positions; each is where the focus is in the middle of its step.
        speed : float
            Speed in m/s.
        pause : float
            Seconds for which it rests at each corner and at each end of an open stroke.
        back : bool
            Whether a single open stroke is passed to and fro.
        """
        count, (speed, pause) = whole("count", count, 1, MOST_STEPS), _pace(speed, pause)
        where, when = [], []
        now = 0.0
        for stroke in self._walked(flag("back", back)):
            reached = now + np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(stroke, axis=0), axis=1)) / speed])
            stays = _stays(stroke, speed, pause)
            before = np.cumsum(stays) - stays
            where.append(np.repeat(stroke, 2, axis=0))
            when.append(np.stack([reached + before, reached + before + stays], axis=1).ravel())
            now = float(when[-1][-1])
        knots, vertices = np.concatenate(when), np.concatenate(where)
        times = now * (np.arange(count) + 0.5) / count
        return np.stack([np.interp(times, knots, vertices[:, axis]) for axis in range(3)], axis=1)

    def round_trip(self, speed: float, pause: float = 0.0, *, back: bool = True) -> float:
        """Seconds in which `walk` goes once round."""
        (speed, pause), strokes = _pace(speed, pause), self._walked(flag("back", back))
        length = sum(float(np.linalg.norm(np.diff(stroke, axis=0), axis=1).sum()) for stroke in strokes)
        return length / speed + sum(float(_stays(stroke, speed, pause).sum()) for stroke in strokes)

    def _walked(self, back: bool) -> tuple[Line, ...]:
        if back and len(self.strokes) == 1 and not _is_closed(self.strokes[0]):
            return (np.concatenate([self.strokes[0], self.strokes[0][-2::-1]]),)
        return self.strokes


def _strokes(parts: Sequence[Strokes | ControlPoints]) -> Iterator[Line]:
    for part in parts:
        if isinstance(part, Strokes):
            yield from (curve.polyline(STEP) for curve in part.curves)
        else:
            yield from _chains(part)


def _chains(points: ControlPoints) -> Iterator[Line]:
    """Polylines through points in their order; nulls are no part of them."""
    places = points.positions[points.amplitudes > 0]
    gaps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    usual = min(max(JUMP * float(np.median(gaps)), SPACING), WIDEST_GAP) if len(gaps) else SPACING
    for chain in np.split(places, np.flatnonzero(gaps > usual) + 1):
        closes = len(chain) > 2 and np.linalg.norm(chain[-1] - chain[0]) <= usual
        yield np.concatenate([chain, chain[:1]]) if closes else chain


def _without_repeats(stroke: Line) -> Line:
    different = np.linalg.norm(np.diff(stroke, axis=0), axis=1) > SAME
    return np.asarray(stroke[np.concatenate([[True], different])])


def _is_closed(stroke: Line) -> bool:
    return bool(len(stroke) > 2 and np.linalg.norm(stroke[-1] - stroke[0]) <= COINCIDENT * SPACING)


def _pace(speed: float, pause: float) -> tuple[float, float]:
    return real("speed", speed, 0, 1e6, "m/s", above=True), real("pause", pause, 0, 1e6, "s")


def _stays(stroke: Line, speed: float, pause: float) -> NDArray[np.float64]:
    """Seconds for which a walk rests at each vertex."""
    return np.array([ALONE / speed]) if len(stroke) == 1 else pause * _corners(stroke)


def _corners(stroke: Line) -> NDArray[np.float64]:
    """1 for each vertex at which a walk may rest, else 0: corners, and the ends of an open stroke."""
    rests = np.zeros(len(stroke))
    way = np.diff(stroke, axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None]
    rests[1:-1] = np.einsum("ki,ki->k", way[:-1], way[1:]) < math.cos(CORNER)
    if _is_closed(stroke):
        rests[0] = float(way[-1] @ way[0] < math.cos(CORNER))
    else:
        rests[[0, -1]] = 1
    return rests
