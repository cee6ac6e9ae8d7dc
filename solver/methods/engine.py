"""The compiled engine: one update at a time through the float32 kernels.

numba takes half a second to import, so this module is imported at its first use.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..acoustics.propagation import PAIRS_AT_A_TIME, transfer_matrix
from ..acoustics.tables import ArrayTables, aligned, can_reach, tables_of
from ..compiled import block_kernels, kernels
from ..compiled.simd import LANES
from ..compiled.threads import THREADS
from ..shapes.points import REACH, ControlPoints, check_reachable
from .methods import METHODS, Kernels
from .options import FLAT, GRADIENTS, HEADROOM, LEAST_GAIN, NUDGE, TOLERANCE, Options
from .reference import cold_start
from .reference_engine import drive_each

__all__ = ["CompiledEngine", "solves_at_once"]

OUTPUTS = {"solved": kernels.SOLVED, "phase": kernels.PHASE, "limited": kernels.LIMITED}
NO_IDS = np.empty(0, np.int64)
HEADROOM32, NUDGE32 = np.float32(HEADROOM), np.float32(NUDGE)
TOLERANCE32, FLAT32 = np.float32(TOLERANCE), np.float32(FLAT)


def kernels_of(method: str) -> Kernels:
    """The kernels of a method that has some."""
    found = METHODS[method].kernels
    assert found is not None
    return found


def is_modelled(tables: ArrayTables) -> bool:
    """Whether the kernels model the air well enough as far as points may be."""
    low, high = tables.bounds[:2]
    return can_reach(tables, REACH + float(np.linalg.norm(high - low)))


def solves_at_once(tables: ArrayTables, method: str, options: Options) -> bool:
    """Whether one kernel takes points to drives: without a clock, and if the directivity is a polynomial."""
    uses = kernels_of(method)
    timeless = uses.weighed and not uses.polished and options.phase_seconds is None
    return timeless and len(tables.wave) == 1 and is_modelled(tables)


class CompiledEngine:
    """One update at a time in float32, with its buffers and the phases of the last one.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    medium : Medium
        The air.
    method : str
        One of `METHODS` that has kernels.
    options : Options
        With an output policy.
    threads : int, optional
        That a big problem is shared among, `THREADS` by default. They do not change a bit of the result.
    """

    def __init__(
        self, array: TransducerArray, medium: Medium, method: str, options: Options, threads: int | None = None
    ) -> None:
        self._array, self._medium, self._uses, self._options = array, medium, kernels_of(method), options
        self._threads = threads or THREADS
        self._tables = tables_of(array, medium)
        self._modelled = is_modelled(self._tables)
        self._at_once = solves_at_once(self._tables, method, options)
        self._columns = self._tables.elements.shape[1]
        self._capacity = 0
        self._cold = self._u = self._spare = aligned(2, 0)
        self.forget()
        self._gamma, self._mu = np.float32(options.gamma), np.float32(options.mu)
        self._output = OUTPUTS[options.policy]
        self._power = options.phases == "power"
        self._steps = options.steps if self._uses.corrected else 0

    def forget(self) -> None:
        """Begin the next update's phases anew."""
        self._ids = NO_IDS

    def drive(
        self, points: ControlPoints, ids: NDArray[np.int64] | None = None, *, keep: bool = False
    ) -> NDArray[np.complex64]:
        """Drives (n,) for control points; see `Engine.drive`.

        Raises
        ------
        ValueError
            If a point cannot be reached.
        """
        m = len(points)
        self._make_room(m)
        self._model(points)
        drive = np.empty(len(self._array), dtype=np.complex64)
        elements, work = self._tables.elements, self._work
        if not self._uses.weighed:
            kernels.sum_foci(elements, m, self._output, HEADROOM32, work, drive)
            return drive
        if keep and len(self._ids) == m:
            self._begin(m, 0)
        else:
            self._find_phases(m, ids)
        kernels.finish(
            elements=elements,
            m=m,
            u=self._u,
            mu=self._mu,
            output=self._output,
            headroom=HEADROOM32,
            tolerance=TOLERANCE32,
            gradients=GRADIENTS,
            flat=FLAT32,
            steps=self._steps,
            work=work,
            drive=drive,
        )
        if self._uses.polished:
            kernels.polish(m, self._columns, self._options.levels, self._options.sweeps, LEAST_GAIN, work, drive)
        return drive

    def level(self, points: ControlPoints, drive: NDArray[np.complex64]) -> float:
        """What `Engine.level` is, from the transfer matrix that `drive` has left in the work space."""
        relative = kernels.level(len(points), self._columns, self._uses.weighed, self._work, drive)
        return relative * self._tables.strength / float(points.amplitudes.max())

    def drive_frames(self, frames: Sequence[ControlPoints], first: int, stride: int, drives: NDArray[Any]) -> None:
        """Solve every ``stride``-th frame from ``first`` on, from scratch each, into drives (frames, n).

        Raises
        ------
        ValueError
            As `drive`.
        """
        tables, options = self._tables, self._options
        largest = max(len(points) for points in frames)
        if not self._at_once or self._is_big(largest):
            drive_each(self, frames, first, stride, drives)
            return
        begins = np.cumsum([0, *(len(points) for points in frames)])
        self._make_room(largest)
        self.forget()
        self._start(largest)
        suspect = kernels.update_frames(
            elements=tables.elements,
            directivity=tables.wave[0],
            turns=tables.turns,
            nepers=tables.nepers,
            origin=tables.origin,
            bounds=tables.bounds,
            farthest=REACH,
            points=np.concatenate([points.positions for points in frames]),
            amplitudes=np.concatenate([points.amplitudes for points in frames]),
            begins=begins,
            first=first,
            stride=stride,
            gamma=self._gamma,
            phase_steps=options.phase_steps,
            power=self._power,
            cold=self._cold,
            mu=self._mu,
            output=self._output,
            headroom=HEADROOM32,
            tolerance=TOLERANCE32,
            gradients=GRADIENTS,
            flat=FLAT32,
            steps=self._steps,
            work=self._work,
            u=aligned(self._cold.size),
            drives=drives,
        )
        self.forget()
        if suspect >= 0:
            for index in range(suspect, len(frames), stride):
                check_reachable(self._array, frames[index], f"frame {index}: ")

    def _make_room(self, m: int) -> None:
        if m > self._capacity:
            self._work = aligned(kernels.work_size(m, self._columns))
            self._capacity = m

    def _start(self, m: int, ids: NDArray[np.int64] | None = None) -> None:
        """Phases to begin with: those of the same points of the last frame, or else cold ones."""
        if (width := -(-m // LANES) * LANES) != self._cold.shape[1]:
            start = cold_start(width)
            self._cold = aligned(2, width)
            self._cold[0], self._cold[1] = start.real, start.imag
        if ids is None:
            ids = np.arange(m, dtype=np.int64)
            if len(self._ids) != m:
                self.forget()
        if self._spare.shape[1] != width:
            self._spare = aligned(2, width)
        kernels.carry(m, ids, self._ids, self._u, self._cold, NUDGE32, self._spare)
        self._ids, self._u, self._spare = ids, self._spare, self._u

    def _model(self, points: ControlPoints) -> None:
        tables = self._tables
        if self._modelled:
            kernel: Callable[..., int] = kernels.model if len(tables.wave) == 1 else kernels.model_by_table
            suspect = kernel(
                tables.elements,
                *tables.wave,
                tables.turns,
                tables.nepers,
                tables.origin,
                tables.bounds,
                REACH,
                points.positions,
                points.amplitudes,
                self._work,
            )
            if suspect >= 0:
                check_reachable(self._array, points)
        else:
            check_reachable(self._array, points)
            self._enter(points)

    def _enter(self, points: ControlPoints) -> None:
        """Do what `kernels.model` does, with the transfer matrix from `transfer_matrix`."""
        m, n = len(points), len(self._array)
        parts = kernels.carve(self._work, m, self._columns)
        re, im, reach = parts.re, parts.im, parts.spans[kernels.REACH]
        wanted = points.amplitudes / points.amplitudes.max()
        parts.vectors[kernels.WANTED][:m] = wanted
        re[:m, n:] = im[:m, n:] = reach[:] = 0
        at_a_time = max(1, PAIRS_AT_A_TIME // n)
        for first in range(0, m, at_a_time):
            part = slice(first, min(first + at_a_time, m))
            matrix = transfer_matrix(self._array, points.positions[part], self._medium) / self._tables.strength
            matrix *= self._array.able
            re[part, :n], im[part, :n] = matrix.real, matrix.imag
            reach[:n] += wanted[part] @ np.abs(matrix)

    def _find_phases(self, m: int, ids: NDArray[np.int64] | None) -> None:
        options = self._options
        self._start(m, ids)
        if options.phase_seconds is None:
            self._begin(m, options.phase_steps)
            return
        self._begin(m, 0)
        end = perf_counter() + options.phase_seconds
        for _ in range(options.phase_steps):
            if perf_counter() >= end:
                return
            kernels.more_phases(m, self._columns, 1, self._power, self._u, self._work)

    def _begin(self, m: int, phase_steps: int) -> None:
        """From the transfer matrix to the phases after some steps."""
        settings = m, self._columns, self._gamma, phase_steps, self._power, self._u, self._work
        if self._is_big(m):
            block_kernels.begin(*settings, threads=self._threads)
        else:
            kernels.begin(*settings)

    def _is_big(self, m: int) -> bool:
        return bool(m * self._columns >= block_kernels.BLOCKED_PAIRS)
