"""New firmware through the device's own USB port, and what runs after every way of losing power (chapters FWU, DFU)."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from phasewire import Emulator
from phasewire.emulator.door import Stall
from phasewire.emulator.faults import DeadProcessor
from phasewire.emulator.firmware import loader
from phasewire.emulator.firmware.flash import FLASH_BYTES, Flash
from phasewire.emulator.firmware.loader import FACTORY_IMAGE
from phasewire.emulator.scheduler import Scheduler
from phasewire.errors import DeviceError
from phasewire.protocol import descriptors
from phasewire.protocol.blocks import Entries, Entry, Sequence, Slot, Update
from phasewire.protocol.codes import Bank, DfuState, DfuStatus, Fault, Outcome, Request, State, Target
from phasewire.protocol.dfu import DfuReply
from phasewire.protocol.firmware import Image, Segment, build, split_suffix
from phasewire.protocol.replies import decode_reports
from phasewire.protocol.requests import Setup
from phasewire.protocol.versions import Version

from tests.emulator.hosts import FULL, Device, Terminal

OUT, IN = 0x21, 0xA1
BLOCK = 2048
FACTORY = FACTORY_IMAGE.version


def made(version: Version, size: int = 9000) -> bytes:
    """What is sent of the file of an image."""
    body = np.random.default_rng(version.bcd).bytes(size)
    file = build(Image(version, (Segment(Target.ALL_PROCESSORS, body), Segment(Target.CONTROLLER, body[:70]))))
    return split_suffix(file)[0]


NEW, NEWER = Version(2, 3, 4), Version(2, 3, 5)
IMAGE, LATER_IMAGE = made(NEW), made(NEWER)


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

    def read_image(self) -> bytes:
        blocks = []
        for number in range(400):
            blocks.append(self.usb.control(Setup(IN, 2, number, 0, BLOCK)))
            if len(blocks[-1]) < BLOCK:
                self.dfu_out(6)
                return b"".join(blocks)
        raise AssertionError

    # Between the modes

    def descriptor(self) -> descriptors.Device:
        (found,) = descriptors.descriptors(self.usb.control(Setup(0x80, 6, 0x0100, 0, 18)))
        assert isinstance(found, descriptors.Device)
        return found

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

    def lose_power(self) -> None:
        """Off and on, with nobody on the bus."""
        self.emulator.power_down()
        self.run_ms(5)
        self.emulator.power_up()
        self.emulator.run_until_started()

    @property
    def version(self) -> Version:
        """Of the firmware that runs, as a serial line tells it without being asked by the host's configuration."""
        return Version(*self.emulator.running.info().firmware)

    @property
    def faults(self) -> Fault:
        return self.status().faults


@pytest.fixture
def device() -> Iterator[Upgraded]:
    with Emulator() as emulator:
        yield Upgraded(emulator)


# There and back


def test_a_device_goes_to_dfu_mode_and_comes_back(device: Upgraded) -> None:
    """Clauses DFU-002 and USB-013: 10 to 1000 ms after DETACH it leaves, for at least 10 ms."""
    found = device.descriptor()
    assert (found.idVendor, found.idProduct, found.bDeviceClass) == (0x1209, 0x0001, 0xEF)
    device.order(Request.ENABLE)
    device.send(Update(FULL))
    device.run(8)
    generation, asked = device.usb.generation, device.cycle
    device.detach()
    assert device.usb.control(Setup(IN, 5, 0, 3, 1)) == bytes([DfuState.APP_DETACH])
    while device.usb.attached:
        device.run(1)
    left = device.cycle
    assert 10 <= (left - asked) / 400_000 <= 1000
    assert max(device.high_periods()) < asked // 10_000 + 6
    device.come_back()
    assert (device.cycle - left) / 400_000 >= 10
    assert device.usb.generation == generation + 1
    found = device.descriptor()
    assert (found.idVendor, found.idProduct, found.bDeviceClass) == (0x1209, 0x0002, 0x00)
    with pytest.raises(Stall):
        device.info()
    device.usb.reset()
    device.usb.reset()  # enumeration
    device.configure()
    assert device.usb.control(Setup(IN, 5, 0, 0, 1)) == bytes([DfuState.DFU_IDLE])
    with pytest.raises(Stall):
        device.info()
    device.boot()
    assert device.usb.generation == generation + 2
    assert device.descriptor().idProduct == 0x0001
    device.configure()
    assert (device.state, device.info().firmware, device.faults) == (State.OFF, tuple(FACTORY), Fault(0))


def test_a_bus_reset_hastens_it(device: Upgraded) -> None:
    device.detach()
    device.usb.reset()
    assert not device.usb.attached
    device.come_back()
    assert device.descriptor().idProduct == 0x0002


def test_it_stays_in_dfu_mode_however_long_nobody_asks(device: Upgraded) -> None:
    """Clause DFU-016."""
    device.enter_dfu_mode()
    device.run_ms(100_000)
    assert device.usb.control(Setup(IN, 5, 0, 0, 1)) == bytes([DfuState.DFU_IDLE])


def test_a_serial_line_leads_there_too(device: Upgraded) -> None:
    shown = Terminal(device.emulator.line).type("dfu")
    assert shown == "dfu\r\nok\r\n> "
    device.come_back()
    assert device.descriptor().idProduct == 0x0002
    assert device.emulator.line is None
    device.configure()
    device.boot()
    assert Terminal(device.emulator.line).type("version").splitlines()[-2:] == ["ok", "> "]


# New firmware


def test_new_firmware_boots_says_its_version_and_stays(device: Upgraded) -> None:
    """Clauses FWU-004, FWU-020 and USB-008: once a host has configured it, it is there for good."""
    device.upgrade(IMAGE)
    assert device.descriptor().bcdDevice == 0x0234
    device.configure()
    assert device.info().firmware == (2, 3, 4)
    reports = decode_reports(device.ask(Request.PROCESSORS, 160))
    assert {(report.firmware, report.bank) for report in reports} == {((2, 3, 4), Bank.A)}
    device.run_ms(5)
    for _ in range(2):
        device.lose_power()
        assert (device.version, device.faults) == (NEW, Fault(0))


def test_new_firmware_that_no_host_met_is_given_up(device: Upgraded) -> None:
    """Clause FWU-020: one trial; then the one before, and the fault FLASH."""
    device.upgrade(IMAGE)
    assert device.version == NEW
    device.run_ms(1000)
    device.lose_power()
    assert (device.version, device.faults) == (FACTORY, Fault.FLASH)
    device.configure()
    device.order(Request.CLEAR_FAULTS)
    assert device.faults == Fault.FLASH  # until RESET or power-up
    assert device.state is State.OFF  # it silences nothing
    device.lose_power()
    assert (device.version, device.faults) == (FACTORY, Fault.FLASH)


def test_a_reset_is_a_trial_that_failed_like_a_loss_of_power(device: Upgraded) -> None:
    device.upgrade(IMAGE)
    terminal = Terminal(device.emulator.line)
    device.emulator.restart()
    device.emulator.run_until_started()
    assert device.version == FACTORY
    assert terminal.line is not device.emulator.line


@pytest.mark.parametrize("frames", [False, True])
def test_a_word_on_a_serial_line_is_enough_to_stay(device: Upgraded, frames: bool) -> None:
    device.upgrade(IMAGE)
    terminal = Terminal(device.emulator.line)
    if frames:
        terminal.enter_frames()
        assert terminal.order(Request.DISABLE) is Outcome.DONE
    else:
        terminal.type("clock")
    device.run_ms(5)
    device.lose_power()
    assert device.version == NEW


def test_a_mark_that_is_being_written_when_the_device_is_reset_is_finished(device: Upgraded) -> None:
    """Clause DFU-015 says so of DFU mode; a flash knows no difference."""
    device.upgrade(IMAGE)
    device.configure()
    assert device.emulator.flash.busy
    device.order(Request.RESET)
    device.run_until_started()
    assert device.version == NEW


def test_a_mark_that_power_cut_short_counts(device: Upgraded) -> None:
    """Clause FWU-020: as soon as one of its bits is 0; one that was not begun does not."""
    device.upgrade(IMAGE)
    device.configure()
    device.run_ms(0.9)
    device.lose_power()
    assert device.version == NEW


def test_new_firmware_that_does_not_find_all_processors_has_not_come_up(device: Upgraded) -> None:
    """Clause FWU-020: a host has met it, but nine processors are not ten."""
    device.enter_dfu_mode()
    device.send_image(IMAGE)
    device.emulator.inject(DeadProcessor(processor=5))
    device.boot()
    device.configure()
    assert (device.version, device.state, device.faults) == (NEW, State.FAULT, Fault.PROCESSOR)
    device.lose_power()
    assert (device.version, device.faults) == (FACTORY, Fault.PROCESSOR | Fault.FLASH)


def test_upgrades_take_turns_between_the_banks(device: Upgraded) -> None:
    for image, version, bank in ((IMAGE, NEW, Bank.A), (LATER_IMAGE, NEWER, Bank.B), (IMAGE, NEW, Bank.A)):
        device.upgrade(image)
        device.configure()
        device.run_ms(5)
        reports = decode_reports(device.ask(Request.PROCESSORS, 160))
        assert (device.version, reports[0].bank, device.faults) == (version, bank, Fault(0))


def test_a_second_upgrade_that_never_came_up_leaves_the_first(device: Upgraded) -> None:
    device.upgrade(IMAGE)
    device.configure()
    device.run_ms(5)
    device.upgrade(LATER_IMAGE)
    assert device.version == NEWER
    device.lose_power()
    assert (device.version, device.faults) == (NEW, Fault.FLASH)


def test_what_would_boot_is_read_back(device: Upgraded) -> None:
    """Clause DFU-014."""
    device.enter_dfu_mode()
    assert device.read_image() == FACTORY_IMAGE.encode()
    device.send_image(IMAGE)
    assert device.read_image() == IMAGE


@pytest.mark.parametrize("blocks", range(1, 5))
def test_a_download_that_power_cut_short_leaves_what_ran(device: Upgraded, blocks: int) -> None:
    """Clause FWU-018; in the middle of a block that is being written, too."""
    device.enter_dfu_mode()
    device.send_image(IMAGE, blocks)
    device.dfu_out(1, blocks, IMAGE[blocks * BLOCK : (blocks + 1) * BLOCK])
    device.dfu_status()
    device.run_ms(2.5)
    assert device.emulator.flash.busy
    device.lose_power()
    assert (device.version, device.faults) == (FACTORY, Fault(0))
    device.configure()
    device.upgrade(LATER_IMAGE)
    assert device.version == NEWER


def test_a_write_that_power_cut_short_stays_half_done(device: Upgraded) -> None:
    device.enter_dfu_mode()
    device.dfu_out(1, 0, IMAGE[:BLOCK])
    device.dfu_status()
    device.run_ms(120.5)  # the sectors are erased, and the first page is under way
    device.lose_power()
    written = device.emulator.flash.read(Bank.A.image_address, 256)
    assert IMAGE[:20] == written[:20]
    assert written != IMAGE[:256]


@pytest.mark.parametrize("blocks", range(1, 6))
def test_a_download_that_a_bus_reset_cut_short_leaves_what_ran(device: Upgraded, blocks: int) -> None:
    device.enter_dfu_mode()
    device.send_image(IMAGE, blocks)
    device.dfu_out(1, blocks, IMAGE[blocks * BLOCK : (blocks + 1) * BLOCK])
    device.dfu_status()
    device.boot()
    device.run_ms(3000)  # longer than all that was under way
    device.configure()
    assert (device.version, device.faults) == (FACTORY, Fault(0))


def test_a_bus_reset_in_mid_write_lets_the_flash_finish(device: Upgraded) -> None:
    """Clause DFU-015: it boots once the flash is idle."""
    device.enter_dfu_mode()
    device.dfu_out(1, 0, IMAGE[:BLOCK])
    assert device.dfu_status().poll_ms == 128
    until = device.emulator.flash.busy_until
    device.usb.reset()
    device.emulator.run_until_started()
    assert device.emulator.scheduler.now >= until


def test_a_bad_image_is_refused_and_changes_nothing(device: Upgraded) -> None:
    device.enter_dfu_mode()
    bad = bytearray(IMAGE)
    bad[5000] ^= 1
    for number, at in enumerate(range(0, len(bad), BLOCK)):
        device.dfu_out(1, number, bytes(bad[at : at + BLOCK]))
        device.poll()
    device.dfu_out(1, 9)
    reply = device.poll()
    assert (reply.status, reply.state) == (DfuStatus.FILE, DfuState.ERROR)
    assert device.usb.control(Setup(0x80, 6, 0x0300 + reply.string, 0x0409, 255))
    device.boot()
    assert (device.version, device.faults) == (FACTORY, Fault(0))


# Back to the factory's image


def upgraded_twice(device: Upgraded) -> None:
    """Firmware in both banks, each of which has come up; the newer runs."""
    for image in (IMAGE, LATER_IMAGE):
        device.upgrade(image)
        device.configure()
        device.run_ms(5)


@pytest.mark.parametrize("state", [State.OFF, State.PLAYING, State.UNATTENDED, State.FAULT])
def test_a_device_reverts_to_the_factory_s_image_in_any_state(device: Upgraded, state: State) -> None:
    """Clauses REQ-014 and FWU-022: answered, then as after a reset, two pages later."""
    upgraded_twice(device)
    if state is State.FAULT:
        device.emulator.running.raise_fault(Fault.SUPPLY, "for this test")
    elif state is not State.OFF:
        device.order(Request.ENABLE)
        device.send(Slot(0, FULL))
        device.send(Entries((Entry(0, 100),)))
        device.send(Sequence(0, 1, unattended=state is State.UNATTENDED))
        device.run(20)
    assert device.state is state
    generation = device.usb.generation
    device.order(Request.REVERT)
    assert device.usb.attached  # the request is answered first
    device.run_ms(0.2)
    assert not device.usb.attached
    left = device.emulator.scheduler.now
    device.run_until_started()
    assert 1.8 < (device.emulator.scheduler.now - left) / 400_000 < 2.5
    assert (device.usb.generation, device.descriptor().bcdDevice) == (generation + 1, FACTORY.bcd)
    device.configure()
    reports = decode_reports(device.ask(Request.PROCESSORS, 160))
    assert {(report.firmware, report.bank) for report in reports} == {(tuple(FACTORY), Bank.FACTORY)}
    assert (device.state, device.faults, device.status().accepted) == (State.OFF, Fault(0), 0)
    device.lose_power()
    assert (device.version, device.faults) == (FACTORY, Fault(0))
    device.configure()
    device.upgrade(IMAGE)
    assert device.version == NEW


def test_a_serial_line_reverts_too_once_it_has_answered(device: Upgraded) -> None:
    """Clause SER-010; the firmware is confirmed by the same answer, and still given up."""
    device.upgrade(IMAGE)
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    assert terminal.order(Request.REVERT) is Outcome.DONE
    assert device.emulator.flash.busy
    device.run_until_started()
    assert (device.version, device.faults) == (FACTORY, Fault(0))
    assert device.emulator.line is not terminal.line


def test_firmware_that_never_came_up_is_given_up_and_forgotten(device: Upgraded) -> None:
    """The fault FLASH goes with it."""
    device.upgrade(IMAGE)
    device.lose_power()
    device.configure()
    assert (device.version, device.faults) == (FACTORY, Fault.FLASH)
    device.order(Request.REVERT)
    device.run_until_started()
    assert (device.version, device.faults) == (FACTORY, Fault(0))


@pytest.mark.parametrize("ms", [0.05, 0.2, 0.6, 1.05, 1.2, 1.6, 2.05, 2.2])
def test_power_that_fails_on_the_way_leaves_what_ran_or_the_factory_s_image(device: Upgraded, ms: float) -> None:
    upgraded_twice(device)
    device.order(Request.REVERT)
    device.run_ms(ms)
    device.lose_power()
    assert device.version in (NEWER, FACTORY)
    assert (device.version == NEWER) == (ms <= 1.05)


def test_power_that_fails_at_each_written_byte_does_too() -> None:
    with Emulator() as emulator:
        upgraded_twice(Upgraded(emulator))
        content = emulator.flash.read(0, FLASH_BYTES)
    for written in range(0, 97, 8):
        device = Upgraded(Emulator(flash=Flash(content)))
        assert device.version == NEWER
        device.emulator.flash.cut_power_after(written, device.emulator.power_down)
        device.order(Request.REVERT)
        device.run_ms(5)
        assert device.emulator.powered == (written == 96)
        device.lose_power()
        assert device.version in ((NEWER, FACTORY) if written <= 50 else (FACTORY,))
        assert device.faults == Fault(0)


def test_a_flash_that_takes_nothing_leaves_what_ran(device: Upgraded) -> None:
    upgraded_twice(device)
    device.emulator.flash.defects.write_protected = True
    device.order(Request.REVERT)
    device.run_until_started()
    device.configure()
    reports = decode_reports(device.ask(Request.PROCESSORS, 160))
    assert (device.version, reports[0].bank, device.faults) == (NEWER, Bank.B, Fault(0))


def test_where_nothing_was_upgraded_it_is_a_reset(device: Upgraded) -> None:
    device.order(Request.REVERT)
    device.run_until_started()
    assert (device.version, device.faults) == (FACTORY, Fault(0))
    assert not device.emulator.flash.erasures.any()


# Without new firmware


def test_a_reset_begins_everything_anew(device: Upgraded) -> None:
    """Clause REQ-013: counts, stores, watchdog time and drive limit; the bus sees it leave and come."""
    generation = device.usb.generation
    device.send(Slot(0, FULL))
    device.order(Request.WATCHDOG, 500)
    device.order(Request.LIMIT, 100)
    device.order(Request.ENABLE)
    device.run(400)
    device.order(Request.RESET)
    assert device.usb.attached  # the request is answered first
    device.run_until_started()
    assert (device.usb.generation, device.usb.configuration) == (generation + 1, 0)
    status = device.status()
    assert (status.state, status.accepted, status.watchdog_ms, status.drive_limit) == (State.OFF, 0, 100, 320)
    assert device.period == 0
    assert len(device.emulator.past) == 1


def test_a_device_without_power_is_not_on_the_bus(device: Upgraded) -> None:
    device.order(Request.ENABLE)
    device.send(Update(FULL))
    device.run(10)
    device.emulator.power_down()
    assert (device.usb.attached, device.emulator.line, device.emulator.controller) == (False, None, None)
    device.run_ms(1000)
    with pytest.raises(ValueError, match="has no power"):
        device.emulator.run(1)
    with pytest.raises(DeviceError, match="has no power"):
        device.emulator.run_until_started()
    device.emulator.power_up()
    device.emulator.run_until_started()
    assert device.usb.attached
    device.run(100)
    assert device.high_periods() == set()
    (before,) = device.emulator.past
    assert before.bits(0, before.end_tick).any()


# Kept in a file


def kept(path: Path) -> Version:
    """What a device would run with the flash that a file holds now."""
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


def test_a_device_that_is_killed_after_an_upgrade_has_it(tmp_path: Path) -> None:
    path = tmp_path / "flash.bin"
    script = (
        "import os, sys; from pathlib import Path; from phasewire import Emulator; "
        "from phasewire.emulator.firmware.loader import keep; from tests.emulator.test_upgrade import IMAGE, Upgraded; "
        "emulator = Emulator().__enter__(); keep(emulator.flash, Path(sys.argv[1]), print); "
        "device = Upgraded(emulator); device.enter_dfu_mode(); device.send_image(IMAGE); os.kill(os.getpid(), 9)"
    )
    root = Path(__file__).parents[2]
    ended = subprocess.run([sys.executable, "-c", script, path], cwd=root, stderr=subprocess.PIPE, check=False)
    assert (ended.returncode, ended.stderr) == (-9, b"")
    assert kept(path) == NEW


def test_a_full_disk_is_told_and_stops_no_device(tmp_path: Path) -> None:
    told: list[OSError] = []
    with Emulator() as emulator:
        loader.keep(emulator.flash, tmp_path / "flash.bin", told.append)
        emulator.flash.save = Mock(side_effect=OSError(28, "No space left on device"))  # type: ignore[method-assign]  # stands for the disk
        Upgraded(emulator).upgrade(IMAGE)
        assert told
        assert Upgraded(emulator).version == NEW
