"""Layout of what a device answers: records on bulk IN, the data of control requests (SPEC.md, chapters ACK and REQ)."""

from __future__ import annotations

import zlib
from enum import IntFlag

from construct import (
    Array,
    Bytes,
    Checksum,
    Const,
    Construct,
    ExprValidator,
    Int8sl,
    Int8ul,
    Int16ul,
    Int32ul,
    Int64ul,
    OneOf,
    RawCopy,
    Struct,
    Terminated,
    obj_,
    this,
)

from ..board import CHANNELS, PROCESSORS
from ..codes import ACK_MAGIC, PROTOCOL_VERSION, STATUS_MAGIC, AckFlag, Bank, Fault, Reason, State, StatusFlag
from .blocks import PULSES

__all__ = ["ACK", "CLOCK", "INFO", "PROCESSOR_REPORTS", "READ_BACK", "STATUS", "WIRING"]


def _only(integer: Construct, flags: type[IntFlag]) -> Construct:
    """Flags of which only the known ones may be set."""
    known = sum(flag.value for flag in flags)
    return ExprValidator(integer, obj_ & ~known == 0)


def _record(*fields: Construct) -> Construct:
    """A record on bulk IN: its fields, then the CRC-32 of all before it."""
    return Struct(
        "body" / RawCopy(Struct(*fields)),
        "checksum" / Checksum(Int32ul, zlib.crc32, this.body.data),
        Terminated,
    )


ACK = _record(
    "magic" / Const(ACK_MAGIC),
    "version" / Const(PROTOCOL_VERSION, Int8ul),
    "reason" / OneOf(Int8ul, list(Reason)),
    "sequence" / Int32ul,
    "commit_period" / Int64ul,
    "now" / Int64ul,
    "flags" / _only(Int8ul, AckFlag),
    "free" / Int8ul,
    "state" / OneOf(Int8ul, list(State)),
    "reserved" / Const(bytes(1)),
)
"""The answer to a block, 32 bytes."""

STATUS = _record(
    "magic" / Const(STATUS_MAGIC),
    "version" / Const(PROTOCOL_VERSION, Int8ul),
    "state" / OneOf(Int8ul, list(State)),
    "faults" / _only(Int16ul, Fault),
    "last_refusal" / OneOf(Int8ul, list(Reason)),
    "flags" / _only(Int8ul, StatusFlag),
    "now" / Int64ul,
    "since_period" / Int64ul,
    "accepted" / Int32ul,
    "refused" / Int32ul,
    "late" / Int32ul,
    "lost" / Int32ul,
    "missed_commits" / Int32ul,
    "damaged_messages" / Int32ul,
    "free" / Int8ul,
    "temperature_c" / Int8sl,
    "watchdog_ms" / Int16ul,
    "drive_limit" / Int16ul,
    "dropped_frames" / Int32ul,
    "reserved" / Const(bytes(2)),
)
"""What a device is doing, 64 bytes: the answer to STATUS, and sent unasked on bulk IN."""

INFO = Struct(
    "oldest_version" / Int8ul,
    "newest_version" / Int8ul,
    "hardware" / Int16ul,
    "firmware" / Array(3, Int8ul),
    "boards" / Int8ul,
    "unique_id" / Bytes(8),
    "carrier_hz" / Int32ul,
    "features" / Int16ul,
    "channels" / Int16ul,
    "columns" / Int8ul,
    "rows" / Int8ul,
    "pitch_um" / Int16ul,
    "processors_per_board" / Int8ul,
    "ticks_per_period" / Int8ul,
    "max_width_ticks" / Int8ul,
    "link_wires" / OneOf(Int8ul, [2, 5]),
    "cycles_per_symbol" / Int8ul,
    "queue_blocks" / Int8ul,
    "periods_per_update" / Int16ul,
    "queue_records" / Int16ul,
    "slots" / Int16ul,
    "sequence_entries" / Int16ul,
    "modulation_samples" / Int16ul,
    "drive_limit" / Int16ul,
    "watchdog_ms" / Int16ul,
    "later" / Bytes(16),
    Terminated,
)
"""Answer to INFO, 64 bytes; the last 16 are for later versions, and a host that does not know them ignores them."""

WIRING = Struct("channels" / Array(CHANNELS, Int16ul), Terminated)
"""Answer to WIRING: the output channel of each transducer in array order, 640 bytes."""

CLOCK = Struct(
    "now" / Int64ul,
    "sync_period" / Int64ul,
    "sync_pulses" / Int32ul,
    "reserved" / Const(bytes(4)),
    Terminated,
)
"""Answer to CLOCK, 24 bytes."""

READ_BACK = Struct("since_period" / Int64ul, "read_period" / Int64ul, "pulses" / PULSES, Terminated)
"""Answer to PULSES, 496 bytes."""

_PROCESSOR_REPORT = Struct(
    "faults" / _only(Int16ul, Fault),
    "temperature_c" / Int8sl,
    "bank" / OneOf(Int8ul, [0, *Bank]),
    "missed_commits" / Int32ul,
    "damaged_messages" / Int32ul,
    "firmware" / Array(3, Int8ul),
    "reserved" / Const(bytes(1)),
)

PROCESSOR_REPORTS = Struct("reports" / Array(PROCESSORS, _PROCESSOR_REPORT), Terminated)
"""Answer to PROCESSORS: 16 bytes for each processor in the order of the chain."""
