"""Update blocks: 320 pulses as one 512-byte packet, packed and unpacked with NumPy (SPEC.md, chapter BLK).

The fast twin of `layout.BLOCK`: same bytes, and the same input refused.
"""

from __future__ import annotations

import operator
import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import BlockError
from .board import CHANNELS, HALF_TICKS_PER_PERIOD, MAX_WIDTH_TICKS
from .codes import BLOCK_BYTES, BLOCK_MAGIC, CHECKSUM_OFFSET, HEADER_BYTES, PROTOCOL_VERSION, Kind, Reason
from .pulses import Pulses

__all__ = ["Update", "pack", "pack_pulses", "unpack", "unpack_pulses"]

HEADER = struct.Struct("<2sBBIQ12sI")
NO_RESERVED = bytes(12)


@dataclass(frozen=True)
class Update:
    """One update of the whole array.

    Parameters
    ----------
    pulses : Pulses
        320 pulses in array order.
    sequence : int
        Number of the block, 32 bits; the acknowledgement repeats it.
    period : int or None
        Carrier period at which the pulses begin to play, 64 bits; None for as soon as possible.
    """

    pulses: Pulses
    sequence: int
    period: int | None = None

    def __post_init__(self) -> None:
        """Check the ranges."""
        if len(self.pulses) != CHANNELS:
            raise ValueError(f"an update carries {CHANNELS} pulses, not {len(self.pulses)}")
        object.__setattr__(self, "sequence", operator.index(self.sequence))
        if self.period is not None:
            object.__setattr__(self, "period", operator.index(self.period))
        if not 0 <= self.sequence < 2**32:
            raise ValueError(f"sequence number {self.sequence} does not fit 32 bits")
        if self.period is not None and not 0 <= self.period < 2**64:
            raise ValueError(f"period {self.period} does not fit 64 unsigned bits")


def pack_pulses(pulses: Pulses) -> bytes:
    """Pack an even number of pulses at 12 bits each: phase in the low 7 bits, width in the high 5."""
    words = pulses.phase.astype(np.uint16) | pulses.width.astype(np.uint16) << 7
    even, odd = words[0::2], words[1::2]
    packed = np.empty((even.size, 3), np.uint8)
    packed[:, 0] = even & 0xFF
    packed[:, 1] = even >> 8 | (odd & 0xF) << 4
    packed[:, 2] = odd >> 4
    return packed.tobytes()


def unpack_pulses(data: bytes) -> Pulses:
    """Undo `pack_pulses`.

    Raises
    ------
    BlockError
        Where a phase or a width is one of the reserved values.
    """
    first, middle, last = np.frombuffer(data, np.uint8).reshape(-1, 3).astype(np.uint16).T
    words = np.stack([first | (middle & 0xF) << 8, middle >> 4 | last << 4], axis=1).ravel()
    phase, width = words & 0x7F, words >> 7
    _refuse_above(phase, HALF_TICKS_PER_PERIOD - 1, "phase", Reason.PHASE)
    _refuse_above(width, MAX_WIDTH_TICKS, "width", Reason.WIDTH)
    return Pulses(phase, width)


def _refuse_above(values: NDArray[np.integer], limit: int, name: str, reason: Reason) -> None:
    above = np.flatnonzero(values > limit)
    if above.size:
        raise BlockError(f"transducer {above[0]}: {name} {values[above[0]]} is above {limit}", reason)


def pack(update: Update) -> bytes:
    """Pack an update into its 512-byte block."""
    kind, period = (Kind.UPDATE_NOW, 0) if update.period is None else (Kind.UPDATE_AT, update.period)
    fields = (BLOCK_MAGIC, PROTOCOL_VERSION, kind, update.sequence, period, NO_RESERVED)
    payload = pack_pulses(update.pulses)
    checksum = zlib.crc32(payload, zlib.crc32(HEADER.pack(*fields, 0)[:CHECKSUM_OFFSET]))
    return HEADER.pack(*fields, checksum) + payload


def unpack(block: bytes) -> Update:
    """Validate a block and read the update it carries.

    Raises
    ------
    BlockError
        With the first reason that applies, in the order of `Reason`.
    """
    if len(block) != BLOCK_BYTES:
        raise BlockError(f"a block has {BLOCK_BYTES} bytes, not {len(block)}", Reason.LENGTH)
    magic, version, kind, sequence, period, reserved, checksum = HEADER.unpack_from(block)
    if magic != BLOCK_MAGIC:
        raise BlockError(f"magic {magic.hex()} should be {BLOCK_MAGIC.hex()}", Reason.MAGIC)
    if version != PROTOCOL_VERSION:
        raise BlockError(f"protocol version {version}; this is version {PROTOCOL_VERSION}", Reason.VERSION)
    computed = zlib.crc32(block[HEADER_BYTES:], zlib.crc32(block[:CHECKSUM_OFFSET]))
    if checksum != computed:
        raise BlockError(f"CRC-32 {checksum:08x} should be {computed:08x}", Reason.CHECKSUM)
    if kind not in set(Kind):
        raise BlockError(f"unknown kind {kind}; known are {[k.value for k in Kind]}", Reason.KIND)
    if reserved != NO_RESERVED:
        raise BlockError(f"reserved bytes {reserved.hex()} should be zero", Reason.RESERVED)
    if kind == Kind.UPDATE_NOW and period != 0:
        raise BlockError(f"an update for now names period {period}; it should be zero", Reason.RESERVED)
    pulses = unpack_pulses(block[HEADER_BYTES:])
    return Update(pulses, sequence, period if kind == Kind.UPDATE_AT else None)
