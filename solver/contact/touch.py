"""Touch: from hands and objects to control points (section 4.2 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import flag, length, real, whole
from ..geometry import counted, frozen
from ..shapes.curves import SPACING
from ..shapes.points import MAX_POINTS, ControlPoints
from .arcs import Arcs
from .hand import Hand
from .mesh import Mesh, Solid
from .scene import Scene, poses

__all__ = ["LEAST_SPACING", "MOST_OBJECTS", "MOST_POINTS", "Touch", "Toucher", "touch"]

MOST_POINTS = 32
"""Control points by default at most: a whole section of the paper's cube; the more there are, the weaker is each."""

LEAST_SPACING = 1e-3
"""Least spacing in metres: far below what a focus resolves."""

FRAME_SECONDS = 0.01
"""Between frames without a time: trackers give about 100 a second."""

LATEST = 1e12
"""Largest time of a frame, in seconds: it still tells a millisecond from the next one."""

MOST_HANDS = 16
MOST_OBJECTS = 256
"""Hands and objects at once, so that no call takes unbounded time."""

_NO_QUADS = frozen(np.empty((0, 4, 3)))

Item = TypeVar("Item")


@dataclass(frozen=True, eq=False)
class Touch:
    """What hands feel of objects at one moment; true if they feel anything.

    Parameters
    ----------
    cuts : Arcs
        The arcs, with the faces, edges and quadrilaterals that they are made of.
    points : ControlPoints or None
        m control points on the arcs; None if nothing is touched. Radiation force goes with the square of the amplitude:
        with corners it rises to twice that of a flat face at edges of 90° and more.
    marks : (4, m) int
        What `ids`, `objects`, `quads` and `anchors` say of each point.
    """

    cuts: Arcs
    points: ControlPoints | None
    marks: NDArray[np.int64]

    def __repr__(self) -> str:
        return f"Touch({counted(0 if self.points is None else len(self.points), 'point')})"

    @property
    def ids(self) -> NDArray[np.int64]:
        """(m,) identities of the points: one that survives from frame to frame keeps its own, none is used twice."""
        return np.asarray(self.marks[0])

    @property
    def objects(self) -> NDArray[np.int64]:
        """(m,) the object that each point is on."""
        return np.asarray(self.marks[1])

    @property
    def quads(self) -> NDArray[np.int64]:
        """(m,) the quadrilateral that each point is in, hand · 16 + quad."""
        return np.asarray(self.marks[2])

    @property
    def anchors(self) -> NDArray[np.bool_]:
        """(m,) which points stand for crossings of sharp edges."""
        return np.asarray(self.marks[3] == 1)

    @cached_property
    def arcs(self) -> list[NDArray[np.float64]]:
        """The arcs as (k, 3) polylines in metres; closed ones repeat their first vertex."""
        return self.cuts.polylines()

    def __bool__(self) -> bool:
        return self.points is not None


class Toucher:
    """Finds what hands feel, frame after frame: points keep their identities, places and order as long as they can.

    Parameters
    ----------
    spacing : float
        Arc length between control points in metres, where nothing is curved; the paper's 15 mm by default.
    corners : bool
        Whether points are denser and stronger at edges and corners, by the paper's equation (13), and stand on sharp
        edges exactly. If not, they are evenly spaced and of equal strength.
    most_points : int
        Most control points. If an even density asks for more, edges and corners keep theirs, and the others are
        thinned alike.

    Raises
    ------
    ValueError
        If the spacing or the number of points is out of range.

    Notes
    -----
    A new point of a hand that feels the object already is felt after 30 ms; so what just grazes an edge makes no point.
    How points are placed is described in `density`, and how they are followed in `tracking`. Objects are known by their
    place in the sequence and their solid, hands by their nearness.
    """

    def __init__(self, spacing: float = SPACING, corners: bool = True, most_points: int = MOST_POINTS) -> None:
        self._spacing = length("spacing", spacing, least=LEAST_SPACING, above=False)
        self._corners, self._most = flag("corners", corners), whole("most_points", most_points, 1, MAX_POINTS)
        from .feeling import feel  # compiled

        self._feel = feel
        self._fresh = 0
        self._solids: tuple[Solid, ...] = ()
        self._scene = Scene.of((), self._corners)
        self.forget()

    def __repr__(self) -> str:
        return f"Toucher({self._spacing * 1e3:g} mm apart, at most {self._most} points)"

    def forget(self) -> None:
        """Begin anew with the next frame: all its points are new."""
        self._positions, self._marks = frozen(np.empty((0, 3))), frozen(np.empty((5, 0), dtype=np.int64))
        self._quads = _NO_QUADS
        self._time: float | None = None
        self._objects: tuple[Mesh, ...] = ()
        self._poses, self._same = poses(()), frozen(np.empty(0, dtype=np.bool_))

    def touch(self, hands: Hand | Sequence[Hand], objects: Mesh | Sequence[Mesh], time: float | None = None) -> Touch:
        """What hands feel of objects in the next frame.

        Parameters
        ----------
        hands : Hand or sequence of Hand
            It may be empty.
        objects : Mesh or sequence of Mesh
            The objects, in the same order in each frame.
        time : float, optional
            Time of the frame, in seconds by any clock. Without it, frames are taken to be `FRAME_SECONDS` apart.

        Raises
        ------
        ValueError
            If there are too many hands or objects, a value is of another type, or the time is not finite.
        """
        elapsed = self._elapsed(time)
        quads = _quads(_several(hands, Hand, "hand", MOST_HANDS))
        meshes = _several(objects, Mesh, "object", MOST_OBJECTS)
        before, known = self._poses, self._same
        if meshes != self._objects:
            known = self._enter(meshes)
        *cuts, positions, amplitudes, marks, tracked = self._feel(
            *self._scene,
            poses=self._poses,
            quads=quads,
            known=known,
            poses_before=before,
            quads_before=self._quads,
            positions=self._positions,
            marks=self._marks,
            fresh=self._fresh,
            elapsed=elapsed,
            spacing=self._spacing,
            most=self._most,
        )
        self._quads = quads
        self._positions, self._marks, self._fresh = tracked
        for each in (*cuts, positions, amplitudes, marks, self._positions, self._marks):
            frozen(each)
        points = ControlPoints.trusted(positions, amplitudes) if len(amplitudes) else None
        return Touch(Arcs(*cuts), points, marks)

    def _elapsed(self, time: float | None) -> int:
        """Microseconds since the last frame, 0 if time went backwards, at most a second."""
        if time is not None:
            time = real("time", time, -LATEST, LATEST, "s")
        last, self._time = self._time, time
        if time is None:
            return round(FRAME_SECONDS * 1e6)
        return round(min(max(time - last, 0.0), 1.0) * 1e6) if last is not None else 0

    def _enter(self, meshes: tuple[Mesh, ...]) -> NDArray[np.bool_]:
        """Take other objects, or the same ones elsewhere; which of them have the same solid as those before."""
        solids = tuple(mesh.solid for mesh in meshes)
        if solids != self._solids:
            self._scene = Scene.of(meshes, self._corners)
        last = [mesh.solid for mesh in self._objects]
        known = [i < len(last) and solid is last[i] for i, solid in enumerate(solids)]
        self._solids, self._objects, self._poses = solids, meshes, poses(meshes)
        self._same = frozen(np.ones(len(meshes), dtype=np.bool_))
        return frozen(np.array(known, dtype=np.bool_))


def touch(
    hands: Hand | Sequence[Hand],
    objects: Mesh | Sequence[Mesh],
    spacing: float = SPACING,
    corners: bool = True,
    most_points: int = MOST_POINTS,
) -> Touch:
    """What hands feel of objects at one moment: a `Toucher` for one frame; parameters and errors as there."""
    return Toucher(spacing, corners, most_points).touch(hands, objects)


def _quads(hands: tuple[Hand, ...]) -> NDArray[np.float64]:
    """(16 h, 4, 3) quadrilaterals of all hands."""
    if len(hands) == 1:
        return hands[0].quads
    return frozen(np.concatenate([hand.quads for hand in hands])) if hands else _NO_QUADS


def _several(values: Item | Sequence[Item], kind: type[Item], what: str, most: int) -> tuple[Item, ...]:
    """One value or a sequence of them as a tuple."""
    if isinstance(values, kind):
        return (values,)
    if not isinstance(values, Sequence):
        raise ValueError(f"{what}s are a {type(values).__name__}; they must be a {kind.__name__} or a sequence of them")
    if len(values) > most:
        raise ValueError(f"there are {len(values)} {what}s; at most {most} are possible")
    for i, value in enumerate(values):
        if not isinstance(value, kind):
            raise ValueError(f"{what} {i} is a {type(value).__name__}; it must be a {kind.__name__}")
    return tuple(values)
