"""Layout of firmware images, boot records, the DFU suffix and DFU's status reply (SPEC.md, chapters FWU and DFU)."""

from __future__ import annotations

import hashlib
import zlib
from typing import Any

from construct import (
    Array,
    Bytes,
    Check,
    Checksum,
    Computed,
    Const,
    ExprValidator,
    Int8ul,
    Int16ul,
    Int24ul,
    Int32ul,
    OneOf,
    Padding,
    Pointer,
    RawCopy,
    Struct,
    Terminated,
    obj_,
    this,
)

from ..board import PROCESSORS
from ..codes import (
    BOOT_RECORD_MAGIC,
    IMAGE_HEADER_BYTES,
    IMAGE_MAGIC,
    IMAGE_MAX_BYTES,
    IMAGE_VERSION,
    KEY_ID_BYTES,
    SEGMENT_MAX_BYTES,
    SIGNATURE_BYTES,
    DfuState,
    DfuStatus,
    Hardware,
    Target,
)

__all__ = ["BOOT_RECORD", "DFU_STATUS", "DFU_SUFFIX", "IMAGE", "IMAGE_HEADER", "SEGMENT_ENTRY"]

_TARGETS = (
    [Target.ALL_PROCESSORS, Target.CONTROLLER],
    [*list(Target)[:PROCESSORS], Target.CONTROLLER],
)


def _check_padding(segment: Any) -> bool:
    return not any(segment.padding)


def _check_hashes(segment: Any) -> bool:
    entry = segment.entry
    return bool(zlib.crc32(segment.data) == entry.checksum and hashlib.sha256(segment.data).digest() == entry.digest)


IMAGE_HEADER = Struct(
    "magic" / Const(IMAGE_MAGIC),
    "version" / Const(IMAGE_VERSION, Int8ul),
    "segments" / OneOf(Int8ul, [len(targets) for targets in _TARGETS]),
    "hardware" / OneOf(Int16ul, list(Hardware)),
    "major" / ExprValidator(Int8ul, obj_ <= 99),
    "minor" / ExprValidator(Int8ul, obj_ <= 9),
    "patch" / ExprValidator(Int8ul, obj_ <= 9),
    "protocol" / ExprValidator(Int8ul, obj_ != 0),
    "total" / Int32ul,
    "key_id" / Bytes(KEY_ID_BYTES),
    "reserved" / Const(bytes(4)),
)
"""The first 28 bytes of an image; the checksum of header and table follows."""

SEGMENT_ENTRY = Struct(
    "target" / OneOf(Int8ul, list(Target)),
    "reserved" / Const(bytes(3)),
    "offset" / Int32ul,
    "size" / ExprValidator(Int32ul, (obj_ > 0) & (obj_ <= SEGMENT_MAX_BYTES)),
    "checksum" / Int32ul,
    "digest" / Bytes(32),
)
"""One line of the segment table, 48 bytes."""

_SEGMENT = Struct(
    "entry" / Computed(lambda segment: segment._.table.value[segment._index]),
    Check(lambda segment: segment._io.tell() == segment.entry.offset),
    "data" / Bytes(this.entry.size),
    "padding" / Bytes(-this.entry.size % 4),
    Check(_check_padding),
    Check(_check_hashes),
)

IMAGE = Struct(
    "header" / RawCopy(IMAGE_HEADER),
    Padding(4),
    "table" / RawCopy(Array(this.header.value.segments, SEGMENT_ENTRY)),
    "checksum"
    / Pointer(
        IMAGE_HEADER_BYTES - 4, Checksum(Int32ul, zlib.crc32, lambda image: image.header.data + image.table.data)
    ),
    Check(lambda image: [entry.target for entry in image.table.value] in _TARGETS),
    "segments" / Array(this.header.value.segments, _SEGMENT),
    "signature" / Bytes(SIGNATURE_BYTES),
    Check(lambda image: any(image.header.value.key_id) or not any(image.signature)),
    Check(lambda image: image._io.tell() == image.header.value.total),
    Terminated,
)
"""A firmware image for all eleven processors, as it lies in flash and goes over DFU."""

DFU_SUFFIX = Struct(
    "release" / Int16ul,
    "product" / Int16ul,
    "vendor" / Int16ul,
    "dfu_version" / Const(0x0100, Int16ul),
    "signature" / Const(b"UFD"),
    "length" / Const(16, Int8ul),
    "checksum" / Int32ul,
    Terminated,
)
"""What follows the image in a file, 16 bytes (DFU 1.1, appendix B)."""

_RECORD_BODY = Struct(
    "magic" / Const(BOOT_RECORD_MAGIC),
    "generation" / Int32ul,
    "size" / ExprValidator(Int32ul, (obj_ > 0) & (obj_ <= IMAGE_MAX_BYTES)),
    "digest" / Bytes(32),
)

BOOT_RECORD = Struct(
    "body" / RawCopy(_RECORD_BODY),
    "checksum" / Checksum(Int32ul, zlib.crc32, this.body.data),
    "started" / Int32ul,
    "confirmed" / Int32ul,
    Terminated,
)
"""What says that a bank holds a whole image, 56 bytes."""

DFU_STATUS = Struct(
    "status" / OneOf(Int8ul, list(DfuStatus)),
    "poll_ms" / Int24ul,
    "state" / OneOf(Int8ul, list(DfuState)),
    "string" / Int8ul,
    Terminated,
)
"""Answer to the GETSTATUS request, 6 bytes (DFU 1.1, 6.1.2)."""
