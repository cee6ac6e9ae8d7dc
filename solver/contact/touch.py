"""Touch: from hands and objects to control points (section 4.2 of the paper)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..curves import SPACING
from ..geometry import frozen
from ..points import MAX_POINTS, ControlPoints
from .arcs import Arcs
from .hand import QUADS, Hand
from .mesh import Mesh

__all__ = ["LEAST_SPACING", "MOST_OBJECTS", "MOST_POINTS", "Touch", "Toucher", "touch"]

MOST_POINTS = 32
"""Control points by default at most: a whole section of the paper's cube; the more there are, the weaker is each."""

LEAST_SPACING = 1e-3
"""Least spacing in metres: far below what a focus resolves."""

MOST_HANDS = 16
MOST_OBJECTS = 256
"""Hands and objects at once, so that no call takes unbounded time."""

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
    ids : (m,) int
        Identities of the points: one that survives from frame to frame keeps its own, and none is used twice.
    objects : (m,) int
        The object that each point is on.
    quads : (m,) int
        The quadrilateral that each point is in, hand · 16 + quad.
    anchors : (m,) bool
        Which points stand for crossings of sharp edges.
    """

    cuts: Arcs
    points: ControlPoints | None
    ids: NDArray[np.int64]
    objects: NDArray[np.int64]
    quads: NDArray[np.int64]
    anchors: NDArray[np.bool_]

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
    How points are placed is described in `density`, and how they are followed in `tracking`. Objects are known by their
    place in the sequence and their solid, hands by their nearness.
    """

    def __init__(self, spacing: float = SPACING, corners: bool = True, most_points: int = MOST_POINTS) -> None:
        if not LEAST_SPACING <= spacing < math.inf:
            raise ValueError(f"spacing {spacing} m must be finite and at least {LEAST_SPACING:g} m")
        if not 1 <= most_points <= MAX_POINTS:
            raise ValueError(f"most_points is {most_points}; it must be from 1 to {MAX_POINTS}")
        from .cut import cut  # compiled, as are the others
        from .density import curvature_of
        from .tracking import follow, motion

        self._cut, self._curvature_of, self._follow, self._motion = cut, curvature_of, follow, motion
        self._spacing, self._corners, self._most = float(spacing), bool(corners), int(most_points)
        self._fresh = 0
        self.forget()

    def forget(self) -> None:
        """Begin anew with the next frame: none of its points is one of before."""
        self._positions, self._ids = np.empty((0, 3)), np.empty(0, dtype=np.int64)
        self._marks = np.empty((0, 3), dtype=np.int64)
        self._quads = np.empty((0, QUADS, 4, 3))
        self._objects: tuple[Mesh, ...] = ()

    def touch(self, hands: Hand | Sequence[Hand], objects: Mesh | Sequence[Mesh]) -> Touch:
        """What hands feel of objects in the next frame.

        Parameters
        ----------
        hands : Hand or sequence of Hand
            None at all is possible.
        objects : Mesh or sequence of Mesh
            In the same order in each frame.

        Raises
        ------
        ValueError
            If there are too many hands or objects, or something else than them.
        """
        quads = _quads(_several(hands, Hand, "hand", MOST_HANDS))
        meshes = _several(objects, Mesh, "object", MOST_OBJECTS)
        arcs = self._cut(quads.reshape(-1, 4, 3), meshes, hands=True)
        moved = self._carry(meshes, quads)
        self._positions, amplitudes, self._marks, self._ids, self._fresh = self._follow(
            arcs.vertices,
            arcs.starts,
            arcs.closed,
            arcs.objects,
            arcs.quads,
            self._curvature(arcs, meshes),
            self._spacing,
            self._most,
            moved,
            self._positions,
            self._marks,
            self._ids,
            self._fresh,
        )
        self._quads, self._objects = quads, meshes
        points = ControlPoints(self._positions, amplitudes) if len(amplitudes) else None
        on, within, anchors = frozen(self._marks).T
        return Touch(arcs, points, frozen(self._ids), on, within, frozen(anchors == 1))

    def _curvature(self, arcs: Arcs, meshes: tuple[Mesh, ...]) -> NDArray[np.float64]:
        """(k,) radians at the vertices of arcs; 0 if corners are not to be felt."""
        curvature = np.zeros(len(arcs.vertices))
        for i, mesh in enumerate(meshes if self._corners else ()):
            values = mesh.solid.edge_curvature
            self._curvature_of(i, values, arcs.objects, arcs.starts, arcs.edges, arcs.along, curvature)
        return curvature

    def _carry(self, meshes: tuple[Mesh, ...], quads: NDArray[np.float64]) -> NDArray[np.float64]:
        """Move the last points with their objects, and say how far hands have moved since, as seen from each object.

        Returns
        -------
        (o, h) float
            In metres; inf if the hand or the object is another one.
        """
        moved = np.full((len(meshes), len(quads)), math.inf)
        for i, (mesh, before) in enumerate(zip(meshes, self._objects, strict=False)):
            if mesh is before:
                moved[i] = self._motion(quads, self._quads)
            elif mesh.solid is before.solid:
                turn = mesh.rotation @ before.rotation.T
                shift = mesh.offset - turn @ before.offset
                moved[i] = self._motion(quads, self._quads @ turn.T + shift)
                on = self._marks[:, 0] == i
                self._positions[on] = self._positions[on] @ turn.T + shift
        return moved


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
    """(h, 16, 4, 3) quadrilaterals of all hands."""
    return np.array([hand.quads for hand in hands]).reshape(-1, QUADS, 4, 3)


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
