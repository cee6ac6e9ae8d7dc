"""Hosts for a whole device: one at its USB bus, one at its serial line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from phasewire import Emulator, Pulses
from phasewire.emulator.door import Handshake
from phasewire.emulator.interfaces.serial_line import SerialLine
from phasewire.protocol.blocks import AmplitudeModulation, Block, Body, Output, PlaySequence, Update, pack
from phasewire.protocol.codes import FrameKind, Outcome, Request, State
from phasewire.protocol.framing import LineReader, SerialFrame, SerialReply, SerialRequest, encode
from phasewire.protocol.replies import Ack, Info, ReadBack, Status, records
from phasewire.protocol.requests import Setup

PERIOD = 10_000
"""Core cycles."""
PERIODS_PER_MS = 40
FULL = Pulses(np.full(320, 25), np.full(320, 25))
HALF = Pulses(np.full(320, 50), np.full(320, 12))
SILENT = Pulses.silent(320)


def pulses(width: int) -> Pulses:
    """All transducers alike."""
    return Pulses(np.full(320, width), np.full(320, width))


class Device:
    """A whole device, a host at its USB bus, and a logic analyser.

    Blocks are numbered from 0 on, unless a number is given.
    """

    def __init__(self, emulator: Emulator | None = None, *, configured: bool = True, enabled: bool = False) -> None:
        self.emulator = emulator or Emulator()
        self.usb = self.emulator.usb
        self.number = 0
        if configured:
            self.configure()
        if enabled:
            self.order(Request.ENABLE)

    # Requests

    def configure(self, value: int = 1) -> None:
        self.usb.control(Setup(0x00, 9, value, 0, 0))

    def order(self, request: Request, value: int = 0) -> None:
        self.usb.control(Setup(0x41, request, value, 0, 0))

    def ask(self, request: Request, length: int) -> bytes:
        return self.usb.control(Setup(0xC1, request, 0, 0, length))

    def ask_status(self) -> Status:
        """Ask for STATUS, which is a sign of life."""
        return Status.decode(self.ask(Request.STATUS, 64))

    def read_back(self) -> ReadBack:
        return ReadBack.decode(self.ask(Request.PULSES, 496))

    def info(self) -> Info:
        return Info.decode(self.ask(Request.INFO, 64))

    def detach(self) -> None:
        self.usb.control(Setup(0x21, 0, 1000, 3, 0))

    # Blocks and records

    def pack(self, body: Body, number: int | None = None, *, restart: bool = False) -> bytes:
        number = self.number if number is None else number
        self.number = number + 1
        return pack(Block(body, number, restart))

    def send(self, body: Body, number: int | None = None) -> Ack:
        """Send a block that the device takes at once, and read its acknowledgement."""
        block = self.pack(body, number)
        assert self.usb.bulk_out(0x01, block) is Handshake.ACK
        acks = [record for record in self.records() if isinstance(record, Ack)]
        return acks[-1]

    def send_at(self, body: Update | PlaySequence | AmplitudeModulation | Output, period: int) -> Ack:
        """Send a change for a period."""
        return self.send(replace(body, period=period))

    def send_in_time(self, *bodies: Body) -> list[Ack]:
        """Send blocks as soon as the device takes them, and read their acknowledgements."""
        acks = []
        for body in bodies:
            block = self.pack(body)
            while self.usb.bulk_out(0x01, block) is Handshake.NAK:
                upcoming = self.emulator.scheduler.next_time()
                assert upcoming is not None
                self.emulator.scheduler.run_until(upcoming)
            acks += [record for record in self.records() if isinstance(record, Ack)]
        return acks

    def records(self) -> list[Ack | Status]:
        """All records that wait on 81 IN."""
        found: list[Ack | Status] = []
        while isinstance(packet := self.usb.bulk_in(0x81), bytes):
            found += records(packet)
        return found

    def told(self) -> list[Status]:
        """The unsolicited records that wait on 81 IN."""
        return [record for record in self.records() if isinstance(record, Status)]

    # Observations; they change nothing

    @property
    def state(self) -> State:
        return self.emulator.running.state

    def status(self) -> Status:
        """The answer to STATUS, without the sign of life that the request is."""
        self.emulator.running.settle()
        return self.emulator.running.status()

    @property
    def cycle(self) -> int:
        """Core cycles since period 0."""
        return self.emulator.scheduler.now - self.emulator.running.time.origin

    @property
    def period(self) -> int:
        return self.cycle // PERIOD

    def widths(self) -> NDArray[np.int64]:
        """How long transducer 0 is high in each period since period 0, in ticks."""
        capture = self.emulator.capture()
        words = capture.bits(0, capture.periods * 50)
        processor, bit = divmod(int(capture.wiring.channels[0]), 32)
        return np.asarray((words[:, processor] >> bit & 1).reshape(-1, 50).sum(axis=1))

    def high_periods(self) -> set[int]:
        """Periods in which any output is high, the last one that has begun included."""
        capture = self.emulator.capture()
        ticks = np.flatnonzero(capture.bits(0, capture.end_tick).any(axis=1))
        return set((ticks // 50).tolist())

    # Time

    def run(self, periods: int) -> None:
        self.emulator.run(periods)

    def run_ms(self, milliseconds: float) -> None:
        self.emulator.scheduler.run_until(self.emulator.scheduler.now + round(milliseconds * 400_000))

    def run_until(self, cycle: int) -> None:
        """Let time pass until a core cycle after period 0 began."""
        self.emulator.scheduler.run_until(self.emulator.running.time.origin + cycle)

    def run_until_started(self) -> None:
        """Let time pass until the device has started anew."""
        before = self.emulator.controller
        while self.emulator.controller is before:
            upcoming = self.emulator.scheduler.next_time()
            assert upcoming is not None
            self.emulator.scheduler.run_until(upcoming)
        self.emulator.run_until_started()

    def set_temperature(self, celsius: int, processor: int = 3) -> None:
        """Give a board a temperature, and wait until the controller knows it."""
        self.emulator.running.unfold()
        self.emulator.processors[processor].set_temperature(celsius)
        self.run_ms(12)


class Terminal:
    """A host at a serial line: it sends text, and frames after `enter_frames`."""

    def __init__(self, line: SerialLine | None) -> None:
        assert line is not None
        self.line = line
        self._incoming = LineReader()
        self._tag = 0

    def type(self, text: str) -> str:
        """Type a line; returns what the terminal shows."""
        self.line.receive(f"{text}\r".encode("ascii"))
        return self.shown()

    def shown(self) -> str:
        return b"".join(event for event in self._events() if isinstance(event, bytes)).decode("ascii")

    def _events(self) -> list[object]:
        return list(self._incoming.feed(self.line.take(100_000)))

    def enter_frames(self) -> None:
        self.line.receive(b"\0")
        self._events()

    def frames(self) -> list[SerialFrame]:
        """The received frames."""
        return [event for event in self._events() if isinstance(event, SerialFrame)]

    def records(self) -> list[Ack | Status]:
        """The received records."""
        return records(b"".join(frame.body for frame in self.frames() if frame.kind is FrameKind.RECORD))

    def told(self) -> list[Status]:
        """The received unsolicited records."""
        return [record for record in self.records() if isinstance(record, Status)]

    def send(self, block: bytes) -> list[Ack | Status]:
        """Send a block; returns the records that come at once."""
        self.line.receive(encode(SerialFrame(FrameKind.BLOCK, block)))
        return self.records()

    def request(self, request_type: int, request: int, value: int = 0, length: int = 0) -> SerialReply:
        self._tag = (self._tag + 1) % 256
        body = SerialRequest(self._tag, request_type, request, value, 0, length).encode()
        self.line.receive(encode(SerialFrame(FrameKind.REQUEST, body)))
        replies = [SerialReply.decode(frame.body) for frame in self.frames() if frame.kind is FrameKind.REPLY]
        (reply,) = [reply for reply in replies if reply.tag == self._tag]
        return reply

    def order(self, request: Request, value: int = 0) -> Outcome:
        return self.request(0x41, request, value).outcome

    def ask_status(self) -> Status:
        return Status.decode(self.request(0xC1, Request.STATUS, length=64).data)
