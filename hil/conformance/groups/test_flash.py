"""Firmware in flash: banks, trial boots, power cuts, and the return to the factory image (chapter FWU)."""

from __future__ import annotations

from functools import partial

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from phasewire.base.errors import DeviceError
from phasewire.emulator import faults
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, case, expect
from phasewire.hil.conformance.tools.dfu import RawDfuLine, dfu_mode
from phasewire.hil.conformance.tools.images import (
    UNTRUSTED,
    Forgery,
    as_version,
    boot_record,
    large_image,
    of_many_blocks,
    signed_by,
)
from phasewire.host.transports.usb_find import RUN_TIME
from phasewire.protocol.board import CARRIER_HZ
from phasewire.protocol.codes import (
    FLASH_SECTOR_BYTES,
    Bank,
    DfuState,
    DfuStatus,
    Fault,
    Feature,
    ImageReason,
    Request,
    State,
)
from phasewire.protocol.dfu import DfuReply
from phasewire.protocol.requests import Setup

flashing = partial(case, allow=(Risk.FLASH, Risk.RESET), line="usb", features=Feature.DFU)
reverting = partial(case, allow=(Risk.FLASH, Risk.RESET), line="usb", features=Feature.DFU | Feature.REVERT)
BLOCK = 2048
DEVICE_DESCRIPTOR = Setup(0x80, 6, 0x0100, 0, 18)
ASK_INFO = Setup(0xC1, Request.INFO, 0, 0, 64)
STUCK_SECONDS = 12.0
"""For how long a bit of the flash sticks: less than a restart, so that the next case is not affected."""
FOR_ITS_SIGNATURE = (DfuStatus.FILE, 16 + ImageReason.SIGNATURE)
"""Status and string of an image that is refused for its signature (clause DFU-012)."""
UP_SECONDS = 5.0
"""Time after which a device with power again has come up, or has tried and failed."""


def bank_of(bench: Bench) -> Bank:
    """The bank from which all processors' firmware came."""
    first, *others = (report.bank for report in bench.processors())
    assert first is not None, "processor 0 names no bank that its firmware came from"
    for processor, bank in enumerate(others, start=1):
        expect(f"the bank that processor {processor}'s firmware came from", bank, first)
    return first


def idle_bank(running: Bank) -> Bank:
    """The bank for the next upgrade (clause FWU-018)."""
    return Bank.B if running is Bank.A else Bank.A


def settled(bench: Bench) -> Bank:
    """The bank that runs after the device was prepared as for any case."""
    bench.begin_case("after a restart")
    return bank_of(bench)


def upgraded(bench: Bench) -> Bank:
    """Flash the device's own firmware once more; returns the bank that runs afterwards."""
    with dfu_mode(bench) as line:
        line.flash(line.own_image())
    return settled(bench)


@flashing("FWU-018/2", "FWU-018", "FWU-016", "FWU-019", "FWU-020/2", "DFU-011", "DFU-015")
def test_upgrades_go_to_the_bank_that_does_not_run_and_boot_from_it(bench: Bench) -> None:
    """Three upgrades with the same firmware boot from A and B in turn, A first if the factory image ran."""
    running = bank_of(bench)
    for _ in range(3):
        before, running = running, upgraded(bench)
        expect("the bank that boots", running, idle_bank(before))
        expect("the faults", bench.status().faults, Fault(0))


@pytest.mark.parametrize("how", ["abort", "failure", "bus-reset"])
@flashing("FWU-018/1", "FWU-018", "DFU-010", "FWU-019")
def test_a_download_that_is_given_up_leaves_its_bank_empty(bench: Bench, how: str) -> None:
    """A cancelled download over an upgrade leaves no record of it: the previous image boots, without a fault."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        image = large_image(line)
        line.flash(image)
        expect("the state after three blocks", line.send(image, 0, 3).state, DfuState.DNLOAD_IDLE)
        if how == "abort":
            assert line.abort(), "ABORT between two blocks is answered with STALL"
        elif how == "failure":
            assert not line.download(0, image[:BLOCK]), "block 0 after block 2 is not answered with STALL"
    expect("the faults", bench.status().faults, Fault(0))
    expect("the bank that boots", settled(bench), before)


@pytest.mark.parametrize("forgery", Forgery.of_contents(), ids=str)
@flashing("DFU-011", "FWU-018/1", "FWU-015", "FWU-019")
def test_a_wrong_image_never_boots(bench: Bench, forgery: Forgery) -> None:
    """After an image with a defect after its header the previous image boots, whatever the device has answered."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        offer(line, forgery.of(line.own_image()))
    expect("the faults", bench.status().faults, Fault(0))
    expect("the bank that boots", settled(bench), before)


@flashing("DFU-010", "FWU-018/1", "DFU-014")
def test_a_refused_header_erases_nothing(bench: Bench) -> None:
    """An upgrade that waits for a reset boots although a later download was refused for its header."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        own = line.own_image()
        line.flash(own)
        for wrong in (bytes(BLOCK), own[:31], Forgery.of_headers()[2].of(own)[:BLOCK]):
            line.download(0, wrong)
            expect("the state after it", line.poll().state, DfuState.ERROR)
            line.rest()
    expect("the faults", bench.status().faults, Fault(0))
    expect("the bank that boots", settled(bench), idle_bank(before))


@flashing("FWU-020/2", "FWU-020", needs=(Need.POWER,))
def test_an_image_that_came_up_boots_again_and_again(bench: Bench) -> None:
    """Firmware that a host has configured once is confirmed: it boots again whenever power returns."""
    running = upgraded(bench)
    for _ in range(3):
        bench.power_cycle()
        expect("the bank that boots", settled(bench), running)
        expect("the faults", bench.status().faults, Fault(0))


def upgraded_in_vain(bench: Bench) -> Bank:
    """Flash an image that never comes up; returns the bank of before, which boots again."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        line.flash(line.own_image())
        _power(bench)  # it boots on trial, and no host configures it
        bench.power_cycle()
    expect("the bank that boots", settled_with_fault(bench), before)
    return before


@flashing("FWU-020/1", "FWU-020", "FWU-019", needs=(Need.POWER,))
def test_an_image_that_never_came_up_does_not_boot_again(bench: Bench) -> None:
    """New firmware that was started and not confirmed is replaced by the previous one, and FLASH reports it."""
    upgraded_in_vain(bench)
    upgraded(bench)  # over the image that never came up


@pytest.mark.parametrize("what", ["bus-reset", "descriptors", "other-requests"])
@flashing("FWU-020/3", "FWU-020", "FWU-019", needs=(Need.POWER,), since=2)
def test_what_comes_before_configuration_does_not_confirm_an_image(bench: Bench, what: str) -> None:
    """New firmware that met bus resets or requests, but was not configured, does not boot again."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        line.flash(line.own_image())
        _power(bench)
        bench.usb.wait_for(RUN_TIME, bench.paced(UP_SECONDS), configured=False)
        if bench.usb.is_configured:
            raise Inconclusive("the computer configures the device by itself before a program can reset it")
        for _ in range(3):
            match what:
                case "bus-reset":
                    bench.usb.reset(configured=False)
                case "descriptors":
                    assert bench.request(DEVICE_DESCRIPTOR), "the descriptor of the device is answered with STALL"
                case _:
                    expect("INFO before the device is configured", bench.request(ASK_INFO), None)
        bench.power_cycle()
    expect("the bank that boots", settled_with_fault(bench), before)
    upgraded(bench)


@flashing("FWU-018/3", "FWU-018", needs=(Need.FAULTS, Need.POWER))
def test_a_record_that_may_not_boot_is_gone_even_where_it_cannot_be_erased(bench: Bench) -> None:
    """The record of an image that never came up is overwritten before its sector is erased, so that none is left."""
    before = upgraded_in_vain(bench)
    sector = idle_bank(before).record_address // FLASH_SECTOR_BYTES
    with dfu_mode(bench) as line:
        bench.levers.cause(faults.FailingSector(sector=sector, periods=round(STUCK_SECONDS * CARRIER_HZ)))
        expect("the status of a sector that is not erased", line.send(line.own_image()).status, DfuStatus.ERASE)
    expect("the faults, for the bank has no record", bench.status().faults, Fault(0))
    expect("the bank that boots", settled(bench), before)
    bench.outlast(STUCK_SECONDS)
    upgraded(bench)


@flashing("FWU-018/3", "FWU-018/2", needs=(Need.FAULTS, Need.POWER))
def test_an_image_that_never_came_up_does_not_boot_after_a_cut_erasure(bench: Bench) -> None:
    """If an upgrade over such an image is interrupted, the void image does not boot again."""
    before = upgraded(bench)
    # Few bits change in the first bytes' time of an erasure: a record stays whole, but a mark may not.
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
            bench.usb.reopen(bench.paced(UP_SECONDS))
        expect("the bank that boots after the cut", settled(bench), before)
    upgraded(bench)


def settled_with_fault(bench: Bench) -> Bank:
    """The bank that runs after a restart that must report FLASH."""
    faults_found = bench.status().faults
    assert Fault.FLASH in faults_found, f"the faults are {faults_found!r}; FLASH should be among them"
    return settled(bench)


def _power(bench: Bench) -> None:
    """Cut the power and restore it, without a look at the bus."""
    bench.levers.power_down()
    bench.wait(0.1)
    bench.levers.power_up()
    bench.wait(bench.paced(UP_SECONDS))


@flashing("FWU-018/1", "FWU-018/2", "DFU-010", "DFU-015", needs=(Need.POWER,))
def test_power_may_go_at_any_time_of_a_download(bench: Bench) -> None:
    """After a power cut anywhere in a download or manifestation the device boots from an intact bank."""
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
    """A flash write that is cut short at any byte leaves the previous image, or the new one intact."""
    running = bank_of(bench)
    with dfu_mode(bench) as line:
        size = len(line.own_image())
    sectors = 1 + -(-size // 4096)
    for _ in range(12):
        byte = bench.random.randrange(sectors * 4096 + size + 48)
        bench.note("cut at byte", byte)
        with dfu_mode(bench) as line:
            image = large_image(line)
            bench.levers.cause(faults.PowerCutInWrite(written_bytes=byte, off_periods=4000))
            _send_while_there(bench, line, image)
            bench.usb.reopen(bench.paced(UP_SECONDS))
        found = settled(bench)
        assert found in (running, idle_bank(running)), f"the device boots from {found.name}, ran from {running.name}"
        running = found


def _send_while_there(bench: Bench, line: RawDfuLine, image: bytes) -> None:
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
    """If the newest image does not match its record, the one before it boots, and FLASH reports it."""
    before = upgraded(bench)
    with dfu_mode(bench) as line:
        line.flash(line.own_image())
        _stick(bench, idle_bank(before).image_address)
    expect("the bank that boots", settled_with_fault(bench), before)
    bench.outlast(STUCK_SECONDS)


def _stick(bench: Bench, address: int, bit: int = 0, value: int = 1) -> None:
    """Let a bit of the flash stick for a while; bit 0 turns 50h, the first byte of images and records, into 51h."""
    periods = round(STUCK_SECONDS * CARRIER_HZ)
    bench.levers.cause(faults.StuckFlashBit(address=address, bit=bit, value=value, periods=periods))


@flashing("DFU-009", "DFU-014", "FWU-007", "FWU-008", "FWU-019")
def test_an_image_of_more_than_256_blocks_boots(bench: Bench) -> None:
    """Firmware of 258 blocks, one segment of 65 536 and zeros after it, is accepted, uploaded unchanged, and boots."""
    before = bank_of(bench)
    with dfu_mode(bench) as line:
        own = line.own_image()
        image = of_many_blocks(own, 258)
        line.flash(image)
        found = line.image()
        assert found == image, f"an image of {len(image)} bytes is uploaded as another, of {len(found)} bytes"
    expect("the bank that boots", settled(bench), idle_bank(before))
    expect("the faults", bench.status().faults, Fault(0))
    with dfu_mode(bench) as line:
        line.flash(own)
    settled(bench)


@pytest.mark.parametrize("generation", [0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF], ids=lambda number: f"{number:X}")
@reverting("FWU-017", "FWU-019", needs=(Need.FAULTS,))
def test_an_upgrade_is_newer_whatever_generation_it_follows(bench: Bench, generation: int) -> None:
    """After an upgrade with the largest generation of some bits, as its stuck record reads, the next one boots."""
    bench.restart(lambda: bench.order(Request.REVERT))
    expect("the bank that boots", upgraded(bench), Bank.A)  # with generation 0, for there is no other record
    with dfu_mode(bench) as line:
        own = line.own_image()
        written, reads = boot_record(own, 0), boot_record(own, generation)
        for number, (one, other) in enumerate(zip(written, reads, strict=True)):
            for bit in range(8):
                if (one ^ other) >> bit & 1:
                    _stick(bench, Bank.A.record_address + number, bit, other >> bit & 1)
        line.flash(own)
    expect("the bank that boots", settled(bench), Bank.B)
    expect("the faults", bench.status().faults, Fault(0))
    bench.outlast(STUCK_SECONDS)


@reverting("REQ-014", "FWU-022/1", "FWU-022")
def test_revert_goes_back_to_the_factory_image(bench: Bench) -> None:
    """REVERT boots the factory image, voids both upgrades for good, and resets everything as RESET does."""
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
    """A power cut during REVERT leaves what would have booted without it, or the factory image."""
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


@pytest.mark.parametrize("what", ["image", "record"])
@reverting("FWU-022/2", needs=(Need.FAULTS,))
def test_revert_gives_up_nothing_where_the_factory_image_is_bad(bench: Bench, what: str) -> None:
    """If the factory image does not match its record, REVERT restarts the device with the current upgrade."""
    running = upgraded(bench)
    _stick(bench, Bank.FACTORY.image_address if what == "image" else Bank.FACTORY.record_address)
    bench.restart(lambda: bench.order(Request.REVERT))
    expect("the bank that boots", settled(bench), running)
    bench.outlast(STUCK_SECONDS)


@flashing("FWU-013/1", "FWU-004", "USB-008")
def test_an_older_version_is_taken_like_a_newer_one(bench: Bench) -> None:
    """An image of version 0.0.1 is accepted and boots: a bad upgrade must be reversible."""
    with dfu_mode(bench) as line:
        own = line.own_image()
        line.flash(as_version(own, (0, 0, 1)))
    settled(bench)
    expect("the version that runs", tuple(bench.processors()[0].firmware), (0, 0, 1))
    expect("bcdDevice", bench.usb.device.bcdDevice, 0x0001)
    with dfu_mode(bench) as line:
        line.flash(own)
    settled(bench)


@flashing("FWU-012", "FWU-011")
def test_keys_decide_whose_images_are_taken(bench: Bench) -> None:
    """Unsigned images and those by an unknown key are both accepted, or both refused for their signature."""
    stranger = key_of(bench)
    with dfu_mode(bench) as line:
        own = line.own_image()
        takes = []
        for image in (signed_by(own, None), signed_by(own, stranger)):
            reply = offer(line, image)
            if reply.state is DfuState.ERROR:
                expect("why it is refused", (reply.status, reply.string), FOR_ITS_SIGNATURE)
            takes.append(reply.state is not DfuState.ERROR)
            line.rest()
        assert takes[0] == takes[1], (
            f"unsigned images are {'accepted' if takes[0] else 'refused'}, those of an unknown key "
            f"{'accepted' if takes[1] else 'refused'}: a device with keys refuses both, one without accepts both"
        )
        line.flash(own)
    settled(bench)


def key_of(bench: Bench) -> Ed25519PrivateKey:
    """A new key."""
    return Ed25519PrivateKey.from_private_bytes(bench.random.randbytes(32))


def offer(line: RawDfuLine, image: bytes) -> DfuReply:
    """Download an image to its end and return the device's last answer."""
    line.send(image)
    line.download(0, b"")
    return line.poll()


@pytest.mark.parametrize("what", UNTRUSTED)
@pytest.mark.parametrize("runs", ["factory", "upgrade"])
@flashing("FWU-012/1", "FWU-011", "FWU-015", needs=(Need.SPARE,))
def test_a_device_with_keys_refuses_what_they_have_not_signed(bench: Bench, runs: str, what: str) -> None:
    """An image that no trusted key has signed is refused, whichever image runs, and that one boots again."""
    with bench.spare(key_of(bench)) as device:
        running = upgraded(device) if runs == "upgrade" else bank_of(device)
        with dfu_mode(device) as line:
            own = line.own_image()
            reply = offer(line, UNTRUSTED[what](own, key_of(bench)))
            expect("the state after it", reply.state, DfuState.ERROR)
            expect("why it is refused", (reply.status, reply.string), FOR_ITS_SIGNATURE)
            line.rest()
            expect("the image that would boot next", line.image(), own)
        expect("the bank that boots", settled(device), running)


@flashing("FWU-012", "FWU-013/1", "FWU-011", needs=(Need.SPARE,))
def test_a_device_with_keys_takes_what_they_have_signed(bench: Bench) -> None:
    """Images signed by the trusted key are accepted one after the other, older versions as well as newer ones."""
    key = key_of(bench)
    with bench.spare(key) as device:
        running = bank_of(device)
        for version in ((9, 0, 0), (0, 0, 1), (1, 0, 0)):
            with dfu_mode(device) as line:
                line.flash(signed_by(as_version(signed_by(line.own_image(), None), version), key))
            before, running = running, settled(device)
            expect("the bank that boots", running, idle_bank(before))
            expect("the version that runs", tuple(device.processors()[0].firmware), version)


@pytest.mark.parametrize("processor", [0, 4, 9])
@flashing("FWU-021", "CHN-024", "TIM-002/2", "SAF-007/1", needs=(Need.SPARE, Need.FAULTS, Need.POWER))
def test_a_device_without_all_its_processors_stays_on_the_bus(bench: Bench, processor: int) -> None:
    """If a processor does not start, the device reports PROCESSOR, keeps its outputs off and accepts firmware."""
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
            line.flash(line.own_image())
        expect("the faults after an upgrade", broken.status().faults & Fault.PROCESSOR, Fault.PROCESSOR)
