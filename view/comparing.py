"""A second method for the points of a moment: what it would emit, and the figures of both.

Like is compared with like: the points of one moment, all fields that were emitted for them, and what the second method
makes of the same points, with the same gains and calibration, in whole ticks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..host.touching.fields import PoseSolver
from ..protocol.quantise import PulseFrames
from ..solver.rendering.ways import Amplitude, Halves
from .painting import Complex, Painter
from .settings import Settings
from .snapshot import Emitter, PlayedPose, Snapshot

__all__ = ["Comparison", "Contest", "gains_of"]

MOST_FIELDS = 2


def gains_of(settings: Settings, transducers: int) -> NDArray[np.float32]:
    """By how much the drive of each transducer is turned down, (n,) from 0 to 1."""
    gains = np.full(transducers, settings.amplitude, np.float32)
    gains[list(settings.silenced)] = 0
    return gains


class Contest(NamedTuple):
    """Two methods for the same points: the first one's name, the fields (k, n) of both, and figures.

    ``other`` is what the second would emit; each of ``numbers`` is a label and the values of both.
    """

    method: str
    this: Complex
    other: Complex
    numbers: list[tuple[str, str, str]]


class Comparison:
    """Solves the points of snapshots of an array by a second method."""

    def __init__(self, emitter: Emitter, painter: Painter) -> None:
        self._rig, self._painter = emitter, painter
        self._solvers: dict[tuple[str, int], PoseSolver] = {}

    def hold(self, snapshot: Snapshot, settings: Settings) -> Contest | str | None:
        """The contest of a snapshot; why there is none; or None if the settings ask for none."""
        if settings.compare is None:
            return None
        pose = snapshot.pose
        if isinstance(pose, str):
            return pose
        if not pose.fading.amplitudes.any():
            return "every control point is a null"
        if len(pose.drives) > MOST_FIELDS:
            return f"{len(pose.drives)} fields take turns; methods are compared for one field or two"
        pulses = pose.solved if pose.method == settings.compare else None
        pulses = pulses or self._solved(pose, settings.compare)
        other = np.stack([pulses.pulses(number).to_drive() for number in range(len(pose.drives))])
        places = pose.fading.positions
        this, that = (self._painter.at_points(drives, places) for drives in (pose.drives, other))
        numbers = [
            ("Mean at the points", f"{this.mean():.0f} Pa", f"{that.mean():.0f} Pa"),
            ("Weakest point", f"{this.min():.0f} Pa", f"{that.min():.0f} Pa"),
            ("Spread", f"{_spread(this):.1f} %", f"{_spread(that):.1f} %"),
        ]
        return Contest(pose.method or settings.method, pose.drives, other, numbers)

    def _solved(self, pose: PlayedPose, method: str) -> PulseFrames:
        """What a method would send for the points of a pose."""
        key = method, len(pose.drives)
        if key not in self._solvers:
            way = Amplitude(envelope="square") if len(pose.drives) == 1 else Halves(envelope="square")
            self._solvers[key] = PoseSolver(self._rig.array, way, method, MOST_FIELDS, self._rig.calibration)
        solver = self._solvers[key]
        solver.gains = pose.gains
        return solver.solve(pose.fading).frames


def _spread(values: NDArray[np.float64]) -> float:
    """Standard deviation in percent of the mean."""
    return float(100 * values.std() / values.mean()) if values.mean() > 0 else 0.0
