"""The interfaces: blocks and records in packets, the console, and their state after a session."""

from __future__ import annotations

from phasewire.emulator.door import Handshake
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED
from phasewire.protocol.requests import Setup

from tests.emulator.usb_bench import SET_CONFIGURATION, Bench, ack, configured, status

SPEEDS = {HIGH_SPEED: 512, FULL_SPEED: 64}


def dtr(high: bool) -> Setup:
    return Setup(0x21, 0x22, 2 | high, 1, 0)  # RTS is ignored


# Records


def test_a_new_record_takes_the_place_of_the_empty_packet() -> None:
    bench = configured(FULL_SPEED)
    for n in range(2):
        bench.door.acknowledge(ack(n))
    assert bench.usb.bulk_in(0x81) == ack(0) + ack(1)
    bench.door.acknowledge(ack(2))
    assert bench.usb.bulk_in(0x81) == ack(2)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK


def test_a_host_is_notified_only_after_it_configured_the_device() -> None:
    """Clause ACK-006."""
    bench = Bench()
    bench.door.notify(status(0))
    bench.usb.control(SET_CONFIGURATION)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK


# Sessions


EVENTS = {
    "SET_CONFIGURATION": SET_CONFIGURATION,
    "SET_INTERFACE of interface 0": Setup(0x01, 11, 0, 0, 0),
    "CLEAR_FEATURE of 01 OUT": Setup(0x02, 1, 0, 0x01, 0),
}


def test_a_new_session_owes_no_empty_packet() -> None:
    bench = configured(FULL_SPEED)
    for n in range(2):
        bench.door.acknowledge(ack(n))
    assert bench.usb.bulk_in(0x81) == ack(0) + ack(1)
    bench.usb.control(SET_CONFIGURATION)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK


# The console


def test_dtr_opens_the_line_and_hangs_up() -> None:
    """Clauses USB-023 and SER-010."""
    bench = configured()
    for high in (False, True, True, False, False, True):
        bench.usb.control(dtr(high))
    assert bench.line.told == ["open", "hang up", "open"]


def test_bytes_of_the_console_pass_both_ways() -> None:
    bench = configured()
    assert bench.usb.bulk_out(0x03, b"help\r") is Handshake.ACK
    bench.line.can_receive = False
    assert bench.usb.bulk_out(0x03, b"again\r") is Handshake.NAK
    assert bench.line.received == b"help\r"
    assert bench.usb.bulk_in(0x83) is Handshake.NAK
    bench.line.output.extend(b"ok\r\n")
    assert bench.usb.bulk_in(0x83) == b"ok\r\n"
    assert bench.usb.bulk_in(0x82) is bench.usb.bulk_in(0x83) is Handshake.NAK
    assert bench.controller.blocks == []


def test_a_line_that_was_hung_up_owes_no_empty_packet() -> None:
    bench = configured()
    bench.usb.control(dtr(True))
    bench.line.output.extend(bytes(512))
    assert bench.usb.bulk_in(0x83) == bytes(512)
    bench.usb.control(dtr(False))
    assert bench.usb.bulk_in(0x83) is Handshake.NAK
