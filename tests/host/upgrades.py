"""Firmware images and the content of a device's flash, for tests of upgrades."""

from __future__ import annotations

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from phasewire import Emulator, Wiring
from phasewire.emulator.firmware.flash import Flash
from phasewire.emulator.firmware.loader import FACTORY_IMAGE, DeviceIdentity, make_flash
from phasewire.protocol.codes import Bank, Request, Target
from phasewire.protocol.enumeration import DFU_PRODUCT_ID
from phasewire.protocol.firmware import Image, Segment, build
from phasewire.protocol.replies import ProcessorReport, decode_reports
from phasewire.protocol.requests import Setup
from phasewire.protocol.versions import Version

BLOCK, SECTOR = 2048, 4096
KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
STRANGER = Ed25519PrivateKey.from_private_bytes(bytes(32))
FACTORY = FACTORY_IMAGE.version


def made(major: int, size: int = 9000, protocol: int = 1) -> Image:
    """An image of about so many random bytes."""
    body = np.random.default_rng(major).bytes(size)
    segments = (Segment(Target.ALL_PROCESSORS, body), Segment(Target.CONTROLLER, body[:70]))
    return Image(Version(major, 3, 4), segments, protocol=protocol)


OLD, NEW, NEWER = made(1), made(2), made(3)
STORED, FILE = NEW.encode(), build(NEW)
BLOCKS = -(-len(STORED) // BLOCK)
WRITTEN = SECTOR + -(-len(STORED) // SECTOR) * SECTOR + len(STORED) + 48 + 4 + 4
"""Bytes that an upgrade erases and programs: a sector for the record and those of the image, the image, the record, and
the marks that it was started and came up."""


def trusting(key: Ed25519PrivateKey) -> Flash:
    """A flash whose device takes only what was signed with a key."""
    return make_flash(DeviceIdentity("TRUSTS", Wiring.strips(), (key.public_key(),)))


def in_dfu_mode(emulator: Emulator) -> bool:
    return emulator.usb.attached and emulator.usb.enumeration.device.idProduct == DFU_PRODUCT_ID


def reports(emulator: Emulator) -> list[ProcessorReport]:
    """The reports of the processors, after a host has configured the device."""
    return decode_reports(emulator.usb.control(Setup(0xC1, Request.PROCESSORS, 0, 0, 160)))


def running(emulator: Emulator) -> tuple[Version, Bank | None]:
    """The firmware on all ten processors, and its bank; the controller must run the same."""
    ((firmware, bank),) = {(report.firmware, report.bank) for report in reports(emulator)}
    assert emulator.running.info().firmware == firmware
    return Version(*firmware), bank


def booted(emulator: Emulator) -> Version:
    """The firmware that runs after a power cut."""
    emulator.power_down()
    emulator.power_up()
    emulator.run_until_started()
    return Version(*emulator.running.info().firmware)


def untouched(emulator: Emulator) -> bool:
    """Whether the device has stayed in run-time mode, with its flash unwritten."""
    return emulator.usb.generation == 1 and not emulator.flash.erasures.any() and not in_dfu_mode(emulator)
