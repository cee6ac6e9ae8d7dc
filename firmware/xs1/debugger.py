"""A debugger's views of one core: its threads, the instructions around them, single steps, and a profile by function.

Everything here only looks, apart from `steps`, which executes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .disassembler import DisassembledLine, disassemble
from .encoding import decode
from .instructions import BY_NAME
from .names import EXCEPTIONS, THREAD_REGISTERS, port_name
from .program import CYCLES_PER_SECOND, MEMORY_BYTES, RAM_BASE, LinkedProgram
from .state import DIVISION

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .core import Core, ThreadView
    from .execution import Execution

__all__ = [
    "FunctionShare",
    "Step",
    "around",
    "describe_cycle",
    "describe_thread",
    "describe_trap",
    "last_words",
    "profile_by_function",
    "registers_text",
    "steps",
    "view",
]

_DIVISIONS = frozenset(BY_NAME[name] for name in ("divs", "divu", "rems", "remu", "ldivu"))
_IN_A_ROW = 4  # registers
_SPC, _ET, _ED = (THREAD_REGISTERS.index(name) for name in ("spc", "et", "ed"))


class Step(NamedTuple):
    """One executed instruction.

    Parameters
    ----------
    cycle : int
        Cycle in which it issued.
    thread : int
    address : int
    text : str
        Disassembled; an exception for which a handler begins adds its type.
    changed : dict
        The thread's registers that the instruction changed, with their new values.
    """

    cycle: int
    thread: int
    address: int
    text: str
    changed: dict[str, int]


class FunctionShare(NamedTuple):
    """What a function took of the executed instructions, without those that it calls.

    Parameters
    ----------
    name : str
        The function's, or the nearest label's before the instructions.
    instructions : int
        How many were executed.
    slots : int
        Issue slots that they took: 1 each, and 32 for a division.
    share : float
        Share of all slots, 0 to 1.
    """

    name: str
    instructions: int
    slots: int
    share: float


def describe_cycle(cycle: int) -> str:
    """A cycle with its time: ``cycle 4,000 (10.0000 µs)``."""
    return f"cycle {cycle:,} ({cycle / CYCLES_PER_SECOND * 1e6:,.4f} µs)"


def describe_thread(thread: ThreadView, program: LinkedProgram) -> str:
    """What a thread does, in words."""
    text = f"thread {thread.number} {thread.state} at {program.describe(thread.pc)}"
    if thread.waits_for:
        text += f", waits for {thread.waits_for}" + (f" ({thread.resource})" if thread.resource else "")
        text += ", for ever" if thread.ready is None else f", until cycle {thread.ready:,} or longer"
    return text


def describe_trap(execution: Execution) -> str:
    """The exception without a handler, in words; empty if there is none."""
    core, program = execution.core, execution.setup.program
    if (trap := core.trap) is None:
        return ""
    where = f"{program.describe(trap.pc)} ({_text(core, program, trap.pc)})"
    what = f"{EXCEPTIONS[trap.type]}, data 0x{trap.data:x}"
    return f"thread {trap.thread} trapped in cycle {trap.cycle:,} at {where}: {what}"


def registers_text(registers: NDArray[np.uint32]) -> str:
    """The registers of a thread, four in a row."""
    cells = [f"{name:>3} {int(value):08x}" for name, value in zip(THREAD_REGISTERS, registers, strict=True)]
    rows = [cells[first : first + _IN_A_ROW] for first in range(0, len(cells), _IN_A_ROW)]
    return "\n".join("  ".join(row) for row in rows)


def around(
    memory: NDArray[np.uint8], program: LinkedProgram, address: int, *, before: int = 4, after: int = 4
) -> list[DisassembledLine]:
    """Instructions around an address.

    Parameters
    ----------
    memory : (65536,) uint8
        Memory as it is now.
    program : LinkedProgram
        Program whose names are shown.
    address : int
        Address of the instruction in the middle.
    before, after : int
        Largest number of instructions before and after it.

    Returns
    -------
    list of DisassembledLine
        Empty if the address is not in memory.
    """
    if address % 2 or not RAM_BASE <= address < RAM_BASE + MEMORY_BYTES:
        return []
    everything = replace(program, code=())  # what is executed is code, whatever the map says
    function = program.function_at(address)
    earliest = max(RAM_BASE, address - 4 * before, function.address if function else RAM_BASE)
    ends = min(RAM_BASE + MEMORY_BYTES, address + 4 * after + 4)
    first: list[DisassembledLine] = []
    for start in range(earliest, address, 2):  # of instructions of two lengths, the first that lead to the address
        lines = disassemble(memory, start, address, program=everything)
        if sum(len(line.content) for line in lines) == address - start and all(line.code is not None for line in lines):
            first = lines
            break
    return first[-before:] + disassemble(memory, address, ends, program=everything)[: after + 1]


def last_words(execution: Execution) -> dict[int, tuple[int, int]]:
    """Of each watched port that has changed: the cycle of its last change, and the word since."""
    found = {}
    for port in execution.setup.watched:
        cycles, words = execution.changes(port)
        if len(cycles):
            found[port] = int(cycles[-1]), int(words[-1])
    return found


def view(execution: Execution, *, threads: Sequence[int] | None = None) -> str:
    """Everything about a core at this moment: cycle, threads with registers and instructions, and port words.

    Parameters
    ----------
    execution : Execution
    threads : sequence of int, optional
        Numbers; by default all that are not free.
    """
    core, program = execution.core, execution.setup.program
    rows = [f"{describe_cycle(core.cycle)}, {core.instructions:,} instructions"]
    for thread in core.threads():
        if thread.state == "free" if threads is None else thread.number not in threads:
            continue
        rows += ["", describe_thread(thread, program)]
        rows += [f"  {row}" for row in registers_text(core.registers(thread.number)).splitlines()]
        rows.append("")
        for line in around(core.memory, program, thread.pc):
            rows += [f"  {label}:" for label in line.labels]
            mark = ">" if line.address == thread.pc else " "
            rows.append(f"{mark} {line.address:8x}  {line.content.hex(' ', 2):<11s}  {line.text}")
    words = last_words(execution)
    if words:
        rows.append("")
    for port, (cycle, word) in words.items():
        digits = -(-(port >> 16) // 4)
        rows.append(f"port {port_name(port)} 0x{word:0{digits}x} since cycle {cycle:,}")
    return "\n".join(rows)


def steps(execution: Execution, last: int) -> Iterator[Step]:
    """Execute instruction by instruction.

    Parameters
    ----------
    execution : Execution
        An execution in lockstep.
    last : int
        The last cycle to execute.

    Yields
    ------
    Step
        The steps in the order of cycles, up to that cycle, or until a thread traps without a handler or nothing can
        happen any more.
    """
    core = execution.core
    program = execution.setup.program
    counts = core.profile.copy()
    while core.cycle < last and core.trap is None:
        before, count = core.threads(), core.instructions
        times = [thread.ready for thread in before if thread.ready is not None]
        if not times:
            return
        registers = [core.registers(thread.number).copy() for thread in before]
        execution.run(min(last, max(core.cycle + 1, min(times))))
        if core.instructions == count:
            continue
        address = _executed(core, counts, before)
        number = _thread_of(before, core.threads(), address, core.cycle)
        now = core.registers(number)
        changed = {
            name: int(value)
            for name, value, old in zip(THREAD_REGISTERS, now, registers[number], strict=True)
            if value != old
        }
        if address is None:  # the handler of an exception begins
            address = int(now[_SPC])
            text = f"{_text(core, program, address)}: {EXCEPTIONS[int(now[_ET])]}, data 0x{int(now[_ED]):x}"
        else:
            text = _text(core, program, address)
        yield Step(core.cycle, number, address, text, changed)


def _executed(core: Core, counts: NDArray[np.int64], before: Sequence[ThreadView]) -> int | None:
    """The address of the instruction that was executed since the counts, which are brought up; None if none was."""
    places = [place for thread in before if 0 <= (place := (thread.pc - RAM_BASE) // 2) < len(counts)]
    found = next((place for place in places if core.profile[place] != counts[place]), None)
    if found is None:
        others = np.flatnonzero(core.profile != counts)
        if not len(others):
            return None
        found = int(others[0])
    counts[found] = core.profile[found]
    return RAM_BASE + 2 * found


def _thread_of(before: Sequence[ThreadView], after: Sequence[ThreadView], address: int | None, cycle: int) -> int:
    """The thread that executed the instruction at an address: the one that was there and due, if several changed."""

    def likeness(number: int) -> tuple[bool, bool, bool]:
        old = before[number]
        due = old.ready is not None and old.ready <= cycle
        return old.pc == address, due, old.state == "running"

    moved = [old.number for old, new in zip(before, after, strict=True) if old != new]
    return max(moved, key=likeness, default=0)


def _text(core: Core, program: LinkedProgram, address: int) -> str:
    """The instruction at an address, as memory is now."""
    place = address - RAM_BASE
    if address % 2 or not 0 <= place < MEMORY_BYTES:
        return "outside memory"
    part = core.memory[place : place + 4]
    everything = replace(program, code=())  # what is executed is code, whatever the map says
    (line, *_) = disassemble(part, address, address + 2, base=address, program=everything)
    return line.text


def profile_by_function(execution: Execution) -> list[FunctionShare]:
    """The functions that were executed, the one that took the most issue slots first."""
    core, program = execution.core, execution.setup.program
    instructions: defaultdict[str, int] = defaultdict(int)
    slots: defaultdict[str, int] = defaultdict(int)
    halves = core.memory.view(np.uint16)
    for place in np.flatnonzero(core.profile).tolist():
        count = int(core.profile[place])
        decoded = decode(int(halves[place]), int(halves[place + 1]) if place + 1 < len(halves) else 0)
        name = _function_name(program, RAM_BASE + 2 * place)
        instructions[name] += count
        slots[name] += count * (DIVISION if decoded is not None and decoded.code in _DIVISIONS else 1)
    total = sum(slots.values())
    shares = [FunctionShare(name, instructions[name], slots[name], slots[name] / total) for name in slots]
    return sorted(shares, key=lambda share: (-share.slots, share.name))


def _function_name(program: LinkedProgram, address: int) -> str:
    if (function := program.function_at(address)) is not None:
        return function.name
    name, _, offset = program.describe(address).rpartition("+0x")
    return name if name else offset if offset in program.symbols else "(no name)"
