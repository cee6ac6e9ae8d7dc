from __future__ import annotations

import re
import zlib

import pytest
from cobs import cobs
from construct import ConstructError
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import FrameError
from phasewire.protocol.codes import FrameKind, Outcome
from phasewire.protocol.framing import (
    BAUD,
    MAX_FRAME_BYTES,
    UART_BITS_PER_BYTE,
    FrameReader,
    SerialFrame,
    SerialReply,
    SerialRequest,
    decode,
    encode,
    frame_bytes,
)
from phasewire.protocol.layout.serial import FRAME

from tests.from_spec import cobs_encode
from tests.specification import table

STATUS = SerialRequest(tag=0x2A, request_type=0xC1, request=2, length=64)
STATUS_FRAME = SerialFrame(FrameKind.REQUEST, STATUS.encode())


def sealed(content: bytes) -> bytes:
    """Any content as a frame, whether or not its type and size are allowed."""
    return cobs_encode(content + zlib.crc32(content).to_bytes(4, "little")) + b"\0"


# The specification's tables and examples


def test_the_table_of_sizes() -> None:
    rows = table("frames")
    assert len(rows) == 8
    for name, body, most in rows:
        assert re.match(r"`\w+`", name)
        assert frame_bytes(int(body)) == int(most)
    assert max(int(most) for *_, most in rows) == MAX_FRAME_BYTES


def test_the_table_of_rates() -> None:
    """Each speed follows from the name of its line, and the rest from the speed."""
    rows = table("rates")
    assert [row[0].split(",")[0] for row in rows] == ["UART", "UART", "UART", "CDC-ACM"]
    speeds = [baud // UART_BITS_PER_BYTE for baud in (115_200, 1_000_000, 12_000_000)] + [13 * 8000 * 512]
    for (_, bytes_per_second, block_ms, blocks), speed in zip(rows, speeds, strict=True):
        rate = speed / frame_bytes(512)
        assert int(bytes_per_second.replace(" ", "")) == speed
        assert float(block_ms.removesuffix(" ms")) == round(1000 / rate, 2)
        assert int(blocks.replace(" ", "")) == int(rate)
    assert BAUD == 115_200


# One frame


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "does not end with 00"),
        (encode(STATUS_FRAME)[:-1], "does not end with 00"),
        (b"\1\0", "too short"),
        (b"\5ab\0", "not COBS"),
        (encode(STATUS_FRAME)[:-2] + b"\xcf\0", "CRC-32 cf88c2cd; it should be ce88c2cd"),
        (b"x" * MAX_FRAME_BYTES + b"\0", "at most 658 bytes"),
    ],
)
def test_bytes_that_are_no_frame_are_refused(data: bytes, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        decode(data)
    with pytest.raises(ConstructError):
        FRAME.parse(data)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SerialFrame(6, b""), "unknown type of frame 6"),  # type: ignore[arg-type]  # the wrong value is the point
        (lambda: SerialReply(0, 2), "unknown outcome 2"),  # type: ignore[arg-type]  # the wrong value is the point
        (lambda: SerialRequest(256, 0xC1, 2), "does not fit"),
        (lambda: SerialRequest(0, 0xC1, 2, value=-1), "does not fit"),
        (lambda: SerialRequest(0, 0x41, 2, length=1), "request 2 must carry 1 bytes, not 0"),
        (lambda: SerialReply(256, Outcome.DONE), "tag 256"),
        (lambda: SerialFrame(FrameKind.BLOCK, b"PW"), "a block has 512 bytes, not 2"),
    ],
)
def test_errors_name_wrong_arguments(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=message):
        make()


# Damage


def test_three_flipped_bits_in_the_content_are_always_found() -> None:
    """Clause SER-015: no sum of up to three powers of x below the longest content's length is a multiple of the CRC.

    A CRC is linear and the place of the first flipped bit does not matter, so that bit may stay put.
    """
    bits = 8 * (1 + 9 + 640 + 4)
    nothing = zlib.crc32(bytes(bits // 8))
    first, *others = (zlib.crc32((1 << bit).to_bytes(bits // 8, "little")) ^ nothing for bit in range(bits))
    assert first != 0
    assert not {first} & set(others)
    assert not {first ^ other for other in others} & set(others)


@given(st.binary(min_size=513, max_size=513), st.integers(1, 2**32 - 1), st.integers(0, 8 * 513 - 32))
def test_bursts_of_32_bits_are_found(content: bytes, pattern: int, place: int) -> None:
    burst = int.from_bytes(content, "little") ^ pattern << place
    assert zlib.crc32(burst.to_bytes(513, "little")) != zlib.crc32(content)


# Streams


def test_a_stream_without_zeros_takes_no_memory() -> None:
    reader = FrameReader()
    for _ in range(100):
        assert reader.feed(b"x" * 1000) == []
    held = max(len(value) for value in vars(reader).values())
    assert held <= MAX_FRAME_BYTES
    (dropped, frame) = reader.feed(b"\0" + encode(STATUS_FRAME))
    assert "at most 658 bytes" in str(dropped)
    assert frame == STATUS_FRAME


# The line that text and frames share


def test_no_frame_is_longer_than_its_limit() -> None:
    """Bytes without a zero are the worst for COBS."""
    longest = [len(cobs.encode(bytes([1]) * (1 + payload + 4)) + b"\0") for payload in range(600)]
    assert [frame_bytes(payload) for payload in range(600)] == longest
