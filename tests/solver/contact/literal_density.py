"""Equation (13) and the division of arcs as documented, in readable NumPy with numeric integrals."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from phasewire.solver.contact.arcs import Arcs
from phasewire.solver.contact.curvature import SHARP
from phasewire.solver.contact.density import CLOSEST, FADING, FULL, SHARPER, SLIGHT
from scipy.optimize import brentq

Floats = NDArray[np.float64]
Piece = tuple[float, float, float, float]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


@dataclass
class Line:
    """An arc without a bridge: vertices, how far along each is, the curvature, and the quadrilateral from there on."""

    vertices: Floats
    reached: Floats
    curvature: Floats
    quads: NDArray[np.int64]
    closed: bool
    spacing: float
    held: frozenset[int] = frozenset()
    """Vertices that may be anchors although they are near to an end."""
    object: int = 0

    @cached_property
    def pieces(self) -> list[Piece]:
        """κ₀ and κ₁ in units of `FULL`, and t₀ and t₁ of each piece between ends and vertices that have a curvature."""
        ends = [i for i in range(len(self.reached)) if i in (0, len(self.reached) - 1) or self.curvature[i] > 0]
        pieces = []
        for i, j in itertools.pairwise(ends):
            near, far = np.minimum(self.curvature[[i, j]] / FULL, 1) * [self.weight(i), self.weight(j)]
            faded = math.exp(-(self.reached[j] - self.reached[i]) / (FADING * self.spacing))
            highest = max(near + far * faded, far + near * faded, 1.0)
            pieces.append((near / highest, far / highest, self.reached[i], self.reached[j]))
        return pieces

    def weight(self, i: int) -> float:
        """Curvature counts less near to an end that a border cuts off."""
        if self.closed or i in (0, len(self.reached) - 1):
            return 1.0
        return float(min(1.0, self.reached[i] / SLIGHT, (self.reached[-1] - self.reached[i]) / SLIGHT))

    def density(self, piece: Piece, t: Floats) -> Floats:
        """Points per metre."""
        near, far, begin, end = piece
        c = 1 / (FADING * self.spacing)
        kappa = near * np.exp(-c * (t - begin)) + far * np.exp(-c * (end - t))
        return np.asarray((1 + max(self.spacing / CLOSEST - 1, 0) * kappa) / self.spacing)

    def integral(self, piece: Piece, stop: float) -> float:
        """Of the density, from the beginning of a piece."""
        borders = np.linspace(piece[2], stop, 21)
        middles, half = (borders[1:] + borders[:-1]) / 2, (stop - piece[2]) / 40
        return half * float((self.density(piece, middles[:, None] + half * NODES) @ WEIGHTS).sum())

    @cached_property
    def whole(self) -> Floats:
        """The integral of the density from the arc's beginning to the end of each piece, after a 0."""
        return np.cumsum([0.0, *(self.integral(piece, piece[3]) for piece in self.pieces)])

    def until(self, place: float) -> float:
        """The integral of the density from the arc's beginning to a place."""
        i = max(i for i, piece in enumerate(self.pieces) if piece[2] <= place)
        return float(self.whole[i]) + self.integral(self.pieces[i], place)

    def at(self, place: float) -> Floats:
        return np.array([np.interp(place, self.reached, self.vertices[:, axis]) for axis in range(3)])

    @property
    def anchors(self) -> list[int]:
        """Sharp vertices, the sharper of two too close; one that lost comes back if the one that beat it goes."""
        kept: list[int] = []
        beaten: list[int] = []  # by the last one that is kept, the first of them first
        closest = min(CLOSEST, self.spacing)
        for i in range(len(self.reached) - self.closed):
            to_end = min(self.reached[i], self.reached[-1] - self.reached[i])
            if self.curvature[i] < SHARP or (not self.closed and 0 < to_end < SLIGHT and i not in self.held):
                continue
            if not kept or self.reached[i] - self.reached[kept[-1]] >= closest:
                kept, beaten = [*kept, i], []
            elif self.curvature[i] > SHARPER * self.curvature[kept[-1]] and not (self.closed and len(kept) == 1):
                beaten.append(kept.pop())
                if self.reached[i] - self.reached[beaten[0]] >= closest:
                    kept, beaten = [*kept, beaten[0]], []
                kept.append(i)
        if self.closed and len(kept) > 1 and self.reached[-1] - self.reached[kept[-1]] < closest:
            kept[-1:] = [i for i in beaten[:1] if self.reached[-1] - self.reached[i] >= closest]
        return kept

    @property
    def places(self) -> list[float]:
        """The arc lengths of all points."""
        length, anchors = float(self.reached[-1]), [float(self.reached[i]) for i in self.anchors]
        if length < SLIGHT:
            return []
        if self.closed and not anchors:
            return self._between(0.0, length, 0.0, 0.0)
        places = list(anchors)
        ends = [*anchors, length] if self.closed else [0.0, *anchors, length]
        for start, stop in itertools.pairwise(ends):
            lead = 1.0 if start in anchors else 0.5
            trail = 1.0 if stop in anchors or self.closed else 0.5
            if stop > start:
                places += self._between(start, stop, lead, trail)
        return places

    def _between(self, start: float, stop: float, lead: float, trail: float) -> list[float]:
        """Points at equal steps of which the first is ``lead`` and the last ``trail`` steps from the ends."""
        mass = self.until(stop) - self.until(start)
        extra = lead + trail - 1 if lead else 0
        fitting = int((stop - start) / min(CLOSEST, self.spacing) - extra + 1e-6)
        count = max(1 if lead + trail < 1.5 else 0, min(math.floor(mass - extra + 0.5), fitting))
        return self.spread(start, stop, count, lead, extra)

    def spread(self, start: float, stop: float, count: int, lead: float, extra: float) -> list[float]:
        """Places at equal steps; there are ``extra`` more steps than points, and the first point is after ``lead``."""
        begin = self.until(start)
        mass = self.until(stop) - begin
        wanted = [begin + mass * (j + lead) / (count + extra) for j in range(count)]
        return [brentq(lambda t, goal=goal: self.until(t) - goal, start, stop, xtol=1e-14) for goal in wanted]


def lines(arcs: Arcs, curvature: Floats, spacing: float) -> list[Line]:
    """The arcs, divided at bridges; closed ones begin at the same vertex as in the compiled version."""
    found = []
    for k, (start, closed) in enumerate(zip(arcs.starts[:-1], arcs.closed, strict=True)):
        of = np.arange(start, arcs.starts[k + 1])
        if closed:
            bridges = [i for i in of[:-1] if arcs.faces[i] < 0]
            begin = max(of[:-1], key=lambda i: (curvature[i] >= SHARP, arcs.vertices[i] @ [0.83, 0.49, 0.27]))
            of = np.roll(of[:-1], -(bridges[-1] + 1 if bridges else begin) + start)
            of = of if bridges else np.append(of, of[0])
            closed = not bridges
        for part in np.split(of, 1 + np.flatnonzero(arcs.faces[of[:-1]] < 0)):
            vertices, quads = arcs.vertices[part], arcs.quads[part]
            quads[-1] = quads[-2]
            reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(vertices, axis=0), axis=1))])
            found.append(Line(vertices, reached, curvature[part], quads, bool(closed), spacing, object=arcs.objects[k]))
    return found
