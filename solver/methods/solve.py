"""From control points to drives: one update, a stream of frames, many frames at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, get_args
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import array_of, shown, whole
from ...base.pictures import Drawable
from ..accelerated.devices import Backend, check_backend, device_for
from ..acoustics.array import TransducerArray, check_array
from ..acoustics.medium import Medium, as_medium
from ..acoustics.propagation import Precision
from ..contact.hand import Hand
from ..contact.mesh import Mesh
from ..contact.touch import Touch
from ..geometry import as_points, counted, frozen
from ..shapes.points import MAX_POINTS, ControlPoints
from ..shapes.shapes import Shape
from .methods import METHODS, options_of
from .options import LEAST_MU, Options
from .reference_engine import Engine, ReferenceEngine

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Solution", "Solver", "Wanted", "control_points", "solve", "solve_frames"]

MOST_WORKERS = 1024
MAX_PAIRS = 20_000_000  # of points and transducers: about 2 GB of intermediate arrays in double precision

Wanted: TypeAlias = ControlPoints | Shape | ArrayLike
"""What to solve for: control points, a shape, or (m, 3) positions in metres, all of amplitude 1."""


@dataclass(frozen=True, eq=False)
class Solution(Drawable):
    """What a solver found.

    Parameters
    ----------
    drive : (n,) complex
        Drives in array order, of magnitude at most 1.
    array, points, medium, method
        What the drive was solved for, and how.
    """

    drive: NDArray[np.complex128]
    array: TransducerArray
    points: ControlPoints
    medium: Medium
    method: str

    def __repr__(self) -> str:
        return f"Solution({self.method}, {len(self.drive)} drives for {counted(len(self.points), 'point')})"

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the drives, as `TransducerArray.plot` does."""
        return self.array.plot(ax, drive=self.drive, **style)


class Solver:
    """Solves for an array, frame after frame: it keeps its buffers, and the phases of one frame begin the next.

    Successive frames then stay coherent, which is quieter. The result depends on the frames before it, but the same
    frames give the same bits; `forget` begins anew. A solver is for one thread at a time; from 250 000 points ·
    transducers on it uses all cores, or as many threads as ``$NUMBA_NUM_THREADS`` says, which does not change a bit.

    Parameters
    ----------
    array : TransducerArray
        n transducers, in any place and direction. Dead ones are left out.
    method : str
        A key of `METHODS`.
    medium : Medium, optional
        The air; 20 °C by default.
    precision : {"single", "double"}
        Compiled float32 kernels, or the readable complex128 versions in NumPy, which are far slower. With points that
        are well apart the ratios of |p| are within 1e-3 of the strongest and phases within 0.2° (rms). If
        points crowd or contradict each other, their solutions are as good, but may differ. Methods without kernels,
        and a ``mu`` below 1e-4, are always solved in double precision. The first solve on a machine compiles the
        kernels, which takes some ten seconds, once.
    **options
        Options of the method, see `Options`.

    Raises
    ------
    ValueError
        If a method, an option or a value is unknown or out of range.

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
        if precision not in get_args(Precision):
            raise ValueError(f"precision {precision!r} must be one of {', '.join(get_args(Precision))}")
        check_array(array)
        self.array, self.method, self.medium = array, method, as_medium(medium)
        self.options = options_of(method, options)
        self._engine = engine_for(self.array, self.medium, method, self.options, precision)

    def __repr__(self) -> str:
        return f"Solver({self.method}, {len(self.array)} transducers)"

    def solve(self, points: Wanted, ids: NDArray[np.int64] | None = None) -> Solution:
        """Find the drives for the next frame.

        Parameters
        ----------
        points : ControlPoints, Shape or (m, 3) float
            Control points in metres; without amplitudes, all are 1. A shape is sampled as it prefers.
        ids : (m,) int64, optional
            Identities of the points, each once: a point begins with the phase of the same one in the last frame.
            Without them, the points are taken for those of the last frame if there are as many, and for new ones
            otherwise.

        Raises
        ------
        ValueError
            If a point cannot be reached, there are too many, or they are too close for so small a ``mu``; or if the
            identities are not as many as the points.
        """
        points = control_points(points)
        check_size(self.array, points, self.method)
        warn_of_many(self.array, len(points))
        drive = self._engine.drive(points, checked_ids(points, ids))
        return Solution(frozen(drive), self.array, points, self.medium, self.method)

    def follow(
        self, positions: NDArray[np.float64], amplitudes: NDArray[np.float64], ids: NDArray[np.int64] | None = None
    ) -> NDArray[np.complex64]:
        """Find the drives for points in motion, which keep the phases that they have in the first frame.

        So drives change no faster than the points move. Phases that were found anew in each frame would be up to some
        per cent stronger, but jump at times.

        Parameters
        ----------
        positions : (k, m, 3) float
            Places in metres, in each of k frames.
        amplitudes : (m,) float
            Relative to each other.
        ids : (m,) int64, optional
            As for `solve`.

        Returns
        -------
        (k, n) complex64
            Drives.

        Raises
        ------
        ValueError
            As `solve`.
        """
        positions = array_of("positions (k, m, 3)", positions, np.float64)  # C-contiguous, as kernels read them
        if positions.ndim != 3 or not len(positions):
            raise ValueError(f"positions have the shape {positions.shape}; it must be (k, m, 3), k at least 1")
        as_points(positions.reshape(-1, positions.shape[2]), "control point")
        points = ControlPoints(positions[0], array_of("amplitudes", amplitudes, np.float64))
        check_size(self.array, points, self.method)
        names = checked_ids(points, ids)
        drives = np.empty((len(positions), len(self.array)), np.complex64)
        for frame, places in enumerate(positions):
            drives[frame] = self._engine.drive(ControlPoints.trusted(places, points.amplitudes), names, keep=frame > 0)
        return drives

    def forget(self) -> None:
        """Begin the next frame from scratch, as the first."""
        self._engine.forget()


def solve(
    array: TransducerArray,
    points: Wanted,
    method: str = "wgs",
    *,
    medium: Medium | None = None,
    precision: Precision = "single",
    **options: Any,
) -> Solution:
    """Find the drive that makes the field strong at the control points: a `Solver` for one frame.

    Parameters and errors are those of `Solver` and its `Solver.solve`.

    Examples
    --------
    >>> from phasewire import Circle, TransducerArray, solve
    >>> solve(TransducerArray.grid(), Circle()).drive.shape
    (320,)
    """
    return Solver(array, method, medium=medium, precision=precision, **options).solve(points)


def solve_frames(
    array: TransducerArray,
    frames: Sequence[Wanted],
    method: str = "wgs",
    *,
    medium: Medium | None = None,
    workers: int = 1,
    precision: Precision = "single",
    backend: Backend = "cpu",
    **options: Any,
) -> NDArray[np.complex64]:
    """Drives of many frames, each solved from scratch, so that they do not depend on the number of workers.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    frames : sequence of ControlPoints, Shape or (m, 3) float
        f frames, each as for `Solver.solve`.
    method, medium, precision, **options
        As for `Solver`.
    workers : int
        Threads to share the frames among, at least 1; more threads than cores gain nothing.
    backend : {"cpu", "cuda"}
        ``"cuda"`` solves batches of frames on a GPU, by `tikhonov`, `wgs` or `multiplex` in single precision. If there
        is no GPU, or it cannot solve as asked, the processor does, and a warning says why.

    Returns
    -------
    (f, n) complex
        Drives.

    Raises
    ------
    ValueError
        As `Solver` and `Solver.solve`, naming the frame; if there is less than one worker; or if the backend is unknown
        or lacks the precision.
    """
    check_array(array)
    if not isinstance(frames, Iterable):
        raise ValueError(f"frames {shown(frames)} must be a sequence of control points")
    wanted, settings, air = [control_points(frame) for frame in frames], options_of(method, options), as_medium(medium)
    workers = whole("workers", workers, 1, MOST_WORKERS)
    check_backend(backend, precision)
    drives = np.empty((len(wanted), len(array)), dtype=np.complex64)
    for index, points in enumerate(wanted):
        check_size(array, points, method, f"frame {index}: ")
    warn_of_many(array, max(map(len, wanted), default=0))
    if backend == "cuda":
        from .batches import drive_batches, hindrance  # numba takes half a second to import

        if (device := device_for(backend, hindrance(array, air, method, settings))) is not None:
            drive_batches(device, array, air, method, settings, wanted, drives)
            return drives

    def work(first: int) -> None:
        engine_for(array, air, method, settings, precision, 1).drive_frames(wanted, first, workers, drives)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(work, range(min(workers, len(wanted)))))
    return drives


def control_points(wanted: Wanted) -> ControlPoints:
    """The control points of what is wanted; raises `ValueError` if it has none, and says what has."""
    if isinstance(wanted, ControlPoints):
        return wanted
    if isinstance(wanted, str):
        raise ValueError(
            f"control points must be a shape or (m, 3) numbers, not {wanted!r}; parse_shape({wanted!r}) makes a "
            "shape, and read_points reads a file"
        )
    if isinstance(wanted, (list, tuple)) and any(isinstance(part, (Shape, type)) for part in wanted):
        raise ValueError("several shapes are one if they are added, as in Circle() + Star(), or sum(shapes)")
    if isinstance(wanted, (Hand, Mesh)):
        raise ValueError(f"a {type(wanted).__name__} has no control points; touch(hand, mesh).points has")
    if isinstance(wanted, type):
        raise ValueError(f"{wanted.__name__} is a class; {wanted.__name__}() makes one")
    if isinstance(wanted, TransducerArray):
        raise ValueError("a TransducerArray has no control points; it is the first argument, and they are the next")
    if isinstance(wanted, Touch):
        raise ValueError("a Touch is solved by its points and their identities: solver.solve(touch.points, touch.ids)")
    return wanted.sample() if isinstance(wanted, Shape) else ControlPoints(wanted)


def checked_ids(points: ControlPoints, ids: NDArray[np.int64] | None) -> NDArray[np.int64] | None:
    """Identities as kernels read them, writable; raises `ValueError` if they are not as many as the points."""
    if ids is not None and np.shape(ids) != (len(points),):
        raise ValueError(f"ids have the shape {np.shape(ids)}, but there are {len(points)} control points")
    return None if ids is None else array_of("ids", ids, np.int64)


def check_size(array: TransducerArray, points: ControlPoints, method: str, where: str = "") -> None:
    """Raise `ValueError` if a problem would fill the memory; the message begins with ``where``."""
    squared = METHODS[method].squared
    m, n = len(points.positions), len(array.positions)
    pairs = n * (m + (n if squared else 0))
    if m > MAX_POINTS or pairs > MAX_PAIRS:
        which = f", of which the system of {method} has n·(m + n)" if squared else ""
        raise ValueError(
            f"{where}{m} control points with {n} transducers are too many; at most {MAX_POINTS} "
            f"points are possible, and at most {MAX_PAIRS} pairs{which}"
        )


def warn_of_many(array: TransducerArray, points: int) -> None:
    """Warn if there are more control points than transducers, of which drives can meet no more than as many."""
    if points > len(array):
        warn(
            f"{points} control points are more than the {len(array)} transducers: the field cannot meet them all; "
            "space them further apart, or leave some out",
            stacklevel=3,
        )


def engine_for(
    array: TransducerArray,
    medium: Medium,
    method: str,
    options: Options,
    precision: Precision,
    threads: int | None = None,
) -> Engine:
    """The engine for a method and a precision, the compiled one if there is one; ``threads`` as for that."""
    if not has_kernels(method, options, precision):
        return ReferenceEngine(array, medium, method, options)
    from .engine import CompiledEngine  # numba takes half a second to import

    return CompiledEngine(array, medium, method, options, threads)


def has_kernels(method: str, options: Options, precision: Precision) -> bool:
    """Whether compiled kernels solve by a method with these options."""
    return precision == "single" and METHODS[method].kernels is not None and options.mu >= LEAST_MU
