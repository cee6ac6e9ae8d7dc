from __future__ import annotations

import io
import tracemalloc
from collections.abc import Iterator
from typing import Any

import pytest
from phasewire.base.errors import InputFileError
from phasewire.hil.traffic.packets import MAGICS
from phasewire.hil.traffic.traffic import Piece, Traffic
from phasewire.hil.traffic.usbmon import MOST_PENDING, UsbAddress, read_usbmon

from tests.captures import COMPLETE, ERROR, SUBMIT, bulk_in, bulk_out, control, event, pcap, pcapng

BLOCK = b"PW" + bytes(range(254)) * 2 + b"\1\2"
OTHER_BLOCK = b"PW" + bytes(510)
ACK = b"PA" + bytes(30)
STATUS = b"PS" + bytes(62)
GET_DEVICE_DESCRIPTOR = bytes.fromhex("80 06 0001 0000 1200")
DEVICE_DESCRIPTOR = bytes.fromhex("12 01 0002 00 00 00 40 0912 0100 0001 01 02 03 01")
GET_INFO = bytes.fromhex("c1 01 0000 0000 4000")


def read(capture: bytes, address: UsbAddress | None = None) -> list[Piece]:
    return list(read_usbmon(io.BytesIO(capture), "c", address))


def block(where: str, time: float, data: bytes = BLOCK, **settings: Any) -> Piece:
    return Piece(where, Traffic.BLOCK, "out", data, time, **settings)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("link", [189, 220])
@pytest.mark.parametrize("write", [pcap, pcapng])
def test_every_container_header_and_byte_order_tells_the_same(write: Any, link: int, order: str) -> None:
    settings: dict[str, Any] = {"link": link, "order": order}
    packets = [
        *control(1, GET_DEVICE_DESCRIPTOR, DEVICE_DESCRIPTOR, at=10, **settings),
        *bulk_out(0xFFFF_8881_0203_0405, BLOCK + OTHER_BLOCK, at=500, **settings),
        *bulk_in(3, ACK + STATUS + ACK, at=600, **settings),
    ]
    capture = write(packets, order=order, **({"link": link} if write is pcap else {"links": [link]}))
    assert capture.startswith(MAGICS)
    assert read(capture) == [
        Piece("packet 1", Traffic.REQUEST, "in", DEVICE_DESCRIPTOR, 60e-6, GET_DEVICE_DESCRIPTOR),
        block("packet 3", 490e-6),
        block("packet 3 +512", 490e-6, OTHER_BLOCK),
        Piece("packet 6", Traffic.RECORD, "in", ACK, 690e-6),
        Piece("packet 6 +32", Traffic.RECORD, "in", STATUS, 690e-6),
        Piece("packet 6 +96", Traffic.RECORD, "in", ACK, 690e-6),
    ]


@pytest.mark.parametrize("order", ["<", ">"])
def test_classic_captures_with_nanoseconds_are_read_too(order: str) -> None:
    capture = pcap(bulk_out(1, BLOCK, order=order), order=order, magic=0xA1B23C4D)
    assert read(capture) == [block("packet 1", 0.0)]


def test_packets_have_the_link_type_of_their_interface() -> None:
    """Where a network was captured too, on the first interface."""
    assert read(pcapng(bulk_out(1, BLOCK), links=[1, 220], interface=1)) == [block("packet 1", 0.0)]


def test_sections_of_either_byte_order_follow_each_other() -> None:
    little, big = pcapng(bulk_out(1, BLOCK)), pcapng(bulk_out(1, OTHER_BLOCK, order=">"), order=">")
    assert [piece.data for piece in read(little + big)] == [BLOCK, OTHER_BLOCK]


def test_blocks_that_are_no_packets_are_skipped() -> None:
    """A comment or statistics may stand anywhere."""
    unknown = bytes.fromhex("ad0b0000 10000000 01020304 10000000")
    section = len(pcapng([]))
    capture = pcapng(bulk_out(1, BLOCK))
    assert read(capture[:section] + unknown + capture[section:] + unknown) == [block("packet 1", 0.0)]


def test_transfers_come_in_causal_order() -> None:
    """usbmon has reported this of a stream over USB/IP: acknowledgements before the completions of their blocks."""
    first, second, early, late = bulk_out(1, BLOCK), bulk_out(2, OTHER_BLOCK), bulk_in(3, ACK), bulk_in(4, STATUS)
    packets = [early[0], late[0], first[0], second[0], early[1], second[1], late[1], first[1]]
    assert [(piece.where, piece.data) for piece in read(pcapng(packets))] == [
        ("packet 3", BLOCK),
        ("packet 4", OTHER_BLOCK),
        ("packet 5", ACK),
        ("packet 7", STATUS),
    ]


def test_a_transfer_that_does_not_end_holds_up_only_so_many_others() -> None:
    """Such as text for a console that takes none: it is read when it ends, and no other piece is read twice."""
    stuck = bulk_out(1, b"info\r", endpoint=0x03)
    answers = [packet for urb in range(MOST_PENDING + 1) for packet in bulk_in(2 + urb, ACK)]
    pieces = read(pcap([stuck[0], *answers, stuck[1], *bulk_out(1, BLOCK)]))
    assert [piece.traffic for piece in pieces] == [
        *[Traffic.RECORD] * (MOST_PENDING + 1),
        Traffic.TEXT,
        Traffic.BLOCK,
    ]


def test_transfers_that_a_capture_cuts_off_are_read_as_far_as_recorded() -> None:
    completion_alone = bulk_out(1, BLOCK)[1:]
    answer_alone = bulk_in(2, ACK)[1:]
    waiting = bulk_in(3, ACK)[:1]
    not_completed = bulk_out(4, BLOCK, at=9)[:1]
    pieces = read(pcapng(completion_alone + answer_alone + waiting + not_completed))
    assert [(piece.where, piece.traffic) for piece in pieces] == [
        ("packet 2", Traffic.RECORD),
        ("packet 4", Traffic.BLOCK),
    ]
    assert not any(piece.problem for piece in pieces)


@pytest.mark.parametrize(
    ("status", "taken", "problem"),
    [
        (-2, 512, "cancelled by the host"),
        (-32, 0, "the endpoint is halted"),
        (-5, 0, "the host reports error 5"),
        (0, 512, "only 512 of 1024 bytes were taken"),
    ],
)
def test_a_failed_transfer_has_its_problem_and_its_data(status: int, taken: int, problem: str) -> None:
    submitted = bulk_out(1, BLOCK + OTHER_BLOCK)[0]
    completed = event(COMPLETE, 1, 0x01, length=taken, status=status)
    pieces = read(pcapng([submitted, completed]))
    assert [piece.data for piece in pieces] == ([BLOCK] if taken else []) + [b""]
    assert [piece.problem for piece in pieces] == ([""] if taken else []) + [problem]


def test_a_submission_that_the_host_refuses_is_a_problem() -> None:
    packets = [bulk_out(1, BLOCK)[0], event(ERROR, 1, 0x01, status=-110)]
    assert [(piece.data, piece.problem) for piece in read(pcapng(packets))] == [(b"", "no answer in time")]


@pytest.mark.parametrize("status", [-2, -104, -108, -121])
def test_a_read_that_the_host_cancels_is_no_piece(status: int) -> None:
    packets = [*bulk_in(1, ACK), event(COMPLETE, 2, 0x81, status=status)]
    assert [piece.data for piece in read(pcapng(packets))] == [ACK]


def test_what_was_not_captured_is_counted() -> None:
    packets = bulk_out(1, BLOCK + BLOCK + BLOCK, captured=600) + bulk_in(2, ACK + ACK, captured=40)
    assert [(len(piece.data), piece.missing) for piece in read(pcapng(packets))] == [
        (512, 0),
        (88, 424),
        (0, 512),
        (32, 0),
        (8, 24),
    ]


def test_packets_cut_short_by_the_capture_are_counted() -> None:
    """A snap length cuts packets, and usbmon's own count of captured bytes ignores it."""
    submitted, completed = bulk_out(1, BLOCK)
    assert [(len(piece.data), piece.missing) for piece in read(pcapng([submitted[:164], completed]))] == [(100, 412)]


def test_bytes_after_the_captured_ones_are_no_data() -> None:
    submitted, completed = bulk_out(1, BLOCK, captured=512)
    assert [piece.data for piece in read(pcapng([submitted + b"padding", completed]))] == [BLOCK]
    short, completed = bulk_out(1, BLOCK, captured=100)
    assert [len(piece.data) for piece in read(pcapng([short + b"padding", completed]))] == [100]


def test_a_control_transfer_without_its_setup_stage_is_skipped() -> None:
    packets = [
        event(SUBMIT, 1, 0x80, length=64, transfer=2),
        event(COMPLETE, 1, 0x80, data=bytes(64), transfer=2),
    ]
    assert read(pcapng(packets), UsbAddress(2, 5)) == []


def test_other_devices_are_left_out() -> None:
    packets = [
        *bulk_out(1, b"USBC" + bytes(27), device=4),
        *bulk_out(2, BLOCK, device=6),
        *control(3, GET_DEVICE_DESCRIPTOR, DEVICE_DESCRIPTOR, device=0),  # before it has an address
        *control(3, GET_DEVICE_DESCRIPTOR, DEVICE_DESCRIPTOR, device=9, bus=1),
        *control(3, GET_DEVICE_DESCRIPTOR, DEVICE_DESCRIPTOR[:8] + b"\x34\x12\x01\x00", device=7),
        *bulk_in(4, ACK, device=8),
    ]
    assert [piece.where for piece in read(pcapng(packets))] == ["packet 3", "packet 7", "packet 12"]
    assert [piece.data for piece in read(pcapng(packets), UsbAddress(2, 4))] == [b"USBC" + bytes(27)]
    with pytest.raises(InputFileError, match=r"^c: no device 3\.1 .*2\.0, 2\.4, 2\.6, 2\.7, 2\.8"):
        read(pcapng(packets), UsbAddress(3, 1))
    with pytest.raises(InputFileError, match=r"^c: no array .* traffic of 2\.4; choose"):
        read(pcapng(packets[:2]))


def test_the_console_is_read_wherever_it_was_cut() -> None:
    texts = bulk_in(1, b"> ", endpoint=0x83) + bulk_out(2, b"info\r\0\1", endpoint=0x03)
    frames = bulk_out(3, b"\2\0\3\0\4", endpoint=0x03)
    pieces = read(pcapng(texts + frames), UsbAddress(2, 5))
    assert [(piece.where, piece.traffic, piece.direction, piece.data) for piece in pieces] == [
        ("packet 2", Traffic.TEXT, "in", b"> "),
        ("packet 3", Traffic.TEXT, "out", b"info\r"),
        ("packet 5", Traffic.FRAME, "out", b"\1\2"),
        ("packet 5", Traffic.FRAME, "out", b"\3"),
        ("the end", Traffic.FRAME, "out", b"\4"),
    ]


def test_other_endpoints_are_passed_on_whole() -> None:
    packets = bulk_in(1, b"note", endpoint=0x82, transfer=1)
    assert read(pcapng(packets), UsbAddress(2, 5)) == [Piece("packet 2", Traffic.OTHER, "in", b"note", 100e-6)]


def refusal(capture: bytes) -> str:
    with pytest.raises(InputFileError) as refused:
        read(capture)
    return str(refused.value)


def test_a_malformed_container_is_refused_with_its_place() -> None:
    capture = pcapng(bulk_out(1, BLOCK) + bulk_out(2, BLOCK))
    classic = pcap(bulk_out(1, BLOCK) + bulk_out(2, BLOCK))
    section, size = len(pcapng([])), len(bulk_out(1, BLOCK)[0])
    third = section + (32 + size) + (32 + size - 512)
    assert refusal(capture[:-7]) == "c, packet 4: the file ends within it"
    assert refusal(classic[:-7]) == "c, packet 4: the file ends within it"
    assert refusal(classic[: 24 + 9]) == "c, packet 1: the file ends within it"
    assert refusal(b"\x0a\x0d\x0d\x0a") == "c, packet 1: the file ends within it"
    huge = capture[: third + 4] + b"\xfc\xff\xff\xff" + capture[third + 8 :]
    assert refusal(huge) == "c, packet 3: a length of 4294967284 bytes is corrupt"
    odd = capture[: third + 4] + b"\x41\0\0\0" + capture[third + 8 :]
    assert refusal(odd) == "c, packet 3: a block's length of 65 bytes is corrupt"
    none = capture[: third + 4] + b"\0\0\0\0" + capture[third + 8 :]
    assert refusal(none) == "c, packet 3: a length of -8 bytes is corrupt"
    stranger = capture[: third + 8] + b"\1\0\0\0" + capture[third + 12 :]
    assert "c, packet 3: it claims 576 bytes of interface 1" in refusal(stranger)
    longer = capture[: third + 20] + b"\x44\2\0\0" + capture[third + 24 :]
    assert "c, packet 3: it claims 580 bytes of interface 0" in refusal(longer)
    unequal = capture[:-1] + b"\1"
    assert refusal(unequal).startswith("c, packet 4: ")
    assert "no byte-order magic" in refusal(capture[:8] + b"\0" + capture[9:])
    assert "begins neither a pcap nor a pcapng file" in refusal(b"PW" + bytes(100))
    assert "no packet in it is of Linux's usbmon" in refusal(pcap([bytes(60)], link=1))
    assert refusal(pcap([bytes(60)])) == "c, packet 1: it has 60 bytes, and usbmon's header alone 64"


class Endless(io.RawIOBase):
    """A classic capture of so many packets, made while it is read."""

    def __init__(self, packets: int) -> None:
        self._packets, self._chunks = packets, iter([b""])
        self._held = b""

    def seek(self, offset: int, whence: int = 0) -> int:
        self._held, self._chunks = b"", self._make()
        return 0

    def read(self, size: int | None = -1) -> bytes:
        assert size is not None
        while len(self._held) < size and (chunk := next(self._chunks, b"")):
            self._held += chunk
        data, self._held = self._held[:size], self._held[size:]
        return data

    def _make(self) -> Iterator[bytes]:
        head = len(pcap([]))
        yield pcap([])
        for urb in range(self._packets):
            yield pcap([bulk_out(urb, BLOCK)[0]])[head:]


@pytest.mark.slow
def test_submissions_without_end_are_not_all_kept() -> None:
    tracemalloc.start()
    try:
        capture: Any = Endless(3 * MOST_PENDING)
        pieces = sum(not piece.problem for piece in read_usbmon(capture, "c"))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert pieces == 3 * MOST_PENDING
    assert peak < 2 * MOST_PENDING * 1500


def test_time_counts_from_the_first_packet_of_anyone() -> None:
    other = event(SUBMIT, 1, 0x81, device=3, microseconds=7)
    assert [piece.time for piece in read(pcapng([other, *bulk_out(1, BLOCK, at=1_000_007)]))] == [1.0]
