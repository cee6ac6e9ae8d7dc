"""Layout of the blocks on bulk OUT (SPEC.md, chapters BLK and PUL)."""

from __future__ import annotations

import zlib
from typing import Any

from construct import (
    Array,
    BitsInteger,
    BitStruct,
    Bytes,
    ByteSwapped,
    Const,
    Construct,
    Default,
    ExprValidator,
    Int8ul,
    Int16ul,
    Int32ul,
    Int64ul,
    OneOf,
    Pointer,
    Struct,
    Switch,
    Terminated,
    Transformed,
    ValidationError,
    obj_,
    this,
)

from ..board import CHANNELS, HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS
from ..codes import (
    BLOCK_BYTES,
    BLOCK_MAGIC,
    CHECKSUM_OFFSET,
    ENTRIES_PER_BLOCK,
    MODULATION_SAMPLES,
    PAYLOAD_BYTES,
    PROTOCOL_VERSION,
    SAMPLES_PER_BLOCK,
    SEQUENCE_ENTRIES,
    SLOTS,
    Action,
    Flag,
    Kind,
)

__all__ = ["BLOCK", "PULSES"]

_PHASE = ExprValidator(BitsInteger(7), obj_ < HALF_TICKS_PER_PERIOD)
_WIDTH = ExprValidator(BitsInteger(5), obj_ <= MAX_WIDTH_TICKS)

# Two pulses share three bytes. Read as one 24-bit little-endian number the even transducer is the low half; construct
# names bits from the most significant down, hence the order.
PULSES = Array(
    CHANNELS // 2,
    ByteSwapped(BitStruct("odd_width" / _WIDTH, "odd_phase" / _PHASE, "even_width" / _WIDTH, "even_phase" / _PHASE)),
)
"""320 pulses of 12 bits in array order, 480 bytes."""

_SLOT_NUMBER = ExprValidator(Int16ul, obj_ < SLOTS)
_ENTRY = Struct("slot" / _SLOT_NUMBER, "periods" / ExprValidator(Int16ul, obj_ >= 1))


def _zeros(size: Any) -> Construct:
    return Default(ExprValidator(Bytes(size), lambda obj, _: not any(obj)), lambda context: bytes(_size(size, context)))


def _size(size: Any, context: Any) -> int:
    return int(size(context) if callable(size) else size)


def _only(flags: Flag) -> Construct:
    """A byte in which only these flags may be set."""
    return Default(ExprValidator(Int8ul, lambda obj, _: obj | flags.value == flags.value), 0)


def _within(room: int) -> Construct:
    """A count of items that, from `first` on, lie within a store."""
    return ExprValidator(Int16ul, lambda count, block: 1 <= count <= room - block.first)


def _body(*payload: Any, **used: Construct) -> Struct:
    """Bytes 8 to 511 of a block. A field that is not named here is not used by the kind, and 0."""
    header = (
        ("period", Int64ul),
        ("first", Int16ul),
        ("count", Int16ul),
        ("hold", Int16ul),
        ("repeats", Int16ul),
        ("reserved", Int16ul),
        ("flags", Int8ul),
        ("action", Int8ul),
        ("checksum", Int32ul),
    )
    used.setdefault("flags", _only(Flag.RESTART))
    return Struct(*(name / used.get(name, Const(0, integer)) for name, integer in header), *payload)


_NOTHING = "rest" / _zeros(PAYLOAD_BYTES)

_BODIES = {
    Kind.UPDATE: _body("pulses" / PULSES, period=Int64ul),
    Kind.SLOT: _body("pulses" / PULSES, first=_SLOT_NUMBER),
    Kind.ENTRIES: _body(
        "entries" / Array(this.count, _ENTRY),
        "rest" / _zeros(PAYLOAD_BYTES - this.count * _ENTRY.sizeof()),
        first=Int16ul,
        count=ExprValidator(_within(SEQUENCE_ENTRIES), obj_ <= ENTRIES_PER_BLOCK),
    ),
    Kind.SEQUENCE: _body(
        _NOTHING,
        period=Int64ul,
        first=Int16ul,
        count=_within(SEQUENCE_ENTRIES),
        repeats=Int16ul,
        flags=_only(Flag.RESTART | Flag.UNATTENDED),
    ),
    Kind.SAMPLES: _body(
        "samples" / Bytes(this.count),
        "rest" / _zeros(PAYLOAD_BYTES - this.count),
        first=Int16ul,
        count=ExprValidator(_within(MODULATION_SAMPLES), obj_ <= SAMPLES_PER_BLOCK),
    ),
    Kind.MODULATION: _body(
        _NOTHING,
        period=Int64ul,
        first=Int16ul,
        count=_within(MODULATION_SAMPLES),
        hold=ExprValidator(Int16ul, obj_ >= 1),
    ),
    Kind.OUTPUT: _body(_NOTHING, period=Int64ul, action=OneOf(Int8ul, list(Action))),
    Kind.CLOCK: _body(_NOTHING),
    Kind.NO_OP: _body(_NOTHING),
}


def _checksum(data: bytes) -> bytes:
    cleared = data[:CHECKSUM_OFFSET] + bytes(4) + data[CHECKSUM_OFFSET + 4 :]
    return zlib.crc32(cleared).to_bytes(4, "little")


def _sealed(data: bytes) -> bytes:
    return data[:CHECKSUM_OFFSET] + _checksum(data) + data[CHECKSUM_OFFSET + 4 :]


def _unsealed(data: bytes) -> bytes:
    if _sealed(data) != data:
        raise ValidationError("wrong checksum", path="(parsing) -> checksum")
    return data[:CHECKSUM_OFFSET] + bytes(4) + data[CHECKSUM_OFFSET + 4 :]


_CLEARED = Struct(
    "magic" / Const(BLOCK_MAGIC),
    "version" / Const(PROTOCOL_VERSION, Int8ul),
    "kind" / OneOf(Int8ul, list(Kind)),
    "sequence" / Int32ul,
    "body" / Switch(this.kind, _BODIES),
)

BLOCK = Struct(
    Pointer(BLOCK_BYTES, Terminated),  # the length is judged before anything else
    "block" / Transformed(_CLEARED, _unsealed, BLOCK_BYTES, _sealed, BLOCK_BYTES),
)
"""A block, 512 bytes. Its checksum is that of the block with 0 in the checksum's place, as its parts see it here."""
