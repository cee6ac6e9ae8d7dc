"""DFU 1.1 as a host speaks it, request by request (chapter DFU)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from phasewire import Emulator
from phasewire.base.errors import DeviceError, DeviceRefusedError, DeviceStalledError, DeviceTimeoutError
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.emulator.firmware.flash import FlashTimes
from phasewire.host.firmware.dfu import DfuLine, detach
from phasewire.host.transports.usb_find import DFU_MODE, RUN_TIME, UsbFinder
from phasewire.protocol.codes import DfuState, DfuStatus, ImageReason
from phasewire.protocol.dfu import DfuReply

from tests.host.upgrades import BLOCK, BLOCKS, NEW, STORED

assert BLOCKS == 5
assert len(STORED) % BLOCK


@pytest.fixture
def line(emulator: Emulator) -> Iterator[DfuLine]:
    """A line to a device in DFU mode."""
    bus = UsbFinder(emulator.url)
    seen = bus.find()
    assert seen.mode == RUN_TIME
    detach(seen)
    with DfuLine(bus.find_again(seen, (DFU_MODE,), 2)) as opened:
        yield opened


class Requests:
    """The traffic of the control endpoint: request type, request, value, length or data, and when, in ms."""

    def __init__(self, emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
        self.seen: list[tuple[int, int, int, int, float]] = []
        self.answers: dict[int, bytes] = {}
        """Instead of the device's."""
        genuine = EmulatorBackend.ctrl_transfer

        def transfer(bus: EmulatorBackend, handle: Any, kind: int, request: int, value: int, *rest: Any) -> int:
            self.seen.append((kind, request, value, len(rest[1]), emulator.scheduler.now / 400_000))
            if kind == 0xA1 and request in self.answers:
                answer = self.answers[request]
                rest[1][: len(answer)] = type(rest[1])("B", answer)
                return len(answer)
            return genuine(bus, handle, kind, request, value, *rest)

        monkeypatch.setattr(EmulatorBackend, "ctrl_transfer", transfer)


@pytest.fixture
def requests(emulator: Emulator, line: DfuLine, monkeypatch: pytest.MonkeyPatch) -> Requests:
    return Requests(emulator, monkeypatch)


def test_a_download_waits_for_the_poll_time_of_each_answer(
    line: DfuLine, requests: Requests, emulator: Emulator
) -> None:
    """Clause DFU-008: 128 ms for the first block, 68 for even and 8 for odd ones, 2500 in the end; 2048-byte blocks."""
    done: list[int] = []
    line.download(STORED, done.append)
    assert done == [2048, 4096, 6144, 8192, len(STORED)]
    blocks = [(value, length) for kind, request, value, length, _ in requests.seen if (kind, request) == (0x21, 1)]
    assert blocks == [(0, 2048), (1, 2048), (2, 2048), (3, 2048), (4, len(STORED) - 8192), (5, 0)]
    polls = [at for kind, request, *_, at in requests.seen if (kind, request) == (0xA1, 3)]
    waits = [later - sooner for sooner, later in zip(polls[::2], polls[1::2], strict=True)]
    for wait, told in zip(waits, (128, 8, 68, 8, 68, 2500), strict=True):
        assert told <= wait < told + 1
    assert line.status() == DfuReply(DfuStatus.OK, 0, DfuState.DFU_IDLE)
    assert b"".join(line.upload()) == STORED


def test_a_slow_flash_is_waited_for(line: DfuLine, emulator: Emulator) -> None:
    """Clause DFU-008: 400 ms for a sector and 3 ms for a page are usual limits."""
    emulator.flash.times = FlashTimes(erase_ms=400, program_ms=3)
    line.download(STORED)
    assert line.holds(STORED)


@pytest.mark.parametrize("at", [0, 2047, 2048, 5000, len(STORED) - 1])
def test_an_image_that_differs_anywhere_is_another(line: DfuLine, at: int) -> None:
    line.download(STORED)
    other = bytearray(STORED)
    other[at] ^= 1
    assert not line.holds(bytes(other))
    assert not line.holds(STORED[:at])
    assert not line.holds(STORED + b"\0")
    assert line.status().state is DfuState.DFU_IDLE


def test_an_image_of_whole_blocks_ends_with_an_empty_one(line: DfuLine) -> None:
    size = 2 * BLOCK - len(NEW.encode()) + len(NEW.segments[0].data)
    whole = type(NEW)(NEW.version, (NEW.segments[0]._replace(data=bytes(size)), NEW.segments[1])).encode()
    assert len(whole) == 2 * BLOCK
    line.download(whole)
    assert line.holds(whole)
    assert [len(block) for block in line.upload()] == [BLOCK, BLOCK, 0]


def test_a_refusal_has_the_device_s_words(line: DfuLine, emulator: Emulator) -> None:
    """Clause DFU-012: string 16 + reason."""
    bad = bytearray(STORED)
    bad[0] ^= 1
    with pytest.raises(DeviceRefusedError, match=r"refuses the image: this is no firmware image$") as refused:
        line.download(bytes(bad))
    assert refused.value.reason is ImageReason.MAGIC
    assert not emulator.flash.erasures.any()
    line.make_idle()
    bad = bytearray(STORED)
    bad[5000] ^= 1
    with pytest.raises(DeviceRefusedError, match=r"a segment's CRC-32 or SHA-256 does not match$") as refused:
        line.download(bytes(bad))
    assert refused.value.reason is ImageReason.HASH
    line.make_idle()
    with pytest.raises(DeviceRefusedError) as refused:
        line.download(STORED[:20])
    assert refused.value.reason is ImageReason.LENGTH


@pytest.mark.parametrize(
    ("reply", "reason", "message"),
    [
        (DfuReply(DfuStatus.FILE, 0, DfuState.ERROR, 16 + 99), DfuStatus.FILE, "refuses the image: status FILE"),
        (DfuReply(DfuStatus.TARGET, 0, DfuState.ERROR, 0), DfuStatus.TARGET, "refuses the image: status TARGET"),
        (DfuReply(DfuStatus.FILE, 0, DfuState.ERROR, 16 + 13), ImageReason.HASH, "a segment's CRC-32"),
        (DfuReply(DfuStatus.PROG, 0, DfuState.ERROR, 0), DfuStatus.PROG, r"\(PROG\): a page was not programmed"),
    ],
)
def test_a_later_device_may_have_other_reasons(
    line: DfuLine, requests: Requests, reply: DfuReply, reason: int, message: str
) -> None:
    requests.answers[3] = reply.encode()
    with pytest.raises(DeviceRefusedError, match=message) as refused:
        line.download(STORED)
    assert refused.value.reason is reason


@pytest.mark.parametrize(
    ("answers", "call", "error", "message"),
    [
        ({3: b"\x00\x00\x00"}, DfuLine.status, DeviceError, "breaks the protocol"),
        ({3: b"\x00\x00\x00\x00\x63\x00"}, DfuLine.status, DeviceError, "breaks the protocol"),
        ({3: b"\x00\x80\x00\x00\x04\x00"}, DfuLine.make_idle, DeviceTimeoutError, "busy for longer than the 10 s"),
        ({3: b"\x00\xff\xff\xff\x04\x00"}, DfuLine.make_idle, DeviceTimeoutError, "busy for longer than the 10 s"),
        ({3: b"\x0f\x00\x00\x00\x0a\x00"}, DfuLine.make_idle, DeviceStalledError, "does not come to rest"),
        ({2: bytes(BLOCK)}, lambda line: list(line.upload()), DeviceError, "more than the largest image"),
        ({3: b"\x00\x00\x00\x00\x02\x00"}, lambda line: line.download(STORED), DeviceStalledError, "state DFU_IDLE"),
        ({3: b"\x0f\x00\x00\x00\x0a\x00"}, lambda line: line.download(STORED), DeviceStalledError, "STALLEDPKT"),
    ],
)
def test_a_device_that_does_not_keep_to_it_is_given_up(
    line: DfuLine,
    requests: Requests,
    emulator: Emulator,
    answers: dict[int, bytes],
    call: Callable[[DfuLine], object],
    error: type[DeviceError],
    message: str,
) -> None:
    requests.answers = answers
    began = emulator.scheduler.now
    with pytest.raises(error, match=message) as raised:
        call(line)
    assert type(raised.value) is error
    assert emulator.scheduler.now - began < 21 * 400_000_000
    assert len(requests.seen) < 400
