"""A device whose queue is full of distant changes takes no block: its host waits, with signs of life, and gives up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from phasewire import Device, Pulses, open_device
from phasewire.errors import DeviceTimeoutError
from phasewire.protocol.codes import State

FULL = Pulses(np.full(320, 25), np.full(320, 25))
SECOND = 40_000
"""In carrier periods."""


@pytest.fixture(params=["", "?speed=full", "?door=serial&baud=3000000", "?door=serial"])
def device(request: pytest.FixtureRequest) -> Iterator[Device]:
    with open_device(f"emulator:{request.param}") as device:
        yield device


def fill(device: Device, first: int) -> None:
    """Queue what begins in and after a period, as much as there is room for."""
    for place in range(device.info.queue_blocks):
        device.show(FULL, first + place)


def test_a_block_waits_for_room_while_the_device_hears_of_its_host(device: Device) -> None:
    first = device.status().period + 2 * SECOND
    fill(device, first)
    device.keep_playing((first - device.status().period) / SECOND - 0.5)
    ack = device.show(FULL, first + 1000)
    assert (ack.commit_period, device.status().refused) == (first + 1000, 0)


def test_where_there_is_no_room_for_long_it_is_given_up_and_not_sent_again(device: Device) -> None:
    fill(device, device.status().period + 60 * SECOND)
    with pytest.raises(DeviceTimeoutError, match="did not take a block for 1 s: its queue is full; wait, or stop it"):
        device.show(FULL)
    status = device.status()
    assert (status.state, status.free, status.refused, status.dropped_frames) == (State.READY, 0, 0, 0)
    device.stop()
    assert device.show(FULL).commit_period > 0, "not what became of the one that waited"
