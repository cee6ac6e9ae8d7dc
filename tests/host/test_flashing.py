"""One image to one device, whole or not at all, whatever happens on the way (chapters FWU and DFU)."""

from __future__ import annotations

import dataclasses
import errno
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import usb.core
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from phasewire import Emulator, open_device
from phasewire.base.errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceRefusedError,
    DeviceStalledError,
    ImageError,
    InputFileError,
)
from phasewire.emulator import faults
from phasewire.emulator.door import Stall
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.emulator.faults import InjectedFault
from phasewire.emulator.firmware.flash import Flash
from phasewire.emulator.firmware.loader import FACTORY_IMAGE, Boot, boot
from phasewire.host.firmware import flashing
from phasewire.host.firmware.dfu import DfuLine, detach
from phasewire.host.firmware.flashing import ATTEMPTS, FlashReport, FlashStage, find_flashable, revert
from phasewire.host.firmware.images import read_firmware
from phasewire.host.transports.usb_find import DFU_MODE, UsbFinder
from phasewire.protocol.blocks import Update
from phasewire.protocol.codes import Bank, DfuStatus, Fault, Feature, ImageReason, Request, State
from phasewire.protocol.firmware import Suffix, Trust, build, sign, split_suffix, with_suffix
from phasewire.protocol.replies import Info
from phasewire.protocol.requests import Setup
from phasewire.protocol.versions import Version

from tests.emulator.hosts import FULL, Device
from tests.host.upgrades import (
    BLOCK,
    BLOCKS,
    FACTORY,
    FILE,
    KEY,
    NEW,
    NEWER,
    OLD,
    SECTOR,
    STORED,
    STRANGER,
    WRITTEN,
    booted,
    in_dfu_mode,
    made,
    running,
    trusting,
    untouched,
)

OURS = Suffix(0x1209, 0x0001, 0x0234)
PUBLIC = KEY.public_key()
Step = tuple[FlashStage, int, int]


def flash(url: str, file: Path | bytes, keys: Iterable[Ed25519PublicKey] = (), **options: Any) -> FlashReport:
    """Send what is in a file."""
    return flashing.flash(url, read_firmware(file, keys), **options)


# Upgrades that succeed


def test_an_upgrade_as_a_whole(emulator: Emulator) -> None:
    steps: list[Step] = []
    report = flash(emulator.url, FILE, on_progress=lambda *step: steps.append(step))
    assert (report.before, report.firmware, report.bank) == (FACTORY, NEW.version, Bank.A)
    assert (report.trust, report.written, report.attempts) == (Trust.UNSIGNED, True, 1)
    assert report.device.endswith(emulator.serial)
    assert running(emulator) == (NEW.version, Bank.A)
    assert emulator.flash.read(Bank.A.image_address, len(STORED)) == STORED
    assert emulator.running.status().state is State.OFF
    written = [done for stage, done, total in steps if (stage, total) == (FlashStage.WRITE, len(STORED))]
    assert written == [*range(BLOCK, len(STORED), BLOCK), len(STORED)]
    assert [done for stage, done, _ in steps if stage is FlashStage.CHECK] == written
    assert list(dict.fromkeys(stage for stage, *_ in steps)) == list(FlashStage)
    assert booted(emulator) == NEW.version  # it has come up, and stays


def test_an_image_that_is_there_already_is_compared_with_progress_and_not_sent_again(emulator: Emulator) -> None:
    flash(emulator.url, FILE)
    erasures = emulator.flash.erasures.copy()
    steps: list[Step] = []
    report = flash(emulator.url, FILE, on_progress=lambda *step: steps.append(step))
    assert (report.written, report.bank, report.firmware) == (False, Bank.A, NEW.version)
    np.testing.assert_array_equal(emulator.flash.erasures, erasures)
    ends = [*range(0, len(STORED), BLOCK), len(STORED)]
    assert [step[1:] for step in steps if step[0] is FlashStage.COMPARE] == [(done, len(STORED)) for done in ends]
    assert [stage for stage, *_ in steps if stage is not FlashStage.COMPARE] == [FlashStage.DETACH, FlashStage.BOOT]


def test_the_outputs_are_off_throughout(emulator: Emulator) -> None:
    device = Device(emulator, enabled=True)
    device.send(Update(FULL))
    device.run(40)
    asked = emulator.scheduler.now
    flash(emulator.url, FILE)
    before, after = emulator.past[0], emulator.capture()
    silent = asked // 200 + 50 * 40  # in 1 ms it is asked, and silent six periods later (SAF-004)
    assert before.bits(0, silent).any()
    for capture, begin in ((before, silent), (before, before.end_tick - 5000), (after, 0)):
        assert not capture.bits(begin, min(begin + 5000, capture.end_tick)).any()


def test_the_url_names_the_device_and_others_are_left_alone() -> None:
    with Emulator(serial="A") as a, Emulator(serial="B") as b:
        flash("emulator:B", FILE)
        assert untouched(a)
        assert running(b) == (NEW.version, Bank.A)
        with pytest.raises(DeviceNotFoundError, match="no device at 'emulator:C': there are 'A', 'B'"):
            flash("emulator:C", FILE)
        with pytest.raises(DeviceNotFoundError, match="2 devices; name one: emulator:A or emulator:B"):
            flash("emulator:1209:0001", FILE)
        with pytest.raises(DeviceNotFoundError, match="nothing is plugged in"):
            flash("emulator:1209:0003", FILE)
    with Emulator(serial="C") as c:
        assert flash("emulator:1209:0001", FILE).firmware == NEW.version
        assert running(c) == (NEW.version, Bank.A)


# Refused before any loss


def damaged(file: bytes, at: int) -> bytes:
    """With a flipped bit, and a suffix that is right all the same."""
    stored = bytearray(split_suffix(file)[0])
    stored[at] ^= 0x10
    return with_suffix(bytes(stored), OURS)


FORGED = with_suffix(sign(NEW, KEY).encode()[:-1] + bytes([sign(NEW, KEY).encode()[-1] ^ 1]), OURS)


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        (STORED, ImageReason.SUFFIX),
        (FILE[:-1] + bytes([FILE[-1] ^ 1]), ImageReason.SUFFIX),
        (b"", ImageReason.SUFFIX),
        (with_suffix(STORED, Suffix(0x1209, 0x0007, 0xFFFF)), ImageReason.SUFFIX),
        (with_suffix(STORED, Suffix(0x0483, 0x0001, 0xFFFF)), ImageReason.SUFFIX),
        (damaged(FILE, 0), ImageReason.MAGIC),
        (damaged(FILE, 9), ImageReason.CHECKSUM),
        (damaged(FILE, 5000), ImageReason.HASH),
        (with_suffix(STORED[:-1], OURS), ImageReason.TOTAL),
    ],
)
def test_a_file_that_is_not_for_this_device_never_reaches_it(
    emulator: Emulator, file: bytes, reason: ImageReason
) -> None:
    with pytest.raises(ImageError) as refused:
        flash(emulator.url, file)
    assert refused.value.reason == reason
    assert untouched(emulator)


@pytest.mark.parametrize("file", [FILE, build(NEW, STRANGER), FORGED])
def test_with_keys_only_what_they_signed_is_sent(emulator: Emulator, file: bytes) -> None:
    """Clause FWU-012."""
    with pytest.raises(ImageError) as refused:
        flash(emulator.url, file, keys=[PUBLIC])
    assert refused.value.reason == ImageReason.SIGNATURE
    assert untouched(emulator)
    assert flash(emulator.url, build(NEW, KEY), keys=[PUBLIC]).trust is Trust.SIGNED


def test_an_older_image_needs_permission(emulator: Emulator) -> None:
    """Clause FWU-013; in DFU mode bcdDevice says what ran."""
    flash(emulator.url, FILE)
    generation = emulator.usb.generation
    older = build(OLD)
    with pytest.raises(InputFileError, match=r"version 1\.3\.4, older than the 2\.3\.4 of .*--allow-downgrade"):
        flash(emulator.url, older)
    assert emulator.usb.generation == generation
    Left(emulator)
    with pytest.raises(InputFileError, match=r"older than the 2\.3\.4"):
        flash(emulator.url, older)
    assert in_dfu_mode(emulator)
    assert flash(emulator.url, older, allow_downgrade=True).before == NEW.version
    assert running(emulator) == (OLD.version, Bank.B)


def test_an_image_of_another_protocol_needs_permission(emulator: Emulator) -> None:
    later = build(made(4, protocol=2))
    with pytest.raises(InputFileError, match="version 2 of the protocol, this program version 1"):
        flash(emulator.url, later)
    assert untouched(emulator)
    assert flash(emulator.url, later, allow_other_protocol=True).firmware == Version(4, 3, 4)


def saying(monkeypatch: pytest.MonkeyPatch, **fields: object) -> None:
    """Let devices say something else of themselves."""
    genuine = Info.encode
    monkeypatch.setattr(Info, "encode", lambda info: genuine(dataclasses.replace(info, **fields)))


def test_other_hardware_is_refused(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    saying(monkeypatch, hardware=7)
    with pytest.raises(ImageError, match=r"FIVE_BOARDS, and .* is 7") as refused:
        flash(emulator.url, FILE)
    assert refused.value.reason == ImageReason.HARDWARE
    assert untouched(emulator)


def test_a_device_without_firmware_upgrade_is_refused_with_the_reason(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    saying(monkeypatch, features=Feature.SEQUENCES)
    with pytest.raises(DeviceError, match="lacks the feature DFU"):
        flash(emulator.url, FILE)
    assert untouched(emulator)


def test_a_device_that_is_used_by_another_program_is_not_disturbed(emulator: Emulator) -> None:
    with open_device(emulator.url) as other:
        other.enable()
        with pytest.raises(DeviceAccessError, match="another program is using the device"):
            flash(emulator.url, FILE)
        with pytest.raises(DeviceAccessError, match="another program is using the device"):
            revert(emulator.url)
        assert untouched(emulator)
        assert other.status().enabled


def test_two_programs_do_not_flash_one_device(emulator: Emulator) -> None:
    bus = UsbFinder(emulator.url)
    seen = bus.find()
    detach(seen)
    with DfuLine(bus.find_again(seen, (DFU_MODE,), 2)) as first:
        first.make_idle()
        with pytest.raises(DeviceAccessError, match="another program is using the device"):
            flash(emulator.url, build(NEWER))
        with pytest.raises(DeviceAccessError, match="another program is using the device"):
            revert(emulator.url)
        first.download(STORED)
        first.boot()
    report = flash(emulator.url, FILE)
    assert (report.written, report.attempts) == (False, 1)


# Refused by the device


def test_a_device_with_keys_says_why_it_refuses(tmp_path: Path) -> None:
    """Clause DFU-012: in the words of the device."""
    with Emulator(flash=trusting(KEY)) as emulator:
        with pytest.raises(DeviceRefusedError, match="refuses the image: the signature is wrong, or the device") as no:
            flash(emulator.url, FILE)
        assert no.value.reason is ImageReason.SIGNATURE
        assert running_after_a_look(emulator) == FACTORY
        assert flash(emulator.url, build(NEW, KEY)).firmware == NEW.version


def running_after_a_look(emulator: Emulator) -> Version:
    """The firmware of a device that was ordered to boot and may not have come back yet."""
    assert not in_dfu_mode(emulator)
    emulator.run_until_started()
    return Version(*emulator.running.info().firmware)


FLASH_FAULTS: list[tuple[InjectedFault, DfuStatus]] = [
    (faults.WriteProtectedFlash(), DfuStatus.WRITE),
    (faults.FailingSector(sector=0x200), DfuStatus.ERASE),
    (faults.FailingSector(sector=0x202), DfuStatus.ERASE),
    (faults.StuckFlashBit(address=0x201000 + 4000, bit=0, value=0), DfuStatus.CHECK_ERASED),
    (faults.FailingPage(page=0x2012), DfuStatus.PROG),
    (faults.FailingPage(page=0x2000), DfuStatus.PROG),
    (faults.StuckFlashBit(address=0x201000 + 7777, bit=3, value=1), DfuStatus.VERIFY),
]


@pytest.mark.parametrize(("fault", "status"), FLASH_FAULTS)
def test_a_flash_that_fails_is_no_reason_to_try_again(
    emulator: Emulator, fault: InjectedFault, status: DfuStatus
) -> None:
    if status is DfuStatus.VERIFY:
        address = fault.address  # type: ignore[attr-defined]
        assert not STORED[address - 0x201000] & 1 << 3
    emulator.inject(fault)
    with pytest.raises(DeviceRefusedError, match=f"could not write its flash .{status.name}.: ") as refused:
        flash(emulator.url, FILE)
    assert refused.value.reason is status
    assert running_after_a_look(emulator) == FACTORY


def test_a_flash_that_forgets_is_found_by_reading_back(emulator: Emulator) -> None:
    """One byte of block 3, which is right when the device itself looks at it."""
    genuine = EmulatorBackend.ctrl_transfer
    with pytest.MonkeyPatch.context() as patch:
        spoilt: list[int] = []

        def upload(self: EmulatorBackend, handle: object, kind: int, request: int, value: int, *rest: object) -> int:
            count: int = genuine(self, handle, kind, request, value, *rest)  # type: ignore[arg-type]
            if (kind, request, value) == (0xA1, 2, 3) and not spoilt:
                rest[1][0] ^= 1  # type: ignore[index]
                spoilt.append(value)
            return count

        patch.setattr(EmulatorBackend, "ctrl_transfer", upload)
        with pytest.raises(DeviceError, match="would not boot what it was sent"):
            flash(emulator.url, FILE)
    assert spoilt == [3]
    assert flash(emulator.url, FILE).written is False


# Lines that fail


def plug_in(emulator: Emulator) -> None:
    """Plug the cable in; a computer enumerates the device, which ends DFU mode (clause DFU-015)."""
    emulator.usb.plug()
    find_flashable(emulator.url)
    emulator.run_until_started()


def striking(
    emulator: Emulator, fault: InjectedFault, stage: FlashStage, at: int = 0, times: int = 1
) -> Callable[..., None]:
    """A listener to progress that lets a fault happen once a stage has got so far."""
    left = [times]

    def listen(now: FlashStage, done: int, _: int) -> None:
        if now is stage and done >= at and left[0]:
            left[0] -= 1
            emulator.inject(fault)

    return listen


SHORT = 40 * 200
"""Periods: 200 ms."""
INTERRUPTIONS: list[InjectedFault] = [
    faults.Unplugged(periods=SHORT),
    faults.PowerCut(periods=SHORT),
    faults.BusReset(),
    faults.BusSuspended(periods=SHORT),
    faults.SilentHost(periods=SHORT),
]


@pytest.mark.parametrize("stage", FlashStage)
@pytest.mark.parametrize("fault", INTERRUPTIONS, ids=lambda fault: fault.name())
def test_a_line_that_fails_for_a_moment_is_tried_again(
    emulator: Emulator, fault: InjectedFault, stage: FlashStage
) -> None:
    listen = striking(emulator, fault, stage, at=2 * BLOCK if stage in (FlashStage.WRITE, FlashStage.CHECK) else 0)
    report = flash(emulator.url, FILE, on_progress=listen)
    assert report.attempts <= 2
    assert report.firmware == NEW.version
    assert running(emulator)[0] == NEW.version
    assert booted(emulator) == NEW.version


@pytest.mark.parametrize("fault", [faults.Unplugged(), faults.PowerCut(), faults.PowerCutInWrite(written_bytes=9999)])
def test_a_device_that_does_not_come_back_is_given_up(emulator: Emulator, fault: InjectedFault) -> None:
    began = emulator.scheduler.now
    with pytest.raises(DeviceLostError, match="has not come back in run time or DFU mode within 10 s; switch it off"):
        flash(emulator.url, FILE, on_progress=striking(emulator, fault, FlashStage.DETACH))
    assert (emulator.scheduler.now - began) / 400e6 < 25
    emulator.power_up()
    plug_in(emulator)
    assert flash(emulator.url, FILE).firmware == NEW.version


def test_a_line_that_fails_again_and_again_is_given_up(emulator: Emulator) -> None:
    listen = striking(emulator, faults.Unplugged(periods=SHORT), FlashStage.WRITE, times=100)
    with pytest.raises(DeviceLostError, match=rf"is gone.*\(tried {ATTEMPTS} times\)\. It boots its old") as given_up:
        flash(emulator.url, FILE, on_progress=listen)
    assert type(given_up.value.__cause__) is DeviceLostError
    assert "tried" not in str(given_up.value.__cause__)
    plug_in(emulator)
    assert flash(emulator.url, FILE).attempts == 1


def test_a_device_that_does_not_detach_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phasewire.emulator.interfaces.usb_device.UsbDevice._leave_for_dfu", lambda *_: None)
    with Emulator() as emulator:
        began = emulator.scheduler.now
        with pytest.raises(DeviceStalledError, match="go to DFU mode"):  # the second time it is asked
            flash(emulator.url, FILE)
        assert (emulator.scheduler.now - began) / 400e6 < 25
        assert not emulator.flash.erasures.any()


def test_ctrl_c_leaves_a_device_that_runs_what_it_ran(emulator: Emulator) -> None:
    def interrupt(stage: FlashStage, done: int, _: int) -> None:
        if stage is FlashStage.WRITE and done > BLOCK:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flash(emulator.url, FILE, on_progress=interrupt)
    assert running_after_a_look(emulator) == FACTORY
    assert flash(emulator.url, FILE).firmware == NEW.version


# From whatever state


class Left:
    """A device in DFU mode, which a host leaves in some state."""

    def __init__(self, emulator: Emulator) -> None:
        self.emulator = emulator
        Device(emulator).detach()
        while not in_dfu_mode(emulator):
            self.wait(1)
        find_flashable(emulator.url)  # a computer that enumerates it, as it does only once
        emulator.usb.control(Setup(0x00, 9, 1, 0, 0))

    def out(self, request: int, value: int = 0, data: bytes = b"") -> None:
        self.emulator.usb.control(Setup(0x21, request, value, 0, len(data)), data)

    def query(self, request: int, value: int = 0, length: int = 6) -> bytes:
        return self.emulator.usb.control(Setup(0xA1, request, value, 0, length))

    def wait(self, ms: int) -> None:
        self.emulator.scheduler.run_until(self.emulator.scheduler.now + ms * 400_000)

    def send(self, stored: bytes, blocks: int) -> None:
        for number in range(blocks):
            self.out(1, number, stored[number * BLOCK : (number + 1) * BLOCK])
            while poll := int.from_bytes(self.query(3)[1:4], "little"):
                self.wait(poll)

    def err(self) -> None:
        with pytest.raises(Stall):
            self.out(4)

    def half_done(self) -> None:
        self.send(NEWER.encode(), 3)

    def in_block(self) -> None:
        self.half_done()
        self.out(1, 3, NEWER.encode()[3 * BLOCK : 4 * BLOCK])

    def busy(self) -> None:
        self.in_block()
        self.query(3)

    def all_sent(self) -> None:
        self.send(NEWER.encode(), BLOCKS)
        self.out(1, BLOCKS)

    def manifesting(self) -> None:
        self.all_sent()
        self.query(3)

    def reading(self) -> None:
        self.query(2, 0, BLOCK)


LEAVINGS: list[Callable[[Left], None]] = [
    lambda left: None,
    Left.err,
    Left.half_done,
    Left.in_block,
    Left.busy,
    Left.all_sent,
    Left.manifesting,
    Left.reading,
]


@pytest.mark.parametrize("leave", LEAVINGS)
def test_a_device_that_was_left_in_any_state_is_taken_from_there(
    emulator: Emulator, leave: Callable[[Left], None]
) -> None:
    leave(Left(emulator))
    assert in_dfu_mode(emulator)
    assert flash(emulator.url, FILE).attempts == 1
    assert running(emulator)[0] == NEW.version


# Eleven processors as one


def test_firmware_that_does_not_come_up_everywhere_is_taken_back(emulator: Emulator) -> None:
    """Clause FWU-020: it is on trial, and a restart ends that."""
    with pytest.raises(DeviceError, match=r"did not get firmware 2\.3\.4 on .* 7, 8, 9; .* runs 0\.1\.0"):
        flash(emulator.url, FILE, on_progress=striking(emulator, faults.DeadProcessor(processor=7), FlashStage.BOOT))
    assert emulator.running.info().firmware == FACTORY
    assert emulator.running.status().faults & Fault.FLASH


def test_an_image_that_does_not_boot_is_an_error(emulator: Emulator) -> None:
    address = next(at for at in range(5000, 6000) if STORED[at] & 1)
    stuck = faults.StuckFlashBit(address=Bank.A.image_address + address, bit=0, value=0)
    with pytest.raises(DeviceRefusedError) as refused:  # the second time it finds out what is wrong
        flash(emulator.url, FILE, on_progress=striking(emulator, stuck, FlashStage.BOOT))
    assert refused.value.reason is DfuStatus.CHECK_ERASED


def test_an_image_that_starts_nowhere_is_an_error(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    def boot_factory(flash: Flash) -> Boot:
        return boot(flash)._replace(bank=Bank.FACTORY, image=FACTORY_IMAGE)

    monkeypatch.setattr("phasewire.emulator.machine.boot", boot_factory)
    with pytest.raises(DeviceError, match=r"runs firmware 0\.1\.0 rather than 2\.3\.4; .*\(tried 3 times\)"):
        flash(emulator.url, FILE)


# Power cuts and unplugged cables, at any moment


def block_boundaries() -> list[int]:
    """How many bytes of flash have been written before each block, and before the record."""
    ends = [SECTOR + (n // 2 + 1) * SECTOR + min((n + 1) * BLOCK, len(STORED)) for n in range(BLOCKS)]
    return [0, SECTOR, *ends]


BYTES = np.random.default_rng(6).integers(WRITTEN, size=200).tolist()
BOUNDARIES = sorted({at + by for at in block_boundaries() for by in (-1, 0, 1)} - {-1})
MOMENTS = np.random.default_rng(7).uniform(0, 2900, size=200).tolist()
"""In ms: detach, transfer, check and start take 2.9 s."""


def slow(*values: float) -> list[Any]:
    """Values for a parametrization that `make test` leaves out."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


@pytest.mark.parametrize(
    "written",
    [
        *(*block_boundaries()[::2], WRITTEN - 9, WRITTEN - 5, WRITTEN - 1, *BYTES[:2]),
        *slow(*BOUNDARIES, *range(WRITTEN - 58, WRITTEN), *BYTES),
    ],
)
def test_a_power_cut_at_any_byte_leaves_a_device_that_boots(written: int) -> None:
    """The power fails after so many written bytes: once it stays away, once it comes back while the host waits."""
    with Emulator() as emulator:
        emulator.inject(faults.PowerCutInWrite(written_bytes=written))
        with pytest.raises(DeviceLostError):
            flash(emulator.url, FILE)
        assert not emulator.powered
        assert booted(emulator) in (FACTORY, NEW.version)
        assert flash(emulator.url, FILE).firmware == NEW.version
        assert booted(emulator) == NEW.version
    with Emulator() as emulator:
        emulator.inject(faults.PowerCutInWrite(written_bytes=written, off_periods=SHORT))
        assert flash(emulator.url, FILE).attempts == 2
        assert booted(emulator) == NEW.version


@pytest.mark.parametrize("ms", [0.1, 15, 35, 60, 250, 300, 500, 2700, 2830, 2860, *MOMENTS[:3], *slow(*MOMENTS)])
def test_a_cable_pulled_at_any_moment_leaves_a_device_that_boots(ms: float) -> None:
    """The cable is pulled so long after the beginning."""
    with Emulator() as emulator:
        emulator.scheduler.at(emulator.scheduler.now + round(ms * 400_000), emulator.usb.unplug)
        try:
            flash(emulator.url, FILE)
        except (DeviceLostError, DeviceNotFoundError):
            assert not emulator.usb.attached
        plug_in(emulator)
        assert flash(emulator.url, FILE).firmware == NEW.version
        assert booted(emulator) == NEW.version


# Back to the factory image: clause REQ-014


@pytest.mark.parametrize("upgrades", [0, 1, 2])
def test_a_device_goes_back_to_its_factory_image(emulator: Emulator, upgrades: int) -> None:
    images = [OLD, NEW][:upgrades]
    for image in images:
        flash(emulator.url, build(image))
    report = revert(emulator.url)
    assert report.before == (images[-1].version if images else FACTORY)
    assert report.firmware == FACTORY
    assert running(emulator) == (FACTORY, Bank.FACTORY)
    assert booted(emulator) == FACTORY
    assert flash(emulator.url, FILE).bank is Bank.A


def test_a_device_in_dfu_mode_goes_back_too(emulator: Emulator) -> None:
    flash(emulator.url, FILE)
    Left(emulator).half_done()
    assert revert(emulator.url).before == NEW.version
    assert running(emulator) == (FACTORY, Bank.FACTORY)


@pytest.mark.parametrize(
    "fault", [faults.WriteProtectedFlash(), faults.StuckFlashBit(address=0x101000 + 200, bit=7, value=1)]
)
def test_a_device_that_could_not_go_back_is_an_error(emulator: Emulator, fault: InjectedFault) -> None:
    """Clause FWU-022: it tells no success, but comes back with what ran."""
    flash(emulator.url, FILE)
    emulator.inject(fault)
    with pytest.raises(DeviceError, match=r"could not go back to its factory image and runs 2\.3\.4 still"):
        revert(emulator.url)
    assert running(emulator) == (NEW.version, Bank.A)


def test_a_device_without_revert_is_refused_with_the_reason(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    flash(emulator.url, FILE)
    saying(monkeypatch, features=Feature.DFU)
    with pytest.raises(DeviceError, match="lacks the feature REVERT"):
        revert(emulator.url)
    assert running(emulator)[0] == NEW.version


@pytest.mark.parametrize("number", [errno.ENODEV, errno.EIO, errno.ETIMEDOUT])
def test_a_device_that_leaves_during_the_request_has_received_it(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    flash(emulator.url, FILE)
    genuine = EmulatorBackend.ctrl_transfer

    def leave(self: EmulatorBackend, handle: Any, kind: int, request: int, *rest: Any) -> int:
        count = genuine(self, handle, kind, request, *rest)
        if (kind, request) == (0x41, Request.REVERT):
            raise usb.core.USBError("it left", errno=number)
        return count

    monkeypatch.setattr(EmulatorBackend, "ctrl_transfer", leave)
    assert revert(emulator.url).firmware == FACTORY
