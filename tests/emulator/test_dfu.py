"""What a conformance case cannot see of DFU mode: exact cycles, and flash that fails."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from phasewire.emulator.door import Stall
from phasewire.emulator.firmware.dfu import DfuMode
from phasewire.emulator.firmware.flash import Flash, FlashTimes
from phasewire.emulator.firmware.loader import DeviceIdentity, boot, make_flash
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.codes import Bank, DfuState, DfuStatus, Target
from phasewire.protocol.dfu import DfuReply
from phasewire.protocol.firmware import Image, Segment
from phasewire.protocol.requests import Setup
from phasewire.protocol.versions import Version
from phasewire.protocol.wiring import Wiring

MS = 400_000  # core cycles: 400 MHz
BLOCK = 2048
OUT, IN = 0x21, 0xA1
DETACH, DNLOAD, GETSTATUS, CLRSTATUS, GETSTATE = 0, 1, 3, 4, 5
IMAGE_A = 0x201000


def made(minor: int, size: int = 9000) -> Image:
    """An image of about so many random bytes."""
    body = np.random.default_rng(minor).bytes(size - 300)
    segments = (Segment(Target.ALL_PROCESSORS, body), Segment(Target.CONTROLLER, body[:72]))
    return Image(Version(3, minor, 0), segments)


FACTORY, NEW = made(0, 5000), made(2)
STORED = NEW.encode()
BLOCKS = [STORED[at : at + BLOCK] for at in range(0, len(STORED), BLOCK)]
assert len(BLOCKS) == 5
assert len(BLOCKS[-1]) < BLOCK


class Bench:
    """A device in DFU mode and a host that speaks to it as dfu-util does."""

    def __init__(self, flash: Flash | None = None, running: Bank = Bank.FACTORY) -> None:
        self.flash = flash or make_flash(DeviceIdentity("FL-1", Wiring.strips()), FACTORY)
        self.scheduler = Scheduler()
        self.flash.power_up(self.scheduler)
        self.dfu = DfuMode(self.scheduler, self.flash, running, [])

    def out(self, request: int, value: int = 0, data: bytes = b"") -> None:
        assert self.dfu.control(Setup(OUT, request, value, 0, len(data)), data) == b""

    def status(self) -> DfuReply:
        return DfuReply.decode(self.dfu.control(Setup(IN, GETSTATUS, 0, 0, 6)))

    def state(self) -> int:
        return self.dfu.control(Setup(IN, GETSTATE, 0, 0, 1))[0]

    def quietly(self) -> DfuState:
        """The state, without a request."""
        return self.dfu.state

    def wait(self, ms: float) -> None:
        self.scheduler.run_until(self.scheduler.now + round(ms * MS))

    def poll(self) -> list[tuple[str, int]]:
        """Ask until the device is not busy, waiting as it says; returns the states and times in between."""
        seen = []
        for _ in range(200):
            reply = self.status()
            seen.append((reply.state.name, reply.poll_ms))
            if not reply.poll_ms:
                return seen
            self.wait(reply.poll_ms)
        raise AssertionError(seen)

    def refuses(self, call: Callable[[], object]) -> DfuReply:
        """The status after a request that the device answers with STALL."""
        with pytest.raises(Stall):
            call()
        return self.status()


@pytest.fixture
def bench() -> Bench:
    return Bench()


def error(status: DfuStatus) -> DfuReply:
    return DfuReply(status, 0, DfuState.ERROR, 0)


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


def in_busy(bench: Bench) -> None:
    bench.out(DNLOAD, 0, BLOCKS[0])
    bench.status()


# Time


@pytest.mark.parametrize(
    ("times", "status"), [(FlashTimes(erase_ms=10_001), DfuStatus.ERASE), (FlashTimes(program_ms=2000), DfuStatus.PROG)]
)
def test_flash_work_fails_after_ten_seconds(bench: Bench, times: FlashTimes, status: DfuStatus) -> None:
    bench.flash.times = times
    bench.out(DNLOAD, 0, BLOCKS[0])
    bench.scheduler.run_until(10_000 * MS - 1)
    assert bench.quietly() is DfuState.DNLOAD_SYNC
    bench.scheduler.run_until(10_000 * MS)
    assert bench.status() == error(status)


def test_the_time_out_of_an_earlier_block_does_not_count(bench: Bench) -> None:
    in_busy(bench)
    bench.refuses(bench.state)
    bench.out(CLRSTATUS)
    bench.wait(100)
    in_busy(bench)
    bench.wait(28)
    assert bench.quietly() is DfuState.DNBUSY
    bench.wait(100)
    assert bench.quietly() is DfuState.DNLOAD_SYNC


# Flash that fails


def test_a_sector_that_is_not_erased_is_no_place_for_a_block(bench: Bench) -> None:
    bench.flash.defects.stuck_at_0[IMAGE_A + 1000] = 1
    in_busy(bench)
    bench.wait(128)
    assert bench.status() == error(DfuStatus.CHECK_ERASED)
    assert boot(bench.flash).image == FACTORY


def test_a_download_waits_for_the_flash(bench: Bench) -> None:
    """The flash goes on with the first sector after an error; the next download waits for it: 350 + 800 + 24 ms."""
    bench.flash.times = FlashTimes(erase_ms=400, program_ms=3)
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


# Resets: clause DFU-015


def test_a_reset_lets_the_flash_finish_and_starts_no_more_work(bench: Bench) -> None:
    in_busy(bench)
    bench.wait(10)
    assert bench.dfu.bus_reset(configured=True)
    assert bench.flash.busy_until == 60 * MS
    bench.wait(1000)
    assert bench.flash.erasures.nonzero()[0].tolist() == [0x200]
    assert boot(bench.flash).image == FACTORY
