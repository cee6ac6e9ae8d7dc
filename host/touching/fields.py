"""From points to the pulses of two fields in turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...protocol.quantise import PulseFrames, quantise
from ...solver import ControlPoints, TransducerArray, TwoSidedSolver
from ..playing.calibration import Calibration
from .fading import Fading

__all__ = ["PoseSolver"]


class PoseSolver:
    """Solves pose after pose: the two halves of the points, as pulses.

    Parameters
    ----------
    array : TransducerArray
        Of the device.
    method : str
        A key of `METHODS`.
    frequency : float
        Of the modulation, in Hz.
    calibration : Calibration, optional
        Of the device.
    """

    def __init__(
        self, array: TransducerArray, method: str, frequency: float, calibration: Calibration | None = None
    ) -> None:
        self._solver = TwoSidedSolver(array, method, frequency=frequency)
        self._calibration = calibration
        self.gains: NDArray[np.float32] | None = None
        """(n,) factors of the drives, from 0 to 1; None for 1."""

    def solve(self, fading: Fading) -> PulseFrames:
        """The fields of one pose, (2, n), from at least one point.

        The amplitudes of points are relative to each other, so the strongest level turns down the whole, and the others
        their points beside it. A point begins with the phase that it had in the last pose.

        Raises
        ------
        ValueError
            As `TwoSidedSolver.solve`.
        """
        points = ControlPoints.trusted(fading.positions, fading.amplitudes * fading.levels)
        drives = self._solver.solve(points, fading.ids).drives * np.float32(fading.levels.max())
        if self.gains is not None:
            drives = drives * self.gains
        return quantise(drives if self._calibration is None else self._calibration.apply(drives))

    def forget(self) -> None:
        """Begin the next pose from scratch."""
        self._solver.forget()
