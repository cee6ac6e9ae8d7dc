"""The runtime library, executed, against Python's integers and bytes."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from phasewire.firmware.xs1.assembler import AssemblySource, assemble, runtime
from phasewire.firmware.xs1.core import Core, Stop
from phasewire.firmware.xs1.program import RAM_BASE

from tests.firmware.xs1.llvm import compiled, needs_clang

DRIVER = """
	ldap r11, _cp
	set cp, r11
	ldap r11, _dp
	set dp, r11
	ldw r0, cp[top]
	set sp, r0
	ldaw r5, dp[cases]
	ldw r4, dp[count]
next:	bf r4, done
	ldw r0, r5[0]
	ldw r1, r5[1]
	ldw r2, r5[2]
	ldw r3, r5[3]
	ldw r11, r5[4]
	bla r11
	stw r0, r5[0]
	stw r1, r5[1]
	ldaw r5, r5[5]
	sub r4, r4, 1
	bu next
done:	ldc r0, 0
	ecallf r0
	.section .cp.rodata
top:	.long 0x1fff0
	.section .dp.data
	.globl buffer
buffer:	.space 512, 0xa5
	.globl cases
"""
"""Calls a function for each case of four operands and an address, and puts the results in their place."""

WORD = (1 << 32) - 1
LONG = (1 << 64) - 1
EDGES = (0, 1, 2, 3, 10, (1 << 31) - 1, 1 << 31, WORD, WORD + 1, WORD + 2, (1 << 63) - 1, 1 << 63, LONG)


def called(calls: Sequence[tuple[str, Sequence[int]]], *others: AssemblySource) -> tuple[list[tuple[int, int]], bytes]:
    """The results of calls, r0 and r1, and the buffer after them; operand 0x5xxx is a place in the buffer."""
    rows = []
    for name, operands in calls:
        words = [f"buffer + {word - 0x5000}" if 0x5000 <= word < 0x5200 else str(word) for word in operands]
        rows.append(f".long {', '.join([*words, '0', '0', '0'][:4])}, {name}")
    text = "\n".join([DRIVER, f"count: .long {len(calls)}", "cases:", *rows])
    program = assemble([AssemblySource("driver.s", text), *others, runtime()])
    core = Core(program.image)
    assert core.run(4000 * (len(calls) + 10)) == Stop.TRAPPED
    place = program.symbols["cases"] - RAM_BASE
    results = core.memory[place : place + 20 * len(calls)].view("<u4").reshape(-1, 5)[:, :2].tolist()
    place = program.symbols["buffer"] - RAM_BASE
    return [(low, high) for low, high in results], core.memory[place : place + 512].tobytes()


def signed(number: int) -> int:
    """64 bits with a sign."""
    return number - (1 << 64) if number >> 63 else number


def quotient(a: int, b: int) -> int:
    """Rounded towards 0, as C does it."""
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


DIVISIONS: dict[str, Callable[[int, int], int]] = {
    "__udivdi3": lambda a, b: a // b,
    "__umoddi3": lambda a, b: a % b,
    "__divdi3": lambda a, b: quotient(signed(a), signed(b)) & LONG,
    "__moddi3": lambda a, b: (signed(a) - signed(b) * quotient(signed(a), signed(b))) & LONG,
}
SHIFTS: dict[str, Callable[[int, int], int]] = {
    "__ashldi3": lambda a, n: a << n & LONG,
    "__lshrdi3": lambda a, n: a >> n,
    "__ashrdi3": lambda a, n: signed(a) >> n & LONG,
}


@pytest.mark.parametrize("name", DIVISIONS)
def test_divisions_of_64_bits(name: str) -> None:
    """Edges with each other, and random numbers of all lengths."""
    random = np.random.default_rng(5)
    pairs = [(a, b) for a in EDGES for b in EDGES if b]
    pairs += [
        (int(random.integers(0, 1 << 63)) * 2 >> a & LONG, max(int(random.integers(0, 1 << 63)) * 2 + 1 >> b, 1))
        for a, b in random.integers(0, 64, (300, 2)).tolist()
    ]
    results, _ = called([(name, (a & WORD, a >> 32, b & WORD, b >> 32)) for a, b in pairs])
    assert [low | high << 32 for low, high in results] == [DIVISIONS[name](a, b) for a, b in pairs]


@pytest.mark.parametrize("name", SHIFTS)
def test_shifts_of_64_bits(name: str) -> None:
    """By 0 to 63."""
    numbers = (0x0123456789ABCDEF, 0xFEDCBA9876543210, LONG, 1 << 63, 1)
    cases = [(number, bits) for number in numbers for bits in range(64)]
    results, _ = called([(name, (a & WORD, a >> 32, bits)) for a, bits in cases])
    assert [low | high << 32 for low, high in results] == [SHIFTS[name](a, bits) for a, bits in cases]


def test_memory() -> None:
    """Random calls after each other, on one buffer, with and without overlap, aligned and not."""
    random = np.random.default_rng(6)
    buffer = bytearray(b"\xa5" * 512)
    calls: list[tuple[str, Sequence[int]]] = []
    expected: list[int] = []
    names = ("memset", "memcpy", "memmove", "memcmp", "__memcpy_4", "__misaligned_load", "__misaligned_store")
    for number in range(600):
        name = names[number % len(names)]
        count = int(random.integers(0, 40)) if name != "__memcpy_4" else 4 * int(random.integers(0, 10))
        to, from_ = (int(place) for place in random.integers(0, 512 - 40, 2))
        if random.integers(0, 2) or name == "__memcpy_4":
            to, from_ = to & ~3, from_ & ~3
        if name in ("memcpy", "__memcpy_4") and abs(to - from_) < count:
            from_ = (to + 64) % 448
        elif name in ("memmove", "memcmp") and random.integers(0, 2):
            from_ = max(0, min(to + int(random.integers(-8, 9)), 470))
        value = int(random.integers(0, 1 << 32))
        here = 0x5000 + to
        if name == "memset":
            calls.append((name, (here, value, count)))
            buffer[to : to + count] = bytes([value & 255]) * count
        elif name == "__misaligned_load":
            calls.append((name, (here,)))
            expected.append(int.from_bytes(buffer[to : to + 4], "little"))
            continue
        elif name == "__misaligned_store":
            calls.append((name, (here, value)))
            buffer[to : to + 4] = value.to_bytes(4, "little")
            expected.append(-1)
            continue
        else:
            calls.append((name, (here, 0x5000 + from_, count)))
            if name == "memcmp":
                a, b = buffer[to : to + count], buffer[from_ : from_ + count]
                expected.append(next((x - y & WORD for x, y in zip(a, b, strict=True) if x != y), 0))
                continue
            buffer[to : to + count] = bytes(buffer[from_ : from_ + count])
        expected.append(-2)
    results, after = called(calls)
    assert after == bytes(buffer)
    for (low, _), (name, operands), value in zip(results, calls, expected, strict=True):
        if value >= 0:
            assert low == value, name
        elif value == -2:
            assert low - results[0][0] == operands[0] - calls[0][1][0], name


C = """
typedef unsigned long long ull; typedef long long ll; struct big { int x[9]; }; static struct big kept[3];
ull mixed(ull a, ull b) { struct big one = kept[1]; one.x[3] += (int)a; kept[a & 1] = one; kept[1].x[8]++;
    ull s = a / (b | 1) + (a % (b | 3)) * (a << (b & 63)) - (ull)((ll)a >> (b & 31)) + (ull)((ll)a / (ll)(b | 5));
    switch (b & 7) { case 0: s ^= 5; break; case 1: s *= 3; break; case 2: s += a; break; case 3: s -= b; break;
        case 4: s = ~s; break; case 5: s = s << 7 | s >> 57; break; case 6: s += kept[0].x[3]; break; }
    return s + kept[1].x[8]; }
"""


def mixed(a: int, b: int, kept: list[list[int]]) -> int:
    """The same in Python."""
    one = list(kept[1])
    one[3] = one[3] + a & WORD
    kept[a & 1] = one
    kept[1] = list(kept[1])
    kept[1][8] += 1
    s = a // (b | 1) + a % (b | 3) * (a << (b & 63)) - (signed(a) >> (b & 31)) + quotient(signed(a), signed(b | 5))
    s &= LONG
    low = kept[0][3] - (kept[0][3] >> 31 << 32)
    s = [s ^ 5, s * 3, s + a, s - b, ~s, s << 7 | s >> 57, s + low, s][b & 7]
    return s + kept[1][8] & LONG


@needs_clang
@pytest.mark.parametrize("option", ["-O0", "-O2", "-Os"])
def test_c_that_uses_it(option: str) -> None:
    """Structures, divisions, shifts and a jump table."""
    random = np.random.default_rng(7)
    rows = random.integers(0, 1 << 63, (200, 2)) >> random.integers(0, 60, (200, 2))
    pairs = [(2 * a + 1 & LONG, 2 * b & LONG) for a, b in rows.tolist()]
    kept = [[0] * 9 for _ in range(3)]
    expected = [mixed(a, b, kept) for a, b in pairs]
    calls = [("mixed", (a & WORD, a >> 32, b & WORD, b >> 32)) for a, b in pairs]
    results, _ = called(calls, AssemblySource("c.s", compiled(C, option)))
    assert [low | high << 32 for low, high in results] == expected
