"""A model of one driver processor: mailbox, memories, rasteriser, and a 32-bit port that plays tables of 50 words.

It takes whole messages from the chain and answers some; what its port plays is kept in a `History`. It knows nothing of
links, of the controller or of other processors. `executed` is a processor that executes its firmware instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.errors import ChainError
from ...protocol.board import (
    CYCLES_PER_MS,
    CYCLES_PER_PERIOD,
    PROCESSORS_PER_BOARD,
    TICKS_PER_PERIOD,
)
from ...protocol.chain import (
    MEMORIES,
    SLICE_BYTES,
    Collect,
    Commit,
    Identity,
    Load,
    Message,
    Number,
    Playing,
    Program,
    Report,
    Slice,
    decode,
)
from ...protocol.codes import (
    DEAF_MS,
    SILENCING_FAULTS,
    SUPPLY_RANGE_MV,
    SYNC_PERIODS,
    SYNC_TOLERANCE_TICKS,
    TEMPERATURE_LIMIT_C,
    UNNUMBERED_NODE,
    ChannelEnd,
    Fault,
    Memory,
)
from ...protocol.timing import MODULATE_CYCLES, RASTERISE_CYCLES
from ..ports.capture import Track
from ..ports.clock import COUNTER_TICKS, BoardClock, Timebase
from ..ports.history import History
from ..scheduler import Scheduler
from ..trace import Tracer
from .package import Package

__all__ = ["Processor"]

COUNTER_BITS = 16
SYNC_STEP = SYNC_PERIODS * TICKS_PER_PERIOD % COUNTER_TICKS
"""By how much the port's counter advances from one pulse of the sync line to the next (clause CHN-027)."""
DEAF_CYCLES = DEAF_MS * CYCLES_PER_MS
DRIFT_RANGE = (-128, 127)
NO_PULSE = "no pulse on the sync line"
PERSISTENT = Fault.SYNC | Fault.TEMPERATURE | Fault.SUPPLY
"""Faults that last, SYNC until a restart and the others as long as their cause; all else are events, said once."""


@dataclass(eq=False)
class Waiting:
    """A rasterised slice that waits for its period."""

    period: int
    packed: bytes


class Processor(Package):
    """One of the ten.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    place : int
        Its place in the chain, 0 to 9. It is not told: `number` is what it was given.
    clock : BoardClock
        The ticks of its board.
    firmware : (int, int, int)
        Version that it runs.
    unique_id : int
        64 bits, of its package.
    log : callable
        What takes a line about each thing that happens.
    tracer : Tracer
        What is told of its work.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        place: int,
        clock: BoardClock,
        firmware: tuple[int, int, int],
        unique_id: int,
        log: Callable[[str], None],
        tracer: Tracer,
    ) -> None:
        super().__init__(scheduler, place, clock)
        self.firmware = firmware
        self._unique_id = unique_id
        self._log = log
        self._tracer = tracer
        self._scope = f"board{place // PROCESSORS_PER_BOARD}.processor{place % PROCESSORS_PER_BOARD}"
        self.history = History()
        self._number: int | None = None
        self.slowness = 1
        """Times that everything takes longer than its budget; more than 1 is a fault."""
        self.missed_commits = self.damaged_messages = self.carried_out = 0
        self.faults = Fault(0)
        self._memories = {memory: bytearray(layout.size) for memory, layout in MEMORIES.items()}
        self._mailbox: bytes | None = None
        self._table: Waiting | None = None
        self._programs: dict[Memory, Program] = {}
        self._late: dict[Memory, Program] = {}
        """Programs whose period has come and whose first table is not ready."""
        self._modulated = False
        self._heard = 0
        self._counter_at_pulse = 0
        self._late_ticks = 0
        self.drift = 0

    @property
    def number(self) -> int | None:
        """The number that it took; None before (clause CHN-022)."""
        return self._number

    # What happens to it

    def start(self, time: Timebase) -> None:
        """The first pulse of the sync line: period 0 begins."""
        self._time = time
        self._counter_at_pulse = self.clock.counter(0)
        self._heard = time.origin
        if not self.sync_connected:
            self._raise(Fault.SYNC, NO_PULSE)

    def take_up_pulses(self, tick: int) -> None:
        """Every pulse of the sync line up to a tick of the device, that of one of them, came in time."""
        self._counter_at_pulse = self.clock.counter(tick)

    def feel_pulse(self, tick: int) -> None:
        """A later pulse of the sync line is due, at a tick of the device.

        Notes
        -----
        The counter wraps between any two pulses; its difference modulo 2¹⁶ is compared with what it should be, and the
        differences add up to how far the port is off since its start.
        """
        if not self.sync_connected:
            self._raise(Fault.SYNC, NO_PULSE)
            return
        counter = self.clock.counter(tick)
        self._signal("counter", counter, COUNTER_BITS)
        early = (counter - self._counter_at_pulse - SYNC_STEP + COUNTER_TICKS // 2) % COUNTER_TICKS - COUNTER_TICKS // 2
        self._counter_at_pulse = counter
        self._late_ticks += early  # the counter has gone further: the pulse came late
        self.drift = min(max(self._late_ticks, DRIFT_RANGE[0]), DRIFT_RANGE[1])
        if abs(self._late_ticks) > SYNC_TOLERANCE_TICKS:
            self._raise(Fault.SYNC, f"the sync pulse is {self._late_ticks} ticks off")

    def set_temperature(self, celsius: int) -> None:
        """The board has another temperature."""
        self.temperature_c = celsius
        self._judge(Fault.TEMPERATURE, celsius > TEMPERATURE_LIMIT_C, f"{celsius} °C")

    def set_supply(self, millivolts: int) -> None:
        """The output amplifiers get another voltage."""
        self._judge(Fault.SUPPLY, millivolts not in SUPPLY_RANGE_MV, f"{millivolts / 1000:g} V")

    def slow_down(self, slowness: int) -> None:
        """From now on everything takes so many times as long as its budget; 1 is as it should be."""
        self.slowness = slowness
        if self.history.runs or self._modulated:
            self._lag()

    def track(self) -> Track:
        """What its port did so far."""
        return Track(self.history.segments(), self.clock, tuple(self.forced))

    def forget(self, period: int) -> None:
        """Drop what its port did before a period of its own clock."""
        self.history.forget(period)

    # Messages

    def receive(self, tokens: bytes) -> Message | None:
        """Take a message that is complete at this moment; the answer, if it asks for one (clause CHN-010)."""
        if self.stopped:
            return None
        try:
            message = decode(tokens)
            node = UNNUMBERED_NODE if self.number is None else self.number
            if message.node != node:
                raise ChainError(f"a message for node {message.node:#06x}", "CHN-010")
        except ChainError as error:
            self.damaged_messages += 1
            self._raise(Fault.CHAIN, f"drops a damaged message: {error}")
            return None
        match message:
            case Slice():
                self._mailbox = message.packed
                self._tracer.begin(self._scheduler.now, f"mailbox {self.place}", "mailbox")
                self._signal("mailbox", 1)
            case Commit():
                self._commit(message)
            case Load():
                self.load(message.memory, message.first, message.data)
            case Program():
                self._program(message)
            case Collect():
                self._heard = self._scheduler.now
                return self._answer(message.answer)
            case Number():
                self._number = message.number
                return Identity(message.number, self.is_last, self.firmware, self._unique_id)
        return None

    def _commit(self, commit: Commit) -> None:
        packed, self._mailbox = self._mailbox, None
        now = self._scheduler.now
        self._tracer.end(now, f"mailbox {self.place}")
        self._signal("mailbox", 0)
        problem = None
        if packed is None or not commit.guards(packed):
            problem = "the slice in the mailbox is another"
        elif self._table is not None:
            problem = "another table waits"
        elif not self._in_time(commit.period):
            problem = "too late to rasterise"
        if problem or packed is None:
            self._miss(f"the commit for period {commit.period}: {problem}")
            return
        self._table = waiting = Waiting(commit.period, packed)
        self._tracer.span(now, now + self.rasterise_cycles, f"processor {self.place}", "rasterise")
        self._tracer.begin(now + self.rasterise_cycles, f"processor {self.place}", "waits")
        self._signal("table", 1)
        self._at_boundary(commit.period, lambda: self._turn_table(waiting))

    def _program(self, program: Program) -> None:
        if program.memory in self._programs or not self._in_time(program.period):
            self._miss(f"the program for period {program.period}: too late, or another waits")
            return
        self._programs[program.memory] = program
        self._at_boundary(program.period, lambda: self._turn_program(program))

    def _signal(self, name: str, value: int, width: int = 1) -> None:
        self._tracer.value(self._scheduler.now, f"{self._scope}.{name}", width, value)

    def _miss(self, what: str) -> None:
        self.missed_commits += 1
        self._raise(Fault.CHAIN, f"misses {what}")

    def _in_time(self, period: int) -> bool:
        """Whether its tables can be ready when a period begins (clause CHN-004)."""
        if self._time is None:
            return False
        in_time = self._scheduler.now + self.rasterise_cycles <= self._time.boundary(period)
        if not in_time and self.slowness > 1:
            self._overrun()
        return in_time

    @property
    def rasterise_cycles(self) -> int:
        """How long it takes to make the table of a period."""
        return (RASTERISE_CYCLES + (MODULATE_CYCLES if self._modulated else 0)) * self.slowness

    def _at_boundary(self, period: int, action: Callable[[], None]) -> None:
        assert self._time is not None
        self._scheduler.at(self._time.boundary(period), action)

    def _turn_table(self, waiting: Waiting) -> None:
        if self._table is waiting:
            self._table = None
            self._late.pop(Memory.ENTRIES, None)
            now = self._scheduler.now
            self._tracer.end(now, f"processor {self.place}")
            self._tracer.begin(now, f"port {self.place}", "plays")
            self._signal("table", 0)
            self.play(np.array([waiting.period]), np.frombuffer(waiting.packed, np.uint8)[None])

    def _turn_program(self, program: Program) -> None:
        if self._programs.get(program.memory) is program:
            del self._programs[program.memory]
            self.carry_out(program)

    def _answer(self, wanted: ChannelEnd) -> Message:
        if wanted is ChannelEnd.PLAYING:
            return self.playing(self._period)
        report = Report(
            processor=self.place,
            temperature_c=self.temperature_c,
            faults=int(self.faults),
            firmware=self.firmware,
            drift=self.drift,
            carried_out=self.carried_out % 2**32,
            missed_commits=self.missed_commits % 2**32,
            damaged_messages=self.damaged_messages % 2**32,
        )
        self.faults &= PERSISTENT
        return report

    @property
    def _period(self) -> int:
        return 0 if self._time is None else max(self._time.period(self._scheduler.now), 0)

    # What it plays

    def play(self, periods: NDArray[np.int64], slices: NDArray[np.uint8]) -> None:
        """Play slices, (n, 48), each from its period on, (n,)."""
        self.carried_out += len(periods)
        self.history.play(periods, np.zeros_like(slices) if self._silenced else slices)

    def load(self, memory: Memory, first: int, data: bytes) -> None:
        """Keep items of a memory (clause CHN-012)."""
        at = first * MEMORIES[memory].item_bytes
        self._memories[memory][at : at + len(data)] = data

    def carry_out(self, program: Program) -> None:
        """Start or stop the sequence or the modulation (clause CHN-014)."""
        if self._silenced:
            return
        stored = self._memories[program.memory]
        layout = MEMORIES[program.memory]
        items = bytes(stored[program.first * layout.item_bytes : (program.first + program.count) * layout.item_bytes])
        if program.memory is Memory.SAMPLES:
            self._modulated = bool(items)
        if items and (lag := self._lag()):
            # Its first table comes late, and so does every step; what the history takes meanwhile comes before.
            self._late[program.memory] = program
            self._at_boundary(program.period + lag, lambda: self._begin_late(program, items, lag))
        else:
            self._late.pop(program.memory, None)
            self._enter(program, program.period, items)

    def _begin_late(self, program: Program, items: bytes, lag: int) -> None:
        if self._late.get(program.memory) is program:
            del self._late[program.memory]
            self._enter(program, program.period + lag, items)

    def _enter(self, program: Program, period: int, items: bytes) -> None:
        """Begin a program, or stop it if there are no items."""
        if program.memory is Memory.SAMPLES:
            self.history.modulate(period, items, program.hold)
        elif items:
            slots, periods = np.frombuffer(items, "<u2").astype(np.int64).reshape(-1, 2).T
            used, entries = np.unique(slots, return_inverse=True)
            pulses = self._memories[Memory.SLOTS]
            packed = [bytes(pulses[slot * SLICE_BYTES : (slot + 1) * SLICE_BYTES]) for slot in used]
            if periods.any():
                self.history.run(period, packed, entries, periods, program.repeats)
            else:  # entries that were never stored; a controller never lets it come to this
                self.history.silence(period)
        elif self.history.runs:
            self.history.silence(period)

    def _lag(self) -> int:
        """Periods by which every step of a sequence or a modulation comes late; more than 0 is an overrun."""
        lag = -(-self.rasterise_cycles // CYCLES_PER_PERIOD) - 1
        if lag:
            self._overrun()
        return lag

    def _overrun(self) -> None:
        self._raise(Fault.OVERRUN, f"needs {self.rasterise_cycles} cycles for a table")

    def playing(self, period: int) -> Playing:
        """What it plays in a period, before modulation."""
        since, packed = self.history.segments().at(period)
        return Playing(self.place, since, packed)

    # Silence

    @property
    def _silenced(self) -> bool:
        """Whether a fault of its own keeps its outputs low (clause SAF-007)."""
        return bool(self.faults.value & SILENCING_FAULTS.value)  # plain numbers: this is asked for each stretch played

    def _judge(self, fault: Fault, there: bool, what: str) -> None:
        if there:
            self._raise(fault, what)
        else:
            self.faults &= ~fault

    def _raise(self, fault: Fault, what: str) -> None:
        new = fault & ~self.faults
        self.faults |= fault
        self._log(what)
        if new & SILENCING_FAULTS:
            self._silence()

    def _silence(self) -> None:
        """Fall silent at the next boundary, and drop what waits or runs (clauses SAF-007 and CHN-018)."""
        if self._table is not None:
            self.missed_commits += 1
            self._table = None
            self._tracer.end(self._scheduler.now, f"processor {self.place}")
            self._signal("table", 0)
        self._programs.clear()
        self._late.clear()
        if self._time is not None:
            period = max(self._time.first_boundary(self._scheduler.now), 0)
            self.history.silence(period)
            self.history.modulate(period, b"", 0)
            self._modulated = False

    def listen(self, since: int) -> None:
        """From now on fall silent if no question came for long, counted from a core cycle (clause CHN-018)."""
        self._heard = since
        self._scheduler.at(max(since + DEAF_CYCLES, self._scheduler.now), self._check_hearing)

    def _check_hearing(self) -> None:
        if self.stopped:
            return
        due = self._heard + DEAF_CYCLES
        if self._scheduler.now < due:
            self._scheduler.at(due, self._check_hearing)
            return
        self._raise(Fault.CHAIN, f"no question for {DEAF_MS} ms")
        self._silence()
        self._heard = self._scheduler.now
        self._scheduler.at(self._heard + DEAF_CYCLES, self._check_hearing)
