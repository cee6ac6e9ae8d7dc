"""The protocol of engines, and the engine that uses the readable functions of the methods, in complex128."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..acoustics.array import TransducerArray
from ..acoustics.medium import Medium
from ..acoustics.propagation import transfer_matrix
from ..shapes.points import ControlPoints, check_reachable
from .methods import METHODS, Problem
from .options import NUDGE, Options, Phases
from .reference import Complex, Real, cold_start, phase_iteration, unit

__all__ = ["Engine", "ReferenceEngine", "drive_each"]


class Engine(Protocol):
    """What finds drives, with the phases of the last frame."""

    def forget(self) -> None:
        """Begin the next update's phases anew."""

    def drive(self, points: ControlPoints, ids: NDArray[np.int64] | None = None, *, keep: bool = False) -> NDArray[Any]:
        """Drives (n,) complex for control points; ``ids`` as for `Solver.solve`.

        With ``keep`` points that were all in the last frame begin with the phases that they had there, unchanged.
        """

    def level(self, points: ControlPoints, drive: NDArray[Any]) -> float:
        """|p| at the points per wanted amplitude, in pascals, as the least squares have it.

        ``drive`` must be the last result of `drive`, for these points.
        """

    def drive_frames(
        self, frames: Sequence[ControlPoints], first: int, stride: int, drives: NDArray[np.complex64]
    ) -> None:
        """Solve every ``stride``-th frame from ``first`` on, from scratch each, into drives (frames, n)."""


def drive_each(
    engine: Engine, frames: Sequence[ControlPoints], first: int, stride: int, drives: NDArray[np.complex64]
) -> None:
    """Let an engine solve every ``stride``-th frame from ``first`` on, from scratch each; an error names the frame."""
    for index in range(first, len(frames), stride):
        engine.forget()
        try:
            drives[index] = engine.drive(frames[index])
        except ValueError as error:
            raise ValueError(f"frame {index}: {error}") from error
    engine.forget()


class ReferenceEngine:
    """One update at a time in complex128, with the phases of the last one.

    Parameters are those of `engine.CompiledEngine`; any method will do.
    """

    def __init__(self, array: TransducerArray, medium: Medium, method: str, options: Options) -> None:
        self._array, self._medium, self._method, self._options = array, medium, METHODS[method], options
        self._limits = np.where(array.able, array.limits, 0.0)
        self.forget()

    def forget(self) -> None:
        """Begin the next update's phases anew."""
        self._ids, self._u = np.empty(0, np.int64), np.empty(0, np.complex128)

    def drive(self, points: ControlPoints, ids: NDArray[np.int64] | None = None, *, keep: bool = False) -> Complex:
        """Drives (n,) for control points; see `Engine.drive`.

        `ValueError` if a point cannot be reached, or the system is singular.
        """
        check_reachable(self._array, points)
        transfer = transfer_matrix(self._array, points.positions, self._medium) * (self._limits > 0)
        wanted = points.amplitudes / points.amplitudes.max()

        def phases(gram: Complex, way: Phases) -> Complex:
            return unit(self._u) if keep and len(self._u) == len(wanted) else self._phases(gram, wanted, ids, way)

        return self._method.solve(Problem(transfer, wanted, self._limits, self._options, phases))

    def level(self, points: ControlPoints, drive: Complex) -> float:
        """|p| at the points per wanted amplitude, in pascals; see `Engine.level`."""
        reached = np.abs(transfer_matrix(self._array, points.positions, self._medium) @ drive)
        return float(points.amplitudes @ reached / (points.amplitudes @ points.amplitudes))

    def drive_frames(
        self, frames: Sequence[ControlPoints], first: int, stride: int, drives: NDArray[np.complex64]
    ) -> None:
        """Solve every ``stride``-th frame from ``first`` on, from scratch each, into drives (frames, n)."""
        drive_each(self, frames, first, stride, drives)

    def _phases(self, gram: Complex, wanted: Real, ids: NDArray[np.int64] | None, way: Phases) -> Complex:
        """Unit-modulus phases; the iteration begins with the last phases of the same points."""
        options, m = self._options, len(wanted)
        if ids is None:
            ids = np.arange(m, dtype=np.int64)
            if len(self._ids) != m:
                self.forget()
        u = self._start(ids)
        if options.phase_seconds is None:
            u = phase_iteration(gram, wanted, u, options.phase_steps, way)
        else:
            end = perf_counter() + options.phase_seconds
            for _ in range(options.phase_steps):
                if perf_counter() >= end:
                    break
                u = phase_iteration(gram, wanted, u, 1, way)
        self._ids, self._u = ids, u
        return unit(u)

    def _start(self, ids: NDArray[np.int64]) -> Complex:
        """Phases to begin with: of mean square 1 at points of the last frame, cold ones at others."""
        cold = cold_start(len(ids))
        place = {each: number for number, each in enumerate(self._ids.tolist())}
        known = np.array([each in place for each in ids.tolist()])
        if not known.any():
            return cold
        carried = self._u[[place[each] for each in ids[known].tolist()]]
        u = cold.copy()
        u[known] = carried * np.sqrt(len(carried)) / np.linalg.norm(carried)
        return np.asarray(u + NUDGE * cold)
