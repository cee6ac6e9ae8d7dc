"""The interfaces: blocks and records in packets, the console, and their state after a session."""

from __future__ import annotations

import pytest
from phasewire.emulator.control.requests import QUEUE_RECORDS
from phasewire.emulator.door import Handshake
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed
from phasewire.protocol.requests import Setup

from tests.emulator.usb_bench import SET_CONFIGURATION, Bench, ack, configured, status

SPEEDS = {HIGH_SPEED: 512, FULL_SPEED: 64}
GET_LINE_CODING = Setup(0xA1, 0x21, 0, 1, 7)
SET_LINE_CODING = Setup(0x21, 0x20, 0, 1, 7)


def dtr(high: bool) -> Setup:
    return Setup(0x21, 0x22, 2 | high, 1, 0)  # RTS is ignored


# Blocks


def transfer(bench: Bench, data: bytes, *, empty_packet: bool) -> None:
    """Send data as a host does: full packets, then a short one, and an empty one if it is due."""
    size = SPEEDS[bench.usb.speed]
    for at in range(0, len(data), size):
        assert bench.usb.bulk_out(0x01, data[at : at + size]) is Handshake.ACK
    if empty_packet and len(data) % size == 0:
        assert bench.usb.bulk_out(0x01, b"") is Handshake.ACK


def test_a_part_of_a_block_waits_for_the_rest() -> None:
    bench = configured(FULL_SPEED)
    for n in range(7):
        bench.usb.bulk_out(0x01, bytes([n]) * 64)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK
    bench.usb.bulk_out(0x01, bytes([7]) * 64)
    assert bench.controller.blocks == [b"".join(bytes([n]) * 64 for n in range(8))]
    assert bench.usb.bulk_in(0x81) == ack(0)


def test_no_block_is_taken_while_the_record_buffer_is_full() -> None:
    """Clause ACK-001; an unsolicited record is additional to those (clause ACK-006)."""
    bench = configured()
    bench.door.notify(status(0))
    for _ in range(QUEUE_RECORDS):
        assert bench.usb.bulk_out(0x01, bytes(512)) is Handshake.ACK
    bench.door.notify(status(1))
    assert bench.usb.bulk_out(0x01, bytes(512)) is Handshake.NAK
    bench.usb.bulk_in(0x81)
    assert bench.usb.bulk_out(0x01, bytes(512)) is Handshake.ACK


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
    "bus reset": None,
    "SET_CONFIGURATION": SET_CONFIGURATION,
    "SET_INTERFACE of interface 0": Setup(0x01, 11, 0, 0, 0),
    "CLEAR_FEATURE of 01 OUT": Setup(0x02, 1, 0, 0x01, 0),
}
GOES_ON = "go on"
WHAT_BECOMES = [  # clause USB-026, row by row
    ("outputs, queue", "off, emptied", "off, emptied", "off, emptied", GOES_ON),
    ("sequence numbers", "any is accepted next", "any is accepted next", "any is accepted next", GOES_ON),
    ("slots, entries, samples; watchdog time, drive limit", "stay", "stay", "stay", "stay"),
    ("records that wait", "dropped", "dropped", "dropped", GOES_ON),
    ("a block of which a part has arrived", "forgotten", "forgotten", "forgotten", "forgotten"),
    ("mode of the CDC line", "console", "console", GOES_ON, GOES_ON),
    ("line coding", "as at first", "as at first", GOES_ON, GOES_ON),
    ("DTR", "low", "low", GOES_ON, GOES_ON),
]


def fate(bench: Bench, what: str) -> str:
    """Which parts of the state that `in_full_swing` leaves still hold."""
    usb = bench.usb
    if what == "outputs, queue":
        return "off, emptied" if "new session" in bench.controller.told else GOES_ON
    if what == "sequence numbers":
        return "any is accepted next" if "new session" in bench.controller.told else GOES_ON
    if what.startswith("slots"):
        return "stay" if {*bench.controller.told} <= {"new session", "host arrived"} else "are told something else"
    if what == "records that wait":
        return "dropped" if usb.bulk_in(0x81) is Handshake.NAK else GOES_ON
    if what == "a block of which a part has arrived":
        transfer(bench, b"\x55" * 512, empty_packet=False)
        return "forgotten" if bench.controller.blocks[-1] == b"\x55" * 512 else GOES_ON
    if what == "mode of the CDC line":
        return "console" if "hang up" in bench.line.told else GOES_ON
    if what == "line coding":
        return "as at first" if usb.control(GET_LINE_CODING) == bytes([0, 0xC2, 1, 0, 0, 0, 8]) else GOES_ON
    bench.line.told.clear()
    usb.control(dtr(True))  # the line notices if it was low
    return "low" if bench.line.told == ["open"] else GOES_ON


def in_full_swing() -> Bench:
    bench = configured(FULL_SPEED)
    transfer(bench, bytes(512), empty_packet=False)
    transfer(bench, bytes(128), empty_packet=False)
    bench.usb.control(SET_LINE_CODING, bytes([0x80, 0x25, 0, 0, 2, 2, 7]))
    bench.usb.control(dtr(True))
    bench.line.told.clear()
    return bench


@pytest.mark.parametrize(("event", "column"), [(event, n) for n, event in enumerate(EVENTS, start=1)])
@pytest.mark.parametrize("row", WHAT_BECOMES, ids=lambda row: row[0])
def test_the_rest_after_an_event(event: str, column: int, row: tuple[str, ...]) -> None:
    bench = in_full_swing()
    setup = EVENTS[event]
    if setup is None:
        bench.usb.reset()
    else:
        bench.usb.control(setup)
    told = [*bench.controller.told], [*bench.line.told]
    if not bench.usb.configuration:
        bench.usb.control(SET_CONFIGURATION)
        bench.controller.told, bench.line.told = told
    assert fate(bench, row[0]) == row[column]


def test_the_controller_is_notified_of_sessions_and_hosts() -> None:
    """Clauses STA-002 and FWU-020."""
    bench = Bench()
    assert bench.controller.told == []
    bench.usb.control(SET_CONFIGURATION)
    assert bench.controller.told == ["new session", "host arrived"]
    bench.usb.control(Setup(0x00, 9, 0, 0, 0))
    assert bench.controller.told == ["new session", "host arrived", "new session"]
    bench.usb.control(SET_CONFIGURATION)
    bench.controller.told.clear()
    bench.usb.control(Setup(0x01, 11, 0, 0, 0))
    bench.usb.reset()
    assert bench.controller.told == ["new session", "new session"]


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


@pytest.mark.parametrize(("speed", "size"), SPEEDS.items())
def test_text_that_fills_its_last_packet_is_followed_by_an_empty_one(speed: Speed, size: int) -> None:
    """USB 2.0, 5.8.3: a host that reads more at once waits for a short packet."""
    bench = configured(speed)
    bench.line.output.extend(bytes(2 * size))
    assert [bench.usb.bulk_in(0x83) for _ in range(4)] == [bytes(size), bytes(size), b"", Handshake.NAK]


def test_a_line_that_was_hung_up_owes_no_empty_packet() -> None:
    bench = configured()
    bench.usb.control(dtr(True))
    bench.line.output.extend(bytes(512))
    assert bench.usb.bulk_in(0x83) == bytes(512)
    bench.usb.control(dtr(False))
    assert bench.usb.bulk_in(0x83) is Handshake.NAK
