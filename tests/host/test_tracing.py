"""Traffic in words: a line for each transfer, on demand one for each piece; the traffic itself stays unchanged."""

from __future__ import annotations

import logging
from typing import cast

import numpy as np
import pytest
from phasewire import Emulator, Pulses
from phasewire.base.errors import DeviceLostError
from phasewire.host.firmware.flashing import flash
from phasewire.host.firmware.images import read_firmware
from phasewire.host.transports.tracing import (
    TRAFFIC,
    TracedTransport,
    log_request,
    split_records,
    traced,
)
from phasewire.host.transports.transport import Timekeeper, Transport
from phasewire.protocol.blocks import Block, Update, pack
from phasewire.protocol.codes import REQUEST_TYPE_OUT, AckFlag, Reason, Request, State
from phasewire.protocol.replies import Ack, Status
from phasewire.protocol.requests import Setup

from tests.host import upgrades

PULSES = Pulses(np.full(320, 25), np.full(320, 25))


class Line:
    """A line that takes and gives what a test sets."""

    name, serial, lossy, posts, most_blocks_per_second = "a line", "SERIAL", True, False, 40.0

    def __init__(self) -> None:
        self.time: Timekeeper = self
        self.now = 100.0
        self.records = b""
        self.answer = b""
        self.most_bytes = 1 << 20
        self.error: DeviceLostError | None = None
        self.calls: list[tuple[object, ...]] = []

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float, /) -> None:
        self.now += seconds

    def _call(self, *what: object) -> None:
        self.calls.append(what)
        self.now += 0.001
        if self.error:
            raise self.error

    def window(self, free: int | None, records: int) -> int:
        self._call("window", free, records)
        return 7

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        self._call("write", len(blocks), seconds)
        return min(len(blocks), self.most_bytes)

    def read_records(self, seconds: float) -> bytes:
        self._call("read", seconds)
        return self.records

    def take_back(self) -> int:
        self._call("take back")
        return 3 * 512

    def query(self, request: Request, size: int) -> bytes:
        self._call("query", request, size)
        return self.answer

    def command(self, request: Request, value: int = 0) -> None:
        self._call("command", request, value)

    def reopen(self, seconds: float) -> None:
        self._call("reopen", seconds)

    def close(self) -> None:
        self._call("close")


def block(sequence: int) -> bytes:
    return pack(Block(Update(PULSES, 1000 + sequence), sequence))


def ack(sequence: int, reason: Reason = Reason.ACCEPTED, flags: int = 0) -> bytes:
    return Ack(reason, sequence, 1000 + sequence, 50 * sequence, AckFlag(flags), 12, State.PLAYING).encode()


@pytest.fixture
def line() -> Line:
    return Line()


def test_a_line_without_listeners_is_not_wrapped(line: Line) -> None:
    assert traced(line) is cast("Transport", line)


def test_what_is_asked_and_answered_is_passed_on(line: Line) -> None:
    through = TracedTransport(line)
    line.answer, line.records, line.most_bytes = b"1234", ack(3), 512
    assert (through.name, through.serial, through.time) == ("a line", "SERIAL", line)
    assert (through.lossy, through.most_blocks_per_second) == (True, 40.0)
    assert through.window(None, 64) == 7
    assert through.write_blocks(block(1) + block(2), 0.5) == 512
    assert through.read_records(0.25) == ack(3)
    assert through.query(Request.INFO, 64) == b"1234"
    through.command(Request.WATCHDOG, 100)
    through.reopen(3)
    through.close()
    assert line.calls == [
        ("window", None, 64),
        ("write", 1024, 0.5),
        ("read", 0.25),
        ("query", Request.INFO, 64),
        ("command", Request.WATCHDOG, 100),
        ("reopen", 3),
        ("close",),
    ]


def traffic(caplog: pytest.LogCaptureFixture, level: int, line: Line) -> TracedTransport:
    caplog.set_level(level, logger=TRAFFIC)
    through = traced(line)
    assert isinstance(through, TracedTransport)
    return through


def test_a_transfer_is_a_line_and_so_is_each_piece_on_demand(line: Line, caplog: pytest.LogCaptureFixture) -> None:
    blocks = b"".join(block(sequence) for sequence in range(7, 71))
    line.records = ack(7) + ack(8, flags=AckFlag.LATE) + ack(9, Reason.RATE)
    through = traffic(caplog, logging.INFO, line)
    through.write_blocks(blocks, 1)
    through.read_records(1)
    assert caplog.messages == [
        "    0.000000 s      line            to a line",
        "    0.001000 s  out transfer        64 blocks, 7 to 70: 64 UPDATE",
        "    0.002000 s  in  transfer        3 records: 2 ACCEPTED, 1 RATE, 1 LATE; the last for 9, period 1009, "
        "PLAYING, room for 12",
    ]
    caplog.clear()
    caplog.set_level(logging.DEBUG, logger=TRAFFIC)
    through.write_blocks(blocks, 1)
    through.read_records(1)
    assert len(caplog.messages) == 1 + 64 + 1 + 3
    assert caplog.messages[1] == (
        "    0.003000 s  out block           UPDATE 7: 320 pulses of at most 25 ticks, total drive 320.0, "
        "from period 1007 on"
    )
    assert caplog.messages[-2] == (
        "    0.004000 s  in  acknowledgement 8 accepted, period 1008, LATE; PLAYING at tick 400, room for 12"
    )


def test_blocks_that_were_taken_back_are_logged(line: Line, caplog: pytest.LogCaptureFixture) -> None:
    assert traffic(caplog, logging.INFO, line).take_back() == 3 * 512
    assert caplog.messages[1].endswith("out blocks          3 were taken back")


def test_a_failing_call_is_logged_and_still_fails(line: Line, caplog: pytest.LogCaptureFixture) -> None:
    through = traffic(caplog, logging.INFO, line)
    line.error = DeviceLostError("the device is gone")
    for fail in (
        lambda: through.write_blocks(block(1), 1),
        lambda: through.read_records(1),
        lambda: through.take_back(),
        lambda: through.query(Request.INFO, 64),
        lambda: through.command(Request.ENABLE),
        lambda: through.reopen(1),
    ):
        with pytest.raises(DeviceLostError, match="the device is gone"):
            fail()
    assert [message[16:] for message in caplog.messages[1:]] == [
        "out block           ✗ the device is gone",
        "in  record          ✗ the device is gone",
        "out block           ✗ the device is gone",
        "in  request         INFO ✗ the device is gone",
        "out request         ENABLE ✗ the device is gone",
        "    line            ✗ the device is gone",
    ]


def test_damaged_records_are_logged_as_such(line: Line, caplog: pytest.LogCaptureFixture) -> None:
    through = traffic(caplog, logging.INFO, line)
    line.records = ack(1) + ack(2)[:-1] + b"\x00"
    through.read_records(1)
    assert "in  transfer        2 records ✗ " in caplog.messages[1]
    line.records = ack(1)[:-1]
    through.read_records(1)
    assert "in  acknowledgement" in caplog.messages[2]
    assert "✗ ACK-002" in caplog.messages[2]


def test_records_are_split_where_the_device_put_them_together() -> None:
    status = b"PS" + bytes(Status.BYTES - 2)
    assert split_records(ack(1) + status + ack(2) + b"PA") == [ack(1), status, ack(2), b"PA"]
    assert split_records(b"") == []


def test_requests_outside_a_line_are_logged_too(emulator: Emulator, caplog: pytest.LogCaptureFixture) -> None:
    """An upgrade's are: DFU is spoken over no line of blocks and records."""
    caplog.set_level(logging.INFO, logger=TRAFFIC)
    flash(emulator.url, read_firmware(upgrades.FILE))
    told = [message.split(" s  ", 1)[1] for message in caplog.messages]
    assert told[1] == "out request         DETACH"
    assert f"out request         DNLOAD block 0, 2048 bytes: {upgrades.STORED[:4].hex(' ')} …" in told
    assert "in  request         GETSTATUS: MANIFEST, OK, wait 2500 ms" in told
    caplog.clear()
    log_request(Setup(REQUEST_TYPE_OUT, Request.ENABLE, 0, 0, 0), None, stalled=True)
    assert caplog.messages[0].endswith("s  out request         ENABLE, answered with STALL")
