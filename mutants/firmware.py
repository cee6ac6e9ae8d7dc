"""Broken firmware images in flash: what is judged, where it is written, and what boots (chapter FWU)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from functools import partial
from itertools import islice
from types import SimpleNamespace
from typing import Any

from ..emulator import machine
from ..emulator.firmware import dfu, loader
from ..emulator.firmware.dfu import DfuMode
from ..emulator.firmware.flash import Flash
from ..emulator.interfaces.usb_device import UsbDevice
from ..errors import ImageError
from ..protocol.codes import Bank, DfuState, DfuStatus, Fault, ImageReason, Target
from ..protocol.firmware import BootRecord, Image, ImageHeader, Segment, Trust, idle_bank, trust
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

    @patch.around(loader, "_whole_image")
    def whole_image(original: Any, flash: Flash, bank: Bank) -> Image | None:
        try:
            found: Image | None = original(flash, bank)
        except ImageError:
            record = loader.read_record(flash, bank)
            return None if record is None else _read_loosely(flash.read(bank.image_address, record.size))
        return found


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


@mutant("FWU-010", "DFU-011", wraps=(DfuMode, "_judge"), also=_start_bad_images)
def digests_of_images_are_not_checked(original: Any, self: Any, stored: bytes) -> ImageReason:
    """An image is taken whose segments have another CRC-32 or SHA-256 than its table says."""
    reason: ImageReason = original(self, stored)
    return ImageReason.ACCEPTED if reason is ImageReason.HASH else reason


@mutant("FWU-009", "FWU-015", wraps=(DfuMode, "_judge"), also=_start_bad_images)
def padding_of_images_is_not_checked(original: Any, self: Any, stored: bytes) -> ImageReason:
    """An image is taken whose bytes between the segments are not 0."""
    reason: ImageReason = original(self, stored)
    return ImageReason.ACCEPTED if reason is ImageReason.PADDING else reason


@mutant("FWU-011", "FWU-015", wraps=(DfuMode, "_judge"), also=_start_bad_images)
def signature_without_a_key_is_taken(original: Any, self: Any, stored: bytes) -> ImageReason:
    """An unsigned image is taken whose signature is not zero: nobody looks at it where there is no key."""
    reason: ImageReason = original(self, stored)
    return ImageReason.ACCEPTED if reason is ImageReason.SIGNATURE and not self._keys else reason


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


@mutant("FWU-012", wraps=(DfuMode, "__init__"))
def keys_are_lost_with_the_first_upgrade(
    original: Any, self: Any, scheduler: Any, flash: Flash, running: Bank, keys: Any
) -> None:
    """Only the factory's image looks at the keys: what runs from another bank takes any valid image."""
    original(self, scheduler, flash, running, keys if running is Bank.FACTORY else ())


@mutant("FWU-013")
def older_versions_are_refused(patch: Patch) -> None:
    """An image that is older than what runs is refused: nobody should want to go back."""

    @patch.around(DfuMode, "__init__")
    def of_init(original: Any, self: Any, scheduler: Any, flash: Flash, running: Bank, keys: Any) -> None:
        original(self, scheduler, flash, running, keys)
        self.version = flash.read(running.image_address, VERSION_AT.stop)[VERSION_AT]

    def download(original: Any, self: Any, setup: Any, data: bytes) -> Any:
        begins = self.state is DfuState.DFU_IDLE and len(data) >= HEADER_BYTES
        if begins and data[VERSION_AT] < self.version:
            self._refuse(DfuStatus.FILE)
        return original(self, setup, data)

    handle(patch, download, DOWNLOAD)


# Where it is written, and when


@mutant("FWU-018", wraps=(DfuMode, "__init__"))
def upgrade_overwrites_the_bank_that_runs(
    original: Any, self: Any, scheduler: Any, flash: Flash, running: Bank, keys: Any
) -> None:
    """An upgrade goes to the bank that runs, where that is not the factory's: there is one place for upgrades."""
    original(self, scheduler, flash, running, keys)
    if running is not Bank.FACTORY:
        self._bank = running


@mutant("FWU-018", "DFU-010", by=partial(handle, request=DOWNLOAD))
def bank_is_erased_before_the_header_is_checked(original: Any) -> Any:
    """The first block erases the boot record of the bank before anybody has looked at its header."""

    def download(self: Any, setup: Any, data: bytes) -> Any:
        begins = self.state is DfuState.DFU_IDLE and data
        if begins and self._flash.writable and not self._flash.busy:
            self._flash.erase(self._bank.record_address)
        return original(self, setup, data)

    return download


@mutant("FWU-018")
def record_is_erased_at_the_end(patch: Patch) -> None:
    """The boot record of the bank stays until the new one is written, over an image that is half another."""

    def of_empty(_: Any) -> Any:
        return lambda _self: iter(())

    @patch.around(DfuMode, "_manifest")
    def of_manifest(original: Any, self: Any) -> Iterator[Any]:
        steps = original(self)
        yield next(steps)
        yield from self._erase(self._bank.record_address)
        yield from steps

    patch.wrap(DfuMode, "_empty_bank", of_empty)


@mutant("FWU-018", "DFU-010", wraps=(DfuMode, "_manifest"), also=_start_bad_images)
def record_is_written_before_the_image_is_checked(original: Any, self: Any) -> Iterator[Any]:
    """Manifestation writes the boot record first and checks the image behind it, so that a bad one has a record too."""
    stored = self._flash.read(self._bank.image_address, self._total)
    record = BootRecord.of(stored, loader.read_record(self._flash, idle_bank(self._bank))).encode()[:-8]
    yield from self._program(self._bank.record_address, record)
    yield from original(self)


@mutant("FWU-018", wraps=(DfuMode, "_empty_bank"))
def records_that_may_not_boot_are_erased_as_they_are(_: Any, self: Any) -> Any:
    """A record that may not boot is erased without zeros over it, so that a power cut can bring its image back."""
    return self._erase(self._bank.record_address)


# What boots


@mutant("FWU-020")
def new_images_are_never_confirmed(patch: Patch) -> None:
    """New firmware is started and never confirmed, so that the device goes back to the old one at its second boot."""
    patch.replace(machine, "confirm", lambda *_: None)


@mutant("FWU-020", wraps=(machine.Emulator, "_come_up"))
def new_images_are_confirmed_at_once(original: Any, self: Any, booted: Any, identities: Any, time: Any) -> None:
    """New firmware is confirmed as soon as it runs, before a host has spoken to it: a bad one boots for ever."""
    original(self, booted, identities, time)
    loader.confirm(self.flash, booted.bank)


@mutant("FWU-020", wraps=(UsbDevice, "reset"))
def bus_reset_confirms_images(original: Any, self: Any) -> None:
    """New firmware is confirmed by a bus reset, before a host has configured it: that proves a cable only."""
    original(self)
    if self._dfu is not None:
        self._dfu._controller.host_arrived()


@mutant("FWU-020", wraps=(UsbDevice, "_descriptor"))
def descriptors_confirm_images(original: Any, self: Any, setup: Any) -> bytes:
    """New firmware is confirmed when a host reads its descriptors: that is the code that was there for sure."""
    if self._dfu is not None:
        self._dfu._controller.host_arrived()
    found: bytes = original(self, setup)
    return found


@mutant("FWU-020", wraps=(loader, "boot_order"))
def images_that_never_came_up_boot_again(original: Any, *records: Any) -> Any:
    """The loader starts an image again that it has started before and that never came up."""
    return original(*(record[: -len(MARKED)] + MARKED for record in records))


@mutant("FWU-019", wraps=(loader, "boot_order"))
def bank_a_always_comes_first(original: Any, *records: Any) -> Any:
    """The loader tries bank A before bank B, whichever is newer."""
    return tuple(sorted(original(*records), key=(Bank.A, Bank.B, Bank.FACTORY).index))


@mutant("FWU-019", "SAF-008", wraps=(machine, "boot"))
def bad_images_are_passed_over_in_silence(original: Any, flash: Any) -> Any:
    """Where the newest image does not boot the one before does, and no fault FLASH says so."""
    return original(flash)._replace(faults=Fault(0))


@mutant("FWU-022", "REQ-014", wraps=(machine, "give_up_upgrades"))
def revert_leaves_the_newer_image(original: Any, flash: Flash) -> Iterator[int]:
    """REVERT gives up the older of two upgrades alone, and the newer boots again."""
    yield from islice(original(flash), 1)


@mutant("FWU-022", wraps=(loader, "_whole_image"))
def revert_does_not_look_at_the_factory_image(original: Any, flash: Flash, bank: Bank) -> Image | None:
    """REVERT gives up the upgrades also where the factory's image is bad, which then runs as it is."""
    found: Image | None = original(flash, bank)
    return loader.FACTORY_IMAGE if bank is Bank.FACTORY else found
