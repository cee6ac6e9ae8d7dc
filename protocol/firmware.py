"""Firmware images: one file for all eleven processors, and which of the images in flash boots (SPEC.md, chapter FWU).

An `Image` is what a device stores and DFU carries; a file is that with the DFU suffix after it (`build`, `parse`).
`Image.decode` judges the bytes, `trust` who signed them; what is done with an image that nobody known has signed is for
the caller to decide. Nothing here reads or writes a flash: `boot_order` is told what the boot records hold.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from construct import ConstructError

from ..base.errors import ImageError
from .board import PROCESSORS
from .codes import (
    BOOT_RECORD_MAGIC,
    IMAGE_ENTRY_BYTES,
    IMAGE_HEADER_BYTES,
    IMAGE_MAGIC,
    IMAGE_VERSION,
    KEY_ID_BYTES,
    PROTOCOL_VERSION,
    SEGMENT_MAX_BYTES,
    SIGNATURE_BYTES,
    Bank,
    Hardware,
    ImageReason,
    Target,
)
from .enumeration import PRODUCT_ID, VENDOR_ID
from .layout import build as encode_layout
from .layout.firmware import BOOT_RECORD, DFU_SUFFIX
from .numbering import follows, successor
from .versions import Version

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

__all__ = [
    "BootRecord",
    "Image",
    "ImageHeader",
    "Segment",
    "Signature",
    "Suffix",
    "Trust",
    "boot_order",
    "build",
    "idle_bank",
    "key_id",
    "parse",
    "sign",
    "split_suffix",
    "trust",
    "with_suffix",
]

HEADER = struct.Struct("<4sBBH3BBI8s4sI")
ENTRY = struct.Struct("<B3sIII32s")
UNSIGNED = bytes(KEY_ID_BYTES)
TARGETS = (
    (Target.ALL_PROCESSORS, Target.CONTROLLER),
    (*(Target(n) for n in range(PROCESSORS)), Target.CONTROLLER),
)
ERASED = 0xFFFF_FFFF
SUFFIX_BYTES = 16


class Segment(NamedTuple):
    """The program of one processor, or of all ten."""

    target: Target
    data: bytes


class Signature(NamedTuple):
    """An Ed25519 signature, 64 bytes, and the number of the key that made it, 8 bytes (clause FWU-011)."""

    key_id: bytes
    value: bytes


class SegmentEntry(NamedTuple):
    """One line of the segment table."""

    target: int
    reserved: bytes
    offset: int
    size: int
    checksum: int
    digest: bytes


class ImageHeader(NamedTuple):
    """What the header and the segment table say, checked as far as they alone allow."""

    hardware: Hardware
    version: Version
    protocol: int
    total: int
    key_id: bytes
    entries: tuple[SegmentEntry, ...]

    @classmethod
    def decode(cls, data: bytes) -> ImageHeader:
        """Read header and table from the beginning of an image; the rest of it may be missing.

        A device does this with the first block of a download, before it erases anything.

        Raises
        ------
        ImageError
            With the first reason from `LENGTH` to `OFFSET` that applies, in the order of `ImageReason`.
        """
        if len(data) < IMAGE_HEADER_BYTES or len(data) < _first_offset(data[5]):
            _refuse(ImageReason.LENGTH, f"{len(data)} bytes")
        magic, container, count, hardware, *version, protocol, total, key, reserved, checksum = HEADER.unpack_from(data)
        if magic != IMAGE_MAGIC:
            _refuse(ImageReason.MAGIC, f"it begins with {magic.hex()}, not {IMAGE_MAGIC.hex()}")
        if container != IMAGE_VERSION:
            _refuse(ImageReason.VERSION, f"version {container}, not {IMAGE_VERSION}")
        computed = zlib.crc32(data[IMAGE_HEADER_BYTES : _first_offset(count)], zlib.crc32(data[: HEADER.size - 4]))
        if checksum != computed:
            _refuse(ImageReason.CHECKSUM, f"{checksum:08x} should be {computed:08x}")
        entries = tuple(
            SegmentEntry(*ENTRY.unpack_from(data, at))
            for at in range(IMAGE_HEADER_BYTES, _first_offset(count), IMAGE_ENTRY_BYTES)
        )
        if any(reserved) or any(any(entry.reserved) for entry in entries):
            _refuse(ImageReason.RESERVED, "reserved bytes are not zero")
        if not Version(*version).valid or protocol == 0:
            _refuse(ImageReason.RESERVED, f"firmware version {Version(*version)}, protocol version {protocol}")
        if hardware not in set(Hardware):
            _refuse(ImageReason.HARDWARE, f"hardware {hardware}; known are {[known.value for known in Hardware]}")
        if tuple(entry.target for entry in entries) not in TARGETS:
            _refuse(ImageReason.TARGETS, f"targets {[entry.target for entry in entries]}")
        for entry in entries:
            if not 0 < entry.size <= SEGMENT_MAX_BYTES:
                _refuse(ImageReason.SIZE, f"{entry.size} bytes for {Target(entry.target).name}")
        at = _first_offset(count)
        for entry in entries:
            if entry.offset != at:
                _refuse(ImageReason.OFFSET, f"{Target(entry.target).name} begins at {entry.offset}, not {at}")
            at += _padded(entry.size)
        if total != at + SIGNATURE_BYTES:
            _refuse(ImageReason.OFFSET, f"its total is {total} bytes; the segments make {at + SIGNATURE_BYTES}")
        return cls(Hardware(hardware), Version(*version), protocol, total, key, entries)


def _refuse(reason: ImageReason, found: str) -> NoReturn:
    raise ImageError(f"{reason.text} (clause {reason.clause}): {found}", reason)


def _padded(size: int) -> int:
    return -(-size // 4) * 4


def _first_offset(segments: int) -> int:
    return IMAGE_HEADER_BYTES + segments * IMAGE_ENTRY_BYTES


@dataclass(frozen=True)
class Image:
    """The firmware of the controller and of the ten processors (SPEC.md, chapter FWU).

    Parameters
    ----------
    version : Version
        The version, at most 99.9.9.
    segments : tuple of Segment
        One for all processors or ten for one each, in their order, and last the controller's; 1 to 65 536 bytes each.
    hardware : Hardware
        What the image is for.
    protocol : int
        Version of the protocol that the firmware speaks, 1 to 255.
    signature : Signature or None
        None if nobody has signed; see `sign`.

    Raises
    ------
    ValueError
        If one of these is otherwise.
    """

    version: Version
    segments: tuple[Segment, ...]
    hardware: Hardware = Hardware.FIVE_BOARDS
    protocol: int = PROTOCOL_VERSION
    signature: Signature | None = None

    def __post_init__(self) -> None:
        """Check what the layout cannot hold."""
        if not self.version.valid:
            raise ValueError(f"firmware version {self.version}: the first number is 0 to 99, the others 0 to 9")
        if not 0 < self.protocol <= 0xFF:
            raise ValueError(f"protocol version {self.protocol} is not between 1 and 255")
        if self.hardware not in set(Hardware):
            raise ValueError(f"hardware {self.hardware}; known are {[known.value for known in Hardware]}")
        targets = tuple(segment.target for segment in self.segments)
        if targets not in TARGETS:
            raise ValueError(
                f"segments for {[target.name for target in targets]}; an image has one for ALL_PROCESSORS or ten for "
                "PROCESSOR_0 to PROCESSOR_9, and then one for the CONTROLLER"
            )
        for segment in self.segments:
            if not 0 < len(segment.data) <= SEGMENT_MAX_BYTES:
                raise ValueError(
                    f"{segment.target.name} has {len(segment.data)} bytes; a segment has 1 to {SEGMENT_MAX_BYTES}"
                )
        if self.signature is not None:
            key, value = self.signature
            if len(key) != KEY_ID_BYTES or key == UNSIGNED or len(value) != SIGNATURE_BYTES:
                raise ValueError(
                    f"key {key.hex()} with a signature of {len(value)} bytes; a key has {KEY_ID_BYTES} bytes, not all "
                    f"zero, and a signature {SIGNATURE_BYTES}"
                )

    def program(self, processor: int) -> bytes:
        """The program of a processor in the chain, 0 to 9."""
        programs = {segment.target: segment.data for segment in self.segments}
        return programs.get(Target.ALL_PROCESSORS) or programs[Target(processor)]

    def signed_bytes(self) -> bytes:
        """What the signature covers: all of the image that stands before it."""
        table, body = b"", b""
        for target, data in self.segments:
            offset = _first_offset(len(self.segments)) + len(body)
            digest = hashlib.sha256(data).digest()
            table += ENTRY.pack(target, bytes(3), offset, len(data), zlib.crc32(data), digest)
            body += data.ljust(_padded(len(data)), b"\0")
        key = UNSIGNED if self.signature is None else self.signature.key_id
        total = IMAGE_HEADER_BYTES + len(table) + len(body) + SIGNATURE_BYTES
        fields = (IMAGE_MAGIC, IMAGE_VERSION, len(self.segments), self.hardware, *self.version, self.protocol)
        header = HEADER.pack(*fields, total, key, bytes(4), 0)[:-4]
        return header + zlib.crc32(table, zlib.crc32(header)).to_bytes(4, "little") + table + body

    def encode(self) -> bytes:
        """Encode as it lies in flash and goes over DFU."""
        return self.signed_bytes() + (bytes(SIGNATURE_BYTES) if self.signature is None else self.signature.value)

    @classmethod
    def decode(cls, data: bytes) -> Image:
        """Decode what `encode` gives.

        The signature is only looked at, since who may sign is not known here: `trust` judges it.

        Raises
        ------
        ImageError
            With the first reason that applies, in the order of `ImageReason`.
        """
        header = ImageHeader.decode(data)
        if len(data) != header.total:
            _refuse(ImageReason.TOTAL, f"{len(data)} bytes; it says {header.total}")
        for entry in header.entries:
            padding = data[entry.offset + entry.size : entry.offset + _padded(entry.size)]
            if any(padding):
                _refuse(ImageReason.PADDING, f"{padding.hex()} after {Target(entry.target).name}")
        segments = tuple(
            Segment(Target(entry.target), bytes(data[entry.offset : entry.offset + entry.size]))
            for entry in header.entries
        )
        for segment, entry in zip(segments, header.entries, strict=True):
            if (zlib.crc32(segment.data), hashlib.sha256(segment.data).digest()) != (entry.checksum, entry.digest):
                _refuse(ImageReason.HASH, f"{segment.target.name}, {entry.size} bytes")
        value = bytes(data[-SIGNATURE_BYTES:])
        if header.key_id == UNSIGNED and any(value):
            _refuse(ImageReason.SIGNATURE, "there is a signature, but no key")
        signature = None if header.key_id == UNSIGNED else Signature(header.key_id, value)
        return cls(header.version, segments, header.hardware, header.protocol, signature)


def key_id(key: Ed25519PublicKey) -> bytes:
    """The number of a key, 8 bytes: the beginning of its SHA-256 (clause FWU-011)."""
    return hashlib.sha256(key.public_bytes_raw()).digest()[:KEY_ID_BYTES]


def sign(image: Image, key: Ed25519PrivateKey) -> Image:
    """The same image, signed with this key; an earlier signature is replaced."""
    named = replace(image, signature=Signature(key_id(key.public_key()), bytes(SIGNATURE_BYTES)))
    return replace(named, signature=Signature(key_id(key.public_key()), key.sign(named.signed_bytes())))


class Trust(Enum):
    """Who stands behind an image."""

    SIGNED = "signed with a key that is trusted"
    UNKNOWN_KEY = "signed with a key that is not trusted; the signature was not checked"
    UNSIGNED = "not signed"


def trust(image: Image, keys: Iterable[Ed25519PublicKey]) -> Trust:
    """Whether one of these keys has signed an image (clauses FWU-011 and FWU-012).

    Raises
    ------
    ImageError
        If the image names one of the keys, but was not signed with it.
    """
    if image.signature is None:
        return Trust.UNSIGNED
    for key in keys:
        if key_id(key) == image.signature.key_id:
            from cryptography.exceptions import InvalidSignature  # an extra, which whoever has a key has installed

            try:
                key.verify(image.signature.value, image.signed_bytes())
            except InvalidSignature:
                _refuse(ImageReason.SIGNATURE, f"key {image.signature.key_id.hex()} did not sign this image")
            return Trust.SIGNED
    return Trust.UNKNOWN_KEY


class Suffix(NamedTuple):
    """What the DFU suffix says a file is for (clause FWU-014): vendor, product and release of the device, 16 bits each.

    FFFF stands for any.
    """

    vendor: int
    product: int
    release: int


def with_suffix(image: bytes, suffix: Suffix) -> bytes:
    """Put the DFU suffix after an encoded image; the outcome is a file for dfu-util."""
    fields = suffix._asdict() | {"dfu_version": None, "signature": None, "length": None}
    body = image + encode_layout(DFU_SUFFIX, fields | {"checksum": 0}, suffix)[:-4]
    return bytes(body + _suffix_checksum(body).to_bytes(4, "little"))


def _suffix_checksum(body: bytes) -> int:
    """DFU's CRC-32, which is zlib's without the inversion at the end."""
    return zlib.crc32(body) ^ 0xFFFF_FFFF


def split_suffix(file: bytes) -> tuple[bytes, Suffix]:
    """Undo `with_suffix`.

    Raises
    ------
    ImageError
        With `ImageReason.SUFFIX` if there is no suffix, or its checksum does not match.
    """
    try:
        suffix = DFU_SUFFIX.parse(file[-SUFFIX_BYTES:])
    except ConstructError as error:
        ending = file[-SUFFIX_BYTES:].hex() or "nothing"
        raise ImageError(
            f"{ImageReason.SUFFIX.text} (clause {ImageReason.SUFFIX.clause}): {ending}", ImageReason.SUFFIX
        ) from error
    computed = _suffix_checksum(file[:-4])
    if suffix.checksum != computed:
        _refuse(ImageReason.SUFFIX, f"CRC-32 {suffix.checksum:08x} should be {computed:08x}")
    return bytes(file[:-SUFFIX_BYTES]), Suffix(suffix.vendor, suffix.product, suffix.release)


def build(image: Image, key: Ed25519PrivateKey | None = None) -> bytes:
    """Make the file of an image: signed if there is a key, with the suffix that dfu-util looks for."""
    signed = image if key is None else sign(image, key)
    return with_suffix(signed.encode(), Suffix(VENDOR_ID, PRODUCT_ID, image.version.bcd))


def parse(file: bytes) -> Image:
    """Read the file of an image, whatever device its suffix names.

    Raises
    ------
    ImageError
        With the first reason that applies, in the order of `ImageReason`.
    """
    return Image.decode(split_suffix(file)[0])


@dataclass(frozen=True)
class BootRecord:
    """What says that a bank holds a whole image (clause FWU-017).

    Parameters
    ----------
    generation : int
        Number of the upgrade, 32 bits with wrap-around: the newer one boots.
    size : int
        Bytes of the image.
    digest : bytes
        SHA-256 of these bytes.
    started, confirmed : int
        Marks, 32 bits, untouched if all bits are 1: the image was started; it came up.
    """

    generation: int
    size: int
    digest: bytes
    started: int = ERASED
    confirmed: int = ERASED

    BYTES = 56

    @classmethod
    def of(cls, image: bytes, other: BootRecord | None) -> BootRecord:
        """The record of an encoded image, one newer than that of the other bank, if it has one."""
        generation = 0 if other is None else successor(other.generation)
        return cls(generation, len(image), hashlib.sha256(image).digest())

    def describes(self, stored: bytes) -> bool:
        """Whether a bank, read from where its image begins, holds the image of this record."""
        return hashlib.sha256(stored[: self.size]).digest() == self.digest

    @property
    def may_boot(self) -> bool:
        """Whether the image has come up before or was never tried (clause FWU-020)."""
        return self.confirmed != ERASED or self.started == ERASED

    def newer_than(self, other: BootRecord) -> bool:
        """Less than half of all generations ahead, round the wrap (clause FWU-019)."""
        return follows(self.generation, other.generation)

    def encode(self) -> bytes:
        """Encode as 56 bytes; raise `ValueError` if a field does not fit."""
        fields = asdict(self)
        nested = fields | {"body": {"value": fields | {"magic": BOOT_RECORD_MAGIC}}}
        return encode_layout(BOOT_RECORD, nested, self)

    @classmethod
    def decode(cls, data: bytes) -> BootRecord | None:
        """Decode 56 bytes; None if they are no record: erased, written in part, or something else."""
        try:
            record = BOOT_RECORD.parse(data)
        except ConstructError:
            return None
        body = record.body.value
        return cls(body.generation, body.size, body.digest, record.started, record.confirmed)


def boot_order(record_a: bytes, record_b: bytes) -> tuple[Bank, ...]:
    """The banks that a loader tries, best first, given what stands where their records should be (clause FWU-019).

    The factory image is always the last. Of two records of which none is newer, bank A is first.
    """
    records = {Bank.A: BootRecord.decode(record_a), Bank.B: BootRecord.decode(record_b)}
    found = [(bank, record) for bank, record in records.items() if record is not None and record.may_boot]
    if len(found) == 2 and found[1][1].newer_than(found[0][1]):
        found.reverse()
    return (*(bank for bank, _ in found), Bank.FACTORY)


def idle_bank(running: Bank) -> Bank:
    """The bank that a download writes, which is never the running one (clause FWU-018)."""
    return Bank.B if running is Bank.A else Bank.A
