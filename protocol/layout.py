"""The normative layout of every byte that travels, as construct definitions (SPEC.md, chapters BLK, ACK, REQ).

Integers are little-endian. These definitions are the reference; `blocks` is the fast twin of `BLOCK`, and the tests
hold the two together.
"""

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
    Int16ul,
    Int32ul,
    Int64ul,
    OneOf,
    Padding,
    Pointer,
    RawCopy,
    Struct,
    Terminated,
    obj_,
    this,
)

from .board import CHANNELS, HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS
from .codes import ACK_MAGIC, BLOCK_MAGIC, CHECKSUM_OFFSET, PROTOCOL_VERSION, Kind, Reason

__all__ = ["ACK", "BLOCK", "INFO", "STATUS", "WIRING"]

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

_ACK_BODY = Struct(
    "magic" / Const(ACK_MAGIC),
    "version" / Const(PROTOCOL_VERSION, Int8ul),
    "reason" / OneOf(Int8ul, list(Reason)),
    "sequence" / Int32ul,
    "commit_period" / Int64ul,
    "now_period" / Int64ul,
    "late" / OneOf(Int8ul, [0, 1]),
    "free" / Int8ul,
    "reserved" / Const(bytes(2)),
)

ACK = Struct(
    "body" / RawCopy(_ACK_BODY),
    "checksum" / Checksum(Int32ul, zlib.crc32, this.body.data),
    Terminated,
)
"""The answer to a block on the bulk IN endpoint, 32 bytes."""

STATUS = Struct(
    "enabled" / OneOf(Int8ul, [0, 1]),
    "watchdog_fired" / OneOf(Int8ul, [0, 1]),
    "last_refusal" / OneOf(Int8ul, list(Reason)),
    "reserved" / Const(b"\0"),
    "period" / Int64ul,
    "accepted" / Int32ul,
    "refused" / Int32ul,
    "late" / Int32ul,
    "missed_commits" / Int32ul,
    Terminated,
)
"""Answer to the STATUS request, 28 bytes."""

INFO = Struct(
    "protocol_version" / Int8ul,
    "firmware" / Array(3, Int8ul),
    "channels" / Int16ul,
    "columns" / Int8ul,
    "rows" / Int8ul,
    "pitch_um" / Int16ul,
    "boards" / Int8ul,
    "processors_per_board" / Int8ul,
    "ticks_per_period" / Int8ul,
    "max_width_ticks" / Int8ul,
    "link_wires" / OneOf(Int8ul, [2, 5]),
    "queue_blocks" / Int8ul,
    "carrier_hz" / Int32ul,
    "max_updates_per_second" / Int32ul,
    "watchdog_ms" / Int16ul,
    "reserved" / Const(bytes(6)),
    Terminated,
)
"""Answer to the INFO request, 32 bytes."""

WIRING = Struct("channels" / Array(CHANNELS, Int16ul), Terminated)
"""Answer to the WIRING request: the output channel of each transducer in array order, 640 bytes."""
