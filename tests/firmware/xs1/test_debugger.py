"""A debugger's views: steps against the core's own counts, a profile against counting by hand."""

import re
from collections import Counter

import numpy as np
import pytest
from phasewire.firmware.xs1.assembler import AssemblySource, assemble
from phasewire.firmware.xs1.debugger import (
    around,
    describe_cycle,
    describe_thread,
    describe_trap,
    last_words,
    profile_by_function,
    registers_text,
    steps,
    view,
)
from phasewire.firmware.xs1.execution import Execution, Setup
from phasewire.firmware.xs1.names import PORT_IDS, THREAD_REGISTERS
from phasewire.firmware.xs1.program import LinkedProgram, read_map

PORT = PORT_IDS["32A"]

TWO_THREADS = """
    .type start, @function
start:
    ldap r11, _cp
    set cp, r11
    getr r0, 2
    getr r1, 2
    setd res[r0], r1
    setd res[r1], r0
    getr r2, 3
    getst r3, res[r2]
    ldap r11, adder
    init t[r3]:pc, r11
    ldap r11, _cp
    init t[r3]:cp, r11
    set t[r3]:r0, r1
    msync res[r2]
    in r4, res[r0]
    ldc r5, 7
    divu r4, r4, r5
    ldw r6, cp[PORT]
    setc res[r6], 8
    out res[r6], r4
    mjoin res[r2]
    waiteu
    .size start, . - start
    .type adder, @function
adder:
    ldaw r11, cp[TABLE]
    ldc r1, 0
    ldc r2, 0
more:
    ldw r3, r11[r2]
    add r1, r1, r3
    add r2, r2, 1
    eq r3, r2, 8
    bf r3, more
    out res[r0], r1
    ssync
    .size adder, . - adder
    .section .cp.rodata, "ac", @progbits
PORT:
    .long 0x200000
TABLE:
    .long 1, 2, 3, 4, 5, 6, 7, 8
"""
"""Thread 0 starts thread 1, which adds up a table and sends the sum; thread 0 divides it, and shows it on a port."""


def made(text: str) -> LinkedProgram:
    return assemble([AssemblySource("t.s", text)])


@pytest.fixture
def program() -> LinkedProgram:
    return made(TWO_THREADS)


@pytest.fixture
def execution(program: LinkedProgram) -> Execution:
    return Execution(Setup(program, watched=[PORT], lockstep=True))


def test_steps_are_all_instructions_each_once(program: LinkedProgram, execution: Execution) -> None:
    found = list(steps(execution, 10_000))
    assert len(found) == execution.core.instructions == 21 + 45  # thread 0's last, waiteu, does not go on
    assert Counter(step.thread for step in found) == {0: 21, 1: 45}
    counts = Counter((step.address - 0x10000) // 2 for step in found)
    assert counts == {place: int(execution.core.profile[place]) for place in np.flatnonzero(execution.core.profile)}
    for thread in (0, 1):
        cycles = [step.cycle for step in found if step.thread == thread]
        assert (np.diff(cycles) >= 4).all()
    assert len({step.cycle for step in found}) == len(found)
    assert execution.idle


def test_steps_name_what_they_change(program: LinkedProgram, execution: Execution) -> None:
    """The registers of a step are those of a core that is executed up to its cycle, and no other has changed."""
    for step in steps(execution, 10_000):
        other = Execution(execution.setup)
        other.run(step.cycle - 1)
        before = other.core.registers(step.thread).copy()
        other.run(step.cycle)
        after = other.core.registers(step.thread)
        changed = [place for place in range(len(before)) if before[place] != after[place]]
        assert step.changed == {THREAD_REGISTERS[place]: after[place] for place in changed}
    sums = [step.changed["r1"] for step in steps(Execution(execution.setup), 10_000) if step.text == "add r1, r1, r3"]
    assert sums == [1, 3, 6, 10, 15, 21, 28, 36]


def test_steps_are_the_same_however_the_rest_is_executed(execution: Execution) -> None:
    begun = Execution(execution.setup)
    begun.run(149)
    assert list(steps(begun, 10_000)) == [step for step in steps(execution, 10_000) if step.cycle >= 150]


def test_steps_end_at_a_cycle(execution: Execution) -> None:
    found = list(steps(execution, 12))
    assert [step.cycle for step in found] == [0, 4, 8, 12]
    assert execution.core.cycle == 12


def test_the_handler_of_an_exception_is_a_step() -> None:
    program = made("""
        ldap r11, handler
        set kep, r11
        ldc r0, 2
        ldw r1, r0[0]
        waiteu
        .p2align 7
    handler:
        get r11, ed
        waiteu
    """)
    execution = Execution(Setup(program, lockstep=True))
    found = list(steps(execution, 1000))
    assert [step.text for step in found] == [
        "ldap r11, handler",
        "set kep, r11",
        "ldc r0, 2",
        "ldw r1, r0[0]: load or store, data 0x2",
        "get r11, ed",
    ]
    assert (found[3].address, found[3].changed["et"]) == (0x10006, 5)
    assert found[4].changed == {"r11": 2}


def test_steps_end_with_a_trap() -> None:
    program = made("start: ldc r0, 2\nldw r1, r0[0]")
    execution = Execution(Setup(program, lockstep=True))
    assert [step.text for step in steps(execution, 1000)] == ["ldc r0, 2"]
    said = "thread 0 trapped in cycle 4 at start+0x2 (ldw r1, r0[0]): load or store, data 0x2"
    assert describe_trap(execution) == said
    assert "trapped at start+0x2" in view(execution)


def test_a_profile_is_counted_by_function(program: LinkedProgram) -> None:
    """A division takes 32 slots, so that thread 0 has 20 + 32."""
    execution = Execution(Setup(program))
    execution.run(10_000)
    start, adder = profile_by_function(execution)
    assert (start.name, start.instructions, start.slots) == ("start", 21, 52)
    assert (adder.name, adder.instructions, adder.slots) == ("adder", 45, 45)
    assert start.share == pytest.approx(52 / 97)
    assert start.share + adder.share == pytest.approx(1)


def test_a_profile_without_functions_has_labels_or_no_names(program: LinkedProgram) -> None:
    text = TWO_THREADS.replace(".type", "# ").replace(".size", "# ")
    execution = Execution(Setup(made(text)))
    execution.run(10_000)
    assert {share.name: share.instructions for share in profile_by_function(execution)} == {
        "start": 21,
        "adder": 3,
        "more": 42,
    }
    execution = Execution(Setup(LinkedProgram(program.image)))
    execution.run(10_000)
    assert [(share.name, share.share) for share in profile_by_function(execution)] == [("(no name)", 1.0)]
    assert profile_by_function(Execution(Setup(program))) == []


def test_instructions_around_a_place_begin_at_instructions(program: LinkedProgram) -> None:
    """Around each instruction the lines are those of the whole program's listing, which has long instructions too."""
    whole = {step.address: step.text for step in steps(Execution(Setup(program, lockstep=True)), 10_000)}
    memory = Execution(Setup(program)).core.memory
    for address, text in whole.items():
        lines = around(memory, program, address, before=3, after=3)
        (here,) = [line for line in lines if line.address == address]
        assert here.text == text
        assert all(whole.get(line.address, line.text) == line.text for line in lines)
        assert [line.address + len(line.content) for line in lines[:-1]] == [line.address for line in lines[1:]]
        function = program.function_at(address)
        assert function is not None
        assert all(line.address >= function.address for line in lines[: lines.index(here)])
    assert around(memory, program, 0x10001) == around(memory, program, 0x20000) == []
    assert around(memory, program, 0x1FFFE, after=3)[-1].address == 0x1FFFE


def test_what_lies_before_a_place_and_leads_into_it_is_not_shown() -> None:
    """The half word before `over` is a prefix: with it `ldc` would be one instruction of four bytes."""
    program = made("start: bu over\n.short 0xf000\nover: ldc r0, 1\nwaiteu")
    memory = Execution(Setup(program)).core.memory
    lines = around(memory, program, program.symbols["over"], after=1)
    assert [(line.address, line.text) for line in lines] == [(0x10004, "ldc r0, 1"), (0x10006, "waiteu")]


def test_the_view_has_everything(program: LinkedProgram, execution: Execution) -> None:
    execution.run(10_000)
    text = view(execution)
    core = execution.core
    assert text.startswith(f"cycle 10,000 (25.0000 µs), {core.instructions} instructions\n")
    assert "thread 0 paused at start+0x" in text
    assert "waits for an event, for ever" in text
    assert "thread 1" not in text  # it has ended
    for name, value in zip(THREAD_REGISTERS, core.registers(0), strict=True):
        assert re.search(rf"\b{name} {int(value):08x}\b", text)
    assert re.search(r"^> +1[0-9a-f]{4}  [0-9a-f ]+  waiteu$", text, re.MULTILINE)
    (changed,) = execution.changes(PORT)[0].tolist()
    assert text.endswith(f"port 32A 0x00000005 since cycle {changed}")
    assert last_words(execution) == {PORT: (changed, 5)}


def test_the_view_of_threads_that_are_named(program: LinkedProgram) -> None:
    execution = Execution(Setup(program))
    execution.run(100)
    assert re.findall(r"^thread (\d) (\w+)", view(execution), re.MULTILINE) == [("0", "paused"), ("1", "running")]
    assert re.findall(r"^thread (\d) (\w+)", view(execution, threads=[1, 7]), re.MULTILINE) == [
        ("1", "running"),
        ("7", "free"),
    ]
    assert "port" not in view(execution)


def test_threads_and_cycles_in_words(program: LinkedProgram) -> None:
    execution = Execution(Setup(program))
    execution.run(100)
    waiting, running, *_ = execution.core.threads()
    assert describe_thread(running, program).startswith("thread 1 running at ")
    assert re.fullmatch(
        r"thread 0 paused at start\+0x[0-9a-f]+, waits for a (word|token) \(channel end 0\), for ever",
        describe_thread(waiting, program),
    )
    assert describe_cycle(4000) == "cycle 4,000 (10.0000 µs)"


def test_registers_are_shown_four_in_a_row() -> None:
    rows = registers_text(np.arange(24, dtype=np.uint32)).splitlines()
    assert len(rows) == 6
    assert rows[3] == " cp 0000000c   dp 0000000d   sp 0000000e   lr 0000000f"


def test_a_map_from_a_file_gives_the_same_view(program: LinkedProgram, execution: Execution) -> None:
    execution.run(200)
    other = Execution(Setup(read_map(program.map_text(), program.image), watched=[PORT], lockstep=True))
    other.run(200)
    assert view(other) == view(execution)
