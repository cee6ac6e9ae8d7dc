"""The codes that travel: versions, magics, kinds, reasons and requests. One source for all of them."""

from __future__ import annotations

from enum import IntEnum

__all__ = [
    "ACK_MAGIC",
    "BLOCK_BYTES",
    "BLOCK_MAGIC",
    "CHECKSUM_OFFSET",
    "HEADER_BYTES",
    "HORIZON_PERIODS",
    "PROTOCOL_VERSION",
    "REQUEST_TYPE_IN",
    "REQUEST_TYPE_OUT",
    "Kind",
    "Reason",
    "Request",
]

PROTOCOL_VERSION = 1

BLOCK_MAGIC = b"PW"
BLOCK_BYTES = 512
HEADER_BYTES = 32
CHECKSUM_OFFSET = 28
HORIZON_PERIODS = 2**32

ACK_MAGIC = b"PA"


REQUEST_TYPE_IN = 0xC1
REQUEST_TYPE_OUT = 0x41


class Kind(IntEnum):
    """What a block asks for (SPEC.md, clause BLK-004)."""

    UPDATE_NOW = 1
    UPDATE_AT = 2


class Request(IntEnum):
    """Vendor control requests, addressed to the interface (SPEC.md, chapter REQ)."""

    INFO = 1
    STATUS = 2
    WIRING = 3
    ENABLE = 4
    DISABLE = 5


class Reason(IntEnum):
    """Outcome of a block (SPEC.md, clause ACK-003). The first failure in this order is the one reported."""

    ACCEPTED = 0
    LENGTH = 1
    MAGIC = 2
    VERSION = 3
    CHECKSUM = 4
    KIND = 5
    RESERVED = 6
    PHASE = 7
    WIDTH = 8
    DISABLED = 9
    HORIZON = 10

    @property
    def text(self) -> str:
        """What it means, for people."""
        return _TEXTS[self]


_TEXTS = {
    Reason.ACCEPTED: "accepted",
    Reason.LENGTH: "the block is not exactly 512 bytes long",
    Reason.MAGIC: "the block does not begin with the magic bytes",
    Reason.VERSION: "the block is of another protocol version",
    Reason.CHECKSUM: "the block's CRC-32 does not match its bytes",
    Reason.KIND: "the block is of an unknown kind",
    Reason.RESERVED: "a reserved field is not zero",
    Reason.PHASE: "a pulse's phase is above 99 half ticks",
    Reason.WIDTH: "a pulse's width is above 25 ticks",
    Reason.DISABLED: "the outputs are not enabled",
    Reason.HORIZON: "the period is more than 2**32 ahead",
}
