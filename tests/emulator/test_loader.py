from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from phasewire.base.errors import InputFileError
from phasewire.emulator.firmware.flash import FLASH_BYTES, Flash
from phasewire.emulator.firmware.loader import (
    FACTORY_IMAGE,
    Boot,
    DeviceIdentity,
    boot,
    confirm,
    give_up_upgrades,
    load_cycles,
    make_flash,
)
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.codes import Bank, Fault, Target
from phasewire.protocol.firmware import BootRecord, Image, Segment
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE
from phasewire.protocol.versions import Version
from phasewire.protocol.wiring import Wiring

MS = 400_000
IDENTITY = DeviceIdentity("FL-1", Wiring.strips())
ERASED, WRITTEN = 0xFFFF_FFFF, 0
NEVER, CAME_UP = (ERASED, ERASED), (WRITTEN, WRITTEN)
ADDRESSES = {Bank.FACTORY: 0x100000, Bank.A: 0x200000, Bank.B: 0x300000}


def image(patch: int) -> Image:
    return Image(
        Version(2, 0, patch),
        (Segment(Target.ALL_PROCESSORS, bytes([patch]) * 5000), Segment(Target.CONTROLLER, bytes([patch]) * 99)),
    )


IMAGES = {Bank.FACTORY: FACTORY_IMAGE, Bank.A: image(1), Bank.B: image(2)}


def stored(**banks: tuple[int, tuple[int, int]]) -> Flash:
    """A powered flash with images in some banks, each with its generation and its marks."""
    content = bytearray(make_flash(IDENTITY).read(0, FLASH_BYTES))
    for name, (generation, (started, confirmed)) in banks.items():
        at, data = ADDRESSES[Bank[name]], IMAGES[Bank[name]].encode()
        record = BootRecord(generation, len(data), hashlib.sha256(data).digest(), started, confirmed)
        content[at : at + 56] = record.encode()
        content[at + 4096 : at + 4096 + len(data)] = data
    flash = Flash(bytes(content))
    flash.power_up(Scheduler())
    return flash


def marks(flash: Flash, bank: Bank) -> bytes:
    return flash.read(ADDRESSES[bank] + 48, 8)


# What the factory leaves


def test_a_new_flash_boots_the_factory_s_image() -> None:
    """Addresses by clause FWU-016: the record at the beginning of the bank, the image one sector later."""
    flash = make_flash(IDENTITY)
    assert flash.read(0x100000, 4) == b"PWBR"
    assert flash.read(0x101000, 4) == b"PWFW"
    assert marks(flash, Bank.FACTORY) == bytes(8)
    assert set(flash.read(0x200000, 0x200000)) == {0xFF}
    flash.power_up(Scheduler())
    assert boot(flash) == Boot(Bank.FACTORY, FACTORY_IMAGE, Fault(0))
    assert not flash.busy  # there was nothing to write


def test_a_flash_holds_its_device_s_identity(scrambled: Wiring) -> None:
    keys = tuple(Ed25519PrivateKey.from_private_bytes(bytes([n]) * 32).public_key() for n in range(3))
    identity = DeviceIdentity.read(make_flash(DeviceIdentity("A.b-c_9", scrambled, keys)))
    assert identity.serial == "A.b-c_9"
    assert identity.wiring.channels.tolist() == scrambled.channels.tolist()
    assert [key.public_bytes_raw() for key in identity.keys] == [key.public_bytes_raw() for key in keys]
    assert DeviceIdentity.read(make_flash(IDENTITY)).keys == ()


@pytest.mark.parametrize(
    "text", [b"", b"[]", b"{}", b"\0", b'{"serial": "1", "wiring": [1, 2], "keys": []}', b'{"serial": "x"']
)
def test_a_flash_without_an_identity_is_refused(text: bytes) -> None:
    flash = Flash(text + b"\xff" * (FLASH_BYTES - len(text)))
    with pytest.raises(InputFileError, match="does not say which device it belongs to"):
        DeviceIdentity.read(flash)


def test_bytes_that_are_no_key_are_refused() -> None:
    fields = json.loads(IDENTITY.encode()) | {"keys": ["abcd"]}
    text = json.dumps(fields).encode()
    with pytest.raises(InputFileError):
        DeviceIdentity.read(Flash(text + b"\xff" * (FLASH_BYTES - len(text))))


# Trials


def test_a_bank_without_a_trial_is_not_confirmed() -> None:
    flash = stored()
    confirm(flash, Bank.A)
    confirm(flash, Bank.FACTORY)
    assert set(marks(flash, Bank.A)) == {0xFF}
    assert not flash.busy


@pytest.mark.parametrize(
    ("written", "runs"), [(0, "AB"), (1, "A"), (2, "A"), (3, "A"), (4, "AB"), (5, "B"), (6, "B"), (7, "B")]
)
def test_a_mark_cut_short_counts_from_its_first_bit_on(written: int, runs: str) -> None:
    """Four bytes say that it was started, four that it came up; the byte at a cut may have any of its bits."""
    flash = stored(A=(4, CAME_UP), B=(5, NEVER))
    scheduler = Scheduler()
    flash.power_up(scheduler)
    flash.cut_power_after(written)
    assert boot(flash).bank is Bank.B
    scheduler.run_until(MS)
    if written >= 4:
        confirm(flash, Bank.B)
        scheduler.run_until(2 * MS)
    with pytest.raises(ValueError, match="no power"):
        flash.erase(0)
    assert marks(flash, Bank.B)[:written] == bytes(written)
    assert set(marks(flash, Bank.B)[written + 1 :]) <= {0xFF}
    flash.power_up(Scheduler())
    assert boot(flash).bank.name in runs


def test_an_image_whose_trial_cannot_be_marked_is_not_started() -> None:
    flash = stored(A=(4, CAME_UP), B=(5, NEVER))
    flash.defects.write_protected = True
    assert boot(flash) == Boot(Bank.A, IMAGES[Bank.A], Fault.FLASH)
    confirm(flash, Bank.B)
    assert marks(flash, Bank.B) == b"\xff" * 8
    flash.defects.write_protected = False
    flash.defects.failing_pages.add(0x3000)
    assert boot(flash).bank is Bank.A


# Back to the factory's image: clause FWU-022

Banks = dict[str, tuple[int, tuple[int, int]]]


def given_up(flash: Flash) -> list[int]:
    """Void the upgrades; returns the end of each step, in ms."""
    scheduler = Scheduler()
    flash.power_up(scheduler)
    times = []
    for until in give_up_upgrades(flash):
        scheduler.run_until(until)
        times.append(until // MS)
    return times


def test_an_upgrade_that_cannot_be_voided_stays_and_the_newer_with_it() -> None:
    both: Banks = {"A": (4, CAME_UP), "B": (5, CAME_UP)}
    flash = stored(**both)
    flash.defects.write_protected = True
    assert given_up(flash) == []
    assert boot(flash) == Boot(Bank.B, IMAGES[Bank.B], Fault(0))
    flash = stored(**both)
    flash.defects.failing_pages.add(0x200000 // 256)
    assert given_up(flash) == [1]
    assert boot(flash) == Boot(Bank.B, IMAGES[Bank.B], Fault(0))
    flash = stored(**both)
    flash.defects.failing_pages.add(0x300000 // 256)
    assert given_up(flash) == [1, 2]
    assert boot(flash) == Boot(Bank.B, IMAGES[Bank.B], Fault(0))


def test_a_stuck_bit_in_a_voided_record_does_no_harm() -> None:
    flash = stored(A=(4, CAME_UP), B=(5, CAME_UP))
    flash.defects.stuck_at_1[0x200000] = 0x40
    assert given_up(flash) == [1, 2]
    assert boot(flash) == Boot(Bank.FACTORY, FACTORY_IMAGE, Fault(0))


# Loading the processors: clause FWU-021


def test_the_largest_programs_take_what_the_specification_says() -> None:
    largest = replace(
        FACTORY_IMAGE,
        segments=(Segment(Target.ALL_PROCESSORS, bytes(65_536)), Segment(Target.CONTROLLER, bytes(65_536))),
    )
    five, two = load_cycles(largest, FIVE_WIRE), load_cycles(largest, TWO_WIRE)
    assert five == ((4 + 65_536 + 4) * 8,) * 10
    assert [round(cycles / MS, 1) for cycles in (five[0], two[0])] == [1.3, 3.3]


def test_each_processor_may_have_its_own_program() -> None:
    segments = (*(Segment(Target(n), bytes(n + 1)) for n in range(10)), Segment(Target.CONTROLLER, bytes(1)))
    assert load_cycles(replace(FACTORY_IMAGE, segments=segments), FIVE_WIRE) == tuple((9 + n) * 8 for n in range(10))
