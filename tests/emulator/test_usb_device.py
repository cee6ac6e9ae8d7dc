"""USB 2.0, chapter 9, and chapter USB of the specification, for any mode of the device."""

from __future__ import annotations

import pytest
from phasewire.emulator.door import Handshake, Stall
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed
from phasewire.protocol.requests import Setup

from tests.emulator.usb_bench import Bench, configured

GET_DEVICE = Setup(0x80, 6, 0x0100, 0, 18)
DETACH = Setup(0x21, 0, 1000, 3, 0)
GETSTATE = Setup(0xA1, 5, 0, 3, 1)


def stalls(bench: Bench, setup: Setup, data: bytes = b"") -> bool:
    try:
        bench.usb.control(setup, data)
    except Stall:
        return True
    return False


@pytest.fixture
def bench() -> Bench:
    return configured()


@pytest.mark.parametrize("setup", [Setup(0x00, 5, 128, 0, 0), Setup(0x00, 9, 1, 0, 3)], ids=["address 128", "data"])
def test_a_standard_request_with_wrong_fields_stalls(bench: Bench, setup: Setup) -> None:
    assert stalls(bench, setup)
    assert (bench.usb.attached, bench.usb.configuration) == (True, 1)


# Standard requests


@pytest.mark.parametrize("speed", [HIGH_SPEED, FULL_SPEED])
def test_only_a_high_speed_device_has_test_modes_and_it_stays_in_them(speed: Speed) -> None:
    """USB 2.0, 9.4.9: it no longer responds, until its power is cycled."""
    bench = configured(speed)
    test_packet = Setup(0x00, 3, 2, 0x0400, 0)
    assert stalls(bench, test_packet) == (speed == FULL_SPEED)
    assert bench.usb.attached == (speed == FULL_SPEED)
    bench.usb.reset()
    bench.run_ms(1000)
    assert bench.usb.attached == (speed == FULL_SPEED)


# Halts


@pytest.mark.parametrize(("speed", "largest"), [(HIGH_SPEED, 512), (FULL_SPEED, 64)])
def test_a_packet_that_no_bus_can_carry_is_refused(speed: Speed, largest: int) -> None:
    usb = configured(speed).usb
    for endpoint in (0x01, 0x03):
        assert usb.bulk_out(endpoint, bytes(largest)) is Handshake.ACK
        with pytest.raises(ValueError, match=rf"endpoint 0x0{endpoint} has at most {largest} bytes, not {largest + 1}"):
            usb.bulk_out(endpoint, bytes(largest + 1))


# Attachment


def test_it_attaches_with_voltage_and_firmware_only() -> None:
    """Clause USB-022; the generation tells a host to enumerate the device again."""
    bench = Bench()
    usb = bench.usb
    assert (usb.attached, usb.generation) == (True, 1)
    usb.unplug()
    assert (usb.attached, usb.generation) == (False, 1)
    usb.disconnect()
    usb.plug()
    assert (usb.attached, usb.generation) == (False, 1)
    usb.connect(bench.controller, bench.line, (1, 2, 3))
    assert (usb.attached, usb.generation) == (True, 2)
    usb.plug()  # it is plugged in already
    assert usb.generation == 2
    usb.unplug()
    usb.connect(bench.controller, bench.line, (1, 2, 3))
    assert (usb.attached, usb.generation) == (False, 2)
    usb.plug()
    assert (usb.attached, usb.generation) == (True, 3)


# To DFU mode and back


def test_the_console_detaches_as_the_request_does(bench: Bench) -> None:
    bench.usb.detach(bench.door)
    assert bench.usb.control(GETSTATE) == bytes([1])
    bench.run_ms(1010)
    assert bench.usb.generation == 2
    with pytest.raises(Stall, match="only a device in run-time mode"):
        bench.usb.detach(bench.door)


def test_a_bus_reset_hastens_a_detach_unless_it_was_cancelled(bench: Bench) -> None:
    bench.usb.control(DETACH)
    bench.controller.can_detach = False
    assert stalls(bench, DETACH)
    bench.usb.reset()
    assert not bench.usb.attached


@pytest.mark.parametrize("wait_ms", [0, 25])
def test_a_restart_cancels_a_detach(bench: Bench, wait_ms: int) -> None:
    bench.usb.control(DETACH)
    bench.run_ms(wait_ms)
    bench.usb.connect(bench.controller, bench.line, (1, 2, 3))
    bench.run_ms(2000)
    assert bench.usb.control(GET_DEVICE)[10:12] == b"\x01\x00"


def test_a_device_that_is_unplugged_meanwhile_comes_back_in_dfu_mode(bench: Bench) -> None:
    bench.usb.control(DETACH)
    bench.usb.unplug()
    bench.run_ms(2000)
    assert (bench.usb.attached, bench.usb.generation) == (False, 1)
    bench.usb.plug()
    assert (bench.usb.attached, bench.usb.generation) == (True, 2)
    assert bench.usb.control(GET_DEVICE)[10:12] == b"\x02\x00"
