"""DFU: the states of DFU 1.1, the device's poll times, and its refusals (chapter DFU)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import ceil

import pytest
from phasewire.base.errors import DeviceError
from phasewire.emulator import faults
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.waveforms import check_silent
from phasewire.hil.conformance.tools.dfu import RawDfuLine, dfu_mode
from phasewire.hil.conformance.tools.images import Forgery, large_image, of_whole_blocks
from phasewire.hil.conformance.tools.steps import enable
from phasewire.host.transports.usb_find import DFU_MODE, RUN_TIME
from phasewire.protocol.blocks import Update
from phasewire.protocol.board import CARRIER_HZ
from phasewire.protocol.codes import (
    SILENT_PERIODS,
    Bank,
    DfuRequest,
    DfuState,
    DfuStatus,
    Feature,
    ImageReason,
    Request,
    State,
)
from phasewire.protocol.dfu import DfuReply

flashing = partial(case, allow=(Risk.FLASH, Risk.RESET), line="usb", features=Feature.DFU)
restarting = partial(case, allow=(Risk.RESET,), line="usb", features=Feature.DFU)
UNKNOWN_REQUEST = 7
BLOCK = 2048
SECTOR, PAGE = 4096, 256
WRITING_SECONDS = 0.002
"""No flash writes a block faster."""
LEAST_BUSY_SECONDS = 0.008
"""The shortest time that a device is busy (clause DFU-008/1)."""
LEAST_SECONDS, MOST_SECONDS = 0.01, 1.0
"""Between DETACH and leaving the bus (clause DFU-002)."""
AWAY_SECONDS = 0.01
"""The least time off the bus (clause DFU-002)."""
CLOCK_ERROR = 0.001
"""The greatest difference between the clocks of host and device."""
ASK_SECONDS = 0.001

IDLE, SYNC, DNBUSY, DNLOAD_IDLE = DfuState.DFU_IDLE, DfuState.DNLOAD_SYNC, DfuState.DNBUSY, DfuState.DNLOAD_IDLE
MANIFEST_SYNC, MANIFEST, UPLOAD_IDLE = DfuState.MANIFEST_SYNC, DfuState.MANIFEST, DfuState.UPLOAD_IDLE
ERROR = DfuState.ERROR

DRAWN = {
    (IDLE, "DNLOAD"): SYNC,
    (IDLE, "UPLOAD"): UPLOAD_IDLE,
    (IDLE, "ABORT"): IDLE,
    (SYNC, "GETSTATUS"): DNBUSY,
    (DNLOAD_IDLE, "DNLOAD"): SYNC,
    (DNLOAD_IDLE, "ABORT"): IDLE,
    (MANIFEST_SYNC, "GETSTATUS"): MANIFEST,
    (UPLOAD_IDLE, "UPLOAD"): UPLOAD_IDLE,
    (UPLOAD_IDLE, "ABORT"): IDLE,
    (ERROR, "CLRSTATUS"): IDLE,
}
"""The transitions of DFU-006 that begin with a request, with the longest busy time before them."""
DEAF = (DNBUSY, MANIFEST)


@pytest.fixture
def line(bench: Bench) -> Iterator[RawDfuLine]:
    """A device in DFU mode, returned to run-time mode however the case ends."""
    with dfu_mode(bench) as line:
        yield line


class Walk:
    """A device in DFU mode, a large image, and the way to each state."""

    def __init__(self, line: RawDfuLine, image: bytes) -> None:
        self.line = line
        self.image = image

    def reach(self, state: DfuState) -> None:
        """Go from dfuIDLE to a state."""
        blocks = -(-len(self.image) // BLOCK)
        match state:
            case DfuState.DNLOAD_SYNC | DfuState.DNBUSY:
                self.line.download(0, self.image[:BLOCK])
            case DfuState.DNLOAD_IDLE:
                self.line.send(self.image, 0, 1)
            case DfuState.MANIFEST_SYNC | DfuState.MANIFEST:
                self.line.send(self.image)
                self.line.download(blocks, b"")
            case DfuState.UPLOAD_IDLE:
                self.line.upload(0)
            case DfuState.ERROR:
                self.line.clear()
        if state in DEAF:
            reply = self.line.status()
            if reply and reply.state in (DNLOAD_IDLE, IDLE) and self.line.since_download > WRITING_SECONDS:
                raise TooSlow(f"the line was too slow: {state.name} had ended when the device was asked")
            expect("the state after GETSTATUS", reply and reply.state, state)
        else:
            expect("the state", self.line.state(), state)

    def ask(self, request: str, state: DfuState) -> bool:
        """Make a request that would be right in a fitting state; returns whether it was answered."""
        match request:
            case "DETACH":
                return self.line.detach()
            case "DNLOAD":
                at = BLOCK if state is DNLOAD_IDLE else 0
                return self.line.download(at // BLOCK, self.image[at : at + BLOCK])
            case "DNLOAD_END":
                return self.line.download(0, b"")
            case "UPLOAD":
                return self.line.upload(1 if state is UPLOAD_IDLE else 0) is not None
            case "GETSTATUS":
                return self.line.status() is not None
            case "CLRSTATUS":
                return self.line.clear()
            case "GETSTATE":
                return self.line.state() is not None
            case "ABORT":
                return self.line.abort()
        return self.line.request(UNKNOWN_REQUEST) is not None


REQUESTS = (
    *("DETACH", "DNLOAD", "DNLOAD_END", "UPLOAD", "GETSTATUS", "CLRSTATUS", "GETSTATE", "ABORT"),
    "an unknown request",
)
STATES = (IDLE, SYNC, DNBUSY, DNLOAD_IDLE, MANIFEST_SYNC, MANIFEST, UPLOAD_IDLE, ERROR)


@pytest.mark.parametrize("state", STATES, ids=lambda state: state.name.lower().replace("_", "-"))
@flashing("DFU-006", "DFU-004", "DFU-003")
def test_every_request_in_every_state_leads_where_the_diagram_says(
    bench: Bench, line: RawDfuLine, state: DfuState
) -> None:
    """Each request in this state leads to the specified state, or is answered with STALL and leads to dfuERROR."""
    walk = Walk(line, large_image(line))
    own = line.image()
    for request in REQUESTS:
        line.rest()
        walk.reach(state)
        if (state, request) == (UPLOAD_IDLE, "UPLOAD") and len(own) < BLOCK:
            continue  # the first block completes it, and there is no second
        began = bench.line.time.monotonic()
        answered = walk.ask(request, state)
        drawn = DRAWN.get((state, request))
        asks = request in ("GETSTATUS", "GETSTATE") and state not in DEAF
        expect(f"whether {request} in {state.name} is answered", answered, drawn is not None or asks)
        after = ERROR if not answered else drawn if drawn is not None else state
        if (state, request) == (UPLOAD_IDLE, "UPLOAD") and len(own) < 2 * BLOCK:
            after = IDLE
        if after in DEAF:  # the answer named that time, and asking earlier is an error
            line.wait(1)
            told = line.state()
            if told is not None and bench.line.time.monotonic() - began > LEAST_BUSY_SECONDS:
                raise TooSlow(f"the line was too slow: {after.name} had ended when the device was asked")
            expect(f"whether GETSTATE is answered in {after.name}", told, None)
            after = ERROR
        expect(f"the state after {request} in {state.name}", line.state(), after)


@flashing("DFU-006", "USB-024")
def test_run_time_mode_knows_the_questions_and_detach_alone(bench: Bench) -> None:
    """At run time GETSTATUS and GETSTATE answer OK and appIDLE, and all else except DETACH is answered with STALL."""
    line = RawDfuLine(bench)
    status = line.status()
    assert status is not None, "GETSTATUS is answered with STALL at run time"
    expect("the status", (status.status, status.poll_ms, status.state), (DfuStatus.OK, 0, DfuState.APP_IDLE))
    expect("the state", line.state(), DfuState.APP_IDLE)
    for name, answered in (
        ("DNLOAD", line.download(0, bytes(BLOCK))),
        ("DNLOAD without data", line.download(0, b"")),
        ("DETACH with an answer", line.request(DfuRequest.DETACH, length=DfuReply.BYTES) is not None),
        ("UPLOAD", line.upload(0) is not None),
        ("CLRSTATUS", line.clear()),
        ("ABORT", line.abort()),
        ("an unknown request", line.request(UNKNOWN_REQUEST) is not None),
    ):
        assert not answered, f"{name} at run time is not answered with STALL"
        expect(f"the state after {name}", line.state(), DfuState.APP_IDLE)


@restarting("DFU-002", "DFU-006", "USB-024")
def test_detach_is_answered_before_the_device_leaves_and_comes_back(bench: Bench) -> None:
    """After DETACH the device says appDETACH, leaves after 10 to 1000 ms despite refusals, and returns as itself.

    A host observes the last answer before it leaves and the first one in DFU mode.
    """
    line, serial, now = RawDfuLine(bench), bench.usb.serial, bench.line.time.monotonic
    asked = now()
    assert line.detach(), "DETACH is answered with STALL"
    try:
        there = check_leaves(bench, line, asked)
        bench.usb.wait_for(DFU_MODE, bench.return_seconds)
        away = now() - there
        assert away >= AWAY_SECONDS, f"the device is back {away:.4f} s after it was there, should be 10 ms or later"
        expect("the serial number in DFU mode", bench.usb.serial, serial)
        expect("the state in DFU mode", line.state(), IDLE)
    finally:
        _come_back(bench, line)


def check_leaves(bench: Bench, line: RawDfuLine, asked: float) -> float:
    """Watch a device leave the bus in time after DETACH; returns the host's time of the last answered question."""
    now = bench.line.time.monotonic
    assert line.detached is not None
    latest, there = line.detached + bench.paced(MOST_SECONDS) * (1 + CLOCK_ERROR), asked
    told: list[tuple[str, Callable[[], object], object]] = [
        ("the state after DETACH", line.state, DfuState.APP_DETACH),
        ("whether ABORT after DETACH is answered", line.abort, False),
    ]
    while True:
        began = now()
        what, ask, wanted = told[0] if told else ("the state while it leaves", line.state, DfuState.APP_IDLE)
        try:
            seen = ask()
        except DeviceError as error:
            passed = now() - asked
            assert passed >= LEAST_SECONDS, f"the device left {passed:.4f} s after DETACH, should be 10 ms or later"
            if told:
                raise Inconclusive(f"the device had left before this computer could ask all: {error}") from error
            return there
        there = began
        assert there <= latest, f"the device is there {there - asked:.3f} s after DETACH, should leave within 1000 ms"
        expect(what, seen, wanted)
        del told[:1]
        bench.wait(ASK_SECONDS)


@restarting("DFU-002")
def test_a_bus_reset_after_detach_hastens_it(bench: Bench) -> None:
    """A bus reset between DETACH and leaving has the same effect: hosts do so that do not know bitWillDetach."""
    line = RawDfuLine(bench)
    assert line.detach(), "DETACH is answered with STALL"
    try:
        bench.usb.reset()
        bench.usb.wait_for(DFU_MODE, bench.return_seconds)
        expect("the state in DFU mode", line.state(), IDLE)
    finally:
        _come_back(bench, line)


def _come_back(bench: Bench, line: RawDfuLine) -> None:
    """Bring the device to run-time mode from any step on its way to DFU mode."""
    if bench.usb.mode != DFU_MODE:
        bench.usb.wait_for(DFU_MODE, bench.return_seconds)
    line.leave()


@flashing("DFU-002", "SAF-004/1", "SAF-001", "STA-003", needs=(Need.CAPTURE,))
def test_detach_silences_the_outputs_for_as_long_as_dfu_mode_lasts(bench: Bench) -> None:
    """DETACH silences the outputs within six periods, and they stay low during the download."""
    enable(bench)
    ack = bench.must(Update(bench.weak()))
    bench.wait_until(ack.commit_period + 4)
    earliest, period, latest = bench.line.time.monotonic(), bench.period(), bench.line.time.monotonic()
    with dfu_mode(bench) as line:
        line.send(large_image(line), 0, 2)
        assert line.detached is not None
        passed = bench.line.time.monotonic() - latest
        detached = period + ceil((line.detached - earliest) * CARRIER_HZ * (1 + CLOCK_ERROR))
        last = period + int(passed * CARRIER_HZ * (1 - CLOCK_ERROR))
        bench.judge(detached + SILENT_PERIODS + 1, last, check_silent, over=True)


@flashing("DFU-008/1", "DFU-007", "DFU-008")
def test_the_poll_times_are_those_of_the_flash(line: RawDfuLine) -> None:
    """Block 0 takes 128 ms, other even blocks 68 ms, odd ones 8 ms, and only a busy answer names a time."""
    image = large_image(line)
    for number in range(4):
        idle = line.status()
        expect("poll time in an idle state", idle and idle.poll_ms, 0)
        busy = busy_with(line, image, number)
        expect(f"poll time of block {number}", busy.poll_ms, 128 if number == 0 else 8 if number % 2 else 68)
        line.wait(busy.poll_ms)
        reply = line.poll()
        expect("the answer after it", (reply.state, reply.poll_ms, reply.status), (DNLOAD_IDLE, 0, DfuStatus.OK))


def busy_with(line: RawDfuLine, image: bytes, number: int) -> DfuReply:
    """Send a block; returns the answer while the device is busy, inconclusive if the block may be written by then."""
    line.download(number, image[BLOCK * number :][:BLOCK])
    busy = line.status()
    passed = line.since_download
    assert busy is not None, "GETSTATUS after DNLOAD is answered with STALL"
    if busy.state is DNLOAD_IDLE and passed > WRITING_SECONDS:
        raise TooSlow(f"the line was too slow: the device was asked {passed:.3f} s after it had block {number}")
    expect(f"the state with block {number}", busy.state, DNBUSY)
    return busy


@flashing("DFU-008/2")
def test_the_busy_state_ends_with_its_poll_time(line: RawDfuLine) -> None:
    """A device answers as soon as its poll time is over: a host that waits that long must not meet a STALL."""
    image = large_image(line)
    for number in range(3):
        line.wait(busy_with(line, image, number).poll_ms)
        expect("the state after the time is over", line.state(), SYNC)
        line.poll()
    line.send(image, 3)
    line.download(0, b"")
    busy = line.status()
    assert busy is not None, "GETSTATUS after the end of the download is answered with STALL"
    expect("the state", busy.state, MANIFEST)
    expect("its poll time", busy.poll_ms, 2500)
    line.wait(busy.poll_ms)
    expect("the state after the time is over", line.state(), MANIFEST_SYNC)
    line.poll()


@flashing("DFU-009", "DFU-006")
def test_blocks_out_of_turn_are_refused_with_address(line: RawDfuLine) -> None:
    """A wrong block number, a short block before the end, a block too long or too many ends the download (ADDRESS)."""
    image = large_image(line)
    last = (len(image) - 1) // BLOCK
    tries: list[tuple[str, int, Callable[[], bool]]] = [
        ("a download that begins with block 1", 0, lambda: line.download(1, image[:BLOCK])),
        ("block 2 after block 0", 1, lambda: line.download(2, image[BLOCK : 2 * BLOCK])),
        ("block 0 twice", 1, lambda: line.download(0, image[:BLOCK])),
        ("a short block", 1, lambda: line.download(1, image[BLOCK : 2 * BLOCK - 4])),
        ("a last block that is too long", last, lambda: line.download(last, image[BLOCK * last :] + bytes(4))),
        ("a block after the last", last + 1, lambda: line.download(last + 1, bytes(4))),
    ]
    for what, blocks, send in tries:
        line.rest()
        if blocks:
            expect("the state before it", line.send(image, 0, blocks).state, DNLOAD_IDLE)
        assert not send(), f"{what} is not answered with STALL"
        _expect_error(line, DfuStatus.ADDRESS, what)


@pytest.mark.parametrize("how", ["clrstatus", "abort", "end"])
@flashing("DFU-009", "DFU-006")
def test_each_download_begins_with_block_0(line: RawDfuLine, how: str) -> None:
    """After a download that failed, was cancelled or was completed, the next one must begin with block 0."""
    image = large_image(line)
    last = (len(image) - 1) // BLOCK
    for blocks in (1, 2, last):
        expect("the state before it", line.send(image, 0, blocks).state, DNLOAD_IDLE)
        if how == "clrstatus":
            assert not line.download(blocks + 1, image[:BLOCK]), "a block out of turn is not answered with STALL"
            assert line.clear(), "CLRSTATUS in dfuERROR is answered with STALL"
        elif how == "abort":
            assert line.abort(), "ABORT between two blocks is answered with STALL"
        else:
            line.send(image, blocks)
            expect("the state at its end", line.end().state, IDLE)
        for number in (blocks, 1):
            taken = line.download(number, image[BLOCK * number :][:BLOCK])
            assert not taken, f"block {number} at first, after {blocks} of a download, is not answered with STALL"
            _expect_error(line, DfuStatus.ADDRESS, f"a download that begins with block {number}")
            line.rest()


def _expect_error(line: RawDfuLine, status: DfuStatus, what: str, string: int | None = 0) -> None:
    reply = line.status()
    assert reply is not None, f"GETSTATUS in dfuERROR is answered with STALL after {what}"
    expect(f"state and status after {what}", (reply.state, reply.status), (ERROR, status))
    if string is not None:
        expect(f"the string after {what}", reply.string, string)


@flashing("DFU-009", "DFU-005")
def test_a_download_must_not_end_early(line: RawDfuLine) -> None:
    """DNLOAD without data before the last block gives NOTDONE, in dfuIDLE STALLEDPKT: half an image is no image."""
    image = large_image(line)
    assert not line.download(0, b""), "a download of nothing is not answered with STALL"
    _expect_error(line, DfuStatus.STALLEDPKT, "a download of nothing")
    line.rest()
    line.send(image, 0, 2)
    assert not line.download(2, b""), "an early end is not answered with STALL"
    _expect_error(line, DfuStatus.NOTDONE, "an early end")


@flashing("DFU-006")
def test_the_first_failure_is_the_one_that_is_told(line: RawDfuLine) -> None:
    """In dfuERROR the status stays that of the first failure, until CLRSTATUS resets it to OK."""
    assert not line.download(5, large_image(line)[:BLOCK]), "block 5 at first is not answered with STALL"
    assert not line.abort(), "ABORT in dfuERROR is not answered with STALL"
    assert not line.download(0, b""), "DNLOAD in dfuERROR is not answered with STALL"
    _expect_error(line, DfuStatus.ADDRESS, "more refusals")
    assert line.clear(), "CLRSTATUS in dfuERROR is answered with STALL"
    reply = line.status()
    expect("the answer after CLRSTATUS", reply and (reply.state, reply.status), (IDLE, DfuStatus.OK))


@flashing("DFU-010", "DFU-012", "FWU-015", "FWU-001", "DFU-009")
def test_a_first_block_that_is_no_header_is_refused_for_its_length(line: RawDfuLine) -> None:
    """A first block shorter than header and table is refused with LENGTH before anything is erased."""
    own = line.own_image()
    for size in (1, 31, 32, 127):
        assert not line.download(0, own[:size]), f"a first block of {size} bytes is not answered with STALL"
        _expect_error(line, DfuStatus.FILE, f"a first block of {size} bytes", 16 + ImageReason.LENGTH)
        line.rest()
    expect("the image that would boot next", line.image(), own)


@pytest.mark.parametrize("forgery", Forgery.of_headers(), ids=str)
@flashing("DFU-010", "DFU-012", "FWU-015", "FWU-004", "FWU-005", "FWU-007", "FWU-008", "FWU-009")
def test_a_wrong_header_is_refused_with_the_first_block(line: RawDfuLine, forgery: Forgery) -> None:
    """An image with this defect in header or table is refused after block 0, with the reason in words."""
    own = line.own_image()
    wrong = forgery.of(own)
    line.download(0, wrong[:BLOCK])
    _expect_reason(line, line.poll, forgery.reason)
    line.rest()
    expect("the image that would boot next", line.image(), own)


@pytest.mark.parametrize("forgery", Forgery.of_contents(), ids=str)
@flashing("DFU-011", "DFU-012", "FWU-015", "FWU-009", "FWU-010", "FWU-011")
def test_a_wrong_image_is_refused_when_it_has_come(line: RawDfuLine, forgery: Forgery) -> None:
    """An image with this defect after its header ends manifestation in dfuERROR, with the reason in words."""
    own = line.own_image()
    line.send(forgery.of(own))
    line.download(0, b"")
    _expect_reason(line, line.poll, forgery.reason)
    line.rest()
    expect("the image that would boot next", line.image(), own)


def _expect_reason(line: RawDfuLine, poll: Callable[[], object], reason: ImageReason) -> None:
    poll()
    status = DfuStatus.TARGET if reason in (ImageReason.MAGIC, ImageReason.HARDWARE) else DfuStatus.FILE
    _expect_error(line, status, f"an image with a wrong {reason.name}", 16 + reason)
    assert line.string(16 + reason), f"string {16 + reason} says nothing about {reason.name}"


@flashing("DFU-014", "DFU-006")
def test_an_upload_gives_the_image_block_by_block(line: RawDfuLine) -> None:
    """UPLOAD answers 2048 bytes a block, the last shorter, the same each time, and accepts no other number."""
    own = line.image()
    expect("the state after the last block", line.state(), IDLE if len(own) >= BLOCK else UPLOAD_IDLE)
    line.rest()
    expect("its magic", own[:4], b"PWFW")
    expect("its size, as its header says", len(own), int.from_bytes(own[12:16], "little"))
    expect("the bytes of a second upload", line.image(), own)
    line.rest()
    for what, number, length in (
        ("an upload that begins with block 1", 1, BLOCK),
        ("an upload of 1024 bytes", 0, 1024),
        ("an upload of 4096 bytes", 0, 4096),
    ):
        expect(what, line.upload(number, length), None)
        _expect_error(line, DfuStatus.ADDRESS, what)
        line.rest()
    line.upload(0)
    if line.state() is UPLOAD_IDLE:
        expect("block 0 after block 0", line.upload(0), None)
        _expect_error(line, DfuStatus.ADDRESS, "block 0 twice")
        line.rest()


@flashing("DFU-014", "DFU-006")
def test_an_upload_of_whole_blocks_ends_with_an_empty_one(line: RawDfuLine) -> None:
    """If the image's last block is full, an empty answer ends the upload; otherwise the host would wait for more."""
    own = large_image(line)
    image = of_whole_blocks(own)
    line.flash(image)
    for number in range(len(image) // BLOCK):
        expect(f"block {number}", line.upload(number), image[BLOCK * number :][:BLOCK])
    expect("the state after the last full block", line.state(), UPLOAD_IDLE)
    expect("the answer after it", line.upload(len(image) // BLOCK), b"")
    expect("the state at the end", line.state(), IDLE)
    line.flash(own)


@restarting("DFU-015", "DFU-016")
def test_a_device_waits_for_a_bus_reset_in_dfu_mode(bench: Bench) -> None:
    """A device in DFU mode stays there while its host is silent, and a bus reset boots it into run-time mode."""
    before = bench.info
    with dfu_mode(bench) as line:
        line.wait(3000)
        expect("the state after 3 s", line.state(), IDLE)
    expect("the mode after a bus reset", bench.usb.mode, RUN_TIME)
    bench.begin_case("again")
    expect("INFO after it", bench.ask(Request.INFO), before.encode())
    expect("the state", bench.status().state, State.OFF)


@flashing("DFU-016", "DFU-006", needs=(Need.SUSPEND,))
def test_a_suspended_bus_leaves_a_download_where_it_is(bench: Bench, line: RawDfuLine) -> None:
    """A host that sleeps in the middle of a download finds it unchanged: the next block is accepted."""
    image = line.image()
    expect("the state after the first block", line.send(image, last=1).state, DfuState.DNLOAD_IDLE)
    bench.levers.suspend()
    bench.wait(0.1)
    bench.levers.resume()
    expect("the state after the bus was suspended", line.state(), DfuState.DNLOAD_IDLE)
    line.send(image, first=1)
    expect("the state after manifestation", line.end().state, DfuState.DFU_IDLE)


@restarting("DFU-015")
def test_resets_of_enumeration_do_not_boot_the_device(bench: Bench) -> None:
    """A bus reset before a host has configured the device in DFU mode does not end it: hosts reset more than once."""
    line = RawDfuLine(bench)
    assert line.detach(), "DETACH is answered with STALL"
    try:
        bench.usb.wait_for(DFU_MODE, bench.return_seconds, configured=False)
        if bench.usb.is_configured:
            raise Inconclusive("the computer configures the device by itself before a program can reset it")
        for _ in range(2):
            bench.usb.reset(configured=False)
            expect("the mode after a reset", bench.usb.mode, DFU_MODE)
    finally:
        if bench.usb.mode == DFU_MODE:
            bench.usb.wait_for(DFU_MODE, bench.return_seconds)
            line.leave()


@flashing("DFU-013", "DFU-005", "DFU-010", needs=(Need.FAULTS,))
@pytest.mark.parametrize(
    "status", [DfuStatus.WRITE, DfuStatus.ERASE, DfuStatus.PROG, DfuStatus.VERIFY], ids=lambda status: status.name
)
def test_a_failure_of_the_flash_is_told_as_what_it_is(bench: Bench, status: DfuStatus) -> None:
    """A failure while a block is written leads to dfuERROR with its own status; the previous image would still boot."""
    bank = Bank.B if bench.processors()[0].bank is Bank.A else Bank.A
    address = bank.image_address
    spoil = {
        DfuStatus.WRITE: faults.WriteProtectedFlash(periods=400_000),
        DfuStatus.ERASE: faults.FailingSector(sector=address // SECTOR, periods=400_000),
        DfuStatus.PROG: faults.FailingPage(page=address // PAGE, periods=400_000),
        DfuStatus.VERIFY: faults.StuckFlashBit(address=address, bit=0, value=1, periods=400_000),
    }[status]
    with dfu_mode(bench) as line:
        own = line.own_image()
        bench.levers.cause(spoil)
        line.download(0, large_image(line)[:BLOCK])
        line.poll()
        _expect_error(line, status, "a failure of the flash")
        line.rest()
        expect("the image that would boot next", line.image(), own)
    bench.outlast(11)
