from __future__ import annotations

import dataclasses
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.errors import ReplyError
from phasewire.protocol import Ack, Info, Reason, Status, Wiring
from phasewire.protocol.replies import decode_wiring, encode_wiring

U8, U16, U32, U64 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64))
ACKS = st.builds(Ack, st.sampled_from(Reason), U32, U64, U64, st.booleans(), U8)
STATUSES = st.builds(Status, st.booleans(), st.booleans(), st.sampled_from(Reason), U64, U32, U32, U32, U32)
INFO = Info(1, (0, 1, 0), 320, 20, 16, 10.3e-3, 5, 2, 50, 25, 5, 8, 40_000, 40_000, 0.1)


@given(ACKS)
def test_acks_survive_the_way(ack: Ack) -> None:
    data = ack.encode()
    assert len(data) == 32
    assert Ack.decode(data) == ack
    assert int.from_bytes(data[28:], "little") == zlib.crc32(data[:28])


@given(STATUSES)
def test_statuses_survive_the_way(status: Status) -> None:
    assert len(status.encode()) == 28
    assert Status.decode(status.encode()) == status


def test_info_survives_the_way() -> None:
    assert len(INFO.encode()) == 32
    assert Info.decode(INFO.encode()) == INFO


def test_the_wiring_table_survives_the_way(scrambled: Wiring) -> None:
    data = encode_wiring(scrambled)
    assert len(data) == 640
    assert int.from_bytes(data[2:4], "little") == scrambled.channels[1]
    assert decode_wiring(data).channels.tolist() == scrambled.channels.tolist()


def test_an_ack_by_hand() -> None:
    data = Ack(Reason.PHASE, 0x01020304, 5, 6, True, 7).encode()
    assert data[:8] == b"PA" + bytes([1, 7]) + bytes([4, 3, 2, 1])
    assert data[8:28] == bytes([5, 0, 0, 0, 0, 0, 0, 0, 6, 0, 0, 0, 0, 0, 0, 0, 1, 7, 0, 0])


def test_a_status_by_hand() -> None:
    data = Status(True, False, Reason.WIDTH, 0x0807060504030201, 10, 11, 12, 13).encode()
    assert data == bytes([1, 0, 8, 0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 0, 0, 0, 11, 0, 0, 0, 12, 0, 0, 0, 13, 0, 0, 0])


def test_an_information_record_by_hand() -> None:
    """Field by field as clause REQ-002 lists them."""
    fields = [
        (1, 1),  # protocol version
        (0, 1),  # firmware
        (1, 1),
        (0, 1),
        (320, 2),  # channels
        (20, 1),  # columns
        (16, 1),  # rows
        (10_300, 2),  # pitch in µm
        (5, 1),  # boards
        (2, 1),  # processors per board
        (50, 1),  # ticks per period
        (25, 1),  # largest width
        (5, 1),  # wires per link
        (8, 1),  # blocks that can be queued
        (40_000, 4),  # carrier in Hz
        (39_999, 4),  # most updates per second
        (100, 2),  # watchdog in ms
        (0, 6),  # reserved
    ]
    expected = b"".join(value.to_bytes(size, "little") for value, size in fields)
    assert dataclasses.replace(INFO, max_updates_per_second=39_999).encode() == expected


@given(ACKS, st.integers(0, 32 * 8 - 1))
def test_every_flipped_bit_of_an_ack_is_refused(ack: Ack, bit: int) -> None:
    data = bytearray(ack.encode())
    data[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ReplyError):
        Ack.decode(bytes(data))


@pytest.mark.parametrize("kind", [Ack, Status, Info])
@given(data=st.binary(max_size=64))
def test_any_bytes_are_read_or_refused(kind: type[Ack] | type[Status] | type[Info], data: bytes) -> None:
    try:
        reply = kind.decode(data)
    except ReplyError:
        return
    assert reply.encode() == data
