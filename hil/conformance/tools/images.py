"""Firmware images for a device under test: its own, and its own with one defect (chapter FWU).

No firmware is invented here: an image that is flashed completely came from the device itself.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from ....protocol.board import PROCESSORS
from ....protocol.codes import ImageReason, Target
from ..cases import Inconclusive, NotApplicable
from .dfu import RawDfuLine

BLOCK = 2048
LEAST_BLOCKS = 5
HEADER, ENTRY, SIGNATURE = 32, 48, 64
LARGEST_SEGMENT = 65_536
Edit = Callable[[bytearray], None]


def large_image(line: RawDfuLine) -> bytes:
    """The device's own image, if it has at least the five blocks that show sectors and pages at work."""
    image = line.own_image()
    if len(image) < LEAST_BLOCKS * BLOCK:
        raise Inconclusive(f"the firmware has {len(image)} bytes; this needs five blocks of 2048")
    return image


def reseal(image: bytes | bytearray) -> bytes:
    """An image with a matching checksum of header and table (clause FWU-003)."""
    table = image[HEADER : HEADER + ENTRY * image[5]]
    return bytes(image[:28]) + zlib.crc32(table, zlib.crc32(image[:28])).to_bytes(4, "little") + bytes(image[HEADER:])


def as_version(image: bytes, version: tuple[int, int, int]) -> bytes:
    """The same firmware under another version, unsigned; not applicable if it is signed."""
    if image[16:24] != bytes(8):
        raise NotApplicable("the firmware is signed, so that only its maker can give it another version")
    return _renamed(image, version)


def _renamed(image: bytes, version: tuple[int, int, int]) -> bytes:
    return reseal(image[:8] + bytes(version) + image[11:])


def of_whole_blocks(image: bytes) -> bytes:
    """The same firmware, if it is unsigned, with zeros after its last segment, so that its last block is full."""
    if image[16:24] != bytes(8):
        raise NotApplicable("the firmware is signed, so that only its maker can make it longer")
    if len(image) % BLOCK == 0:
        return image
    grown = bytearray(image[:-SIGNATURE] + bytes(-len(image) % BLOCK) + image[-SIGNATURE:])
    entry = HEADER + ENTRY * (image[5] - 1)
    offset = int.from_bytes(image[entry + 4 : entry + 8], "little")
    segment = grown[offset:-SIGNATURE]
    if len(segment) > LARGEST_SEGMENT:
        raise Inconclusive(f"the firmware's last segment has no room for {-len(image) % BLOCK} bytes more")
    grown[12:16] = len(grown).to_bytes(4, "little")
    grown[entry + 8 : entry + 12] = len(segment).to_bytes(4, "little")
    grown[entry + 12 : entry + 16] = zlib.crc32(segment).to_bytes(4, "little")
    grown[entry + 16 : entry + 48] = hashlib.sha256(segment).digest()
    return reseal(grown)


def of_many_blocks(image: bytes, blocks: int) -> bytes:
    """The same firmware, if it is unsigned, in a segment for each processor, with zeros for at least so many blocks."""
    if image[16:24] != bytes(8):
        raise NotApplicable("the firmware is signed, so that only its maker can make it longer")
    found = [_segment(image, number) for number in range(image[5])]
    *programs, controller = (image[begin:end] for begin, end in found)
    each = -(-(blocks * BLOCK - LARGEST_SEGMENT) // (PROCESSORS - 1))
    sizes = [LARGEST_SEGMENT, *[min(each, LARGEST_SEGMENT)] * (PROCESSORS - 1)]
    of_all = programs * PROCESSORS if len(programs) == 1 else programs
    segments = [program.ljust(size, b"\0") for program, size in zip(of_all, sizes, strict=True)] + [controller]
    table, body, at = b"", b"", HEADER + ENTRY * len(segments)
    for target, segment in zip((*range(PROCESSORS), Target.CONTROLLER), segments, strict=True):
        body += bytes(-len(body) % 4)
        place = (target, at + len(body), len(segment), zlib.crc32(segment))
        table += struct.pack("<4I", *place) + hashlib.sha256(segment).digest()
        body += segment
    body += bytes(-len(body) % 4)
    header = bytearray(image[:HEADER])
    header[5] = len(segments)
    header[12:16] = (at + len(body) + SIGNATURE).to_bytes(4, "little")
    return reseal(bytes(header) + table + body + bytes(SIGNATURE))


def boot_record(image: bytes, generation: int) -> bytes:
    """The record of an image up to its checksum (clause FWU-017)."""
    record = b"PWBR" + struct.pack("<II", generation, len(image)) + hashlib.sha256(image).digest()
    return record + zlib.crc32(record).to_bytes(4, "little")


@dataclass(frozen=True)
class Forgery:
    """A defect of an image in a few words, and the reason of its refusal; if sealed, its checksum is right."""

    what: str
    reason: ImageReason
    edit: Edit
    sealed: bool = True

    def __str__(self) -> str:
        """Its words, as part of a case's name."""
        return self.what.replace(" ", "-")

    def of(self, image: bytes) -> bytes:
        """An image with this defect."""
        wrong = bytearray(image)
        self.edit(wrong)
        return reseal(wrong) if self.sealed else bytes(wrong)

    def with_later(self, later: Forgery) -> Self:
        """Both defects, of which the earlier reason counts."""

        def edit(image: bytearray) -> None:
            self.edit(image)
            later.edit(image)

        return type(self)(f"{self.what} and {later.what}", self.reason, edit, self.sealed and later.sealed)

    @classmethod
    def of_headers(cls) -> list[Self]:
        """Defects of header or table, each alone, and each with the next one of another reason."""
        alone = [
            cls("magic", ImageReason.MAGIC, _put(0, b"PWFX")),
            cls("version of the container", ImageReason.VERSION, _put(4, b"\x02")),
            cls("checksum", ImageReason.CHECKSUM, _flip(28), sealed=False),
            cls("reserved bytes of the header", ImageReason.RESERVED, _put(24, b"\x01")),
            cls("major version 100", ImageReason.RESERVED, _put(8, b"\x64")),
            cls("minor version 10", ImageReason.RESERVED, _put(9, b"\x0a")),
            cls("patch 10", ImageReason.RESERVED, _put(10, b"\x0a")),
            cls("protocol 0", ImageReason.RESERVED, _put(11, b"\x00")),
            cls("reserved bytes of the table", ImageReason.RESERVED, _put(HEADER + 3, b"\x80")),
            cls("hardware", ImageReason.HARDWARE, _put(6, b"\x63\x00")),
            cls("an unknown target", ImageReason.TARGETS, _put(HEADER, b"\x0c")),
            cls("a target twice", ImageReason.TARGETS, _repeat_target),
            cls("a segment of no bytes", ImageReason.SIZE, _put(HEADER + 8, bytes(4))),
            cls("a segment of 65537 bytes", ImageReason.SIZE, _put(HEADER + 8, (65_537).to_bytes(4, "little"))),
            cls("a segment of 2¹⁶ bytes more", ImageReason.SIZE, _add(HEADER + 8, 2**16)),
            cls("a segment of 2³¹ bytes more", ImageReason.SIZE, _add(HEADER + 8, 2**31)),
            cls("a gap before a segment", ImageReason.OFFSET, _add(HEADER + 4, 4)),
            cls("a segment 2¹⁶ bytes further on", ImageReason.OFFSET, _add(HEADER + 4, 2**16)),
            cls("a segment 2³¹ bytes further on", ImageReason.OFFSET, _add(HEADER + 4, 2**31)),
            cls("a total of four bytes more", ImageReason.OFFSET, _add(12, 4)),
            cls("a total of 2¹⁶ bytes more", ImageReason.OFFSET, _add(12, 2**16)),
            cls("a total of 2³¹ bytes more", ImageReason.OFFSET, _add(12, 2**31)),
        ]
        both = [earlier.with_later(later) for earlier, later in pairwise(alone) if earlier.reason is not later.reason]
        return alone + both

    @classmethod
    def of_contents(cls) -> list[Self]:
        """Defects after header and table."""
        return [
            cls("padding", ImageReason.PADDING, _spoil_padding),
            cls("a byte of a segment", ImageReason.HASH, _spoil_segment),
            cls("the CRC-32 of a segment", ImageReason.HASH, _flip(HEADER + 12)),
            cls("the SHA-256 of a segment", ImageReason.HASH, _flip(HEADER + 16)),
            cls("a signature without a key", ImageReason.SIGNATURE, _sign_without_key),
        ]


def _put(at: int, data: bytes) -> Edit:
    def edit(image: bytearray) -> None:
        image[at : at + len(data)] = data

    return edit


def _flip(at: int) -> Edit:
    def edit(image: bytearray) -> None:
        image[at] ^= 0x10

    return edit


def _add(at: int, much: int) -> Edit:
    def edit(image: bytearray) -> None:
        value = int.from_bytes(image[at : at + 4], "little") + much
        image[at : at + 4] = value.to_bytes(4, "little")

    return edit


def _repeat_target(image: bytearray) -> None:
    image[HEADER + ENTRY] = image[HEADER]


def _segment(image: bytes | bytearray, number: int = 0) -> tuple[int, int]:
    """Where a segment begins and ends, the first by default."""
    offset, size = (int.from_bytes(image[HEADER + ENTRY * number + at :][:4], "little") for at in (4, 8))
    return offset, offset + size


def _spoil_padding(image: bytearray) -> None:
    _, end = _segment(image)
    if end % 4 == 0:
        raise NotApplicable("the first segment of the firmware has no padding after it")
    image[end] = 1


def _spoil_segment(image: bytearray) -> None:
    begin, _ = _segment(image)
    image[begin] ^= 1


def _sign_without_key(image: bytearray) -> None:
    image[16:24] = bytes(8)
    image[-SIGNATURE] ^= 1
    if not any(image[-SIGNATURE:]):
        image[-1] = 1


def signed_by(image: bytes, key: Ed25519PrivateKey | None) -> bytes:
    """The same firmware, signed by another key, or by none (clause FWU-011)."""
    identifier = bytes(8) if key is None else hashlib.sha256(key.public_key().public_bytes_raw()).digest()[:8]
    body = reseal(image[:16] + identifier + image[24:-SIGNATURE])
    return body + (bytes(SIGNATURE) if key is None else key.sign(body))


def _damaged(image: bytes, at: int) -> bytes:
    """The image with a wrong bit in one byte."""
    wrong = bytearray(image)
    wrong[at] ^= 0x10
    return bytes(wrong)


UNTRUSTED: Mapping[str, Callable[[bytes, Ed25519PrivateKey], bytes]] = {
    "unsigned": lambda image, _: signed_by(image, None),
    "by-an-unknown-key": signed_by,
    "by-an-unknown-key-in-another-s-name": lambda image, key: image[:-SIGNATURE] + key.sign(image[:-SIGNATURE]),
    "with-a-damaged-signature": lambda image, _: _damaged(image, -SIGNATURE),
    "with-a-signature-of-zeros": lambda image, _: image[:-SIGNATURE] + bytes(SIGNATURE),
    "signed-before-it-was-changed": lambda image, _: _renamed(image, (0, 0, 1)),
    "signed-without-a-key": lambda image, _: reseal(image[:16] + bytes(8) + image[24:]),
}
"""Forgeries of a signed image by somebody with another key: none of them is trusted (FWU-012)."""
