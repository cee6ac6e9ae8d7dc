"""The two halves of a frame, from their points to their drives."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..geometry import frozen
from ..shapes.points import ControlPoints
from .reference_engine import Engine
from .split import Split, split

__all__ = ["EnginePair", "Pair", "PairEngine"]


class Pair(NamedTuple):
    """What both halves of a frame emit.

    Parameters
    ----------
    split : Split
        Split of the points.
    drives : (2, n) complex
        Drives of each half, at full strength; 0 without a second half.
    levels : (2,) float
        Factor of each half, at most 1, with which both are equally loud relative to the wanted amplitudes.
    """

    split: Split
    drives: NDArray[Any]
    levels: NDArray[np.float64]


class PairEngine(Protocol):
    """Solves both halves of a frame, with the split and the phases of the last one."""

    def solve(self, points: ControlPoints, ids: NDArray[np.int64]) -> Pair:
        """The next frame; ``ids`` as for `Solver.solve`."""

    def forget(self) -> None:
        """Begin the next frame from scratch."""


class EnginePair:
    """An engine for each half, for the same array of so many transducers, step by step: any method will do."""

    def __init__(self, first: Engine, second: Engine, transducers: int) -> None:
        self._engines, self._transducers = (first, second), transducers
        self._split: Split | None = None

    def solve(self, points: ControlPoints, ids: NDArray[np.int64]) -> Pair:
        """The next frame."""
        cut = split(points, self._split, ids)
        relative = ControlPoints.trusted(points.positions, points.amplitudes / points.amplitudes.max())
        drives, levels = np.zeros((2, self._transducers), np.complex128), np.ones(2)
        for k, (engine, mask) in enumerate(zip(self._engines, cut.masks(points), strict=True)):
            if mask is None:
                levels[k] = levels[0]
            else:
                half = relative.part(mask)
                drive = engine.drive(half, ids[mask])
                drives[k], levels[k] = drive, engine.level(half, drive)
        self._split = cut
        return Pair(cut, frozen(drives), frozen(levels.min() / levels))

    def forget(self) -> None:
        """Begin the next frame from scratch."""
        self._split = None
        for engine in self._engines:
            engine.forget()
