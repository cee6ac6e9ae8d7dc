"""A second method for the points that are played now: what it would emit, and the figures of both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..protocol.quantise import quantise
from ..solver import ControlPoints, TwoSidedSolver
from .painting import Complex, Painter
from .settings import Settings
from .snapshot import Emitter, Snapshot

__all__ = ["Comparison", "gains_of"]

FAINTEST = 1e-3
"""Strength of a point that is about to fade in or out."""


def gains_of(settings: Settings, transducers: int) -> NDArray[np.float32]:
    """By how much the drive of each transducer is turned down, (n,) from 0 to 1."""
    gains = np.full(transducers, settings.amplitude, np.float32)
    gains[list(settings.silenced)] = 0
    return gains


class Comparison:
    """Solves the points of snapshots by a second method.

    Parameters
    ----------
    emitter : Emitter
        The array and its calibration.
    """

    def __init__(self, emitter: Emitter) -> None:
        self._rig = emitter
        self._method = ""
        self._solver: TwoSidedSolver | None = None

    def drives(self, snapshot: Snapshot, settings: Settings) -> Complex | None:
        """Both fields of the second method, (2, n), as pulses would emit them; None if there is nothing to compare."""
        if settings.compare is None or not len(snapshot.points) or not snapshot.points[:, 3].max() > 0:
            return None
        if self._solver is None or self._method != settings.compare:
            self._method, self._solver = settings.compare, TwoSidedSolver(self._rig.array, settings.compare)
        solved = self._solver.solve(
            ControlPoints.trusted(snapshot.points[:, :3].copy(), np.maximum(snapshot.points[:, 3], FAINTEST))
        )
        drives = solved.drives * gains_of(settings, len(self._rig.array))
        pulses = quantise(drives if self._rig.calibration is None else self._rig.calibration.apply(drives))
        return np.stack([pulses.pulses(half).to_drive() for half in range(len(drives))])

    def numbers(self, painter: Painter, snapshot: Snapshot, other: Complex) -> list[tuple[str, str, str]]:
        """Figures of what is emitted and of the second method: label, and both values."""
        places = snapshot.points[:, :3]
        this, that = (painter.at_points(drives, places) for drives in (snapshot.drives, other))
        return [
            ("Mean at the points", f"{this.mean():.0f} Pa", f"{that.mean():.0f} Pa"),
            ("Weakest point", f"{this.min():.0f} Pa", f"{that.min():.0f} Pa"),
            ("Spread", f"{_spread(this):.1f} %", f"{_spread(that):.1f} %"),
        ]


def _spread(values: NDArray[np.float64]) -> float:
    """Standard deviation in percent of the mean."""
    return float(100 * values.std() / values.mean()) if values.mean() > 0 else 0.0
