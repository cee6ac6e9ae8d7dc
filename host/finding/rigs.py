"""A look at the devices of a rig: which are there, where they are, and how their clocks are related."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ...base.errors import DeviceError
from ...protocol.codes import State
from ...protocol.plain import flag_names
from ...protocol.replies import Status
from ..streaming.common_clock import CommonClock
from ..streaming.device import open_device
from ..streaming.group import open_devices
from ..streaming.rig import RigDevice

__all__ = ["RigLook", "SeenDevice", "look_at_rig"]

ALL_SIDES = 1e-6
"""Length of the mean of unit vectors that have no common direction."""


class SeenDevice(NamedTuple):
    """A device of a rig, and what speaks against it."""

    name: str
    url: str
    serial: str
    """Empty if it cannot be opened, or its line does not say."""
    transducers: int
    centre: tuple[float, float, float]
    """Of its transducers, in metres."""
    direction: tuple[float, float, float]
    """In which they look, on average; a unit vector, or zeros if they look at all sides alike."""
    periods_ahead: int | None
    """By how many periods its count is ahead of the first device's; None unless all can be opened."""
    problem: str | None


class RigLook(NamedTuple):
    """What a look at a rig has found."""

    devices: list[SeenDevice]
    common: CommonClock | None
    """How the clocks are related; None unless all devices can be opened."""
    error: DeviceError | None
    """Why the rig cannot be opened."""


def look_at_rig(members: Sequence[RigDevice]) -> RigLook:
    """Open the devices of a rig, read their clocks, and leave them as they are.

    Raises
    ------
    ValueError
        If the devices cannot be one rig, or a device has other transducers than the rig says.
    """
    try:
        with open_devices(members, observe=True) as group:
            seen = [
                _seen(member, device.serial, ahead, _silenced(status))
                for member, device, ahead, status in zip(
                    members, group.devices, group.common.offsets, group.status(), strict=True
                )
            ]
            return RigLook(seen, group.common, None)
    except DeviceError as error:
        return RigLook([_alone(member) for member in members], None, error)


def _alone(member: RigDevice) -> SeenDevice:
    """A device of a rig that cannot be opened as a whole."""
    try:
        with open_device(member.url, observe=True) as device:
            return _seen(member, device.serial, None, _silenced(device.status()))
    except DeviceError as error:
        return _seen(member, "", None, str(error))


def _silenced(status: Status) -> str | None:
    """What silences a device, None if nothing does."""
    return f"silenced by a fault: {flag_names(status.faults)}" if status.state is State.FAULT else None


def _seen(member: RigDevice, serial: str, ahead: int | None, problem: str | None) -> SeenDevice:
    mean = member.array.normals.mean(axis=0)
    length = float((mean @ mean) ** 0.5)
    x, y, z = (mean / length if length > ALL_SIDES else 0 * mean).tolist()
    centre = tuple(member.array.centre.tolist())
    return SeenDevice(member.name, member.url, serial, len(member.array), centre, (x, y, z), ahead, problem)
