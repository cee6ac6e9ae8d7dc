"""Frames on a serial line: how blocks, records and requests travel where there is no USB (SPEC.md, chapter SER).

`encode` and `decode` turn one frame into bytes and back. `FrameReader` finds the frames in a stream that arrives in any
pieces, and `LineReader` tells them from the text of the console, which shares the line. Nothing here reads or writes:
bytes come in as arguments, what they mean goes out as values.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from cobs import cobs

from ..base.errors import FrameError
from .codes import BLOCK_BYTES, RECORD_BYTES, SERIAL_DATA_BYTES, FrameKind, Outcome
from .requests import Setup

__all__ = [
    "BAUD",
    "CONSOLE_FRAME",
    "DELIMITER",
    "MAX_FRAME_BYTES",
    "UART_BITS_PER_BYTE",
    "FrameReader",
    "LineEvent",
    "LineMode",
    "LineReader",
    "SerialFrame",
    "SerialReply",
    "SerialRequest",
    "decode",
    "encode",
    "frame_bytes",
]

DELIMITER = b"\0"
BAUD = 115_200

UART_BITS_PER_BYTE = 10
COBS_GROUP_BYTES = 254

TAG = struct.Struct("<B")
REQUEST_HEAD_BYTES = TAG.size + Setup.BYTES
REPLY_HEAD = struct.Struct("<BB")
CHECKSUM = struct.Struct("<I")
KIND_BYTES = 1


@dataclass(frozen=True)
class SerialRequest:
    """A control request in a frame (clause SER-007).

    Parameters
    ----------
    tag : int
        Chosen by the host, 8 bits; the reply repeats it.
    request_type, request, value, index, length : int
        The SETUP packet as on USB.
    data : bytes
        What the host sends with it: `length` bytes, or none if the request asks for data.

    Raises
    ------
    FrameError
        If a field does not fit its bytes, or the data is not as long as the other fields say.
    """

    tag: int
    request_type: int
    request: int
    value: int = 0
    index: int = 0
    length: int = 0
    data: bytes = b""

    def __post_init__(self) -> None:
        """Check the ranges."""
        try:
            self.encode()
        except struct.error as error:
            raise FrameError(f"a field of {self} does not fit its bytes: {error}") from error
        if self.length > SERIAL_DATA_BYTES:
            raise FrameError(f"a request on a serial line moves at most {SERIAL_DATA_BYTES} bytes, not {self.length}")
        expected = 0 if self.setup.is_in else self.length
        if len(self.data) != expected:
            raise FrameError(f"request {self.request} must carry {expected} bytes, not {len(self.data)}")

    @property
    def setup(self) -> Setup:
        """The setup stage of the same request on USB."""
        return Setup(self.request_type, self.request, self.value, self.index, self.length)

    def encode(self) -> bytes:
        """Encode as the body of a frame, 9 bytes and the data."""
        return TAG.pack(self.tag) + self.setup.encode() + self.data

    @classmethod
    def decode(cls, body: bytes) -> SerialRequest:
        """Decode the body of a frame; raise `FrameError` if it breaks the layout."""
        if len(body) < REQUEST_HEAD_BYTES:
            raise FrameError(f"a request has at least {REQUEST_HEAD_BYTES} bytes, not {len(body)}")
        setup = Setup.decode(body[TAG.size : REQUEST_HEAD_BYTES])
        return cls(body[0], **vars(setup), data=body[REQUEST_HEAD_BYTES:])


@dataclass(frozen=True)
class SerialReply:
    """The answer to a control request in a frame (clause SER-008).

    Parameters
    ----------
    tag : int
        The request's tag, 8 bits.
    outcome : Outcome
        Whether it was done.
    data : bytes
        What the request asked for; nothing after a stall.

    Raises
    ------
    FrameError
        If the tag does not fit, there is no such outcome, there is too much data, or a stall has some.
    """

    tag: int
    outcome: Outcome
    data: bytes = b""

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0 <= self.tag <= 0xFF:
            raise FrameError(f"tag {self.tag} does not fit 8 bits")
        if self.outcome not in set(Outcome):
            raise FrameError(f"unknown outcome {self.outcome}; known are {[known.value for known in Outcome]}")
        object.__setattr__(self, "outcome", Outcome(self.outcome))
        if len(self.data) > SERIAL_DATA_BYTES:
            raise FrameError(f"a reply carries at most {SERIAL_DATA_BYTES} bytes, not {len(self.data)}")
        if self.outcome == Outcome.STALL and self.data:
            raise FrameError(f"a stalled request is answered without data, not with {len(self.data)} bytes")

    def encode(self) -> bytes:
        """Encode as the body of a frame, 2 bytes and the data."""
        return REPLY_HEAD.pack(self.tag, self.outcome) + self.data

    @classmethod
    def decode(cls, body: bytes) -> SerialReply:
        """Decode the body of a frame; raise `FrameError` if it breaks the layout."""
        if len(body) < REPLY_HEAD.size:
            raise FrameError(f"a reply has at least {REPLY_HEAD.size} bytes, not {len(body)}")
        tag, outcome = REPLY_HEAD.unpack_from(body)
        return cls(tag, outcome, body[REPLY_HEAD.size :])


def _has_one_of(what: str, *sizes: int) -> Callable[[bytes], None]:
    def check(body: bytes) -> None:
        if len(body) not in sizes:
            raise FrameError(f"{what} has {' or '.join(map(str, sizes))} bytes, not {len(body)}")

    return check


_CHECKS: Mapping[FrameKind, Callable[[bytes], object]] = MappingProxyType(
    {
        FrameKind.BLOCK: _has_one_of("a block", BLOCK_BYTES),
        FrameKind.RECORD: _has_one_of("a record", RECORD_BYTES, 2 * RECORD_BYTES),
        FrameKind.REQUEST: SerialRequest.decode,
        FrameKind.REPLY: SerialReply.decode,
        FrameKind.CONSOLE: _has_one_of("the body of a CONSOLE frame", 0),
    }
)


def _known(kind: int) -> FrameKind:
    if kind not in set(FrameKind):
        raise FrameError(f"unknown type of frame {kind}; known are {[known.value for known in FrameKind]}")
    return FrameKind(kind)


@dataclass(frozen=True)
class SerialFrame:
    """One frame: its type and a body that obeys the layout of that type (clause SER-004).

    Whether a block or a record is valid in itself is not judged here.

    Raises
    ------
    FrameError
        If there is no such type, or the body breaks its layout.
    """

    kind: FrameKind
    body: bytes = b""

    def __post_init__(self) -> None:
        """Check the body."""
        _CHECKS[_known(self.kind)](self.body)


CONSOLE_FRAME = SerialFrame(FrameKind.CONSOLE)


def frame_bytes(body_bytes: int) -> int:
    """Most bytes that a frame with a body of this size takes on the line, its ending zero included.

    COBS adds one byte for each 254 that have begun.
    """
    content = KIND_BYTES + body_bytes + CHECKSUM.size
    return content + -(-content // COBS_GROUP_BYTES) + len(DELIMITER)


MAX_FRAME_BYTES = frame_bytes(REQUEST_HEAD_BYTES + SERIAL_DATA_BYTES)


def encode(frame: SerialFrame) -> bytes:
    """Encode a frame as it stands on the line, with the zero that ends it."""
    content = bytes([frame.kind]) + frame.body
    return bytes(cobs.encode(content + CHECKSUM.pack(zlib.crc32(content)))) + DELIMITER


def decode(data: bytes) -> SerialFrame:
    """Decode one frame with the zero that ends it.

    Raises
    ------
    FrameError
        If the bytes are not what `encode` makes of some frame.
    """
    if data[-1:] != DELIMITER:
        raise FrameError(f"a frame of {len(data)} bytes does not end with 00")
    if len(data) > MAX_FRAME_BYTES:
        raise FrameError(f"a frame has at most {MAX_FRAME_BYTES} bytes")
    try:
        content = bytes(cobs.decode(data[:-1]))
    except cobs.DecodeError as error:
        raise FrameError(f"a frame of {len(data)} bytes is not COBS: {error}") from error
    if len(content) < KIND_BYTES + CHECKSUM.size:
        raise FrameError(f"a frame of {len(data)} bytes is too short for a type and a checksum")
    (checksum,) = CHECKSUM.unpack_from(content, len(content) - CHECKSUM.size)
    content = content[: -CHECKSUM.size]
    computed = zlib.crc32(content)
    if checksum != computed:
        raise FrameError(f"a frame of {len(data)} bytes has CRC-32 {checksum:08x}; it should be {computed:08x}")
    frame = SerialFrame(_known(content[0]), content[KIND_BYTES:])
    # COBS has two forms if the last group is a full one; two streams of bytes must not mean the same.
    if encode(frame) != data:
        raise FrameError(f"a frame of {len(data)} bytes is not in its shortest COBS form")
    return frame


class FrameReader:
    """Finds the frames in a stream of bytes, however it is cut into pieces.

    It holds less than one frame: of one that grows too long it keeps only that it did.
    """

    def __init__(self) -> None:
        self._begun = bytearray()

    def feed(self, data: bytes) -> list[SerialFrame | FrameError]:
        """Take the next bytes; return the frames that they complete and why others were dropped, in order.

        Zeros in a row have nothing between them that could be dropped.
        """
        *ends, rest = data.split(DELIMITER)
        found = []
        for end in ends:
            self._collect(end)
            if self._begun:
                found.append(self._finish())
        self._collect(rest)
        return found

    def cut(self) -> list[FrameError]:
        """Drop the frame that has begun, if one has, and say so: the line was hung up."""
        dropped = [FrameError("the line was hung up within a frame")] if self._begun else []
        self._begun.clear()
        return dropped

    def _collect(self, data: bytes) -> None:
        # A full buffer has no room for the ending zero, so `decode` finds the frame too long whatever followed.
        self._begun += data[: MAX_FRAME_BYTES - len(self._begun)]

    def _finish(self) -> SerialFrame | FrameError:
        data = bytes(self._begun) + DELIMITER
        self._begun.clear()
        try:
            return decode(data)
        except FrameError as error:
            return error


class LineMode(Enum):
    """What the bytes on a line are."""

    CONSOLE = "console"
    FRAMES = "frames"


LineEvent = bytes | SerialFrame | FrameError | LineMode


class LineReader:
    """One direction of a line that console and frames share (clause SER-010).

    Both ends use it for what they receive. Every line starts with the console.
    """

    def __init__(self) -> None:
        self._reader = FrameReader()
        self.mode = LineMode.CONSOLE

    def feed(self, data: bytes) -> list[LineEvent]:
        """Take the next bytes; return in order text, frames, why others were dropped, and the modes that began.

        A CONSOLE frame shows as the mode that it begins.
        """
        events: list[LineEvent] = []
        *ended, rest = data.split(DELIMITER)
        for piece in [*(end + DELIMITER for end in ended), rest]:
            if self.mode is LineMode.FRAMES:
                events += self._frames(piece)
                continue
            text = piece.removesuffix(DELIMITER)
            events += [text] if text else []
            events += self._begin(LineMode.FRAMES) if piece != text else []
        return events

    def hang_up(self) -> list[LineEvent]:
        """Return to the console after a break, or when DTR went low; a frame that had begun is dropped."""
        return [*self._reader.cut(), *self._begin(LineMode.CONSOLE)]

    def _frames(self, piece: bytes) -> list[LineEvent]:
        """What the reader finds; a piece ends with its first zero, so nothing follows a CONSOLE frame in it."""
        found = self._reader.feed(piece)
        return [*self._begin(LineMode.CONSOLE)] if found == [CONSOLE_FRAME] else [*found]

    def _begin(self, mode: LineMode) -> list[LineMode]:
        self.mode = mode
        return [mode]
