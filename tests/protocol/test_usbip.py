"""USB/IP as bytes, against the tables and the capture in the Linux kernel's Documentation/usb/usbip_protocol.rst."""

from __future__ import annotations

import struct
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED, run_time
from phasewire.protocol.requests import Setup
from phasewire.protocol.usbip import (
    ANSWER_BYTES,
    MOST_URB_BYTES,
    Answer,
    Export,
    Importing,
    ImportStatus,
    Listing,
    Submit,
    Unlink,
    encode_command,
    encode_import,
    encode_list,
    encode_submitted,
    encode_unlinked,
    read_answer,
    read_command,
    read_import,
    read_list,
    read_request,
)

# The capture at the end of the document: interrupt transfers of 64 bytes, in and out.
COMMAND_IN = bytes.fromhex(
    "00000001 00000d05 0001000f 00000001 00000001 00000200 00000040 ffffffff 00000000 00000004 00000000 00000000"
)
COMMAND_OUT = bytes.fromhex(
    "00000001 00000d06 0001000f 00000000 00000001 00000000 00000040 ffffffff 00000000 00000004 00000000 00000000"
)
DATA_OUT = bytes.fromhex("ffffffff860008a784ce5ae212376300").ljust(64, b"\0")
ANSWER_OUT = bytes.fromhex(
    "00000003 00000d06 00000000 00000000 00000000 00000000 00000040 ffffffff 00000000 00000000 00000000 00000000"
)
ANSWER_IN = bytes.fromhex(
    "00000003 00000d05 00000000 00000000 00000000 00000000 00000040 ffffffff 00000000 00000000 00000000 00000000"
)
DATA_IN = bytes.fromhex("ffffffff860011a784ce5ae2123763612891b1020100000400").ljust(64, b"\0")

EXPORT = Export(1, 2, run_time((1, 2, 3), "array", "A-1"), HIGH_SPEED, 1)


def submit(data: bytes | bytearray) -> Submit:
    found = read_command(data)
    assert found
    assert found[1] == len(data)
    assert isinstance(found[0], Submit)
    return found[0]


def test_the_capture_of_the_document_is_read_and_answered_alike() -> None:
    command = submit(COMMAND_IN)
    assert command[:6] == (0xD05, 0x1000F, 0x81, False, False, 64)
    assert command.data == b""
    assert encode_submitted(command, 0, 64, DATA_IN) == ANSWER_IN + DATA_IN
    command = submit(COMMAND_OUT + DATA_OUT)
    assert command[:6] == (0xD06, 0x1000F, 0x01, False, False, 64)
    assert command.data == DATA_OUT
    assert encode_submitted(command, 0, 64) == ANSWER_OUT


def test_requests_are_read() -> None:
    assert read_request(bytes.fromhex("01118005 00000000")) == (Listing(), 8)
    bus_id = b"3-2".ljust(32, b"\0")
    assert read_request(bytes.fromhex("01118003 00000000") + bus_id + b"more") == (Importing("3-2"), 40)


@pytest.mark.parametrize("whole", [bytes.fromhex("01118003 00000000") + bytes(32)])
def test_a_request_in_pieces_is_waited_for(whole: bytes) -> None:
    assert all(read_request(whole[:count]) is None for count in range(len(whole)))


def test_a_command_in_pieces_is_waited_for() -> None:
    whole = COMMAND_OUT + DATA_OUT
    assert all(read_command(whole[:count]) is None for count in range(len(whole)))
    assert read_command(whole + COMMAND_IN) == (submit(whole), len(whole))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("01108005 00000000", "version 0x0110"),
        ("01110005 00000000", "request 0x0005"),
        ("47455420 2f204854", "version 0x4745"),  # GET / HT…
    ],
)
def test_an_invalid_request_is_refused(data: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_request(bytes.fromhex(data))


@pytest.mark.parametrize(
    ("offset", "value", "message"),
    [
        (0, 5, "command 5"),
        (12, 2, "direction 2"),
        (16, 16, "endpoint 16"),
        (24, MOST_URB_BYTES + 1, f"{MOST_URB_BYTES + 1} bytes"),
        (32, 8, "isochronous"),
    ],
)
def test_an_invalid_command_is_refused(offset: int, value: int, message: str) -> None:
    data = bytearray(COMMAND_IN)
    struct.pack_into(">I", data, offset, value)
    with pytest.raises(ValueError, match=message):
        read_command(data)


def test_the_setup_stage_and_the_flags_are_read() -> None:
    data = bytearray(COMMAND_IN)
    struct.pack_into(">I", data, 16, 0)
    struct.pack_into(">I", data, 20, 0x0241)  # in, zero packet, short is not OK
    struct.pack_into(">I", data, 32, 0xFFFF_FFFF)
    data[40:48] = bytes.fromhex("80 06 00 01 00 00 12 00")  # GET_DESCRIPTOR, device, 18 bytes
    command = submit(data)
    assert (command.endpoint, command.zero_packet, command.short_not_ok) == (0x80, True, True)
    assert command.setup == Setup(0x80, 6, 0x0100, 0, 18)
    assert encode_submitted(command, -32, 0)[20:40].hex(" ", 4) == "ffffffe0 00000000 ffffffff ffffffff 00000000"


def test_unlink_is_read_and_answered() -> None:
    data = bytes.fromhex("00000002 00000d07 0001000f 00000000 00000000 00000d05") + bytes(24)
    assert read_command(data) == (Unlink(0xD07, 0x1000F, 0xD05), 48)
    assert encode_unlinked(0xD07, -104) == bytes.fromhex("00000004 00000d07" + "00" * 12 + "ffffff98") + bytes(24)


def test_a_device_is_described_as_the_document_says() -> None:
    answer = encode_import(ImportStatus.OK, EXPORT)
    assert len(answer) == 0x140
    assert answer[:8] == bytes.fromhex("01110003 00000000")
    assert answer[8:0x108].rstrip(b"\0") == b"/sys/devices/phasewire/usb1/1-2"
    assert answer[0x108:0x128].rstrip(b"\0") == b"1-2"
    assert struct.unpack_from(">3I", answer, 0x128) == (1, 2, 3)  # bus, device, high speed
    # 1209:0001, firmware 1.2.3, class EF 02 01, configuration 1 of 1, 4 interfaces
    assert answer[0x134:] == bytes.fromhex("1209 0001 0123 EF 02 01 01 01 04")
    full = encode_import(ImportStatus.OK, EXPORT._replace(speed=FULL_SPEED, configuration=0))
    assert struct.unpack_from(">I", full, 0x130) == (2,)
    assert full[0x13D] == 0
    assert encode_import(ImportStatus.NO_DEVICE) == bytes.fromhex("01110003 00000004")


def test_devices_are_listed_as_the_document_says() -> None:
    assert encode_list([]) == bytes.fromhex("01110005 00000000 00000000")
    second = EXPORT._replace(number=3)
    answer = encode_list([EXPORT, second])
    assert answer[:12] == bytes.fromhex("01110005 00000000 00000002")
    one = 0x138 + 4 * 4
    assert len(answer) == 12 + 2 * one
    assert answer[12 : 12 + 0x138] == encode_import(ImportStatus.OK, EXPORT)[8:]
    assert answer[0x144 : 12 + one] == bytes.fromhex("FF500100 02020000 0A000000 FE010100")
    assert answer[12 + one : 12 + one + 0x138] == encode_import(ImportStatus.OK, second)[8:]


# The client's side


def test_a_client_s_commands_are_those_of_the_document() -> None:
    for data in (COMMAND_OUT + DATA_OUT, COMMAND_IN):
        command = submit(data)
        assert command.interval == 4
        expected = bytearray(data)
        expected[20:24] = bytes(4)  # a flag that only tells the direction once more
        assert encode_command(command) == expected
    unlink = bytes.fromhex("00000002 00000d07 0001000f 00000000 00000000 00000d05") + bytes(24)
    assert encode_command(Unlink(0xD07, 0x1000F, 0xD05)) == unlink


def test_a_client_s_answers_are_those_of_the_document() -> None:
    assert read_answer(ANSWER_IN + DATA_IN) == Answer(False, 0xD05, 0, 64)
    assert read_answer(ANSWER_OUT) == Answer(False, 0xD06, 0, 64)
    assert read_answer(bytes.fromhex("00000004 00000d07" + "00" * 12 + "ffffff98") + bytes(24)) == Answer(
        True, 0xD07, -104, 0
    )
    assert all(read_answer(ANSWER_IN[:count]) is None for count in range(ANSWER_BYTES))
    with pytest.raises(ValueError, match="answer 1; there are 3 and 4"):
        read_answer(COMMAND_IN)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    with suppress(ValueError):
        assert (read_answer(data) is None) == (len(data) < ANSWER_BYTES)
    for read in (read_request, read_command, read_list, read_import):
        try:
            found = read(data)
        except ValueError:
            continue
        assert found is None or 0 < found[1] <= len(data)
