from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from phasewire.emulator.door import Stall
from phasewire.emulator.firmware.dfu import DfuMode
from phasewire.emulator.firmware.flash import FLASH_BYTES, Flash, Times
from phasewire.emulator.firmware.loader import Identity, boot, confirm, make_flash, read_record
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.codes import Bank, DfuState, DfuStatus, Fault, ImageReason, Target
from phasewire.protocol.dfu import TRANSITIONS, DfuEvent, DfuReply
from phasewire.protocol.enumeration import dfu_mode
from phasewire.protocol.firmware import BootRecord, Image, Segment, sign
from phasewire.protocol.requests import Setup
from phasewire.protocol.versions import Version
from phasewire.protocol.wiring import Wiring

MS = 400_000  # core cycles: 400 MHz
SECTOR, BLOCK = 4096, 2048
OUT, IN = 0x21, 0xA1
DETACH, DNLOAD, UPLOAD, GETSTATUS, CLRSTATUS, GETSTATE, ABORT = range(7)
KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
STRANGER = Ed25519PrivateKey.from_private_bytes(bytes(32))
IMAGE_A, IMAGE_B = 0x201000, 0x301000


def made(minor: int, size: int = 9000) -> Image:
    """An image of about so many bytes that look like nothing else."""
    body = np.random.default_rng(minor).bytes(size - 300)
    segments = (Segment(Target.ALL_PROCESSORS, body), Segment(Target.CONTROLLER, body[:72]))
    return Image(Version(3, minor, 0), segments)


FACTORY, OLD, NEW, THIRD = made(0, 5000), made(1), made(2), made(3)
STORED = NEW.encode()
BLOCKS = [STORED[at : at + BLOCK] for at in range(0, len(STORED), BLOCK)]
assert len(BLOCKS) == 5
assert len(BLOCKS[-1]) < BLOCK


class Bench:
    """A device in DFU mode and a host that speaks to it as dfu-util does."""

    def __init__(
        self,
        flash: Flash | None = None,
        running: Bank = Bank.FACTORY,
        *,
        signed_by: Ed25519PrivateKey | None = None,
        configured: bool = True,
    ) -> None:
        self.flash = flash or make_flash(Identity("FL-1", Wiring.strips()), FACTORY)
        self.scheduler = Scheduler()
        self.flash.power_up(self.scheduler)
        keys = [] if signed_by is None else [signed_by.public_key()]
        self.dfu = DfuMode(self.scheduler, self.flash, running, keys)

    def out(self, request: int, value: int = 0, data: bytes = b"") -> None:
        assert self.dfu.control(Setup(OUT, request, value, 0, len(data)), data) == b""

    def status(self) -> DfuReply:
        return DfuReply.decode(self.dfu.control(Setup(IN, GETSTATUS, 0, 0, 6)))

    def state(self) -> int:
        return self.dfu.control(Setup(IN, GETSTATE, 0, 0, 1))[0]

    def quietly(self) -> DfuState:
        """The state, without a request."""
        return self.dfu.state

    def upload(self, number: int, length: int = BLOCK) -> bytes:
        return self.dfu.control(Setup(IN, UPLOAD, number, 0, length))

    def wait(self, ms: float) -> None:
        self.scheduler.run_until(self.scheduler.now + round(ms * MS))

    def poll(self) -> list[tuple[str, int]]:
        """Ask until the device is not busy, waiting as long as it says; states and times in between."""
        seen = []
        for _ in range(200):
            reply = self.status()
            seen.append((reply.state.name, reply.poll_ms))
            if not reply.poll_ms:
                return seen
            self.wait(reply.poll_ms)
        raise AssertionError(seen)

    def send(self, number: int, data: bytes) -> DfuStatus:
        """Send a block and wait until it is written."""
        self.out(DNLOAD, number, data)
        self.poll()
        return self.status().status

    def download(self, stored: bytes) -> DfuStatus:
        """Send an image and see what comes of it."""
        for number, at in enumerate(range(0, len(stored), BLOCK)):
            status = self.send(number, stored[at : at + BLOCK])
            if status is not DfuStatus.OK:
                return status
        return self.send(-(-len(stored) // BLOCK), b"")

    def read_back(self) -> bytes:
        blocks = []
        for number in range(400):
            blocks.append(self.upload(number))
            if len(blocks[-1]) < BLOCK:
                return b"".join(blocks)
        raise AssertionError

    def boots(self) -> Image:
        """What runs after the power was away."""
        self.dfu.stop()
        self.flash.cut_power()
        self.flash.power_up(Scheduler())
        return boot(self.flash).image

    def refuses(self, call: Callable[[], object]) -> DfuReply:
        """What the device says of a request that it answers with STALL."""
        with pytest.raises(Stall):
            call()
        return self.status()


def error(status: DfuStatus, string: int = 0) -> DfuReply:
    return DfuReply(status, 0, DfuState.ERROR, string)


# A whole upgrade


def test_an_upgrade_as_dfu_util_does_it() -> None:
    """Download, read back, reset: every answer and every time by clauses DFU-008 and DFU-011."""
    bench = Bench()
    assert bench.status() == DfuReply(DfuStatus.OK, 0, DfuState.DFU_IDLE)
    polls = []
    for number, block in enumerate(BLOCKS):
        bench.out(DNLOAD, number, block)
        polls.append(bench.poll())
    assert polls == [[("DNBUSY", ms), ("DNLOAD_IDLE", 0)] for ms in (128, 8, 68, 8, 68)]
    bench.out(DNLOAD, len(BLOCKS))
    assert bench.poll() == [("MANIFEST", 2500), ("DFU_IDLE", 0)]
    assert bench.scheduler.now == (128 + 8 + 68 + 8 + 68 + 2500) * MS
    assert bench.flash.read(IMAGE_A, len(STORED)) == STORED
    assert bench.read_back() == STORED
    assert bench.state() == DfuState.DFU_IDLE
    assert bench.dfu.bus_reset(configured=True)
    assert boot(bench.flash) == (Bank.A, NEW, Fault(0))


def test_a_device_left_in_the_middle_is_brought_back() -> None:
    """What dfu-util does before it begins: it clears an error, and aborts what another had begun."""
    bench = Bench()
    bench.send(0, BLOCKS[0])
    assert bench.status().state is DfuState.DNLOAD_IDLE
    bench.out(ABORT)
    assert bench.status() == DfuReply(DfuStatus.OK, 0, DfuState.DFU_IDLE)
    assert bench.refuses(lambda: bench.out(CLRSTATUS)) == error(DfuStatus.STALLEDPKT)
    bench.out(CLRSTATUS)
    assert bench.status() == DfuReply(DfuStatus.OK, 0, DfuState.DFU_IDLE)
    assert bench.download(STORED) is DfuStatus.OK
    assert bench.boots() == NEW


def test_upgrades_take_turns_and_count() -> None:
    flash, running, images = None, Bank.FACTORY, []
    for image, generation in ((OLD, 0), (NEW, 1), (THIRD, 2)):
        bench = Bench(flash, running)
        flash = bench.flash
        assert bench.download(image.encode()) is DfuStatus.OK
        assert bench.boots() == image
        started = Scheduler()
        flash.power_up(started)
        running = Bank.A if running is not Bank.A else Bank.B
        confirm(flash, running)
        started.run_until(MS)
        record = read_record(flash, running)
        assert record is not None
        assert record.generation == generation
        images.append(boot(flash))
    assert images == [(Bank.A, OLD, Fault(0)), (Bank.B, NEW, Fault(0)), (Bank.A, THIRD, Fault(0))]


def test_the_bank_that_runs_is_not_touched() -> None:
    before = upgraded(OLD)
    bench = Bench(Flash(before), Bank.A)
    assert bench.download(STORED) is DfuStatus.OK
    assert bench.flash.read(0, 0x300000) == before[:0x300000]
    assert bench.flash.read(IMAGE_B, len(STORED)) == STORED


def test_an_older_version_is_taken_like_a_newer_one() -> None:
    """Clause FWU-013."""
    bench = Bench(Flash(upgraded(THIRD)), Bank.A)
    assert bench.download(OLD.encode()) is DfuStatus.OK
    assert bench.boots() == OLD


def test_the_largest_image_is_manifested_in_time() -> None:
    """Clause FWU-008: 721 520 bytes, 353 blocks; 2500 ms are enough."""
    segments = (*(Segment(Target(n), bytes(65_536)) for n in range(10)), Segment(Target.CONTROLLER, bytes(65_536)))
    stored = Image(Version(1, 0, 0), segments).encode()
    assert len(stored) == 721_520
    bench = Bench()
    for number, at in enumerate(range(0, len(stored), BLOCK)):
        bench.out(DNLOAD, number, stored[at : at + BLOCK])
        assert len(bench.poll()) == 2
    bench.out(DNLOAD, 353)
    assert bench.poll() == [("MANIFEST", 2500), ("DFU_IDLE", 0)]


# States and requests


def in_download(bench: Bench) -> None:
    bench.out(DNLOAD, 0, BLOCKS[0])


def in_busy(bench: Bench) -> None:
    in_download(bench)
    bench.status()


def in_download_idle(bench: Bench) -> None:
    in_download(bench)
    bench.poll()


def all_sent(bench: Bench) -> None:
    for number, block in enumerate(BLOCKS):
        bench.send(number, block)


def in_manifest_sync(bench: Bench) -> None:
    all_sent(bench)
    bench.out(DNLOAD, len(BLOCKS))


def in_manifest(bench: Bench) -> None:
    in_manifest_sync(bench)
    bench.status()


def in_upload(bench: Bench) -> None:
    bench.upload(0)


def in_error(bench: Bench) -> None:
    with pytest.raises(Stall):
        bench.out(CLRSTATUS)


WAYS = {
    DfuState.DFU_IDLE: lambda bench: None,
    DfuState.DNLOAD_SYNC: in_download,
    DfuState.DNBUSY: in_busy,
    DfuState.DNLOAD_IDLE: in_download_idle,
    DfuState.MANIFEST_SYNC: in_manifest_sync,
    DfuState.MANIFEST: in_manifest,
    DfuState.UPLOAD_IDLE: in_upload,
    DfuState.ERROR: in_error,
}
BLOCK_IN_TURN = {DfuState.DFU_IDLE: 0, DfuState.DNLOAD_IDLE: 1}
BUSY = {DfuState.DNLOAD_SYNC, DfuState.DNBUSY, DfuState.MANIFEST_SYNC, DfuState.MANIFEST}


def cause(bench: Bench, state: DfuState, event: DfuEvent) -> None:
    """Let an event happen to a device in a state."""
    match event:
        case DfuEvent.DETACH:
            bench.out(DETACH, 1000)
        case DfuEvent.DNLOAD:
            number = BLOCK_IN_TURN.get(state, 0)
            bench.out(DNLOAD, number, BLOCKS[number])
        case DfuEvent.DNLOAD_END:
            bench.out(DNLOAD, len(BLOCKS))
        case DfuEvent.UPLOAD:
            bench.upload(1 if state is DfuState.UPLOAD_IDLE else 0)
        case DfuEvent.UPLOAD_END:
            bench.upload(2 if state is DfuState.UPLOAD_IDLE else 0)
        case DfuEvent.GETSTATUS | DfuEvent.GETSTATUS_BUSY:
            bench.status()
        case DfuEvent.CLRSTATUS:
            bench.out(CLRSTATUS)
        case DfuEvent.GETSTATE:
            assert bench.state() == state
        case DfuEvent.ABORT:
            bench.out(ABORT)
        case DfuEvent.REFUSED:
            bench.out(0x42)
        case DfuEvent.POLL_TIMEOUT:
            bench.wait(2500)
        case DfuEvent.FAILURE:
            bench.wait(2400)
        case DfuEvent.BUS_RESET:
            assert bench.dfu.bus_reset(configured=True)


def rows() -> Iterator[tuple[DfuState, DfuEvent]]:
    for state in WAYS:
        for event in DfuEvent:
            happens = event is not DfuEvent.REATTACHED  # that happens at run time only
            if event is DfuEvent.GETSTATUS_BUSY or event is DfuEvent.FAILURE:
                happens = state in BUSY  # in others nothing is under way
            if happens:
                yield state, event


@pytest.mark.parametrize(("state", "event"), list(rows()))
def test_every_row_of_the_table(state: DfuState, event: DfuEvent) -> None:
    bench = Bench()
    flash = bench.flash
    if event is DfuEvent.UPLOAD_END and state is not DfuState.UPLOAD_IDLE:
        bench = Bench(make_flash(Identity("FL-2", Wiring.strips()), made(4, 1000)))  # less than a block
    if event is DfuEvent.GETSTATUS and state in {DfuState.DNBUSY, DfuState.MANIFEST}:
        flash.times = Times(erase_ms=1)  # so that the work is over before the host may ask
    WAYS[state](bench)
    assert bench.quietly() is state
    match event:
        case DfuEvent.GETSTATUS if state is DfuState.DNBUSY:
            bench.wait(100)
        case DfuEvent.GETSTATUS if state is DfuState.MANIFEST:
            bench.wait(2400)
        case DfuEvent.GETSTATUS if state in BUSY:
            bench.wait(3000)  # the work is done whether the host asks or not
        case DfuEvent.DNLOAD_END if state is DfuState.DNLOAD_IDLE:
            for number, block in enumerate(BLOCKS[1:], start=1):
                bench.send(number, block)
        case DfuEvent.UPLOAD_END if state is DfuState.UPLOAD_IDLE:
            bench.upload(1)
        case DfuEvent.FAILURE if state in {DfuState.MANIFEST_SYNC, DfuState.MANIFEST}:
            flash.defects.stuck_at_1[IMAGE_A + 5000] = 0xFF
        case DfuEvent.FAILURE:
            flash.defects.failing_pages.add(IMAGE_A // 256 + 2)
    step = TRANSITIONS[state, event]
    if step.stalls:
        with pytest.raises(Stall):
            cause(bench, state, event)
    else:
        cause(bench, state, event)
    assert bench.quietly() is step.state


def test_an_answer_is_cut_to_the_length_asked_for() -> None:
    assert Bench().dfu.control(Setup(IN, GETSTATUS, 0, 0, 4)) == bytes(4)


@pytest.mark.parametrize(
    "setup",
    [
        Setup(IN, GETSTATUS, 1, 0, 6),
        Setup(IN, GETSTATE, 1, 0, 1),
        Setup(OUT, ABORT, 1, 0, 0),
        Setup(IN, ABORT, 0, 0, 0),
        Setup(OUT, GETSTATUS, 0, 0, 0),
        Setup(IN, 7, 0, 0, 1),
    ],
)
def test_requests_that_the_class_does_not_know_stall(setup: Setup) -> None:
    bench = Bench()
    assert bench.refuses(lambda: bench.dfu.control(setup)) == error(DfuStatus.STALLEDPKT)


def test_an_abort_takes_no_data() -> None:
    bench = Bench()
    assert bench.refuses(lambda: bench.out(ABORT, 0, b"1")) == error(DfuStatus.STALLEDPKT)


# Time


def test_the_busy_state_ends_on_the_cycle_and_not_later() -> None:
    bench = Bench()
    bench.out(DNLOAD, 0, BLOCKS[0])
    bench.wait(20)
    assert bench.status().poll_ms == 128
    bench.scheduler.run_until(148 * MS - 1)
    assert bench.quietly() is DfuState.DNBUSY
    bench.scheduler.run_until(148 * MS)
    assert bench.quietly() is DfuState.DNLOAD_SYNC


def test_a_slow_flash_is_waited_for() -> None:
    """Two sectors of 400 ms and eight pages of 3 ms: 824 ms, which is seven times 128."""
    bench = Bench()
    bench.flash.times = Times(erase_ms=400, program_ms=3)
    bench.out(DNLOAD, 0, BLOCKS[0])
    assert bench.poll() == [("DNBUSY", 128)] * 7 + [("DNLOAD_IDLE", 0)]


@pytest.mark.parametrize(
    ("times", "status"), [(Times(erase_ms=10_001), DfuStatus.ERASE), (Times(program_ms=2000), DfuStatus.PROG)]
)
def test_work_fails_that_is_not_over_after_ten_seconds(times: Times, status: DfuStatus) -> None:
    bench = Bench()
    bench.flash.times = times
    bench.out(DNLOAD, 0, BLOCKS[0])
    bench.scheduler.run_until(10_000 * MS - 1)
    assert bench.quietly() is DfuState.DNLOAD_SYNC
    bench.scheduler.run_until(10_000 * MS)
    assert bench.status() == error(status)


def test_the_time_out_of_an_earlier_block_does_not_count() -> None:
    bench = Bench()
    in_busy(bench)
    bench.refuses(bench.state)
    bench.out(CLRSTATUS)
    bench.wait(100)
    in_busy(bench)
    bench.wait(28)
    assert bench.quietly() is DfuState.DNBUSY
    bench.wait(100)
    assert bench.quietly() is DfuState.DNLOAD_SYNC


# Blocks that are refused


@pytest.mark.parametrize(
    ("number", "data", "status"),
    [
        (0, BLOCKS[0], DfuStatus.ADDRESS),
        (2, BLOCKS[1], DfuStatus.ADDRESS),
        (1, BLOCKS[1][:-1], DfuStatus.ADDRESS),
        (1, BLOCKS[1] + b"1", DfuStatus.ADDRESS),
        (1, b"", DfuStatus.NOTDONE),
        (7, b"", DfuStatus.NOTDONE),
    ],
)
def test_a_block_out_of_turn_is_refused(number: int, data: bytes, status: DfuStatus) -> None:
    bench = Bench()
    in_download_idle(bench)
    assert bench.refuses(lambda: bench.out(DNLOAD, number, data)) == error(status)
    assert bench.boots() == FACTORY


@pytest.mark.parametrize(
    ("number", "data", "status", "string"),
    [
        (0, b"", DfuStatus.STALLEDPKT, 0),
        (1, BLOCKS[0], DfuStatus.ADDRESS, 0),
        (1, BLOCKS[1], DfuStatus.ADDRESS, 0),  # no header, and none is looked for
        (0, BLOCKS[0][:-1], DfuStatus.ADDRESS, 0),
        (0, STORED[:31], DfuStatus.FILE, 16 + 2),  # LENGTH
        (0, STORED[:127], DfuStatus.FILE, 16 + 2),
    ],
)
def test_a_first_block_that_is_none_is_refused(number: int, data: bytes, status: DfuStatus, string: int) -> None:
    bench = Bench()
    assert bench.refuses(lambda: bench.out(DNLOAD, number, data)) == error(status, string)


def test_nothing_comes_behind_the_end() -> None:
    bench = Bench()
    all_sent(bench)
    assert bench.refuses(lambda: bench.out(DNLOAD, len(BLOCKS), b"1")) == error(DfuStatus.ADDRESS)


def changed(at: int, value: int) -> bytes:
    return STORED[:at] + bytes([value]) + STORED[at + 1 :]


@pytest.mark.parametrize(
    ("stored", "status", "reason"),
    [
        (changed(0, 0), DfuStatus.TARGET, ImageReason.MAGIC),
        (changed(4, 2), DfuStatus.FILE, ImageReason.VERSION),
        (changed(10, 9), DfuStatus.FILE, ImageReason.CHECKSUM),
    ],
)
def test_a_bad_header_is_found_before_anything_is_erased(stored: bytes, status: DfuStatus, reason: ImageReason) -> None:
    """The transfer itself succeeds, so that the host asks for the status, and finds the reason in words (DFU-012)."""
    bench = Bench()
    before = bench.flash.read(0, FLASH_BYTES)
    bench.out(DNLOAD, 0, stored[:BLOCK])
    assert bench.status() == error(status, 16 + reason)
    assert dfu_mode((1, 0, 0), "x", "FL-1").strings[16 + reason] == reason.text
    bench.wait(1000)
    assert bench.flash.read(0, FLASH_BYTES) == before
    assert not bench.flash.erasures.any()


@pytest.mark.parametrize(
    ("stored", "trusted", "reason"),
    [
        (changed(200, STORED[200] ^ 1), None, ImageReason.HASH),
        (changed(len(STORED) - 1, 1), None, ImageReason.SIGNATURE),  # a signature without a key
        (STORED, KEY, ImageReason.SIGNATURE),
        (sign(NEW, STRANGER).encode(), KEY, ImageReason.SIGNATURE),
        (sign(NEW, KEY).encode()[:-1] + b"\0", KEY, ImageReason.SIGNATURE),
    ],
)
def test_a_bad_image_is_found_in_manifestation(
    stored: bytes, trusted: Ed25519PrivateKey | None, reason: ImageReason
) -> None:
    bench = Bench(signed_by=trusted)
    for number, at in enumerate(range(0, len(stored), BLOCK)):
        assert bench.send(number, stored[at : at + BLOCK]) is DfuStatus.OK
    bench.out(DNLOAD, 5)
    assert bench.poll() == [("MANIFEST", 2500), ("ERROR", 0)]
    assert bench.status() == error(DfuStatus.FILE, 16 + reason)
    assert read_record(bench.flash, Bank.A) is None
    assert bench.boots() == FACTORY


def test_a_trusted_signature_is_accepted_and_none_is_needed_without_keys() -> None:
    """Clause FWU-012."""
    assert Bench(signed_by=KEY).download(sign(NEW, KEY).encode()) is DfuStatus.OK
    assert Bench().download(sign(NEW, STRANGER).encode()) is DfuStatus.OK


# Flash that fails


def protect(flash: Flash) -> None:
    flash.defects.write_protected = True


@pytest.mark.parametrize(
    ("break_it", "status"),
    [
        (protect, DfuStatus.WRITE),
        (lambda flash: flash.defects.failing_sectors.add(0x200), DfuStatus.ERASE),
        (lambda flash: flash.defects.failing_sectors.add(0x202), DfuStatus.ERASE),
        (lambda flash: flash.defects.stuck_at_0.update({IMAGE_A + 4000: 1}), DfuStatus.CHECK_ERASED),
        (lambda flash: flash.defects.failing_pages.add(0x2012), DfuStatus.PROG),
        (lambda flash: flash.defects.failing_pages.add(0x2000), DfuStatus.PROG),
        (lambda flash: flash.defects.stuck_at_1.update({IMAGE_A + 7777: 0xFF}), DfuStatus.VERIFY),
        (lambda flash: flash.defects.stuck_at_1.update({0x200000: 0xFF}), DfuStatus.VERIFY),
    ],
)
def test_a_flash_that_fails_is_an_error_of_its_own(break_it: Callable[[Flash], None], status: DfuStatus) -> None:
    """Clause DFU-013; the second and the last but two concern the boot record."""
    bench = Bench()
    break_it(bench.flash)
    assert bench.download(STORED) is status
    assert bench.status() == error(status)
    assert bench.refuses(lambda: bench.out(DETACH)) == error(status)  # the first failure stays
    assert bench.boots() == FACTORY


def test_a_failure_is_seen_while_the_device_is_busy() -> None:
    bench = Bench()
    bench.flash.defects.failing_sectors.add(0x200)
    in_busy(bench)
    bench.wait(59)
    assert bench.quietly() is DfuState.DNBUSY
    bench.wait(2)
    assert bench.quietly() is DfuState.ERROR
    bench.wait(100)
    assert bench.status() == error(DfuStatus.ERASE)


def test_a_download_waits_for_what_the_flash_still_does() -> None:
    """The flash goes on with the first sector after an error; the next download waits for it: 350 + 800 + 24 ms."""
    bench = Bench()
    bench.flash.times = Times(erase_ms=400, program_ms=3)
    in_busy(bench)
    bench.wait(50)
    bench.refuses(bench.state)
    bench.out(CLRSTATUS)
    assert bench.flash.busy
    began = bench.scheduler.now
    bench.out(DNLOAD, 0, BLOCKS[0])
    assert bench.poll() == [("DNBUSY", 128)] * 10 + [("DNLOAD_IDLE", 0)]
    assert bench.scheduler.now - began >= 1174 * MS
    assert bench.flash.erasures[[0x200, 0x201]].tolist() == [2, 1]
    assert bench.flash.read(IMAGE_A, BLOCK) == BLOCKS[0]


def test_an_error_in_manifestation_leaves_the_bank_empty() -> None:
    bench = Bench()
    in_manifest(bench)
    bench.refuses(bench.state)
    bench.wait(5000)
    assert read_record(bench.flash, Bank.A) is None


# Upload


def test_what_is_uploaded_is_what_boots_next() -> None:
    bench = Bench(Flash(upgraded(OLD)), Bank.A)
    assert bench.read_back() == OLD.encode()
    bench.send(0, BLOCKS[0])
    bench.out(ABORT)
    assert bench.read_back() == OLD.encode()
    assert bench.download(STORED) is DfuStatus.OK
    assert bench.read_back() == STORED


def test_an_upload_of_whole_blocks_ends_with_none() -> None:
    image = made(5, 4000)
    image = replace(
        image,
        segments=(
            Segment(Target.ALL_PROCESSORS, bytes(2 * BLOCK - 128 - 64 - 4)),
            Segment(Target.CONTROLLER, bytes(4)),
        ),
    )
    assert len(image.encode()) == 2 * BLOCK
    bench = Bench(make_flash(Identity("FL-1", Wiring.strips()), image))
    assert [len(bench.upload(number)) for number in range(3)] == [BLOCK, BLOCK, 0]
    assert bench.state() == DfuState.DFU_IDLE


@pytest.mark.parametrize(
    ("first", "number", "length"),
    [(False, 1, BLOCK), (False, 0, 64), (True, 0, BLOCK), (True, 2, BLOCK), (True, 1, 4096)],
)
def test_an_upload_out_of_turn_is_refused(first: bool, number: int, length: int) -> None:
    bench = Bench()
    if first:
        bench.upload(0)
    assert bench.refuses(lambda: bench.upload(number, length)) == error(DfuStatus.ADDRESS)


def test_an_upload_begins_anew_after_an_abort() -> None:
    bench = Bench()
    bench.upload(0)
    bench.out(ABORT)
    assert bench.read_back() == FACTORY.encode()


# Resets: clause DFU-015


def test_resets_count_once_a_host_has_configured_the_device() -> None:
    bench = Bench()
    in_download_idle(bench)
    assert not bench.dfu.bus_reset(configured=False)
    assert bench.state() == DfuState.DNLOAD_IDLE
    assert bench.dfu.bus_reset(configured=True)
    assert bench.quietly() is DfuState.APP_IDLE


def test_a_reset_lets_the_flash_finish_and_begins_nothing_more() -> None:
    bench = Bench()
    in_busy(bench)
    bench.wait(10)
    assert bench.dfu.bus_reset(configured=True)
    assert bench.flash.busy_until == 60 * MS
    bench.wait(1000)
    assert bench.flash.erasures.nonzero()[0].tolist() == [0x200]
    assert boot(bench.flash).image == FACTORY


# Power cuts: an old or a new image boots, whole, wherever the power fails


def upgraded(image: Image, other: Image | None = None, *, came_up: bool = True) -> bytes:
    """A flash whose bank A runs, confirmed; B may hold another image, which is newer where it never came up."""
    content = bytearray(make_flash(Identity("FL-1", Wiring.strips()), FACTORY).read(0, FLASH_BYTES))
    banks = [(0x200000, image, 4, 0)]
    if other is not None:
        banks.append((0x300000, other, 3 if came_up else 5, 0 if came_up else 0xFFFF_FFFF))
    for at, held, generation, confirmed in banks:
        stored = held.encode()
        record = BootRecord(generation, len(stored), hashlib.sha256(stored).digest(), 0, confirmed)
        content[at : at + 56] = record.encode()
        content[at + SECTOR : at + SECTOR + len(stored)] = stored
    return bytes(content)


STARTS: dict[str, tuple[bytes, Bank, Image]] = {
    "factory": (make_flash(Identity("FL-1", Wiring.strips()), FACTORY).read(0, FLASH_BYTES), Bank.FACTORY, FACTORY),
    "B empty": (upgraded(OLD), Bank.A, OLD),
    "B older": (upgraded(OLD, THIRD), Bank.A, OLD),
    "B never came up": (upgraded(OLD, THIRD, came_up=False), Bank.A, OLD),
}
WRITTEN = SECTOR + 3 * SECTOR + len(STORED) + 48
"""Bytes that an upgrade erases and programs; a record that may not boot is overwritten besides."""


def block_boundaries() -> list[int]:
    """How many bytes are written before each block, and before the record."""
    ends = [SECTOR + (n // 2 + 1) * SECTOR + min((n + 1) * BLOCK, len(STORED)) for n in range(len(BLOCKS))]
    return [0, SECTOR, *ends]


def upgrade_until(start: str, written: int, seed: int = 0) -> tuple[Flash, bool]:
    """An upgrade whose power fails after so many written bytes, and whether it came to its end."""
    content, running, _ = STARTS[start]
    bench = Bench(Flash(content, seed=seed), running)
    cut: list[int] = []

    def lose_power() -> None:
        cut.append(bench.scheduler.now)
        bench.dfu.stop()

    bench.flash.cut_power_after(written, lose_power)
    for number, data in enumerate([*BLOCKS, b""]):
        bench.out(DNLOAD, number, data)
        bench.wait(2600)
        if cut:
            break
        assert bench.status().status is DfuStatus.OK
    return bench.flash, not cut


def check_boots(start: str, written: int, seed: int = 0) -> None:
    content, running, old = STARTS[start]
    extra = 48 if start == "B never came up" else 0
    flash, whole = upgrade_until(start, written, seed)
    assert whole == (written >= WRITTEN + extra)
    flash.cut_power()
    flash.power_up(Scheduler())
    bank, image, _ = boot(flash)
    if image == NEW:
        assert written >= WRITTEN + extra - 1  # half of the last byte may be all of it
        assert bank is not running
    else:
        assert (bank, image) == (running, old)
        assert not whole
    at = running * 0x100000
    assert flash.read(at, 0x100000) == content[at : at + 0x100000]


@pytest.mark.parametrize("start", STARTS)
def test_a_power_cut_at_every_block_leaves_the_old_image(start: str) -> None:
    for boundary in block_boundaries():
        for written in {max(boundary - 1, 0), boundary, boundary + 1}:
            check_boots(start, written)
    for written in range(WRITTEN - 2, WRITTEN + 49):
        check_boots(start, written)


@pytest.mark.parametrize("start", STARTS)
def test_a_power_cut_at_any_byte_leaves_the_old_or_the_new_image(start: str) -> None:
    random = np.random.default_rng(list(STARTS).index(start))
    for written in random.integers(WRITTEN, size=100).tolist():
        check_boots(start, written, seed=written)


def test_a_cut_erasure_does_not_bring_back_an_image_that_never_came_up() -> None:
    """The first bits that an erasure changes may be those of a mark."""
    for seed in range(60):
        for written in (0, 1, 3, 10, 48, 49, 50, 52, 60):
            check_boots("B never came up", written, seed)


@pytest.mark.parametrize("start", STARTS)
def test_an_upgrade_that_was_cut_can_be_made_again(start: str) -> None:
    for written in (100, SECTOR + 100, 2 * SECTOR + 3000, WRITTEN - 20):
        flash, _ = upgrade_until(start, written)
        flash.cut_power()
        bench = Bench(flash, STARTS[start][1])
        assert bench.download(STORED) is DfuStatus.OK
        assert bench.boots() == NEW


def test_a_cut_at_any_time_leaves_the_old_image() -> None:
    """Not at a byte, but at a moment: also while nothing is written."""
    random = np.random.default_rng(5)
    for at in random.integers((128 + 8 + 68 + 8 + 68) * MS, size=50).tolist():
        bench = Bench(Flash(STARTS["B older"][0]), Bank.A)
        later = iter(enumerate(BLOCKS))
        while bench.scheduler.now < at:
            number, block = next(later)
            bench.out(DNLOAD, number, block)
            bench.scheduler.run_until(min(at, bench.scheduler.now + (128, 8, 68, 8, 68)[number] * MS))
            if bench.scheduler.now < at:
                bench.status()
        assert bench.boots() == OLD
