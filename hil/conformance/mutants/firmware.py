"""Broken firmware images in flash: what is judged, where it is written, and what boots (chapter FWU)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from itertools import islice
from types import SimpleNamespace
from typing import Any

from ....emulator import machine
from ....emulator.firmware import dfu, loader
from ....emulator.firmware.dfu import DfuMode
from ....emulator.firmware.flash import Flash
from ....emulator.interfaces.usb_device import UsbDevice
from ....errors import ImageError
from ....protocol.codes import Bank, DfuState, DfuStatus, Fault, ImageReason, Target
from ....protocol.firmware import BootRecord, Image, ImageHeader, Segment, Trust, idle_bank, trust
from .dfu import DOWNLOAD, handle
from .patching import Patch, mutant

HARDWARE_AT = slice(6, 8)
VERSION_AT = slice(8, 11)
CHECKSUM_AT = slice(28, 32)
HEADER_BYTES, ENTRY_BYTES = 32, 48
SEGMENTS_AT = 5
MARKED = bytes(4)


# Images


def _start_bad_images(patch: Patch) -> None:
    """Let the loader start what its record names, as SHA-256 alone decides, also where the image itself is bad."""

    def around(original: Any) -> Any:
        def whole_image(flash: Flash, bank: Bank) -> Image | None:
            try:
                found: Image | None = original(flash, bank)
            except ImageError:
                record = loader.read_record(flash, bank)
                return None if record is None else _read_loosely(flash.read(bank.image_address, record.size))
            return found

        return whole_image

    patch.wrap(loader, "_whole_image", around)


def _read_loosely(stored: bytes) -> Image | None:
    """What can be read of an image whose header is sound, None of another."""
    try:
        header = ImageHeader.decode(_for_this_hardware(stored))
    except ImageError:
        return None
    segments = tuple(
        Segment(Target(entry.target), bytes(stored[entry.offset : entry.offset + entry.size]))
        for entry in header.entries
    )
    return Image(header.version, segments)


def _for_this_hardware(image: bytes) -> bytes:
    """The same image for this hardware, with the checksum of header and table that goes with it."""
    if len(image) < HEADER_BYTES:
        return image
    changed = bytearray(image)
    changed[HARDWARE_AT] = (1).to_bytes(2, "little")
    table = changed[HEADER_BYTES : HEADER_BYTES + ENTRY_BYTES * changed[SEGMENTS_AT]]
    checksum = zlib.crc32(table, zlib.crc32(changed[: CHECKSUM_AT.start]))
    sound = zlib.crc32(table, zlib.crc32(image[: CHECKSUM_AT.start])) == int.from_bytes(image[CHECKSUM_AT], "little")
    changed[CHECKSUM_AT] = checksum.to_bytes(4, "little")
    return bytes(changed) if sound else image


@mutant("FWU-005", "FWU-015")
def hardware_of_images_is_not_checked(patch: Patch) -> None:
    """An image for other hardware is taken, and boots."""
    patch.replace(dfu, "ImageHeader", SimpleNamespace(decode=lambda data: ImageHeader.decode(_for_this_hardware(data))))
    patch.replace(dfu, "Image", SimpleNamespace(decode=lambda data: Image.decode(_for_this_hardware(data))))
    _start_bad_images(patch)


@mutant("FWU-010", "DFU-011")
def digests_of_images_are_not_checked(patch: Patch) -> None:
    """An image is taken whose segments have another CRC-32 or SHA-256 than its table says."""

    def around(original: Any) -> Any:
        def judge(self: Any, stored: bytes) -> ImageReason:
            reason: ImageReason = original(self, stored)
            return ImageReason.ACCEPTED if reason is ImageReason.HASH else reason

        return judge

    patch.wrap(DfuMode, "_judge", around)
    _start_bad_images(patch)


@mutant("FWU-009", "FWU-015")
def padding_of_images_is_not_checked(patch: Patch) -> None:
    """An image is taken whose bytes between the segments are not 0."""

    def around(original: Any) -> Any:
        def judge(self: Any, stored: bytes) -> ImageReason:
            reason: ImageReason = original(self, stored)
            return ImageReason.ACCEPTED if reason is ImageReason.PADDING else reason

        return judge

    patch.wrap(DfuMode, "_judge", around)
    _start_bad_images(patch)


@mutant("FWU-011", "FWU-015")
def signature_without_a_key_is_taken(patch: Patch) -> None:
    """An unsigned image is taken whose signature is not zero: nobody looks at it where there is no key."""

    def around(original: Any) -> Any:
        def judge(self: Any, stored: bytes) -> ImageReason:
            reason: ImageReason = original(self, stored)
            return ImageReason.ACCEPTED if reason is ImageReason.SIGNATURE and not self._keys else reason

        return judge

    patch.wrap(DfuMode, "_judge", around)
    _start_bad_images(patch)


def _trust_more(patch: Patch, trusted: Trust) -> None:
    """Let a device with keys take images that none of them has signed."""

    def judged(image: Image, keys: Any) -> Trust:
        found = trust(image, keys)
        return Trust.SIGNED if found is trusted else found

    patch.replace(dfu, "trust", judged)


@mutant("FWU-012", "FWU-015")
def unsigned_images_are_taken_in_spite_of_keys(patch: Patch) -> None:
    """A device with keys takes images that are not signed: only where there is a signature is it looked at."""
    _trust_more(patch, Trust.UNSIGNED)


@mutant("FWU-012", "FWU-015")
def images_by_unknown_keys_are_taken(patch: Patch) -> None:
    """A device with keys takes images by a key that it does not know: what cannot be checked is let through."""
    _trust_more(patch, Trust.UNKNOWN_KEY)


@mutant("FWU-012", "FWU-011")
def name_of_the_key_is_enough(patch: Patch) -> None:
    """A device with keys takes images that name one of them, whatever their signature is: it is not verified."""

    def judged(image: Image, keys: Any) -> Trust:
        try:
            return trust(image, keys)
        except ImageError:
            return Trust.SIGNED

    patch.replace(dfu, "trust", judged)


@mutant("FWU-012")
def keys_are_lost_with_the_first_upgrade(patch: Patch) -> None:
    """Only the factory's image looks at the keys: what runs from another bank takes any valid image."""

    def around(original: Any) -> Any:
        def init(self: Any, scheduler: Any, flash: Flash, running: Bank, keys: Any) -> None:
            original(self, scheduler, flash, running, keys if running is Bank.FACTORY else ())

        return init

    patch.wrap(DfuMode, "__init__", around)


@mutant("FWU-013")
def older_versions_are_refused(patch: Patch) -> None:
    """An image that is older than what runs is refused: nobody should want to go back."""

    def of_init(original: Any) -> Any:
        def init(self: Any, scheduler: Any, flash: Flash, running: Bank, keys: Any) -> None:
            original(self, scheduler, flash, running, keys)
            self.version = flash.read(running.image_address, VERSION_AT.stop)[VERSION_AT]

        return init

    def around(original: Any) -> Any:
        def download(self: Any, setup: Any, data: bytes) -> Any:
            begins = self.state is DfuState.DFU_IDLE and len(data) >= HEADER_BYTES
            if begins and data[VERSION_AT] < self.version:
                self._refuse(DfuStatus.FILE)
            return original(self, setup, data)

        return download

    patch.wrap(DfuMode, "__init__", of_init)
    handle(patch, DOWNLOAD, around)


# Where it is written, and when


@mutant("FWU-018")
def upgrade_overwrites_the_bank_that_runs(patch: Patch) -> None:
    """An upgrade goes to the bank that runs, where that is not the factory's: there is one place for upgrades."""

    def around(original: Any) -> Any:
        def init(self: Any, scheduler: Any, flash: Flash, running: Bank, keys: Any) -> None:
            original(self, scheduler, flash, running, keys)
            if running is not Bank.FACTORY:
                self._bank = running

        return init

    patch.wrap(DfuMode, "__init__", around)


@mutant("FWU-018", "DFU-010")
def bank_is_erased_before_the_header_is_checked(patch: Patch) -> None:
    """The first block erases the boot record of the bank before anybody has looked at its header."""

    def around(original: Any) -> Any:
        def download(self: Any, setup: Any, data: bytes) -> Any:
            begins = self.state is DfuState.DFU_IDLE and data
            if begins and self._flash.writable and not self._flash.busy:
                self._flash.erase(self._bank.record_address)
            return original(self, setup, data)

        return download

    handle(patch, DOWNLOAD, around)


@mutant("FWU-018")
def record_is_erased_at_the_end(patch: Patch) -> None:
    """The boot record of the bank stays until the new one is written, over an image that is half another."""

    def of_empty(_: Any) -> Any:
        return lambda _self: iter(())

    def of_manifest(original: Any) -> Any:
        def manifest(self: Any) -> Iterator[Any]:
            steps = original(self)
            yield next(steps)
            yield from self._erase(self._bank.record_address)
            yield from steps

        return manifest

    patch.wrap(DfuMode, "_empty_bank", of_empty)
    patch.wrap(DfuMode, "_manifest", of_manifest)


@mutant("FWU-018", "DFU-010")
def record_is_written_before_the_image_is_checked(patch: Patch) -> None:
    """Manifestation writes the boot record first and checks the image behind it, so that a bad one has a record too."""

    def around(original: Any) -> Any:
        def manifest(self: Any) -> Iterator[Any]:
            stored = self._flash.read(self._bank.image_address, self._total)
            record = BootRecord.of(stored, loader.read_record(self._flash, idle_bank(self._bank))).encode()[:-8]
            yield from self._program(self._bank.record_address, record)
            yield from original(self)

        return manifest

    patch.wrap(DfuMode, "_manifest", around)
    _start_bad_images(patch)


@mutant("FWU-018")
def records_that_may_not_boot_are_erased_as_they_are(patch: Patch) -> None:
    """A record that may not boot is erased without zeros over it, so that a power cut can bring its image back."""

    def around(_: Any) -> Any:
        return lambda self: self._erase(self._bank.record_address)

    patch.wrap(DfuMode, "_empty_bank", around)


# What boots


@mutant("FWU-020")
def new_images_are_never_confirmed(patch: Patch) -> None:
    """New firmware is started and never confirmed, so that the device goes back to the old one at its second boot."""
    patch.replace(machine, "confirm", lambda *_: None)


@mutant("FWU-020")
def new_images_are_confirmed_at_once(patch: Patch) -> None:
    """New firmware is confirmed as soon as it runs, before a host has spoken to it: a bad one boots for ever."""

    def around(original: Any) -> Any:
        def come_up(self: Any, booted: Any, identities: Any, time: Any) -> None:
            original(self, booted, identities, time)
            loader.confirm(self.flash, booted.bank)

        return come_up

    patch.wrap(machine.Emulator, "_come_up", around)


@mutant("FWU-020")
def bus_reset_confirms_images(patch: Patch) -> None:
    """New firmware is confirmed by a bus reset, before a host has configured it: that proves a cable only."""

    def around(original: Any) -> Any:
        def reset(self: Any) -> None:
            original(self)
            if self._dfu is not None:
                self._dfu._controller.host_arrived()

        return reset

    patch.wrap(UsbDevice, "reset", around)


@mutant("FWU-020")
def descriptors_confirm_images(patch: Patch) -> None:
    """New firmware is confirmed when a host reads its descriptors: that is the code that was there for sure."""

    def around(original: Any) -> Any:
        def descriptor(self: Any, setup: Any) -> bytes:
            if self._dfu is not None:
                self._dfu._controller.host_arrived()
            found: bytes = original(self, setup)
            return found

        return descriptor

    patch.wrap(UsbDevice, "_descriptor", around)


@mutant("FWU-020")
def images_that_never_came_up_boot_again(patch: Patch) -> None:
    """The loader starts an image again that it has started before and that never came up."""

    def around(original: Any) -> Any:
        return lambda *records: original(*(record[: -len(MARKED)] + MARKED for record in records))

    patch.wrap(loader, "boot_order", around)


@mutant("FWU-019")
def bank_a_always_comes_first(patch: Patch) -> None:
    """The loader tries bank A before bank B, whichever is newer."""

    def around(original: Any) -> Any:
        return lambda *records: tuple(sorted(original(*records), key=(Bank.A, Bank.B, Bank.FACTORY).index))

    patch.wrap(loader, "boot_order", around)


@mutant("FWU-019", "SAF-008")
def bad_images_are_passed_over_in_silence(patch: Patch) -> None:
    """Where the newest image does not boot the one before does, and no fault FLASH says so."""

    def around(original: Any) -> Any:
        return lambda flash: original(flash)._replace(faults=Fault(0))

    patch.wrap(machine, "boot", around)


@mutant("FWU-022", "REQ-014")
def revert_leaves_the_newer_image(patch: Patch) -> None:
    """REVERT gives up the older of two upgrades alone, and the newer boots again."""

    def around(original: Any) -> Any:
        def give_up(flash: Flash) -> Iterator[int]:
            yield from islice(original(flash), 1)

        return give_up

    patch.wrap(machine, "give_up_upgrades", around)


@mutant("FWU-022")
def revert_does_not_look_at_the_factory_image(patch: Patch) -> None:
    """REVERT gives up the upgrades also where the factory's image is bad, which then runs as it is."""

    def around(original: Any) -> Any:
        def whole_image(flash: Flash, bank: Bank) -> Image | None:
            found: Image | None = original(flash, bank)
            return loader.FACTORY_IMAGE if bank is Bank.FACTORY else found

        return whole_image

    patch.wrap(loader, "_whole_image", around)
