"""From points and arcs to the pulses of the fields that are played in turn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...protocol.quantise import PulseFrames
from ...solver import ControlPoints, TransducerArray
from ...solver.rendering.outline import Outline
from ...solver.rendering.renderer import Renderer
from ...solver.rendering.ways import Amplitude, Halves, Way
from ..streaming.calibration import Calibration
from ..streaming.limiting import Limit, pulses_within
from .fading import Fading

__all__ = ["PoseSolver", "PulseCycle"]


class PulseCycle(NamedTuple):
    """A cycle of a rendering, as pulses: what is played for a pose, again and again."""

    frames: PulseFrames
    """The fields in turn, (k, n)."""
    hold: int
    """Carrier periods for which each is played."""
    envelope: float = 0.0
    """Frequency in Hz of an amplitude modulation on top, 0 for none."""

    @property
    def periods(self) -> int:
        """Carrier periods that it lasts."""
        return len(self.frames.phase) * self.hold


class PoseSolver:
    """Solves pose after pose: the cycle of fields for its points, as pulses.

    Parameters
    ----------
    array : TransducerArray
        The array of the device.
    way : Way, optional
        The way in which points are rendered; None chooses for each pose, as ``auto`` does.
    method : str
        A key of `METHODS`.
    most_frames : int
        Fields of a cycle, at most.
    calibration : Calibration, optional
        The calibration of the device.
    limit : callable, optional
        Turns down a pose; see `limiting.Limit`.
    """

    def __init__(
        self,
        array: TransducerArray,
        way: Way | None,
        method: str,
        most_frames: int,
        calibration: Calibration | None = None,
        limit: Limit | None = None,
    ) -> None:
        self._renderer = Renderer(array, "auto" if way is None else way, method, most_frames=most_frames)
        self._calibration, self._limit = calibration, limit
        self.draws = not isinstance(way, Amplitude | Halves)
        """Whether strokes matter, beside points."""
        self.gains: NDArray[np.float32] | None = None
        """(n,) factors of the drives, from 0 to 1; None for 1."""
        self.least_gain = 1.0
        """The smallest factor so far by which the limit has turned drives down."""

    def solve(self, fading: Fading, strokes: Sequence[NDArray[np.float64]] = ()) -> PulseCycle:
        """The fields of one pose, from at least one point, and from strokes on which the points are if `draws`.

        The amplitudes of points are relative to each other, so the strongest level turns down the whole, and the others
        their points beside it. A point begins with the phase that it had in the last pose.

        Raises
        ------
        ValueError
            As `Renderer.render`.
        """
        points = ControlPoints.trusted(fading.positions, fading.amplitudes * fading.levels)
        cycle = self._renderer.render(Outline(tuple(strokes), points, fading.ids))
        drives = cycle.drives * np.float32(fading.levels.max())
        if self.gains is not None:
            drives *= self.gains
        pulses, gain = pulses_within(drives, self._calibration, self._limit)
        self.least_gain = min(self.least_gain, gain)
        return PulseCycle(pulses, cycle.hold, cycle.envelope)

    def forget(self) -> None:
        """Begin the next pose from scratch."""
        self._renderer.forget()
