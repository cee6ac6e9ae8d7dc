"""New firmware through the device's USB port, and what runs after each loss of power (chapters FWU, DFU)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from phasewire import Emulator
from phasewire.emulator.firmware import loader
from phasewire.emulator.firmware.flash import FLASH_BYTES, Flash
from phasewire.emulator.firmware.loader import FACTORY_IMAGE
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.codes import DfuState, DfuStatus, Fault, Target
from phasewire.protocol.dfu import DfuReply
from phasewire.protocol.firmware import Image, Segment, build, split_suffix
from phasewire.protocol.requests import Setup
from phasewire.protocol.versions import Version

from tests.emulator.hosts import Device

OUT, IN = 0x21, 0xA1
BLOCK = 2048
FACTORY = FACTORY_IMAGE.version


def made(version: Version, size: int = 9000) -> bytes:
    """The bytes to send for the file of an image."""
    body = np.random.default_rng(version.bcd).bytes(size)
    file = build(Image(version, (Segment(Target.ALL_PROCESSORS, body), Segment(Target.CONTROLLER, body[:70]))))
    return split_suffix(file)[0]


NEW = Version(2, 3, 4)
IMAGE = made(NEW)


class Upgraded(Device):
    """A device, and a host that gives it new firmware as dfu-util does."""

    # In DFU mode

    def dfu_out(self, request: int, value: int = 0, data: bytes = b"") -> None:
        self.usb.control(Setup(OUT, request, value, 0, len(data)), data)

    def dfu_status(self) -> DfuReply:
        return DfuReply.decode(self.usb.control(Setup(IN, 3, 0, 0, 6)))

    def poll(self) -> DfuReply:
        """Ask until the device is not busy."""
        for _ in range(200):
            reply = self.dfu_status()
            if not reply.poll_ms:
                return reply
            self.run_ms(reply.poll_ms)
        raise AssertionError(reply)

    def send_image(self, image: bytes, blocks: int | None = None) -> None:
        """Send an image, or its first few blocks."""
        pieces = [image[at : at + BLOCK] for at in range(0, len(image), BLOCK)]
        for number, piece in enumerate(pieces[:blocks]):
            self.dfu_out(1, number, piece)
            assert self.poll() == DfuReply(DfuStatus.OK, 0, DfuState.DNLOAD_IDLE, 0)
        if blocks is None:
            self.dfu_out(1, len(pieces))
            assert self.poll() == DfuReply(DfuStatus.OK, 0, DfuState.DFU_IDLE, 0)

    # Between the modes

    def come_back(self) -> None:
        """Wait until the device is on the bus again."""
        before = self.usb.generation
        for _ in range(4000):
            if self.usb.generation > before:
                return
            self.run_ms(1)
        raise AssertionError("it did not come back")

    def enter_dfu_mode(self) -> None:
        self.detach()
        self.come_back()
        self.usb.reset()
        self.configure()

    def boot(self) -> None:
        """Reset the bus, and find the device in run-time mode; a host has not configured it yet."""
        self.usb.reset()
        assert not self.usb.attached
        self.come_back()
        self.usb.reset()

    def upgrade(self, image: bytes) -> None:
        self.enter_dfu_mode()
        self.send_image(image)
        self.boot()

    @property
    def version(self) -> Version:
        """The version of the firmware that runs; it needs no host on the bus."""
        return Version(*self.emulator.running.info().firmware)

    @property
    def faults(self) -> Fault:
        return self.status().faults


@pytest.fixture
def device() -> Iterator[Upgraded]:
    with Emulator() as emulator:
        yield Upgraded(emulator)


# Kept in a file


def kept(path: Path) -> Version:
    """The version that a device would run with a file's flash."""
    flash = Flash.load(path)
    flash.power_up(Scheduler())
    return loader.boot(flash).image.version


def test_a_flash_in_a_file_is_what_a_power_cut_would_leave(tmp_path: Path) -> None:
    path = tmp_path / "flash.bin"
    with Emulator() as emulator:
        loader.keep(emulator.flash, path, print)
        device = Upgraded(emulator)
        device.enter_dfu_mode()
        pieces = [IMAGE[at : at + BLOCK] for at in range(0, len(IMAGE), BLOCK)]
        for number, piece in enumerate(pieces):
            device.dfu_out(1, number, piece)
            device.poll()
            assert kept(path) == FACTORY
        device.dfu_out(1, len(pieces))
        assert device.poll().state is DfuState.DFU_IDLE
        assert kept(path) == NEW
        device.boot()
        device.configure()
        device.run_ms(20)
        assert Flash.load(path).read(0, FLASH_BYTES) == emulator.flash.read(0, FLASH_BYTES)


def test_a_full_disk_is_reported_and_the_device_goes_on(tmp_path: Path) -> None:
    told: list[OSError] = []
    with Emulator() as emulator:
        loader.keep(emulator.flash, tmp_path / "flash.bin", told.append)
        emulator.flash.save = Mock(side_effect=OSError(28, "No space left on device"))  # type: ignore[method-assign]  # stands for the disk
        Upgraded(emulator).upgrade(IMAGE)
        assert told
        assert Upgraded(emulator).version == NEW
