"""Broken handling of firmware images in flash: judging, writing and booting (chapter FWU)."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from functools import partial
from itertools import islice
from types import SimpleNamespace
from typing import Any

from ....base.errors import ImageError
from ....emulator import machine
from ....emulator.firmware import dfu, loader
from ....emulator.firmware.dfu import DfuMode
from ....emulator.firmware.flash import Flash
from ....emulator.interfaces.usb_device import UsbDevice
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
    """Let the loader start the image of its record if SHA-256 is right, even if the image itself is bad."""

    @patch.around(loader, "_whole_image")
    def whole_image(original: Any, flash: Flash, bank: Bank) -> Image | None:
        try:
            found: Image | None = original(flash, bank)
        except ImageError:
            record = loader.read_record(flash, bank)
            return None if record is None else _read_loosely(flash.read(bank.image_address, record.size))
        return found


def _read_loosely(stored: bytes) -> Image | None:
    """The parsed image if its header is sound, else None."""
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
    """The same image, marked for this hardware, with a matching checksum of header and table."""
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
    """An image for other hardware is accepted, and boots."""
    patch.replace(dfu, "ImageHeader", SimpleNamespace(decode=lambda data: ImageHeader.decode(_for_this_hardware(data))))
    patch.replace(dfu, "Image", SimpleNamespace(decode=lambda data: Image.decode(_for_this_hardware(data))))
    _start_bad_images(patch)


@mutant("FWU-010", "DFU-011", wraps=(DfuMode, "_judge"), also=_start_bad_images)
def digests_of_images_are_not_checked(original: Any, self: Any, stored: bytes) -> ImageReason:
    """An image is accepted although CRC-32 or SHA-256 of its segments differ from its table."""
    reason: ImageReason = original(self, stored)
    return ImageReason.ACCEPTED if reason is ImageReason.HASH else reason


@mutant("FWU-009", "FWU-015", wraps=(DfuMode, "_judge"), also=_start_bad_images)
def padding_of_images_is_not_checked(original: Any, self: Any, stored: bytes) -> ImageReason:
    """An image with bytes other than 0 between the segments is accepted."""
    reason: ImageReason = original(self, stored)
    return ImageReason.ACCEPTED if reason is ImageReason.PADDING else reason


@mutant("FWU-011", "FWU-015", wraps=(DfuMode, "_judge"), also=_start_bad_images)
def signature_without_a_key_is_taken(original: Any, self: Any, stored: bytes) -> ImageReason:
    """An unsigned image with a signature other than 0 is accepted: without a key the field is not checked."""
    reason: ImageReason = original(self, stored)
    return ImageReason.ACCEPTED if reason is ImageReason.SIGNATURE and not self._keys else reason


def _trust_more(patch: Patch, trusted: Trust) -> None:
    """Let a device with keys accept images that none of them signed."""

    def judged(image: Image, keys: Any) -> Trust:
        found = trust(image, keys)
        return Trust.SIGNED if found is trusted else found

    patch.replace(dfu, "trust", judged)


@mutant("FWU-012", "FWU-015")
def unsigned_images_are_taken_in_spite_of_keys(patch: Patch) -> None:
    """A device with keys accepts unsigned images: only a signature that is there is checked."""
    _trust_more(patch, Trust.UNSIGNED)


@mutant("FWU-012", "FWU-015")
def images_by_unknown_keys_are_taken(patch: Patch) -> None:
    """A device with keys accepts images signed with an unknown key: what it cannot check, it accepts."""
    _trust_more(patch, Trust.UNKNOWN_KEY)


@mutant("FWU-012", "FWU-011")
def name_of_the_key_is_enough(patch: Patch) -> None:
    """A device with keys accepts any image that names one of them: the signature itself is not verified."""

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
    """Only the factory image checks keys: firmware in another bank accepts any valid image."""
    original(self, scheduler, flash, running, keys if running is Bank.FACTORY else ())


@mutant("FWU-013")
def older_versions_are_refused(patch: Patch) -> None:
    """An image older than the running one is refused: a downgrade was thought useless."""

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


# Where and when it is written


@mutant("FWU-018", wraps=(DfuMode, "__init__"))
def upgrade_overwrites_the_bank_that_runs(
    original: Any, self: Any, scheduler: Any, flash: Flash, running: Bank, keys: Any
) -> None:
    """An upgrade overwrites the running bank unless that is the factory bank: there is one place for upgrades."""
    original(self, scheduler, flash, running, keys)
    if running is not Bank.FACTORY:
        self._bank = running


@mutant("FWU-018", "DFU-010", by=partial(handle, request=DOWNLOAD))
def bank_is_erased_before_the_header_is_checked(original: Any, self: Any, setup: Any, data: bytes) -> Any:
    """The first block erases the bank's boot record before its header is judged."""
    begins = self.state is DfuState.DFU_IDLE and data
    if begins and self._flash.writable and not self._flash.busy:
        self._flash.erase(self._bank.record_address)
    return original(self, setup, data)


@mutant("FWU-018")
def record_is_erased_at_the_end(patch: Patch) -> None:
    """The old boot record stays in the bank until the new one is written, while the image is half overwritten."""

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
    """Manifestation writes the boot record before it checks the image, so that a bad image has a record too."""
    stored = self._flash.read(self._bank.image_address, self._total)
    record = BootRecord.of(stored, loader.read_record(self._flash, idle_bank(self._bank))).encode()[:-8]
    yield from self._program(self._bank.record_address, record)
    yield from original(self)


@mutant("FWU-018", wraps=(DfuMode, "_empty_bank"))
def records_that_may_not_boot_are_erased_as_they_are(_: Any, self: Any) -> Any:
    """A void record is erased without zeros over it first, so that a power cut can revive its image."""
    return self._erase(self._bank.record_address)


# What boots


@mutant("FWU-020")
def new_images_are_never_confirmed(patch: Patch) -> None:
    """New firmware starts and is never confirmed, so that the second boot returns to the old firmware."""
    patch.replace(machine, "confirm", lambda *_: None)


@mutant("FWU-020", wraps=(machine.Emulator, "_come_up"))
def new_images_are_confirmed_at_once(original: Any, self: Any, booted: Any, identities: Any, time: Any) -> None:
    """New firmware is confirmed as soon as it runs, before a host reaches it: a bad one boots for ever."""
    original(self, booted, identities, time)
    loader.confirm(self.flash, booted.bank)


@mutant("FWU-020", wraps=(UsbDevice, "reset"))
def bus_reset_confirms_images(original: Any, self: Any) -> None:
    """New firmware is confirmed by a bus reset, before a host configures it: a reset only proves a cable."""
    original(self)
    if self._dfu is not None:
        self._dfu._controller.host_arrived()


@mutant("FWU-020", wraps=(UsbDevice, "_descriptor"))
def descriptors_confirm_images(original: Any, self: Any, setup: Any) -> bytes:
    """New firmware is confirmed when a host reads its descriptors, which the loader could answer as well."""
    if self._dfu is not None:
        self._dfu._controller.host_arrived()
    found: bytes = original(self, setup)
    return found


@mutant("FWU-020", wraps=(loader, "boot_order"))
def images_that_never_came_up_boot_again(original: Any, *records: Any) -> Any:
    """The loader starts an image a second time although it was started before and never confirmed."""
    return original(*(record[: -len(MARKED)] + MARKED for record in records))


@mutant("FWU-019", wraps=(loader, "boot_order"))
def bank_a_always_comes_first(original: Any, *records: Any) -> Any:
    """The loader tries bank A before bank B, whichever is newer."""
    return tuple(sorted(original(*records), key=(Bank.A, Bank.B, Bank.FACTORY).index))


@mutant("FWU-019", "SAF-008", wraps=(machine, "boot"))
def bad_images_are_passed_over_in_silence(original: Any, flash: Any) -> Any:
    """If the newest image does not boot, the previous one does, but no fault FLASH reports it."""
    return original(flash)._replace(faults=Fault(0))


@mutant("FWU-022", "REQ-014", wraps=(machine, "give_up_upgrades"))
def revert_leaves_the_newer_image(original: Any, flash: Flash) -> Iterator[int]:
    """REVERT voids only the older of two upgrades, and the newer one boots again."""
    yield from islice(original(flash), 1)


@mutant("FWU-022", wraps=(loader, "_whole_image"))
def revert_does_not_look_at_the_factory_image(original: Any, flash: Flash, bank: Bank) -> Image | None:
    """REVERT voids the upgrades even if the factory image is bad, which then runs as it is."""
    found: Image | None = original(flash, bank)
    return loader.FACTORY_IMAGE if bank is Bank.FACTORY else found
