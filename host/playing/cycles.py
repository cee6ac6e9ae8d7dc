"""Cycles of drives on a device, which repeats them from its memory."""

from __future__ import annotations

from ...protocol.replies import Ack
from ...solver import Cycle
from .device import Device
from .envelopes import sine

__all__ = ["play_cycle"]


def play_cycle(device: Device, cycle: Cycle, *, unattended: bool = False) -> tuple[Ack, tuple[tuple[int, int], ...]]:
    """Store a cycle's frames in a device, which then repeats them; its `envelope` becomes the device's modulation.

    Parameters
    ----------
    device : Device
        On which to play.
    cycle : Cycle
        At most as many different frames as the device has slots.
    unattended : bool
        Whether it goes on when the host falls silent.

    Returns
    -------
    Ack
        The answer to the sequence.
    tuple of (int, int)
        Its steps: a slot, and for how many carrier periods.

    Raises
    ------
    ValueError
        If the device has too few slots; or as `Device.store`.
    DeviceRefusedError
        If the device refuses it.
    """
    frames, steps = cycle.slots()
    for slot, frame in enumerate(frames):
        device.store(slot, frame)
    if cycle.envelope:
        device.modulate(*sine(cycle.envelope))
    return device.play(steps, unattended=unattended), steps
