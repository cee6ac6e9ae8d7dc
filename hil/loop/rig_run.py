"""The end-to-end check of a rig: one solution on several emulated devices, compared with one array of all transducers.

As in `end_to_end`, the judge takes from the emulators the captured bits and the wiring; and besides, at which moment
each device's periods began, by which it sees whether all play together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...emulator import Capture, Emulator
from ...host import DeviceGroup
from ...protocol.board import CYCLES_PER_TICK, TICKS_PER_PERIOD
from ...protocol.replies import Ack
from ...solver import Solution, TransducerArray, pressure
from .end_to_end import PERIODS_WATCHED, Check, CheckedRun, emission, emission_checks, nearest_emission

__all__ = ["RigRun", "run_rig"]


@dataclass(frozen=True, eq=False)
class RigRun(CheckedRun):
    """What was intended for a rig, what its devices played, and the difference.

    Parameters
    ----------
    solution : Solution
        The intended drive of all transducers, device after device, and its control points.
    ack : Ack
        The answer of the rig.
    captures : tuple of Capture
        The outputs of each device.
    begins : tuple of int
        The core cycle, of the time of all, at which the frame began on each device.
    channels : tuple of (k,) int
        The transducers of each device that belong to the array.
    built : TransducerArray
        The array where the transducers really are.
    """

    solution: Solution
    ack: Ack
    captures: tuple[Capture, ...]
    begins: tuple[int, ...]
    channels: tuple[NDArray[np.intp], ...]
    built: TransducerArray

    def __repr__(self) -> str:
        return f"RigRun({self.solution}, {len(self.captures)} devices)"

    @cached_property
    def rebuilt(self) -> NDArray[np.complex128]:
        """The drive as emitted by all, (n,) complex, from the captured bits of each one's last whole period."""
        parts = []
        for capture, channels in zip(self.captures, self.channels, strict=True):
            last = capture.periods * TICKS_PER_PERIOD
            parts.append(emission(capture.bits(last - TICKS_PER_PERIOD, last), capture.wiring)[channels])
        return np.concatenate(parts)

    @property
    def shares(self) -> NDArray[np.float64]:
        """Pressure at each control point that is no null, with transducers where they really are: 1 is as intended."""
        solution = self.solution
        at = solution.points.positions[solution.points.amplitudes > 0]
        intended = pressure(solution.array, solution.drive, at, solution.medium)
        return np.abs(pressure(self.built, self.rebuilt, at, solution.medium)) / np.abs(intended)

    def checks(self) -> list[Check]:
        """All requirements; the verdict is good if all are met."""
        off = sum(begin != self.begins[0] for begin in self.begins)
        return [
            Check("devices off the first one's tick", off, 0, f"of {len(self.begins)}"),
            *emission_checks(self.solution, self.rebuilt, nearest_emission(self.solution.drive), self.built),
        ]


def run_rig(
    solution: Solution, group: DeviceGroup, emulators: Sequence[Emulator], built: TransducerArray | None = None
) -> RigRun:
    """Play a solution on a rig of emulators, and judge what they emit.

    Parameters
    ----------
    solution : Solution
        A solution for the array of the group.
    group : DeviceGroup
        The open devices, each one of the emulators, in their order.
    emulators : sequence of Emulator
        Plugged in, and of one time, as a `Cluster`'s.
    built : TransducerArray, optional
        The array where the transducers really are, if it is not where the rig says.

    Raises
    ------
    ValueError
        If the solution has another number of drives than the rig has transducers, or the rig has calibrations.
    DeviceError
        If a device fails, or the devices cannot begin together.
    """
    if group.calibration is not None:
        raise ValueError("a rig with calibrations emits other drives than the solution's; open it without them")
    ack = group.show(solution)
    captures, begins = [], []
    for emulator, offset in zip(emulators, group.common.offsets, strict=True):
        emulator.run_until(ack.commit_period + offset + PERIODS_WATCHED)
        captures.append(emulator.capture())
        latched = max(latches[-1] for latches in captures[-1].latches if latches)
        begins.append(emulator.running.time.origin + latched * CYCLES_PER_TICK)
    channels = [
        np.arange(len(member.array)) if member.channels is None else member.channels for member in group.members
    ]
    return RigRun(
        solution, ack, tuple(captures), tuple(begins), tuple(channels), group.array if built is None else built
    )
