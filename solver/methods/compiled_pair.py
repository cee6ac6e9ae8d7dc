"""Both halves of a frame in one compiled call, for live use.

numba takes half a second to import, so this module is imported at its first use.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..acoustics.tables import aligned, tables_of
from ..compiled import layout
from ..geometry import frozen
from ..shapes.points import ControlPoints, check_reachable
from . import paired_kernels
from .engine import settings_of, way_of
from .options import Options
from .paired import Pair
from .reference import cold_start
from .split import Split, split

__all__ = ["CompiledPair"]


class CompiledPair:
    """Both halves of a frame through `paired_kernels.drive_pair`, if `engine.solves_at_once`."""

    def __init__(self, array: TransducerArray, medium: Medium, method: str, options: Options) -> None:
        self._array, self._tables = array, tables_of(array, medium)
        way = way_of(self._tables, method, options)
        self._way: tuple[Any, ...] = (*way, settings_of(self._tables, options), options.phase_steps)
        self._kept_ids, self._kept = np.empty((2, 0), np.int64), np.empty((2, 2, 0), np.float32)
        self._counts = np.zeros(2, np.int64)
        self._split: Split | None = None

    def forget(self) -> None:
        """Begin the next frame from scratch."""
        self._counts[:] = 0
        self._split = None

    def solve(self, points: ControlPoints, ids: NDArray[np.int64]) -> Pair:
        """The next frame.

        `ValueError` if a point cannot be reached.
        """
        m = len(points)
        if m > self._kept.shape[2]:
            self._make_room(m)
        mask = np.empty(m, np.bool_)
        drives, levels = np.empty((2, len(self._array)), np.complex64), np.empty(2)
        cut = None if self._split is not None else split(points, None, ids)
        suspect = self._drive(points, ids, cut, mask, drives, levels)
        if suspect == paired_kernels.TURNED:
            cut = split(points, self._split, ids)
            suspect = self._drive(points, ids, cut, mask, drives, levels)
        if suspect >= 0:
            check_reachable(self._array, points)
            self._drive(points, ids, cut, mask, drives, levels, sure=True)
        if cut is None:
            assert self._split is not None
            cut = Split(frozen(mask), self._split.axis, ids)
        self._split = cut
        return Pair(cut, frozen(drives), frozen(levels))

    def _drive(
        self,
        points: ControlPoints,
        ids: NDArray[np.int64],
        cut: Split | None,
        mask: NDArray[np.bool_],
        drives: NDArray[np.complex64],
        levels: NDArray[np.float64],
        *,
        sure: bool = False,
    ) -> int:
        """By a split if it is known, or else by the axis of the last one."""
        basis = cut or self._split
        assert basis is not None
        if cut is not None:
            mask[:] = cut.mask
        drive_pair: Callable[..., int] = paired_kernels.drive_pair
        return drive_pair(
            *self._way,
            points.positions,
            points.amplitudes,
            ids,
            int(sure),
            int(cut is not None),
            basis.axis,
            basis.mask,
            basis.ids,
            mask,
            self._cold,
            self._work,
            self._u,
            self._counts,
            self._kept_ids,
            self._kept,
            drives,
            levels,
        )

    def _make_room(self, m: int) -> None:
        """For m points, with what is kept."""
        start = cold_start(m)
        self._cold = np.stack([start.real, start.imag]).astype(np.float32)
        self._work = aligned(layout.work_size(m, self._tables.elements.shape[1]))
        self._u = aligned(2, layout.pad(m))
        more = (0, m - self._kept.shape[2])
        self._kept_ids = np.pad(self._kept_ids, ((0, 0), more))
        self._kept = np.pad(self._kept, ((0, 0), (0, 0), more))
