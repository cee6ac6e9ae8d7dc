"""Cycles of drives on a device, which repeats them from its memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ...protocol.replies import Ack
from ...solver import Cycle
from .envelopes import sine
from .group import AnyDevice
from .limiting import Limit, pulses_within

__all__ = ["PlayedCycle", "play_cycle", "split_steps"]


SILENT_SECONDS = 1e-3
"""After which a device plays nothing for certain and its slots are free: silence begins within some carrier periods."""


MOST_ENTRY_PERIODS = 2**16 - 1


class PlayedCycle(NamedTuple):
    """A cycle that a device repeats."""

    ack: Ack
    """The answer to the sequence."""
    steps: tuple[tuple[int, int], ...]
    """A slot, and for how many carrier periods."""
    gain: float
    """The factor by which a limit has turned the drives down, 1 for not at all."""


def play_cycle(device: AnyDevice, cycle: Cycle, *, unattended: bool = False, limit: Limit | None = None) -> PlayedCycle:
    """Store a cycle's frames in a device, which then repeats them; its `envelope` becomes the device's modulation.

    What plays falls silent first, and its modulation ends.

    Parameters
    ----------
    device : Device or DeviceGroup
        The device on which to play.
    cycle : Cycle
        A cycle of at most as many different frames as the device has slots.
    unattended : bool
        Whether it goes on when the host falls silent.
    limit : callable, optional
        A limit that what is emitted must keep.

    Raises
    ------
    ValueError
        If the device has too few slots; or as `Device.store`.
    DeviceRefusedError
        If the device refuses it.
    """
    device.silence()  # what plays, or will play, cannot be overwritten
    device.time.sleep(SILENT_SECONDS)
    frames, steps = cycle.slots()
    pulses, gain = pulses_within(frames, device.calibration, limit)
    for slot in range(len(frames)):
        device.store(slot, pulses.pulses(slot))
    if cycle.envelope:
        device.modulate(*sine(cycle.envelope))
    whole = tuple(split_steps(steps))
    return PlayedCycle(device.play(whole, unattended=unattended), whole, gain)


def split_steps(steps: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Steps (slot, periods) in parts that an entry can hold; a step of no periods has none."""
    for slot, periods in steps:
        left = periods
        while left > 0:
            yield slot, min(left, MOST_ENTRY_PERIODS)
            left -= MOST_ENTRY_PERIODS
