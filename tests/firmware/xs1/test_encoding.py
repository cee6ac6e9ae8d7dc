"""Encoding both ways, against LLVM's and capstone's disassemblers."""

import itertools
import re
from collections.abc import Sequence
from functools import cache
from typing import Any

import capstone  # type: ignore[import-untyped]
import numpy as np
import pytest
from phasewire.firmware.xs1.encoding import ILLEGAL, Decoded, decode, encode, fields, registers_of, size_of, tables
from phasewire.firmware.xs1.instructions import BIT_POSITIONS, BY_NAME, INSTRUCTIONS, Format
from phasewire.firmware.xs1.predecoding import predecode, redecode
from phasewire.firmware.xs1.syntax import is_branch, render

from tests.firmware.xs1.llvm import disassembled, needs_llvm

LONG_FORMATS = (Format.FL3R, Format.FL2R, Format.FL4R, Format.FL5R, Format.FL6R)
IMMEDIATE_FORMATS = {Format.FRU6: 6, Format.FU6: 6, Format.FU10: 10}
PLACES = np.array([half for half in range(1 << 16) if half >> 4 & 127 == 0b1111110])
"""Second halves of most long instructions; one in a hundred random half words would be."""

Pair = tuple[int, int]


def long_pairs(count: int) -> list[Pair]:
    """Random half words that begin a long instruction, each with another one."""
    random = np.random.default_rng(1)
    firsts = np.concatenate([random.integers(0xF000, 0xF400, count), random.integers(0xF800, 1 << 16, 2 * count)])
    seconds = np.concatenate([random.integers(0, 1 << 16, 2 * count), random.choice(PLACES, count)])
    return list(zip(firsts.tolist(), seconds.tolist(), strict=True))


@cache
def operand_rows() -> list[tuple[Decoded, bytes]]:
    """Every instruction with all operands of up to three fields, or many of them, and immediates at every limit."""
    random = np.random.default_rng(2)
    rows = []
    for code, instruction in enumerate(INSTRUCTIONS):
        count = fields(instruction)
        operands = list(itertools.product(range(registers_of(code)), repeat=count))
        if len(operands) > 300:
            operands = [operands[0], operands[-1], *(operands[k] for k in random.integers(0, len(operands), 300))]
        bits = IMMEDIATE_FORMATS.get(instruction.format)
        for fields_, size in itertools.product(operands, (2, 4)):
            if not bits:
                if (size == 4) == (instruction.format in LONG_FORMATS):
                    decoded = with_fields(code, fields_, last_value(code, fields_), size)
                    rows.append((decoded, encode(code, fields_)))
                continue
            most = (1 << bits if size == 2 else 1 << bits + 10) - 1
            sign = 1 - 2 * instruction.backwards
            for number in {0, 1, most - 1, most, int(random.integers(0, most))}:
                imm = 2 * sign * number if is_branch(code) else number
                decoded = with_fields(code, fields_, imm, size)
                rows.append((decoded, encode(code, fields_, imm, size=size)))
    return rows


def with_fields(code: int, operands: Sequence[int], imm: int, size: int) -> Decoded:
    """An instruction with up to six operands."""
    a, b, c, d, e, f = (*operands, 0, 0, 0, 0, 0, 0)[:6]
    return Decoded(code, a, b, c, d, e, f, imm, size)


def last_value(code: int, operands: tuple[int, ...]) -> int:
    """The value of U or P, from the last field."""
    syntax = INSTRUCTIONS[code].syntax
    if re.search(r"\bU\b", syntax):
        return operands[-1]
    return BIT_POSITIONS[operands[-1]] if re.search(r"\bP\b", syntax) else 0


def halves(content: bytes) -> Pair:
    """The half words of an instruction."""
    return int.from_bytes(content[:2], "little"), int.from_bytes(content[2:], "little")


def text_of(low: int, high: int) -> str | None:
    """The decoder's text, or None."""
    decoded = decode(low, high)
    return decoded and render(decoded)


@needs_llvm
def test_every_half_word_against_llvm() -> None:
    """All 65536 half words that are whole instructions."""
    theirs = disassembled([half.to_bytes(2, "little") for half in range(1 << 16)])
    ours = [text_of(half, 0) if half >> 11 != 31 and half >> 10 != 60 else None for half in range(1 << 16)]
    assert ours == theirs
    assert sum(text is not None for text in ours) > 59_000


@needs_llvm
def test_long_instructions_against_llvm() -> None:
    """Random pairs of half words, of which the first begins a long instruction."""
    pairs = long_pairs(25_000)
    theirs = disassembled([low.to_bytes(2, "little") + high.to_bytes(2, "little") for low, high in pairs])
    assert [text_of(low, high) for low, high in pairs] == theirs
    assert sum(text is not None for text in theirs) > 9_000


@needs_llvm
def test_operands_against_llvm() -> None:
    """Every instruction, encoded."""
    rows = operand_rows()
    assert [render(decoded) for decoded, _ in rows] == disassembled([content for _, content in rows])


def test_capstone() -> None:
    """The same half words, by capstone, which writes larger numbers in base 16, even of registers."""
    disassembler = capstone.Cs(capstone.CS_ARCH_XCORE, 0)

    def theirs(low: int, high: int) -> tuple[int, str] | None:
        content = low.to_bytes(2, "little") + high.to_bytes(2, "little")
        for _, size, mnemonic, operands in disassembler.disasm_lite(content, 0, 1):
            decimal = re.sub(r"0x[0-9a-f]+", lambda found: str(int(found[0], 16)), operands)
            return size, f"{mnemonic} {decimal}".strip()
        return None

    pairs = [*((half, 0xFFFF) for half in range(1 << 16)), *long_pairs(10_000)]
    for low, high in pairs:
        decoded = decode(low, high)
        assert (decoded and (decoded.size, render(decoded))) == theirs(low, high)


def test_encode_is_the_inverse_of_decode() -> None:
    """For every instruction, and for every half word."""
    for decoded, content in operand_rows():
        assert decode(*halves(content)) == decoded
    for low, high in [*((half, 0) for half in range(1 << 16)), *long_pairs(10_000)]:
        if (found := decode(low, high)) is not None:
            content = low.to_bytes(2, "little") + (high.to_bytes(2, "little") if found.size == 4 else b"")
            assert encode(found.code, found[1:7], found.imm, size=found.size) == content


def test_predecode_is_decode_everywhere() -> None:
    """A whole memory of random bytes and of all instructions, and again after stores."""
    random = np.random.default_rng(3)
    memory = random.integers(0, 256, 1 << 16).astype(np.uint8)
    rows = operand_rows()
    content = b"".join(rows[place][1] for place in random.permutation(len(rows))[:12_000].tolist())
    memory[: len(content)] = np.frombuffer(content, np.uint8)
    memory[-2:] = 0x00, 0xF8  # lmul with 0 after it
    words, imm = predecode(memory)
    agree(memory, words, imm)
    half_words = memory.view(np.uint16)
    for index in random.integers(0, 1 << 15, 100).tolist():
        half_words[index] = random.integers(0, 1 << 16)
        for changed in (index, max(index - 1, 0)):
            redecode(tables(), half_words, words, imm, changed)
    agree(memory, words, imm)


def agree(memory: Any, words: Any, imm: Any) -> None:
    """Compare a predecoded memory with the decoder."""
    half_words = [*memory.view("<u2").tolist(), 0xFFFF]
    for index, (word, number) in enumerate(zip(words.tolist(), imm.tolist(), strict=True)):
        decoded = decode(half_words[index], half_words[index + 1])
        if decoded is None or index + decoded.size // 2 > len(words):
            assert word == ILLEGAL
            continue
        registers = [word >> shift & 15 for shift in range(8, 32, 4)]
        assert with_fields(word & 255, registers, number, word >> 32) == decoded


def test_names_and_opcodes_are_unique() -> None:
    """No two rows of the table have the same place or name."""
    assert len(BY_NAME) == len(INSTRUCTIONS) < ILLEGAL
    places = {(instruction.format, instruction.opcode) for instruction in INSTRUCTIONS}
    assert len(places) == len(INSTRUCTIONS)


@pytest.mark.parametrize(
    ("name", "operands", "imm", "size", "message"),
    [
        ("add", (0, 1, 12), 0, 0, r"add takes 3 operands of 0 to 11, not \(0, 1, 12\)"),
        ("add", (0, 1), 0, 0, "add takes 3 operands"),
        ("brft", (14,), 0, 0, "brft takes 1 operands of 0 to 11"),
        ("ldc", (0,), 65536, 0, "the immediate of ldc is 0 to 65535, not 65536"),
        ("ldc", (0,), -1, 0, "at least 0, not -1"),
        ("ldc", (0,), 64, 2, "6 bits for its immediate in 2 bytes, too few for 64"),
        ("brfu", (), -2, 0, "an even number of bytes forwards, not -2"),
        ("brbu", (), 2, 0, "an even number of bytes backwards, not 2"),
        ("brfu", (), 3, 0, "an even number of bytes forwards, not 3"),
        ("mul", (0, 0, 0), 0, 2, "mul has 4 bytes, not 2"),
    ],
)
def test_what_does_not_fit_is_refused(name: str, operands: tuple[int, ...], imm: int, size: int, message: str) -> None:
    """With what would be right."""
    with pytest.raises(ValueError, match=message):
        encode(BY_NAME[name], operands, imm, size=size)


def test_sizes_change_at_the_limits() -> None:
    """6, 10, 16 and 20 bits."""
    assert [size_of(BY_NAME["ldc"], number) for number in (63, 64, 65535)] == [2, 4, 4]
    assert [size_of(BY_NAME["blrf"], 2 * number) for number in (1023, 1024, (1 << 20) - 1)] == [2, 4, 4]
    assert [size_of(BY_NAME["brbu"], -2 * number) for number in (63, 64)] == [2, 4]
    assert [size_of(BY_NAME[name]) for name in ("add", "mul")] == [2, 4]
