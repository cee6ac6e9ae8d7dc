"""One XS1 core that executes a program: memory, threads, resources, and what reaches it from outside and back.

Times are core cycles of 2.5 ns. Nothing happens in a core by itself: `Core.run` executes up to a cycle, and what comes
from outside must be given before, with its cycles.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from .inbox import enqueue
from .instructions import BY_NAME
from .kernels import run
from .names import EXCEPTIONS, port_name
from .predecoding import predecode
from .resources import find_port
from .state import (
    AHEAD,
    BEGAN,
    CHANNEL,
    CHANNEL_0,
    CHANNEL_ENDS,
    CHANNEL_ROW,
    CLAIM,
    CLOCK,
    CLOCK_0,
    CLOCK_ROW,
    CLOCKS,
    COUNT,
    COUNTER,
    CYCLE,
    DESTINATION,
    DRIVEN,
    ENTRIES,
    FAULT,
    FAULT_CYCLE,
    FAULT_DATA,
    FAULT_PC,
    FAULT_THREAD,
    FOR_CLAIM,
    FOR_DRAIN,
    FOR_EVENT,
    FOR_INPUT,
    FOR_JOIN,
    FOR_LINK,
    FOR_LOCK,
    FOR_OUTPUT,
    FOR_ROOM,
    FOR_THREADS,
    FOR_TIME,
    FOR_TOKEN,
    FOR_WORD,
    FREE,
    FROM_PORT,
    GRANTED,
    HALF,
    HALVES,
    HELD_UP,
    INBOX_END,
    INBOX_FIRST,
    INBOX_SEEN,
    ISSUE,
    ISSUED,
    LAST,
    LEFT,
    LINK_CYCLES,
    LOCK,
    LOCK_0,
    LOCK_ROW,
    LOCKS,
    LOCKSTEP,
    LOG_FULL,
    LOG_MARGIN,
    LOGGED,
    LONG,
    MESSAGE,
    MESSAGE_OF,
    NEVER,
    NEXT,
    NODE,
    NOT_DECODED,
    NOWHERE,
    ON,
    OUTBOX_END,
    OUTSIDE_RAM,
    PAUSED,
    PC,
    PESSIMISTIC,
    PINS_END,
    PINS_FIRST,
    PORT,
    PORT_0,
    PORT_ROW,
    PORT_WIDTHS,
    PORTS,
    PROCESSOR_REGISTERS,
    PROFILED,
    RAM,
    REACHED,
    READY,
    REGISTER_ROW,
    RESOURCE,
    RESOURCE_ROW,
    RUNNING,
    RUNS,
    SHIFT_COUNT,
    SIZE,
    SR,
    STATE,
    STOPPED,
    SYNC,
    SYNC_0,
    THREAD,
    THREAD_0,
    THREAD_ROW,
    THREADS,
    TIMER_0,
    TRANSFER_WIDTH,
    TRAPPED,
    UNDECODED,
    UNDECODED_AT,
    UNHANDLED,
    USED,
    USED_THREADS,
    WATCHED,
    WHY,
    WIDTH,
    codes,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Core", "Sent", "Stop", "ThreadView", "Trap"]

_REASONS = {
    FOR_EVENT: "an event",
    FOR_TIME: "a time",
    FOR_TOKEN: "a token",
    FOR_WORD: "a word",
    FOR_CLAIM: "the end of a packet",
    FOR_ROOM: "room",
    FOR_LINK: "its link",
    FOR_LOCK: "a lock",
    FOR_OUTPUT: "an output",
    FOR_INPUT: "an input",
    FOR_DRAIN: "the end of its outputs",
    FOR_THREADS: "other threads",
    FOR_JOIN: "other threads to end",
}
_STATES = {FREE: "free", RUNNING: "running", PAUSED: "paused", STOPPED: "stopped", TRAPPED: "trapped"}

_IN_WORDS = codes(
    "stwi ldwi stwdp stwsp ldwdp ldwsp ldawdp ldawsp ldwcp extdp entsp extsp retsp kentsp krestsp ldawcp ldwcpl blat"
    " blacp ldawfi ldawbi"
)
"""Instructions whose immediate counts words; the kernel counts bytes."""
_BRANCHES = codes("brft brbt brff brbf brfu brbu blrf blrb ldapf ldapb")
"""Instructions whose immediate counts bytes; the kernel counts half words."""

_AHEAD = 256
_LOG = 1 << 16
_CHUNK = 64  # half words that are decoded at once


MOST_CYCLES = 1 << 46
"""Of 2.5 ns: two days. Times of tokens lie in 48 bits."""
_plain_find_port: Any = find_port.py_func  # type: ignore[attr-defined]  # not compiled anew in each process


class Stop(Enum):
    """Why `Core.run` returned."""

    REACHED = REACHED
    MESSAGE = MESSAGE
    TRAPPED = UNHANDLED
    LOG_FULL = LOG_FULL


_STOPS = {stop.value: stop for stop in Stop}


class Sent(NamedTuple):
    """A message to another node or to a switch.

    Parameters
    ----------
    channel_end : int
        From where.
    destination : int
        Identifier of the resource that it is sent to.
    tokens : (n,) uint16
        Control tokens have bit 8 set. The last one is END, or PAUSE, which does not arrive. A message of more than 4092
        tokens comes in pieces; only the last ends so.
    begins, ends : int
        Cycles at which the first token was sent and the last one has left.
    """

    channel_end: int
    destination: int
    tokens: NDArray[np.uint16]
    begins: int
    ends: int


class Trap(NamedTuple):
    """An exception of a thread that has no handler.

    Parameters
    ----------
    thread : int
    type : int
        `names.EXCEPTIONS` has names.
    data : int
    pc : int
        Address of the instruction.
    cycle : int
    """

    thread: int
    type: int
    data: int
    pc: int
    cycle: int

    def __str__(self) -> str:
        return (
            f"thread {self.thread} at 0x{self.pc:x} in cycle {self.cycle}: "
            f"{EXCEPTIONS[self.type]}, data 0x{self.data:x}"
        )


class ThreadView(NamedTuple):
    """What a thread does.

    Parameters
    ----------
    number : int
    state : str
        free, running, paused, stopped (in SSYNC or not started) or trapped.
    pc : int
        Address of its next instruction.
    waits_for : str
        Why it pauses, or empty.
    resource : str
        For which resource it pauses, or empty.
    ready : int or None
        The cycle at which it goes on, if it is known.
    """

    number: int
    state: str
    pc: int
    waits_for: str
    resource: str
    ready: int | None


class Core:
    """A core with its program.

    Parameters
    ----------
    program : bytes
        It lies from 0x10000 on, where thread 0 begins.
    node : int
        Identifier of the node, until the program changes it and `set_node` says so.
    registers : sequence of int
        Of thread 0, from r0 on.
    fetch : {"off", "pessimistic"}
        Whether threads stall when their instruction buffer is empty. The rule is an upper bound: an instruction that
        accesses memory, or returns, fetches nothing; any other fetches a word if there is room in 64 bits; a taken
        branch empties the buffer and loads the word that it leads to.
    lockstep : bool
        Execute one instruction at a time, in order of time, so that threads may share memory freely.
    issue_cycles : int
        A thread issues at most once in this many cycles, 4 or more.
    start : int
        The first cycle.
    run_ahead : int
        Without lockstep, cycles by which a thread may be ahead of the others. So much later may a change of memory be
        seen that is not synchronised; and when a fifth thread starts, with which the core goes in lockstep, the others
        may already be so far.
    profile : bool
        Count how many times each instruction is executed.

    Attributes
    ----------
    memory : (65536,) uint8
        From 0x10000 on. After a change of instructions call `forget`.
    trap : Trap or None
        The last exception without a handler.
    """

    def __init__(
        self,
        program: bytes,
        *,
        node: int = 0,
        registers: Sequence[int] = (),
        fetch: Literal["off", "pessimistic"] = "off",
        lockstep: bool = False,
        issue_cycles: int = 4,
        start: int = 0,
        run_ahead: int = _AHEAD,
        profile: bool = False,
    ) -> None:
        if len(program) > 1 << 16:
            raise ValueError(f"the program has {len(program)} bytes; a core has 65536")
        if fetch not in ("off", "pessimistic"):
            raise ValueError(f"fetch is {fetch!r}; it must be 'off' or 'pessimistic'")
        if issue_cycles < 4:
            raise ValueError(f"issue_cycles is {issue_cycles}; it must be 4 or more")
        if len(registers) > 12:
            raise ValueError(f"{len(registers)} registers are given; a thread has r0 to r11")
        self.memory: NDArray[np.uint8] = np.zeros(1 << 16, np.uint8)
        self.memory[: len(program)] = np.frombuffer(program, np.uint8)
        self.trap: Trap | None = None
        self._views = self.memory, self.memory.view(np.int16), self.memory.view(np.uint32)
        self._code = np.full(HALVES + 2, NOT_DECODED, np.int64)
        self._code[HALVES:] = OUTSIDE_RAM
        self._marks = np.zeros(HALVES // 2, np.uint8)
        self._decode(0, (len(program) + 1) // 2)
        self._registers = np.zeros(THREADS * REGISTER_ROW, np.uint32)
        self._registers[: len(registers)] = np.array(registers, np.int64) & 0xFFFFFFFF
        self._processor = np.zeros(PROCESSOR_REGISTERS, np.int64)
        self._processor[0] = RAM
        self._inbox = np.zeros((CHANNEL_ENDS, 256), np.int64)
        self._outbox = np.zeros((CHANNEL_ENDS, 4096), np.int64)
        self._pins = np.zeros((PORTS, 64, 2), np.int64)
        self._log = np.zeros((2 * LOG_MARGIN, 3), np.int64)
        self._profile = np.zeros(HALVES, np.int64)
        self._messages: list[Sent] = []
        self._changes: dict[int, list[NDArray[np.int64]]] = {}
        self._state = self._first_state(node, start)
        self._state[ISSUE], self._state[LOCKSTEP], self._state[AHEAD] = issue_cycles, lockstep, run_ahead
        self._state[PESSIMISTIC], self._state[PROFILED] = fetch == "pessimistic", profile

    @staticmethod
    def _first_state(node: int, start: int) -> NDArray[np.int64]:
        """One thread at the first instruction, and no resources but the reference clock."""
        s = np.zeros(SIZE, np.int64)
        s[READY : READY + THREADS] = NEVER
        s[NODE], s[CYCLE], s[LAST], s[LINK_CYCLES] = node, start - 1, start - 1, 8
        rows = s[THREAD : THREAD + THREADS * THREAD_ROW].reshape(THREADS, THREAD_ROW)
        rows[:, [SYNC, NEXT, ON]] = -1
        rows[:, ISSUED] = start - (1 << 20)
        s[READY], s[STATE], s[USED_THREADS] = start, RUNNING, 1
        s[RESOURCE + THREAD_0 * RESOURCE_ROW + USED] = 1
        s[CHANNEL : CHANNEL + CHANNEL_ENDS * CHANNEL_ROW].reshape(CHANNEL_ENDS, CHANNEL_ROW)[:, CLAIM] = NOWHERE
        for port, width in enumerate(PORT_WIDTHS):
            row = s[PORT + port * PORT_ROW : PORT + (port + 1) * PORT_ROW]
            row[WIDTH] = row[TRANSFER_WIDTH] = width
            row[ENTRIES] = row[SHIFT_COUNT] = 1
        clocks = s[CLOCK : CLOCK + CLOCKS * CLOCK_ROW].reshape(CLOCKS, CLOCK_ROW)
        clocks[:, FROM_PORT], clocks[:, HALF] = -1, 2
        clocks[0, RUNS] = s[RESOURCE + CLOCK_0 * RESOURCE_ROW + USED] = 1
        s[LOCK : LOCK + LOCKS * LOCK_ROW].reshape(LOCKS, LOCK_ROW)[:, GRANTED] = -1
        return s

    @property
    def cycle(self) -> int:
        """The cycle up to which everything has been executed."""
        return int(self._state[CYCLE])

    @property
    def instructions(self) -> int:
        """How many instructions have been executed."""
        return int(self._state[COUNT])

    @property
    def held_up(self) -> int:
        """How many tokens came from outside while 8 were unread, so that their link was held up."""
        return int(self._state[HELD_UP])

    @property
    def profile(self) -> NDArray[np.int64]:
        """How many times the instruction at each half word was executed: (32768,), changed by `run`."""
        return self._profile

    @property
    def node(self) -> int:
        """Identifier of the node."""
        return int(self._state[NODE])

    @property
    def link_cycles_per_token(self) -> int:
        """Cycles in which a token to outside leaves."""
        return int(self._state[LINK_CYCLES])

    @link_cycles_per_token.setter
    def link_cycles_per_token(self, cycles: int) -> None:
        if cycles < 1:
            raise ValueError(f"a token takes {cycles} cycles; it must be 1 or more")
        self._state[LINK_CYCLES] = cycles

    def run(self, until: int) -> Stop:
        """Execute up to a cycle, this cycle included.

        Parameters
        ----------
        until : int

        Returns
        -------
        Stop
            REACHED; MESSAGE, if a message is complete (`take_messages`); TRAPPED, if an exception has no handler
            (`trap`): its thread stays where it is, and the others may go on; LOG_FULL, if `port_log` must be called.
        """
        if not until < MOST_CYCLES:
            raise ValueError(f"until is cycle {until}; it must be below 2^46")
        s = self._state
        while True:
            result = run(
                s, self._registers, *self._views, self._code, self._marks, self._processor, self._inbox, self._outbox,
                self._pins, self._log, self._profile, until,
            )  # fmt: skip
            if result != UNDECODED:
                break
            self._decode(int(s[UNDECODED_AT]), int(s[UNDECODED_AT]) + _CHUNK)
        if result == MESSAGE:
            self._collect(int(s[MESSAGE_OF]))
        elif result == UNHANDLED:
            self.trap = Trap(*(int(s[field]) for field in (FAULT_THREAD, FAULT, FAULT_DATA, FAULT_PC, FAULT_CYCLE)))
        return _STOPS[result]

    def _collect(self, channel_end: int) -> None:
        row = self._state[CHANNEL + channel_end * CHANNEL_ROW :][:CHANNEL_ROW]
        tokens = self._outbox[channel_end, : row[OUTBOX_END]].astype(np.uint16)
        self._messages.append(Sent(channel_end, int(row[DESTINATION]), tokens, int(row[BEGAN]), int(row[LEFT])))
        row[OUTBOX_END] = 0

    def earliest_delivery(self, channel_end: int) -> int:
        """The first cycle at which a token may be delivered to a channel end: after all that has been.

        Raises
        ------
        ValueError
            If there is no such channel end.
        """
        if not 0 <= channel_end < CHANNEL_ENDS:
            raise ValueError(f"channel end {channel_end} does not exist; there are 0 to 31")
        row = self._state[CHANNEL + channel_end * CHANNEL_ROW :][:CHANNEL_ROW]
        waits = row[INBOX_END] > row[INBOX_FIRST]
        return max(self.cycle + 1, int(self._inbox[channel_end, row[INBOX_END] - 1]) >> 16 if waits else 0)

    def deliver(self, channel_end: int, tokens: ArrayLike, cycles: ArrayLike) -> None:
        """Give tokens to a channel end from outside.

        Parameters
        ----------
        channel_end : int
        tokens : (n,) array_like of int
            Control tokens have bit 8 set. A packet should end with END.
        cycles : (n,) array_like of int
            When each is at the channel end: in ascending order, after `cycle`, and not before tokens given earlier.

        Raises
        ------
        ValueError
            If the cycles are not in order, or have passed.
        """
        latest = self.earliest_delivery(channel_end)
        given, times = np.atleast_1d(np.asarray(tokens, np.int64)), np.atleast_1d(np.asarray(cycles, np.int64))
        if given.shape != times.shape or given.ndim != 1:
            raise ValueError(f"{given.size} tokens have {times.size} cycles; each needs one")
        if not given.size:
            return
        row = self._state[CHANNEL + channel_end * CHANNEL_ROW :][:CHANNEL_ROW]
        first, end = int(row[INBOX_FIRST]), int(row[INBOX_END])
        if times[0] < latest or (np.diff(times) < 0).any() or times[-1] >= MOST_CYCLES:
            raise ValueError(
                f"tokens come in cycles {times[0]} to {times[-1]}; they must be in order, from {latest} on"
            )
        if end + given.size > self._inbox.shape[1]:
            left = self._inbox[channel_end, first:end].copy()
            self._inbox[channel_end, : end - first] = left
            row[INBOX_SEEN] -= first
            row[INBOX_FIRST], end = 0, end - first
            if end + given.size > self._inbox.shape[1]:
                self._inbox = np.pad(self._inbox, ((0, 0), (0, end + given.size)))
        self._inbox[channel_end, end : end + given.size] = times << 16 | given & 0x1FF
        row[INBOX_END] = end + given.size

    def deliver_evenly(self, channel_end: int, tokens: NDArray[np.uint16], last: int, step: int) -> None:
        """Give tokens that come one after the other from a link, fast.

        Parameters
        ----------
        channel_end, tokens
            As for `deliver`.
        last : int
            When the last of them is at the channel end.
        step : int
            Cycles from one to the next.

        Raises
        ------
        ValueError
            As `deliver`.
        """
        count = len(tokens)
        if (
            step < 1
            or last >= MOST_CYCLES
            or enqueue(self._state, self._inbox, int(channel_end), tokens, int(last) - (count - 1) * step, step)
            != count
        ):
            self.deliver(channel_end, tokens, last - np.arange(count - 1, -1, -1) * step)

    def take_messages(self) -> list[Sent]:
        """Messages to other nodes and to switches that are complete; each is returned once."""
        messages, self._messages = self._messages, []
        return messages

    def drive(self, port: int, cycle: int, value: int) -> None:
        """Put a value on a port's input pins.

        Parameters
        ----------
        port : int
            Identifier.
        cycle : int
            The first cycle with this value: after `cycle`, and not before what was driven earlier.
        value : int

        Raises
        ------
        ValueError
            If there is no such port, or the cycle has passed.
        """
        number = self._port(port)
        row = self._port_row(number)
        first, end = int(row[PINS_FIRST]), int(row[PINS_END])
        earliest = max(self.cycle + 1, int(self._pins[number, end - 1, 0]) if end > first else 0)
        if not earliest <= cycle < MOST_CYCLES:
            raise ValueError(f"port 0x{port:x} is driven from cycle {cycle} on; it must be {earliest} or later")
        if end == self._pins.shape[1]:
            clocks = self._state[CLOCK : CLOCK + CLOCKS * CLOCK_ROW].reshape(CLOCKS, CLOCK_ROW)
            if number not in clocks[:, FROM_PORT]:
                left = self._pins[number, first:end].copy()
                self._pins[number, : end - first] = left
                row[PINS_FIRST], row[PINS_END], end = 0, end - first, end - first
            if end > self._pins.shape[1] // 2:
                self._pins = np.pad(self._pins, ((0, 0), (0, self._pins.shape[1]), (0, 0)))
        self._pins[number, end] = cycle, value & ((1 << int(row[WIDTH])) - 1)
        row[PINS_END] = end + 1

    def watch(self, port: int) -> None:
        """Log changes of a port's output pins from now on."""
        number = self._port(port)
        if self._log.shape[0] < _LOG:
            self._log = np.zeros((_LOG, 3), np.int64)
        self._port_row(number)[WATCHED] = 1

    def port_log(self, port: int) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
        """Changes of a watched port's output pins since the last call.

        Parameters
        ----------
        port : int
            Identifier.

        Returns
        -------
        cycles : (n,) int64
        words : (n,) uint32
            On the pins from these cycles on. They are 0 before the first change.
        """
        number, count = self._port(port), int(self._state[LOGGED])
        if count:
            rows = self._log[:count]
            others = [number] if (rows[:, 0] == number).all() else np.unique(rows[:, 0])
            for other in others:
                self._changes.setdefault(int(other), []).append(rows[rows[:, 0] == other, 1:])
            self._state[LOGGED] = 0
        parts = self._changes.pop(number, [])
        changes = np.concatenate(parts) if parts else np.empty((0, 2), np.int64)
        return changes[:, 0].copy(), changes[:, 1].astype(np.uint32)

    def port_counter(self, port: int) -> int:
        """The counter of a port, at the last edge of its clock that mattered to it."""
        return int(self._port_row(self._port(port))[COUNTER])

    def pins(self, port: int) -> int:
        """The output pins of a port, as far as it has been brought up."""
        return int(self._port_row(self._port(port))[DRIVEN])

    def registers(self, thread: int) -> NDArray[np.uint32]:
        """Registers of a thread.

        Parameters
        ----------
        thread : int

        Returns
        -------
        (24,) uint32
            A view: r0 to r11, cp, dp, sp, lr, then sr, ssr, spc, sed, et, ed, kep, ksp.
        """
        if not 0 <= thread < THREADS:
            raise ValueError(f"thread {thread} does not exist; there are 0 to {THREADS - 1}")
        return self._registers[thread * REGISTER_ROW :][: SR + 8]

    def threads(self) -> list[ThreadView]:
        """All eight threads."""
        s = self._state
        views = []
        for t in range(THREADS):
            row = s[THREAD + t * THREAD_ROW :][:THREAD_ROW]
            state, ready = int(s[STATE + t]), int(s[READY + t])
            waits = _REASONS[int(row[WHY])] if state == PAUSED else ""
            resource = _name(int(row[ON])) if state == PAUSED and row[ON] >= 0 else ""
            pc = RAM + 2 * int(row[PC])
            views.append(ThreadView(t, _STATES[state], pc, waits, resource, None if ready == NEVER else ready))
        return views

    def set_issue_cycles(self, cycles: int) -> None:
        """Let each thread issue at most once in so many cycles, 4 or more, from now on."""
        if cycles < 4:
            raise ValueError(f"issue_cycles is {cycles}; it must be 4 or more")
        s = self._state
        s[ISSUE] = cycles
        running = [t for t in range(THREADS) if s[STATE + t] == RUNNING]
        taken: set[int] = set()
        for t in sorted(running, key=lambda t: int(s[READY + t])):
            ready = int(s[READY + t])
            while len(taken) < cycles and ready % cycles in taken:
                ready += 1
            taken.add(ready % cycles)
            s[READY + t] = ready

    def set_node(self, node: int) -> None:
        """Change the node's identifier, as its switch does."""
        self._state[NODE] = node

    def forget(self, address: int, size: int) -> None:
        """Have instructions decoded again, after `memory` was changed from outside."""
        first = max(0, (address - RAM) // 2 - 1)
        self._code[first : min(HALVES, (address - RAM + size + 1) // 2)] = NOT_DECODED

    def _decode(self, first: int, end: int) -> None:
        """Decode half words that are not decoded yet."""
        end = min(end, HALVES)
        code = _kernel_code(self.memory, first, end)
        missing = self._code[first:end] == NOT_DECODED
        self._code[first:end][missing] = code[missing]
        self._marks[first // 2 : (end + 2) // 2] = 1

    def _port(self, identifier: int) -> int:
        number = int(_plain_find_port(identifier))
        if not 0 <= number < PORTS:
            raise ValueError(f"0x{identifier:x} is no port; port 32A is 0x200000")
        return number

    def _port_row(self, number: int) -> NDArray[np.int64]:
        return self._state[PORT + number * PORT_ROW :][:PORT_ROW]


def _kernel_code(memory: NDArray[np.uint8], first: int, end: int) -> NDArray[np.int64]:
    """Instructions at half words, as the kernel reads them."""
    part = np.zeros(2 * (end - first) + 2, np.uint8)
    bytes_ = memory[2 * first : 2 * end + 2]
    part[: len(bytes_)] = bytes_
    words, imm = predecode(part)
    words, values = words[:-1], imm[:-1].astype(np.int64)
    kinds = words & 255
    values = values * _SCALES[kinds, 0] // _SCALES[kinds, 1]
    values = np.where(kinds == BY_NAME["lmul"], words >> 28 & 15, values)
    values = np.where(kinds == BY_NAME["tsetr"], words >> 16 & 15, values)
    return words & (LONG - 1) | np.where(words >> 32 & 7 == 4, LONG, 0) | values << 32


_SCALES = np.ones((256, 2), np.int64)
_SCALES[_IN_WORDS, 0] = 4
_SCALES[_BRANCHES, 1] = 2


def _name(resource: int) -> str:
    """A resource in words."""
    if PORT_0 <= resource < PORT_0 + PORTS:
        width = PORT_WIDTHS[resource - PORT_0]
        return f"port {port_name(width << 16 | (resource - PORT_0 - PORT_WIDTHS.index(width)) << 8)}"
    kinds = {
        THREAD_0: "thread", CLOCK_0: "clock block", SYNC_0: "synchroniser", LOCK_0: "lock", CHANNEL_0: "channel end",
        TIMER_0: "timer",
    }  # fmt: skip
    first = max(first for first in kinds if first <= resource)
    return f"{kinds[first]} {resource - first}"
