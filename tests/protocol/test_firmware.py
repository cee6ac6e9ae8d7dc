from __future__ import annotations

import hashlib
import struct
import zlib
from dataclasses import replace
from typing import Any

import pytest
from construct import ConstructError
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from hypothesis import example, given
from hypothesis import strategies as st
from phasewire.errors import ImageError
from phasewire.protocol.codes import (
    FLASH_BANK_BYTES,
    FLASH_SECTOR_BYTES,
    IMAGE_MAX_BYTES,
    Bank,
    Hardware,
    ImageReason,
    Target,
)
from phasewire.protocol.firmware import (
    BootRecord,
    Image,
    ImageHeader,
    Segment,
    Signature,
    Suffix,
    Trust,
    boot_order,
    build,
    idle_bank,
    key_id,
    parse,
    sign,
    split_suffix,
    trust,
    with_suffix,
)
from phasewire.protocol.layout.firmware import BOOT_RECORD, DFU_SUFFIX, IMAGE, IMAGE_HEADER, SEGMENT_ENTRY
from phasewire.protocol.versions import Version

from tests.specification import clauses, codes, fields, hex_examples, layout_rows, table

# RFC 8032, section 7.1, test 1.
KEY = Ed25519PrivateKey.from_private_bytes(
    bytes.fromhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60")
)
PUBLIC = bytes.fromhex("d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a")
STRANGER = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))

PROGRAM = Segment(Target.ALL_PROCESSORS, bytes([1, 2, 3, 4, 5]))
CONTROLLER = Segment(Target.CONTROLLER, bytes([0xAA, 0xBB, 0xCC, 0xDD]))
IMAGE_123 = Image(Version(1, 2, 3), (PROGRAM, CONTROLLER))
TABLE_AT, ENTRY_BYTES = 32, 48


def seal(data: bytes | bytearray) -> bytes:
    """Put the right checksum into a header that was tampered with."""
    end = TABLE_AT + ENTRY_BYTES * data[5]
    checksum = zlib.crc32(bytes(data[:28] + data[TABLE_AT:end]))
    return bytes(data[:28]) + checksum.to_bytes(4, "little") + bytes(data[32:])


def changed(offset: int, *octets: int, base: Image = IMAGE_123) -> bytes:
    """An image with other bytes at an offset, and a header whose checksum is right."""
    data = bytearray(base.encode())
    data[offset : offset + len(octets)] = bytes(octets)
    return seal(data)


def reason(data: bytes) -> ImageReason:
    """Why an image is refused, by the code; the layout must refuse it as well."""
    with pytest.raises(ConstructError):
        IMAGE.parse(data)
    with pytest.raises(ImageError) as refusal:
        Image.decode(data)
    assert ImageReason(refusal.value.reason).clause in str(refusal.value)
    return ImageReason(refusal.value.reason)


DATA = st.binary(min_size=1, max_size=40)
SEGMENTS = st.one_of(
    st.tuples(*(st.builds(Segment, st.just(target), DATA) for target in (Target.ALL_PROCESSORS, Target.CONTROLLER))),
    st.tuples(
        *(st.builds(Segment, st.just(target), DATA) for target in [*(Target(n) for n in range(10)), Target.CONTROLLER])
    ),
)
VERSIONS = st.builds(Version, st.integers(0, 99), st.integers(0, 9), st.integers(0, 9))
UNSIGNED = st.builds(Image, VERSIONS, SEGMENTS, protocol=st.integers(1, 255))
IMAGES = st.one_of(UNSIGNED, UNSIGNED.map(lambda image: sign(image, KEY)))


# The specification


@pytest.mark.parametrize("enum", [Hardware, Target, Bank, ImageReason])
def test_the_tables_of_the_specification_are_these_codes(
    enum: type[Hardware] | type[Target] | type[Bank] | type[ImageReason],
) -> None:
    assert codes(enum.__name__) == {code.name: code.value for code in enum}


def test_every_reason_names_its_clause_as_the_specification_does() -> None:
    meaning = {row[1].strip("`"): row[2] for row in table("table: ImageReason")}
    for reason in list(ImageReason)[1:]:
        assert reason.clause in meaning[reason.name]
        assert reason.clause in clauses()
    assert len({reason.text for reason in ImageReason}) == len(ImageReason)


def test_the_layouts_of_the_specification_are_these() -> None:
    assert layout_rows("IMAGE_HEADER") == [*fields(IMAGE_HEADER), (28, 4, "checksum")]
    assert layout_rows("SEGMENT_ENTRY") == fields(SEGMENT_ENTRY)
    assert layout_rows("DFU_SUFFIX") == fields(DFU_SUFFIX)
    assert layout_rows("BOOT_RECORD") == fields(BOOT_RECORD)


def test_the_worked_file() -> None:
    """The example was made with zlib, hashlib and the openssl program, and read by dfu-suffix."""
    file = hex_examples()["IMAGE_FILE"]
    assert build(IMAGE_123, KEY) == file
    assert parse(file) == sign(IMAGE_123, KEY)
    assert trust(parse(file), [Ed25519PublicKey.from_public_bytes(PUBLIC)]) is Trust.SIGNED


def test_the_worked_record() -> None:
    data = hex_examples()["BOOT_RECORD"]
    image, _ = split_suffix(hex_examples()["IMAGE_FILE"])
    record = BootRecord(7, 204, hashlib.sha256(image).digest())
    assert record.encode() == data
    assert BootRecord.decode(data) == record


# The container


@given(IMAGES)
def test_images_survive_the_way(image: Image) -> None:
    data = image.encode()
    assert Image.decode(data) == image
    assert parse(build(image)) == image
    assert len(data) % 4 == 0
    assert ImageHeader.decode(data[: TABLE_AT + ENTRY_BYTES * 11]).total == len(data)


@given(IMAGES)
def test_the_layout_reads_what_the_code_writes(image: Image) -> None:
    fields = IMAGE.parse(image.encode())
    header = fields.header.value
    assert (header.major, header.minor, header.patch) == image.version
    assert header.protocol == image.protocol
    assert header.key_id == (bytes(8) if image.signature is None else image.signature.key_id)
    assert [(segment.entry.target, segment.data) for segment in fields.segments] == list(image.segments)


@given(IMAGES, st.data())
def test_layout_and_code_refuse_the_same(image: Image, data: st.DataObject) -> None:
    """Bytes are changed and the header's checksum is made right again, so that the later checks are reached."""
    octets = bytearray(image.encode())
    for _ in range(data.draw(st.integers(1, 2))):
        octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    length = data.draw(st.one_of(st.just(len(octets)), st.integers(0, len(octets) + 4)))
    tampered = bytes(octets.ljust(length, b"\0")[:length])
    if length >= TABLE_AT:
        tampered = seal(tampered)
    try:
        decoded = Image.decode(tampered)
    except ImageError:
        with pytest.raises(ConstructError):
            IMAGE.parse(tampered)
    else:
        IMAGE.parse(tampered)
        assert decoded.encode() == tampered


@given(st.binary(max_size=300), st.booleans())
@example(b"", False)
@example(bytes(31), False)
def test_any_bytes_are_read_or_refused(tail: bytes, begun: bool) -> None:
    data = IMAGE_123.encode()[: len(tail)] + tail if begun else tail
    for decode in (Image.decode, parse, ImageHeader.decode):
        try:
            decode(data)
        except ImageError:
            continue


def test_every_flipped_bit_of_a_file_is_refused() -> None:
    file = build(IMAGE_123, KEY)
    for bit in range(8 * len(file)):
        flipped = bytearray(file)
        flipped[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ImageError) as refusal:
            parse(bytes(flipped))
        assert refusal.value.reason == ImageReason.SUFFIX


@pytest.mark.parametrize("key", [KEY, None])
def test_every_flipped_bit_of_an_image_is_refused(key: Ed25519PrivateKey | None) -> None:
    """Over DFU there is no suffix: of a signed image, what the checksums do not see, the signature does."""
    data = (IMAGE_123 if key is None else sign(IMAGE_123, key)).encode()
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ImageError):
            trust(Image.decode(bytes(flipped)), [KEY.public_key()])


@pytest.mark.parametrize("length", [0, 1, 31, 32, 127])
def test_too_little_for_a_header(length: int) -> None:
    assert reason(IMAGE_123.encode()[:length]) is ImageReason.LENGTH


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (changed(0, 0x51), ImageReason.MAGIC),
        (changed(4, 2), ImageReason.VERSION),
        (IMAGE_123.encode()[:28] + bytes(4) + IMAGE_123.encode()[32:], ImageReason.CHECKSUM),
        (changed(24, 1), ImageReason.RESERVED),
        (changed(27, 1), ImageReason.RESERVED),
        (changed(33, 1), ImageReason.RESERVED),
        (changed(32 + 48 + 3, 1), ImageReason.RESERVED),
        (changed(8, 100), ImageReason.RESERVED),
        (changed(9, 10), ImageReason.RESERVED),
        (changed(10, 10), ImageReason.RESERVED),
        (changed(11, 0), ImageReason.RESERVED),
        (changed(6, 2), ImageReason.HARDWARE),
        (changed(6, 1, 1), ImageReason.HARDWARE),
        (changed(5, 1), ImageReason.TARGETS),
        (changed(5, 0), ImageReason.TARGETS),
        (changed(32, 11), ImageReason.TARGETS),
        (changed(32, 12), ImageReason.TARGETS),
        (changed(32, 0), ImageReason.TARGETS),
        (changed(80, 10), ImageReason.TARGETS),
        (changed(40, 0), ImageReason.SIZE),
        (changed(40, 1, 0, 1), ImageReason.SIZE),
        (changed(36, 124), ImageReason.OFFSET),
        (changed(36, 132), ImageReason.OFFSET),
        (changed(84, 132), ImageReason.OFFSET),
        (changed(84, 140), ImageReason.OFFSET),
        (changed(88, 5), ImageReason.OFFSET),
        (changed(12, 200), ImageReason.OFFSET),
        (IMAGE_123.encode()[:-1], ImageReason.TOTAL),
        (IMAGE_123.encode() + b"\0", ImageReason.TOTAL),
        (changed(133, 1), ImageReason.PADDING),
        (changed(135, 1), ImageReason.PADDING),
        (changed(128, 0), ImageReason.HASH),
        (changed(136, 0), ImageReason.HASH),
        (changed(44, 0), ImageReason.HASH),
        (changed(48, 0), ImageReason.HASH),
        (changed(140, 1), ImageReason.SIGNATURE),
        (changed(16, *bytes(8), base=sign(IMAGE_123, KEY)), ImageReason.SIGNATURE),
    ],
)
def test_reasons(data: bytes, expected: ImageReason) -> None:
    assert reason(data) is expected


def test_the_first_failure_is_the_one_reported() -> None:
    """Everything is made wrong at once, then right again in the order of the reasons."""
    good = IMAGE_123.encode()
    wrong = bytearray(sign(IMAGE_123, KEY).encode()) + b"\0"
    wrong[16:24] = bytes(8)
    faults = [
        (ImageReason.MAGIC, 0, b"?"),
        (ImageReason.VERSION, 4, b"\x09"),
        (ImageReason.RESERVED, 24, b"\1"),
        (ImageReason.HARDWARE, 6, b"\x09"),
        (ImageReason.TARGETS, 32, b"\x0b"),
        (ImageReason.SIZE, 42, b"\x09"),
        (ImageReason.OFFSET, 84, b"\x09"),
        (ImageReason.PADDING, 133, b"\1"),
        (ImageReason.HASH, 136, b"\0"),
    ]
    for _, offset, octets in faults:
        wrong[offset : offset + len(octets)] = octets
    assert reason(bytes(wrong[:100])) is ImageReason.LENGTH
    for expected, offset, octets in faults:
        if expected is ImageReason.RESERVED:
            assert reason(bytes(wrong)) is ImageReason.CHECKSUM
        if expected is ImageReason.PADDING:
            assert reason(seal(wrong)) is ImageReason.TOTAL
            wrong.pop()
        assert reason(seal(wrong) if expected > ImageReason.CHECKSUM else bytes(wrong)) is expected
        wrong[offset : offset + len(octets)] = good[offset : offset + len(octets)]
    assert reason(seal(wrong)) is ImageReason.SIGNATURE


def test_two_segments_for_one_processor_are_refused() -> None:
    singles = (*(Segment(Target(n), b"run") for n in range(10)), CONTROLLER)
    image = Image(Version(1, 0, 0), singles)
    assert reason(changed(TABLE_AT + ENTRY_BYTES, 0, base=image)) is ImageReason.TARGETS


def test_the_largest_image() -> None:
    """The limit was worked out by hand from 64 KiB for each of eleven processors."""
    full = bytes(range(256)) * 256
    image = Image(Version(0, 0, 1), (*(Segment(Target(n), full) for n in range(10)), Segment(Target.CONTROLLER, full)))
    data = image.encode()
    assert len(data) == IMAGE_MAX_BYTES == 721_520
    assert Image.decode(data) == image
    assert FLASH_SECTOR_BYTES + len(data) <= FLASH_BANK_BYTES


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"version": Version(100, 0, 0)}, "100.0.0"),
        ({"version": Version(1, 10, 0)}, "1.10.0"),
        ({"version": Version(1, 0, -1)}, "1.0.-1"),
        ({"hardware": 99}, "hardware 99"),
        ({"protocol": 0}, "protocol version 0"),
        ({"protocol": 256}, "protocol version 256"),
        ({"segments": (CONTROLLER, PROGRAM)}, "CONTROLLER"),
        ({"segments": (PROGRAM,)}, "ALL_PROCESSORS"),
        ({"segments": (Segment(Target.ALL_PROCESSORS, b""), CONTROLLER)}, "0 bytes"),
        ({"segments": (PROGRAM, Segment(Target.CONTROLLER, bytes(65_537)))}, "65537 bytes"),
        ({"signature": Signature(bytes(8), bytes(64))}, "not all zero"),
        ({"signature": Signature(b"shortkey", bytes(63))}, "63 bytes"),
        ({"signature": Signature(b"short", bytes(64))}, "8 bytes"),
    ],
)
def test_wrong_arguments(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(IMAGE_123, **wrong)


# Who signed


def test_the_key_of_the_rfc_signs_and_its_public_half_verifies() -> None:
    image = sign(IMAGE_123, KEY)
    assert image.signature is not None
    assert image.signature.key_id == hashlib.sha256(PUBLIC).digest()[:8] == key_id(KEY.public_key())
    data = image.encode()
    Ed25519PublicKey.from_public_bytes(PUBLIC).verify(data[-64:], data[:-64])


def test_four_outcomes() -> None:
    signed = sign(IMAGE_123, KEY)
    assert signed.signature is not None
    trusted = [STRANGER.public_key(), KEY.public_key()]
    assert trust(signed, trusted) is Trust.SIGNED
    assert trust(signed, trusted[:1]) is Trust.UNKNOWN_KEY
    assert trust(signed, []) is Trust.UNKNOWN_KEY
    assert trust(IMAGE_123, trusted) is Trust.UNSIGNED
    forged = replace(signed, signature=Signature(key_id(STRANGER.public_key()), signed.signature.value))
    with pytest.raises(ImageError, match="FWU-011") as refusal:
        trust(forged, trusted)
    assert refusal.value.reason == ImageReason.SIGNATURE


def test_a_signature_covers_the_version() -> None:
    signed = sign(IMAGE_123, KEY)
    with pytest.raises(ImageError):
        trust(replace(signed, version=Version(1, 2, 4)), [KEY.public_key()])


def test_signing_again_replaces_the_signature() -> None:
    assert sign(sign(IMAGE_123, STRANGER), KEY) == sign(IMAGE_123, KEY)


# Files


@given(st.binary(max_size=100), st.builds(Suffix, *[st.integers(0, 0xFFFF)] * 3))
def test_suffixes_as_appendix_b_describes_them(data: bytes, suffix: Suffix) -> None:
    file = with_suffix(data, suffix)
    release, product, vendor, dfu, mark, length, checksum = struct.unpack("<HHHH3sBI", file[-16:])
    assert (vendor, product, release) == suffix
    assert (dfu, mark, length) == (0x0100, b"UFD", 16)
    assert checksum == zlib.crc32(file[:-4]) ^ 0xFFFFFFFF
    assert split_suffix(file) == (data, suffix)


@given(st.binary(max_size=40))
def test_what_has_no_suffix_is_refused(data: bytes) -> None:
    with pytest.raises(ImageError) as refusal:
        split_suffix(data)
    assert refusal.value.reason == ImageReason.SUFFIX


def test_a_file_names_device_and_release() -> None:
    _, suffix = split_suffix(build(replace(IMAGE_123, version=Version(12, 3, 4))))
    assert suffix == (0x1209, 0x0001, 0x1234)


# Flash

RECORDS = st.builds(
    BootRecord,
    st.integers(0, 2**32 - 1),
    st.integers(1, 721_520),
    st.binary(min_size=32, max_size=32),
    st.sampled_from([0xFFFFFFFF, 0, 0xFFFF00FF]),
    st.sampled_from([0xFFFFFFFF, 0, 0xFFFF00FF]),
)
EMPTY = b"\xff" * 56


def test_what_does_not_fit_is_a_wrong_argument() -> None:
    with pytest.raises(ValueError, match="generation"):
        BootRecord(2**32, 204, bytes(32)).encode()
    with pytest.raises(ValueError, match="vendor"):
        with_suffix(b"", Suffix(-1, 0, 0))


FRESH = BootRecord(5, 204, bytes(32))


def test_the_flash_map() -> None:
    assert [bank.record_address for bank in Bank] == [0x100000, 0x200000, 0x300000]
    assert [bank.image_address for bank in Bank] == [0x101000, 0x201000, 0x301000]


@given(RECORDS)
def test_records_survive_the_way(record: BootRecord) -> None:
    assert len(record.encode()) == 56
    assert BootRecord.decode(record.encode()) == record


@given(RECORDS, st.integers(0, 48 * 8 - 1))
def test_every_flipped_bit_of_a_record_is_seen(record: BootRecord, bit: int) -> None:
    data = bytearray(record.encode())
    data[bit // 8] ^= 1 << bit % 8
    assert BootRecord.decode(bytes(data)) is None


@given(st.binary(max_size=60))
@example(EMPTY)
@example(bytes(56))
def test_what_is_no_record_is_an_empty_bank(data: bytes) -> None:
    assert BootRecord.decode(data) is None
    assert boot_order(data, data) == (Bank.FACTORY,)


def test_a_record_for_more_than_an_image_is_none() -> None:
    body = b"PWBR" + struct.pack("<II", 1, 721_521) + bytes(32)
    assert BootRecord.decode(body + struct.pack("<III", zlib.crc32(body), 0xFFFFFFFF, 0xFFFFFFFF)) is None


@pytest.mark.parametrize(
    ("a", "b", "first"),
    [
        (0, 1, Bank.B),
        (1, 0, Bank.A),
        (7, 7, Bank.A),
        (0xFFFFFFFF, 0, Bank.B),
        (0, 0xFFFFFFFF, Bank.A),
        (0xFFFFFFF0, 0x7FFFFFEF, Bank.B),
        (0, 0x7FFFFFFF, Bank.B),
        (0, 0x80000000, Bank.A),
        (0x80000000, 0, Bank.A),
        (0, 0x80000001, Bank.A),
    ],
)
def test_the_newer_generation_boots(a: int, b: int, first: Bank) -> None:
    order = boot_order(replace(FRESH, generation=a).encode(), replace(FRESH, generation=b).encode())
    assert order[0] is first
    assert sorted(order) == [Bank.FACTORY, Bank.A, Bank.B]
    assert order[-1] is Bank.FACTORY


@given(RECORDS, RECORDS)
def test_the_order_of_banks(a: BootRecord, b: BootRecord) -> None:
    order = boot_order(a.encode(), b.encode())
    assert order[-1] is Bank.FACTORY
    assert (Bank.A in order) == a.may_boot
    assert (Bank.B in order) == b.may_boot
    assert len(set(order)) == len(order)
    assert not (a.newer_than(b) and b.newer_than(a))


@given(RECORDS, st.integers(0, 2**31 - 2), st.integers(1, 2**31 - 1))
def test_an_upgrade_is_newer_than_the_other_bank(other: BootRecord, older: int, step: int) -> None:
    assert BootRecord.of(b"image", other).newer_than(other)
    assert replace(other, generation=(other.generation + step) % 2**32).newer_than(other)
    assert not replace(other, generation=(other.generation - older) % 2**32).newer_than(other)


def test_generations_begin_again_at_0() -> None:
    assert BootRecord.of(b"image", replace(FRESH, generation=0xFFFFFFFF)).generation == 0


def test_the_first_upgrade() -> None:
    record = BootRecord.of(b"image", None)
    assert record == BootRecord(0, 5, hashlib.sha256(b"image").digest())
    assert record.describes(b"image and what follows it in the bank")
    assert not record.describes(b"imagf")
    assert not record.describes(b"imag")


@pytest.mark.parametrize(
    ("started", "confirmed", "boots"),
    [
        (0xFFFFFFFF, 0xFFFFFFFF, True),
        (0, 0xFFFFFFFF, False),
        (0xFFFFFFFE, 0xFFFFFFFF, False),
        (0, 0, True),
        (0, 0xFFFFFF7F, True),
        (0xFFFFFFFF, 0, True),
    ],
)
def test_an_image_that_never_came_up_does_not_boot_again(started: int, confirmed: int, boots: bool) -> None:
    tried = replace(FRESH, generation=6, started=started, confirmed=confirmed)
    good = replace(FRESH, confirmed=0, started=0)
    assert boot_order(tried.encode(), good.encode()) == (
        (Bank.A, Bank.B, Bank.FACTORY) if boots else (Bank.B, Bank.FACTORY)
    )


def test_a_download_never_goes_to_the_bank_that_runs() -> None:
    assert [idle_bank(bank) for bank in (Bank.FACTORY, Bank.A, Bank.B)] == [Bank.A, Bank.B, Bank.A]


class Flash:
    """Two banks of NOR flash, as far as power lasts: programming clears bits byte by byte, erasing sets them."""

    SECTOR = 64

    def __init__(self, banks: dict[Bank, bytes], power: int, garbage: int) -> None:
        self.banks = {bank: bytearray(content) for bank, content in banks.items()}
        self.power = power
        self.garbage = garbage

    def _lasts(self) -> bool:
        self.power -= 1
        return self.power >= 0

    def erase(self, bank: Bank, at: int) -> None:
        for offset in range(at, at + self.SECTOR):
            if self.power < 0:
                return
            # While a sector is being erased, any of its bits may have changed already.
            self.banks[bank][offset] |= 0xFF if self._lasts() else self.garbage

    def program(self, bank: Bank, at: int, data: bytes) -> None:
        for offset, octet in enumerate(data, at):
            if self.power < 0:
                return
            self.banks[bank][offset] &= octet if self._lasts() else octet | self.garbage

    def upgrade(self, running: Bank, image: bytes) -> None:
        """Clause FWU-018."""
        bank = idle_bank(running)
        other = BootRecord.decode(bytes(self.banks[idle_bank(bank)][:56]))
        record = BootRecord.of(image, other).encode()
        for at in range(0, len(self.banks[bank]), self.SECTOR):
            self.erase(bank, at)
        self.program(bank, self.SECTOR, image)
        self.program(bank, 0, record[:48])

    def boots(self) -> tuple[Bank, bytes | None]:
        """Clause FWU-019, and what is then started."""
        for bank in boot_order(*(bytes(self.banks[bank][:56]) for bank in (Bank.A, Bank.B))):
            if bank is Bank.FACTORY:
                break
            record = BootRecord.decode(bytes(self.banks[bank][:56]))
            stored = bytes(self.banks[bank][self.SECTOR :])
            if record is not None and record.describes(stored):
                return bank, stored[: record.size]
        return Bank.FACTORY, None


@pytest.mark.parametrize("garbage", [0x00, 0x5A, 0xFF])
def test_power_may_fail_at_any_byte(garbage: int) -> None:
    """Three upgrades one after the other, each cut at every byte: what boots is the old image or the new one, whole."""
    blank = b"\xff" * (Flash.SECTOR * 5)
    banks = {Bank.A: blank, Bank.B: blank}
    running: Bank = Bank.FACTORY
    before: bytes | None = None
    for number in range(3):
        image = replace(IMAGE_123, version=Version(number, 0, 0)).encode()
        outcomes = []
        for power in range(10_000):
            flash = Flash(banks, power, garbage)
            flash.upgrade(running, image)
            outcomes.append(flash.boots())
            assert outcomes[-1] in [(running, before), (idle_bank(running), image)]
            if flash.power >= 0:
                break
        assert outcomes[0] == (running, before)
        assert outcomes[-1] == (idle_bank(running), image)
        banks = {bank: bytes(content) for bank, content in flash.banks.items()}
        running, before = outcomes[-1]
