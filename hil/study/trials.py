"""Trials: a hand explores an object by the whole path, from hands to the bits of an emulated device."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...emulator import Capture, Emulator
from ...host import open_device
from ...host.hands.frames import HandFrame, TrackedHand
from ...host.hands.sources import PlayedHands
from ...host.touching.loop import TouchLoop, TouchMoment
from ...protocol.board import CARRIER_HZ
from ...solver import TransducerArray
from ...solver.contact.mesh import Mesh
from ...solver.contact.touch import Toucher
from .persons import Exploration

__all__ = ["PlayedTrial", "explored"]

TRACKER_HZ = 120.0
"""Frames of hands per second, as of the Leap Motion controller."""


class PlayedTrial(NamedTuple):
    """The outputs of a trial."""

    capture: Capture
    first: int
    """Carrier period of the path's time 0."""
    last: int
    """Carrier period of its end."""


def explored(
    mesh: Mesh, path: Exploration, seconds: float, array: TransducerArray, *, silent: bool = False
) -> PlayedTrial:
    """Let a hand explore an object for so many seconds on a fresh emulated device.

    With `silent` all drives are 0, and the rest goes on as always. Hands are not predicted, because the prediction
    follows the speed of this computer: so the same path makes the same bits. Time passes by the device's clock only.
    """
    begun: list[float] = []

    def note(moment: TouchMoment) -> None:
        if not begun:
            begun.append(moment.time)

    with Emulator() as emulator, open_device(emulator.url) as device:
        source = PlayedHands("an exploring hand", _frames(path, seconds), TRACKER_HZ, device.time)
        loop = TouchLoop(device, source, [mesh], Toucher(), array, predict=False, on_moment=note)
        if silent:
            loop.set_gains(np.zeros(len(array), np.float32))
        loop.run()
        capture = emulator.capture()
    first = round(begun[0] * CARRIER_HZ)
    return PlayedTrial(capture, first, first + round(seconds * CARRIER_HZ))


def _frames(path: Exploration, seconds: float) -> Iterator[HandFrame]:
    """Hands until the first frame after the end: the field stays until then."""
    for number in range(math.floor(seconds * TRACKER_HZ) + 2):
        yield HandFrame(number / TRACKER_HZ, (TrackedHand(path.at(number / TRACKER_HZ), 1),), number)
