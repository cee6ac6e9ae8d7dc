"""A linked program: the bytes as they lie in memory, and the names for what lies where."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from ...base.errors import InputFileError

__all__ = ["CYCLES_PER_SECOND", "MEMORY_BYTES", "RAM_BASE", "Function", "Line", "LinkedProgram", "Section", "read_map"]

RAM_BASE = 0x10000
"""The address at which a program lies and begins."""

MEMORY_BYTES = 1 << 16
"""The memory of one processor."""

CYCLES_PER_SECOND = 400_000_000
"""Of a core."""

_FIRST_LINE = "phasewire xs1 map 1"
_WORDS = {"section": 3, "function": 3, "symbol": 2, "constant": 2}  # of a row of a map, after its kind


class Section(NamedTuple):
    """A part of memory: text (code), cp (constants), dp (data) or bss (data that begin as 0); sizes are in bytes."""

    name: str
    address: int
    size: int


class Function(NamedTuple):
    """A named stretch of code; the size is in bytes."""

    name: str
    address: int
    size: int


class Line(NamedTuple):
    """An instruction and the line of assembly that it is from; the size is in bytes."""

    address: int
    size: int
    file: str
    number: int


@dataclass(frozen=True)
class LinkedProgram:
    """A linked program.

    Parameters
    ----------
    image : bytes
        Memory from `base` on, data that begin as 0 included. The entry point is its beginning.
    base : int
    symbols : mapping
        Addresses and numbers by name. A name that only its source knows has the source's name before it, as in
        ``"receive.s:loop"``, if another source has the same one. Labels that begin with ``.L`` are left out.
    sections : sequence of Section
        The sections in the order of addresses.
    functions : sequence of Function
        The functions in the order of addresses.
    code : sequence of (int, int)
        Begin and end of each stretch of instructions; the rest of the image is data.
    lines : sequence of Line
        The lines in the order of addresses; empty in what `read_map` returns.
    constants : frozenset of str
        The symbols that are numbers rather than addresses.
    """

    image: bytes
    base: int = RAM_BASE
    symbols: Mapping[str, int] = field(default_factory=dict)
    sections: Sequence[Section] = ()
    functions: Sequence[Function] = ()
    code: Sequence[tuple[int, int]] = ()
    lines: Sequence[Line] = ()
    constants: frozenset[str] = frozenset()

    @property
    def end(self) -> int:
        """The first address after the program, data included."""
        return self.base + len(self.image)

    def function_at(self, address: int) -> Function | None:
        """The function that an address is in, or None."""
        index = bisect_right(self._function_addresses, address) - 1
        if index < 0 or address >= sum(self.functions[index][1:]):
            return None
        return self.functions[index]

    def describe(self, address: int) -> str:
        """An address by name: ``"rasterise+0x12"``, or as a number if no symbol lies at or before it."""
        index = bisect_right(self._named, (address, "\U0010ffff")) - 1
        if index < 0 or not self.base <= address <= self.end:
            return f"0x{address:x}"
        before = self._named[index][0]
        name = self._names[before][0]
        return name if before == address else f"{name}+0x{address - before:x}"

    def names_at(self, address: int) -> Sequence[str]:
        """All symbols that lie at an address."""
        return self._names.get(address, ())

    def map_text(self) -> str:
        """The map as text, which `read_map` reads: sections, stretches of code, functions, symbols; hexadecimal."""
        rows = [f"base {self.base:x} end {self.end:x}"]
        rows += [f"section {part.address:x} {part.size:x} {part.name}" for part in self.sections]
        rows += [f"code {first:x} {last - first:x}" for first, last in self.code]
        rows += [f"function {part.address:x} {part.size:x} {part.name}" for part in self.functions]
        addresses = sorted((value, name) for name, value in self.symbols.items() if name not in self.constants)
        rows += [f"symbol {value:x} {name}" for value, name in addresses]
        rows += [f"constant {self.symbols[name]:x} {name}" for name in sorted(self.constants)]
        return "\n".join([_FIRST_LINE, *rows, ""])

    @cached_property
    def _function_addresses(self) -> list[int]:
        return [function.address for function in self.functions]

    @cached_property
    def _named(self) -> list[tuple[int, str]]:
        """Symbols of the program by address; those of the linker only count if there is no other."""
        return sorted((value, name) for name, value in self.symbols.items() if name not in self.constants)

    @cached_property
    def _names(self) -> dict[int, list[str]]:
        """The symbols at each address, those of the linker last."""
        names: dict[int, list[str]] = {}
        for value, name in sorted(self._named, key=lambda pair: (pair[1].startswith("_"), pair[1])):
            names.setdefault(value, []).append(name)
        return names


def read_map(text: str, image: bytes = b"", *, file: str = "map") -> LinkedProgram:
    """Read a map.

    Parameters
    ----------
    text : str
        A map as `LinkedProgram.map_text` returns it.
    image : bytes
        The program that it is about. Zeros at its end that data which begin as 0 would take may be left out.
    file : str
        Name of the file in messages.

    Returns
    -------
    LinkedProgram
        Without lines; without an image the image is zeros.

    Raises
    ------
    InputFileError
        If the text is no map, or the image is of another length than the map says.
    """
    rows = text.splitlines()
    if not rows or rows[0] != _FIRST_LINE:
        raise InputFileError(f"{file}, line 1: {rows[0][:40] if rows else ''!r} is no map; it must be {_FIRST_LINE!r}")
    base = end = RAM_BASE
    symbols: dict[str, int] = {}
    sections, functions, code, constants = [], [], [], set()
    for number, row in enumerate(rows[1:], 2):
        kind = row.partition(" ")[0]
        words = row.split(maxsplit=_WORDS.get(kind, 4))[1:]
        try:
            match kind, words:
                case "base", [first, "end", last]:
                    base, end = int(first, 16), int(last, 16)
                case "section", [address, size, name]:
                    sections.append(Section(name, int(address, 16), int(size, 16)))
                case "function", [address, size, name]:
                    functions.append(Function(name, int(address, 16), int(size, 16)))
                case "code", [address, size]:
                    code.append((int(address, 16), int(address, 16) + int(size, 16)))
                case "symbol", [value, name]:
                    symbols[name] = int(value, 16)
                case "constant", [value, name]:
                    symbols[name] = int(value, 16)
                    constants.add(name)
                case _:
                    raise ValueError
        except ValueError:
            raise InputFileError(
                f"{file}, line {number}: {row!r} is no row of a map, such as 'symbol 10000 main'"
            ) from None
    if not 0 <= end - base <= MEMORY_BYTES:
        raise InputFileError(f"{file}: the program is {end - base} bytes long; a memory has {MEMORY_BYTES}")
    missing = end - base - len(image)
    if image and 0 < missing <= sum(section.size for section in sections if section.name == "bss"):
        image += bytes(missing)  # an image in flash leaves out what begins as 0 at its end
    if image and len(image) != end - base:
        raise InputFileError(f"{file} is about {end - base} bytes, but the image has {len(image)}: build both again")
    return LinkedProgram(
        image or bytes(end - base),
        base,
        symbols,
        tuple(sections),
        tuple(functions),
        tuple(code),
        (),
        frozenset(constants),
    )
