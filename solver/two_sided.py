"""Two-sided modulation, the paper's section 3.4: both halves of the modulation's period are used.

The control points are split in two halves, and a field for each is emitted in turn, so that the array never rests.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .array import TransducerArray
from .geometry import frozen
from .medium import Medium
from .modulation import FREQUENCY, Modulation, check_frequency
from .points import ControlPoints
from .propagation import pressure
from .solve import Solution, Solver, solve
from .split import Split, split

__all__ = ["Gain", "TwoSided", "TwoSidedSolver", "two_sided"]


@dataclass(frozen=True, eq=False)
class Gain:
    """What two-sided modulation gains on one-sided, at the k points that are no nulls.

    Both drive the transducers equally hard while they emit. The array never rests in two-sided modulation, so that it
    takes about twice the power: the gain is in what a given array can do, not in its efficiency.

    Parameters
    ----------
    two_sided, one_sided : (k,) float
        By how much the intensity |p|² differs between the halves of the modulation's period, in Pa²; p is the peak
        pressure.
    """

    two_sided: NDArray[np.float64]
    one_sided: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Ratio of the mean changes. Both are square waves in time, so their components at any harmonic have it too."""
        return float(self.two_sided.mean() / self.one_sided.mean())

    @property
    def weakest(self) -> float:
        """Ratio of the smallest change at any point to the smallest one of one-sided modulation."""
        return float(self.two_sided.min() / self.one_sided.min())


@dataclass(frozen=True, eq=False)
class TwoSided:
    """Two fields in turn, and what they were solved for.

    Parameters
    ----------
    split : Split
        Of the points.
    first, second : Solution
        Of the halves; no second one where there is but one point that is no null.
    levels : (2,) float
        What each half is turned down by, at most 1.
    frequency : float
        Of the modulation, in hertz.
    points : ControlPoints
        All of them.
    options : mapping
        Of the method.
    """

    split: Split
    first: Solution
    second: Solution | None
    levels: NDArray[np.float64]
    frequency: float
    points: ControlPoints
    options: Mapping[str, Any]

    @cached_property
    def drives(self) -> NDArray[np.complex128]:
        """What each half emits, (2, n) complex; without a second half its drives are 0."""
        emitted = np.zeros((2, len(self.first.drive)), np.complex128)
        for row, level, half in zip(emitted, self.levels, (self.first, self.second), strict=True):
            if half is not None:
                np.multiply(half.drive, level, out=row)
        return frozen(emitted)

    @cached_property
    def modulation(self) -> Modulation:
        """What to emit."""
        drives = [self.first.drive, np.zeros_like(self.first.drive) if self.second is None else self.second.drive]
        return Modulation(drives, np.diag(self.levels), self.frequency, self.first.medium.frequency)

    @cached_property
    def one_sided(self) -> Modulation:
        """All points at once, on and off, by the same method; solved when it is first asked for."""
        first = self.first
        whole = solve(first.array, self.points, first.method, medium=first.medium, **self.options)
        return Modulation.on_off(whole.drive, self.modulation.frequency, carrier=first.medium.frequency)

    @cached_property
    def gain(self) -> Gain:
        """What it gains on one-sided modulation; computed when it is first asked for."""
        return Gain(*(frozen(self._change(modulation)) for modulation in (self.modulation, self.one_sided)))

    def _change(self, modulation: Modulation) -> NDArray[np.float64]:
        at = self.points.positions[self.points.amplitudes > 0]
        on, off = (
            np.abs(pressure(self.first.array, drive, at, self.first.medium)) ** 2
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
    """Solves frame after frame for two-sided modulation: it keeps a `Solver` for each half, and the last split.

    Parameters
    ----------
    array, method, medium, **options
        As for `Solver`.
    frequency : float
        Of the modulation, in hertz.

    Raises
    ------
    ValueError
        As `Solver`, or if the frequency is not possible.

    Notes
    -----
    The amplitudes of points are relative to each other whichever half they are in, so the field that comes out louder
    than the other, for what was asked of it, is turned down. With a single point the second field is silence, which is
    one-sided modulation. The paper powers the array fully: ``output="phase"``.
    """

    def __init__(
        self,
        array: TransducerArray,
        method: str = "wgs",
        *,
        frequency: float = FREQUENCY,
        medium: Medium | None = None,
        **options: Any,
    ) -> None:
        self._solvers = tuple(Solver(array, method, medium=medium, **options) for _ in range(2))
        check_frequency(frequency, 2, self._solvers[0].medium.frequency)
        self._frequency, self._options = frequency, MappingProxyType(options)
        self._split: Split | None = None

    def solve(self, points: ControlPoints) -> TwoSided:
        """Split and solve the next frame.

        Raises
        ------
        ValueError
            As `Solver.solve`.
        """
        cut = split(points, self._split)
        largest = points.amplitudes.max()
        relative = points if largest == 1 else ControlPoints(points.positions, points.amplitudes / largest)
        half, other_half = cut.halves(relative)
        first, level = self._solvers[0].solve_with_level(half)
        second, other_level = self._solvers[1].solve_with_level(other_half) if other_half else (None, level)
        levels = np.array([level, other_level])
        self._split = cut
        return TwoSided(cut, first, second, frozen(levels.min() / levels), self._frequency, points, self._options)

    def forget(self) -> None:
        """Begin the next frame from scratch, as the first."""
        self._split = None
        for solver in self._solvers:
            solver.forget()


def two_sided(
    array: TransducerArray,
    points: ControlPoints,
    method: str = "wgs",
    *,
    frequency: float = FREQUENCY,
    medium: Medium | None = None,
    **options: Any,
) -> TwoSided:
    """Solve both halves of control points for two-sided modulation: a `TwoSidedSolver` for one frame."""
    return TwoSidedSolver(array, method, frequency=frequency, medium=medium, **options).solve(points)
