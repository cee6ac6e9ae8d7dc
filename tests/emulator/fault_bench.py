"""A device that plays, and a host that speaks to it over USB only; faults are tried on it."""

from __future__ import annotations

import numpy as np
from phasewire import Emulator, Pulses
from phasewire.emulator.ports.capture import Capture
from phasewire.protocol import Entries, Entry, PlaySequence, Reason, Slot, Status, Update
from phasewire.protocol.codes import Request
from phasewire.protocol.replies import ProcessorReport, decode_reports

from tests.emulator.hosts import FULL, Device

MS = 400_000
"""In core cycles of 2.5 ns."""
HALF = Pulses(np.full(320, 25), np.full(320, 9))
PLAYS = ("update", "sequence", "unattended")


class Bench(Device):
    """A device whose outputs are enabled."""

    def __init__(self) -> None:
        super().__init__(Emulator(serial="FAULTY"), enabled=True)

    def configure(self, value: int = 1) -> None:
        """Begin a session."""
        self.number = 0
        super().configure(value)

    def status(self) -> Status:
        return self.ask_status()

    def reports(self) -> list[ProcessorReport]:
        return decode_reports(self.ask(Request.PROCESSORS, 160))

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
