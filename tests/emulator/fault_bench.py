"""A device that plays, and a host that speaks to it over USB only; faults are tried on it."""

from __future__ import annotations

import numpy as np
from phasewire import Emulator, Pulses
from phasewire.emulator.door import Handshake
from phasewire.emulator.ports.capture import Capture
from phasewire.protocol import Ack, Block, Entries, Entry, PlaySequence, Reason, Slot, Status, Update, pack
from phasewire.protocol.blocks import Body
from phasewire.protocol.codes import Request
from phasewire.protocol.replies import ProcessorReport, decode_reports, records
from phasewire.protocol.requests import Setup

MS = 400_000
"""In core cycles of 2.5 ns."""
PERIODS_PER_MS = 40
FULL = Pulses(np.full(320, 25), np.full(320, 25))
HALF = Pulses(np.full(320, 25), np.full(320, 9))
PLAYS = ("update", "sequence", "unattended")


class Bench:
    """A device whose outputs are enabled, and the blocks that it was sent."""

    def __init__(self) -> None:
        self.emulator = Emulator(serial="FAULTY")
        self.configure()
        self.order(Request.ENABLE)

    def configure(self) -> None:
        """Begin a session."""
        self.sent = 0
        self.emulator.usb.control(Setup(0x00, 9, 1, 0, 0))

    def order(self, request: Request, value: int = 0) -> None:
        """Send a vendor request without data."""
        self.emulator.usb.control(Setup(0x41, request, value, 0, 0))

    def status(self) -> Status:
        return Status.decode(self.emulator.usb.control(Setup(0xC1, Request.STATUS, 0, 0, 64)))

    def reports(self) -> list[ProcessorReport]:
        return decode_reports(self.emulator.usb.control(Setup(0xC1, Request.PROCESSORS, 0, 0, 160)))

    def send(self, body: Body) -> Ack:
        """Send a block and read its acknowledgement; the test judges the reason."""
        assert self.emulator.usb.bulk_out(0x01, pack(Block(body, self.sent))) is Handshake.ACK
        self.sent += 1
        *_, ack = (record for record in self.read() if isinstance(record, Ack))
        return ack

    def read(self) -> list[Ack | Status]:
        """The records that wait."""
        answer = self.emulator.usb.bulk_in(0x81)
        return records(answer) if isinstance(answer, bytes) else []

    def play(self, what: str, pulses: Pulses = FULL) -> None:
        """Start playing, and wait until all outputs have begun."""
        if what == "update":
            assert self.send(Update(pulses)).reason is Reason.ACCEPTED
        else:
            self.send(Slot(0, pulses))
            self.send(Entries((Entry(0, 100),)))
            ack = self.send(PlaySequence(first=0, count=1, repeats=0, unattended=what == "unattended"))
            assert ack.reason is Reason.ACCEPTED
        self.emulator.run(40)
        assert self.status().enabled

    def wait_ms(self, milliseconds: float) -> None:
        """Let time pass, with the host silent."""
        self.emulator.scheduler.run_until(self.emulator.scheduler.now + round(milliseconds * MS))

    @property
    def period(self) -> int:
        return self.emulator.running.now_tick // 50

    def capture(self) -> Capture:
        """The outputs of this run; those of the last one if no firmware runs."""
        return self.emulator.past[-1] if self.emulator.controller is None else self.emulator.capture()

    def loud(self, first: int, last: int) -> list[int]:
        """In how many ticks of some periods each processor had any output high."""
        words = self.emulator.capture().bits(50 * first, 50 * last)
        return [int(count) for count in (words != 0).sum(axis=0)]

    def loud_now(self) -> list[int]:
        """The same in the last whole period."""
        last = self.emulator.capture().periods
        return self.loud(last - 1, last)


def playing(what: str = "update") -> Bench:
    """A device that plays."""
    bench = Bench()
    bench.play(what)
    return bench
