"""Which thread issues when; and that bursts do what lockstep does."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.firmware.xs1.core import Stop
from phasewire.firmware.xs1.encoding import decode
from phasewire.firmware.xs1.instructions import INSTRUCTIONS, Effect

from tests.firmware.xs1.cores import CLOCK_1, CLOCK_2, PORT_8C, PORT_32A, clocked, constant, core, image

CHILD = """
    getst r0, res[{sync}]
    ldap r11, {label}
    init t[r0]:pc, r11
    {stack}
    init t[r0]:sp, r1
"""


def threads(count: int, body: str, main: str = "") -> str:
    """A program whose threads, with the first, all execute a body, synchronised."""
    starts = "".join(CHILD.format(sync="r2", label="body", stack=f"ldaw r1, sp[{-0}]") for _ in range(count - 1))
    return f"getr r2, 3\n{starts}\nmsync res[r2]\n{main}\nbody:\n{body}"


@pytest.mark.parametrize("lockstep", [False, True])
@pytest.mark.parametrize("count", range(1, 9))
def test_share_of_each_thread(count: int, lockstep: bool) -> None:
    """Of n threads that only compute, each issues once in max(4, n) cycles."""
    made = core(threads(count, "ldc r0, 0\nloop: add r0, r0, 1\nbu loop"), lockstep=lockstep)
    made.run(1999)
    before = [int(made.registers(t)[0]) for t in range(count)]
    cycles = 2 * max(4, count) * 500
    made.run(1999 + cycles)
    for t in range(count):
        assert abs(int(made.registers(t)[0]) - before[t] - 500) <= (0 if count <= 4 else 1), t


def test_paused_threads_take_no_slots() -> None:
    """Of eight threads five wait for ever; the others issue every 4 cycles."""
    body = (
        "get r11, id\nldc r0, 3\nlsu r0, r11, r0\nbt r0, work\nwaiteu\nwork:\nldc r0, 0\nloop: add r0, r0, 1\nbu loop"
    )
    made = core(threads(8, body))
    made.run(999)
    before = [int(made.registers(t)[0]) for t in range(3)]
    made.run(1799)
    assert [int(made.registers(t)[0]) - b for t, b in enumerate(before)] == [100, 100, 100]


@pytest.mark.parametrize("cycles", [5, 8, 13])
def test_issue_cycles(cycles: int) -> None:
    made = core(threads(3, "ldc r0, 0\nloop: add r0, r0, 1\nbu loop"), issue_cycles=cycles)
    made.run(1999)
    before = [int(made.registers(t)[0]) for t in range(3)]
    made.run(1999 + 200 * cycles)
    assert [int(made.registers(t)[0]) - b for t, b in enumerate(before)] == [100, 100, 100]
    made.set_issue_cycles(4)
    before = [int(made.registers(t)[0]) for t in range(3)]
    made.run(1999 + 200 * cycles + 8000)
    assert [abs(int(made.registers(t)[0]) - b - 1000) <= 2 for t, b in enumerate(before)] == [True, True, True]


@pytest.mark.parametrize("count", [1, 2, 4, 5])
def test_no_cycle_issues_twice(count: int) -> None:
    """Every thread counts in memory of its own; their sum is that of the cycles that issued."""
    made = core(threads(count, "ldc r0, 0\nloop: add r0, r0, 1\nbu loop"), lockstep=True)
    made.run(1000)
    seen = made.instructions
    for cycle in range(1001, 1061):
        made.run(cycle)
        assert 0 <= made.instructions - seen <= 1
        seen = made.instructions
    assert seen - made.instructions == 0


def test_divisions_take_32_times_as_long() -> None:
    text = """
        getr r1, 1
        ldc r2, 7
        in r3, res[r1]
        {}
        in r4, res[r1]
        sub r0, r4, r3
        clre
        waiteu
    """
    plain, divides = core(text.format("add r0, r2, r2")), core(text.format("divu r0, r2, r2"))
    for made in (plain, divides):
        assert made.run(1000) is Stop.REACHED
    assert plain.registers(0)[0] == 2
    assert divides.registers(0)[0] == 33


# Random programs. All threads follow one script in its order, so that they cannot wait for each other in a circle.


ARITHMETIC = (
    "add", "sub", "shl", "shr", "eq", "and", "or", "lss", "lsu", "xor", "ashr", "mul", "crc32", "addi", "subi", "shli",
    "ashri", "zexti", "sexti", "not", "neg", "mkmsk", "clz", "bitrev", "ldc", "ldawi", "ladd", "lmul", "maccu", "stack",
    "load",
)  # fmt: skip


def arithmetic(rng: random.Random) -> str:
    """An instruction on r0 to r6 that has no exception."""
    a, b, c = (f"r{rng.randrange(7)}" for _ in range(3))
    small, bits = rng.randrange(12), rng.choice([1, 2, 3, 4, 5, 6, 7, 8, 16, 24, 32])
    name = rng.choice(ARITHMETIC)
    if name in ("addi", "subi"):
        return f"{name[:-1]} {a}, {b}, {small}"
    if name in ("shli", "ashri"):
        return f"{name[:-1]} {a}, {b}, {bits}"
    if name in ("zexti", "sexti"):
        return f"{name[:-1]} {a}, {bits}"
    if name in ("not", "neg", "mkmsk", "clz", "bitrev"):
        return f"{name} {a}, {b}"
    if name == "ldc":
        return f"ldc {a}, {rng.randrange(65536)}"
    if name == "ldawi":
        return f"ldaw {a}, {b}[{small}]"
    if name in ("ladd", "lmul", "maccu"):
        operands = rng.sample([f"r{n}" for n in range(7)], 6)
        return f"{name} {', '.join(operands[: {'ladd': 5, 'lmul': 6, 'maccu': 4}[name]])}"
    if name == "stack":
        return f"stw {a}, sp[{rng.randrange(1, 60)}]"
    if name == "load":
        return f"ldw {a}, sp[{rng.randrange(1, 60)}]"
    return f"{name} {a}, {b}, {c}"


LOCK, ANSWER = 0x005, 0x00FF0702
LATER = "setd res[r7], r8; setc res[r7], 9"
KINDS = ("loop", "lock", "word", "tokens", "timer", "event", "port", "timed", "send", "sync", "divide")


class Script:
    """A random program of some threads, which use a lock, channels, timers, ports and a link."""

    def __init__(self, seed: int, count: int, steps: int) -> None:
        self.rng = random.Random(seed)
        self.count = count
        self.bodies: list[list[str]] = [[] for _ in range(count)]
        self.labels = 0
        for _ in range(steps):
            self.step()
            for body in self.bodies:
                body += [arithmetic(self.rng) for _ in range(self.rng.choice([0, 1, 3, 10, 40]))]

    def label(self) -> str:
        self.labels += 1
        return f"label{self.labels}"

    def step(self) -> None:
        rng = self.rng
        thread = rng.randrange(self.count)
        body = self.bodies[thread]
        kind = rng.choice(KINDS)
        register = f"r{rng.randrange(7)}"
        if kind == "loop":
            label = self.label()
            inner = "; ".join(arithmetic(rng) for _ in range(rng.randrange(1, 8)))
            body.append(f"ldc r7, {rng.randrange(1, 40)}; {label}:; {inner}; sub r7, r7, 1; bt r7, {label}")
        elif kind == "lock":
            for other in self.bodies:
                other.append(f"ldc r7, {LOCK}; in r8, res[r7]; ldw r8, dp[0]; add r8, r8, r0; stw r8, dp[0]")
                other += [arithmetic(rng) for _ in range(3)]
                other.append("out res[r7], r8")
        elif kind in ("word", "tokens") and self.count > 1:
            self.packet(thread, kind, register)
        elif kind == "timer":
            body.append(self.later(thread) + f"in {register}, res[r7]")
        elif kind == "event":
            label = self.label()
            body.append(self.later(thread) + f"ldap r11, {label}; setv res[r7], r11; eeu res[r7]; waiteu")
            body.append(f"{label}:; edu res[r7]; get r11, ed; xor {register}, r11, r8")
        elif kind == "port" and thread < 2:
            body.append(f"ldw r7, dp[{1 + thread}]")
            for _ in range(rng.randrange(1, 8)):
                body += [f"out res[r7], {register}", *[arithmetic(rng) for _ in range(rng.choice([0, 2, 12]))]]
            body.append(f"syncr res[r7]; getts {register}, res[r7]")
        elif kind == "timed" and thread < 2:
            body.append(f"ldw r7, dp[{1 + thread}]; out res[r7], r0; syncr res[r7]; getts r8, res[r7]")
            body.append(f"ldc r9, {rng.randrange(2, 30)}; add r8, r8, r9; setpt res[r7], r8")
            body.append(f"out res[r7], {register}; out res[r7], r1")
        elif kind == "send":
            body += [constant("r8", ANSWER + (thread << 8)), f"ldc r7, {16 + thread << 8 | 2}; setd res[r7], r8"]
            body += rng.choices([f"out res[r7], {register}", f"outt res[r7], {register}", "outct res[r7], 5"], k=4)
            body.append(f"outct res[r7], {rng.choice([1, 2])}")
        elif kind == "sync":
            for number, other in enumerate(self.bodies):
                other.append("msync res[r10]" if number == 0 else "ssync")
        elif kind == "divide":
            body.append(f"ldc r9, {rng.randrange(1, 1000)}; divu {register}, {register}, r9")

    def later(self, thread: int) -> str:
        """Set a timer of the thread to a time in the near future."""
        again = "setc res[r7], 1; in r8, res[r7]"
        return f"ldc r7, {thread << 8 | 1}; {again}; ldc r9, {self.rng.randrange(60)}; add r8, r8, r9; {LATER}; "

    def packet(self, thread: int, kind: str, register: str) -> None:
        """Send words or tokens from one thread to another."""
        rng, body = self.rng, self.bodies[thread]
        to = rng.choice([number for number in range(self.count) if number != thread])
        there, here = to * self.count + thread, thread * self.count + to  # channel ends
        body.append(f"ldc r7, {here << 8 | 2}; ldc r9, {there << 8 | 2}; setd res[r7], r9")
        self.bodies[to].append(f"ldc r7, {there << 8 | 2}")
        for _ in range(rng.randrange(1, 6)):
            read = f"r{rng.randrange(7)}"
            if kind == "word":
                body.append(f"out res[r7], {register}")
                self.bodies[to].append(f"in {read}, res[r7]")
            else:
                body.append(f"outt res[r7], {register}")
                self.bodies[to].append(f"testct r8, res[r7]; int {read}, res[r7]")
            body += [arithmetic(rng) for _ in range(rng.choice([0, 5]))]
        body.append("outct res[r7], 1")
        self.bodies[to].append("testwct r8, res[r7]; chkct res[r7], 1")

    def text(self) -> str:
        resources = 20 * ["getr r0, 2"] + 4 * ["getr r0, 1"] + ["getr r0, 5", "getr r10, 3"]
        data = [constant("r1", 0x1E000), "set dp, r1"]
        ports = [
            clocked(PORT_32A, 25, CLOCK_1, port_in="r6"), "stw r6, dp[1]", clocked(PORT_8C, 7, CLOCK_2, port_in="r6"),
            "stw r6, dp[2]",
        ]  # fmt: skip
        starts = []
        for thread in range(1, self.count):
            starts += ["getst r0, res[r10]", f"ldap r11, thread{thread}", "init t[r0]:pc, r11",
                       constant("r1", 0x18000 + 0x400 * thread), "init t[r0]:sp, r1", constant("r1", 0x1E000),
                       "init t[r0]:dp, r1", f"ldc r1, {thread}", "set t[r0]:r0, r1"]  # fmt: skip
        starts.append("msync res[r10]")
        lines = [*resources, *data, *ports, *starts]
        for thread, body in enumerate(self.bodies):
            lines += [f"thread{thread}:", *body, "clre", "waiteu"]
        return "\n".join(lines)


def outcome(text: str, steps: list[int], **options: Any) -> tuple[Any, ...]:
    """Everything that can be seen of a program, which is run up to some cycles in turn."""
    made = core(text, **options)
    made.watch(PORT_32A)
    made.watch(PORT_8C)
    log: list[tuple[int, int, int]] = []
    sent = []
    for until in steps:
        while (stop := made.run(until)) is not Stop.REACHED:
            assert stop is Stop.MESSAGE, made.trap
            assert made.cycle <= until
            sent += [(m.channel_end, m.destination, m.tokens.tolist(), m.begins, m.ends) for m in made.take_messages()]
    for port in (PORT_32A, PORT_8C):
        log += [(port, int(cycle), int(word)) for cycle, word in zip(*made.port_log(port), strict=True)]
    waiting = [(view.state, view.pc, view.waits_for, view.resource) for view in made.threads()]
    registers = [made.registers(thread).tolist() for thread in range(8)]
    return log, sent, waiting, registers, made.memory.tobytes(), made.instructions


@given(st.integers(0, 2**32), st.integers(1, 4), st.sampled_from(["off", "pessimistic"]))
@settings(max_examples=40, deadline=None)
def test_bursts_are_lockstep(seed: int, count: int, fetch: str) -> None:
    text = Script(seed, count, 12).text()
    end = 60_000
    wanted = outcome(text, [end], lockstep=True, fetch=fetch)
    assert outcome(text, [end], fetch=fetch) == wanted
    rng = random.Random(seed)
    steps = sorted(rng.randrange(end) for _ in range(50))
    assert outcome(text, [*steps, end], fetch=fetch, run_ahead=rng.choice([0, 7, 100, 100_000])) == wanted


@pytest.mark.parametrize("lockstep", [False, True])
@pytest.mark.parametrize("later", range(-4, 5))
def test_first_come_first_served(later: int, lockstep: bool) -> None:
    """Of two threads that come to a lock a few cycles apart, the first gets it, whichever is executed first."""
    text = f"""
        getr r4, 5; getr r2, 3; getst r0, res[r2]; ldap r11, other; init t[r0]:pc, r11; set t[r0]:r4, r4
        set t[r0]:r5, r5
        msync res[r2]
        {"add r1, r1, 1; " * (20 + later)}
        in r6, res[r4]
        ldw r7, r5[0]; add r7, r7, 1; stw r7, r5[0]
        out res[r4], r6
        clre; waiteu
    other:
        {"add r1, r1, 1; " * 20}
        in r6, res[r4]
        ldw r7, r5[0]; add r7, r7, r7; stw r7, r5[0]
        out res[r4], r6
        clre; waiteu
    """
    made = core(text, 0, 0, 0, 0, 0, 0x18000, lockstep=lockstep)
    made.memory[0x8000] = 5
    made.run(1000)
    other_first = made.memory[0x8000] == 11
    assert made.memory[0x8000] in (11, 12)
    if later:
        assert other_first == (later > 0)


def test_scripts_come_to_their_ends() -> None:
    """The random programs do not stop early: every thread waits in its last instruction, and all kinds occur."""
    texts = []
    for seed in range(30):
        text = Script(seed, 4, 12).text()
        texts.append(text)
        made = core(text)
        while made.run(200_000) is not Stop.REACHED:
            pass
        assert [view.waits_for for view in made.threads()[:4]] == 4 * ["an event"], seed
        assert 0x10000 + len(image(text)) - made.threads()[3].pc in (2, 4)
    words = " ".join(texts)
    for name in ("testct", "syncr", "setpt", "divu", "waiteu", "ssync", "outct res[r7], 2", "in r8, res[r7]"):
        assert name in words


def test_a_fifth_thread_puts_bursts_into_lockstep() -> None:
    text = (
        threads(6, "get r11, id\nldc r0, 100\nloop: add r2, r2, r11\nsub r0, r0, 1\nbt r0, loop\nssync", "") + "\nclre"
    )
    ends = []
    for lockstep in (False, True):
        made = core(text, lockstep=lockstep)
        made.run(3000)
        ends.append((made.instructions, [made.registers(t).tolist() for t in range(6)]))
    assert ends[0] == ends[1]


# Fetch no-ops


def stalls(text: str) -> int:
    """No-ops of a straight program, by the rule that `Core` states, from the bytes of its instructions."""
    bits = np.trim_zeros(np.frombuffer(image(text), "<u2"), "b")  # what fills the last word
    place, fetched, count = 0, 4, 0
    while place < 2 * len(bits):
        decoded = decode(int(bits[place // 2]), int(bits[place // 2 + 1]) if place // 2 + 1 < len(bits) else 0)
        assert decoded is not None
        end = place + decoded.size
        while fetched < end:
            fetched += 4
            count += 1
        memory = INSTRUCTIONS[decoded.code].effect in (Effect.LOAD, Effect.STORE)
        if not memory and fetched - end <= 4:
            fetched += 4
        place = end
    return count


STRAIGHT = (
    "add r0, r0, 1", "ldc r1, 1000", "mul r0, r0, r1", "ldw r2, sp[1]", "stw r2, sp[100]", "xor r1, r1, r2",
    "stw r1, r3[r4]",
)  # fmt: skip


@given(st.lists(st.sampled_from(STRAIGHT), max_size=30))
@settings(max_examples=60, deadline=None)
def test_fetch_stalls(lines: list[str]) -> None:
    text = "\n".join([*lines, "getr r0, 1", "in r1, res[r0]", "waiteu"])
    made = core(text, 0, 0, 0, 0x18000, 0, fetch="pessimistic")
    plain = core(text, 0, 0, 0, 0x18000, 0)
    for one in (made, plain):
        assert one.run(2000) is Stop.REACHED
    extra = int(made.registers(0)[1]) - int(plain.registers(0)[1])
    until_in = "\n".join([*lines, "getr r0, 1", "in r1, res[r0]"])
    assert extra == stalls(until_in)


def test_branches_empty_the_buffer() -> None:
    """A long instruction at a target that lies in the middle of a word stalls each time."""
    text = """
        ldc r0, 10
        {}
    loop:
        {}
        sub r0, r0, 1
        bt r0, loop
        getr r2, 1
        in r1, res[r2]
        waiteu
    """
    times = []
    for nop, first in (("", "ldc r3, 1000"), ("add r3, r3, 1", "ldc r3, 1000"), ("", "ldc r3, 1")):
        made = core(text.format(nop, first), fetch="pessimistic")
        made.run(2000)
        times.append(int(made.registers(0)[1]))
    assert times[0] - times[2] >= 9  # unaligned: the second half is not there yet
    assert times[1] - times[2] <= 2  # aligned
