"""Instructions as bits: operands into half words, and half words into operands.

A half word is a whole instruction, or the first half of a long one: then it is a prefix, which has the upper bits of
the next half word's immediate, or it begins with five ones, and the next half word has the opcode. So two half words
are enough to decode, by look-up in `tables`. `predecoding` does it for a whole memory.

Three operands of 0 to 11 lie in 11 bits: two bits of each in a field of its own, and their upper bits as digits of base
3 in five bits, whose values 27 to 31 are left for the formats of fewer operands.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .instructions import BIT_POSITIONS, INSTRUCTIONS, Format, Instruction

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "ILLEGAL",
    "LONG_ONLY",
    "Decoded",
    "Tables",
    "decode",
    "encode",
    "fields",
    "registers_of",
    "size_of",
    "split",
    "tables",
]

ILLEGAL = 255
"""The code of half words that are no instruction."""

PREFIX = 0b111100
"""Of the upper 6 bits of a half word, which give the next one's immediate 10 more bits."""

LONG = 0b11111
"""Of the upper 5 bits of a half word with operands, whose opcode follows in the next one."""

LONG_ONLY = frozenset({Format.FL3R, Format.FL2R, Format.FL4R, Format.FL5R, Format.FL6R})
"""Formats of two half words. Those with an immediate have one or two; the others have one."""

_OPERANDS = {
    Format.F3R: 3,
    Format.F2R: 2,
    Format.F1R: 1,
    Format.F0R: 0,
    Format.FRU6: 1,
    Format.FU6: 0,
    Format.FU10: 0,
    Format.FL3R: 3,
    Format.FL2R: 2,
    Format.FL4R: 4,
    Format.FL5R: 5,
    Format.FL6R: 6,
}
_IMMEDIATE_BITS = {Format.FRU6: 6, Format.FU6: 6, Format.FU10: 10}
_LIKE = {Format.FL4R: Format.F1R, Format.FL5R: Format.F2R, Format.FL6R: Format.F3R}
"""The second half words, with d, e and f, are as short instructions of these formats, with a, b and c."""

_NONE, _NUMBER, _POSITION = range(3)  # what the last field stands for besides a register
_FIRST_REGISTER, _SIZE = 8, 32  # where fields lie in a predecoded word


class Decoded(NamedTuple):
    """An instruction with its operands.

    Parameters
    ----------
    code : int
        Its place in `INSTRUCTIONS`.
    a, b, c, d, e, f : int
        The operand fields as they lie in the bits: register numbers, for U the number, for P the code of the position.
    imm : int
        The number meant by N, U or P (bits), or for T the distance in bytes from the instruction's end; else 0.
    size : int
        Size in bytes: 2 or 4.
    """

    code: int
    a: int = 0
    b: int = 0
    c: int = 0
    d: int = 0
    e: int = 0
    f: int = 0
    imm: int = 0
    size: int = 2

    @property
    def instruction(self) -> Instruction:
        """The row of the table."""
        return INSTRUCTIONS[self.code]


class Tables(NamedTuple):
    """Everything that decodes two half words without a search. Words are as `predecoding.predecode` returns them.

    Parameters
    ----------
    short : (65536,) int64
        The word for a half word that is an instruction, else `ILLEGAL`.
    imm : (65536,) int32
        Its immediate.
    three, two : (65536,) and (2, 65536) int64
        The word for the second half of a long instruction, without the operands of the first; `two` is for first
        halves of two operands, by their bit 4.
    bits, scale : (256,) int32
        The bits of each code's immediate in a short form, 0 if it cannot have a prefix, and its unit.
    last : (256,) int32
        Whether the last field of each code is 1 a number or 2 a bit position.
    positions : (16,) int32
        Bit positions by their code.
    """

    short: NDArray[np.int64]
    imm: NDArray[np.int32]
    three: NDArray[np.int64]
    two: NDArray[np.int64]
    bits: NDArray[np.int32]
    scale: NDArray[np.int32]
    last: NDArray[np.int32]
    positions: NDArray[np.int32]


def decode(low: int, high: int = 0xFFFF) -> Decoded | None:
    """The instruction in a half word, or in it and the next one.

    Parameters
    ----------
    low, high : int
        The half words, the one at the lower address first. A short instruction takes no notice of `high`; with its
        default no other is complete.

    Returns
    -------
    Decoded or None
        None if the half words are no instruction.
    """
    table = tables()
    word, imm = int(table.short[low]), int(table.imm[low])
    if word & 255 == ILLEGAL and low >> 10 == PREFIX:
        word = int(table.short[high])
        code = word & 255
        if word & 255 == ILLEGAL or not (bits := int(table.bits[code])):
            return None
        imm = ((low & 1023) << bits | high & (1 << bits) - 1) * int(table.scale[code])
        word += 2 << _SIZE
    elif word & 255 == ILLEGAL and low >> 11 == LONG:
        first, count = split(low)
        if not count:
            return None
        word = first | int(table.three[high] if count == 3 else table.two[low >> 4 & 1, high])
        if (kind := table.last[word & 255]) != _NONE:
            imm = word >> 16 & 15 if kind == _NUMBER else BIT_POSITIONS[word >> 16 & 15]
    if word & 255 == ILLEGAL:
        return None
    a, b, c, d, e, f = (word >> shift & 15 for shift in range(_FIRST_REGISTER, _SIZE, 4))
    return Decoded(word & 255, a, b, c, d, e, f, imm, word >> _SIZE & 7)


def encode(code: int, operands: Sequence[int] = (), imm: int = 0, *, size: int = 0) -> bytes:
    """The bytes of an instruction.

    Parameters
    ----------
    code : int
        Its place in `INSTRUCTIONS`.
    operands : sequence of int
        The operand fields, a first, as in `Decoded`; as many as the format has, or more.
    imm : int
        The number for N; for T the distance in bytes from the instruction's end, without a sign or with the right one.
        U and P are operand fields, so it does not matter for them.
    size : int
        2 or 4 bytes, or 0 for the shorter that fits.

    Raises
    ------
    ValueError
        If an operand or the immediate does not fit.
    """
    instruction = INSTRUCTIONS[code]
    format_, opcode = instruction.format, instruction.opcode
    count = _OPERANDS[format_]
    values = tuple(operands[:count])
    limit = registers_of(code) - 1
    if len(values) < count or any(not 0 <= value <= limit for value in values):
        raise ValueError(f"{instruction.name} takes {count} operands of 0 to {limit}, not {tuple(operands)}")
    if bits := _IMMEDIATE_BITS.get(format_, 0):
        number = _raw(instruction, imm)
        needed = size_of(code, imm)
        if size and size < needed:
            raise ValueError(f"{instruction.name} has {bits} bits for its immediate in 2 bytes, too few for {imm}")
        low = opcode << bits | number & (1 << bits) - 1
        if format_ == Format.FRU6:
            low = opcode << 10 | values[0] << 6 | number & 63
        if (size or needed) == 2:
            return low.to_bytes(2, "little")
        return (PREFIX << 10 | number >> bits | low << 16).to_bytes(4, "little")
    length = 4 if format_ in LONG_ONLY else 2
    if size not in (0, length):
        raise ValueError(f"{instruction.name} has {length} bytes, not {size}")
    return _half_words(format_, opcode, values).to_bytes(length, "little")


def fields(instruction: Instruction) -> int:
    """The number of operand fields of an instruction, without N and T."""
    return _OPERANDS[instruction.format]


def registers_of(code: int) -> int:
    """The number of registers that an operand of an instruction may be: the first 12, or all 16."""
    return 16 if code in _ANY_REGISTER else 12


def size_of(code: int, imm: int = 0) -> int:
    """The fewest bytes, 2 or 4, that an instruction with an immediate needs.

    Raises
    ------
    ValueError
        If the immediate does not fit at all.
    """
    instruction = INSTRUCTIONS[code]
    if not (bits := _IMMEDIATE_BITS.get(instruction.format, 0)):
        return 4 if instruction.format in LONG_ONLY else 2
    number = _raw(instruction, imm)
    if number >> bits + 10:
        raise ValueError(f"the immediate of {instruction.name} is 0 to {(1 << bits + 10) - 1}, not {number}")
    return 4 if number >> bits else 2


@cache
def tables() -> Tables:
    """The tables that decode; made at the first call."""
    short, imm = np.full(1 << 16, ILLEGAL, np.int64), np.zeros(1 << 16, np.int32)
    three, two = np.full(1 << 16, ILLEGAL, np.int64), np.full((2, 1 << 16), ILLEGAL, np.int64)
    bits, scale, last = np.zeros(256, np.int32), np.ones(256, np.int32), np.zeros(256, np.int32)
    positions = np.zeros(16, np.int32)
    positions[: len(BIT_POSITIONS)] = BIT_POSITIONS
    for code, instruction in enumerate(INSTRUCTIONS):
        format_, opcode = instruction.format, instruction.opcode
        bits[code] = _IMMEDIATE_BITS.get(format_, 0)
        scale[code] = 1 if " T" not in instruction.syntax else -2 if instruction.backwards else 2
        last[code] = _last(instruction)
        word = code | (4 if format_ in LONG_ONLY else 2) << _SIZE
        if format_ == Format.FL2R:
            two[opcode & 1, _second_half(format_, opcode)] = word
        elif format_ == Format.FL3R:
            three[_second_half(format_, opcode)] = word
        elif format_ in _LIKE:
            halves, registers = _all(_LIKE[format_], opcode)
            three[halves] = word | registers << 12
        elif bits[code]:
            numbers = np.arange(1 << bits[code])
            count = registers_of(code) if format_ == Format.FRU6 else 1
            registers = np.arange(count)[:, None]
            halves = opcode << (10 if format_ == Format.FRU6 else bits[code]) | registers << 6 | numbers
            short[halves], imm[halves] = word | registers << _FIRST_REGISTER, numbers * scale[code]
        else:
            halves, registers = _all(format_, opcode)
            short[halves] = word | registers
            if last[code] != _NONE:
                final = registers >> _FIRST_REGISTER + 4 * (_OPERANDS[format_] - 1) & 15
                imm[halves] = final if last[code] == _NUMBER else positions[final]
    for table in (made := Tables(short, imm, three, two, bits, scale, last, positions)):
        table.flags.writeable = False
    return made


def _last(instruction: Instruction) -> int:
    """Whether the last field is a number or a bit position."""
    operands = instruction.syntax.partition(" ")[2]
    return _POSITION if "P" in operands else _NUMBER if "U" in operands else _NONE


def _half_words(format_: Format, opcode: int, values: Sequence[int]) -> int:
    """An instruction without an immediate, the first half word in the lower bits."""
    if format_ == Format.F3R:
        return opcode << 11 | int(_three(*values))
    if format_ == Format.F2R:
        return opcode >> 1 << 11 | int(_two(*values)) | (opcode & 1) << 4
    if format_ not in LONG_ONLY:
        return int(_few(format_, opcode, values))
    if format_ == Format.FL2R:
        low, high = int(_two(*values)) | (opcode & 1) << 4, _second_half(format_, opcode)
    else:
        low = int(_three(*values[:3]))
        high = _half_words(_LIKE[format_], opcode, values[3:]) if format_ in _LIKE else _second_half(format_, opcode)
    return LONG << 11 | low | high << 16


def _raw(instruction: Instruction, imm: int) -> int:
    """The immediate as it lies in the bits: for a branch in half words, without its sign."""
    if " T" not in instruction.syntax:
        if imm < 0:
            raise ValueError(f"the immediate of {instruction.name} is at least 0, not {imm}")
        return imm
    if imm % 2 or (imm and (imm < 0) != instruction.backwards):
        way = "backwards" if instruction.backwards else "forwards"
        raise ValueError(f"{instruction.name} goes an even number of bytes {way}, not {imm}")
    return abs(imm) // 2


def _three(a: Any, b: Any, c: Any) -> Any:
    """The 11 bits of three operands: numbers, or arrays of them."""
    return (a >> 2) + 3 * (b >> 2) + 9 * (c >> 2) << 6 | (a & 3) << 4 | (b & 3) << 2 | c & 3


def _two(a: Any, b: Any) -> Any:
    """The 11 bits of two operands, without bit 4, which belongs to the opcode."""
    upper = (a >> 2) + 3 * (b >> 2) + 27
    return upper - 5 * (upper >> 5) << 6 | upper >> 5 << 5 | (a & 3) << 2 | b & 3


def _few(format_: Format, opcode: int, values: Any) -> Any:
    """A half word of one operand or none."""
    if format_ == Format.F1R:
        return opcode >> 1 << 11 | 0b111111 << 5 | (opcode & 1) << 4 | values[0]
    return opcode >> 5 << 11 | 0b111111 << 5 | opcode & 31


def _second_half(format_: Format, opcode: int) -> int:
    """The second half word of a long instruction of two or three operands: it has only opcode."""
    upper, lower = (opcode >> 5, opcode >> 1 & 15) if format_ == Format.FL2R else (opcode >> 4, opcode & 15)
    return upper << 11 | 0b111111 << 5 | lower


def _all(format_: Format, opcode: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All half words of an opcode with registers, and their operands as they lie in a predecoded word."""
    count = _OPERANDS[format_]
    operands = np.indices((12,) * count).reshape(count, 12**count)
    registers = np.zeros(12**count, np.int64)
    for place, numbers in enumerate(operands):
        registers |= numbers << _FIRST_REGISTER + 4 * place
    if format_ == Format.F3R:
        return opcode << 11 | _three(*operands), registers
    if format_ == Format.F2R:
        return opcode >> 1 << 11 | _two(*operands) | (opcode & 1) << 4, registers
    return _few(format_, opcode, operands) + 0 * registers, registers


def split(low: int) -> tuple[int, int]:
    """Take the operands out of a long instruction's first half.

    Parameters
    ----------
    low : int
        A half word.

    Returns
    -------
    registers : int
        Registers as in a predecoded word.
    count : int
        2 or 3 operands, or 0 if these are none.
    """
    upper = low >> 6 & 31
    if upper < 27:
        a, b, c = upper % 3 << 2 | low >> 4 & 3, upper // 3 % 3 << 2 | low >> 2 & 3, upper // 9 << 2 | low & 3
        return a << 8 | b << 12 | c << 16, 3
    upper += 5 * (low >> 5 & 1) - 27
    if upper > 8:
        return 0, 0
    return (upper % 3 << 2 | low >> 2 & 3) << 8 | (upper // 3 << 2 | low & 3) << 12, 2


_ANY_REGISTER = frozenset(
    code
    for code, instruction in enumerate(INSTRUCTIONS)
    if instruction.format == Format.FRU6 and instruction.name not in ("brft", "brbt", "brff", "brbf", "setci")
)
"""Codes whose register may be any of 16. Branches and setc leave 12 to 15 to other formats."""
