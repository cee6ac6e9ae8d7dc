"""Disassembles a program or a piece of memory: instructions as LLVM writes them, with the names of a program's symbols.

The text of a whole program, without addresses, is assembly again, apart from names that only one source knows.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from .encoding import Decoded, decode
from .program import RAM_BASE, LinkedProgram
from .syntax import is_branch, render

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["DisassembledLine", "disassemble", "listing"]


class DisassembledLine(NamedTuple):
    """An instruction, or data, with its address.

    Parameters
    ----------
    address : int
    content : bytes
    text : str
        The instruction; a directive if the bytes are no instruction.
    labels : tuple of str
        The symbols at this address.
    code : int or None
        The place in `INSTRUCTIONS`; None for data.
    target : int or None
        The address that a branch, a call, or an access by way of cp or dp means, if it is known.
    """

    address: int
    content: bytes
    text: str
    labels: tuple[str, ...] = ()
    code: int | None = None
    target: int | None = None


def disassemble(
    memory: LinkedProgram | bytes | NDArray[np.uint8],
    start: int | None = None,
    stop: int | None = None,
    *,
    base: int = RAM_BASE,
    program: LinkedProgram | None = None,
) -> list[DisassembledLine]:
    """Disassemble from one address up to another.

    Parameters
    ----------
    memory : LinkedProgram or bytes or (n,) uint8
    start, stop : int, optional
        Even addresses; by default of the program's code or of the whole memory. An instruction that begins before
        `stop` is whole in the result.
    base : int
        The address of the memory's first byte; a program brings its own.
    program : LinkedProgram, optional
        Gives names to addresses, and tells which bytes are data, for a memory that was loaded with it.

    Returns
    -------
    list of DisassembledLine

    Raises
    ------
    ValueError
        If the addresses are odd or not in the memory.
    """
    if isinstance(memory, LinkedProgram):
        program, base = memory, memory.base
        text = program.sections[0] if program.sections else None
        start = start if start is not None else text.address if text else base
        stop = stop if stop is not None else text.address + text.size if text else program.end
    content = memory.image if isinstance(memory, LinkedProgram) else bytes(memory)
    start, stop = base if start is None else start, base + len(content) if stop is None else stop
    if start % 2 or not base <= start <= stop <= base + len(content):
        raise ValueError(
            f"start and stop are 0x{start:x} and 0x{stop:x}; they must be even, in order, and from 0x{base:x} "
            f"to 0x{base + len(content):x}"
        )
    lines, address = [], start
    while address < stop:
        lines.append(_line(content, base, address, stop, program))
        address += len(lines[-1].content)
    return lines


def listing(lines: Iterable[DisassembledLine]) -> str:
    """The lines as text: labels, and for each instruction its address, its bytes and its text."""
    rows = []
    for line in lines:
        rows += [f"{label}:" for label in line.labels]
        rows.append(f"{line.address:8x}  {line.content.hex(' ', 2):<11s}  {line.text}")
    return "\n".join(rows) + "\n" * bool(rows)


def _line(content: bytes, base: int, address: int, stop: int, program: LinkedProgram | None) -> DisassembledLine:
    """The line at an address."""
    place = address - base
    labels = tuple(program.names_at(address)) if program else ()
    decoded = None
    if place % 2 == 0 and (program is None or _is_code(program, address)):
        low, high = (int.from_bytes(content[place + skip : place + skip + 2], "little") for skip in (0, 2))
        decoded = decode(low, high) if place + 2 <= len(content) else None
        if decoded is None or place + decoded.size > len(content):
            half = content[place : place + 2]
            return DisassembledLine(address, half, _data(half), labels)
    if decoded is None:
        size = min(_data_size(program, address), stop - address)
        return DisassembledLine(address, (part := content[place : place + size]), _data(part), labels)
    target, text = _target(decoded, address, program)
    return DisassembledLine(address, content[place : place + decoded.size], text, labels, decoded.code, target)


def _is_code(program: LinkedProgram, address: int) -> bool:
    return not program.code or any(first <= address < last for first, last in program.code)


def _data_size(program: LinkedProgram | None, address: int) -> int:
    """Up to a word, but not beyond a symbol or the begin of code."""
    if program is None:
        return 2
    size = 1
    while (address + size) % 4 and not program.names_at(address + size) and not _is_code(program, address + size):
        size += 1
    return 1 if size == 3 else size


def _data(part: bytes) -> str:
    """A directive for data."""
    directive = {1: ".byte", 2: ".short", 4: ".long"}.get(len(part))
    if directive is None:
        return ".byte " + ", ".join(f"0x{byte:02x}" for byte in part)
    return f"{directive} 0x{int.from_bytes(part, 'little'):0{2 * len(part)}x}"


def _target(decoded: Decoded, address: int, program: LinkedProgram | None) -> tuple[int | None, str]:
    """The address that an instruction means, and its text."""
    target = None
    if is_branch(decoded.code):
        target = address + decoded.size + decoded.imm
    elif program:
        for pointer in ("cp", "dp"):
            if f"{pointer}[N]" in decoded.instruction.syntax and f"_{pointer}" in program.symbols:
                target = program.symbols[f"_{pointer}"] + 4 * decoded.imm
    if target is None or program is None or not program.base <= target <= program.end:
        return target, render(decoded)
    return target, render(decoded, program.describe(target))
