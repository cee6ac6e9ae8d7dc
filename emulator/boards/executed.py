"""A driver processor that executes its firmware, instruction by instruction (package `xs1`), and its place on a board.

It brings tokens to the core's channel ends at their times, moves its input pins, answers as its switch does, and
records what its 32-bit port shows. It decides nothing about messages or pulses: the firmware does. The core is executed
only when somebody looks, up to the present; so it is never ahead of what may still reach it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...firmware.xs1.core import Core, Sent, Stop
from ...firmware.xs1.names import PORT_IDS
from ...firmware.xs1.state import CHANNEL_ENDS
from ...firmware.xs1.switch import CONTROL, SWITCH_CONFIGURATION, XLINK, LinkField, Switch, serve
from ...protocol.board import CYCLES_PER_MS, CYCLES_PER_TICK
from ...protocol.codes import CONTROLLER_NODE, END_TOKEN, SUPPLY_RANGE_MV, UNNUMBERED_NODE
from ...protocol.timing import Link
from ..ports.capture import Track
from ..ports.clock import BoardClock, Timebase
from ..ports.recording import PortRecording
from ..scheduler import Scheduler
from .package import Package

__all__ = ["DOWN_LINK", "UP_LINK", "ExecutedProcessor", "with_end"]

OUTPUTS, SYNC_LINE, SUPPLY_GOOD, TEMPERATURE = (PORT_IDS[name] for name in ("32A", "1F", "1G", "8C"))
UP_LINK, DOWN_LINK = 0, 1
"""The switch's links to the controller and away from it."""
ROUTE_TOKENS = 3
MOST_MESSAGES, MESSAGE_CYCLES = 1000, CYCLES_PER_MS // 20
"""A processor that sends more than so many, and one more each so many cycles, is given up: it floods the emulator."""
SAMPLING_CYCLES = 195
"""From the beginning of a tick to the moment at which the pins are read: 5 cycles before its end, so that a port that
changes late in its tick still counts."""
ISSUE_CYCLES = 4
MOST_WAITING_TOKENS = 4096
"""That wait at channel ends before the core is executed, so that memory stays bounded."""


class ExecutedProcessor(Package):
    """One of the ten.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    place : int
        Its place in the chain, 0 to 9.
    clock : BoardClock
        The ticks of its board; it starts with the sync line.
    program : bytes
        The firmware, as the boot program leaves it in memory.
    unique_id : int
        64 bits, of its package.
    link : Link
        Set-up of its links.
    late_ticks : int
        The delay with which the sync line reaches it.
    log : callable
        What takes a line about each thing that happens.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        place: int,
        clock: BoardClock,
        program: bytes,
        unique_id: int,
        link: Link,
        late_ticks: int,
        log: Callable[[str], None],
    ) -> None:
        super().__init__(scheduler, place, clock)
        self._log = log
        self._late_cycles = late_ticks * CYCLES_PER_TICK
        self._link = link
        self.switch = Switch(UNNUMBERED_NODE, hello=self._say_hello)
        self.switch.registers[XLINK + UP_LINK] = _set_up(link) | LinkField.ENABLE | LinkField.TX_CREDIT
        self.core = Core(program, node=UNNUMBERED_NODE, registers=_words(unique_id), start=scheduler.now)
        self.core.link_cycles_per_token = link.cycles_per_token
        self.core.watch(OUTPUTS)
        for port, value in ((SYNC_LINE, 0), (SUPPLY_GOOD, 1), (TEMPERATURE, self.temperature_c)):
            self.core.drive(port, scheduler.now, value)
        self._recording = PortRecording()
        self._word = 0
        self._open_end: int | None = None
        """The channel end of a route whose END got lost."""
        self._answers: list[tuple[bytes, int]] = []
        self._trapped = False
        self._held_up = self._waiting_tokens = self._sent = 0
        self._began = scheduler.now

    @property
    def number(self) -> int | None:
        """The number that it took; None before (clause CHN-022)."""
        return None if self.switch.node == UNNUMBERED_NODE else self.switch.node

    # Time: the core's cycles are those of its board's oscillator

    def _own(self, cycle: int) -> int:
        if self._time is None or self.clock.exact:
            return cycle
        tick = self._time.tick(cycle)
        origin = self._time.origin
        return origin + self.clock.own_tick(tick) * CYCLES_PER_TICK + (cycle - origin) % CYCLES_PER_TICK

    def execute(self) -> None:
        """Execute up to the present."""
        self._waiting_tokens = 0
        self._execute_until(self._own(self._scheduler.now))

    def _execute_until(self, cycle: int) -> None:
        while not self.stopped:
            stop = self.core.run(cycle)
            if stop is Stop.MESSAGE:
                for sent in self.core.take_messages():
                    self._send(sent)
                self._sent += 1
                if self._sent > MOST_MESSAGES + (self.core.cycle - self._began) // MESSAGE_CYCLES:
                    self._log(f"has sent {self._sent} messages, which is a flood; it is executed no more")
                    super().stop()
            elif stop is Stop.LOG_FULL:
                self._record(self.core.cycle)
            elif stop is Stop.TRAPPED and not self._trapped:
                self._trapped = True
                self._log(f"stands still: {self.core.trap}")
            if stop in (Stop.REACHED, Stop.TRAPPED) and self.core.cycle >= cycle:
                break
        if self.core.held_up != self._held_up:
            self._held_up = self.core.held_up
            self._log(f"takes tokens more slowly than its link brings them: {self._held_up} had to wait")

    # Messages

    def bring(self, tokens: bytes, arrives: int, *, ends: bool) -> None:
        """Let tokens of the chain reach a channel end, the last of them at a core cycle.

        Parameters
        ----------
        tokens : bytes
            The tokens, with their route header.
        arrives : int
            Core cycle.
        ends : bool
            Whether the last is END. Without, the route stays open: what follows runs into the same channel end, header
            and all.
        """
        taken = with_end(tokens[:-1]) if ends else np.frombuffer(tokens, np.uint8).astype(np.uint16)
        end = self._open_end
        if end is None:
            if len(taken) < ROUTE_TOKENS:
                return
            end, taken = int(taken[ROUTE_TOKENS - 1]), taken[ROUTE_TOKENS:]
        self._open_end = None if ends else end
        if len(taken):
            self.deliver(end, taken, arrives)

    def deliver(self, channel_end: int, tokens: NDArray[np.uint16], arrives: int) -> None:
        """Let tokens, without a route header, reach a channel end, the last of them at a core cycle."""
        if self.stopped:
            return
        if channel_end >= CHANNEL_ENDS:
            self._log(f"gets tokens for channel end {channel_end}, which does not exist")
            return
        if not self.clock.exact:
            arrives += self._own(self._scheduler.now) - self._scheduler.now
        step = self._link.cycles_per_token
        try:
            self.core.deliver_evenly(channel_end, tokens, arrives, step)
        except ValueError:  # an answer of its switch has gone first
            first = arrives - (len(tokens) - 1) * step
            late = self.core.earliest_delivery(channel_end) - first
            self.core.deliver_evenly(channel_end, tokens, arrives + late, step)
        self._waiting_tokens += len(tokens)
        if self._waiting_tokens > MOST_WAITING_TOKENS:
            self.execute()

    def take_answers(self) -> list[tuple[bytes, int]]:
        """What it has said to the controller since the last call, with route headers and END, and when it began."""
        answers, self._answers = self._answers, []
        return answers

    def _send(self, sent: Sent) -> None:
        if sent.destination & 0xFFFF == SWITCH_CONFIGURATION:
            if not serve(self.core, self.switch, sent):
                self._log(
                    "gets no answer from its switch: the question is malformed, or names no channel end of its own"
                )
            return
        node, end = sent.destination >> 16, sent.destination >> 8 & 0xFF
        if node != CONTROLLER_NODE:
            self._log(f"sends a message to node {node:#06x}, which does not exist")
            return
        if not self.passes(node, UP_LINK):
            return
        tokens = bytes([*node.to_bytes(2, "big"), end, *(int(token) & 0xFF for token in sent.tokens)])
        # The links carry a message as a whole: it begins as late as its last token demands.
        begins = max(sent.begins, sent.ends - (len(tokens) - 1) * self._link.cycles_per_token)
        self._answers.append((tokens, begins + self._scheduler.now - self._own(self._scheduler.now)))

    def passes(self, node: int, link: int) -> bool:
        """Whether its switch sends a message for a node on by a link, as its registers say (clause CHN-025)."""
        try:
            well = self.switch.route(node) == link
        except ValueError:
            well = False
        if not well:
            self._log(f"its switch has no way to node {node:#06x} by link {link}")
        return well

    def _say_hello(self, link: int) -> bool:
        return link == DOWN_LINK and not self.is_last

    # Pins

    def start(self, time: Timebase) -> None:
        """The first pulse of the sync line: period 0 begins."""
        self.execute()
        self._record(self.core.cycle)
        self._time = time
        self._pulse()

    def feel_pulse(self, tick: int) -> None:  # noqa: ARG002  # a base class decides
        """A later pulse of the sync line is due, at a tick of the device."""
        self._pulse()

    def _pulse(self) -> None:
        if self.sync_connected and not self.stopped:
            self.execute()
            at = self._next + self._late_cycles
            self.core.drive(SYNC_LINE, at, 1)
            self.core.drive(SYNC_LINE, at + CYCLES_PER_TICK, 0)

    def take_up_pulses(self, tick: int) -> None:
        """Nothing: it feels each pulse itself."""

    def listen(self, since: int) -> None:
        """Nothing: its firmware listens."""

    def set_temperature(self, celsius: int) -> None:
        """The board has another temperature."""
        self.temperature_c = celsius
        self._move(TEMPERATURE, celsius & 0xFF)

    def set_supply(self, millivolts: int) -> None:
        """The output amplifiers get another voltage."""
        self._move(SUPPLY_GOOD, int(millivolts in SUPPLY_RANGE_MV))

    def _move(self, port: int, value: int) -> None:
        self.execute()
        self.core.drive(port, self._next, value)

    @property
    def _next(self) -> int:
        """The first core cycle that was not executed."""
        return max(self._own(self._scheduler.now), self.core.cycle + 1)

    def slow_down(self, slowness: int) -> None:
        """From now on every instruction takes so many times as long; 1 is as it should be."""
        self.execute()
        self.core.set_issue_cycles(ISSUE_CYCLES * slowness)

    def stop(self) -> None:
        """Lose power: the pins fall low at once, and execution ends."""
        self.execute()
        super().stop()

    def set_clock_error(self, parts_per_billion: int) -> None:
        """Its board's oscillator runs fast from now on, or slow if negative."""
        self.execute()
        super().set_clock_error(parts_per_billion)

    # What it plays

    def _record(self, until: int) -> None:
        """Sample the port's pins at the end of each tick up to a core cycle."""
        cycles, words = self.core.port_log(OUTPUTS)
        if self._time is not None:
            first = self._recording.ticks
            last = max((until - self._time.origin - SAMPLING_CYCLES) // CYCLES_PER_TICK + 1, first)
            ticks = -((self._time.origin + SAMPLING_CYCLES - cycles) // CYCLES_PER_TICK)
            # A change is seen from the first sample after it on.
            at = np.clip(ticks, first, last)
            counts = np.diff(np.concatenate([[first], at, [last]]))
            self._recording.extend(np.repeat(np.concatenate([[self._word], words]).astype(np.uint32), counts))
        if len(words):
            self._word = int(words[-1])

    def track(self) -> Track:
        """What its port did so far."""
        self.execute()
        self._record(self.core.cycle)
        return Track(self._recording.recorded(), self.clock, tuple(self.forced))

    def forget(self, period: int) -> None:
        """Drop what its port did before a period of its own clock."""
        self._recording.forget(period)


def with_end(body: bytes) -> NDArray[np.uint16]:
    """The tokens of a body, and END."""
    tokens = np.empty(len(body) + 1, np.uint16)
    tokens[:-1] = np.frombuffer(body, np.uint8)
    tokens[-1] = CONTROL | END_TOKEN
    return tokens


def _words(unique_id: int) -> tuple[int, int]:
    """What the boot program leaves in r0 and r1."""
    return unique_id & 0xFFFF_FFFF, unique_id >> 32


def _set_up(link: Link) -> int:
    """The register of a link, as the boot program sets it up."""
    wide = LinkField.WIDE if link.wires > 2 else 0
    return wide | (link.cycles_per_symbol - 1) << 11 | link.token_delay
