"""Pulses that keep a limit of exposure, judged by what is emitted: in whole ticks."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...protocol.board import HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS
from ...protocol.pulses import Pulses
from ...protocol.quantise import PulseFrames, quantise
from .calibration import Calibration

__all__ = ["SHORTEST_PULSE", "Limit", "TurnedDown", "pulses_within"]

Limit: TypeAlias = Callable[[NDArray[np.complexfloating]], float]
"""From the emissions (k, n) of a cycle of frames to the factor, at most 1, with which all of them keep a limit; such as
`feel.exposure.exposure_limit` makes."""
SHORTEST_PULSE = float(np.sin(np.pi / (2 * MAX_WIDTH_TICKS)))
"""The weakest drive above silence: a pulse of one tick."""
TURN_DOWN = 0.97
"""The largest factor by which drives are turned down: a smaller change may be lost in whole ticks."""


def pulses_within(
    drives: NDArray[np.complexfloating], calibration: Calibration | None = None, limit: Limit | None = None
) -> tuple[PulseFrames, float]:
    """The pulses of drives, turned down until what they emit keeps a limit.

    Parameters
    ----------
    drives : (k, n) complex
        Drives of magnitude at most 1.
    calibration : Calibration, optional
        The calibration of the device.
    limit : callable, optional
        See `Limit`; without it nothing is turned down.

    Returns
    -------
    PulseFrames
        The pulses of k frames.
    float
        The factor by which the drives were turned down, 1 for not at all.

    Raises
    ------
    ValueError
        As `quantise`.
    """
    gain = 1.0
    while True:
        wanted = drives if gain == 1 else drives * np.float32(gain)
        pulses = quantise(wanted if calibration is None else calibration.apply(wanted))
        if limit is None:
            return pulses, gain
        if (factor := limit(emission(pulses, calibration))) >= 1:
            return pulses, gain
        gain *= min(factor, TURN_DOWN)


def emission(pulses: PulseFrames, calibration: Calibration | None) -> NDArray[np.complexfloating]:
    """The drives (k, n) that transducers emit for pulses, by the response that a calibration says they have."""
    emitted: NDArray[np.complexfloating] = _pulse_drives()[pulses.phase, pulses.width]
    return emitted if calibration is None else emitted * calibration.response


class TurnedDown:
    """Frames one after the other that keep a limit; what was turned down stays down, so that no frame is a jump.

    Parameters
    ----------
    limit : callable, optional
        See `Limit`.

    Attributes
    ----------
    gain : float
        The factor by which frames are turned down now, 1 for not at all.
    """

    def __init__(self, limit: Limit | None) -> None:
        self._limit, self.gain = limit, 1.0
        self._before: NDArray[np.complexfloating] | None = None

    @property
    def limits(self) -> bool:
        """Whether there is a limit."""
        return self._limit is not None

    def pulses(self, drives: NDArray[np.complexfloating], calibration: Calibration | None) -> PulseFrames:
        """The pulses of the next drives, (k, n); as `pulses_within`."""
        limit, before = self._limit, self._before
        if limit is None:
            return pulses_within(drives, calibration)[0]

        def after_the_last(emitted: NDArray[np.complexfloating]) -> float:
            return limit(emitted if before is None else np.concatenate([before, emitted]))

        pulses, factor = pulses_within(drives * np.float32(self.gain), calibration, after_the_last)
        self.gain *= factor
        self._before = emission(pulses, calibration)[-1:]
        return pulses


@cache
def _pulse_drives() -> NDArray[np.complex64]:
    """The drive of each pulse, by its phase and its width."""
    phase, width = np.indices((HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS + 1))
    return Pulses(phase.ravel(), width.ravel()).to_drive().reshape(phase.shape).astype(np.complex64)
