"""What there is to see: of an array that stays, and of one moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..host.streaming.calibration import Calibration
from ..host.touching.fading import Fading
from ..protocol.quantise import PulseFrames
from ..protocol.wiring import Wiring
from ..solver import ControlPoints, Medium, TransducerArray
from ..solver.contact.hand import Hand
from ..solver.contact.mesh import Mesh

__all__ = ["Emitter", "PlayedPose", "Snapshot", "Waves", "rows_of"]


def rows_of(points: ControlPoints) -> NDArray[np.float64]:
    """Control points as a snapshot has them, (m, 4): places in metres, and strengths relative to the strongest."""
    return np.column_stack([points.positions, points.amplitudes / points.amplitudes.max()])


@dataclass(frozen=True, eq=False)
class Emitter:
    """The array, as long as a view is open.

    Parameters
    ----------
    array : TransducerArray
        n transducers.
    name : str
        The device's, for people.
    wiring : Wiring, optional
        The output that drives each transducer of a device's array.
    calibration : Calibration, optional
        Calibration as it is applied to drives.
    medium : Medium
        The air.
    """

    array: TransducerArray
    name: str = "phased array"
    wiring: Wiring | None = None
    calibration: Calibration | None = None
    medium: Medium = field(default_factory=Medium)

    @cached_property
    def emitting(self) -> TransducerArray:
        """The array as it emits: pulses are corrected for its calibration already, so their drives must pass it."""
        return self.array if self.calibration is None else self.array.calibrated(self.calibration.response)

    @cached_property
    def channels(self) -> NDArray[np.int64]:
        """(n,) the output of each transducer; without a wiring as if they were wired in their order."""
        return np.arange(len(self.array)) if self.wiring is None else self.wiring.channels


class PlayedPose(NamedTuple):
    """Control points of one moment, with their ramps, and all fields that were emitted for them.

    ``drives`` (k, n) are what the transducers emitted, field by field; ``solved`` (k, n) what was solved and sent; and
    ``gains`` (n,) the factors that scaled the solution. ``method`` is empty if it is not known.
    """

    fading: Fading
    drives: NDArray[Any]
    method: str = ""
    solved: PulseFrames | None = None
    gains: NDArray[np.float32] | None = None


@dataclass(frozen=True, eq=False)
class Waves:
    """The square waves of some outputs: levels (ticks, k) of k transducers from a tick of the device's time on."""

    transducers: tuple[int, ...]
    first_tick: int
    bits: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One moment.

    Parameters
    ----------
    drives : (k, n) complex
        What the transducers emit: one field, or some that alternate.
    period : int
        Carrier period of the device's time.
    state : str
        ``playing``, ``stopped``, ``waiting``, ``ended`` or ``recording``.
    source : str
        The place where the drives come from, for people.
    hands : sequence of Hand
    objects : sequence of Mesh
        Each in its place.
    points : (m, 4) float
        Control points: x, y, z in metres, and their strength from 0 to 1.
    ids : (m,) int
        Their identities.
    arcs : sequence of (k, 3) float
        The arcs where hands cut objects, in metres.
    boards : tuple of str
        What is wrong with each board; empty if nothing is.
    figures : tuple of (str, str)
        Rates, latencies, counts: label and value, for people.
    waves : Waves, optional
        Waves of the outputs that are watched.
    whole : PlayedPose or str, optional
        Points and all of their fields, if `drives` may be those of several moments; or why there are none.
    """

    drives: NDArray[Any]
    period: int = 0
    state: str = "playing"
    source: str = "as intended"
    hands: Sequence[Hand] = ()
    objects: Sequence[Mesh] = ()
    points: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 4)))
    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    arcs: Sequence[NDArray[np.float64]] = ()
    boards: tuple[str, ...] = ()
    figures: tuple[tuple[str, str], ...] = ()
    waves: Waves | None = None
    whole: PlayedPose | str | None = None

    @property
    def pose(self) -> PlayedPose | str:
        """What can be compared: points and all that was emitted for them; or why nothing can be."""
        if not len(self.points):
            return "no control point is touched"
        if self.whole is not None:
            return self.whole
        levels = np.ones(len(self.points))
        ids = self.ids if len(self.ids) else np.arange(len(self.points))
        return PlayedPose(Fading(ids, self.points[:, :3].copy(), self.points[:, 3].copy(), levels), self.drives)

    def __repr__(self) -> str:
        return f"Snapshot(period {self.period}, {len(self.drives)} × {self.drives.shape[1]} drives, {self.state})"
