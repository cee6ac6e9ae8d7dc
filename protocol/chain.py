"""Chain messages: what the controller tells the processors, and what that costs on the links (SPEC.md, chapter CHN).

A message is a route header (node, channel end), its payload and an END token. Loading and committing are apart: slices
fill the processors' mailboxes, then commits name the period at which all of them begin to play.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from .board import CHANNELS_PER_PROCESSOR, CYCLES_PER_PERIOD, PROCESSORS

__all__ = [
    "FIVE_WIRE",
    "SLICE_BYTES",
    "TWO_WIRE",
    "ChannelEnd",
    "Commit",
    "Link",
    "Message",
    "periods_per_update",
    "slices_cycles",
    "update_cycles",
]

SLICE_BYTES = CHANNELS_PER_PROCESSOR * 12 // 8
COMMIT = struct.Struct("<QI")
ROUTE_HEADER_TOKENS = 3
END_TOKENS = 1


class ChannelEnd(IntEnum):
    """Where on a processor a message arrives."""

    MAILBOX = 1
    COMMIT = 2


@dataclass(frozen=True)
class Link:
    """How fast a link carries tokens (one token is one byte); times in core cycles of 2.5 ns."""

    name: str
    wires: int
    symbols_per_token: int
    cycles_per_symbol: int = 2

    @property
    def cycles_per_token(self) -> int:
        """Core cycles that one token occupies the link."""
        return self.symbols_per_token * self.cycles_per_symbol


FIVE_WIRE = Link("5wire", wires=5, symbols_per_token=4)
TWO_WIRE = Link("2wire", wires=2, symbols_per_token=10)


def message_tokens(payload_bytes: int) -> int:
    """Tokens on the wire of a message: route header, payload and END."""
    return ROUTE_HEADER_TOKENS + payload_bytes + END_TOKENS


class Message(NamedTuple):
    """One routed message."""

    node: int
    channel_end: ChannelEnd
    payload: bytes

    @property
    def tokens(self) -> int:
        """Tokens on the wire."""
        return message_tokens(len(self.payload))


class Commit(NamedTuple):
    """Play the slice with this checksum from this period on."""

    period: int
    checksum: int

    @classmethod
    def of(cls, period: int, piece: bytes) -> Commit:
        """The commit that goes with a slice."""
        return cls(period, zlib.crc32(piece))

    def encode(self) -> bytes:
        """Encode as 12 bytes."""
        return COMMIT.pack(*self)

    @classmethod
    def decode(cls, payload: bytes) -> Commit:
        """Decode 12 bytes."""
        return cls(*COMMIT.unpack(payload))


def slices_cycles(link: Link) -> int:
    """Core cycles that the ten slices of an update occupy the first link."""
    return PROCESSORS * message_tokens(SLICE_BYTES) * link.cycles_per_token


def update_cycles(link: Link) -> int:
    """Core cycles that one update, ten slices and ten commits, occupies the first link."""
    return slices_cycles(link) + PROCESSORS * message_tokens(COMMIT.size) * link.cycles_per_token


def periods_per_update(link: Link) -> int:
    """Carrier periods between updates that a chain of this link can hold."""
    return -(-update_cycles(link) // CYCLES_PER_PERIOD)
