"""A device at the far end of a serial line, made by hand, and a port to it whose line can lose and damage bytes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import serial
from phasewire.protocol import Info, Status
from phasewire.protocol.codes import Fault, FrameKind, Outcome, Request, State
from phasewire.protocol.framing import (
    CONSOLE_FRAME,
    DELIMITER,
    LineMode,
    LineReader,
    SerialFrame,
    SerialReply,
    SerialRequest,
    encode,
)
from phasewire.protocol.replies import Ack

from tests.from_spec import build_ack

Damage = Callable[[bytes], bytes]


class Clock:
    """Time that passes only during a wait."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class HandMade:
    """It answers as SER asks a device to; everything that it carries out is noted."""

    def __init__(self, info: Info, status: Status) -> None:
        self.info, self.status = info, status
        self.line = LineReader()
        self.done: list[Request] = []
        self.requests: list[SerialRequest] = []
        self.blocks: list[bytes] = []
        self.says = bytearray()
        self.stalls: set[int] = set()
        self.answers = True

    def receive(self, data: bytes) -> None:
        for event in self.line.feed(data):
            match event:
                case LineMode.FRAMES:
                    self.says += DELIMITER
                case LineMode.CONSOLE:
                    self.says += encode(CONSOLE_FRAME) + b"> "
                case SerialFrame(FrameKind.REQUEST, body):
                    self._answer(SerialRequest.decode(body))
                case SerialFrame(FrameKind.BLOCK, body):
                    self._acknowledge(body)

    def say(self, kind: FrameKind, body: bytes) -> None:
        self.says += encode(SerialFrame(kind, body))

    def _answer(self, request: SerialRequest) -> None:
        self.requests.append(request)
        if request.request in self.stalls:
            self._reply(request, Outcome.STALL)
            return
        data = b""
        match request.request:
            case Request.INFO:
                data = self.info.encode()
            case Request.STATUS:
                data = self.status.encode()
            case Request.ENABLE:
                self.status = dataclasses.replace(self.status, state=State.READY)
            case Request.DISABLE:
                self.status = dataclasses.replace(self.status, state=State.OFF)
            case Request.CLEAR_FAULTS:
                self.status = dataclasses.replace(self.status, faults=Fault(0))
        self.done.append(Request(request.request))
        self._reply(request, Outcome.DONE, data[: request.length])

    def _reply(self, request: SerialRequest, outcome: Outcome, data: bytes = b"") -> None:
        if self.answers:
            self.say(FrameKind.REPLY, SerialReply(request.tag, outcome, data).encode())

    def _acknowledge(self, block: bytes) -> None:
        self.blocks.append(block)
        if self.answers:
            self.say(FrameKind.RECORD, ack(int.from_bytes(block[4:8], "little")))


def ack(sequence: int) -> bytes:
    fields = {
        "version": 1,
        "reason": 0,
        "sequence": sequence,
        "commit_period": 1,
        "now": 50,
        "flags": 0,
        "free": 7,
        "state": 1,
    }
    record = build_ack(fields)
    assert Ack.decode(record).sequence == sequence
    return record


class BenchPort:
    """The part of pyserial's ports that the line uses. Reading takes the time of the bytes."""

    name = "/dev/bench"

    def __init__(self, device: HandMade, clock: Clock, *, to_device: Damage = bytes, to_host: Damage = bytes) -> None:
        self.device = device
        self.time = clock
        self.baudrate = 115_200
        self.timeout: float | None = None
        self.is_open = False
        self.to_device, self.to_host = to_device, to_host
        self.written: list[bytes] = []
        self.pending = bytearray()
        self.opened = 0
        self.fails: dict[str, Exception] = {}

    def _check(self, what: str) -> None:
        if what in self.fails:
            raise self.fails[what]

    def open(self) -> None:
        self._check("open")
        assert not self.is_open
        self.is_open = True
        self.opened += 1

    def close(self) -> None:
        self.is_open = False
        self._check("close")

    def _fetch(self) -> None:
        self.pending += self.to_host(bytes(self.device.says))
        self.device.says.clear()

    @property
    def in_waiting(self) -> int:
        self._check("in_waiting")
        self._fetch()
        return len(self.pending)

    def read(self, size: int) -> bytes:
        self._check("read")
        if not self.is_open:
            raise serial.PortNotOpenError
        self._fetch()
        if len(self.pending) < size:
            assert self.timeout is not None
            self.time.sleep(self.timeout)
        data = bytes(self.pending[:size])
        del self.pending[:size]
        self.time.sleep(len(data) * 10 / self.baudrate)
        return data

    def write(self, data: bytes) -> int:
        self._check("write")
        if not self.is_open:
            raise serial.PortNotOpenError
        self.written.append(data)
        self.device.receive(self.to_device(data))
        return len(data)
