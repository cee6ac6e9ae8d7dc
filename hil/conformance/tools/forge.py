"""Blocks with one defect: header fields by their names in SPEC.md, with a matching checksum."""

from __future__ import annotations

import zlib

from ....protocol.codes import HEADER_BYTES

FIELDS = {
    "magic": (0, 2),
    "version": (2, 1),
    "kind": (3, 1),
    "sequence": (4, 4),
    "period": (8, 8),
    "first": (16, 2),
    "count": (18, 2),
    "hold": (20, 2),
    "repeats": (22, 2),
    "reserved": (24, 2),
    "flags": (26, 1),
    "action": (27, 1),
    "checksum": (28, 4),
}
"""Offset and bytes of each field (clause BLK-002)."""

CHECKSUM = slice(28, 32)


def seal(block: bytes) -> bytes:
    """A block with a matching checksum (clause BLK-003)."""
    blank = block[: CHECKSUM.start] + bytes(4) + block[CHECKSUM.stop :]
    checksum = zlib.crc32(blank).to_bytes(4, "little")
    return block[: CHECKSUM.start] + checksum + block[CHECKSUM.stop :]


def forged(block: bytes, payload: bytes | None = None, **fields: int) -> bytes:
    """A block with other values in its header, little-endian, or another payload of at most 480 bytes at its beginning.

    It is sealed, unless its checksum is among the fields, whose names are those of clause BLK-002.
    """
    data = bytearray(block)
    for name, value in fields.items():
        offset, size = FIELDS[name]
        data[offset : offset + size] = value.to_bytes(size, "little")
    if payload is not None:
        data[HEADER_BYTES : HEADER_BYTES + len(payload)] = payload
    return bytes(data) if "checksum" in fields else seal(bytes(data))
