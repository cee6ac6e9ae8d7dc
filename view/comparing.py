"""Another method for the points that are played now: what it would emit, and the figures of both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..solver import ControlPoints, TransducerArray, TwoSidedSolver
from .painting import Complex, Painter
from .settings import Settings
from .snapshot import Snapshot

__all__ = ["Comparison"]


class Comparison:
    """Solves the points of snapshots by a second method.

    Parameters
    ----------
    array : TransducerArray
        Of the snapshots.
    """

    def __init__(self, array: TransducerArray) -> None:
        self._array = array
        self._method = ""
        self._solver: TwoSidedSolver | None = None

    def drives(self, snapshot: Snapshot, settings: Settings) -> Complex | None:
        """Both fields of the second method, (2, n); None if none is chosen, or no point is played."""
        if settings.compare is None or not len(snapshot.points):
            return None
        if self._solver is None or self._method != settings.compare:
            self._method, self._solver = settings.compare, TwoSidedSolver(self._array, settings.compare)
        strengths = snapshot.points[:, 3]
        if not strengths.max() > 0:
            return None
        points = ControlPoints(snapshot.points[:, :3], np.maximum(strengths, 1e-3))
        return np.asarray(self._solver.solve(points).drives * np.float32(settings.amplitude))

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
