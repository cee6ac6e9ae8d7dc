"""What a conformance case cannot see of states and safety: exact core cycles, and messages one by one."""

from __future__ import annotations

import pytest
from phasewire import Emulator
from phasewire.emulator.door import Stall
from phasewire.protocol.blocks import (
    Entries,
    Entry,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.codes import Fault, Request, State
from phasewire.protocol.timing import FIVE_WIRE, Link

from tests.emulator.hosts import FULL, HALF, PERIOD, Device, Terminal

MS = 400_000


def stocked(*, unfolded: bool = True, link: Link = FIVE_WIRE) -> Device:
    """A device with stored entries: slot 0 for 100 periods, and for five."""
    device = Device(Emulator(unfolded=unfolded, link=link))
    device.send(Slot(0, FULL))
    device.send(Entries((Entry(0, 100), Entry(0, 5))))
    device.send(Samples(bytes([255, 128])))
    device.run(40)
    return device


# Effects of a transition (the last column of clause STA-003)


@pytest.mark.parametrize("unfolded", [False, True])
@pytest.mark.parametrize(("after", "begins"), [(-1, False), (0, True), (1, True)])
def test_a_change_that_goes_onto_the_chain_in_the_request_s_cycle_has_begun(
    unfolded: bool, after: int, begins: bool
) -> None:
    """Clauses SAF-004 and CHN-029: 5440 cycles of links, 400 of hops and 4400 to rasterise, ready one period before."""
    device = Device(Emulator(unfolded=unfolded), enabled=True)
    device.send(Update(FULL, 30))
    device.run_until(29 * PERIOD - 10_240 + after)
    device.order(Request.DISABLE)
    device.run_ms(25)
    assert bool(device.high_periods()) == begins
    assert (device.status().missed_commits, device.status().faults) == (0, Fault(0))


@pytest.mark.parametrize("unfolded", [False, True])
def test_a_change_begun_in_the_cycle_of_a_bus_reset_is_begun_whole(unfolded: bool) -> None:
    """Its sorting takes 7000 cycles; it goes onto the chain in the cycle of a bus reset that was planned earlier."""
    device = Device(Emulator(unfolded=unfolded), enabled=True)
    device.emulator.scheduler.at(device.emulator.running.time.boundary(30), device.usb.reset)
    device.run_until(30 * PERIOD - 7000)
    device.usb.bulk_out(0x01, device.pack(Update(FULL)))
    device.run_ms(25)
    assert device.high_periods() == {32}
    assert (device.state, device.status().faults) == (State.OFF, Fault(0))


# Unsolicited records (clause ACK-006)


def test_a_stream_of_updates_notifies_the_line_once() -> None:
    device = stocked(unfolded=False)
    device.order(Request.ENABLE)
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    device.send(Update(HALF))
    blocks = b"".join(device.pack(Update(HALF)) for _ in range(6))
    now = device.emulator.scheduler.now
    taken, _ = device.usb.stream_out(0x01, memoryview(blocks), now, now + MS)
    assert taken
    device.run(20)
    assert device.told() == []
    assert [told.state for told in terminal.told()] == [State.PLAYING]


# DETACH (clause STA-005)


def test_a_device_on_its_way_to_dfu_mode_is_not_detached_again() -> None:
    device = Device()
    device.detach()
    assert device.state is State.DFU
    with pytest.raises(Stall):
        device.detach()
    assert device.usb.attached
