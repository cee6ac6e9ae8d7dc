"""Values of instructions, against formulas of their own; memory, branches, exceptions, code that changes."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.firmware.xs1.core import Core, Stop
from phasewire.firmware.xs1.instructions import INSTRUCTIONS
from phasewire.firmware.xs1.names import EXCEPTIONS

from tests.firmware.xs1.cores import STACK, WORD, core, execute, get_words, image, set_words

TABLE, ROWS = 0x12000, 1000
EDGES = (
    0, 1, 2, 3, 7, 8, 15, 16, 30, 31, 32, 33, 63, 64, 255, 256, 0xFFFF, 0x10000, 0x7FFFFFFE, 0x7FFFFFFF, 0x80000000,
    0x80000001, 0xFFFFFFFE, 0xFFFFFFFF, 0x55555555, 0xAAAAAAAA, 0xEDB88320, 0x12345678,
)  # fmt: skip


def signed(value: int) -> int:
    return value - (value >> 31 << 32)


def quotient(a: int, b: int) -> int:
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


def extended(value: int, bits: int, signs: bool) -> int:
    if not 0 < bits < 32:
        return value
    size = 1 << bits
    low = value % size
    return low - size if signs and low >= size // 2 else low


def crc(checksum: int, data: int, bits: int, polynomial: int) -> int:
    for bit in range(bits):
        out = checksum % 2
        checksum = checksum // 2 + (data >> bit) % 2 * 2**31
        if out:
            checksum ^= polynomial
    return checksum


# For each instruction: its text, and (r6, r7) after it from r1 to r7
TWO: dict[str, Callable[[int, int], int]] = {
    "add r6, r1, r2": lambda a, b: a + b,
    "add r6, r1, 11": lambda a, b: a + 11,
    "sub r6, r1, r2": lambda a, b: a - b,
    "sub r6, r1, 7": lambda a, b: a - 7,
    "mul r6, r1, r2": lambda a, b: a * b,
    "and r6, r1, r2": lambda a, b: a & b,
    "or r6, r1, r2": lambda a, b: a | b,
    "xor r6, r1, r2": lambda a, b: a ^ b,
    "not r6, r1": lambda a, b: ~a,
    "neg r6, r1": lambda a, b: -a,
    "mov r6, r1": lambda a, b: a,
    "eq r6, r1, r2": lambda a, b: a == b,
    "eq r6, r1, 3": lambda a, b: a == 3,
    "lss r6, r1, r2": lambda a, b: signed(a) < signed(b),
    "lsu r6, r1, r2": lambda a, b: a < b,
    "shl r6, r1, r2": lambda a, b: a << b if b < 32 else 0,
    "shr r6, r1, r2": lambda a, b: a >> b if b < 32 else 0,
    "ashr r6, r1, r2": lambda a, b: signed(a) >> min(b, 31),
    "shl r6, r1, 1": lambda a, b: a * 2,
    "shl r6, r1, 24": lambda a, b: a << 24,
    "shl r6, r1, 32": lambda a, b: 0,
    "shr r6, r1, 8": lambda a, b: a >> 8,
    "shr r6, r1, 32": lambda a, b: 0,
    "ashr r6, r1, 16": lambda a, b: signed(a) >> 16,
    "ashr r6, r1, 32": lambda a, b: signed(a) >> 31,
    "mkmsk r6, r1": lambda a, b: 2 ** min(a, 32) - 1,
    "mkmsk r6, 16": lambda a, b: 0xFFFF,
    "mkmsk r6, 32": lambda a, b: WORD,
    "ldaw r6, r1[r2]": lambda a, b: a + 4 * b,
    "ldaw r6, r1[-r2]": lambda a, b: a - 4 * b,
    "ldaw r6, r1[9]": lambda a, b: a + 36,
    "ldaw r6, r1[-11]": lambda a, b: a - 44,
    "lda16 r6, r1[r2]": lambda a, b: a + 2 * b,
    "lda16 r6, r1[-r2]": lambda a, b: a - 2 * b,
    "clz r6, r1": lambda a, b: 32 - a.bit_length(),
    "bitrev r6, r1": lambda a, b: int(f"{a:032b}"[::-1], 2),
    "byterev r6, r1": lambda a, b: int.from_bytes(a.to_bytes(4, "little"), "big"),
    "ldc r6, 63": lambda a, b: 63,
    "ldc r6, 65535": lambda a, b: 65535,
}
CHANGING: dict[str, Callable[[int, int, int], int]] = {
    "andnot r6, r1": lambda r6, a, b: r6 & (WORD - a),
    "sext r6, r1": lambda r6, a, b: extended(r6, a, True),
    "zext r6, r1": lambda r6, a, b: extended(r6, a, False),
    "sext r6, 8": lambda r6, a, b: extended(r6, 8, True),
    "sext r6, 1": lambda r6, a, b: extended(r6, 1, True),
    "sext r6, 32": lambda r6, a, b: r6,
    "zext r6, 16": lambda r6, a, b: r6 % 65536,
    "zext r6, 32": lambda r6, a, b: r6,
    "crc32 r6, r1, r2": lambda r6, a, b: crc(r6, a, 32, b),
}
DIVIDING: dict[str, Callable[[int, int], int]] = {
    "divu r6, r1, r2": lambda a, b: a // b,
    "remu r6, r1, r2": lambda a, b: a % b,
    "divs r6, r1, r2": lambda a, b: quotient(signed(a), signed(b)),
    "rems r6, r1, r2": lambda a, b: signed(a) - quotient(signed(a), signed(b)) * signed(b),
}
LONG: dict[str, Callable[..., tuple[int, int]]] = {
    "ladd r7, r6, r1, r2, r3": lambda r1, r2, r3, r4, r5, r6, r7: (r1 + r2 + r3 % 2, (r1 + r2 + r3 % 2) >> 32),
    "lsub r7, r6, r1, r2, r3": lambda r1, r2, r3, r4, r5, r6, r7: (r1 - r2 - r3 % 2, r1 - r2 - r3 % 2 < 0),
    "lmul r7, r6, r1, r2, r3, r4": lambda r1, r2, r3, r4, r5, r6, r7: (x := r1 * r2 + r3 + r4, x >> 32),
    "maccu r7, r6, r1, r2": lambda r1, r2, r3, r4, r5, r6, r7: (x := r1 * r2 + (r7 << 32) + r6, x >> 32),
    "maccs r7, r6, r1, r2": lambda r1, r2, r3, r4, r5, r6, r7: (
        x := signed(r1) * signed(r2) + (r7 << 32) + r6, x >> 32,
    ),
    "crc8 r6, r7, r1, r2": lambda r1, r2, r3, r4, r5, r6, r7: (crc(r6, r1 % 256, 8, r2), r1 >> 8),
}  # fmt: skip

LOOP = f"""
    ldc r10, {TABLE >> 8}
    shl r10, r10, 8
    ldc r9, {ROWS}
loop:
    ldw r1, r10[0]
    ldw r2, r10[1]
    ldw r3, r10[2]
    ldw r4, r10[3]
    ldw r5, r10[4]
    ldw r6, r10[5]
    ldw r7, r10[6]
    %s
    stw r6, r10[5]
    stw r7, r10[6]
    ldaw r10, r10[7]
    sub r9, r9, 1
    bt r9, loop
"""


def rows_of_operands(seed: int) -> np.ndarray:
    """Edge values, each with each in r1 and r2, and random values of all lengths."""
    rng = np.random.default_rng(seed)
    rows = rng.integers(0, 2**32, (ROWS, 7)) >> rng.integers(0, 33, (ROWS, 7))
    pairs = np.array([(a, b) for a in EDGES for b in EDGES])
    rows[: len(pairs), :2] = pairs
    rows[: len(pairs), 2:] = rng.choice(EDGES, (len(pairs), 5))
    return rows


def results(text: str, rows: np.ndarray, **options: bool) -> np.ndarray:
    made = core(LOOP % text + "\nclre\nwaiteu\n", **options)
    set_words(made, TABLE, rows.ravel())
    assert made.run(20_000_000) is Stop.REACHED
    return np.array(get_words(made, TABLE, rows.size)).reshape(rows.shape)[:, 5:]


@pytest.mark.parametrize("text", [*TWO, *CHANGING, *LONG])
def test_values(text: str) -> None:
    rows = rows_of_operands(len(text))
    got = results(text, rows)
    for row, (r6, r7) in zip(rows.tolist(), got.tolist(), strict=True):
        if text in TWO:
            wanted = TWO[text](row[0], row[1]), row[6]
        elif text in CHANGING:
            wanted = CHANGING[text](row[5], row[0], row[1]), row[6]
        else:
            wanted = LONG[text](*row)
        assert (r6, r7) == tuple(int(value) & WORD for value in wanted), (text, row)


@pytest.mark.parametrize("text", DIVIDING)
def test_divisions(text: str) -> None:
    rows = rows_of_operands(5)
    rows[rows[:, 1] == 0, 1] = 3
    rows[(rows[:, 0] == 0x80000000) & (rows[:, 1] == WORD), 1] = 3
    for row, (r6, _) in zip(rows.tolist(), results(text, rows).tolist(), strict=True):
        assert r6 == DIVIDING[text](row[0], row[1]) & WORD, (text, row)


def test_long_division() -> None:
    rows = rows_of_operands(6)
    rows[rows[:, 1] == 0, 1] = WORD
    rows[:, 2] %= rows[:, 1]  # the high word must be less than the divisor
    for row, (r6, r7) in zip(rows.tolist(), results("ldivu r6, r7, r3, r1, r2", rows).tolist(), strict=True):
        assert (r6, r7) == divmod(row[2] << 32 | row[0], row[1])


@given(
    st.sampled_from(["add", "sub", "mul", "xor", "shl", "ashr", "lss", "ldaw {0}, {1}[{2}]", "remu"]),
    st.lists(st.integers(0, 11), min_size=3, max_size=3),
    st.lists(st.sampled_from(EDGES) | st.integers(0, WORD), min_size=12, max_size=12),
)
@settings(max_examples=60, deadline=None)
def test_any_registers(name: str, places: list[int], values: list[int]) -> None:
    """Operands may be any of the 12 registers, and the same one."""
    a, b, c = places
    values[c] = values[c] or 1
    text = name.format(*(f"r{place}" for place in places)) if " " in name else f"{name} r{a}, r{b}, r{c}"
    pattern = text.replace(f"r{a},", "r6,", 1).split(",")[0]
    formula = (TWO | DIVIDING)["ldaw r6, r1[r2]" if " " in name else f"{name} r6, r1, r2"]
    assert pattern.endswith("r6")
    wanted = list(values)
    wanted[a] = formula(values[b], values[c]) & WORD
    assert execute(text, *values).registers(0)[:12].tolist() == wanted


def test_crc32_is_zlibs() -> None:
    """The trial's way: the first word inverted as the seed, further words, one of zeros, and the result inverted."""
    words = np.random.default_rng(7).integers(0, 2**32, 128)
    text = f"""
        ldc r1, {TABLE >> 8}
        shl r1, r1, 8
        ldc r2, 127
        ldw r0, r1[0]
        not r0, r0
    loop:
        ldaw r1, r1[1]
        ldw r4, r1[0]
        crc32 r0, r4, r3
        sub r2, r2, 1
        bt r2, loop
        ldc r4, 0
        crc32 r0, r4, r3
        not r0, r0
    """
    made = core(text + "clre\nwaiteu\n", 0, 0, 0, 0xEDB88320)
    set_words(made, TABLE, words)
    assert made.run(10_000) is Stop.REACHED
    assert made.registers(0)[0] == zlib.crc32(words.astype("<u4").tobytes())


def test_memory() -> None:
    made = execute(
        """
        stw r2, r1[0]
        stw r3, r1[r4]
        st16 r2, r1[r5]
        st8 r3, r1[r6]
        ldw r7, r1[0]
        ldw r8, r1[r4]
        ld16s r9, r1[r5]
        ld8u r10, r1[r6]
        stw r2, sp[2]
        ldw r11, sp[2]
        """,
        0, 0x1A000, 0x8001F0F5, 0x123456C3, 3, 9, 23,
    )  # fmt: skip
    assert made.registers(0)[7:12].tolist() == [0x8001F0F5, 0x123456C3, 0xFFFFF0F5, 0xC3, 0x8001F0F5]
    assert get_words(made, 0x1A000, 6) == [0x8001F0F5, 0, 0, 0x123456C3, 0xF0F5 << 16, 0xC3 << 24]


def test_pointers() -> None:
    """Constants, data and stack: loads, stores, addresses and extensions by words."""
    made = execute(
        """
        set dp, r1
        set cp, r2
        stw r3, dp[5]
        ldw r4, dp[5]
        ldaw r5, dp[1000]
        ldw r6, cp[2]
        ldaw r11, cp[2]
        mov r7, r11
        ldw r11, cp[200]
        extdp 3
        extsp 4
        ldaw r8, sp[1]
        """,
        0, 0x13000, 0x10000, 77,
    )  # fmt: skip
    words = made.memory.view(np.uint32)
    assert made.registers(0)[4:9].tolist() == [77, 0x13000 + 4000, words[2], 0x10008, STACK - 12]
    assert made.registers(0)[11] == words[200]
    assert made.registers(0)[13] == 0x13000 - 12


def test_calls() -> None:
    """BL, BLA and returns; ENTSP keeps the return address on the stack; ENTSP 0 and RETSP 0 leave it in lr."""
    made = execute(
        """
        ldc r0, 0
        bl outer
        ldap r11, leaf
        bla r11
        ldap r11, table
        blat 1
        ldap r11, table
        set cp, r11
        bla cp[0]
        ldap r11, over
        bau r11
        ldc r0, 99
    over:
        ldc r1, 4
        bru r1
        ldc r0, 98
        ldc r0, 97
        bu end
    outer:
        entsp 2
        bl leaf
        bl leaf
        retsp 2
    leaf:
        entsp 0
        add r0, r0, 1
        retsp 0
        .p2align 2
    table:
        .long leaf
        .long outer
    end:
        """
    )
    assert made.registers(0)[0] == 2 + 1 + 2 + 1
    assert made.registers(0)[14] == STACK


def test_conditional_branches() -> None:
    made = execute(
        """
        ldc r0, 0
        ldc r1, 5
    back:
        add r0, r0, 1
        sub r1, r1, 1
        bt r1, back
        bf r1, forth
        ldc r0, 99
    again:
        add r0, r0, 2
        eq r2, r0, 11
        bf r2, again
        bu end
    forth:
        bt r1, again
        bu again
    end:
        """
    )
    assert made.registers(0)[0] == 11


# Each ends in an exception that has no handler: text, registers, type, data, place after the beginning
TRAPS = [
    ("divu r0, r1, r2", [0, 5, 0], "arithmetic", 0, 0),
    ("remu r0, r1, r2", [0, 5, 0], "arithmetic", 0, 0),
    ("divs r0, r1, r2", [0, 5, 0], "arithmetic", 0, 0),
    ("rems r0, r1, r2", [0, 0x80000000, WORD], "arithmetic", 0, 0),
    ("ldivu r0, r1, r2, r3, r4", [0, 0, 5, 1, 5], "arithmetic", 0, 0),
    ("ldw r0, r1[0]", [0, 0x10002], "load or store", 0x10002, 0),
    ("ldw r0, r1[r2]", [0, 0x1FFFC, 1], "load or store", 0x20000, 0),
    ("stw r0, r1[0]", [0, 0xFFFC], "load or store", 0xFFFC, 0),
    ("stw r0, r1[r2]", [0, 0x10001, 3], "load or store", 0x1000D, 0),
    ("ld16s r0, r1[r2]", [0, 0x10001, 0], "load or store", 0x10001, 0),
    ("st16 r0, r1[r2]", [0, 0x20000, 1], "load or store", 0x20002, 0),
    ("ld8u r0, r1[r2]", [0, 0, 5], "load or store", 5, 0),
    ("st8 r0, r1[r2]", [0, WORD, WORD], "load or store", WORD - 1, 0),
    ("bau r0", [0x10001], "illegal pc", 0x10001, 0),
    ("bau r0", [0x20000], "illegal pc", 0x20000, 0),
    ("bla r0", [0], "illegal pc", 0, 0),
    ("bru r0", [0x7FFF], "illegal pc", 0x20000, 0),
    ("retsp 0", [], "illegal pc", 0, 0),
    ("ecallf r0", [0], "ecall", 0, 0),
    ("ecallf r0\necallt r0", [1], "ecall", 0, 2),
    ("kcall r0", [123], "kcall", 123, 0),
    ("kcall 45", [], "kcall", 45, 0),
    ("in r0, res[r1]", [0, 0x001], "illegal resource", 0x001, 0),
    ("in r0, res[r1]", [0, 0x77], "illegal resource", 0x77, 0),
    ("out res[r1], r0", [0, 0x200000], "illegal resource", 0x200000, 0),
    ("setc res[r0], 1", [0x106], "illegal resource", 0x106, 0),
    ("freer res[r0]", [0x102], "illegal resource", 0x102, 0),
    ("set ps[r0], r1", [0x0F0B], "illegal ps", 0x0F0B, 0),
    ("get r1, ps[r0]", [0x0B0C], "illegal ps", 0x0B0C, 0),
    (".short 0x17ff", [], "illegal instruction", 0, 0),
    ("dcall", [], "illegal instruction", 0, 0),
]  # fmt: skip


@pytest.mark.parametrize(("text", "registers", "kind", "data", "place"), TRAPS)
def test_exceptions(text: str, registers: list[int], kind: str, data: int, place: int) -> None:
    made = core(text, *registers)
    assert made.run(1000) is Stop.TRAPPED
    assert made.trap is not None
    assert (EXCEPTIONS[made.trap.type], made.trap.data, made.trap.pc) == (kind, data, 0x10000 + place)
    assert kind in str(made.trap)
    assert made.run(2000) is Stop.REACHED  # the thread stays where it is
    assert made.threads()[0].state == "trapped"


def test_end_of_memory() -> None:
    made = core("bau r0", 0x1FFFE)
    made.memory[-2:] = np.frombuffer(image("add r1, r1, 1")[:2], np.uint8)
    assert made.run(100) is Stop.TRAPPED
    assert made.trap is not None
    assert (made.trap.type, made.trap.data, made.trap.pc) == (2, 0x20000, 0x20000)
    assert made.registers(0)[1] == 1


HANDLED = """
    ldap r11, handler
    set kep, r11
    get r11, kep
    mov r9, r11
    setsr 4
    %s
    bu done
    .p2align 7
handler:
    get r11, ed
    mov r2, r11
    get r11, et
    mov r3, r11
    getsr r11, 31
    mov r4, r11
    ldaw r5, sp[0]
    stw spc, sp[1]
    stw ssr, sp[2]
    stw sed, sp[3]
    stw et, sp[4]
    ldw r6, sp[1]
    add r7, r6, r0
    stw r7, sp[1]
    ldw spc, sp[1]
    kret
    .p2align 6
kernel:
    get r11, ed
    mov r8, r11
    stw spc, sp[1]
    ldw r6, sp[1]
    add r6, r6, 2
    stw r6, sp[1]
    ldw spc, sp[1]
    kret
    .p2align 2
done:
"""


def test_kernel() -> None:
    """A handler gets type, data and place, and returns by KRET; KCALL enters 64 bytes further."""
    text = HANDLED % "nop: ldw r1, r1[0]\n kcall 7\n ldc r10, 5"
    made = execute(text, 2, 0x10001)
    start = 0x1000A
    regs = made.registers(0)
    assert regs[9] % 128 == 0
    assert regs[2:5].tolist() == [0x10001, 5, 4 + 16]
    assert regs[6] == start + 2 + 2  # of the KCALL, which was 2 bytes long
    assert regs[8] == 7
    assert regs[10] == 5
    assert regs[16] & 16 == 0  # the kernel has been left
    assert get_words(made, STACK + 8, 3) == [4, 0, 5]


def test_kernel_stack() -> None:
    """KENTSP switches to the kernel's stack and keeps the stack pointer there; KRESTSP returns."""
    made = execute(
        """
        ldaw r1, sp[0]
        krestsp 0
        extsp 8
        ldaw r2, sp[0]
        kentsp 3
        ldaw r3, sp[0]
        krestsp 3
        ldaw r4, sp[0]
        get r11, ksp
        """
    )
    # The first KRESTSP set the kernel's stack to sp, and sp to the word there, which is 0
    assert made.registers(0)[11] == STACK
    assert made.registers(0)[2:5].tolist() == [WORD + 1 - 32, STACK - 12, WORD + 1 - 32]


def test_processor_state() -> None:
    made = execute("get r0, ps[r1]\nset ps[r2], r3\nget r4, ps[r2]\nget r11, id", 0, 0x00B, 0x210B, 99)
    assert made.registers(0)[[0, 4, 11]].tolist() == [0x10000, 99, 0]


@pytest.mark.parametrize("lockstep", [False, True])
def test_code_that_changes(lockstep: bool) -> None:
    """A store into code takes effect, also if it changes the second half of an instruction that was executed."""
    short, long = image("add r0, r0, 5"), image("ldc r0, 1000")
    other = image("ldc r0, 1001")
    made = execute(
        """
        ldc r6, 2
    again:
        ldc r0, 1
    place:
        add r0, r0, 1
        bf r1, first
        mov r5, r0
        st16 r2, r3[r7]
        bu second
    first:
        mov r4, r0
        st16 r2, r3[r7]
        ldc r1, 1
        bu again
    second:
        .p2align 2
        ldc r8, 0
        bu late
    late:
        """,
        0, 0, int.from_bytes(short[:2], "little"), 0x10004, 0, 0, 0, 0, lockstep=lockstep,
    )  # fmt: skip
    assert made.registers(0)[4:6].tolist() == [2, 6]
    made = execute(
        """
    again:
        ldc r0, 1000
        bt r1, out
        ldc r1, 1
        st16 r2, r3[r4]
        bu again
    out:
        """,
        0, 0, int.from_bytes(other[2:4], "little"), 0x10000, 1, lockstep=lockstep,
    )  # fmt: skip
    assert len(long) == 4
    assert made.registers(0)[0] == 1001
    made = execute(  # the same, with halves in two words
        """
    again:
        add r5, r5, 1
        ldc r0, 1000
        bt r1, out
        ldc r1, 1
        st16 r2, r3[r4]
        bu again
    out:
        """,
        0, 0, int.from_bytes(other[2:4], "little"), 0x10000, 2, lockstep=lockstep,
    )  # fmt: skip
    assert made.registers(0)[0] == 1001


def test_code_that_is_loaded() -> None:
    """Code that is written beyond the program is executed, and written again."""
    code = int.from_bytes(image("add r0, r0, 1\nbau r9")[:4], "little")
    again = int.from_bytes(image("add r0, r0, 8\nbau r9")[:4], "little")
    made = execute(
        """
        ldap r11, back
        mov r9, r11
        stw r1, r3[0]
        bau r3
    back:
        bf r2, end
        stw r2, r3[0]
        ldc r2, 0
        bau r3
    end:
        """,
        0, code, again, 0x1C000,
    )  # fmt: skip
    assert made.registers(0)[0] == 9


def test_code_from_outside() -> None:
    made = core("loop: bf r0, loop\nadd r1, r1, 1\nclre\nwaiteu")
    made.run(100)
    made.memory[0:2] = np.frombuffer(image("add r2, r2, 7")[:2], np.uint8)
    made.forget(0x10000, 2)
    made.run(200)
    assert made.registers(0)[1:3].tolist() == [1, 7]


def test_profile_and_count() -> None:
    made = execute("ldc r0, 10\nloop: sub r0, r0, 1\nbt r0, loop", profile=True)
    assert made.profile[:5].tolist() == [1, 10, 10, 1, 0]  # WAITEU has not ended
    assert made.instructions == 22


def test_every_instruction_is_executed() -> None:
    """No row of the table falls through to an illegal instruction, but those of the debugger."""
    from phasewire.firmware.xs1.encoding import encode, fields

    debugging = {"dcall", "dret", "dentsp", "drestsp", "dgetreg"}
    for code, instruction in enumerate(INSTRUCTIONS):
        operands = [1] * fields(instruction)
        try:
            bits = encode(code, operands, 8 if "P" in instruction.syntax else 2)
        except ValueError:
            bits = encode(code, operands)
        made = Core(bits + image("clre\nwaiteu"))
        made.run(100)
        illegal = made.trap is not None and EXCEPTIONS[made.trap.type] == "illegal instruction"
        assert illegal == (instruction.name in debugging), instruction


def test_arguments() -> None:
    with pytest.raises(ValueError, match="70000 bytes"):
        Core(bytes(70000))
    with pytest.raises(ValueError, match="issue_cycles is 3"):
        Core(b"", issue_cycles=3)
    with pytest.raises(ValueError, match="fetch is"):
        Core(b"", fetch="optimistic")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="13 registers"):
        Core(b"", registers=range(13))
    made = Core(image("waiteu"))
    with pytest.raises(ValueError, match="0x2 is no port"):
        made.watch(2)
    with pytest.raises(ValueError, match="channel end 32"):
        made.deliver(32, [1], [10])
    with pytest.raises(ValueError, match="2 tokens have 1 cycles"):
        made.deliver(3, [1, 2], [10])
    made.run(100)
    with pytest.raises(ValueError, match="must be in order, from 101 on"):
        made.deliver(3, [1, 2], [100, 120])
    with pytest.raises(ValueError, match="must be 101 or later"):
        made.drive(0x10400, 50, 1)
