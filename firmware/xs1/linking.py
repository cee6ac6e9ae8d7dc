"""Parsed sources into a program: addresses, shortest encodings, bytes.

Every instruction whose length depends on a symbol begins short and grows if its value does not fit, until none grows
any more. Nothing shrinks, so this ends, and no instruction is longer than it must be.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from ...base.errors import InputFileError
from .encoding import encode, size_of
from .expressions import ExpressionError, UndefinedError, Value
from .instructions import BIT_POSITIONS, BY_NAME, INSTRUCTIONS
from .parsing import (
    SECTIONS,
    Align,
    AssemblyError,
    Bytes,
    Candidate,
    Code,
    Data,
    Item,
    JumpTable,
    Label,
    Object,
    Space,
    SymbolicCode,
)
from .program import MEMORY_BYTES, Function, Line, LinkedProgram, Section

__all__ = ["MOST_ERRORS", "link"]

MOST_ERRORS = 20
"""So many are reported at a time."""

_POSITION_CODES = {bits: code for code, bits in enumerate(BIT_POSITIONS)}  # 32 has its higher code
_NO_OP = encode(BY_NAME["addi"], (0, 0, 0))  # mov r0, r0
_FORWARDS, _BACKWARDS = BY_NAME["brfu"], BY_NAME["brbu"]
_LINKER_SECTIONS = {"text": ("text",), "cp": ("cp",), "dp": ("data", "large data"), "bss": ("bss", "large bss")}
_WORD = 4
_MOST_PASSES = 1000


class _OtherWayError(Exception):
    """A branch goes into the other direction."""


class _Encoded(NamedTuple):
    """What `SymbolicCode` can become."""

    candidate: Candidate
    operands: tuple[int, ...]
    imm: int
    size: int


def link(objects: Sequence[Object], *, base: int, defines: Mapping[str, int], errors: list[str]) -> LinkedProgram:
    """Link parsed sources.

    Parameters
    ----------
    objects : sequence of Object
    base : int
        The address of the first byte, a multiple of 4.
    defines : mapping
        Numbers that all sources know.
    errors : list of str
        What is already wrong. The sources are still looked at for more.

    Raises
    ------
    InputFileError
        With a line for each error.
    """
    linker = _Linker(objects, base, defines, errors)
    linker.collect()
    linker.place()
    linker.relax()
    linker.check()
    image = linker.emit()
    linker.check()
    return linker.program(image)


class _Scope:
    """Symbols as one source sees them."""

    def __init__(self, linker: _Linker, made: Object) -> None:
        self.linker, self.object = linker, made
        self.labels: dict[str, Label] = {}
        self.depth = 0

    def __call__(self, name: str) -> Value:
        """The value of a symbol; raises `UndefinedError`."""
        if name in self.linker.defines:
            return Value(self.linker.defines[name])
        if (label := self.labels.get(name)) and not (name in self.linker.weakly and name in self.object.exported):
            return Value(label.address, 1)
        if name in self.object.constants:
            return self.constant(name)
        if (owner := self.linker.exported.get(name)) is not None:
            return Value(owner.labels[name].address, 1) if name in owner.labels else owner.constant(name)
        if name in self.linker.marks:
            return Value(self.linker.marks[name], 1)
        if name in self.object.weak:
            return Value(0)
        raise UndefinedError(name)

    def constant(self, name: str) -> Value:
        """The value of a symbol of ``.equ``."""
        if self.depth > 100:
            raise ExpressionError(f"{name} is defined by itself")
        self.depth += 1
        try:
            return self.object.constants[name][0].evaluate(self)
        finally:
            self.depth -= 1


class _Linker:
    """The state of linking."""

    def __init__(self, objects: Sequence[Object], base: int, defines: Mapping[str, int], errors: list[str]) -> None:
        self.base, self.defines, self.errors = base, defines, errors
        self.scopes = [_Scope(self, made) for made in objects]
        self.exported: dict[str, _Scope] = {}
        self.weakly: set[str] = set()
        self.marks: dict[str, int] = dict.fromkeys(("_text", "_cp", "_dp", "_bss", "_end"), base)
        self.items: dict[str, list[tuple[_Scope, list[Item]]]] = {}
        self.ranges: dict[str, tuple[int, int]] = {}

    # Symbols and sections

    def collect(self) -> None:
        """Find all labels, and what of the libraries is needed."""
        for scope in self.scopes:
            for items in scope.object.sections.values():
                scope.labels |= {item.name: item for item in items if isinstance(item, Label)}
        for scope in self.scopes:
            for name in sorted(scope.object.exported & (scope.labels.keys() | scope.object.constants.keys())):
                self.export(name, scope)
        needed = self.needed()

        def keeps(scope: _Scope, item: Item) -> bool:
            return not scope.object.library or not item.group or item.group in needed[scope]

        for section in SECTIONS:
            self.items[section] = [
                (scope, _aligned(section, [item for item in scope.object.sections[section] if keeps(scope, item)]))
                for scope in self.scopes
            ]

    def export(self, name: str, scope: _Scope) -> None:
        """Make a symbol known to all sources; one that is not weak replaces a weak one."""
        other = self.exported.get(name)
        if other is None:
            self.exported[name] = scope
            return
        self.weakly |= {name} & (scope.object.weak | other.object.weak)
        if name in scope.object.weak:
            return
        if name not in other.object.weak:
            place = scope.labels[name].place if name in scope.labels else scope.object.constants[name][1]
            self.errors.append(place.complain(f"{name} is defined in {other.object.name} too; drop one of them"))
        self.exported[name] = scope

    def needed(self) -> dict[_Scope, set[str]]:
        """The groups of each library that something refers to."""
        needed: dict[_Scope, set[str]] = defaultdict(set)
        inside: dict[tuple[_Scope, str], set[str]] = defaultdict(set)
        waiting: list[tuple[_Scope, str]] = []
        for scope in self.scopes:
            for item in _all_items(scope.object):
                names = {name for expression in item.expressions() for name in expression.symbols}
                if scope.object.library and item.group:
                    inside[scope, item.group] |= names
                else:
                    waiting += ((scope, name) for name in names)
        seen = set()
        while waiting:
            scope, name = waiting.pop()
            if (scope, name) in seen:
                continue
            seen.add((scope, name))
            owner = scope if name in scope.labels or name in scope.object.constants else self.exported.get(name)
            if owner is None:
                continue
            if name in owner.object.constants:
                waiting += ((owner, inner) for inner in owner.object.constants[name][0].symbols)
            elif (group := owner.labels[name].group) and group not in needed[owner]:
                needed[owner].add(group)
                waiting += ((owner, inner) for inner in inside[owner, group])
        return needed

    # Addresses

    def place(self) -> bool:
        """Give every item its address; returns whether any changed."""
        changed, address = False, self.base
        begins = {}
        for section, sources in self.items.items():
            address += -address % _WORD
            begins[section] = address
            for scope, items in sources:
                for item in items:
                    if isinstance(item, Align):
                        item.size = -address % item.multiple
                    elif isinstance(item, Space):
                        item.size = self.space(scope, item)
                    changed |= item.address != address
                    item.address = address
                    address += item.size
            self.ranges[section] = (begins[section], address)
        marks = {
            "_text": begins["text"],
            "_cp": begins["cp"],
            "_dp": begins["data"],
            "_bss": begins["bss"],
            "_end": address + -address % _WORD,
        }
        changed |= marks != self.marks
        self.marks.update(marks)
        return changed

    def space(self, scope: _Scope, item: Space) -> int:
        """The size of a space; 0 while it has no value."""
        try:
            number, addresses = item.count.evaluate(scope)
        except ExpressionError:
            return 0
        return number if not addresses and 0 <= number <= 2 * MEMORY_BYTES else 0

    def relax(self) -> None:
        """Let instructions and jump tables grow until everything fits."""
        symbolic = [
            (scope, item)
            for scope, items in self.items["text"]
            for item in items
            if isinstance(item, (SymbolicCode, JumpTable))
        ]
        for scope, item in symbolic:
            if isinstance(item, SymbolicCode) and not any(expression.symbols for expression in item.expressions()):
                item.size = max((best.size for best in self.best(scope, item, [])), default=2)
        symbolic = [(scope, item) for scope, item in symbolic if any(parts.symbols for parts in item.expressions())]
        self.place()
        for _ in range(_MOST_PASSES):
            changed = False
            for scope, item in symbolic:
                before = item.size
                if isinstance(item, JumpTable):
                    self.reach(scope, item)
                elif item.size == 2:
                    item.size = max((best.size for best in self.best(scope, item, [])), default=2)
                changed |= item.size != before
            if not (self.place() or changed):
                return
            symbolic = [pair for pair in symbolic if pair[1].size < 4 or isinstance(pair[1], JumpTable)]
        self.errors.append("the size of a .space depends on itself, so no address is certain")

    def reach(self, scope: _Scope, table: JumpTable) -> None:
        """Find the entries of a jump table that need a longer branch after it."""
        if table.width != 2:
            return
        for index, target in enumerate(table.targets):
            if index in table.far:
                continue
            try:
                distance = target.evaluate(scope).number - (table.address + 2 * index + 2)
            except ExpressionError:
                continue
            if not _fits_short(distance):
                table.far.append(index)
        table.far.sort()
        table.size = 2 * len(table.targets) + 4 * len(table.far)

    def best(self, scope: _Scope, item: SymbolicCode, errors: list[str]) -> list[_Encoded]:
        """The shortest encoding of an instruction. If it has none, the errors are appended."""
        found: list[_Encoded] = []
        for candidate in item.candidates:
            try:
                found.append(self.encoded(scope, item, candidate))
            except _OtherWayError:
                continue
            except (ExpressionError, AssemblyError, ValueError) as error:
                errors.append(str(error))
        return [min(found, key=lambda encoded: encoded.size)] if found else []

    def encoded(self, scope: _Scope, item: SymbolicCode, candidate: Candidate) -> _Encoded:
        """An instruction with its values, at least as long as it already is."""
        code, operands, letter, expression, pointer = candidate
        assert expression is not None  # else it would be Code
        number, addresses = expression.evaluate(scope)
        if letter == "T" and addresses in (0, 1):
            for size in (2, 4):
                imm = number * 2 if not addresses else number - (item.address + size)
                if imm % 2:
                    raise AssemblyError("the label is at an odd address; write .p2align 1 before it")
                if (imm < 0) != INSTRUCTIONS[code].backwards:
                    continue
                if size >= max(item.size, size_of(code, imm)):
                    return _Encoded(candidate, operands, imm, size)
            raise _OtherWayError
        if addresses and pointer and addresses == 1:
            number, addresses = number - self.marks[f"_{pointer}"], 0
            if number % _WORD:
                raise AssemblyError(f"it is {number} bytes after {pointer}, but only words can be reached")
            number //= _WORD
        if addresses:
            kind = "an address" if addresses == 1 else "a sum of addresses"
            raise AssemblyError(f"{kind} where a number must be; load an address by ldaw or ldap")
        if letter == "N":
            return _Encoded(candidate, operands, number, max(item.size, size_of(code, number)))
        if letter == "P" and number not in _POSITION_CODES:
            raise AssemblyError(f"{number} is not one of the possible numbers of bits, 1 to 8, 16, 24 and 32")
        if letter == "U" and not 0 <= number < 12:
            raise AssemblyError(f"{number} is not from 0 to 11, as {INSTRUCTIONS[code].mnemonic} takes it")
        last = _POSITION_CODES[number] if letter == "P" else number
        return _Encoded(candidate, (*operands[:-1], last), 0, size_of(code))

    # Bytes

    def check(self) -> None:
        """Raise an error if anything is wrong so far."""
        if self.errors:
            more = f"\nand {len(self.errors) - MOST_ERRORS} more errors" if len(self.errors) > MOST_ERRORS else ""
            raise InputFileError("\n".join(self.errors[:MOST_ERRORS]) + more)
        if (size := self.marks["_end"] - self.base) > MEMORY_BYTES:
            parts = ", ".join(f"{name} {last - first}" for name, (first, last) in self.ranges.items() if last > first)
            largest = sorted(self.functions(), key=lambda function: -function.size)[:5]
            names = ", ".join(f"{function.name} {function.size}" for function in largest)
            raise InputFileError(
                f"the program has {size} bytes, but a processor's memory has {MEMORY_BYTES}: {parts}; "
                f"the largest functions are {names}"
            )

    def emit(self) -> bytes:
        """The bytes of everything; errors are collected."""
        image = bytearray(min(self.marks["_end"] - self.base, 8 * MEMORY_BYTES))
        for sources in self.items.values():
            for scope, items in sources:
                for item in items:
                    try:
                        content = self.content(scope, item)
                    except (ExpressionError, AssemblyError, ValueError) as error:
                        self.errors.append(item.place.complain(self.explained(error)))
                        continue
                    begin = item.address - self.base
                    image[begin : begin + len(content)] = content
        return bytes(image)

    def explained(self, error: Exception) -> str:
        """The message of an error; for an undefined symbol, where it could be from."""
        if not isinstance(error, UndefinedError):
            return str(error)
        for scope in self.scopes:
            if error.name in scope.labels or error.name in scope.object.constants:
                return f"{error.name} is only known in {scope.object.name}; write .globl {error.name} there"
        return f"{error.name} is not defined in any source"

    def content(self, scope: _Scope, item: Item) -> bytes:
        """The bytes of an item."""
        match item:
            case Bytes(content=content):
                if isinstance(item, Code) and item.address % 2:
                    raise AssemblyError("an instruction at an odd address; write .p2align 1 before it")
                return content
            case SymbolicCode():
                return self.instruction(scope, item)
            case JumpTable():
                return b"".join(self.branches(scope, item))
            case Data(size=size, number=number):
                return _number(number.evaluate(scope), size)
            case Space(count=count, fill=fill):
                return bytes([fill]) * self.counted(count.evaluate(scope))
            case Align(code=True):
                return b"\0" * (item.address % 2) + _NO_OP * (item.size // 2)
        return bytes(item.size)

    def instruction(self, scope: _Scope, item: SymbolicCode) -> bytes:
        """The bytes of an instruction with symbols."""
        if item.address % 2:
            raise AssemblyError("an instruction at an odd address; write .p2align 1 before it")
        errors: list[str] = []
        for expression in item.expressions():
            expression.evaluate(scope)
        if not (best := self.best(scope, item, errors)):
            raise AssemblyError(errors[-1])
        candidate, operands, imm, size = best[0]
        return encode(candidate.code, operands, imm, size=size)

    def branches(self, scope: _Scope, table: JumpTable) -> Iterator[bytes]:
        """The branches of a jump table, and the longer ones after it."""
        if table.address % 2:
            raise AssemblyError("a jump table at an odd address")
        count = len(table.targets)
        for index, target in enumerate(table.targets):
            end = table.address + table.width * (index + 1)
            if index in table.far:
                distance = table.address + 2 * count + 4 * table.far.index(index) - end
                if not _fits_short(distance):
                    raise AssemblyError(f"{count} entries are too many for branches of 2 bytes; use .jmptable32")
            else:
                distance = target.evaluate(scope).number - end
            yield _branch(distance, table.width)
        for place, index in enumerate(table.far):
            end = table.address + 2 * count + 4 * (place + 1)
            yield _branch(table.targets[index].evaluate(scope).number - end, 4)

    def counted(self, value: Value) -> int:
        """The size of a space."""
        if value.addresses or not 0 <= value.number <= 2 * MEMORY_BYTES:
            raise AssemblyError(f"a space of {value.number} bytes; a memory has {MEMORY_BYTES}")
        return value.number

    # Names

    def functions(self) -> list[Function]:
        """The functions, in the order of addresses."""
        found: dict[int, Function] = {}
        for scope, items in self.items["text"]:
            names = (scope.object.functions | scope.object.exported) - scope.object.data
            labels = [item for item in items if isinstance(item, Label) and item.name in names]
            end = max((item.address + item.size for item in items), default=0)
            stops = [label.address for label in labels] + [end]
            for label in labels:
                following = next((stop for stop in stops if stop > label.address), end)
                found.setdefault(label.address, Function(label.name, label.address, 0))
                size = self.function_size(scope, label, following - label.address)
                if found[label.address].name == label.name:
                    found[label.address] = Function(label.name, label.address, size)
        return [found[address] for address in sorted(found) if found[address].size]

    def function_size(self, scope: _Scope, label: Label, otherwise: int) -> int:
        """What .size says, or another number."""
        if label.name not in scope.object.sizes:
            return otherwise
        try:
            number, addresses = scope.object.sizes[label.name].evaluate(scope)
        except ExpressionError:
            return otherwise
        return otherwise if addresses else number

    def program(self, image: bytes) -> LinkedProgram:
        """Everything together."""
        symbols, constants = self.symbols()
        code, lines = [], []
        for _, items in self.items["text"]:
            for item in items:
                if item.size and isinstance(item, (Code, SymbolicCode, JumpTable)):
                    lines.append(Line(item.address, item.size, item.place.file, item.place.number))
                if item.size and isinstance(item, (Code, SymbolicCode, JumpTable, Align)):
                    code.append((item.address + item.address % 2, item.address + item.size))
        sections = []
        for name, parts in _LINKER_SECTIONS.items():
            first, last = self.ranges[parts[0]][0], self.ranges[parts[-1]][1]
            sections.append(Section(name, first, last - first))
        return LinkedProgram(
            image,
            self.base,
            symbols,
            tuple(sections),
            tuple(self.functions()),
            tuple(_joined(code)),
            tuple(lines),
            frozenset(constants),
        )

    def symbols(self) -> tuple[dict[str, int], set[str]]:
        """The values of all names, and which of them are numbers."""
        values: dict[str, list[tuple[_Scope, Value]]] = defaultdict(list)
        kept = {id(item) for sources in self.items.values() for _, items in sources for item in items}
        for scope in self.scopes:
            for name, label in scope.labels.items():
                if id(label) in kept and not name.startswith(".L") and "\0" not in name:
                    values[name].append((scope, Value(label.address, 1)))
            for name in scope.object.constants:
                if not name.startswith(".L"):
                    try:
                        values[name].append((scope, scope(name)))
                    except ExpressionError as error:
                        place = scope.object.constants[name][1]
                        self.errors.append(place.complain(self.explained(error)))
        symbols, constants = dict(self.marks), set()
        for name, number in self.defines.items():
            symbols[name] = number
            constants.add(name)
        for name, places in values.items():
            owner = self.exported.get(name)
            for scope, value in places:
                alone = scope is owner or (owner is None and len({value for _, value in places}) == 1)
                full = name if alone else f"{scope.object.name}:{name}"
                symbols[full] = value.number
                if not value.addresses:
                    constants.add(full)
        self.check()
        return symbols, constants


def _all_items(made: Object) -> Iterator[Item]:
    for items in made.sections.values():
        yield from items


def _aligned(section: str, items: list[Item]) -> list[Item]:
    """A source's part of a section, which begins at a word."""
    return [Align(items[0].place, "", _WORD, section == "text"), *items] if items else []


def _fits_short(distance: int) -> bool:
    """Whether a branch of 2 bytes reaches."""
    return abs(distance) // 2 < 64


def _branch(distance: int, size: int) -> bytes:
    """A branch without a condition."""
    return encode(_FORWARDS if distance >= 0 else _BACKWARDS, (), distance, size=size)


def _number(value: Value, size: int) -> bytes:
    """The bytes of a number, with or without a sign."""
    number, bits = value.number, 8 * size
    if value.addresses not in (0, 1):
        raise AssemblyError("a sum of addresses has no meaning; a difference has")
    if not -(1 << bits - 1) <= number < 1 << bits:
        raise AssemblyError(f"{number} does not fit into {size} bytes")
    return (number & (1 << bits) - 1).to_bytes(size, "little")


def _joined(ranges: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Ranges that touch become one."""
    joined: list[tuple[int, int]] = []
    for first, last in ranges:
        if joined and joined[-1][1] == first:
            joined[-1] = joined[-1][0], last
        elif last > first:
            joined.append((first, last))
    return joined
