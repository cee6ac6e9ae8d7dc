"""interim"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..protocol.pulses import Pulses
from ..solver import Solution
from .calibration import Calibration


class PulseFrames(NamedTuple):
    phase: NDArray[np.uint8]
    width: NDArray[np.uint8]


Frame = Any
Frames = Any


class FrameSource(Protocol):
    def take(self, most: int) -> PulseFrames: ...


def to_pulses(frame: Any, calibration: Calibration | None, channels: int) -> Pulses:
    if isinstance(frame, Solution):
        frame = frame.drive
    if not isinstance(frame, Pulses):
        frame = Pulses.from_drive(frame)
    if len(frame) != channels:
        raise ValueError(f"{len(frame)} pulses for a device with {channels} transducers")
    return frame


class _Arr:
    def __init__(self, f):
        self.f, self.at = f, 0

    def take(self, most):
        a = self.at
        self.at += most
        return PulseFrames(self.f.phase[a : a + most], self.f.width[a : a + most])


class _It:
    def __init__(self, it, n):
        self.it, self.n = iter(it), n

    def take(self, most):
        got = []
        for f in self.it:
            got.append(to_pulses(f, None, self.n))
            if len(got) == most:
                break
        if not got:
            return PulseFrames(np.zeros((0, 320), np.uint8), np.zeros((0, 320), np.uint8))
        return PulseFrames(np.stack([g.phase for g in got]), np.stack([g.width for g in got]))


def frame_source(source: Any, calibration: Any, channels: int) -> FrameSource:
    return _Arr(source) if isinstance(source, PulseFrames) else _It(source, channels)
