"""Layout of what a device answers: acknowledgements, status, information, wiring (SPEC.md, chapters ACK and REQ)."""

from __future__ import annotations

import zlib

from construct import (
    Array,
    Checksum,
    Const,
    Int8ul,
    Int16ul,
    Int32ul,
    Int64ul,
    OneOf,
    RawCopy,
    Struct,
    Terminated,
    this,
)

from ..board import CHANNELS
from ..codes import ACK_MAGIC, PROTOCOL_VERSION, Reason

__all__ = ["ACK", "INFO", "STATUS", "WIRING"]

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
