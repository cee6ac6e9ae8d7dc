"""Vectors of firmware images, boot records and DFU (SPEC.md, chapters FWU and DFU)."""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import replace
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from ...base.errors import ImageError
from ..codes import IMAGE_MAX_BYTES, DfuState, DfuStatus, ImageReason, Target
from ..dfu import TRANSITIONS, DfuReply, check_block, program_ms, reason_string, status_of
from ..enumeration import PRODUCT_ID, VENDOR_ID
from ..firmware import (
    BootRecord,
    Image,
    Segment,
    Suffix,
    boot_order,
    build,
    key_id,
    sign,
    trust,
    with_suffix,
)
from ..plain import plain
from ..versions import Version
from .cases import Section, section, vector

__all__ = [
    "boot_orders",
    "boot_records",
    "dfu_blocks",
    "dfu_replies",
    "dfu_transitions",
    "images",
    "refused_images",
    "signatures",
    "test_keys",
]

# The first test key of RFC 8032, section 7.1, and one of no meaning: everybody knows them.
SEEDS = {
    "rfc-8032": "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
    "counting": bytes(range(32)).hex(),
}
KEYS = {name: Ed25519PrivateKey.from_private_bytes(bytes.fromhex(seed)) for name, seed in SEEDS.items()}
KEY = KEYS["rfc-8032"]

TWO_SEGMENTS = (
    Segment(Target.ALL_PROCESSORS, bytes([1, 2, 3, 4, 5])),
    Segment(Target.CONTROLLER, bytes([0xAA, 0xBB, 0xCC, 0xDD])),
)
ELEVEN_SEGMENTS = (
    *(Segment(Target(n), bytes([n] * (n + 1))) for n in range(10)),
    Segment(Target.CONTROLLER, bytes(4)),
)
SIGNED = sign(Image(Version(1, 2, 3), TWO_SEGMENTS), KEY)
UNSIGNED = replace(SIGNED, signature=None)
IMAGES: dict[str, tuple[str, Image]] = {
    "specification": ("the example of FWU-015: padding, a signature", SIGNED),
    "unsigned": ("the same, not signed: no key, and 64 zeros", UNSIGNED),
    "eleven": ("a segment for each processor, of 1 to 10 bytes", Image(Version(0, 0, 1), ELEVEN_SEGMENTS)),
    "largest-version": (
        "the largest version, of a later protocol",
        sign(Image(Version(99, 9, 9), TWO_SEGMENTS, protocol=255), KEYS["counting"]),
    ),
}


def test_keys() -> Section:
    """The keys that sign here."""
    return section(
        "TEST KEYS, known to everybody: no device may trust them. Ed25519 seeds, public keys and key_ids (FWU-011).",
        (
            vector(
                f"test-key-{name}",
                "a test key",
                seed=SEEDS[name],
                public_key=key.public_key().public_bytes_raw(),
                key_id=key_id(key.public_key()),
            )
            for name, key in KEYS.items()
        ),
    )


def images() -> Section:
    """Files, each an image and the suffix."""
    return section(
        "Firmware files (FWU-014); hex is an image followed by the 16 bytes of the DFU suffix. Offsets, sizes and "
        "hashes follow from the segments.",
        (
            vector(
                f"image-{name}",
                shows,
                hex=build(image),
                version=list(image.version),
                hardware=image.hardware,
                protocol=image.protocol,
                segments=[{"target": segment.target, "data": segment.data} for segment in image.segments],
                key_id=image.signature.key_id if image.signature else bytes(8),
                signature=image.signature.value if image.signature else bytes(64),
                suffix={"release": image.version.bcd, "product": PRODUCT_ID, "vendor": VENDOR_ID},
                reason=ImageReason.ACCEPTED,
            )
            for name, (shows, image) in IMAGES.items()
        ),
    )


def _changed(offset: int, *octets: int, base: Image = UNSIGNED) -> bytes:
    """An image with other bytes at an offset and the checksum of header and table that belongs to them."""
    data = bytearray(base.encode())
    data[offset : offset + len(octets)] = bytes(octets)
    checksum = zlib.crc32(data[32 : 32 + 48 * data[5]], zlib.crc32(data[:28]))
    data[28:32] = checksum.to_bytes(4, "little")
    return bytes(data)


def _u32(value: int) -> bytes:
    return value.to_bytes(4, "little")


def refused_images() -> Section:
    """Images that every device refuses."""
    whole, eleven = UNSIGNED.encode(), IMAGES["eleven"][1]
    refusals: dict[str, tuple[str, ImageReason, str, bytes]] = {
        "empty": ("nothing at all", ImageReason.LENGTH, "FWU-001", b""),
        "header-cut": ("31 bytes of the header", ImageReason.LENGTH, "FWU-001", whole[:31]),
        "table-cut": ("a table without its last byte", ImageReason.LENGTH, "FWU-001", whole[: 32 + 96 - 1]),
        "length-before-magic": ("too short, and not an image", ImageReason.LENGTH, "FWU-001", bytes(31)),
        "magic": ("another magic", ImageReason.MAGIC, "FWU-002", _changed(0, *b"PWBR")),
        "version": ("container version 2", ImageReason.VERSION, "FWU-002", _changed(4, 2)),
        "checksum-header": (
            "a bit of the version is flipped",
            ImageReason.CHECKSUM,
            "FWU-003",
            bytes([*whole[:8], 0, *whole[9:]]),
        ),
        "checksum-table": (
            "a bit of the table is flipped",
            ImageReason.CHECKSUM,
            "FWU-003",
            bytes([*whole[:40], 6, *whole[41:]]),
        ),
        "reserved": ("a reserved byte of the header", ImageReason.RESERVED, "FWU-004", _changed(24, 1)),
        "reserved-entry": ("a reserved byte of the table", ImageReason.RESERVED, "FWU-004", _changed(32 + 1, 1)),
        "major-100": ("version 100.2.3", ImageReason.RESERVED, "FWU-004", _changed(8, 100)),
        "patch-10": ("version 1.2.10", ImageReason.RESERVED, "FWU-004", _changed(10, 10)),
        "protocol-0": ("no protocol", ImageReason.RESERVED, "FWU-004", _changed(11, 0)),
        "hardware": ("for hardware 2", ImageReason.HARDWARE, "FWU-005", _changed(6, 2)),
        "targets-order": ("the controller first", ImageReason.TARGETS, "FWU-007", _changed(32, Target.CONTROLLER)),
        "targets-twice": (
            "processor 0 twice, 1 not at all",
            ImageReason.TARGETS,
            "FWU-007",
            _changed(32 + 48, Target.PROCESSOR_0, base=eleven),
        ),
        "targets-unknown": ("target 12", ImageReason.TARGETS, "FWU-007", _changed(32, 12)),
        "targets-none": ("no segments", ImageReason.TARGETS, "FWU-007", _changed(5, 0)),
        "size-0": ("an empty segment", ImageReason.SIZE, "FWU-008", _changed(32 + 8, *_u32(0))),
        "size-65537": ("a segment that is too large", ImageReason.SIZE, "FWU-008", _changed(32 + 8, *_u32(65537))),
        "offset-gap": ("a gap before the first segment", ImageReason.OFFSET, "FWU-009", _changed(32 + 4, *_u32(132))),
        "offset-overlap": ("two segments overlap", ImageReason.OFFSET, "FWU-009", _changed(80 + 4, *_u32(132))),
        "total": ("a total that the segments do not make", ImageReason.OFFSET, "FWU-009", _changed(12, *_u32(208))),
        "cut": ("the last byte is missing", ImageReason.TOTAL, "FWU-009", whole[:-1]),
        "behind": ("a byte after the signature", ImageReason.TOTAL, "FWU-009", whole + bytes(1)),
        "padding": ("the padding is not 0", ImageReason.PADDING, "FWU-009", whole[:133] + b"\1" + whole[134:]),
        "hash-data": ("a bit of a segment is flipped", ImageReason.HASH, "FWU-010", whole[:128] + b"\0" + whole[129:]),
        "hash-checksum": ("the CRC-32 of a segment is wrong", ImageReason.HASH, "FWU-010", _changed(32 + 12, 0)),
        "hash-digest": ("the SHA-256 of a segment is wrong", ImageReason.HASH, "FWU-010", _changed(32 + 16, 0)),
        "no-key": ("a signature without a key", ImageReason.SIGNATURE, "FWU-011", whole[:-1] + b"\1"),
    }
    signed = SIGNED.encode()
    suffix = Suffix(VENDOR_ID, PRODUCT_ID, SIGNED.version.bcd)
    file = with_suffix(signed, suffix)
    suffixes = {
        "suffix-missing": ("an image without a suffix", signed),
        "suffix-checksum": ("zlib's CRC-32 instead of DFU's", file[:-4] + _u32(zlib.crc32(file[:-4]))),
        "suffix-signature": ("DFU forwards", file[:-8] + b"DFU" + file[-5:]),
        "suffix-damaged": ("a byte of the image is damaged", b"\0" + file[1:]),
    }
    return section(
        "Files that are refused, with the reason of FWU-015 and its number, and what GETSTATUS says of it (DFU-012). "
        "If the reason is not SUFFIX, the suffix is right.",
        (
            vector(
                f"refused-image-{name}",
                shows,
                hex=data,
                reason=reason,
                code=reason.value,
                clause=clause,
                dfu_status=status_of(reason),
                dfu_string=reason_string(reason),
            )
            for name, (shows, reason, clause, data) in (
                *((name, (shows, ImageReason.SUFFIX, "FWU-014", data)) for name, (shows, data) in suffixes.items()),
                *(
                    (name, (shows, reason, clause, with_suffix(data, suffix)))
                    for name, (shows, reason, clause, data) in refusals.items()
                ),
            )
        ),
    )


def signatures() -> Section:
    """The four cases of FWU-012."""
    other = sign(UNSIGNED, KEYS["counting"])
    forged = bytearray(SIGNED.encode())
    forged[-1] ^= 1
    trusted = [KEY.public_key()]
    cases = {
        "trusted": ("signed by a key that is trusted", SIGNED.encode()),
        "unknown": ("signed by a key that is not", other.encode()),
        "unsigned": ("not signed", UNSIGNED.encode()),
        "wrong": ("names the key that is trusted, which has not signed this", bytes(forged)),
    }

    def judged(data: bytes) -> str:
        try:
            return trust(Image.decode(data), trusted).name
        except ImageError as error:
            return ImageReason(error.reason).name

    return section(
        "Images (without suffix) for a device that trusts the key rfc-8032 and no other (FWU-012): only the first may "
        "be stored.",
        (
            vector(
                f"signature-{name}", shows, hex=data, trusts=[KEY.public_key().public_bytes_raw()], outcome=judged(data)
            )
            for name, (shows, data) in cases.items()
        ),
    )


RECORD = BootRecord(7, len(SIGNED.encode()), hashlib.sha256(SIGNED.encode()).digest())
ERASED = b"\xff" * BootRecord.BYTES


def _with_size(size: int) -> bytes:
    """The record of an image of any size, and the checksum that belongs to it."""
    body = RECORD.encode()[:8] + _u32(size) + RECORD.digest
    return body + _u32(zlib.crc32(body)) + ERASED[:8]


RECORDS: dict[str, tuple[str, bytes]] = {
    "specification": ("the example of FWU-017: never started", RECORD.encode()),
    "started": ("started, not confirmed: it may not boot again", replace(RECORD, started=0).encode()),
    "confirmed": ("came up", replace(RECORD, started=0, confirmed=0).encode()),
    "mark-cut": (
        "the write of a mark was cut short: it counts",
        replace(RECORD, started=0, confirmed=0xFFFF_FFFE).encode(),
    ),
    "newer": ("one newer", replace(RECORD, generation=8).encode()),
    "wrapped": ("generation 0, which is newer than 2^32 - 1", replace(RECORD, generation=0).encode()),
    "before-wrap": ("generation 2^32 - 1", replace(RECORD, generation=2**32 - 1).encode()),
    "erased": ("an erased bank", ERASED),
    "cut": ("written up to the middle of the checksum", RECORD.encode()[:46] + ERASED[46:]),
    "damaged": ("a bit of the digest is flipped", RECORD.encode()[:12] + b"\0" + RECORD.encode()[13:]),
    "magic": ("the magic of an image", b"PWFW" + RECORD.encode()[4:]),
    "size-0": ("of an image of no bytes", _with_size(0)),
    "size-largest": ("of the largest image that there can be", _with_size(IMAGE_MAX_BYTES)),
    "size-too-large": ("of one byte more", _with_size(IMAGE_MAX_BYTES + 1)),
}


def boot_records() -> Section:
    """What stands at the beginning of a bank."""

    def read(data: bytes) -> dict[str, Any]:
        record = BootRecord.decode(data)
        return {"fields": record, "may_boot": record is not None and record.may_boot}

    return section(
        "What stands at the beginning of a bank (FWU-017): fields are null if it is no record. may_boot is FWU-020.",
        (vector(f"record-{name}", shows, hex=data, **read(data)) for name, (shows, data) in RECORDS.items()),
    )


def boot_orders() -> Section:
    """Which bank boots."""
    cases = {
        "empty": ("both are empty", "erased", "erased"),
        "a-only": ("only A", "specification", "erased"),
        "b-only": ("only B; A was cut short", "cut", "confirmed"),
        "b-newer": ("B is newer", "confirmed", "newer"),
        "a-newer": ("A is newer", "newer", "confirmed"),
        "same": ("neither is newer", "specification", "confirmed"),
        "on-trial": ("the newer was started and never came up", "started", "wrapped"),
        "wrap": ("0 is newer than 2^32 - 1", "before-wrap", "wrapped"),
        "both-failed": ("neither may boot again", "started", "started"),
    }
    return section(
        "Names of the records in the banks A and B, and the banks that a loader tries, the first one first (FWU-019).",
        (
            vector(
                f"boot-{name}", shows, a=f"record-{a}", b=f"record-{b}", order=boot_order(RECORDS[a][1], RECORDS[b][1])
            )
            for name, (shows, a, b) in cases.items()
        ),
    )


def dfu_replies() -> Section:
    """Answers to GETSTATUS."""
    bad = ImageReason.HASH
    cases = {
        "app-idle": ("run-time mode", DfuReply(DfuStatus.OK, 0, DfuState.APP_IDLE)),
        "idle": ("DFU mode, nothing to do", DfuReply(DfuStatus.OK, 0, DfuState.DFU_IDLE)),
        "specification": ("the example of DFU-007", DfuReply(DfuStatus.OK, program_ms(0), DfuState.DNBUSY)),
        "manifest": ("the image is being checked", DfuReply(DfuStatus.OK, 2500, DfuState.MANIFEST)),
        "refused": ("an image was refused, and why", DfuReply(status_of(bad), 0, DfuState.ERROR, reason_string(bad))),
        "largest": ("the largest values", DfuReply(DfuStatus.STALLEDPKT, 2**24 - 1, DfuState.ERROR, 255)),
    }
    return section(
        "Answers to GETSTATUS (DFU-007).",
        (vector(f"dfu-{name}", shows, hex=reply.encode(), fields=reply) for name, (shows, reply) in cases.items()),
    )


def dfu_blocks() -> Section:
    """How the blocks of a download are judged."""
    total = 5000
    cases = {
        "first": ("block 0", 0, 2048, 0),
        "second": ("block 1", 1, 2048, 2048),
        "last": ("the last block has what is left", 2, 904, 4096),
        "end": ("no data, after the last block", 3, 0, total),
        "end-early": ("no data, before the last block", 1, 0, 2048),
        "again": ("the same number again", 0, 2048, 2048),
        "skipped": ("a number was left out", 2, 2048, 2048),
        "short": ("shorter than a block", 1, 2047, 2048),
        "long": ("beyond the end that the header names", 2, 905, 4096),
        "behind": ("behind the end", 3, 1, total),
    }
    return section(
        f"Blocks of a download of an image of {total} bytes, of which so many were received (DFU-009): the status, "
        "and for how many ms the device says that it is busy with a good one (DFU-008).",
        (
            vector(
                f"download-{name}",
                shows,
                block=number,
                length=length,
                received=received,
                total=total,
                status=(status := check_block(number, length, received, total)),
                poll_ms=program_ms(number) if length and status is DfuStatus.OK else None,
            )
            for name, (shows, number, length, received) in cases.items()
        ),
    )


def dfu_transitions() -> Section:
    """The states of DFU."""
    return section(
        "The state that follows, and whether the request is answered with STALL (DFU-006), for every state and event. "
        "REFUSED is any other request of the class.",
        (
            plain({"state": state, "event": event, "next": step.state, "stalls": step.stalls})
            for (state, event), step in TRANSITIONS.items()
        ),
    )
