"""The objects that a page can choose from, and where it puts them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ..solver.contact.mesh import SIZE, Mesh
from ..solver.contact.solids import SOLIDS
from ..solver.objects.parsing import MovingObject
from .settings import MOST_OBJECTS, ObjectSetting

__all__ = ["Shelf"]

MOST_SIZES = 32
"""Of objects that are kept ready for cuts."""


class Shelf:
    """The paper's shapes, and the objects that a command names, with their names; `ValueError` if there are too many.

    A page can name no file: it chooses among the files that the command was given.
    """

    def __init__(self, named: Sequence[tuple[str, MovingObject]]) -> None:
        if len(named) > MOST_OBJECTS:
            raise ValueError(f"{len(named)} objects are too many for a page; it shows at most {MOST_OBJECTS}")
        self._named = tuple(named)
        self._files = {name: thing.mesh for name, thing in named if name not in SOLIDS}
        self.kinds = (*SOLIDS, *self._files)
        self.settings = tuple(self._setting(number, *each) for number, each in enumerate(named))
        """The command's objects as settings."""
        self._sized = lru_cache(MOST_SIZES)(self._of_size)

    def put(self, settings: Sequence[ObjectSetting]) -> tuple[MovingObject, ...]:
        """The objects of a page, ready to be cut. An object of the command goes on moving as it did."""
        return tuple(self._put(setting) for setting in settings)

    def _put(self, setting: ObjectSetting) -> MovingObject:
        mesh = self._sized(setting.kind, round(setting.size, 4))
        at = np.array([setting.x, setting.y, setting.z])
        mesh = mesh.moved(at - mesh.centre).rotated(setting.rotation)
        if setting.number is not None and setting.number < len(self._named):
            _, thing = self._named[setting.number]
            return MovingObject(mesh, thing.velocity, thing.spin)
        return MovingObject(mesh)

    def _of_size(self, kind: str, size: float) -> Mesh:
        """An object of a size, ready to be cut."""
        mesh = self._base(kind).scaled(size / self._nominal(kind))
        _ = mesh.solid.tables, mesh.solid.edge_curvature  # prepared here, not in the loop that plays
        return mesh

    def _base(self, kind: str) -> Mesh:
        """An object as it was read, or a shape of the paper in its usual size."""
        made: Mesh = self._files[kind] if kind in self._files else getattr(Mesh, kind)(SIZE)
        return made

    def _nominal(self, kind: str) -> float:
        """The size of that, as a page counts it: the paper's for its shapes, the longest side for a file."""
        return SIZE if kind in SOLIDS else _longest(self._files[kind])

    def _setting(self, number: int, name: str, thing: MovingObject) -> ObjectSetting:
        """Where the command has put an object."""
        mesh, rotation = thing.mesh, 0.0
        if name in SOLIDS:  # a file was read in its rotation
            rotation = math.degrees(math.atan2(mesh.rotation[1, 0], mesh.rotation[0, 0]))
        x, y, z = mesh.centre.tolist()
        size = self._nominal(name) * _longest(mesh.rotated(-rotation)) / _longest(self._base(name))
        return ObjectSetting(name, x, y, z, size, rotation, number)


def _longest(mesh: Mesh) -> float:
    """The longest side of the bounding box, in metres."""
    return float(np.ptp(mesh.vertices, axis=0).max())
