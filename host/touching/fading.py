"""Amplitude ramps: points fade in when they appear and fade out when they vanish, so that contact is no click."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

__all__ = ["Fading"]


@dataclass(frozen=True, eq=False)
class Fading:
    """Points on their way to full strength, or from it.

    Parameters
    ----------
    ids : (m,) int64
        The numbers of the points, each once: first those that are there, in the order in which they were given, then
        those that fade out.
    positions : (m, 3) float
        The positions in metres. A point that fades out stays where it was last.
    amplitudes : (m,) float
        What the points are to have at full strength, relative to each other.
    levels : (m,) float
        How far each has come, above 0 and up to 1.
    """

    ids: NDArray[np.int64]
    positions: NDArray[np.float64]
    amplitudes: NDArray[np.float64]
    levels: NDArray[np.float64]

    @classmethod
    def nothing(cls) -> Self:
        """No points."""
        return cls(np.empty(0, np.int64), np.empty((0, 3)), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def changing(self) -> bool:
        """Whether the next step changes something though no hand moves."""
        return bool((self.levels < 1).any())

    def step(
        self,
        ids: NDArray[np.int64],
        positions: NDArray[np.float64],
        amplitudes: NDArray[np.float64],
        change: float,
        most: int,
    ) -> Self:
        """The points after some time: those that are given come nearer to full strength, all others to nothing.

        Parameters
        ----------
        ids, positions, amplitudes : (k,) int64, (k, 3) float, (k,) float
            The values of the points that are there now, each id once.
        change : float
            How much a level changes in that time, above 0; at 1 or above there is no ramp.
        most : int
            Points that may be left, at least k. Of those that fade out the weakest vanish at once if need be.
        """
        if len(ids) == len(self.ids) and (ids == self.ids).all():  # as nearly always
            levels = np.minimum(self.levels + change, 1.0) if self.changing else self.levels
            return type(self)(ids, positions, amplitudes, levels)
        levels = np.full(len(ids), change)
        leaving = self.levels > change
        if len(self.ids):
            order = np.argsort(self.ids)
            at = order[np.minimum(np.searchsorted(self.ids, ids, sorter=order), len(order) - 1)]
            known = self.ids[at] == ids
            levels[known] += self.levels[at[known]]
            leaving[at[known]] = False
        np.minimum(levels, 1.0, out=levels)
        left = np.flatnonzero(leaving)
        if len(left) > most - len(ids):
            strongest = np.argsort(-self.levels[left] * self.amplitudes[left], kind="stable")
            left = np.sort(left[strongest[: max(most - len(ids), 0)]])
        return type(self)(
            np.concatenate([ids, self.ids[left]]),
            np.concatenate([positions, self.positions[left]]),
            np.concatenate([amplitudes, self.amplitudes[left]]),
            np.concatenate([levels, self.levels[left] - change]),
        )
