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
from .modulation import FREQUENCY, Modulation
from .points import ControlPoints
from .propagation import pressure
from .solve import Solution, solve
from .split import Split, split

__all__ = ["Gain", "TwoSided", "two_sided"]


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
        Give it to the next frame as ``previous``.
    first, second : Solution
        Of the halves; no second one where there is but one point that is no null.
    modulation : Modulation
        What to emit.
    array, points, medium, method, options, full_power
        What it was solved for, and how.
    """

    split: Split
    first: Solution
    second: Solution | None
    modulation: Modulation
    array: TransducerArray
    points: ControlPoints
    medium: Medium
    method: str
    options: Mapping[str, Any]
    full_power: bool

    @cached_property
    def one_sided(self) -> Modulation:
        """All points at once, on and off, with the same power; solved when it is first asked for."""
        whole = solve(self.array, self.points, self.method, medium=self.medium, **self.options)
        drive = _emitted(whole, self.full_power)
        return Modulation.on_off(drive, self.modulation.frequency, carrier=self.medium.frequency)

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


def two_sided(
    array: TransducerArray,
    points: ControlPoints,
    method: str = "tikhonov",
    *,
    previous: Split | None = None,
    frequency: float = FREQUENCY,
    full_power: bool | None = None,
    medium: Medium | None = None,
    **options: Any,
) -> TwoSided:
    """Solve both halves of control points for two-sided modulation.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    points : ControlPoints
        m points.
    method : str
        A key of `METHODS`.
    previous : Split, optional
        The split of the last frame.
    frequency : float
        Of the modulation, in hertz.
    full_power : bool, optional
        Whether every transducer that is not silent is driven fully and only phases count, as in the paper's section
        3.5; otherwise the strongest transducer of each field is driven fully. It is louder, but points come out less
        even, and nulls not at all, so by default it is done only where all amplitudes are equal.
    medium : Medium, optional
        The air; 20 °C by default.
    **options
        Of the method.

    Raises
    ------
    ValueError
        As `solve` and `Modulation`.

    Notes
    -----
    The amplitudes of points are relative to each other whichever half they are in, so the field that comes out louder
    than the other, for what was asked of it, is turned down. With a single point the second field is silence, which is
    one-sided modulation.
    """
    medium = medium or Medium()
    if full_power is None:
        full_power = bool((points.amplitudes == points.amplitudes[0]).all())
    cut = split(points, previous)
    half, other_half = cut.halves(points)
    first = solve(array, half, method, medium=medium, **options)
    second = solve(array, other_half, method, medium=medium, **options) if other_half else None
    one, other = _emitted(first, full_power), np.zeros(len(array), dtype=np.complex128)
    levels = np.ones(2)
    if second is not None:
        other = _emitted(second, full_power)
        levels = np.array([_level(first, one), _level(second, other)])
    modulation = Modulation([one, other], np.diag(levels.min() / levels), frequency, medium.frequency)
    return TwoSided(
        cut, first, second, modulation, array, points, medium, method, MappingProxyType(options), full_power
    )


def _emitted(solution: Solution, full_power: bool) -> NDArray[np.complex128]:
    """The drive of a solution, or its phases only; silent transducers stay silent."""
    return np.asarray(np.sign(solution.drive) if full_power else solution.drive)


def _level(solution: Solution, drive: NDArray[np.complex128]) -> float:
    """Pressure per wanted amplitude that a drive makes at the points of a solution, as the least squares have it."""
    points = solution.points
    reached = np.abs(pressure(solution.array, drive, points.positions, solution.medium))
    return float(points.amplitudes @ reached / (points.amplitudes @ points.amplitudes))
