"""Ports, clocks, timers, channel ends, locks, synchronisers; events and interrupts."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.firmware.xs1.assembler import AssemblySource, assemble
from phasewire.firmware.xs1.core import Core, Stop
from phasewire.firmware.xs1.names import EXCEPTIONS

from tests.firmware.xs1.cores import (
    CLOCK_2,
    PORT_1F,
    PORT_4A,
    PORT_8C,
    PORT_32A,
    clocked,
    constant,
    core,
    execute,
    get_words,
    set_words,
)

END, PAUSE = 0x101, 0x102
ANSWER = 0x00FF0702


def plain(port: int, register: str = "r4") -> str:
    return f"{constant(register, port)}setc res[{register}], 8\n"


def trapped(text: str, *registers: int, **options: Any) -> tuple[str, int]:
    """Type and data of the exception in which a program ends."""
    made = core(text, *registers, **options)
    assert made.run(100_000) is Stop.TRAPPED
    assert made.trap is not None
    return EXCEPTIONS[made.trap.type], made.trap.data


def messages(made: Core, until: int) -> list[Any]:
    sent = []
    while (stop := made.run(until)) is not Stop.REACHED:
        assert stop is Stop.MESSAGE, made.trap
        sent += made.take_messages()
    return sent


# Outputs


@pytest.mark.parametrize("lockstep", [False, True])
def test_words_at_falling_edges(lockstep: bool) -> None:
    """A port with divide 25 changes every 200 cycles, first a period after the start of its clock."""
    text = f"""
        {clocked(PORT_32A, 25)}
        {constant("r1", 0x11000)}
        ldc r2, 1000
    loop:
        ldw r3, r1[0]
        out res[r4], r3
        ldaw r1, r1[1]
        sub r2, r2, 1
        bt r2, loop
        syncr res[r4]
        getts r6, res[r4]
        clre
        waiteu
    """
    words = np.random.default_rng(1).integers(1, 2**32, 1000)
    made = core(text, lockstep=lockstep)
    set_words(made, 0x11000, words)
    made.watch(PORT_32A)
    assert made.run(300_000) is Stop.REACHED
    cycles, seen = made.port_log(PORT_32A)
    assert seen.tolist() == words.tolist()
    assert np.diff(cycles).tolist() == [200] * 999
    assert made.registers(0)[6] == 1000
    assert made.port_log(PORT_32A)[0].size == 0


def test_start_of_a_clock() -> None:
    """The first falling edge is a whole period after the start, with a period of two reference cycles for divide 1."""
    for divide, period in ((0, 4), (1, 8), (3, 24), (255, 2040)):
        text = clocked(PORT_32A, divide).replace("setc res[r5], 15", "")
        text += "getr r6, 1\nldc r1, 9\nout res[r4], r1\nsetc res[r5], 15\nin r7, res[r6]\n"
        made = execute(text, cycles=10_000, watch=PORT_32A)
        (cycle,), (word,) = made.port_log(PORT_32A)
        start = 4 * int(made.registers(0)[7]) - 4  # the instruction before IN
        assert (int(cycle) - start, int(word)) == (period, 9)


def test_log_fills() -> None:
    made = core(f"{plain(PORT_32A)}loop: add r0, r0, 1\nout res[r4], r0\nbu loop")
    made.watch(PORT_32A)
    seen = 0
    while made.run(1_500_000) is Stop.LOG_FULL:
        cycles, words = made.port_log(PORT_32A)
        assert words.tolist() == list(range(seen + 1, seen + 1 + len(words)))
        seen += len(words)
    assert seen > 60_000
    assert np.diff(cycles).min() >= 12


@pytest.mark.parametrize("wait", [12, 40, 65_535])
def test_timed_output(wait: int) -> None:
    """SETPT holds an output back until the counter has a value, modulo 65536; GETTS returns it."""
    text = f"""
        {clocked(PORT_32A, 1)}
        out res[r4], r4
        syncr res[r4]
        getts r0, res[r4]
        {constant("r1", wait)}
        add r1, r0, r1
        setpt res[r4], r1
        ldc r2, 77
        out res[r4], r2
        ldc r3, 78
        out res[r4], r3
        syncr res[r4]
        getts r3, res[r4]
    """
    made = execute(text, cycles=1_000_000, watch=PORT_32A)
    cycles, words = made.port_log(PORT_32A)
    assert words.tolist() == [PORT_32A, 77, 78]
    assert np.diff(cycles).tolist() == [8 * wait, 8]
    assert made.registers(0)[3] == (int(made.registers(0)[0]) + wait + 1) % 65536


def test_clrpt_and_a_missed_time() -> None:
    """CLRPT forgets the time. Without data at its time an output becomes an input."""
    start = f"{clocked(PORT_32A, 2)}ldc r1, 5\nout res[r4], r1\nsyncr res[r4]\ngetts r0, res[r4]\nadd r0, r0, 9\n"
    text = start + "setpt res[r4], r0\nclrpt res[r4]\nldc r2, 6\nout res[r4], r2\n"
    made = execute(text, cycles=10_000, watch=PORT_32A)
    cycles, _ = made.port_log(PORT_32A)
    assert cycles[1] - cycles[0] <= 64
    made = core(start + "setpt res[r4], r0\nclre\nwaiteu")
    made.watch(PORT_32A)
    made.run(10_000)
    cycles, words = made.port_log(PORT_32A)
    assert words.tolist() == [5, 0]
    assert cycles[1] - cycles[0] == 9 * 16 + (9 * 0)


def test_buffered_output() -> None:
    """Of 32 bits the lowest go first; OUTPW sends some; OUTSHR shifts; the last bits stay on the pins."""
    text = f"""
        {clocked(PORT_4A, 2)}
        setc res[r4], 0x200f
        ldc r0, 32
        settw res[r4], r0
        {constant("r1", 0x87654321)}
        {constant("r2", 0x0000DCBA)}
        {constant("r3", 0xF00000E9)}
        out res[r4], r1
        outpw res[r4], r2, 16
        outshr res[r4], r3
    """
    made = execute(text, cycles=10_000, watch=PORT_4A)
    cycles, words = made.port_log(PORT_4A)
    assert words.tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 0xA, 0xB, 0xC, 0xD, 9, 0xE, 0, 0xF]
    assert np.diff(cycles).tolist() == [*14 * [16], 5 * 16]
    assert made.registers(0)[3] == 0


def test_buffered_output_never_pauses_between_words() -> None:
    """The transfer register keeps the shift register busy, even if a thread is late by nearly a word."""
    text = f"""
        {clocked(PORT_1F, 1)}
        setc res[r4], 0x200f
        ldc r0, 32
        settw res[r4], r0
        {constant("r1", 0x55555555)}
        ldc r2, 20
    loop:
        out res[r4], r1
        ldc r3, 18
    late:
        sub r3, r3, 1
        bt r3, late
        sub r2, r2, 1
        bt r2, loop
    """
    made = execute(text, cycles=100_000, watch=PORT_1F)
    cycles, words = made.port_log(PORT_1F)
    assert np.diff(cycles).tolist() == 639 * [8]
    assert words.tolist() == 320 * [1, 0]


def test_inverted_port() -> None:
    made = core(f"{plain(PORT_1F)}setc res[r4], 0x600f\nldc r0, 0\nout res[r4], r0\npeek r1, res[r4]\nldc r2, 1\n"
                "out res[r4], r2\nsyncr res[r4]\npeek r3, res[r4]\nclre\nwaiteu")  # fmt: skip
    made.watch(PORT_1F)
    made.run(1000)
    assert made.port_log(PORT_1F)[1].tolist() == [1, 0]
    assert made.registers(0)[3] == 1


# Inputs


def test_input_and_peek() -> None:
    """IN returns a sample that is newer than the last IN; PEEK the pins as they are."""
    made = core(f"{plain(PORT_8C)}loop: in r0, res[r4]\npeek r1, res[r4]\nbu loop")
    for cycle, value in ((100, 0x5A), (200, 0x1FF), (300, 0x80)):
        made.drive(PORT_8C, cycle, value)
    for until, value in ((99, 0), (130, 0x5A), (230, 0xFF), (330, 0x80)):
        made.run(until)
        assert made.registers(0)[:2].tolist() == [value, value]


@pytest.mark.parametrize("lockstep", [False, True])
@pytest.mark.parametrize(("condition", "value"), [(0x11, 1), (0x19, 0)])
def test_condition(condition: int, value: int, lockstep: bool) -> None:
    """A thread that waits for a value of a pin goes on within two reference cycles, even if the pulse is over."""
    text = f"""
        {plain(PORT_1F)}
        getr r6, 1
        ldc r8, 99
        ldc r0, {value}
        setd res[r4], r0
        setc res[r4], {condition}
        in r0, res[r4]
        in r7, res[r6]
        setc res[r4], 1
        in r8, res[r4]
    """
    for rise in (1000, 1001, 1002, 1003, 5555):
        made = execute(text, cycles=700, pins=[(PORT_1F, rise, 1), (PORT_1F, rise + 4, 0)], lockstep=lockstep)
        assert made.threads()[0].waits_for == "an input"
        assert made.threads()[0].resource == "port 1F"
        made.run(20_000)
        assert made.registers(0)[0] == 1
        assert 0 <= 4 * int(made.registers(0)[7]) - rise <= 12
        assert made.registers(0)[8] == 0


def test_driving_while_a_thread_waits() -> None:
    made = core(
        f"{plain(PORT_1F)}ldc r0, 1\nsetd res[r4], r0\nsetc res[r4], 0x11\nin r0, res[r4]\nldc r3, 7\nclre\nwaiteu"
    )
    for until in range(100, 2000, 100):
        made.run(until)
        assert made.threads()[0].ready is None
    made.drive(PORT_1F, 2000, 1)
    made.run(2012)
    assert made.registers(0)[3] == 7


def test_timed_input() -> None:
    """With SETPT the sample is that of the rising edge at which the counter has the value."""
    text = f"""
        {clocked(PORT_8C, 25)}
        in r0, res[r4]
        in r0, res[r4]
        getts r1, res[r4]
        add r2, r1, 10
        setpt res[r4], r2
        in r3, res[r4]
        getts r6, res[r4]
    """
    made = execute(text, cycles=9_999, pins=[(PORT_8C, cycle, cycle >> 4) for cycle in range(1, 10_000)])
    regs = made.registers(0)
    assert regs[6] == regs[2]
    assert (int(regs[3]) << 4) - (int(regs[0]) << 4) == pytest.approx(2000, abs=16)


def test_buffered_input() -> None:
    """The first sample is in the lowest bits; INPW takes fewer bits, into the highest; INSHR shifts them in."""
    text = f"""
        {clocked(PORT_4A, 25)}
        setc res[r4], 0x200f
        ldc r0, 32
        settw res[r4], r0
        setc res[r4], 0x17
        in r1, res[r4]
        in r2, res[r4]
        getts r6, res[r4]
        inshr r3, res[r4]
        getts r7, res[r4]
    """
    made = execute(text, cycles=50_000, pins=[(PORT_4A, 200 * tick + 1, tick % 15) for tick in range(300)])
    regs = made.registers(0)
    nibbles = [int(regs[r]) >> 4 * place & 15 for r in (1, 2, 3) for place in range(8)]
    assert nibbles == [(nibbles[0] + place) % 15 for place in range(24)]
    assert regs[7] - regs[6] == 8


def test_buffered_input_after_a_long_time() -> None:
    """A word that nobody took is overwritten by later ones."""
    text = f"""
        {clocked(PORT_4A, 1)}
        setc res[r4], 0x200f; ldc r0, 32; settw res[r4], r0
        getr r6, 1; ldc r7, 6000; setd res[r6], r7; setc res[r6], 9
        in r7, res[r6]
        in r1, res[r4]
        getts r2, res[r4]
    """
    made = execute(text, cycles=50_000, pins=[(PORT_4A, 100, 5), (PORT_4A, 5000, 11)])
    assert made.registers(0)[1] == 0xBBBBBBBB
    assert 3000 - 16 <= made.registers(0)[2] <= 3000


def test_buffered_input_aligns_to_a_condition() -> None:
    """A buffered port that waits for a value returns it as the last sample, and then whole words."""
    text = f"""
        {clocked(PORT_4A, 25)}
        setc res[r4], 0x200f
        ldc r0, 32
        settw res[r4], r0
        ldc r0, 9
        setd res[r4], r0
        setc res[r4], 0x11
        in r1, res[r4]
        in r2, res[r4]
    """
    made = core(text + "clre\nwaiteu")
    values = [0] * 20 + [1, 2, 3, 9, 4, 5, 6, 7, 8, 10, 11, 12, 13, 14]
    for tick, value in enumerate(values):
        made.drive(PORT_4A, 200 * tick + 1, value)
    made.run(50_000)
    assert made.registers(0)[1] >> 16 == 0x9321
    assert made.registers(0)[2] == 0xCBA87654


def test_endin() -> None:
    """ENDIN says how many bits are left; IN then returns a word, and the rest."""
    text = f"""
        {clocked(PORT_1F, 25)}
        setc res[r4], 0x200f
        ldc r0, 32
        settw res[r4], r0
        setc res[r4], 0x17
        getr r6, 1
        in r7, res[r6]
        ldc r8, 500
        add r7, r7, r8
        setd res[r6], r7
        setc res[r6], 9
        in r8, res[r6]
        endin r1, res[r4]
        in r2, res[r4]
    """
    made = execute(text, cycles=50_000, pins=[(PORT_1F, 1, 1)])
    assert 9 <= made.registers(0)[1] <= 11
    assert made.registers(0)[2] >> (32 - int(made.registers(0)[1])) == (1 << int(made.registers(0)[1])) - 1


def test_direction_changes() -> None:
    """After an output IN waits until it was on the pins for a period, and OUT makes an output of an input."""
    text = f"""
        {clocked(PORT_8C, 25)}
        ldc r0, 0x55
        out res[r4], r0
        in r1, res[r4]
        getts r2, res[r4]
        out res[r4], r0
        syncr res[r4]
        getts r3, res[r4]
    """
    made = execute(text, cycles=10_000, watch=PORT_8C, pins=[(PORT_8C, 1, 0x33)])
    cycles, words = made.port_log(PORT_8C)
    assert words.tolist() == [0x55, 0, 0x55]
    assert cycles[1] - cycles[0] == 200
    assert made.registers(0)[1] == 0x33
    assert made.registers(0)[3] > made.registers(0)[2]


def test_clock_from_a_pin() -> None:
    """A port whose clock block follows a pin puts out a word at each of its falling edges."""
    text = f"""
        {plain(PORT_1F, "r6")}
        {plain(PORT_8C)}
        {constant("r5", CLOCK_2)}
        setc res[r5], 8
        setclk res[r5], r6
        setclk res[r4], r5
        setc res[r5], 15
        ldc r1, 1
    loop:
        out res[r4], r1
        add r1, r1, 1
        bu loop
    """
    made = core(text)
    made.watch(PORT_8C)
    falls = []
    level = 0
    rng = np.random.default_rng(3)
    cycle = 1000
    for _ in range(40):
        level ^= 1
        cycle += int(rng.integers(20, 500))
        made.drive(PORT_1F, cycle, level)
        if level == 0:
            falls.append(cycle)
    made.run(50_000)
    cycles, words = made.port_log(PORT_8C)
    assert cycles.tolist() == falls
    assert words.tolist() == list(range(1, 21))
    assert made.port_counter(PORT_8C) == 20


PORT_STEPS = (
    "out", "in", "setpt", "getts", "peek", "syncr", "clrpt", "wait", "eq", "all", "endin", "clrbuf", "outpw", "inpw",
)  # fmt: skip


@given(
    st.lists(st.tuples(st.sampled_from(PORT_STEPS), st.integers(0, 300)), min_size=1, max_size=25),
    st.booleans(),
    st.integers(0, 6),
    st.lists(st.integers(1, 900), max_size=30),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_looking_does_not_change_a_port(
    steps: list[tuple[str, int]], buffered: bool, divide: int, changes: list[int], falling: bool
) -> None:
    """A port that is brought up in every cycle, edge by edge, does what it does if it is brought up in long steps."""
    lines = [clocked(PORT_4A, divide)]
    if buffered:
        lines += ["setc res[r4], 0x200f", "ldc r0, 32", "settw res[r4], r0"]
    if falling:
        lines.append("setc res[r4], 0x400f")
    lines += ["getr r6, 1", "ldc r10, 0", "ldaw r9, sp[0]"]
    for name, number in steps:
        lines += {
            "out": [f"ldc r1, {number * 77}", "out res[r4], r1"],
            "in": ["in r1, res[r4]"],
            "setpt": ["getts r1, res[r4]", f"ldc r2, {number % 50}", "add r1, r1, r2", "setpt res[r4], r1"],
            "getts": ["getts r1, res[r4]"],
            "peek": ["peek r1, res[r4]"],
            "syncr": ["syncr res[r4]"],
            "clrpt": ["clrpt res[r4]"],
            "wait": ["in r1, res[r6]", f"ldc r2, {number}", "add r1, r1, r2", "setd res[r6], r1", "setc res[r6], 9",
                     "in r1, res[r6]", "setc res[r6], 1"],
            "eq": [f"ldc r1, {number % 16}", "setd res[r4], r1", "setc res[r4], 0x11"],
            "all": ["setc res[r4], 1"],
            "endin": ["setc res[r4], 1", "in r1, res[r4]", "endin r1, res[r4]", "in r2, res[r4]"] if buffered else [],
            "clrbuf": ["setc res[r4], 0x17"],
            "outpw": [f"ldc r1, {number * 99}", f"outpw res[r4], r1, {4 if number % 2 else 16}"] if buffered else [],
            "inpw": [f"inpw r1, res[r4], {8 if number % 2 else 24}"] if buffered else [],
        }[name]  # fmt: skip
        lines += ["crc32 r10, r1, r9"]
    text = "\n".join([*lines, "clre", "waiteu"])
    values = np.random.default_rng(divide).integers(0, 16, len(changes)).tolist()
    seen = []
    for often in (True, False):
        made = core(text)
        for cycle, value in zip(np.cumsum(changes).tolist(), values, strict=True):
            made.drive(PORT_4A, 20 + cycle, value)
        if often:
            made.watch(PORT_4A)
        for until in range(1, 4000) if often else [3999]:
            made.run(until)
        seen.append((made.registers(0).tolist(), made.threads()[0], made.instructions))
    assert seen[0] == seen[1]


# Timers


@pytest.mark.parametrize("lockstep", [False, True])
@pytest.mark.parametrize("wait", [0, 1, 2, 50, 100_000])
def test_timer(wait: int, lockstep: bool) -> None:
    """With COND_AFTER a timer is ready when its time is over; the thread goes on in the first cycle after it."""
    text = f"getr r0, 1\nin r1, res[r0]\n{constant('r2', wait)}add r2, r1, r2\n"
    text += "setd res[r0], r2\nsetc res[r0], 9\nin r3, res[r0]"
    made = execute(text + "\ngetd r4, res[r0]", cycles=10**6, lockstep=lockstep)
    regs = made.registers(0)
    passed = text.count("\n") - 1
    assert regs[3] == max(int(regs[2]) + 1, int(regs[1]) + passed)
    assert regs[4] == regs[2]


def test_timer_wraps() -> None:
    """The reference clock has 32 bits, and times before and after its end compare."""
    text = "getr r0, 1\nin r1, res[r0]\nldc r2, 100\nadd r2, r1, r2\nsetd res[r0], r2\nsetc res[r0], 9\nin r3, res[r0]"
    start = 4 * (2**32 - 50)
    made = execute(text, start=start)
    assert made.registers(0)[1:4].tolist() == [2**32 - 49, 51, 52]


def test_an_idle_core_jumps() -> None:
    made = core(f"getr r0, 1\n{constant('r1', 1 << 30)}setd res[r0], r1\nsetc res[r0], 9\nin r2, res[r0]\nclre\nwaiteu")
    begun = time.perf_counter()
    made.run(2**40)
    assert time.perf_counter() - begun < 0.1
    assert made.registers(0)[2] == 2**30 + 1
    assert made.cycle == 2**40


# Channel ends


CHANNELS = """
    getr r0, 2
    getr r1, 2
    setd res[r0], r1
    setd res[r1], r0
"""


@pytest.mark.parametrize("node", [0, 0xFFFF])
def test_local_channel(node: int) -> None:
    """A word is four tokens, the most significant first; control tokens are told apart."""
    made = execute(
        CHANNELS
        + """
        ldc r2, 0x1234
        shl r2, r2, 16
        out res[r0], r2
        outt res[r0], r2
        outct res[r0], 5
        testwct r3, res[r1]
        int r4, res[r1]
        int r5, res[r1]
        testwct r6, res[r1]
        testct r7, res[r1]
        int r8, res[r1]
        int r8, res[r1]
        testwct r8, res[r1]
        int r9, res[r1]
        testct r9, res[r1]
        inct r10, res[r1]
        outct res[r0], 1
        chkct res[r1], 1
        """,
        node=node,
    )
    regs = made.registers(0)
    assert regs[0] == node << 16 | 0x002
    assert regs[1] == node << 16 | 0x102
    assert regs[3:11].tolist() == [0, 0x12, 0x34, 4, 0, 2, 1, 5]


def two_threads(first: str, second: str) -> str:
    """Two threads with two channels, of which the first thread has the ends 0 and 2."""
    return f"""
        {CHANNELS}
        getr r4, 2
        getr r5, 2
        setd res[r4], r5
        setd res[r5], r4
        getr r2, 3
        getst r3, res[r2]
        ldap r11, second
        init t[r3]:pc, r11
        set t[r3]:r1, r1
        set t[r3]:r5, r5
        msync res[r2]
        {first}
        clre
        waiteu
    second:
        {second}
        clre
        waiteu
    """


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_full_buffer_holds_the_sender(lockstep: bool) -> None:
    """Eight tokens fit; a sender pauses until there is room for all of its word."""
    late = (
        "getr r6, 1\nin r7, res[r6]\nldc r8, 250\nadd r7, r7, r8\nsetd res[r6], r7\nsetc res[r6], 9\nin r7, res[r6]\n"
    )
    made = core(
        two_threads(
            "out res[r0], r0\nout res[r0], r1\nout res[r0], r2\nout res[r0], r3\nldc r6, 1",
            late + "in r0, res[r1]\n" + late.replace("getr r6, 1", "") + "in r2, res[r1]\nint r3, res[r1]",
        ),
        lockstep=lockstep,
    )
    made.run(800)
    assert made.threads()[0].waits_for == "room"
    made.run(100_000)
    assert made.registers(0)[6] == 1
    assert made.registers(1)[0] == 0x002
    assert made.registers(1)[2:4].tolist() == [0x102, 0]
    late_twice = int(made.registers(1)[7])
    assert late_twice * 4 >= 2000


def test_senders_take_turns() -> None:
    """A packet to a channel end is whole, though three threads send at a time; who waits longest sends next."""
    start = "getr r1, 2; setd res[r1], r0; getst r3, res[r2]; init t[r3]:pc, r11; set t[r3]:r0, r1; "
    text = f"""
        getr r0, 2; getr r2, 3; ldap r11, sender
        {start * 3}
        msync res[r2]
        {constant("r5", 0x18000)}
        ldc r6, 60
    loop:
        in r7, res[r0]
        stw r7, r5[0]
        in r7, res[r0]
        stw r7, r5[1]
        chkct res[r0], 1
        ldaw r5, r5[2]
        sub r6, r6, 1
        bt r6, loop
        clre; waiteu
    sender:
        ldc r6, 20
    again:
        out res[r0], r0
        out res[r0], r6
        outct res[r0], 1
        sub r6, r6, 1
        bt r6, again
        clre; waiteu
    """
    made = core(text)
    assert made.run(100_000) is Stop.REACHED
    pairs = np.array(get_words(made, 0x18000, 120)).reshape(60, 2)
    for end in (0x102, 0x202, 0x302):
        assert pairs[pairs[:, 0] == end, 1].tolist() == list(range(20, 0, -1))
    assert all(len(set(pairs[place : place + 3, 0])) == 3 for place in range(58))


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("outct res[r0], 3\nint r2, res[r1]", 0x102),
        ("outt res[r0], r0\ninct r2, res[r1]", 0x102),
        ("outct res[r0], 3\nchkct res[r1], 1", 0x102),
        ("outt res[r0], r0\nchkct res[r1], 1", 0x102),
        ("outt res[r0], r0\noutct res[r0], 1\nin r2, res[r1]", 0x102),
        ("outt res[r0], r0\nfreer res[r1]", 0x102),
        ("outt res[r0], r0\nsetd res[r0], r1", 0x002),
        ("ldc r2, 1\nsetd res[r0], r2", 0x002),
        ("setc res[r0], 9", 0x002),
    ],
)
def test_wrong_tokens(text: str, data: int) -> None:
    assert trapped(CHANNELS + text) == ("illegal resource", data)


def test_no_destination() -> None:
    assert trapped("getr r0, 2\ngetr r1, 2\noutt res[r1], r0") == ("link error", 0x102)


def test_packets_to_nobody_are_lost() -> None:
    made = execute(
        "getr r0, 2; ldc r1, 0x1f02; setd res[r0], r1; ldc r2, 9; loop: out res[r0], r2; sub r2, r2, 1; bt r2, loop; "
        "outct res[r0], 1; ldc r3, 5"
    )
    assert made.registers(0)[3] == 5


SEND = f"""
    getr r0, 2
    {constant("r1", ANSWER)}
    setd res[r0], r1
    {constant("r2", 0x01020304)}
"""


def test_messages_to_elsewhere() -> None:
    text = SEND + "out res[r0], r2\noutt res[r0], r2\noutct res[r0], 9\noutct res[r0], 1\nouttail:\noutct res[r0], 2\n"
    made = core(text + "clre\nwaiteu", node=3)
    first, second = messages(made, 10_000)
    assert (first.channel_end, first.destination) == (0, ANSWER)
    assert first.tokens.tolist() == [1, 2, 3, 4, 4, 0x109, END]
    assert first.ends - first.begins == 7 * 8
    assert second.tokens.tolist() == [PAUSE]
    assert second.begins > first.begins


def test_a_slow_link_holds_the_sender() -> None:
    """More than 8 tokens do not wait for the link, of which one leaves every so many cycles."""
    for rate in (8, 40, 333):
        body = 8 * "out res[r0], r2\n"
        made = core(SEND + "getr r6, 1\nin r7, res[r6]\n" + body + "in r8, res[r6]\noutct res[r0], 1\nclre\nwaiteu")
        made.link_cycles_per_token = rate
        (sent,) = messages(made, 100_000)
        took = 4 * (int(made.registers(0)[8]) - int(made.registers(0)[7]))
        assert took >= (32 - 8) * rate
        assert took <= (32 - 8) * rate + 16 + 9 * 4
        assert sent.ends - sent.begins == pytest.approx(33 * rate, abs=40)


def test_switch_messages_leave_even_from_the_own_node() -> None:
    destination = constant("r1", 3 << 16 | 0xC30C)
    text = f"getr r0, 2\n{destination}setd res[r0], r1\ntestlcl r3, res[r0]\n"
    text += "outct res[r0], r4\nout res[r0], r2\noutct res[r0], 1\n"
    made = core(text + "clre\nwaiteu", 0, 0, 7, 0, 0xC0, node=3)
    (sent,) = messages(made, 10_000)
    assert sent.destination == 3 << 16 | 0xC30C
    assert sent.tokens.tolist() == [0x1C0, 0, 0, 0, 7, END]
    assert made.registers(0)[3] == 0


def test_node_changes() -> None:
    made = core(
        "getr r0, 2\nin r2, res[r0]\ngetr r1, 2\nsetd res[r1], r0\ntestlcl r3, res[r1]\nclre\nwaiteu", node=0xFFFF
    )
    made.run(100)
    made.set_node(0x21)
    made.deliver(0, [0, 0, 0, 0], [200] * 4)
    made.run(1000)
    assert made.registers(0)[[0, 1, 3]].tolist() == [0xFFFF0002, 0x210102, 0]


def test_tokens_from_outside() -> None:
    """A thread goes on as soon as the last token of its word is there; the queue before the buffer has no end."""
    text = "getr r0, 2\ngetr r1, 1\nin r2, res[r0]\nin r3, res[r1]\nchkct res[r0], 1\nin r4, res[r1]\n"
    made = execute(text, cycles=500)
    assert made.threads()[0].ready is None
    assert (made.threads()[0].waits_for, made.threads()[0].resource) == ("a word", "channel end 0")
    made.deliver(0, [1, 2, 3, 4], [1000, 1010, 1020, 1031])
    made.run(1015)
    made.deliver(0, [END], [3000])
    made.run(5000)
    assert made.registers(0)[2] == 0x01020304
    assert made.registers(0)[3] == 1035 // 4
    assert 3004 <= 4 * made.registers(0)[4] <= 3008
    assert made.held_up == 0


@pytest.mark.parametrize(("came", "goes_on"), [(9, 12), (11, 12), (13, 13), (18, 18)])
def test_a_thread_that_pauses_shortly(came: int, goes_on: int) -> None:
    """It issues again no sooner than 4 cycles after it did, in cycle 8."""
    made = core("getr r0, 2; getr r1, 1; int r2, res[r0]; in r3, res[r1]; clre; waiteu")
    made.run(8)
    made.deliver(0, [1], [came])
    made.run(100)
    assert made.registers(0)[3] == (goes_on + 4) // 4


def test_held_up() -> None:
    """Tokens are counted that come while 8 are unread, and those that wait behind them."""
    text = "getr r0, 2\ngetr r1, 1\nldc r2, 250\nsetd res[r1], r2\nsetc res[r1], 9\nin r2, res[r1]\n"
    text += "ldc r3, 5000\nloop: int r4, res[r0]\nadd r5, r5, r4\nbu loop"
    made = core(text)
    made.run(50)
    made.deliver(0, [1] * 600, np.arange(60, 660))  # one in each cycle
    made.run(100_000)
    assert made.registers(0)[5] == 600
    assert made.held_up == 592
    made = core(text)
    made.run(50)
    made.deliver(0, [1] * 600, np.arange(1200, 1200 + 600 * 12, 12))
    made.run(100_000)
    assert made.registers(0)[5] == 600
    assert made.held_up == 0


def test_long_queues() -> None:
    """More tokens than the arrays had place for at first, delivered in parts."""
    made = core("getr r0, 2\nloop: int r1, res[r0]\nadd r2, r2, r1\nbu loop")
    made.run(100)
    cycle = 200
    for _ in range(30):
        made.deliver(0, [3] * 1000, np.arange(cycle, cycle + 1000))
        cycle += 1000
        made.run(cycle - 700)
    made.run(10**6)
    assert made.registers(0)[2] == 90_000


def test_control_among_a_word_from_outside() -> None:
    made = core("getr r0, 2\ntestwct r1, res[r0]\ngetr r2, 1\nin r3, res[r2]\nin r4, res[r0]")
    made.run(100)
    made.deliver(0, [7, 8, END], [200, 210, 220])
    assert made.run(1000) is Stop.TRAPPED
    assert made.registers(0)[1] == 3
    assert made.registers(0)[3] == 228 // 4
    assert made.trap is not None
    assert made.trap.data == 0x002


def test_tokens_for_a_channel_end_that_is_not_used() -> None:
    made = core("ldc r1, 100\nwait: sub r1, r1, 1\nbt r1, wait\ngetr r0, 2\nint r2, res[r0]\nclre\nwaiteu")
    made.deliver(0, [1, 2, END, 9], [10, 20, 30, 5000])
    made.run(10_000)
    assert made.registers(0)[2] == 9


# Locks


@pytest.mark.parametrize("lockstep", [False, True])
def test_lock(lockstep: bool) -> None:
    """Threads that wait for a lock get it in their order."""
    text = """
        getr r0, 5
        in r1, res[r0]
        getr r2, 3
        ldc r5, 6
    more:
        getst r3, res[r2]
        ldap r11, child
        init t[r3]:pc, r11
        set t[r3]:r0, r0
        set t[r3]:r4, r4
        sub r5, r5, 1
        bt r5, more
        msync res[r2]
        ldc r5, 50
    wait:
        sub r5, r5, 1
        bt r5, wait
        out res[r0], r0
        mjoin res[r2]
        clre
        waiteu
    child:
        get r11, id
        ldc r6, 7
        sub r6, r6, r11
        shl r6, r6, 3
    late:
        sub r6, r6, 1
        bt r6, late
        in r1, res[r0]
        ldw r7, r4[0]
        stw r11, r4[r7]
        add r7, r7, 1
        stw r7, r4[0]
        out res[r0], r0
        ssync
    """
    made = core(text, 0, 0, 0, 0, 0x18000, lockstep=lockstep)
    set_words(made, 0x18000, [1])
    assert made.run(20_000) is Stop.REACHED
    assert made.registers(0)[1] == 5  # the identifier
    assert get_words(made, 0x18000, 7) == [7, 6, 5, 4, 3, 2, 1]
    assert [view.state for view in made.threads()] == ["paused", *7 * ["free"]]


# Events


EVENTS = """
    getr r0, 1
    getr r1, 2
    getr r2, 2
    setd res[r1], r2
    ldap r11, timer
    setv res[r0], r11
    ldap r11, channel
    setv res[r2], r11
"""


def test_events() -> None:
    """An event begins at its vector, with the environment in ed, and events off."""
    text = (
        EVENTS
        + """
        ldc r3, 300
        setd res[r0], r3
        setc res[r0], 9
        eeu res[r0]
        eeu res[r2]
        waiteu
        ldc r4, 99
    timer:
        getsr r11, 1
        mov r5, r11
        get r11, ed
        mov r6, r11
        in r7, res[r0]
        edu res[r0]
        ldap r11, set
        setev res[r2], r11
        outct res[r1], 1
    set:
        waiteu
    channel:
        get r11, ed
        mov r8, r11
        chkct res[r2], 1
        """
    )
    made = execute(text)
    regs = made.registers(0)
    assert regs[4:8].tolist() == [0, 0, 0x001, 301 + 4]
    assert 0x10000 < regs[8] < 0x10100


def test_order_of_events() -> None:
    """Of several events that are due, a timer's comes before a channel end's, and smaller numbers first."""
    text = """
        getr r0, 2
        getr r1, 2
        getr r2, 2
        getr r3, 2
        getr r4, 1
        setd res[r0], r2
        setd res[r1], r3
        outt res[r1], r1
        outt res[r0], r0
        ldap r11, came
        setv res[r2], r11
        setv res[r3], r11
        setv res[r4], r11
        eeu res[r3]
        eeu res[r2]
        eeu res[r4]
        ldaw r5, sp[1]
        ldc r6, 3
    loop:
        waiteu
    came:
        get r11, ed
        stw r11, r5[0]
        ldaw r5, r5[1]
        edu res[r11]
        sub r6, r6, 1
        bt r6, loop
    """
    made = execute(text)
    assert get_words(made, int(made.registers(0)[14]) + 4, 3) == [0x001, 0x202, 0x302]


@pytest.mark.parametrize(("name", "value", "enabled"), [
    ("eet", 1, True), ("eet", 0, False), ("eef", 1, False), ("eef", 0, True), ("eeu", 0, True), ("edu", 0, False),
])  # fmt: skip
def test_conditional_enabling(name: str, value: int, enabled: bool) -> None:
    operands = f"r3, res[r0]" if name in ("eet", "eef") else "res[r0]"  # noqa: F541
    made = execute(
        f"getr r0, 1\nldap r11, came\nsetv res[r0], r11\n{name} {operands}\nwaiteu\ncame: ldc r5, 1", 0, 0, 0, value
    )
    assert made.registers(0)[5] == enabled


@pytest.mark.parametrize(
    ("name", "value", "waits"), [("waitet", 1, True), ("waitet", 0, False), ("waitef", 1, False), ("waitef", 0, True)]
)
def test_conditional_waiting(name: str, value: int, waits: bool) -> None:
    made = execute(
        f"getr r0, 1; ldap r11, t; setv res[r0], r11; eeu res[r0]; {name} r3; ldc r5, 1; bu end; t: ldc r5, 2; end:",
        0,
        0,
        0,
        value,
    )
    assert made.registers(0)[5] == (2 if waits else 1)


def test_clre_and_setsr() -> None:
    """With SETSR 1 an event interrupts a running thread; CLRSR 1 and CLRE end that."""
    text = """
        getr r0, 1
        ldap r11, came
        setv res[r0], r11
        ldc r1, 100
        setd res[r0], r1
        setc res[r0], 9
        eeu res[r0]
        setsr 1
    loop:
        add r2, r2, 1
        bu loop
    came:
        getsr r11, 1
        mov r3, r11
        add r4, r4, 1
        eq r5, r4, 3
        bt r5, enough
        setsr 1
        ldc r6, 99
    enough:
        clre
        setsr 1
        ldc r7, 99
        clrsr 1
    """
    made = execute(text)
    regs = made.registers(0)
    assert regs[2:8].tolist() == [regs[2], 0, 3, 1, 0, 99]  # SETSR 1 brings the event again at once, until CLRE
    assert 85 <= 2 * regs[2] <= 101


@pytest.mark.parametrize("lockstep", [False, True])
def test_interrupt(lockstep: bool) -> None:
    """An interrupt keeps place, status and ed; KRET returns to the instruction that would have come."""
    text = """
        getr r0, 1
        ldap r11, came
        setv res[r0], r11
        ldc r1, 100
        setd res[r0], r1
        setc res[r0], 9
        setc res[r0], 10
        eeu res[r0]
        setsr 2
        ldc r2, 1000
    loop:
        add r3, r3, 1
        sub r2, r2, 1
        bt r2, loop
        bu end
        .p2align 2
    came:
        in r1, res[r0]
        ldc r10, 100
        add r1, r1, r10
        setd res[r0], r1
        getsr r11, 31
        mov r5, r11
        get r11, ed
        mov r6, r11
        add r4, r4, 1
        kret
    end:
        clrsr 2
    """
    made = execute(text, lockstep=lockstep)
    regs = made.registers(0)
    assert regs[3] == 1000
    assert (
        29 <= regs[4] <= 33
    )  # 3000 instructions, one every 4 cycles, and those of the interrupts, every 100 reference cycles
    assert regs[5] == 8 + 16
    assert regs[6] == 0x001
    assert regs[16] & 30 == 0


def test_interrupt_of_a_thread_that_waits() -> None:
    """A thread that pauses for a token is interrupted, and pauses again."""
    text = """
        getr r0, 1
        getr r7, 2
        ldap r11, came
        setv res[r0], r11
        ldc r1, 100
        setd res[r0], r1
        setc res[r0], 9
        setc res[r0], 10
        eeu res[r0]
        setsr 2
        int r8, res[r7]
        clrsr 2
        bu end
        .p2align 2
    came:
        edu res[r0]
        add r4, r4, 1
        kret
    end:
    """
    made = execute(text, cycles=2000)
    assert made.threads()[0].waits_for == "a token"
    assert made.registers(0)[4] == 1
    made.deliver(0, [55], [3000])
    made.run(4000)
    assert made.registers(0)[8] == 55


def test_event_of_a_port() -> None:
    """The event of a pin: the value that caused it is what IN returns, even if the pin has changed since."""
    text = f"""
        {plain(PORT_1F)}
        ldap r11, came
        setv res[r4], r11
        ldc r0, 1
        setd res[r4], r0
        setc res[r4], 0x11
        eeu res[r4]
        getr r6, 1
        waiteu
    came:
        in r7, res[r6]
        in r8, res[r4]
    """
    made = execute(text, cycles=5000, pins=[(PORT_1F, 1000, 1), (PORT_1F, 1006, 0)])
    assert made.registers(0)[8] == 1
    assert 1000 <= 4 * made.registers(0)[7] <= 1012


def test_eight_receivers() -> None:
    """A loop of events over six channel ends takes every token, whenever it comes."""
    text = """
        ldc r0, 0
        getr r1, 2
    """
    text += "".join("getr r1, 2\nldap r11, came\nsetv res[r1], r11\nmov r11, r1\neeu res[r1]\n" for _ in range(6))
    text += "wait: waiteu\ncame: get r11, ed\nint r2, res[r11]\nadd r0, r0, r2\nbu wait"
    made = core(text)
    made.run(500)
    rng = np.random.default_rng(9)
    total = 0
    for end in range(1, 7):
        tokens = rng.integers(0, 256, 500)
        made.deliver(end, tokens, np.sort(rng.integers(501, 500_000, 500)))
        total += int(tokens.sum())
    made.run(600_000)
    assert made.registers(0)[0] == total


# Resources and threads


def test_allocation() -> None:
    """GETR returns the first that is free, and 0 if there is none."""
    for kind, count in ((1, 10), (2, 32), (3, 7), (5, 4), (0, 0), (6, 0), (7, 0)):
        text = f"ldaw r1, sp[1]; ldc r2, {count + 2}; loop: getr r0, {kind}; stw r0, r1[0]; ldaw r1, r1[1]; "
        made = execute(text + "sub r2, r2, 1; bt r2, loop")
        got = get_words(made, int(made.registers(0)[14]) + 4, count + 2)
        assert got == [n << 8 | kind for n in range(count)] + [0, 0]
    made = execute(
        "getr r0, 1\ngetr r1, 1\ngetr r2, 1\nfreer res[r1]\nfreer res[r0]\ngetr r3, 1\ngetr r4, 1\ngetr r5, 1"
    )
    assert made.registers(0)[:6].tolist() == [1, 0x101, 0x201, 1, 0x101, 0x301]


def test_threads_are_allocated_once() -> None:
    made = execute(
        "getr r1, 3; ldaw r2, sp[1]; ldc r3, 9; loop: getst r0, res[r1]; stw r0, r2[0]; ldaw r2, r2[1]; sub r3, r3, 1; "
        "bt r3, loop"
    )
    assert get_words(made, int(made.registers(0)[14]) + 4, 9) == [*(n << 8 | 4 for n in range(1, 8)), 0, 0]


def test_unsynchronised_thread() -> None:
    """GETR of a thread, START, and FREET at its end; its registers are set before."""
    text = """
        getr r0, 4
        ldap r11, child
        init t[r0]:pc, r11
        ldc r1, 5
        init t[r0]:sp, r1
        ldc r1, 6
        init t[r0]:dp, r1
        ldc r1, 7
        init t[r0]:cp, r1
        ldc r1, 8
        init t[r0]:lr, r1
        set t[r0]:r3, r1
        start t[r0]
        ldc r5, 40
    wait:
        sub r5, r5, 1
        bt r5, wait
        getr r2, 4
        bu end
    child:
        stw r3, r4[0]
        freet
    end:
    """
    made = core(text + "clre\nwaiteu")
    made.registers(1)[4] = 0x18000
    made.run(2000)
    assert made.registers(1)[12:16].tolist() == [7, 6, 5, 8]
    assert get_words(made, 0x18000, 1) == [8]
    assert made.registers(0)[2] == made.registers(0)[0] == 0x104
    assert made.threads()[1].state == "stopped"


def test_starting_twice() -> None:
    start = "getr r0, 4\nldap r11, child\ninit t[r0]:pc, r11\nstart t[r0]\n"
    child = "\nclre\nwaiteu\nchild: waiteu"
    for text in ("start t[r0]", "init t[r0]:pc, r11", "freer res[r0]"):
        assert trapped(start + text + child) == ("illegal resource", 0x104)
    assert trapped("getr r1, 3\ngetst r0, res[r1]\nstart t[r0]") == ("illegal resource", 0x104)
    assert trapped("ldc r0, 0x204\nset t[r0]:r1, r1") == ("illegal resource", 0x204)


@pytest.mark.parametrize("lockstep", [False, True])
def test_synchronisers(lockstep: bool) -> None:
    """MSYNC and SSYNC: all have come before any goes on; TSETMR writes the master's registers; MJOIN ends them."""
    text = """
        getr r0, 3
        getst r1, res[r0]
        ldap r11, child
        init t[r1]:pc, r11
        set t[r1]:r5, r5
        getst r1, res[r0]
        init t[r1]:pc, r11
        set t[r1]:r5, r5
        msync res[r0]
        ldc r3, 60
    work:
        sub r3, r3, 1
        bt r3, work
        ldc r3, 1
        stw r3, r5[0]
        msync res[r0]
        msync res[r0]
        ldw r3, r5[1]
        ldw r4, r5[2]
        mjoin res[r0]
        ldc r9, 3
        bu end
    child:
        ldc r6, 30
    late:
        sub r6, r6, 1
        bt r6, late
        ssync
        ldw r2, r5[0]
        get r11, id
        stw r2, r5[r11]
        ssync
        tsetmr r8, r11
        ssync
        ldc r9, 1
    end:
    """
    made = core(text + "clre\nwaiteu", 0, 0, 0, 0, 0, 0x18000, lockstep=lockstep)
    assert made.run(20_000) is Stop.REACHED, made.trap
    regs = made.registers(0)
    assert regs[[3, 4, 9]].tolist() == [1, 1, 3]
    assert regs[8] in (1, 2)
    assert [view.state for view in made.threads()[1:3]] == ["free", "free"]


def test_setc_of_what_is_not_modelled() -> None:
    """Ready signals and ports as clocks are refused, rather than ignored."""
    for value in (0x300F, 0x3017, 0x500F, 0x5017, 0x100F):
        assert trapped(f"{plain(PORT_1F)}{constant('r0', value)}setc res[r4], r0") == ("illegal resource", PORT_1F)
    for value in (0x1007, 0x3007, 0x5007, 0x4007, 0x6007, 0x7027, 3, 0xB, 0x13):
        execute(f"{plain(PORT_1F)}{constant('r0', value)}setc res[r4], r0")


@pytest.mark.parametrize(("text", "data"), [
    (f"{plain(PORT_32A)}setc res[r4], 9", PORT_32A),
    (f"{plain(PORT_32A)}setc res[r4], 0\nout res[r4], r0", PORT_32A),
    (f"{plain(PORT_8C)}ldc r0, 4\nsettw res[r4], r0", PORT_8C),
    (f"{plain(PORT_8C)}outpw res[r4], r0, 8", PORT_8C),
    (f"{plain(PORT_8C)}endin r0, res[r4]", PORT_8C),
    (f"{plain(PORT_8C)}{constant('r0', 0x600F)}setc res[r4], r0", PORT_8C),
    (f"{plain(PORT_32A)}ldc r0, 0x106\nsetclk res[r4], r4", PORT_32A),
    ("ldc r0, 0x106\nsetc res[r0], 8\nldc r1, 0x101\nsetclk res[r0], r1", 0x106),
    ("getr r0, 1\nout res[r0], r1", 0x001),
    ("getr r0, 3\nin r1, res[r0]", 0x003),
    ("getr r0, 5\neeu res[r0]", 0x005),
    ("getr r0, 5\nsetd res[r0], r1", 0x005),
    ("getr r0, 5\nint r1, res[r0]", 0x005),
])  # fmt: skip
def test_wrong_resources(text: str, data: int) -> None:
    assert trapped(text) == ("illegal resource", data)


def test_names_of_resources() -> None:
    made = core(two_threads("getr r6, 5\nin r7, res[r6]\nin r7, res[r6]", "in r0, res[r1]"))
    made.run(5000)
    assert [(view.state, view.waits_for, view.resource) for view in made.threads()[:3]] == [
        ("paused", "a lock", "lock 0"), ("paused", "a word", "channel end 1"), ("free", "", ""),
    ]  # fmt: skip


@pytest.mark.parametrize("kind", [2, 3, 5, 6])
def test_a_condition_is_for_ports_and_timers_alone(kind: int) -> None:
    """A channel end, a synchroniser, a lock or a clock block has none: refused, and nothing is written."""
    program = assemble([AssemblySource("cond.s", f"getr r0, {kind}\nldc r1, 0x7ff9\nsetc res[r0], r1\nwaiteu\n")])
    core = Core(program.image)
    assert core.run(1000) is Stop.TRAPPED
    assert core.trap is not None
    assert core.trap.type == 4
