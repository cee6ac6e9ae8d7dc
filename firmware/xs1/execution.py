"""A core executes a program by itself: with its switch, with inputs that are known before, and with watched ports.

Nothing is at the other end of its links. A program is executed again from its beginning as often as it takes to find
the exact cycle in which something happens first; the same program with the same inputs does the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from .core import Core, Sent, Stop
from .program import RAM_BASE, LinkedProgram
from .switch import SWITCH_CONFIGURATION, UNNUMBERED, Switch, serve

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Ending", "Execution", "Outcome", "Setup", "execute", "first_cycle"]

_FIRST_CHUNK, _CHUNK = 1 << 12, 1 << 22  # cycles between two looks, at which Ctrl-C is heard too
_PARTS = 16
_MOST_CHANGES = 1 << 22
_MOST_MESSAGES = 1 << 16


@dataclass(frozen=True)
class Setup:
    """How a program is executed.

    Parameters
    ----------
    program : LinkedProgram
    registers : mapping
        Values in thread 0 at the beginning, by number: 0 to 11 are r0 to r11, 12 to 15 cp, dp, sp and lr.
    inputs : sequence of (int, int, int)
        Port, cycle and value: what is on input pins from a cycle on, in the order of cycles for each port.
    watched : sequence of int
        Identifiers of the ports whose outputs are logged.
    fetch : {"off", "pessimistic"}
    lockstep : bool
        Both as `Core` has them.
    """

    program: LinkedProgram
    registers: Mapping[int, int] = field(default_factory=dict)
    inputs: Sequence[tuple[int, int, int]] = ()
    watched: Sequence[int] = ()
    fetch: Literal["off", "pessimistic"] = "off"
    lockstep: bool = False


class Execution:
    """A core amid the execution of a program.

    Parameters
    ----------
    setup : Setup

    Attributes
    ----------
    core : Core
    messages : list of Sent
        What it has sent to other nodes, without what its switch has answered.

    Raises
    ------
    ValueError
        If an input is for no port, or not in the order of cycles.
    """

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.core = Core(setup.program.image, node=UNNUMBERED, fetch=setup.fetch, lockstep=setup.lockstep, profile=True)
        for number, value in setup.registers.items():
            self.core.registers(0)[number] = value & 0xFFFFFFFF
        for port, cycle, value in setup.inputs:
            self.core.drive(port, cycle, value)
        for port in setup.watched:
            self.core.watch(port)
        self.messages: list[Sent] = []
        self._switch = Switch(UNNUMBERED)
        self._changes: dict[int, list[tuple[NDArray[np.int64], NDArray[np.uint32]]]] = {}
        self._change_count = 0

    def run(self, until: int) -> None:
        """Execute up to a cycle, this cycle included, or until a thread traps.

        Raises
        ------
        ValueError
            If watched ports change, or messages are sent, more often than can be kept.
        """
        while self.core.trap is None:
            stop = self.core.run(until)
            for sent in self.core.take_messages():
                self._send(sent)
            if stop is Stop.LOG_FULL:
                self._drain()
            if stop is Stop.REACHED:
                return

    def changes(self, port: int) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
        """All changes of a watched port so far: cycles, and the words on its pins from then on."""
        self._drain()
        parts = self._changes.get(port, [])
        if not parts:
            return np.empty(0, np.int64), np.empty(0, np.uint32)
        return np.concatenate([cycles for cycles, _ in parts]), np.concatenate([words for _, words in parts])

    @property
    def idle(self) -> bool:
        """Whether nothing can happen any more, because no thread runs or knows when it will go on."""
        threads = self.core.threads()
        return not any(
            thread.state == "running" or (thread.state == "paused" and thread.ready is not None) for thread in threads
        )

    def has_executed(self, address: int) -> bool:
        """Whether the instruction at an address was executed."""
        return bool(self.core.profile[(address - RAM_BASE) // 2])

    def _drain(self) -> None:
        for port in self.setup.watched:
            cycles, words = self.core.port_log(port)
            if len(cycles):
                self._changes.setdefault(port, []).append((cycles, words))
                self._change_count += len(cycles)
        if self._change_count > _MOST_CHANGES:
            raise ValueError(f"the watched ports change more than {_MOST_CHANGES:,} times; execute fewer cycles")

    def _send(self, sent: Sent) -> None:
        if sent.destination & 0xFFFF != SWITCH_CONFIGURATION:
            if len(self.messages) == _MOST_MESSAGES:
                raise ValueError(f"the program sends more than {_MOST_MESSAGES:,} messages; execute fewer cycles")
            self.messages.append(sent)
            return
        serve(self.core, self._switch, sent)


class Ending(Enum):
    """Why an execution ended."""

    REACHED = "all cycles were executed"
    PLACE = "the place was reached"
    IDLE = "nothing can happen any more"
    TRAPPED = "a thread trapped"


class Outcome(NamedTuple):
    """The result of an execution.

    Parameters
    ----------
    ending : Ending
    cycle : int
        The last cycle that was executed; for IDLE the cycle of the last instruction, -1 if there was none.
    execution : Execution
    """

    ending: Ending
    cycle: int
    execution: Execution


def execute(setup: Setup, cycles: int, *, place: int | None = None) -> Outcome:
    """Execute a program from its beginning.

    Parameters
    ----------
    setup : Setup
    cycles : int
        Largest number of cycles.
    place : int, optional
        The address of an instruction after whose first execution to end.

    Returns
    -------
    Outcome
    """

    def happened(execution: Execution) -> bool:
        return place is not None and execution.has_executed(place)

    execution, size = Execution(setup), _FIRST_CHUNK
    while execution.core.cycle < cycles - 1 and not execution.idle:
        before = execution.core.cycle
        execution.run(min(cycles - 1, before + size))
        if happened(execution):
            found = _narrow(setup, happened, before, execution.core.cycle)
            return Outcome(Ending.PLACE, found.core.cycle, found)
        if (trap := execution.core.trap) is not None:
            return Outcome(Ending.TRAPPED, trap.cycle, execution)
        size = min(2 * size, _CHUNK)
    if not execution.idle:
        return Outcome(Ending.REACHED, execution.core.cycle, execution)
    count = execution.core.instructions
    last = first_cycle(setup, lambda later: later.core.instructions >= count, execution.core.cycle)
    return Outcome(Ending.IDLE, -1 if last is None else last.core.cycle, execution)


def first_cycle(setup: Setup, happened: Callable[[Execution], bool], last: int) -> Execution | None:
    """Find the first cycle in which something has happened.

    Parameters
    ----------
    setup : Setup
    happened : callable
        Takes an execution, and returns whether it has happened; then it must return that ever after.
    last : int
        The last cycle to look at.

    Returns
    -------
    Execution or None
        Executed up to this cycle; None if it does not happen.
    """
    execution, size, before = Execution(setup), _FIRST_CHUNK, -1
    while not happened(execution):
        before = execution.core.cycle
        if before >= last or execution.core.trap is not None:
            return None
        execution.run(min(last, before + size))
        size = min(2 * size, _CHUNK)
    return _narrow(setup, happened, before, execution.core.cycle)


def _narrow(setup: Setup, happened: Callable[[Execution], bool], before: int, after: int) -> Execution:
    """An execution up to the first cycle in which something has happened: after one cycle, up to another."""
    while True:
        step = max(1, (after - before) // _PARTS)
        execution = Execution(setup)
        execution.run(before)
        while not happened(execution) and execution.core.trap is None and before < after:
            before = execution.core.cycle
            execution.run(min(after, before + step))
        if step == 1:
            return execution
        after = execution.core.cycle
