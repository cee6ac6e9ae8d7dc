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
from ..compiled import block_kernels, layout, propagation, updates
from ..compiled.threads import THREADS
from ..shapes.points import REACH, ControlPoints, check_reachable
from .methods import METHODS, Kernels
from .options import ALONE, BETTER, FLAT, GRADIENTS, HEADROOM, KEPT, LEAST_GAIN, NUDGE, TOLERANCE, Options
from .reference import cold_start
from .reference_engine import drive_each

__all__ = ["CompiledEngine", "settings_of", "solves_at_once", "way_of"]

OUTPUTS = {"solved": layout.SOLVED, "phase": layout.PHASE, "limited": layout.LIMITED}
NO_IDS = np.empty(0, np.int64)


def kernels_of(method: str) -> Kernels:
    """The kernels of a method that has some."""
    found = METHODS[method].kernels
    assert found is not None
    return found


def is_modelled(tables: ArrayTables) -> bool:
    """Whether the kernels model the air well enough as far as points may be."""
    low, high = tables.bounds[:2]
    return can_reach(tables, REACH + float(np.linalg.norm(high - low)))


def is_timeless(tables: ArrayTables, method: str, options: Options) -> bool:
    """Whether one kernel takes points to the drives of a least squares solution, without a clock."""
    polynomial = len(tables.wave) == 1
    return kernels_of(method).weighed and options.phase_seconds is None and polynomial and is_modelled(tables)


def solves_at_once(tables: ArrayTables, method: str, options: Options) -> bool:
    """Whether one kernel takes points to drives, so that no other one must follow."""
    return is_timeless(tables, method, options) and not kernels_of(method).polished


def settings_of(tables: ArrayTables, options: Options) -> NDArray[np.float32]:
    """The numbers of an update as kernels read them."""
    settings = np.empty(layout.SETTINGS, np.float32)
    settings[layout.TURNS], settings[layout.GAMMA], settings[layout.MU] = tables.turns, options.gamma, options.mu
    settings[layout.HEADROOM], settings[layout.NUDGE] = HEADROOM, NUDGE
    settings[layout.TOLERANCE], settings[layout.FLAT], settings[layout.KEPT] = TOLERANCE, FLAT, KEPT
    settings[layout.ALONE], settings[layout.BETTER] = ALONE, BETTER
    return settings


def way_of(tables: ArrayTables, method: str, options: Options) -> tuple[Any, ...]:
    """The first arguments of kernels that solve at once, which are the same in each update."""
    return (
        tables.elements,
        tables.wave[0],
        tables.nepers,
        tables.origin,
        tables.bounds,
        REACH,
        int(options.phases == "power"),
        OUTPUTS[options.policy],
        options.steps if kernels_of(method).corrected else 0,
        GRADIENTS,
    )


class CompiledEngine:
    """One update at a time in float32, with its buffers and the phases of the last one, by a method that has kernels.

    ``threads``, `THREADS` by default, share a big problem; they do not change a bit of the result.
    """

    def __init__(
        self, array: TransducerArray, medium: Medium, method: str, options: Options, threads: int | None = None
    ) -> None:
        self._array, self._medium, self._uses, self._options = array, medium, kernels_of(method), options
        self._threads = threads or THREADS
        self._tables = tables_of(array, medium)
        self._modelled = is_modelled(self._tables)
        self._timeless = is_timeless(self._tables, method, options)
        self._transducers, self._columns = len(array), self._tables.elements.shape[1]
        self._settings = settings_of(self._tables, options)
        self._held = self._settings.copy()
        self._held[layout.NUDGE] = 0
        self._way = way_of(self._tables, method, options)
        *_, self._power, self._output, self._steps, self._gradients = self._way
        self._most, self._plain, self._phases, self._last = 0, NO_IDS, aligned(3, 2, 0), 1
        self.forget()

    def forget(self) -> None:
        """Begin the next update's phases anew."""
        self._ids = NO_IDS

    def drive(
        self, points: ControlPoints, ids: NDArray[np.int64] | None = None, *, keep: bool = False
    ) -> NDArray[np.complex128]:
        """Drives (n,) for control points; see `Engine.drive`.

        `ValueError` if a point cannot be reached.
        """
        m = len(points.positions)
        if m > self._most:
            self._make_room(m)
        drive = np.empty(self._transducers, np.complex128)
        if not self._uses.weighed:
            self._model(points)
            updates.sum_foci(self._tables.elements, m, self._output, self._settings[layout.HEADROOM], self._work, drive)
            return drive
        before = self._ids
        if ids is None:
            if len(self._plain) != m:
                self._plain = np.arange(m, dtype=np.int64)
            ids = self._plain
            if len(before) != m:
                before = NO_IDS
        held = keep and len(before) == m
        settings, phase_steps = (self._held, 0) if held else (self._settings, self._options.phase_steps)
        solve = self._solve_at_once if self._timeless and not self._is_big(m) else self._solve_in_steps
        solve(settings, phase_steps, points, ids, before, drive)
        if self._uses.polished:
            polished = drive.astype(np.complex64)
            updates.polish(
                m, self._columns, self._options.levels, self._options.sweeps, LEAST_GAIN, self._work, polished
            )
            drive[:] = polished
        return drive

    def _solve_at_once(
        self,
        settings: NDArray[np.float32],
        phase_steps: int,
        points: ControlPoints,
        ids: NDArray[np.int64],
        before: NDArray[np.int64],
        drive: NDArray[np.complex128],
    ) -> None:
        arguments: tuple[Any, ...] = (
            *self._way,
            settings,
            phase_steps,
            points.positions,
            points.amplitudes,
            ids,
            before,
            self._phases,
            self._last,
            self._work,
            drive,
        )
        update: Callable[..., int] = updates.update
        if update(*arguments, 0) >= 0:
            check_reachable(self._array, points)
            update(*arguments, 1)
        self._ids, self._last = ids, 3 - self._last

    def _solve_in_steps(
        self,
        settings: NDArray[np.float32],
        phase_steps: int,
        points: ControlPoints,
        ids: NDArray[np.int64],
        before: NDArray[np.int64],
        drive: NDArray[np.complex128],
    ) -> None:
        """What `_solve_at_once` does, for any transducer, for big problems and with a clock."""
        m, columns, work, power = len(points), self._columns, self._work, self._power
        self._model(points)
        cold, last, u = (self._phases[place] for place in (layout.COLD, self._last, 3 - self._last))
        updates.carry(m, ids, before, last, cold, settings[layout.NUDGE], u)
        self._ids, self._last = ids, 3 - self._last
        seconds = self._options.phase_seconds
        first_steps = phase_steps if seconds is None else 0
        if self._is_big(m):
            gamma = settings[layout.GAMMA]
            block_kernels.begin(m, columns, gamma, first_steps, power, u, work, threads=self._threads)
        else:
            updates.begin(m, columns, settings[layout.GAMMA], first_steps, power, u, work)
        if seconds is not None:
            end = perf_counter() + seconds
            for _ in range(phase_steps):
                if perf_counter() >= end:
                    break
                updates.more_phases(m, columns, 1, power, u, work)
        updates.finish(
            elements=self._tables.elements,
            m=m,
            u=u,
            settings=settings,
            output=self._output,
            gradients=self._gradients,
            steps=self._steps,
            work=work,
            drive=drive,
        )

    def level(self, points: ControlPoints, drive: NDArray[np.complex64]) -> float:
        """What `Engine.level` is, from the transfer matrix that `drive` has left in the work space."""
        relative = updates.level(len(points), self._columns, self._uses.weighed, self._work, drive)
        return relative * self._tables.strength / float(points.amplitudes.max())

    def drive_frames(self, frames: Sequence[ControlPoints], first: int, stride: int, drives: NDArray[Any]) -> None:
        """Solve every ``stride``-th frame from ``first`` on, from scratch each, into drives (frames, n).

        `ValueError` as `drive`.
        """
        largest = max(len(points) for points in frames)
        if self._uses.polished or not self._timeless or self._is_big(largest):
            drive_each(self, frames, first, stride, drives)
            return
        begins = np.cumsum([0, *(len(points) for points in frames)])
        if largest > self._most:
            self._make_room(largest)
        self.forget()
        update_frames: Callable[..., int] = updates.update_frames
        suspect = update_frames(
            *self._way,
            self._settings,
            self._options.phase_steps,
            np.concatenate([points.positions for points in frames]),
            np.concatenate([points.amplitudes for points in frames]),
            begins,
            first,
            stride,
            np.arange(largest, dtype=np.int64),
            self._phases,
            self._work,
            drives,
        )
        if suspect >= 0:
            for index in range(suspect, len(frames), stride):
                check_reachable(self._array, frames[index], f"frame {index}: ")

    def _make_room(self, m: int) -> None:
        """For m points, with the phases of the last ones."""
        self._most, width = m, layout.pad(m)
        start, kept = cold_start(width), self._phases
        self._phases = aligned(3, 2, width)
        self._phases[:, :, : kept.shape[2]] = kept
        self._phases[layout.COLD] = start.real, start.imag
        self._work = aligned(layout.work_size(m, self._columns))

    def _model(self, points: ControlPoints) -> None:
        tables = self._tables
        if self._modelled:
            kernel: Callable[..., int] = propagation.model if len(tables.wave) == 1 else propagation.model_by_table
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
        """Do what `propagation.model` does, with the transfer matrix from `transfer_matrix`."""
        m, n = len(points), self._transducers
        parts = layout.carve(self._work, m, self._columns)
        re, im, reach = parts.re, parts.im, parts.spans[layout.REACH]
        wanted = points.amplitudes / points.amplitudes.max()
        parts.vectors[layout.WANTED][:m] = wanted
        re[:m, n:] = im[:m, n:] = reach[:] = 0
        at_a_time = max(1, PAIRS_AT_A_TIME // n)
        for first in range(0, m, at_a_time):
            part = slice(first, min(first + at_a_time, m))
            matrix = transfer_matrix(self._array, points.positions[part], self._medium) / self._tables.strength
            matrix *= self._array.able
            re[part, :n], im[part, :n] = matrix.real, matrix.imag
            reach[:n] += wanted[part] @ np.abs(matrix)

    def _is_big(self, m: int) -> bool:
        return bool(m * self._columns >= block_kernels.BLOCKED_PAIRS)
