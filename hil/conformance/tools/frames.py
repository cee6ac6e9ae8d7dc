"""Frames on a serial line, valid and not, from the words of clauses SER-002 and SER-003 alone.

The judge must not share a mistake with the implementation: nothing here uses `protocol.framing`.
"""

from __future__ import annotations

import zlib

from ....protocol.requests import Setup

GROUP_BYTES = 254
FULL = GROUP_BYTES + 1
CONSOLE = 5
REQUEST = 3


def stuffed(content: bytes) -> bytes:
    """COBS: a content without its zeros (clause SER-003)."""
    coded = bytearray()
    *pieces, last = content.split(b"\0")
    for piece in pieces:
        coded += _groups(piece)
        rest = piece[len(piece) // GROUP_BYTES * GROUP_BYTES :]
        coded += bytes([len(rest) + 1]) + rest
    coded += _groups(last)
    rest = last[len(last) // GROUP_BYTES * GROUP_BYTES :]
    if rest or not last:
        coded += bytes([len(rest) + 1]) + rest
    return bytes(coded)


def _groups(piece: bytes) -> bytes:
    """The groups of 254 bytes, without a zero, at the head of a piece."""
    heads = (piece[at : at + GROUP_BYTES] for at in range(0, len(piece) - GROUP_BYTES + 1, GROUP_BYTES))
    return b"".join(bytes([FULL]) + head for head in heads)


def unstuffed(coded: bytes) -> bytes:
    """Undo `stuffed`; fails if these bytes do not encode a content."""
    content, at, goes_on = bytearray(), 0, False
    while at < len(coded):
        length = coded[at]
        assert length, f"byte {at} of a frame is 00: {coded.hex(' ')}"
        group = coded[at + 1 : at + length]
        assert len(group) == length - 1, f"a frame ends within a group of {length - 1} bytes: {coded.hex(' ')}"
        content += group
        at += length
        goes_on = length < FULL
        content += b"\0" if goes_on else b""
    found = bytes(content[:-1] if goes_on else content)
    assert stuffed(found) == coded, f"a frame is not in the one form of SER-003: {coded.hex(' ')}"
    return found


def sealed(kind: int, body: bytes = b"") -> bytes:
    """Kind, body and checksum (clause SER-002)."""
    head = bytes([kind]) + body
    return head + zlib.crc32(head).to_bytes(4, "little")


def frame(kind: int, body: bytes = b"") -> bytes:
    """A frame as it stands on the line, of any kind and with any body."""
    return stuffed(sealed(kind, body)) + b"\0"


def request_frame(tag: int, setup: Setup, data: bytes = b"") -> bytes:
    """A frame with a request (clause SER-007)."""
    return frame(REQUEST, bytes([tag]) + setup.encode() + data)


def console_frame() -> bytes:
    """The frame after which text follows."""
    return frame(CONSOLE)
