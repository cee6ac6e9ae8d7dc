"""Two-sided modulation, the paper's section 3.4: both halves of the modulation's period are used.

The control points are split in two halves, and a field for each is emitted in turn, so that the array never rests.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...base.pictures import Drawable
from ..acoustics.array import TransducerArray, check_array
from ..acoustics.medium import Medium, as_medium
from ..acoustics.propagation import Precision, pressure
from ..geometry import frozen
from ..shapes.points import ControlPoints
from .methods import options_of
from .modulation import FREQUENCY, Modulation, check_frequency
from .options import Options
from .paired import EnginePair, Pair, PairEngine
from .solve import Solution, Wanted, check_size, checked_ids, control_points, engine_for, has_kernels, solve
from .split import Split

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Gain", "TwoSided", "TwoSidedSolver", "pair_engine", "two_sided"]


@dataclass(frozen=True, eq=False)
class Gain:
    """The gain of two-sided modulation over one-sided, at the k points that are no nulls.

    Both drive the transducers equally hard while they emit. The array never rests in two-sided modulation, so that it
    takes about twice the power: the gain is in what a given array can do, not in its efficiency.

    Parameters
    ----------
    two_sided, one_sided : (k,) float
        Difference of the intensity |p|² between the halves of the modulation's period, in Pa²; p is the peak pressure.
    """

    two_sided: NDArray[np.float64]
    one_sided: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"Gain({self.mean:.2f} times in the mean, {self.weakest:.2f} times at the weakest point)"

    @property
    def mean(self) -> float:
        """Ratio of the mean changes. Both are square waves in time, so their components at any harmonic have it too."""
        return float(self.two_sided.mean() / self.one_sided.mean())

    @property
    def weakest(self) -> float:
        """Ratio of the smallest change at any point to the smallest one of one-sided modulation."""
        return float(self.two_sided.min() / self.one_sided.min())


@dataclass(frozen=True, eq=False)
class TwoSided(Drawable):
    """Two fields in turn, and what they were solved for.

    Parameters
    ----------
    pair : Pair
        The split of the points, the drives of both halves at full strength, and the levels that they are turned down
        by.
    frequency : float
        Frequency of the modulation, in hertz.
    array, points, medium, method, options
        What it was solved for, and how.
    """

    pair: Pair
    frequency: float
    array: TransducerArray
    points: ControlPoints
    medium: Medium
    method: str
    options: Mapping[str, Any]

    def __repr__(self) -> str:
        return f"TwoSided({self.method}, {self.split}, {self.frequency:g} Hz)"

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the points, each half in its colour; nulls, which are in both, are in the second."""
        return self.points.plot(ax, second=~self.split.mask, **style)

    @property
    def split(self) -> Split:
        """Of the points."""
        return self.pair.split

    @property
    def levels(self) -> NDArray[np.float64]:
        """(2,) what each half is turned down by, at most 1."""
        return self.pair.levels

    @cached_property
    def first(self) -> Solution:
        """Of the first half, at full strength."""
        return self._solution(0, self.split.halves(self.points)[0])

    @cached_property
    def second(self) -> Solution | None:
        """Of the second half; None if only one point is no null."""
        half = self.split.halves(self.points)[1]
        return None if half is None else self._solution(1, half)

    def _solution(self, number: int, half: ControlPoints) -> Solution:
        drive = frozen(self.pair.drives[number].astype(np.complex128))
        return Solution(drive, self.array, half, self.medium, self.method)

    @cached_property
    def drives(self) -> NDArray[Any]:
        """What each half emits, (2, n) complex; without a second half its drives are 0."""
        return frozen(self.pair.drives * self.pair.levels.astype(self.pair.drives.real.dtype)[:, None])

    @cached_property
    def modulation(self) -> Modulation:
        """What to emit."""
        drives = self.pair.drives.astype(np.complex128)
        return Modulation(list(drives), np.diag(self.pair.levels), self.frequency, self.medium.frequency)

    @cached_property
    def one_sided(self) -> Modulation:
        """All points at once, on and off, by the same method; solved when it is first asked for."""
        whole = solve(self.array, self.points, self.method, medium=self.medium, **self.options)
        return Modulation.on_off(whole.drive, self.modulation.frequency, carrier=self.medium.frequency)

    @cached_property
    def gain(self) -> Gain:
        """What it gains on one-sided modulation; computed when it is first asked for."""
        return Gain(*(frozen(self._change(modulation)) for modulation in (self.modulation, self.one_sided)))

    def _change(self, modulation: Modulation) -> NDArray[np.float64]:
        at = self.points.positions[self.points.amplitudes > 0]
        on, off = (
            np.abs(pressure(self.array, drive, at, self.medium)) ** 2
            for drive in modulation.weights @ modulation.drives
        )
        return np.asarray(np.abs(on - off))

    def summary(self) -> str:
        """One line for people, with the gain."""
        gain, first = self.gain, int(self.split.mask.sum())
        return (
            f"{first} + {len(gain.two_sided) - first} points at {self.modulation.true_frequency:g} Hz: the intensity "
            f"changes by {gain.two_sided.mean():.3g} Pa² on average, {gain.mean:.2f} times as much as one-sided, and "
            f"{gain.weakest:.2f} times at the weakest point"
        )


class TwoSidedSolver:
    """Solves frame after frame for two-sided modulation: it keeps the last split, and the phases of each half.

    Parameters
    ----------
    array, method, medium, precision, **options
        As for `Solver`.
    frequency : float
        Frequency of the modulation, in hertz.

    Raises
    ------
    ValueError
        As `Solver`, or if the frequency is not possible.

    Notes
    -----
    The amplitudes of points are relative to each other whichever half they are in, so the field that comes out louder
    relative to its wanted amplitudes is turned down. With a single point the second field is silence, which is
    one-sided modulation. The paper powers the array fully: ``output="phase"``.
    """

    def __init__(
        self,
        array: TransducerArray,
        method: str = "wgs",
        *,
        frequency: float = FREQUENCY,
        medium: Medium | None = None,
        precision: Precision = "single",
        **options: Any,
    ) -> None:
        check_array(array)
        self._array, self._method, self._medium = array, method, as_medium(medium)
        self._frequency = check_frequency(frequency, 2, self._medium.frequency)
        self._options = MappingProxyType(options)
        self._engine = pair_engine(array, self._medium, method, options_of(method, options), precision)
        self._count, self._first_id = 0, 0

    def __repr__(self) -> str:
        return f"TwoSidedSolver({self._method}, {len(self._array)} transducers, {self._frequency:g} Hz)"

    def solve(self, points: Wanted, ids: NDArray[np.int64] | None = None) -> TwoSided:
        """Split and solve the next frame.

        Parameters
        ----------
        points, ids
            As for `Solver.solve`.

        Raises
        ------
        ValueError
            As `Solver.solve`.
        """
        points = control_points(points)
        check_size(self._array, points, self._method)
        names = checked_ids(points, ids)
        if names is None:
            if len(points) != self._count:  # none of them is one of the last frame
                self._count, self._first_id = len(points), self._first_id + self._count
            names = np.arange(self._first_id, self._first_id + self._count)
        pair = self._engine.solve(points, names)
        return TwoSided(pair, self._frequency, self._array, points, self._medium, self._method, self._options)

    def forget(self) -> None:
        """Begin the next frame from scratch, as the first."""
        self._engine.forget()


def pair_engine(
    array: TransducerArray, medium: Medium, method: str, options: Options, precision: Precision = "single"
) -> PairEngine:
    """The engine for both halves of a frame: one compiled call if the method has one."""
    if has_kernels(method, options, precision):
        from ..acoustics.tables import tables_of  # numba takes half a second to import
        from .compiled_pair import CompiledPair
        from .engine import solves_at_once

        if solves_at_once(tables_of(array, medium), method, options):
            return CompiledPair(array, medium, method, options)
    first, second = (engine_for(array, medium, method, options, precision) for _ in range(2))
    return EnginePair(first, second, len(array))


def two_sided(
    array: TransducerArray,
    points: Wanted,
    method: str = "wgs",
    *,
    frequency: float = FREQUENCY,
    medium: Medium | None = None,
    **options: Any,
) -> TwoSided:
    """Solve both halves of control points for two-sided modulation: a `TwoSidedSolver` for one frame."""
    return TwoSidedSolver(array, method, frequency=frequency, medium=medium, **options).solve(points)
