"""Layout of the blocks on bulk OUT (SPEC.md, chapters BLK and PUL)."""

from __future__ import annotations

import zlib

from construct import (
    Array,
    BitsInteger,
    BitStruct,
    ByteSwapped,
    Check,
    Checksum,
    Const,
    ExprValidator,
    Int8ul,
    Int32ul,
    Int64ul,
    OneOf,
    Padding,
    Pointer,
    RawCopy,
    Struct,
    Terminated,
    obj_,
)

from ..board import CHANNELS, HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS
from ..codes import BLOCK_MAGIC, CHECKSUM_OFFSET, PROTOCOL_VERSION, Kind

__all__ = ["BLOCK"]

_PHASE = ExprValidator(BitsInteger(7), obj_ < HALF_TICKS_PER_PERIOD)
_WIDTH = ExprValidator(BitsInteger(5), obj_ <= MAX_WIDTH_TICKS)

# Two pulses share three bytes. Read as one 24-bit little-endian number the even transducer is the low half; construct
# names bits from the most significant down, hence the order.
_PULSE_PAIR = ByteSwapped(
    BitStruct("odd_width" / _WIDTH, "odd_phase" / _PHASE, "even_width" / _WIDTH, "even_phase" / _PHASE)
)

_HEADER = Struct(
    "magic" / Const(BLOCK_MAGIC),
    "version" / Const(PROTOCOL_VERSION, Int8ul),
    "kind" / OneOf(Int8ul, list(Kind)),
    "sequence" / Int32ul,
    "period" / Int64ul,
    "reserved" / Const(bytes(12)),
    Check(lambda header: header.kind != Kind.UPDATE_NOW or header.period == 0),
)

BLOCK = Struct(
    "header" / RawCopy(_HEADER),
    Padding(4),
    "pulses" / RawCopy(Array(CHANNELS // 2, _PULSE_PAIR)),
    "checksum"
    / Pointer(CHECKSUM_OFFSET, Checksum(Int32ul, zlib.crc32, lambda block: block.header.data + block.pulses.data)),
    Terminated,
)
"""An update block, 512 bytes."""
