"""The boot loader: which image in flash runs, and the marks that put it on trial (SPEC.md, clauses FWU-016 to FWU-022).

It is also where a flash is made in the first place: the factory's image, and what the loader's own part of the flash
says of the device. It knows nothing of USB, and how an image comes into a bank is `dfu.py`'s business.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...base.errors import DeviceError, InputFileError
from ...base.extras import needing
from ...protocol.board import PROCESSORS
from ...protocol.codes import FLASH_SECTOR_BYTES, Bank, Fault, Target
from ...protocol.firmware import BootRecord, Image, Segment, boot_order
from ...protocol.timing import Link
from ...protocol.versions import Version
from ...protocol.wiring import Wiring
from .flash import ERASED_BYTE, FLASH_BYTES, Flash

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

__all__ = [
    "FACTORY_IMAGE",
    "Boot",
    "DeviceIdentity",
    "boot",
    "confirm",
    "give_up_upgrades",
    "keep",
    "load_cycles",
    "make_flash",
    "next_image",
    "read_record",
]

FACTORY_IMAGE = Image(
    Version(0, 1, 0),
    (
        Segment(Target.ALL_PROCESSORS, b"stands for the program of a processor"),
        Segment(Target.CONTROLLER, b"stands for the program of the controller"),
    ),
)
"""What an emulated device is made with. Nothing executes it, so that a few bytes are enough."""

IDENTITY_ADDRESS = 0
IDENTITY_BYTES = 64 * 1024
MARK, UNMARKED = bytes(4), bytes([ERASED_BYTE]) * 4
SIZE_BYTES, CHECKSUM_BYTES = 4, 4  # sent before and after a segment


class DeviceIdentity(NamedTuple):
    """What a device is told of itself when it is made (clause FWU-016)."""

    serial: str
    wiring: Wiring
    keys: tuple[Ed25519PublicKey, ...] = ()
    """Whose images it accepts; without any, everybody's (clause FWU-012)."""

    def encode(self) -> bytes:
        """Encode as it lies in the loader's part of the flash: JSON, after which the flash is erased."""
        keys = [key.public_bytes_raw().hex() for key in self.keys]
        return json.dumps({"serial": self.serial, "wiring": self.wiring.channels.tolist(), "keys": keys}).encode()

    @classmethod
    def read(cls, flash: Flash) -> DeviceIdentity:
        """Read it from a flash; raise `InputFileError` if none was written there."""
        text = flash.read(IDENTITY_ADDRESS, IDENTITY_BYTES).partition(bytes([ERASED_BYTE]))[0]
        try:
            fields = json.loads(text)
            return cls(str(fields["serial"]), Wiring(fields["wiring"]), _public_keys(fields["keys"]))
        except (ValueError, KeyError, TypeError) as error:
            raise InputFileError(f"this flash does not say which device it belongs to: {error}") from error


def _public_keys(keys: Sequence[str]) -> tuple[Ed25519PublicKey, ...]:
    if not keys:
        return ()
    with needing("signing", "a flash that trusts keys"):
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey  # slow, and few have keys

    return tuple(Ed25519PublicKey.from_public_bytes(bytes.fromhex(key)) for key in keys)


def make_flash(identity: DeviceIdentity, image: Image = FACTORY_IMAGE) -> Flash:
    """A flash as it leaves the factory: its image confirmed, the banks A and B empty (clause FWU-016)."""
    stored = image.encode()
    record = replace(BootRecord.of(stored, None), started=0, confirmed=0)
    content = np.full(FLASH_BYTES, ERASED_BYTE, np.uint8)
    for address, data in (
        (IDENTITY_ADDRESS, identity.encode()),
        (Bank.FACTORY.record_address, record.encode()),
        (Bank.FACTORY.image_address, stored),
    ):
        content[address : address + len(data)] = np.frombuffer(data, np.uint8)
    return Flash(content)


def keep(flash: Flash, path: Path, complain: Callable[[OSError], None]) -> None:
    """Write a flash to a file now, and whenever a boot record has changed, before the device says so to anybody.

    What is not yet in a record boots nowhere, so the file always holds a flash that a power cut could have left: one
    from before a step of an upgrade, or from after it. Somebody is told of an error, and the device goes on.
    """

    def save(address: int) -> None:
        if any(0 <= address - bank.record_address < FLASH_SECTOR_BYTES for bank in Bank):
            try:
                flash.save(path)
            except OSError as error:
                complain(error)

    flash.save(path)
    flash.on_change = save


def read_record(flash: Flash, bank: Bank) -> BootRecord | None:
    """The boot record of a bank; None if it is empty (clause FWU-017)."""
    return BootRecord.decode(flash.read(bank.record_address, BootRecord.BYTES))


class Boot(NamedTuple):
    """What a device runs. Its marks are written when `Flash.busy_until` is over; it does not start before."""

    bank: Bank
    image: Image
    faults: Fault
    """`Fault.FLASH` if a bank with a record failed or may not boot."""


def boot(flash: Flash) -> Boot:
    """Choose the image that runs, and put it on trial if it is new (clauses FWU-019 and FWU-020).

    The flash must be idle.

    Raises
    ------
    DeviceError
        If not even the factory's image is whole.
    """
    order = _order(flash)
    barred = any(bank not in order and read_record(flash, bank) is not None for bank in (Bank.A, Bank.B))
    faults = Fault.FLASH if barred else Fault(0)
    for bank in order:
        image = _whole_image(flash, bank)
        # One that nothing says of that it was started would be started for ever.
        if image is not None and (_is_marked(flash, _confirmed(bank)) or _mark(flash, _started(bank))):
            return Boot(bank, image, faults)
        faults = Fault.FLASH
    raise DeviceError("nothing in this flash boots: the factory's image is damaged, or was never written")


def next_image(flash: Flash) -> bytes:
    """The image that would boot next, as it stands in flash; no bytes if none would (clause DFU-014)."""
    images = (_whole_image(flash, bank) for bank in _order(flash))
    return next((image.encode() for image in images if image is not None), b"")


def confirm(flash: Flash, bank: Bank) -> None:
    """Write that the image of a bank came up, unless that is written already (clause FWU-020).

    If it cannot be written, the image is not started again.
    """
    if read_record(flash, bank) is not None:
        _mark(flash, _confirmed(bank))


def give_up_upgrades(flash: Flash) -> Iterator[int]:
    """Leave the factory's image alone to boot (clause FWU-022); yields the core cycle until which the flash is busy.

    The flash must be idle at first. What cannot be given up stays, and what is newer with it.
    """
    if _whole_image(flash, Bank.FACTORY) is None:
        return
    for bank in _by_age(flash):
        if flash.writable:
            flash.program(bank.record_address, bytes(BootRecord.BYTES - 2 * len(MARK)))
            yield flash.busy_until
        if read_record(flash, bank) is not None:
            return


def _by_age(flash: Flash) -> list[Bank]:
    """The banks A and B that have a record, the older first; of two of which none is newer, A counts as the newer."""
    records = {bank: record for bank in (Bank.B, Bank.A) if (record := read_record(flash, bank)) is not None}
    banks = list(records)
    if len(banks) == 2 and records[Bank.B].newer_than(records[Bank.A]):
        banks.reverse()
    return banks


def _order(flash: Flash) -> tuple[Bank, ...]:
    return boot_order(*(flash.read(bank.record_address, BootRecord.BYTES) for bank in (Bank.A, Bank.B)))


def _whole_image(flash: Flash, bank: Bank) -> Image | None:
    """The image of a bank if it is the one that its record names."""
    record = read_record(flash, bank)
    stored = b"" if record is None else flash.read(bank.image_address, record.size)
    return Image.decode(stored) if record is not None and record.describes(stored) else None


def _started(bank: Bank) -> int:
    return bank.record_address + BootRecord.BYTES - 2 * len(MARK)


def _confirmed(bank: Bank) -> int:
    return bank.record_address + BootRecord.BYTES - len(MARK)


def _is_marked(flash: Flash, address: int) -> bool:
    return flash.read(address, len(MARK)) != UNMARKED


def _mark(flash: Flash, address: int) -> bool:
    """Write a mark that is not there yet; False if it is not there afterwards either."""
    if flash.writable and not _is_marked(flash, address):
        flash.program(address, MARK)
    return _is_marked(flash, address)


def load_cycles(image: Image, link: Link) -> tuple[int, ...]:
    """How long each processor, in the order of the chain, receives its program, in core cycles (clause FWU-021)."""
    return tuple(
        (SIZE_BYTES + len(image.program(place)) + CHECKSUM_BYTES) * link.cycles_per_token for place in range(PROCESSORS)
    )
