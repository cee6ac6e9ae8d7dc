"""From control points to drives: one update, a stream of frames, many frames at once."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .array import TransducerArray
from .geometry import frozen
from .medium import Medium
from .options import METHODS, Options
from .points import MAX_POINTS, ControlPoints
from .propagation import Precision
from .reference import ReferenceEngine

if TYPE_CHECKING:
    from .engine import CompiledEngine

__all__ = ["Solution", "Solver", "solve", "solve_frames"]

MAX_PAIRS = 20_000_000  # of points and transducers: about 2 GB of intermediate arrays


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver found.

    Parameters
    ----------
    drive : (n,) complex
        Drives in array order, of magnitude at most 1.
    array, points, medium, method
        What it was solved for, and how.
    """

    drive: NDArray[np.complex128]
    array: TransducerArray
    points: ControlPoints
    medium: Medium
    method: str


class Solver:
    """Solves for an array, frame after frame: it keeps its buffers, and the phases of one frame begin the next.

    Successive frames then stay coherent, which is quieter. The result depends on the frames before it, but the same
    frames give the same bits; `forget` begins anew. A solver is for one thread at a time.

    Parameters
    ----------
    array : TransducerArray
        n transducers, in any place and direction. Dead ones are left out.
    method : str
        A key of `METHODS`.
    medium : Medium, optional
        The air; 20 °C by default.
    precision : {"single", "double"}
        Compiled float32 kernels, or the readable complex128 versions in NumPy, which are far slower. Methods without
        kernels are always solved in double precision.
    **options
        Of the method, see `Options`.

    Raises
    ------
    ValueError
        Where a method, an option or a value is unknown or out of range.

    Examples
    --------
    >>> import numpy as np
    >>> solver = Solver(TransducerArray.grid(), method="wgs", steps=10)
    >>> solution = solver.solve(ControlPoints([[-0.03, 0, 0.2], [0.03, 0, 0.2]]))
    >>> bool(np.abs(solution.drive).max() <= 1)
    True
    """

    def __init__(
        self,
        array: TransducerArray,
        method: str = "wgs",
        *,
        medium: Medium | None = None,
        precision: Precision = "single",
        **options: Any,
    ) -> None:
        if precision not in ("single", "double"):
            raise ValueError(f"precision {precision!r} must be single or double")
        self.array, self.method, self.medium = array, method, medium or Medium()
        self.options = Options.of(method, **options)
        self._engine = _engine(self.array, self.medium, method, self.options, precision)

    def solve(self, points: ControlPoints) -> Solution:
        """Find the drives for the next frame.

        Raises
        ------
        ValueError
            Where a point cannot be reached, there are too many, or they are too close for so small a ``mu``.
        """
        _check_size(self.array, points)
        drive = frozen(self._engine.drive(points).astype(np.complex128))
        return Solution(drive, self.array, points, self.medium, self.method)

    def forget(self) -> None:
        """Begin the next frame from scratch, as the first."""
        self._engine.forget()


def solve(
    array: TransducerArray,
    points: ControlPoints,
    method: str = "wgs",
    *,
    medium: Medium | None = None,
    precision: Precision = "single",
    **options: Any,
) -> Solution:
    """Find the drive that makes the field strong at the control points: a `Solver` for one frame.

    Parameters and errors are those of `Solver` and its `Solver.solve`.
    """
    return Solver(array, method, medium=medium, precision=precision, **options).solve(points)


def solve_frames(
    array: TransducerArray,
    frames: Sequence[ControlPoints],
    method: str = "wgs",
    *,
    medium: Medium | None = None,
    workers: int = 1,
    **options: Any,
) -> NDArray[np.complex64]:
    """Drives of many frames, each solved from scratch, so that they do not depend on the number of workers.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    frames : sequence of ControlPoints
        f frames.
    method, medium, **options
        As for `Solver`.
    workers : int
        Threads to share the frames among, at least 1; more than there are cores gain nothing.

    Returns
    -------
    (f, n) complex
        Drives.

    Raises
    ------
    ValueError
        As `Solver` and `Solver.solve`; or where there are fewer than one worker.
    """
    settings = Options.of(method, **options)
    if workers < 1:
        raise ValueError(f"workers {workers} must be at least 1")
    drives = np.empty((len(frames), len(array)), dtype=np.complex64)
    for points in frames:
        _check_size(array, points)

    def work(first: int) -> None:
        engine = _engine(array, medium or Medium(), method, settings, "single")
        if isinstance(engine, ReferenceEngine) or not engine.takes_frames:
            for index in range(first, len(frames), workers):
                engine.forget()
                drives[index] = engine.drive(frames[index])
        else:
            engine.drive_frames(frames, first, workers, drives)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(work, range(min(workers, len(frames)))))
    return drives


def _check_size(array: TransducerArray, points: ControlPoints) -> None:
    if len(points) > MAX_POINTS or len(array) * len(points) > MAX_PAIRS:
        raise ValueError(
            f"{len(points)} control points with {len(array)} transducers are too many; at most {MAX_POINTS} points are "
            f"possible, and at most {MAX_PAIRS} pairs"
        )


def _engine(
    array: TransducerArray, medium: Medium, method: str, options: Options, precision: Precision
) -> CompiledEngine | ReferenceEngine:
    if precision == "double" or not METHODS[method].compiled:
        return ReferenceEngine(array, medium, method, options)
    from .engine import CompiledEngine  # numba takes half a second to import

    return CompiledEngine(array, medium, method, options)
