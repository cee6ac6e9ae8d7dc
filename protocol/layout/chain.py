"""Layout of the messages between the controller and its processors, token for token (SPEC.md, chapter CHN).

Each is a route header, a payload and the control token END, which stands here as the byte of its code. The number of a
node travels with its high byte first, because the switches read it so; everything else is little-endian.
"""

from __future__ import annotations

import zlib

from construct import (
    Array,
    Bytes,
    Check,
    Checksum,
    Const,
    Construct,
    Int8sb,
    Int8ul,
    Int16ub,
    Int16ul,
    Int32ul,
    Int64ul,
    OneOf,
    RawCopy,
    Struct,
    Terminated,
    this,
)

from ..board import CHANNELS_PER_PROCESSOR, PROCESSORS
from ..codes import (
    CONTROLLER_NODE,
    END_TOKEN,
    MODULATION_SAMPLES,
    SEQUENCE_ENTRIES,
    SLOTS,
    UNNUMBERED_NODE,
    ChannelEnd,
    Memory,
)

__all__ = ["COLLECT", "COMMIT", "IDENTITY", "LOAD", "NUMBER", "PLAYING", "PROGRAM", "REPORT", "SLICE"]

_PACKED = Bytes(CHANNELS_PER_PROCESSOR * 12 // 8)
_PROCESSOR = OneOf(Int8ul, range(PROCESSORS))
_TO_PROCESSOR = OneOf(Int16ub, range(PROCESSORS))
_TO_CONTROLLER = Const(CONTROLLER_NODE, Int16ub)
_TO_UNNUMBERED = Const(UNNUMBERED_NODE, Int16ub)
_END = Const(END_TOKEN, Int8ul)

_ITEMS = {Memory.SLOTS: SLOTS, Memory.ENTRIES: SEQUENCE_ENTRIES, Memory.SAMPLES: MODULATION_SAMPLES}
_ITEM_BYTES = {Memory.SLOTS: 48, Memory.ENTRIES: 4, Memory.SAMPLES: 1}


def _guarded(node: Construct, end: ChannelEnd, *payload: Construct) -> Construct:
    """A message whose CRC-32 covers all tokens before it, the route header too."""
    return Struct(
        "checked" / RawCopy(Struct("node" / node, "channel_end" / Const(end, Int8ul), *payload)),
        "checksum" / Checksum(Int32ul, zlib.crc32, this.checked.data),
        "end" / _END,
        Terminated,
    )


SLICE = Struct(
    "node" / _TO_PROCESSOR,
    "channel_end" / Const(ChannelEnd.SLICE, Int8ul),
    "pulses" / _PACKED,
    "end" / _END,
    Terminated,
)
"""The pulses of one processor, 52 tokens; the checksum of its commit guards it."""

COMMIT = Struct(
    "node" / _TO_PROCESSOR,
    "channel_end" / Const(ChannelEnd.COMMIT, Int8ul),
    "period" / Int64ul,
    "checksum" / Int32ul,
    "end" / _END,
    Terminated,
)
"""Play a slice from a period on, 16 tokens; the checksum is that of the slice and the period."""

LOAD = _guarded(
    _TO_PROCESSOR,
    ChannelEnd.LOAD,
    "memory" / OneOf(Int8ul, list(Memory)),
    "first" / Int16ul,
    "count" / Int8ul,
    "data" / Bytes(48),
    Check(lambda load: load.count >= 1 and load.count * _ITEM_BYTES[load.memory] <= 48),
    Check(lambda load: load.first + load.count <= _ITEMS[load.memory]),
    Check(lambda load: not any(load.data[load.count * _ITEM_BYTES[load.memory] :])),
)
"""Store items of a memory, 60 tokens."""

PROGRAM = _guarded(
    _TO_PROCESSOR,
    ChannelEnd.PROGRAM,
    "memory" / OneOf(Int8ul, [Memory.ENTRIES, Memory.SAMPLES]),
    "first" / Int16ul,
    "count" / Int16ul,
    "hold" / Int16ul,
    "repeats" / Int16ul,
    "period" / Int64ul,
    Check(lambda program: program.first + program.count <= _ITEMS[program.memory]),
    Check(lambda program: program.first == 0 or program.count > 0),
    Check(lambda program: (program.hold > 0) == (program.count > 0 and program.memory == Memory.SAMPLES)),
    Check(lambda program: program.repeats == 0 or (program.count > 0 and program.memory == Memory.ENTRIES)),
)
"""Start or stop the sequence or the modulation at a period, 25 tokens."""

COLLECT = _guarded(_TO_PROCESSOR, ChannelEnd.COLLECT, "answer" / OneOf(Int8ul, [ChannelEnd.REPORT, ChannelEnd.PLAYING]))
"""Ask a processor how it is, or what it plays, 9 tokens."""

NUMBER = _guarded(_TO_UNNUMBERED, ChannelEnd.NUMBER, "number" / _PROCESSOR)
"""The number that the next processor without one takes, 9 tokens."""

REPORT = _guarded(
    _TO_CONTROLLER,
    ChannelEnd.REPORT,
    "processor" / _PROCESSOR,
    "temperature_c" / Int8sb,
    "faults" / Int16ul,
    "firmware" / Array(3, Int8ul),
    "drift" / Int8sb,
    "carried_out" / Int32ul,
    "missed_commits" / Int32ul,
    "damaged_messages" / Int32ul,
)
"""How a processor is, 28 tokens."""

PLAYING = _guarded(_TO_CONTROLLER, ChannelEnd.PLAYING, "processor" / _PROCESSOR, "period" / Int64ul, "pulses" / _PACKED)
"""What a processor plays and since when, 65 tokens."""

IDENTITY = _guarded(
    _TO_CONTROLLER,
    ChannelEnd.IDENTITY,
    "processor" / _PROCESSOR,
    "last" / OneOf(Int8ul, [0, 1]),
    "firmware" / Array(3, Int8ul),
    "unique_id" / Int64ul,
)
"""Who took a number, 21 tokens."""
