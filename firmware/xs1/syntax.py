"""Instructions as text, by the templates of the table: operands into text, and text into operands."""

from __future__ import annotations

import re
from functools import cache
from typing import NamedTuple

from .encoding import Decoded, registers_of
from .instructions import ALIASES, BY_NAME, INSTRUCTIONS, REGISTERS

__all__ = ["Meaning", "is_branch", "meanings", "mnemonics", "render", "spellings"]

_LETTER = re.compile(r"\b[A-FNPTU]\b")
_REGISTERS = {count: "|".join(sorted(REGISTERS[:count], key=len, reverse=True)) for count in (12, 16)}
_NUMBERS = {register: number for number, register in enumerate(REGISTERS)}
_SPOKEN = {"U": "0..11", "P": "bits", "N": "number", "T": "label"}


class Meaning(NamedTuple):
    """One way to read a line of assembly.

    Parameters
    ----------
    code : int
        The place in `INSTRUCTIONS`.
    registers : dict
        Register numbers by letters A to F.
    number : str
        The text of U, P, N or T; empty if there is none.
    letter : str
        One of these; empty if there is none.
    """

    code: int
    registers: dict[str, int]
    number: str
    letter: str


class _Form(NamedTuple):
    code: int
    pattern: re.Pattern[str]
    letter: str
    number: str


def render(decoded: Decoded, target: str = "") -> str:
    """The text of an instruction, as LLVM's disassembler writes it.

    Parameters
    ----------
    decoded : Decoded
    target : str
        The text of N or T; by default the number itself, and for T the distance in half words.
    """
    instruction = decoded.instruction
    number = decoded.imm // 2 if is_branch(decoded.code) else decoded.imm

    def operand(found: re.Match[str]) -> str:
        letter = found[0]
        if letter in "NT":
            return target or str(number)
        return str(decoded.imm) if letter in "PU" else REGISTERS[decoded["ABCDEF".index(letter) + 1]]

    mnemonic, space, operands = instruction.syntax.partition(" ")
    return mnemonic + space + _LETTER.sub(operand, operands)


def is_branch(code: int) -> bool:
    """Whether the immediate of an instruction is T: the distance of a branch or an address."""
    return INSTRUCTIONS[code].syntax.endswith(" T")


def mnemonics() -> frozenset[str]:
    """All first words of instructions."""
    return frozenset(_forms())


def spellings(mnemonic: str) -> list[str]:
    """How the instructions of a mnemonic are written, for messages."""
    syntaxes = [instruction.syntax for instruction in INSTRUCTIONS if instruction.mnemonic == mnemonic]
    syntaxes += [alias for alias in ALIASES if alias.split()[0] == mnemonic]
    spoken = [_speak(syntax) for syntax in syntaxes]
    return list(dict.fromkeys(spoken))


def meanings(mnemonic: str, operands: str) -> list[Meaning]:
    """All instructions that a line may mean, in the order of the table.

    Parameters
    ----------
    mnemonic, operands : str
        The first word, and everything after it.

    Notes
    -----
    Several are possible: a branch forwards and backwards, immediates of different length. The values decide.
    """
    found = []
    for form in _forms().get(mnemonic, ()):
        if not (match := form.pattern.fullmatch(operands)):
            continue
        groups = match.groupdict()
        number = groups.pop("number", form.number)
        if number not in REGISTERS:
            registers = {letter: _NUMBERS[name] for letter, name in groups.items()}
            found.append(Meaning(form.code, registers, number.strip(), form.letter))
    return found


def _speak(syntax: str) -> str:
    """A template with words instead of letters."""
    mnemonic, space, operands = syntax.partition(" ")
    return mnemonic + space + _LETTER.sub(lambda found: _SPOKEN.get(found[0], "register"), operands)


@cache
def _forms() -> dict[str, list[_Form]]:
    """The patterns of each mnemonic."""
    forms: dict[str, list[_Form]] = {}
    rows = [(code, instruction.syntax, "") for code, instruction in enumerate(INSTRUCTIONS)]
    rows += [(BY_NAME[name], syntax, str(number)) for syntax, (name, number) in ALIASES.items()]
    for code, syntax, number in rows:
        mnemonic, _, operands = syntax.partition(" ")
        letter = next((found for found in _LETTER.findall(operands) if found in "UPNT"), "U" if number else "")
        pattern = re.compile(
            "".join(_pattern(token, _REGISTERS[registers_of(code)]) for token in re.findall(r"\w+|\S", operands))
        )
        forms.setdefault(mnemonic, []).append(_Form(code, pattern, letter, number))
    return forms


def _pattern(token: str, registers: str) -> str:
    """The pattern of a word or a sign of a template."""
    if token in _SPOKEN:
        return r"(?P<number>[^\[\],]+)"
    if _LETTER.fullmatch(token):
        return f"(?P<{token}>{registers})"
    return token if token.isalnum() else rf"\s*{re.escape(token)}\s*"
