"""Layout of the frames on a serial line (SPEC.md, chapter SER)."""

from __future__ import annotations

import zlib

from cobs import cobs
from construct import (
    Bytes,
    Check,
    ChecksumError,
    ExprValidator,
    GreedyBytes,
    Int8ul,
    Int16ul,
    NullTerminated,
    OneOf,
    StreamError,
    Struct,
    Switch,
    Terminated,
    Transformed,
    len_,
    obj_,
    this,
)

from ..codes import BLOCK_BYTES, RECORD_BYTES, SERIAL_DATA_BYTES, FrameKind, Outcome
from ..requests import DIRECTION_IN

__all__ = ["FRAME", "SERIAL_REPLY", "SERIAL_REQUEST"]

SERIAL_REQUEST = Struct(
    "tag" / Int8ul,
    "request_type" / Int8ul,
    "request" / Int8ul,
    "value" / Int16ul,
    "index" / Int16ul,
    "length" / Int16ul,
    Check(this.length <= SERIAL_DATA_BYTES),
    "data" / Bytes(lambda request: 0 if request.request_type & DIRECTION_IN else request.length),
    Terminated,
)
"""A control request in a frame: a tag, the eight bytes of a USB SETUP packet, and what the host sends with it."""

SERIAL_REPLY = Struct(
    "tag" / Int8ul,
    "outcome" / OneOf(Int8ul, list(Outcome)),
    "data" / ExprValidator(GreedyBytes, len_(obj_) <= SERIAL_DATA_BYTES),
    Check(lambda reply: reply.outcome == Outcome.DONE or not reply.data),
)
"""The answer to a control request in a frame."""

_CONTENT = Struct(
    "kind" / OneOf(Int8ul, list(FrameKind)),
    "body"
    / Switch(
        this.kind,
        {
            FrameKind.BLOCK: Bytes(BLOCK_BYTES),
            FrameKind.RECORD: ExprValidator(
                GreedyBytes, lambda record, _: len(record) in (RECORD_BYTES, 2 * RECORD_BYTES)
            ),
            FrameKind.REQUEST: SERIAL_REQUEST,
            FrameKind.REPLY: SERIAL_REPLY,
            FrameKind.CONSOLE: Bytes(0),
        },
    ),
    Terminated,
)


def _protect(content: bytes) -> bytes:
    return content + zlib.crc32(content).to_bytes(4, "little")


def _checked(protected: bytes) -> bytes:
    if _protect(protected[:-4]) != protected:
        raise ChecksumError("the last four bytes are not the CRC-32 of the bytes before")
    return protected[:-4]


def _unstuffed(stuffed: bytes) -> bytes:
    try:
        content = bytes(cobs.decode(stuffed))
    except cobs.DecodeError as error:
        raise StreamError(str(error)) from error
    if cobs.encode(content) != stuffed:
        raise StreamError("not the shortest encoding")
    return content


FRAME = NullTerminated(
    Transformed(Transformed(_CONTENT, _checked, None, _protect, None), _unstuffed, None, cobs.encode, None)
)
"""A frame as it stands on the line, with the zero that ends it."""
