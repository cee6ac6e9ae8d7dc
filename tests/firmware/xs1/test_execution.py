"""A core by itself: where an execution ends, its switch, and its inputs."""

import numpy as np
import pytest
from phasewire.firmware.xs1.assembler import AssemblySource, assemble
from phasewire.firmware.xs1.execution import Ending, Execution, Setup, execute, first_cycle
from phasewire.firmware.xs1.names import PORT_IDS
from phasewire.firmware.xs1.program import LinkedProgram

PORT, LINE = PORT_IDS["32A"], PORT_IDS["1F"]


def made(text: str) -> LinkedProgram:
    return assemble([AssemblySource("t.s", text)])


COUNTING = """
    ldc r0, 0
again:
    add r0, r0, 1
    eq r1, r0, 10
    bf r1, again
done:
    ldc r2, 7
    waiteu
"""
"""Two instructions, 3 in each of 10 rounds, and one that waits: r2 is set by the 32nd, at a slot every 4 cycles."""


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_program_that_stops_is_idle_from_its_last_instruction(lockstep: bool) -> None:
    outcome = execute(Setup(made(COUNTING), lockstep=lockstep), 1_000_000)
    assert (outcome.ending, outcome.cycle) == (Ending.IDLE, 31 * 4)
    assert outcome.execution.core.instructions == 32
    assert outcome.execution.core.registers(0)[2] == 7
    assert outcome.execution.idle


def test_an_execution_ends_at_a_place_at_the_cycle_of_its_instruction() -> None:
    program = made(COUNTING)
    outcome = execute(Setup(program), 1_000_000, place=program.symbols["done"])
    assert (outcome.ending, outcome.cycle) == (Ending.PLACE, 31 * 4)
    assert outcome.execution.core.cycle == 31 * 4
    outcome = execute(Setup(program), 1_000_000, place=program.symbols["again"])
    assert (outcome.cycle, outcome.execution.core.instructions) == (4, 2)


def test_an_execution_ends_after_its_cycles() -> None:
    outcome = execute(Setup(made(COUNTING)), 101)
    assert (outcome.ending, outcome.cycle) == (Ending.REACHED, 100)
    assert outcome.execution.core.instructions == 26


def test_a_trap_ends_an_execution() -> None:
    outcome = execute(Setup(made("ldc r0, 0\nldw r1, r0[0]\nldc r0, 1")), 1000)
    assert (outcome.ending, outcome.cycle) == (Ending.TRAPPED, 4)
    assert outcome.execution.core.instructions == 1
    assert outcome.execution.core.trap is not None


@pytest.mark.parametrize("late", [0, 1, 4095, 4096, 5000, 70_001])
def test_the_first_cycle_of_something_is_found_wherever_it_is(late: int) -> None:
    """A loop that leaves once a line rises, looked at every 16 cycles: the first input sampled after the rise."""
    text = f"""
        ldc r1, {LINE & 0xFFFF}
        ldc r0, 1
        shl r0, r0, 16
        or r0, r0, r1
        setc res[r0], 8
    again:
        in r2, res[r0]
        bf r2, again
    risen:
        waiteu
    """
    program = made(text)
    setup = Setup(program, inputs=[(LINE, 0, 0), (LINE, 100 + late, 1)])
    found = first_cycle(setup, lambda execution: bool(execution.core.registers(0)[2]), 200_000)
    assert found is not None
    cycle = found.core.cycle
    assert 100 + late <= cycle <= 100 + late + 12
    before = Execution(setup)
    before.run(cycle - 1)
    assert before.core.registers(0)[2] == 0
    assert first_cycle(setup, lambda execution: bool(execution.core.registers(0)[2]), cycle - 1) is None
    assert execute(setup, 200_000, place=program.symbols["risen"]).cycle >= cycle


def test_registers_of_the_beginning() -> None:
    setup = Setup(made("add r2, r0, r1\nstw r2, sp[0]\nwaiteu"), {0: 5, 1: -2, 14: 0x1FFF0})
    core = execute(setup, 100).execution.core
    assert core.registers(0)[2] == 3
    assert core.memory.view(np.uint32)[0xFFF0 // 4] == 3


def test_the_switch_answers_and_takes_its_node() -> None:
    """Writes NODE_ID 0x0012, waits for the answer, and asks for a channel end: its identifier has the new node."""
    text = """
        ldap r11, _cp
        set cp, r11
        getr r0, 2
        ldw r1, cp[switch]
        setd res[r0], r1
        ldw r1, cp[write]
        ldc r4, 0xc0
        outct res[r0], r4
        ldc r3, 0
        outt res[r0], r3
        ldc r3, 0x12
        outt res[r0], r3
        shr r2, r0, 8
        outt res[r0], r2
        ldc r3, 0
        outt res[r0], r3
        ldc r3, 5
        outt res[r0], r3
        ldc r3, 0x12
        out res[r0], r3
        outct res[r0], 1
        chkct res[r0], 3
        chkct res[r0], 1
        getr r5, 2
        setd res[r5], r1
        outt res[r5], r3
        outct res[r5], 1
        waiteu
        .section .cp.rodata, "ac", @progbits
    switch:
        .long 0xffffc30c
    write:
        .long 0x00ff0702
    """
    outcome = execute(Setup(made(text)), 100_000)
    assert outcome.execution.core.trap is None
    assert outcome.ending is Ending.IDLE
    assert outcome.execution.core.registers(0)[5] == 0x00120102
    (sent,) = outcome.execution.messages
    assert (sent.destination, sent.tokens.tolist()) == (0x00FF0702, [0x12, 0x101])


def test_all_changes_of_a_port_are_kept_though_the_core_s_log_is_shorter() -> None:
    """A port that changes with every instruction, 100 000 times, against numbers that are counted here."""
    text = """
        ldc r0, 0x20
        shl r0, r0, 16
        setc res[r0], 8
        ldc r1, 0
    again:
        add r1, r1, 1
        out res[r0], r1
        bu again
    """
    execution = Execution(Setup(made(text), watched=[PORT]))
    execution.run(1_300_000)
    cycles, words = execution.changes(PORT)
    assert len(words) > 100_000
    np.testing.assert_array_equal(words, np.arange(1, len(words) + 1))
    assert (np.diff(cycles) == 12).all()
