"""Firmware in flash: banks, trials, power cuts, and the way back to the factory's image (chapter FWU)."""

from __future__ import annotations

from functools import partial

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from phasewire.emulator import faults
from phasewire.errors import DeviceError
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, NotApplicable, Risk, case, expect
from phasewire.hil.conformance.tools.dfu import DfuLine, dfu_mode
from phasewire.hil.conformance.tools.images import as_version, large_image, signed_by
from phasewire.protocol.board import CARRIER_HZ
from phasewire.protocol.codes import Bank, DfuState, DfuStatus, Fault, Feature, ImageReason, Request, State

flashing = partial(case, allow=(Risk.FLASH, Risk.RESET), line="usb", features=Feature.DFU)
reverting = partial(case, allow=(Risk.FLASH, Risk.RESET), line="usb", features=Feature.DFU | Feature.REVERT)
BLOCK = 2048
STUCK_SECONDS = 12.0
"""For how long a bit of the flash sticks: a restart takes less, and nothing is left of it for the next case."""
UP_SECONDS = 5.0
"""After which a device that was given its power back has come up, or started and failed to."""


def bank_of(bench: Bench) -> Bank:
    """The bank that all processors' firmware came from."""
    first, *others = (report.bank for report in bench.processors())
    assert first is not None, "processor 0 names no bank that its firmware came from"
    for processor, bank in enumerate(others, start=1):
        expect(f"the bank that processor {processor}'s firmware came from", bank, first)
    return first


def idle_bank(running: Bank) -> Bank:
    """Where the next upgrade goes (clause FWU-018)."""
    return Bank.B if running is Bank.A else Bank.A


def settled(bench: Bench) -> Bank:
    """The bank that runs after the device was begun like any case again."""
    bench.begin_case("after a restart")
    return bank_of(bench)


def upgraded(bench: Bench) -> Bank:
    """Flash the device's own firmware once more; the bank that it then runs from."""
    with dfu_mode(bench) as line:
        line.flash(_own(line))
    return settled(bench)


def _own(line: DfuLine) -> bytes:
    image = line.image()
    line.rest()
    return image


@flashing("FWU-018/2", "FWU-018", "FWU-016", "FWU-019", "FWU-020/2", "DFU-011", "DFU-015")
def test_upgrades_go_to_the_bank_that_does_not_run_and_boot_from_it(bench: Bench) -> None:
    """Three upgrades with the same firmware boot from A and B in turn, A first where the factory's image ran."""
    running = bank_of(bench)
    for _ in range(3):
        before, running = running, upgraded(bench)
        expect("the bank that boots", running, idle_bank(before))
        expect("the faults", bench.status().faults, Fault(0))


@flashing("FWU-018/1", "FWU-018", "DFU-010", "FWU-019")
def test_a_download_that_is_given_up_leaves_its_bank_empty(bench: Bench) -> None:
    """A download that is given up over an upgrade leaves no record of it: what ran before boots, and nothing failed."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        image = large_image(line)
        line.flash(image)
        expect("the state behind three blocks", line.send(image, 0, 3).state, DfuState.DNLOAD_IDLE)
        assert line.abort(), "ABORT between two blocks is answered with STALL"
    expect("the faults", bench.status().faults, Fault(0))
    expect("the bank that boots", settled(bench), before)


@flashing("FWU-020/2", "FWU-020", needs=(Need.POWER,))
def test_an_image_that_came_up_boots_again_and_again(bench: Bench) -> None:
    """Firmware that a host has configured once is confirmed: it boots again whenever power comes back."""
    running = upgraded(bench)
    for _ in range(3):
        bench.power_cycle()
        expect("the bank that boots", settled(bench), running)
        expect("the faults", bench.status().faults, Fault(0))


@flashing("FWU-020/1", "FWU-020", "FWU-019", needs=(Need.POWER,))
def test_an_image_that_never_came_up_does_not_boot_again(bench: Bench) -> None:
    """New firmware that was started and not confirmed is given up for what ran before, and FLASH says so."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        line.flash(_own(line))
        _power(bench)  # it boots on trial, and no host configures it
        bench.power_cycle()
    expect("the bank that boots", settled_with_fault(bench), before)
    upgraded(bench)  # over what never came up


@flashing("FWU-018/3", "FWU-018/2", needs=(Need.FAULTS, Need.POWER))
def test_an_image_that_never_came_up_does_not_boot_after_a_cut_erasure(bench: Bench) -> None:
    """Where an upgrade that overwrites such an image is cut short, what was given up does not boot after all."""
    before = upgraded(bench)
    # Few bits change in the first bytes' time of an erasure: a record stays whole then, and a mark may not.
    for byte in (20, 47, 50, 60, 500, 3000, *(1 + number % 12 for number in range(24))):
        with dfu_mode(bench) as line:
            image = large_image(line)
            line.flash(image)
            _power(bench)  # it boots on trial, and no host configures it
            bench.power_cycle()
        expect("the bank that boots", settled_with_fault(bench), before)
        bench.note("cut at byte", byte)
        with dfu_mode(bench) as line:
            bench.levers.cause(faults.PowerCutInWrite(written_bytes=byte, off_periods=4000))
            _send_while_there(bench, line, image)
            bench.usb.reopen(UP_SECONDS)
        expect("the bank that boots after the cut", settled(bench), before)
    upgraded(bench)


def settled_with_fault(bench: Bench) -> Bank:
    """The bank that runs after a restart that has to report FLASH."""
    faults_found = bench.status().faults
    assert Fault.FLASH in faults_found, f"the faults are {faults_found!r}; FLASH should be among them"
    return settled(bench)


def _power(bench: Bench) -> None:
    """Take power away and give it back, without a look at the bus."""
    bench.levers.power_down()
    bench.wait(0.1)
    bench.levers.power_up()
    bench.wait(UP_SECONDS)


@flashing("FWU-018/1", "FWU-018/2", "DFU-010", "DFU-015", needs=(Need.POWER,))
def test_power_may_go_at_any_time_of_a_download(bench: Bench) -> None:
    """After a power cut anywhere in a download or manifestation the device boots, from a bank that is whole."""
    running = bank_of(bench)
    for moment in range(10):
        with dfu_mode(bench) as line:
            image = large_image(line)
            blocks = -(-len(image) // BLOCK)
            cut_at = bench.random.randrange(blocks + 1)
            line.send(image, 0, cut_at)
            at = cut_at * BLOCK
            line.download(cut_at, image[at : at + BLOCK])
            line.status()
            bench.wait(bench.random.uniform(0, 0.14))
            bench.power_cycle()
        found = settled(bench)
        finished = cut_at == blocks
        assert found is running or (finished and found is idle_bank(running)), (
            f"cut {moment}, in block {cut_at} of {blocks}: the device boots from {found.name}, ran from {running.name}"
        )
        running = found


@flashing("FWU-018/1", "FWU-018/2", "FWU-018", needs=(Need.FAULTS, Need.POWER))
def test_power_may_go_at_any_byte_that_is_written(bench: Bench) -> None:
    """A write to the flash that is cut short at any byte leaves what ran before, or the new image whole."""
    running = bank_of(bench)
    with dfu_mode(bench) as line:
        size = len(_own(line))
    sectors = 1 + -(-size // 4096)
    for _ in range(12):
        byte = bench.random.randrange(sectors * 4096 + size + 48)
        bench.note("cut at byte", byte)
        with dfu_mode(bench) as line:
            image = large_image(line)
            bench.levers.cause(faults.PowerCutInWrite(written_bytes=byte, off_periods=4000))
            _send_while_there(bench, line, image)
            bench.usb.reopen(UP_SECONDS)
        found = settled(bench)
        assert found in (running, idle_bank(running)), f"the device boots from {found.name}, ran from {running.name}"
        running = found


def _send_while_there(bench: Bench, line: DfuLine, image: bytes) -> None:
    """Download an image until the device is gone."""
    try:
        line.flash(image)
        bench.wait(0.01)
        line.state()
    except (DeviceError, AssertionError):
        bench.wait(0.2)
        return
    raise AssertionError("the power should have gone while the image was written")


@flashing("FWU-019", "FWU-017", needs=(Need.FAULTS,))
def test_an_image_that_has_gone_bad_does_not_boot(bench: Bench) -> None:
    """Where the newest image is not what its record says, the one before it boots, and FLASH says so."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        line.flash(_own(line))
        _stick(bench, idle_bank(before))
    expect("the bank that boots", settled_with_fault(bench), before)
    bench.wait(STUCK_SECONDS)


def _stick(bench: Bench, bank: Bank) -> None:
    """Let the first byte of a bank's image, which is 50h, read as 51h for a while."""
    periods = round(STUCK_SECONDS * CARRIER_HZ)
    bench.levers.cause(faults.StuckFlashBit(address=bank.image_address, bit=0, value=1, periods=periods))


@reverting("REQ-014", "FWU-022/1", "FWU-022")
def test_revert_goes_back_to_the_factory_image(bench: Bench) -> None:
    """REVERT boots the factory's image, gives up both upgrades for good, and resets everything as RESET does."""
    upgraded(bench)
    upgraded(bench)
    accepted = bench.status().accepted
    bench.restart(lambda: bench.order(Request.REVERT))
    status = bench.status()
    expect("the bank that boots", bank_of(bench), Bank.FACTORY)
    expect("the faults", status.faults, Fault(0))
    assert status.accepted <= accepted, f"{status.accepted} accepted blocks are counted after a restart"
    expect("the state", status.state, State.OFF)
    if bench.can(Need.POWER):
        bench.power_cycle()
        expect("the bank that boots after power-up", settled(bench), Bank.FACTORY)


@reverting("FWU-022/1", "REQ-014", needs=(Need.FAULTS, Need.POWER))
def test_a_revert_that_is_cut_short_leaves_the_newer_image_or_the_factory_s(bench: Bench) -> None:
    """Power that goes while REVERT writes leaves what would have booted without it, or the factory's image."""
    for byte in (0, 1, 47, 48, 49, 95):
        upgraded(bench)
        newer = upgraded(bench)
        bench.note("cut at byte", byte)
        bench.levers.cause(faults.PowerCutInWrite(written_bytes=byte, off_periods=4000))
        bench.restart(lambda: bench.order(Request.REVERT))
        found = settled(bench)
        assert found in (newer, Bank.FACTORY), f"the device boots from {found.name}, ran from {newer.name}"
        bench.restart(lambda: bench.order(Request.REVERT))
        expect("the bank that boots after a whole REVERT", settled(bench), Bank.FACTORY)


@reverting("FWU-022/2", needs=(Need.FAULTS,))
def test_revert_gives_up_nothing_where_the_factory_image_is_bad(bench: Bench) -> None:
    """Where the factory's image is not what its record says, REVERT restarts the device with the upgrade it has."""
    running = upgraded(bench)
    _stick(bench, Bank.FACTORY)
    bench.restart(lambda: bench.order(Request.REVERT))
    expect("the bank that boots", settled(bench), running)
    bench.wait(STUCK_SECONDS)


@flashing("FWU-013/1", "FWU-004", "USB-008")
def test_an_older_version_is_taken_like_a_newer_one(bench: Bench) -> None:
    """An image of version 0.0.1 is taken and boots: a bad upgrade must be able to be undone."""
    with dfu_mode(bench) as line:
        own = _own(line)
        line.flash(as_version(own, (0, 0, 1)))
    settled(bench)
    report = bench.processors()[0]
    expect("the version that runs", tuple(report.firmware), (0, 0, 1))
    expect("bcdDevice", bench.usb.device.bcdDevice, 0x0001)
    with dfu_mode(bench) as line:
        line.flash(own)
    settled(bench)


@flashing("FWU-012/1", "FWU-011")
def test_keys_decide_whose_images_are_taken(bench: Bench) -> None:
    """A device that trusts keys refuses images that are not signed, or by another key; one without keys takes both."""
    stranger = Ed25519PrivateKey.from_private_bytes(bench.random.randbytes(32))
    with dfu_mode(bench) as line:
        own = _own(line)
        takes = []
        for image in (signed_by(own, None), signed_by(own, stranger)):
            line.send(image)
            line.download(0, b"")
            reply = line.poll()
            if reply.state is DfuState.ERROR:
                expect("why it is refused", (reply.status, reply.string), (DfuStatus.FILE, 16 + ImageReason.SIGNATURE))
            takes.append(reply.state is not DfuState.ERROR)
            line.rest()
        assert takes[0] == takes[1], (
            f"unsigned images are {'taken' if takes[0] else 'refused'}, those of an unknown key "
            f"{'taken' if takes[1] else 'refused'}: a device with keys refuses both, one without takes both"
        )
        line.flash(own)
    settled(bench)
    if takes[0]:
        raise NotApplicable("the device trusts no keys, and takes any valid image")


@pytest.mark.parametrize("processor", [0, 4, 9])
@flashing("FWU-021", "CHN-024", "TIM-002/2", "SAF-007/1", needs=(Need.SPARE, Need.FAULTS, Need.POWER))
def test_a_device_without_all_its_processors_stays_on_the_bus(bench: Bench, processor: int) -> None:
    """Where a processor does not start, the device reports PROCESSOR, keeps its outputs off and takes firmware."""
    with bench.spare() as broken:
        broken.levers.cause(faults.DeadProcessor(processor=processor))
        broken.power_cycle()
        expect("the state", broken.status().state, State.FAULT)
        found = broken.status().faults
        assert Fault.PROCESSOR in found, f"the faults are {found!r}; PROCESSOR should be among them"
        reports = broken.processors()
        expect(
            "processors with the fault", [Fault.PROCESSOR in report.faults for report in reports].index(True), processor
        )
        assert not broken.try_order(Request.ENABLE), "ENABLE is not answered with STALL"
        assert not broken.try_order(Request.CLEAR_FAULTS) or broken.status().state is State.FAULT, (
            "PROCESSOR was cleared"
        )
        with dfu_mode(broken) as line:
            line.flash(_own(line))
        expect("the faults after an upgrade", broken.status().faults & Fault.PROCESSOR, Fault.PROCESSOR)
