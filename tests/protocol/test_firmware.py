from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from construct import ConstructError
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import strategies as st
from phasewire.base.errors import ImageError
from phasewire.protocol.codes import (
    Bank,
    ImageReason,
    Target,
)
from phasewire.protocol.firmware import (
    BootRecord,
    Image,
    Segment,
    Signature,
    Suffix,
    boot_order,
    idle_bank,
    sign,
    with_suffix,
)
from phasewire.protocol.layout.firmware import IMAGE
from phasewire.protocol.versions import Version

# RFC 8032, section 7.1, test 1.
KEY = Ed25519PrivateKey.from_private_bytes(
    bytes.fromhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60")
)
PUBLIC = bytes.fromhex("d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a")
STRANGER = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))

PROGRAM = Segment(Target.ALL_PROCESSORS, bytes([1, 2, 3, 4, 5]))
CONTROLLER = Segment(Target.CONTROLLER, bytes([0xAA, 0xBB, 0xCC, 0xDD]))
IMAGE_123 = Image(Version(1, 2, 3), (PROGRAM, CONTROLLER))


def reason(data: bytes) -> ImageReason:
    """The reason for which the code refuses an image; the layout must refuse it as well."""
    with pytest.raises(ConstructError):
        IMAGE.parse(data)
    with pytest.raises(ImageError) as refusal:
        Image.decode(data)
    assert ImageReason(refusal.value.reason).clause in str(refusal.value)
    return ImageReason(refusal.value.reason)


# The container


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


# Signatures


def test_signing_again_replaces_the_signature() -> None:
    assert sign(sign(IMAGE_123, STRANGER), KEY) == sign(IMAGE_123, KEY)


# Flash

RECORDS = st.builds(
    BootRecord,
    st.integers(0, 2**32 - 1),
    st.integers(1, 721_520),
    st.binary(min_size=32, max_size=32),
    st.sampled_from([0xFFFFFFFF, 0, 0xFFFF00FF]),
    st.sampled_from([0xFFFFFFFF, 0, 0xFFFF00FF]),
)


def test_a_value_that_does_not_fit_is_a_wrong_argument() -> None:
    with pytest.raises(ValueError, match="generation"):
        BootRecord(2**32, 204, bytes(32)).encode()
    with pytest.raises(ValueError, match="vendor"):
        with_suffix(b"", Suffix(-1, 0, 0))


FRESH = BootRecord(5, 204, bytes(32))


def test_the_flash_map() -> None:
    assert [bank.record_address for bank in Bank] == [0x100000, 0x200000, 0x300000]
    assert [bank.image_address for bank in Bank] == [0x101000, 0x201000, 0x301000]


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
