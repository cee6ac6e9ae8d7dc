"""What the interfaces do: blocks and records in packets, the console, and what becomes of them when a session ends."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.control.controller import RECORDS
from phasewire.emulator.door import Handshake
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, Speed
from phasewire.protocol.requests import Setup

from tests.emulator.usb_bench import SET_CONFIGURATION, Bench, ack, configured, status

SPEEDS = {HIGH_SPEED: 512, FULL_SPEED: 64}
GET_LINE_CODING = Setup(0xA1, 0x21, 0, 1, 7)
SET_LINE_CODING = Setup(0x21, 0x20, 0, 1, 7)


def dtr(high: bool) -> Setup:
    return Setup(0x21, 0x22, 2 | high, 1, 0)  # RTS is not looked at


# Blocks


def transfer(bench: Bench, data: bytes, *, empty_packet: bool) -> None:
    """Send data as a host does: full packets, then a short one, and an empty one where it is wanted and due."""
    size = SPEEDS[bench.usb.speed]
    for at in range(0, len(data), size):
        assert bench.usb.bulk_out(0x01, data[at : at + size]) is Handshake.ACK
    if empty_packet and len(data) % size == 0:
        assert bench.usb.bulk_out(0x01, b"") is Handshake.ACK


@pytest.mark.parametrize("speed", SPEEDS)
@given(blocks=st.lists(st.integers(0, 4), max_size=5), empty_packets=st.booleans())
def test_any_number_of_blocks_travel_in_one_transfer(speed: Speed, blocks: list[int], empty_packets: bool) -> None:
    """Clause USB-018."""
    bench = configured(speed)
    sent: list[bytes] = []
    for count in blocks:
        these = [bytes([len(sent) + n]) * 512 for n in range(count)]
        transfer(bench, b"".join(these), empty_packet=empty_packets)
        sent += these
    assert bench.controller.blocks == sent


@pytest.mark.parametrize("speed", SPEEDS)
@given(lengths=st.lists(st.integers(0, 1600), max_size=4))
def test_no_error_shifts_the_blocks_that_follow(speed: Speed, lengths: list[int]) -> None:
    """Clause USB-017: a transfer that ends with a short or an empty packet ends a block, whole or not."""
    bench = configured(speed)
    for length in lengths:
        transfer(bench, bytes(length), empty_packet=True)
    transfer(bench, b"\x55" * 512, empty_packet=False)
    expected = [bytes(min(512, length - at)) for length in lengths for at in range(0, length, 512)]
    assert bench.controller.blocks == [*expected, b"\x55" * 512]


def test_a_part_of_a_block_waits_for_the_rest() -> None:
    bench = configured(FULL_SPEED)
    for n in range(7):
        bench.usb.bulk_out(0x01, bytes([n]) * 64)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK
    bench.usb.bulk_out(0x01, bytes([7]) * 64)
    assert bench.controller.blocks == [b"".join(bytes([n]) * 64 for n in range(8))]
    assert bench.usb.bulk_in(0x81) == ack(0)


@pytest.mark.parametrize("speed", SPEEDS)
def test_nothing_is_taken_while_the_queue_is_full(speed: Speed) -> None:
    bench = configured(speed)
    bench.controller.can_accept = False
    packet = bytes(SPEEDS[speed])
    assert bench.usb.bulk_out(0x01, packet) is Handshake.NAK
    bench.controller.can_accept = True
    transfer(bench, bytes(512), empty_packet=False)
    assert bench.controller.blocks == [bytes(512)]


def test_nothing_is_taken_while_as_many_records_wait_as_the_device_holds() -> None:
    """Clause ACK-001; a record that nobody asked for is beside those (clause ACK-006)."""
    bench = configured()
    bench.door.notify(status(0))
    for _ in range(RECORDS):
        assert bench.usb.bulk_out(0x01, bytes(512)) is Handshake.ACK
    bench.door.notify(status(1))
    assert bench.usb.bulk_out(0x01, bytes(512)) is Handshake.NAK
    bench.usb.bulk_in(0x81)
    assert bench.usb.bulk_out(0x01, bytes(512)) is Handshake.ACK


# Records


def read_all(bench: Bench) -> list[bytes]:
    packets = []
    while isinstance(packet := bench.usb.bulk_in(0x81), bytes):
        packets.append(packet)
        assert len(packets) < 100
    return packets


@pytest.mark.parametrize("speed", SPEEDS)
@given(acks=st.integers(0, 70), unasked=st.booleans())
def test_a_packet_holds_whole_records_and_the_last_is_short(speed: Speed, acks: int, unasked: bool) -> None:
    """Clauses ACK-005 and USB-019."""
    bench, size = configured(speed), SPEEDS[speed]
    records = [ack(n) for n in range(acks)]
    for record in records:
        bench.door.acknowledge(record)
    if unasked:
        bench.door.notify(status(9))
        records.append(status(9))
    packets = read_all(bench)
    assert b"".join(packets) == b"".join(records)
    assert all(len(packet) % 32 == 0 and len(packet) <= size for packet in packets)
    assert all(size - len(packet) < 64 for packet in packets[:-2])  # no room for the largest record
    if packets:
        assert len(packets[-1]) < size
        assert all(packets[:-1])
    assert read_all(bench) == []


def test_what_comes_up_meanwhile_takes_the_place_of_the_empty_packet() -> None:
    bench = configured(FULL_SPEED)
    for n in range(2):
        bench.door.acknowledge(ack(n))
    assert bench.usb.bulk_in(0x81) == ack(0) + ack(1)
    bench.door.acknowledge(ack(2))
    assert bench.usb.bulk_in(0x81) == ack(2)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK


def test_a_newer_status_takes_the_place_of_an_older_one_behind_what_waits() -> None:
    """Clause ACK-006."""
    bench = configured()
    bench.door.acknowledge(ack(0))
    bench.door.notify(status(0))
    bench.door.acknowledge(ack(1))
    bench.door.notify(status(1))
    bench.door.acknowledge(ack(2))
    assert bench.usb.bulk_in(0x81) == ack(0) + ack(1) + status(1) + ack(2)
    bench.door.notify(status(2))
    assert bench.usb.bulk_in(0x81) == status(2)


def test_nobody_is_notified_who_has_not_configured_the_device() -> None:
    """Clause ACK-006."""
    bench = Bench()
    bench.door.notify(status(0))
    bench.usb.control(SET_CONFIGURATION)
    assert bench.usb.bulk_in(0x81) is Handshake.NAK


def test_a_session_begins_without_what_nobody_asked_for_in_the_last() -> None:
    bench = configured()
    bench.door.notify(status(0))
    bench.usb.control(SET_CONFIGURATION)
    bench.door.notify(status(1))
    assert bench.usb.bulk_in(0x81) == status(1)


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
    """What became of something in the state that `in_full_swing` leaves."""
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
    usb.control(dtr(True))  # which the line learns of if it was low
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
def test_what_becomes_of_the_rest(event: str, column: int, row: tuple[str, ...]) -> None:
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


def test_clearing_the_other_endpoint_keeps_a_part_of_a_block() -> None:
    """Clause USB-015."""
    bench = configured(FULL_SPEED)
    bench.usb.bulk_out(0x01, bytes(64))
    bench.usb.control(Setup(0x02, 1, 0, 0x81, 0))
    bench.usb.bulk_out(0x01, b"")
    assert bench.controller.blocks == [bytes(64)]


@pytest.mark.parametrize("interface", [1, 2, 3])
def test_setting_another_interface_leaves_the_array_alone(interface: int) -> None:
    bench = in_full_swing()
    bench.usb.control(Setup(0x01, 11, 0, interface, 0))
    assert bench.controller.told == bench.line.told == []
    assert bench.usb.bulk_in(0x81) == ack(0)


def test_the_controller_learns_of_sessions_and_of_hosts() -> None:
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


def test_the_console_keeps_its_line_coding() -> None:
    usb = configured().usb
    assert usb.control(GET_LINE_CODING) == bytes([0x00, 0xC2, 0x01, 0x00, 0, 0, 8])  # 115 200, 8N1
    wanted = bytes([0x80, 0x25, 0, 0, 2, 2, 7])
    assert usb.control(SET_LINE_CODING, wanted) == b""
    assert usb.control(GET_LINE_CODING) == wanted
    with pytest.raises(Exception, match="unknown"):
        usb.control(Setup(0x21, 0x20, 0, 1, 6), wanted[:6])
    assert usb.control(GET_LINE_CODING) == wanted


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


def test_a_console_that_is_not_read_delays_nothing() -> None:
    """Clause USB-025."""
    bench = configured()
    bench.line.can_receive = False
    bench.line.output.extend(bytes(5000))
    assert bench.usb.bulk_out(0x03, b"x") is Handshake.NAK
    assert bench.usb.bulk_out(0x01, bytes(512)) is Handshake.ACK
    assert bench.usb.bulk_in(0x81) == ack(0)
