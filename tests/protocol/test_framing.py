from __future__ import annotations

import dataclasses
import re
import zlib
from collections.abc import Sequence

import pytest
from cobs import cobs
from construct import Construct, ConstructError
from hypothesis import given
from hypothesis import strategies as st
from phasewire.errors import FrameError
from phasewire.protocol.codes import FrameKind, Outcome
from phasewire.protocol.framing import (
    BAUD,
    CONSOLE_FRAME,
    MAX_FRAME_BYTES,
    UART_BITS_PER_BYTE,
    Frame,
    FrameReader,
    Line,
    LineEvent,
    Mode,
    SerialReply,
    SerialRequest,
    decode,
    encode,
    frame_bytes,
)
from phasewire.protocol.layout.serial import FRAME, SERIAL_REPLY, SERIAL_REQUEST

from tests.specification import codes, fields, hex_examples, layout_rows, table

STATUS = SerialRequest(tag=0x2A, request_type=0xC1, request=2, length=64)
STATUS_FRAME = Frame(FrameKind.REQUEST, STATUS.encode())

U8, U16 = st.integers(0, 2**8 - 1), st.integers(0, 2**16 - 1)


def blob(size: int) -> st.SearchStrategy[bytes]:
    """Bytes of this size in which zeros, and long runs without them, both occur."""
    uniform = st.integers(0, 255).map(lambda byte: bytes([byte]) * size)
    return st.one_of(st.binary(min_size=size, max_size=size), uniform)


ASKING = st.builds(SerialRequest, U8, U8.map(lambda kind: kind | 0x80), U8, U16, U16, st.integers(0, 640))
TELLING = st.binary(max_size=640).flatmap(
    lambda data: st.builds(
        SerialRequest, U8, U8.map(lambda kind: kind & 0x7F), U8, U16, U16, st.just(len(data)), st.just(data)
    )
)
REQUESTS = st.one_of(ASKING, TELLING)
REPLIES = st.one_of(
    st.builds(SerialReply, U8, st.just(Outcome.DONE), st.integers(0, 640).flatmap(blob)),
    st.builds(SerialReply, U8, st.just(Outcome.STALL)),
)
FRAMES = st.one_of(
    st.builds(Frame, st.just(FrameKind.BLOCK), blob(512)),
    st.builds(Frame, st.just(FrameKind.RECORD), st.one_of(blob(32), blob(64))),
    st.builds(Frame, st.just(FrameKind.REQUEST), REQUESTS.map(SerialRequest.encode)),
    st.builds(Frame, st.just(FrameKind.REPLY), REPLIES.map(SerialReply.encode)),
    st.just(CONSOLE_FRAME),
)


@st.composite
def cuts(draw: st.DrawFn, data: bytes) -> list[bytes]:
    """The same bytes in pieces."""
    places = sorted(draw(st.lists(st.integers(0, len(data)), max_size=12)))
    return [data[start:stop] for start, stop in zip([0, *places], [*places, len(data)], strict=True)]


STREAMS = st.lists(
    st.one_of(
        FRAMES.map(encode),
        FRAMES.map(lambda frame: encode(frame)[:-3]),
        st.binary(max_size=20),
        st.just(b"\0\0"),
        st.integers(600, 2000).map(lambda size: b"x" * size),
    ),
    max_size=6,
).map(b"".join)


def stuff(content: bytes) -> bytes:
    """COBS word for word as clause SER-003 puts it, without a thought for speed."""
    stuffed = b""
    *pieces, last = content.split(b"\0")
    for piece, ends_content in [*((piece, False) for piece in pieces), (last, True)]:
        left = piece
        while len(left) >= 254:
            stuffed += b"\xff" + left[:254]
            left = left[254:]
        if left or not piece or not ends_content:
            stuffed += bytes([len(left) + 1]) + left
    return stuffed


def sealed(content: bytes) -> bytes:
    """Any content as a frame, whether or not its type and size are allowed."""
    return stuff(content + zlib.crc32(content).to_bytes(4, "little")) + b"\0"


# The specification's tables and examples


@pytest.mark.parametrize("kind", [FrameKind, Outcome])
def test_the_tables_of_codes(kind: type[FrameKind] | type[Outcome]) -> None:
    assert codes(kind.__name__) == {code.name: code.value for code in kind}


@pytest.mark.parametrize(("name", "layout"), [("SERIAL_REQUEST", SERIAL_REQUEST), ("SERIAL_REPLY", SERIAL_REPLY)])
def test_the_tables_of_layouts(name: str, layout: Construct) -> None:
    assert layout_rows(name) == fields(layout)


def test_the_table_of_sizes() -> None:
    rows = table("frames")
    assert len(rows) == 8
    for name, body, most in rows:
        assert re.match(r"`\w+`", name)
        assert frame_bytes(int(body)) == int(most)
    assert max(int(most) for *_, most in rows) == MAX_FRAME_BYTES


def test_the_table_of_rates() -> None:
    """Each speed follows from its line's own name, and the rest from the speed."""
    rows = table("rates")
    assert [row[0].split(",")[0] for row in rows] == ["UART", "UART", "UART", "CDC-ACM"]
    speeds = [baud // UART_BITS_PER_BYTE for baud in (115_200, 1_000_000, 12_000_000)] + [13 * 8000 * 512]
    for (_, bytes_per_second, block_ms, blocks), speed in zip(rows, speeds, strict=True):
        rate = speed / frame_bytes(512)
        assert int(bytes_per_second.replace(" ", "")) == speed
        assert float(block_ms.removesuffix(" ms")) == round(1000 / rate, 2)
        assert int(blocks.replace(" ", "")) == int(rate)
    assert BAUD == 115_200


def test_the_worked_examples() -> None:
    examples = hex_examples()
    assert encode(STATUS_FRAME) == examples["SERIAL_STATUS_REQUEST"]
    assert SerialReply.decode(decode(examples["SERIAL_STALL_REPLY"]).body) == SerialReply(0x2A, Outcome.STALL)


# One frame


@given(st.binary(max_size=700))
def test_the_words_for_cobs_describe_what_the_library_does(content: bytes) -> None:
    for data in (content, content.replace(b"\0", b"\1"), (b"\1" * 254 + content)[:254], b"\2" * 508 + content[:1]):
        assert stuff(data) == cobs.encode(data)


@given(FRAMES)
def test_a_frame_comes_back_and_is_what_the_layout_says(frame: Frame) -> None:
    data = encode(frame)
    assert data == sealed(bytes([frame.kind]) + frame.body)
    assert data.count(0) == 1
    assert len(data) <= frame_bytes(len(frame.body)) <= MAX_FRAME_BYTES
    assert decode(data) == frame
    parsed = FRAME.parse(data)
    assert parsed.kind == frame.kind
    assert FRAME.build(parsed) == data


@given(REQUESTS)
def test_a_request_has_the_layout_s_fields(request: SerialRequest) -> None:
    assert SerialRequest.decode(request.encode()) == request
    assert SERIAL_REQUEST.build(dataclasses.asdict(request)) == request.encode()


@given(REPLIES)
def test_a_reply_has_the_layout_s_fields(reply: SerialReply) -> None:
    assert SerialReply.decode(reply.encode()) == reply
    assert SERIAL_REPLY.build(dataclasses.asdict(reply)) == reply.encode()


@given(
    st.one_of(
        st.binary(max_size=60),
        st.tuples(st.integers(0, 6), st.binary(max_size=30)).map(
            lambda content: sealed(bytes([content[0]]) + content[1])
        ),
    )
)
def test_any_bytes_are_a_frame_to_both_or_to_none(data: bytes) -> None:
    try:
        frame = decode(data)
    except FrameError:
        # The layout reads one frame from a stream, which may go on behind the first zero.
        if data.find(b"\0") == len(data) - 1:
            with pytest.raises(ConstructError):
                FRAME.parse(data)
    else:
        assert encode(frame) == data
        assert FRAME.build(FRAME.parse(data)) == data


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "too short"),
        (b"\0", "unknown type of frame 0"),
        (b"\6", "unknown type of frame 6"),
        (b"\1" + bytes(511), "a block has 512 bytes, not 511"),
        (b"\2" + bytes(48), "a record has 32 or 64 bytes, not 48"),
        (b"\3" + bytes(8), "at least 9 bytes, not 8"),
        (b"\3\0\x41\2\0\0\0\0\2\0x", "must carry 2 bytes, not 1"),
        (b"\3\0\xc1\2\0\0\0\0\2\0xy", "must carry 0 bytes, not 2"),
        (b"\3\0\xc1\2\0\0\0\0\x81\2", "at most 640 bytes, not 641"),
        (b"\4\0", "at least 2 bytes, not 1"),
        (b"\4\0\2", "unknown outcome 2"),
        (b"\4\0\1x", "without data, not with 1"),
        (b"\4\0\0" + bytes(641), "at most 640 bytes, not 641"),
        (b"\5\0", "has 0 bytes, not 1"),
    ],
)
def test_what_no_type_allows_is_refused(content: bytes, message: str) -> None:
    data = sealed(content)
    with pytest.raises(FrameError, match=message):
        decode(data)
    with pytest.raises(ConstructError):
        FRAME.parse(data)


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
def test_what_is_no_frame_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        decode(data)
    with pytest.raises(ConstructError):
        FRAME.parse(data)


def test_two_frames_are_not_one() -> None:
    with pytest.raises(FrameError, match="not COBS"):
        decode(encode(STATUS_FRAME) * 2)


def test_a_content_has_one_encoding_only() -> None:
    """The form with 01 behind a full last group, which some encoders send, is refused."""
    for filling in range(1, 256):
        content = b"\4\1\0" + bytes([filling]) * 250
        data = sealed(content)
        if data[3] == 0xFF and len(data) == 3 + 255 + 1:
            break
    assert decode(data).body == content[1:]
    with pytest.raises(FrameError, match="shortest"):
        decode(data[:-1] + b"\1\0")
    with pytest.raises(ConstructError):
        FRAME.parse(data[:-1] + b"\1\0")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Frame(6, b""), "unknown type of frame 6"),  # type: ignore[arg-type]  # the wrong value is the point
        (lambda: SerialReply(0, 2), "unknown outcome 2"),  # type: ignore[arg-type]  # the wrong value is the point
        (lambda: SerialRequest(256, 0xC1, 2), "does not fit"),
        (lambda: SerialRequest(0, 0xC1, 2, value=-1), "does not fit"),
        (lambda: SerialRequest(0, 0x41, 2, length=1), "request 2 must carry 1 bytes, not 0"),
        (lambda: SerialReply(256, Outcome.DONE), "tag 256"),
        (lambda: Frame(FrameKind.BLOCK, b"PW"), "a block has 512 bytes, not 2"),
    ],
)
def test_wrong_arguments_are_named(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=message):
        make()


# Damage


@pytest.mark.parametrize("frame", [STATUS_FRAME, CONSOLE_FRAME, Frame(FrameKind.RECORD, bytes(range(32)))])
def test_every_flipped_bit_costs_that_frame_and_at_most_the_next(frame: Frame) -> None:
    """Also the flips that make zeros, unmake them, or change the lengths of COBS, for which no theorem stands."""
    second, third = Frame(FrameKind.RECORD, b"2" * 32), Frame(FrameKind.RECORD, b"3" * 32)
    sent = encode(frame)
    for bit in range(8 * len(sent)):
        damaged = bytearray(sent)
        damaged[bit // 8] ^= 1 << bit % 8
        found = FrameReader().feed(bytes(damaged) + encode(second) + encode(third))
        frames = [item for item in found if isinstance(item, Frame)]
        assert any(isinstance(item, FrameError) for item in found)
        ends_late = bit // 8 == len(sent) - 1
        assert frames == ([third] if ends_late else [second, third])


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


def told(events: Sequence[LineEvent]) -> list[str]:
    """Events as text, for errors are equal to themselves only."""
    return [str(event) for event in events]


@given(STREAMS, st.data())
def test_frames_do_not_depend_on_how_the_stream_is_cut(stream: bytes, data: st.DataObject) -> None:
    reader = FrameReader()
    found = [item for piece in data.draw(cuts(stream)) for item in reader.feed(piece)]
    assert told(found) == told(FrameReader().feed(stream))


@given(st.lists(FRAMES, max_size=5))
def test_what_is_sent_is_received(frames: list[Frame]) -> None:
    assert FrameReader().feed(b"\0" + b"\0".join(map(encode, frames))) == frames


@given(st.binary(min_size=1, max_size=50), FRAMES)
def test_noise_costs_at_most_what_it_touches(noise: bytes, frame: Frame) -> None:
    """With a zero before it a frame is safe from whatever came before (clause SER-005)."""
    assert FrameReader().feed(noise + b"\0" + encode(frame))[-1] == frame


def test_a_stream_without_zeros_takes_no_memory() -> None:
    reader = FrameReader()
    for _ in range(100):
        assert reader.feed(b"x" * 1000) == []
    held = max(len(value) for value in vars(reader).values())
    assert held <= MAX_FRAME_BYTES
    (dropped, frame) = reader.feed(b"\0" + encode(STATUS_FRAME))
    assert "at most 658 bytes" in str(dropped)
    assert frame == STATUS_FRAME


def test_the_longest_frame_is_not_too_long() -> None:
    """Some frame of the most bytes exists, and passes; one byte more does not."""
    request = b"\3\1\x41\xff\xff\xff\xff\xff\x80\2"
    contents = (request + bytes([1 + fill % 255]) * 639 + bytes([1 + fill // 255]) for fill in range(10_000))
    data = next(data for data in map(sealed, contents) if len(data) == MAX_FRAME_BYTES)
    assert isinstance(FrameReader().feed(data)[0], Frame)
    assert isinstance(FrameReader().feed(data[:1] + data)[0], FrameError)
    assert len(encode(Frame(FrameKind.BLOCK, b"\x55" * 512))) == frame_bytes(512)


# The line that text and frames share


def test_a_line_goes_to_frames_and_back() -> None:
    line = Line()
    assert line.feed(b"help\rsta") == [b"help\rsta"]
    assert line.feed(b"tus\0" + encode(STATUS_FRAME)[:5]) == [b"tus", Mode.FRAMES]
    assert line.feed(encode(STATUS_FRAME)[5:] + b"\0") == [STATUS_FRAME]
    assert line.feed(encode(CONSOLE_FRAME) + b"info\r") == [Mode.CONSOLE, b"info\r"]
    assert line.mode is Mode.CONSOLE


def test_hanging_up_returns_to_the_console() -> None:
    line = Line()
    line.feed(b"\0" + encode(STATUS_FRAME)[:5])
    dropped, mode = line.hang_up()
    assert isinstance(dropped, FrameError)
    assert mode is line.mode is Mode.CONSOLE
    assert line.hang_up() == [Mode.CONSOLE]
    assert line.feed(b"x\0" + encode(STATUS_FRAME)) == [b"x", Mode.FRAMES, STATUS_FRAME]


TEXT = st.binary(min_size=1, max_size=30).map(lambda text: text.replace(b"\0", b"\r"))
SESSIONS = st.lists(st.tuples(TEXT, st.lists(FRAMES.filter(CONSOLE_FRAME.__ne__), max_size=3)), max_size=4)


@given(SESSIONS, st.data())
def test_no_switch_loses_a_byte(sessions: list[tuple[bytes, list[Frame]]], data: st.DataObject) -> None:
    sent = b"".join(text + b"\0" + b"".join(map(encode, frames)) + encode(CONSOLE_FRAME) for text, frames in sessions)
    line = Line()
    received = [event for piece in data.draw(cuts(sent)) for event in line.feed(piece)]
    joined: list[LineEvent] = []
    for event in received:
        if isinstance(event, bytes) and joined and isinstance(joined[-1], bytes):
            joined[-1] += event
        else:
            joined.append(event)
    assert joined == [event for text, frames in sessions for event in (text, Mode.FRAMES, *frames, Mode.CONSOLE)]


@given(STREAMS, st.data())
def test_events_do_not_depend_on_how_the_stream_is_cut(stream: bytes, data: st.DataObject) -> None:
    def events(pieces: list[bytes]) -> tuple[bytes, list[str]]:
        line = Line()
        found = [event for piece in pieces for event in line.feed(piece)]
        text = b"".join(event for event in found if isinstance(event, bytes))
        return text, told([event for event in found if not isinstance(event, bytes)])

    assert events(data.draw(cuts(stream))) == events([stream])


@given(st.sampled_from(Mode), st.sampled_from(Mode), st.binary(max_size=20))
def test_a_host_that_knows_nothing_reaches_frames(device_mode: Mode, host_mode: Mode, unread: bytes) -> None:
    """Clause SER-010: 00, CONSOLE, 00 from any modes, with remains of anything still on the way to the host."""
    device, host = Line(), Line()
    device.feed(b"\0" if device_mode is Mode.FRAMES else b"")
    host.feed(b"\0" if host_mode is Mode.FRAMES else b"")
    answers = unread + (b"" if device_mode is Mode.CONSOLE else b"\0")
    for event in device.feed(b"\0" + encode(CONSOLE_FRAME) + b"\0"):
        answers += b"\0" if event is Mode.FRAMES else encode(CONSOLE_FRAME) + b"\r\n> "
    host.feed(answers)
    assert device.mode is host.mode is Mode.FRAMES
    assert host.feed(encode(STATUS_FRAME)) == [STATUS_FRAME]


def test_no_frame_is_longer_than_is_said() -> None:
    """Bytes without a zero are the worst for COBS."""
    longest = [len(cobs.encode(bytes([1]) * (1 + payload + 4)) + b"\0") for payload in range(600)]
    assert [frame_bytes(payload) for payload in range(600)] == longest
