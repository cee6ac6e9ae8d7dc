"""One XS1 core that executes a program: memory, threads, resources, and what reaches it from outside and back.

Times are core cycles of 2.5 ns. Nothing happens in a core by itself: `Core.run` executes up to a cycle, and what comes
from outside must be given before, with its cycles.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from . import state as st
from .inbox import enqueue
from .instructions import BY_NAME
from .kernels import run
from .names import EXCEPTIONS, port_name
from .predecoding import predecode
from .resources import find_port

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Core", "Sent", "Stop", "ThreadView", "Trap"]

_REASONS = {
    st.FOR_EVENT: "an event",
    st.FOR_TIME: "a time",
    st.FOR_TOKEN: "a token",
    st.FOR_WORD: "a word",
    st.FOR_CLAIM: "the end of a packet",
    st.FOR_ROOM: "room",
    st.FOR_LINK: "its link",
    st.FOR_LOCK: "a lock",
    st.FOR_OUTPUT: "an output",
    st.FOR_INPUT: "an input",
    st.FOR_DRAIN: "the end of its outputs",
    st.FOR_THREADS: "other threads",
    st.FOR_JOIN: "other threads to end",
}
_STATES = {st.FREE: "free", st.RUNNING: "running", st.PAUSED: "paused", st.STOPPED: "stopped", st.TRAPPED: "trapped"}

_IN_WORDS = st.codes(
    "stwi ldwi stwdp stwsp ldwdp ldwsp ldawdp ldawsp ldwcp extdp entsp extsp retsp kentsp krestsp ldawcp ldwcpl blat"
    " blacp ldawfi ldawbi"
)
"""Instructions whose immediate counts words; the kernel counts bytes."""
_BRANCHES = st.codes("brft brbt brff brbf brfu brbu blrf blrb ldapf ldapb")
"""Instructions whose immediate counts bytes; the kernel counts half words."""

_AHEAD = 256
_LOG = 1 << 16
_CHUNK = 64  # half words that are decoded at once


MOST_CYCLES = 1 << 46
"""Of 2.5 ns: two days. Times of tokens lie in 48 bits."""
_plain_find_port: Any = find_port.py_func  # type: ignore[attr-defined]  # not compiled anew in each process


class Stop(Enum):
    """Why `Core.run` returned."""

    REACHED = st.REACHED
    MESSAGE = st.MESSAGE
    TRAPPED = st.UNHANDLED
    LOG_FULL = st.LOG_FULL


_STOPS = {stop.value: stop for stop in Stop}


class Sent(NamedTuple):
    """A message to another node or to a switch.

    Parameters
    ----------
    channel_end : int
        Channel end that sent it.
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
        The resource for which it pauses, or empty.
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
        Bytes from 0x10000 on, where thread 0 begins.
    node : int
        Identifier of the node, until the program changes it and `set_node` says so.
    registers : sequence of int
        Values of r0 and on of thread 0.
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
        Bytes from 0x10000 on. After a change of instructions call `forget`.
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
        self._code = np.full(st.HALVES + 2, st.NOT_DECODED, np.int64)
        self._code[st.HALVES :] = st.OUTSIDE_RAM
        self._marks = np.zeros(st.HALVES // 2, np.uint8)
        self._decode(0, (len(program) + 1) // 2)
        self._registers = np.zeros(st.THREADS * st.REGISTER_ROW, np.uint32)
        self._registers[: len(registers)] = np.array(registers, np.int64) & 0xFFFFFFFF
        self._processor = np.zeros(st.PROCESSOR_REGISTERS, np.int64)
        self._processor[0] = st.RAM
        self._inbox = np.zeros((st.CHANNEL_ENDS, 256), np.int64)
        self._outbox = np.zeros((st.CHANNEL_ENDS, 4096), np.int64)
        self._pins = np.zeros((st.PORTS, 64, 2), np.int64)
        self._log = np.zeros((2 * st.LOG_MARGIN, 3), np.int64)
        self._profile = np.zeros(st.HALVES, np.int64)
        self._messages: list[Sent] = []
        self._changes: dict[int, list[NDArray[np.int64]]] = {}
        self._state = self._first_state(node, start)
        self._state[st.ISSUE], self._state[st.LOCKSTEP], self._state[st.AHEAD] = issue_cycles, lockstep, run_ahead
        self._state[st.PESSIMISTIC], self._state[st.PROFILED] = fetch == "pessimistic", profile

    @staticmethod
    def _first_state(node: int, start: int) -> NDArray[np.int64]:
        """One thread at the first instruction, and no resources but the reference clock."""
        s = np.zeros(st.SIZE, np.int64)
        s[st.READY : st.READY + st.THREADS] = st.NEVER
        s[st.NODE], s[st.CYCLE], s[st.LAST], s[st.LINK_CYCLES] = node, start - 1, start - 1, 8
        rows = s[st.THREAD : st.THREAD + st.THREADS * st.THREAD_ROW].reshape(st.THREADS, st.THREAD_ROW)
        rows[:, [st.SYNC, st.NEXT, st.ON]] = -1
        rows[:, st.ISSUED] = start - (1 << 20)
        s[st.READY], s[st.STATE], s[st.USED_THREADS] = start, st.RUNNING, 1
        s[st.RESOURCE + st.THREAD_0 * st.RESOURCE_ROW + st.USED] = 1
        s[st.CHANNEL : st.CHANNEL + st.CHANNEL_ENDS * st.CHANNEL_ROW].reshape(st.CHANNEL_ENDS, st.CHANNEL_ROW)[
            :, st.CLAIM
        ] = st.NOWHERE
        for port, width in enumerate(st.PORT_WIDTHS):
            row = s[st.PORT + port * st.PORT_ROW : st.PORT + (port + 1) * st.PORT_ROW]
            row[st.WIDTH] = row[st.TRANSFER_WIDTH] = width
            row[st.ENTRIES] = row[st.SHIFT_COUNT] = 1
        clocks = s[st.CLOCK : st.CLOCK + st.CLOCKS * st.CLOCK_ROW].reshape(st.CLOCKS, st.CLOCK_ROW)
        clocks[:, st.FROM_PORT], clocks[:, st.HALF] = -1, 2
        clocks[0, st.RUNS] = s[st.RESOURCE + st.CLOCK_0 * st.RESOURCE_ROW + st.USED] = 1
        s[st.LOCK : st.LOCK + st.LOCKS * st.LOCK_ROW].reshape(st.LOCKS, st.LOCK_ROW)[:, st.GRANTED] = -1
        return s

    @property
    def cycle(self) -> int:
        """The cycle up to which everything has been executed."""
        return int(self._state[st.CYCLE])

    @property
    def instructions(self) -> int:
        """How many instructions have been executed."""
        return int(self._state[st.COUNT])

    @property
    def held_up(self) -> int:
        """How many tokens came from outside while 8 were unread, so that their link was held up."""
        return int(self._state[st.HELD_UP])

    @property
    def profile(self) -> NDArray[np.int64]:
        """How many times the instruction at each half word was executed: (32768,), changed by `run`."""
        return self._profile

    @property
    def node(self) -> int:
        """Identifier of the node."""
        return int(self._state[st.NODE])

    @property
    def link_cycles_per_token(self) -> int:
        """Cycles in which a token to outside leaves."""
        return int(self._state[st.LINK_CYCLES])

    @link_cycles_per_token.setter
    def link_cycles_per_token(self, cycles: int) -> None:
        if cycles < 1:
            raise ValueError(f"a token takes {cycles} cycles; it must be 1 or more")
        self._state[st.LINK_CYCLES] = cycles

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
            if result != st.UNDECODED:
                break
            self._decode(int(s[st.UNDECODED_AT]), int(s[st.UNDECODED_AT]) + _CHUNK)
        if result == st.MESSAGE:
            self._collect(int(s[st.MESSAGE_OF]))
        elif result == st.UNHANDLED:
            self.trap = Trap(
                *(int(s[field]) for field in (st.FAULT_THREAD, st.FAULT, st.FAULT_DATA, st.FAULT_PC, st.FAULT_CYCLE))
            )
        return _STOPS[result]

    def _collect(self, channel_end: int) -> None:
        row = self._state[st.CHANNEL + channel_end * st.CHANNEL_ROW :][: st.CHANNEL_ROW]
        tokens = self._outbox[channel_end, : row[st.OUTBOX_END]].astype(np.uint16)
        self._messages.append(
            Sent(channel_end, int(row[st.DESTINATION]), tokens, int(row[st.BEGAN]), int(row[st.LEFT]))
        )
        row[st.OUTBOX_END] = 0

    def earliest_delivery(self, channel_end: int) -> int:
        """The first cycle at which a token may be delivered to a channel end: after all that has been.

        Raises
        ------
        ValueError
            If there is no such channel end.
        """
        if not 0 <= channel_end < st.CHANNEL_ENDS:
            raise ValueError(f"channel end {channel_end} does not exist; there are 0 to 31")
        row = self._state[st.CHANNEL + channel_end * st.CHANNEL_ROW :][: st.CHANNEL_ROW]
        waits = row[st.INBOX_END] > row[st.INBOX_FIRST]
        return max(self.cycle + 1, int(self._inbox[channel_end, row[st.INBOX_END] - 1]) >> 16 if waits else 0)

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
        row = self._state[st.CHANNEL + channel_end * st.CHANNEL_ROW :][: st.CHANNEL_ROW]
        first, end = int(row[st.INBOX_FIRST]), int(row[st.INBOX_END])
        if times[0] < latest or (np.diff(times) < 0).any() or times[-1] >= MOST_CYCLES:
            raise ValueError(
                f"tokens come in cycles {times[0]} to {times[-1]}; they must be in order, from {latest} on"
            )
        if end + given.size > self._inbox.shape[1]:
            left = self._inbox[channel_end, first:end].copy()
            self._inbox[channel_end, : end - first] = left
            row[st.INBOX_SEEN] -= first
            row[st.INBOX_FIRST], end = 0, end - first
            if end + given.size > self._inbox.shape[1]:
                self._inbox = np.pad(self._inbox, ((0, 0), (0, end + given.size)))
        self._inbox[channel_end, end : end + given.size] = times << 16 | given & 0x1FF
        row[st.INBOX_END] = end + given.size

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
        first, end = int(row[st.PINS_FIRST]), int(row[st.PINS_END])
        earliest = max(self.cycle + 1, int(self._pins[number, end - 1, 0]) if end > first else 0)
        if not earliest <= cycle < MOST_CYCLES:
            raise ValueError(f"port 0x{port:x} is driven from cycle {cycle} on; it must be {earliest} or later")
        if end == self._pins.shape[1]:
            clocks = self._state[st.CLOCK : st.CLOCK + st.CLOCKS * st.CLOCK_ROW].reshape(st.CLOCKS, st.CLOCK_ROW)
            if number not in clocks[:, st.FROM_PORT]:
                left = self._pins[number, first:end].copy()
                self._pins[number, : end - first] = left
                row[st.PINS_FIRST], row[st.PINS_END], end = 0, end - first, end - first
            if end > self._pins.shape[1] // 2:
                self._pins = np.pad(self._pins, ((0, 0), (0, self._pins.shape[1]), (0, 0)))
        self._pins[number, end] = cycle, value & ((1 << int(row[st.WIDTH])) - 1)
        row[st.PINS_END] = end + 1

    def watch(self, port: int) -> None:
        """Log changes of a port's output pins from now on."""
        number = self._port(port)
        if self._log.shape[0] < _LOG:
            self._log = np.zeros((_LOG, 3), np.int64)
        self._port_row(number)[st.WATCHED] = 1

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
            Values of the pins from these cycles on. They are 0 before the first change.
        """
        number, count = self._port(port), int(self._state[st.LOGGED])
        if count:
            rows = self._log[:count]
            others = [number] if (rows[:, 0] == number).all() else np.unique(rows[:, 0])
            for other in others:
                self._changes.setdefault(int(other), []).append(rows[rows[:, 0] == other, 1:])
            self._state[st.LOGGED] = 0
        parts = self._changes.pop(number, [])
        changes = np.concatenate(parts) if parts else np.empty((0, 2), np.int64)
        return changes[:, 0].copy(), changes[:, 1].astype(np.uint32)

    def port_counter(self, port: int) -> int:
        """The counter of a port, at the last edge of its clock that mattered to it."""
        return int(self._port_row(self._port(port))[st.COUNTER])

    def pins(self, port: int) -> int:
        """The output pins of a port, as far as it has been brought up."""
        return int(self._port_row(self._port(port))[st.DRIVEN])

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
        if not 0 <= thread < st.THREADS:
            raise ValueError(f"thread {thread} does not exist; there are 0 to {st.THREADS - 1}")
        return self._registers[thread * st.REGISTER_ROW :][: st.SR + 8]

    def threads(self) -> list[ThreadView]:
        """All eight threads."""
        s = self._state
        views = []
        for t in range(st.THREADS):
            row = s[st.THREAD + t * st.THREAD_ROW :][: st.THREAD_ROW]
            state, ready = int(s[st.STATE + t]), int(s[st.READY + t])
            waits = _REASONS[int(row[st.WHY])] if state == st.PAUSED else ""
            resource = _name(int(row[st.ON])) if state == st.PAUSED and row[st.ON] >= 0 else ""
            pc = st.RAM + 2 * int(row[st.PC])
            views.append(ThreadView(t, _STATES[state], pc, waits, resource, None if ready == st.NEVER else ready))
        return views

    def set_issue_cycles(self, cycles: int) -> None:
        """Let each thread issue at most once in so many cycles, 4 or more, from now on."""
        if cycles < 4:
            raise ValueError(f"issue_cycles is {cycles}; it must be 4 or more")
        s = self._state
        s[st.ISSUE] = cycles
        running = [t for t in range(st.THREADS) if s[st.STATE + t] == st.RUNNING]
        taken: set[int] = set()
        for t in sorted(running, key=lambda t: int(s[st.READY + t])):
            ready = int(s[st.READY + t])
            while len(taken) < cycles and ready % cycles in taken:
                ready += 1
            taken.add(ready % cycles)
            s[st.READY + t] = ready

    def set_node(self, node: int) -> None:
        """Change the node's identifier, as its switch does."""
        self._state[st.NODE] = node

    def forget(self, address: int, size: int) -> None:
        """Have instructions decoded again, after `memory` was changed from outside."""
        first = max(0, (address - st.RAM) // 2 - 1)
        self._code[first : min(st.HALVES, (address - st.RAM + size + 1) // 2)] = st.NOT_DECODED

    def _decode(self, first: int, end: int) -> None:
        """Decode half words that are not decoded yet."""
        end = min(end, st.HALVES)
        code = _kernel_code(self.memory, first, end)
        missing = self._code[first:end] == st.NOT_DECODED
        self._code[first:end][missing] = code[missing]
        self._marks[first // 2 : (end + 2) // 2] = 1

    def _port(self, identifier: int) -> int:
        number = int(_plain_find_port(identifier))
        if not 0 <= number < st.PORTS:
            raise ValueError(f"0x{identifier:x} is no port; port 32A is 0x200000")
        return number

    def _port_row(self, number: int) -> NDArray[np.int64]:
        return self._state[st.PORT + number * st.PORT_ROW :][: st.PORT_ROW]


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
    return words & (st.LONG - 1) | np.where(words >> 32 & 7 == 4, st.LONG, 0) | values << 32


_SCALES = np.ones((256, 2), np.int64)
_SCALES[_IN_WORDS, 0] = 4
_SCALES[_BRANCHES, 1] = 2


def _name(resource: int) -> str:
    """A resource in words."""
    if st.PORT_0 <= resource < st.PORT_0 + st.PORTS:
        width = st.PORT_WIDTHS[resource - st.PORT_0]
        number = resource - st.PORT_0 - st.PORT_WIDTHS.index(width)
        return f"port {port_name(width << 16 | number << 8)}"
    kinds = {
        st.THREAD_0: "thread",
        st.CLOCK_0: "clock block",
        st.SYNC_0: "synchroniser",
        st.LOCK_0: "lock",
        st.CHANNEL_0: "channel end",
        st.TIMER_0: "timer",
    }
    first = max(first for first in kinds if first <= resource)
    return f"{kinds[first]} {resource - first}"
