from __future__ import annotations

import numpy as np
import pytest
from phasewire import Pulses, open_device
from phasewire.emulator.boards.sync import SyncLine
from phasewire.emulator.cluster import Cluster
from phasewire.emulator.machine import Emulator
from phasewire.protocol import Fault, State
from phasewire.protocol.codes import Request
from phasewire.protocol.replies import ClockReading, Status
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import Link

PULSE = 4096 * 10_000


def status(device: Emulator) -> Status:
    return Status.decode(device.usb.control(Setup(0xC1, Request.STATUS, 0, 0, 64)))


def configured(device: Emulator) -> Emulator:
    device.usb.control(Setup(0x00, 9, 1, 0, 0))
    return device


def test_all_begin_with_a_pulse_so_that_boundaries_coincide() -> None:
    driver, *listeners = Cluster(3)
    for listener in listeners:
        apart = listener.running.time.origin - driver.running.time.origin
        assert apart % PULSE == 0
    late = Emulator(sync=driver.sync, link=Link("slow", 2, 10, cycles_per_symbol=200))  # is numbered some ms later
    assert late.running.time.origin - driver.running.time.origin == PULSE


def test_a_field_begins_on_all_devices_in_the_same_tick() -> None:
    """A host reads all clocks, and names the same moment to each device in its own count."""
    with Cluster(4, serial="BIG") as cluster:
        cluster.run(50_000)
        full = Pulses(np.full(320, 25), np.full(320, 25))
        moments = []
        for device in cluster:
            with open_device(device.url) as host:
                reading = ClockReading.decode(device.usb.control(Setup(0xC1, Request.CLOCK, 0, 0, 24)))
                assert reading.sync_period % 4096 == 0
                ack = host.show(full, period=reading.sync_period + 4000)
                device.run_until(ack.commit_period + 2)
                first = device.capture().latches[0][-1]
                moments.append(device.running.time.origin + 200 * first)
        assert len(set(moments)) == 1


def test_a_listener_without_a_driver_starts_with_a_fault() -> None:
    alone = configured(Emulator(sync=SyncLine()))
    assert alone.scheduler.now >= 5 * 400_000_000
    assert (status(alone).state, status(alone).faults) == (State.FAULT, Fault.SYNC)


def test_listeners_notice_that_the_driver_restarted() -> None:
    driver, listener = Cluster(2)
    configured(listener)
    driver.power_down()
    listener.run(2 * 4096 + 500)
    assert Fault.SYNC in status(listener).faults
    assert status(listener).state is State.FAULT
    driver.power_up()
    driver.run_until_started()


@pytest.mark.parametrize("count", [0, 65])
def test_there_are_1_to_64_devices(count: int) -> None:
    with pytest.raises(ValueError, match=f"number of devices .*{count}"):
        Cluster(count)
