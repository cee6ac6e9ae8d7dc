"""The executed processor and the Python model of one side by side: the same messages, pins and times for both."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from phasewire.emulator.boards.processor import Processor
from phasewire.emulator.ports.capture import Capture
from phasewire.emulator.ports.clock import BoardClock, Timebase
from phasewire.emulator.scheduler import Scheduler
from phasewire.emulator.trace import Tracer
from phasewire.protocol.board import CYCLES_PER_PERIOD, TICKS_PER_PERIOD
from phasewire.protocol.chain import Collect, Message, Number, Playing, Report
from phasewire.protocol.codes import ChannelEnd
from phasewire.protocol.wiring import Wiring

from .harness import Bench

UNIQUE_ID = 0x0123456789ABCDEF
VERSION = (0, 1, 0)


class Pair:
    """A bench and a model; both are numbered, and their period 0 has begun."""

    def __init__(self, number: int = 3, **options: object) -> None:
        self.bench = Bench(unique_id=UNIQUE_ID, **options)  # type: ignore[arg-type]
        self.bench.begin(number)
        assert self.bench.origin is not None
        self.scheduler = Scheduler()
        self.model = Processor(self.scheduler, number, BoardClock(), VERSION, UNIQUE_ID, lambda _: None, Tracer())
        self.model.receive(Number(number).encode())
        self.origin = self.bench.origin
        self.model.start(Timebase(self.origin))
        self.scheduler.run_until(self.origin)
        self.model.listen(self.origin)

    def at(self, cycle: int, action: Callable[[], None]) -> None:
        """Do something to the model at a cycle."""
        self.scheduler.at(cycle, action)

    def bring(self, message: Message, at: int) -> int:
        """Bring a message to both; returns the cycle of its END."""
        arrives = self.bench.bring(message, at)
        self.at(arrives, lambda: self._receive(message))
        return arrives

    def _receive(self, message: Message) -> None:
        self.model.receive(message.encode())

    def damage(self, channel_end: int, tokens: NDArray[np.uint16], at: int) -> None:
        """Bring tokens to a channel end, which are no message."""
        arrives = self.bench.deliver(channel_end, tokens, at)
        header = self.bench.number.to_bytes(2, "big") + bytes([channel_end])
        self.at(arrives, lambda: self._receive_bytes(header + tokens.astype(np.uint8).tobytes()))

    def _receive_bytes(self, tokens: bytes) -> None:
        self.model.receive(tokens)

    def set_temperature(self, celsius: int, at: int) -> None:
        self.bench.set_temperature(celsius, at)
        self.at(at, lambda: self.model.set_temperature(celsius))

    def set_supply(self, millivolts: int, at: int) -> None:
        self.bench.set_supply(12_000 <= millivolts <= 18_000, at)
        self.at(at, lambda: self.model.set_supply(millivolts))

    def boundary(self, period: int) -> int:
        return self.bench.boundary(period)

    def run_to(self, period: int, cycles: int = 0) -> None:
        """Run both up to a time."""
        at = self.boundary(period) + cycles
        self.bench.run(at)
        self.scheduler.run_until(at)

    def ask(self, at: int) -> tuple[Report, Report]:
        """Both reports."""
        return self._ask(ChannelEnd.REPORT, at)  # type: ignore[return-value]

    def ask_playing(self, at: int) -> tuple[Playing, Playing]:
        """What both say that they play."""
        return self._ask(ChannelEnd.PLAYING, at)  # type: ignore[return-value]

    def _ask(self, what: ChannelEnd, at: int) -> tuple[Message, Message]:
        question = Collect(self.bench.number, what)
        arrives = self.bench.bring(question, at)
        self.bench.run(arrives + 8 * 4000)
        answers = self.bench.answers()
        assert len(answers) == 1
        self.scheduler.run_until(arrives)
        wanted = self.model.receive(question.encode())
        assert wanted is not None
        return answers[0], wanted

    def words(self, first: int, last: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """The words of both in periods, (n, 50)."""
        track = self.model.track()
        capture = Capture(Wiring.strips(), last * TICKS_PER_PERIOD, (track,) * 10)
        bits = capture.bits(first * TICKS_PER_PERIOD, last * TICKS_PER_PERIOD)[:, 0]
        return self.bench.words(first, last), bits.reshape(-1, TICKS_PER_PERIOD).astype(np.uint32)

    @property
    def period(self) -> int:
        return (self.bench.core.cycle - self.origin) // CYCLES_PER_PERIOD
