"""Assembly as text into items that have no address yet: the first half of the assembler.

Directives are those that clang writes for the XS1, and some for people who write assembly: ``.equ``, ``.macro``,
``.rept`` and ``.if``. Comments begin with ``#`` or ``//``; ``;`` separates statements.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import NamedTuple

from .encoding import encode, fields
from .expressions import ESCAPES, Expression, ExpressionError, UndefinedError, Value, parse_expression
from .instructions import INSTRUCTIONS
from .syntax import Meaning, meanings, mnemonics, spellings

__all__ = [
    "SECTIONS",
    "Align",
    "AssemblyError",
    "Bytes",
    "Candidate",
    "Code",
    "Data",
    "Item",
    "JumpTable",
    "Label",
    "Object",
    "Place",
    "Space",
    "SymbolicCode",
    "parse",
]

SECTIONS = ("text", "cp", "data", "large data", "bss", "large bss")
"""In the order of addresses. Large data lie after the others, so that these have small offsets."""

_MOST_STATEMENTS = 1_000_000  # after macros and repetitions
_IGNORED = {".file", ".ident", ".loc", ".addrsig", ".addrsig_sym", ".globound", ".linkset", ".corev"}
_WIDTHS = {".byte": 1, ".short": 2, ".hword": 2, ".2byte": 2, ".long": 4, ".word": 4, ".int": 4, ".4byte": 4}
_NAME = re.compile(r"[A-Za-z_.$][\w.$]*")
_LABEL = re.compile(r"\s*([\w.$]+)\s*:(?!:)")
_PIECE = re.compile(r'"(?:\\.|[^"\\])*"|\'\\?.\'|#|//|;|[^"\'#/;]+|.')
_BLOCK_COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|/\*.*?\*/', re.DOTALL)
_ESCAPE = re.compile(r"\\([0-7]{1,3}|x[0-9a-fA-F]{1,2}|.)", re.DOTALL)


class AssemblyError(ValueError):
    """Something is wrong in a statement; the message says what, and what would be right."""


class Place(NamedTuple):
    """Where a statement is."""

    file: str
    number: int
    text: str

    def complain(self, what: object) -> str:
        """A line of an error's message."""
        return f"{self.file}:{self.number}: {self.text}: {what}"


class Candidate(NamedTuple):
    """One meaning of a statement.

    Parameters
    ----------
    code : int
        The place in `INSTRUCTIONS`.
    operands : tuple of int
        The fields; the one of U or P is 0.
    letter : str
        U, P, N or T, or empty.
    number : Expression or None
        The value of U, P, N or T.
    pointer : str
        ``cp`` or ``dp`` if the number may be the address of something there.
    """

    code: int
    operands: tuple[int, ...]
    letter: str
    number: Expression | None
    pointer: str


@dataclass(eq=False)
class Item:
    """Something that takes up memory.

    Parameters
    ----------
    place : Place
    group : str
        The name of the part of a source that it belongs to, from ``.cc_top`` to ``.cc_bottom``, or empty.
    """

    place: Place
    group: str
    address: int = field(default=0, init=False)
    size: int = field(default=0, init=False)

    def expressions(self) -> Iterator[Expression]:
        """All that its bytes depend on."""
        yield from ()


@dataclass(eq=False)
class Label(Item):
    """A name for an address."""

    name: str


@dataclass(eq=False)
class Align(Item):
    """Fill up to a multiple of a number of bytes, in code with no-ops."""

    multiple: int
    code: bool


@dataclass(eq=False)
class Bytes(Item):
    """Fixed bytes."""

    content: bytes

    def __post_init__(self) -> None:
        self.size = len(self.content)


@dataclass(eq=False)
class Data(Item):
    """A number of some bytes."""

    width: int
    number: Expression

    def __post_init__(self) -> None:
        self.size = self.width

    def expressions(self) -> Iterator[Expression]:
        """The number."""
        yield self.number


@dataclass(eq=False)
class Space(Item):
    """Some bytes of one value."""

    count: Expression
    fill: int

    def expressions(self) -> Iterator[Expression]:
        """The number of bytes."""
        yield self.count


@dataclass(eq=False)
class SymbolicCode(Item):
    """An instruction whose bytes depend on symbols. The size grows while the program is linked."""

    candidates: list[Candidate]

    def __post_init__(self) -> None:
        self.size = 2

    def expressions(self) -> Iterator[Expression]:
        """The operands that are no registers."""
        for candidate in self.candidates:
            if candidate.number:
                yield candidate.number


@dataclass(eq=False)
class Code(Bytes):
    """An instruction of registers and plain numbers."""


@dataclass(eq=False)
class JumpTable(Item):
    """A jump table: a branch for each entry.

    Parameters
    ----------
    width : int
        Width of each entry, bytes.
    targets : list of Expression
    far : list of int
        Entries that reach their target by a longer branch after the table, found while the program is linked.
    """

    width: int
    targets: list[Expression]
    far: list[int] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.size = self.width * len(self.targets)

    def expressions(self) -> Iterator[Expression]:
        """The targets."""
        yield from self.targets


class Object:
    """A source after parsing.

    Parameters
    ----------
    name : str
        The file's name.
    library : bool
        Whether only those groups are linked that something refers to.

    Attributes
    ----------
    sections : dict of list of Item
    constants : dict of (Expression, Place)
        What ``.set`` and ``.equ`` define.
    exported, weak, functions, data : set of str
        Names after ``.globl`` and ``.weak``; of functions, by ``.type`` or ``.cc_top``; and of what is no function.
    sizes : dict of Expression
        What ``.size`` says.
    """

    def __init__(self, name: str, library: bool) -> None:
        self.name, self.library = name, library
        self.sections: dict[str, list[Item]] = {section: [] for section in SECTIONS}
        self.constants: dict[str, tuple[Expression, Place]] = {}
        self.exported: set[str] = set()
        self.weak: set[str] = set()
        self.functions: set[str] = set()
        self.data: set[str] = set()
        self.sizes: dict[str, Expression] = {}


def parse(name: str, text: str, *, library: bool, defines: Mapping[str, int], errors: list[str]) -> Object:
    """Parse a source.

    Parameters
    ----------
    name, text : str
    library : bool
        As for `Object`.
    defines : mapping
        Numbers that replace those of ``.equ``.
    errors : list of str
        Messages are appended.
    """
    parser = _Parser(Object(name, library), defines, errors)
    parser.run(text)
    return parser.object


class _Parser:
    """The state of parsing one source."""

    def __init__(self, made: Object, defines: Mapping[str, int], errors: list[str]) -> None:
        self.object, self.defines, self.errors = made, defines, errors
        self.section: str | None = "text"
        self.group = ""
        self.groups = 0
        self.labels: Counter[str] = Counter()
        self.dots = 0
        self.here: str | None = None
        self.known: set[str] = set()
        self.macros: dict[str, tuple[list[tuple[str, str]], list[str]]] = {}
        self.expansions = 0
        self.waiting: deque[tuple[Place, str]] = deque()
        self.conditions: list[bool] = []
        self.place = Place(made.name, 0, "")

    def run(self, text: str) -> None:
        """Parse all lines."""
        text = _BLOCK_COMMENT.sub(_without_comment, text)
        for number, line in enumerate(text.splitlines(), 1):
            place = Place(self.object.name, number, " ".join(line.split()))
            self.waiting.extend((place, statement) for statement in _statements(line))
        count = 0
        while self.waiting:
            self.place, statement = self.waiting.popleft()
            count += 1
            try:
                if count > _MOST_STATEMENTS:
                    self.waiting.clear()
                    raise AssemblyError(f"the source has more than {_MOST_STATEMENTS} statements with its macros")
                self.statement(statement)
            except (AssemblyError, ExpressionError) as error:
                self.errors.append(self.place.complain(error))
        if self.conditions:
            self.errors.append(self.place.complain("an .if lacks its .endif"))

    def statement(self, text: str) -> None:
        """Parse one statement with the labels before it."""
        self.here = None
        word, _, rest = text.partition(" ")
        if word in (".if", ".ifdef", ".ifndef", ".else", ".endif"):
            return self.condition(word, rest.strip())
        if not all(self.conditions):
            return None
        while match := _LABEL.match(text):
            self.label(match[1])
            text = text[match.end() :]
        text = text.strip()
        word = re.split(r"[\s\"]", text, maxsplit=1)[0]
        rest = text[len(word) :].strip()
        if not word:
            return None
        if word in self.macros:
            return self.expand(word, rest)
        if word.startswith("."):
            return self.directive(word, rest)
        if self.section:
            self.instruction(word, rest)
        return None

    def label(self, name: str) -> None:
        """Define a label here."""
        if not self.section:
            return
        if name.isdigit():
            self.labels[name] += 1
            name = f"{name}\0{self.labels[name]}"
        elif not _NAME.fullmatch(name):
            raise AssemblyError(f"{name!r} is no name for a label: letters, digits, '_', '.' and '$', no digit first")
        elif name in self.known or name in self.object.constants:
            raise AssemblyError(f"{name} is defined twice in this source")
        self.known.add(name)
        self.add(Label(self.place, self.group, name))

    def add(self, item: Item) -> None:
        """Append an item to the section."""
        if self.section:
            self.object.sections[self.section].append(item)

    def expression(self, text: str) -> Expression:
        """An expression with this source's numbered labels."""
        return parse_expression(text, self.rename)

    def rename(self, name: str) -> str:
        """The label that a number such as 1b or 1f means, or the address of a statement, ``.``."""
        if name == ".":
            if self.here is None:
                self.dots += 1
                self.here = f".\0{self.dots}"
                self.add(Label(self.place, self.group, self.here))
            return self.here
        if not name[0].isdigit():
            return name
        number, forwards = name[:-1], name[-1] == "f"
        if not forwards and not self.labels[number]:
            raise AssemblyError(f"there is no label {number}: before this line")
        return f"{number}\0{self.labels[number] + forwards}"

    def constant(self, text: str) -> int:
        """A number that must be known already."""

        def lookup(name: str, depth: int = 0) -> Value:
            if name in self.defines:
                return Value(self.defines[name])
            if name in self.object.constants and depth < 100:
                return self.object.constants[name][0].evaluate(lambda inner: lookup(inner, depth + 1))
            raise UndefinedError(name)

        value = self.expression(text).evaluate(lookup)
        return value.number

    # Instructions

    def instruction(self, mnemonic: str, operands: str) -> None:
        """Add an instruction."""
        if self.section != "text":
            raise AssemblyError(f"an instruction in the section of {self.section}; write .text before it")
        if mnemonic not in mnemonics():
            near = get_close_matches(mnemonic, [*mnemonics(), *self.macros], 1)
            raise AssemblyError(f"{mnemonic} is no instruction" + (f"; is it {near[0]}?" if near else ""))
        if not (found := meanings(mnemonic, operands)):
            raise AssemblyError("these are not its operands; write " + " or ".join(spellings(mnemonic)))
        candidates = [self.candidate(reading) for reading in found]
        for candidate in candidates:
            if not candidate.letter:
                self.add(Code(self.place, self.group, encode(candidate.code, candidate.operands)))
                return
        self.add(SymbolicCode(self.place, self.group, candidates))

    def candidate(self, reading: Meaning) -> Candidate:
        """One meaning, with its expression parsed."""
        instruction = INSTRUCTIONS[reading.code]
        letters = "ABCDEF"[: fields(instruction)]
        operands = tuple(reading.registers.get(letter, 0) for letter in letters)
        number = self.expression(reading.number) if reading.letter else None
        pointer = re.search(r"\b([cd]p)\[N\]", instruction.syntax)
        return Candidate(reading.code, operands, reading.letter, number, pointer[1] if pointer else "")

    # Directives

    def directive(self, word: str, rest: str) -> None:
        """Carry out a directive."""
        if word in _IGNORED or word.startswith(".cfi_"):
            return
        if word in (".text", ".data", ".bss"):
            word, rest = ".section", word
        if word == ".section":
            self.section = _section(rest.split(",")[0].strip().strip('"'))
        elif word == ".macro":
            self.define_macro(rest)
        elif word == ".rept":
            body = self.body(".rept", ".endr")
            self.repeat(body * self.count(rest))
        elif word in (".set", ".equ"):
            self.equate(rest)
        elif word in (".globl", ".global", ".weak"):
            names = {name.strip() for name in rest.split(",")}
            self.object.exported |= names
            if word == ".weak":
                self.object.weak |= names
        elif word == ".type":
            name, _, kind = rest.partition(",")
            if kind.strip() in ("@function", "%function"):
                self.object.functions.add(name.strip())
            else:
                self.object.data.add(name.strip())
        elif word == ".size":
            name, _, size = rest.partition(",")
            if self.section:
                self.object.sizes[name.strip()] = self.expression(size)
        elif word == ".cc_top":
            self.groups += 1
            self.group = f"{rest.split(',')[0].strip()} {self.groups}"
            if self.section != "text":  # clang reaches arrays of bytes by words, but does not align them
                self.align(".balign", 4)
            if rest.split(",")[0].strip().endswith(".function"):
                self.object.functions.add(rest.rpartition(",")[2].strip())
        elif word == ".cc_bottom":
            self.group = ""
        elif not self.content(word, rest) and self.section:
            raise AssemblyError(f"the directive {word} is not known")

    def content(self, word: str, rest: str) -> bool:
        """Add what a directive puts into memory; returns whether the directive is known."""
        if not self.section:
            return True
        if word in _WIDTHS:
            for number in _split(rest):
                self.add(Data(self.place, self.group, _WIDTHS[word], self.expression(number)))
        elif word in (".ascii", ".asciz", ".asciiz", ".string"):
            end = b"" if word == ".ascii" else b"\0"
            content = b"".join(_string(part) + end for part in _split(rest))
            self.add(Bytes(self.place, self.group, content))
        elif word in (".space", ".zero", ".skip"):
            size, fill = [*_split(rest), "0"][:2]
            self.add(Space(self.place, self.group, self.expression(size), self.constant(fill) & 255))
        elif word in (".p2align", ".align", ".balign"):
            self.align(word, self.constant(_split(rest)[0]))
        elif word in (".jmptable", ".jmptable32"):
            self.jump_table(2 if word == ".jmptable" else 4, rest)
        elif word == ".comm":
            self.common(rest)
        else:
            return False
        return True

    def align(self, word: str, number: int) -> None:
        """Align what follows."""
        multiple = 1 << number if word == ".p2align" and 0 <= number < 16 else number
        if multiple < 1 or multiple & (multiple - 1) or multiple > 1 << 15:
            raise AssemblyError(f"{word} takes {'0 to 15' if word == '.p2align' else 'a power of two'}, not {number}")
        self.add(Align(self.place, self.group, multiple, self.section == "text"))

    def jump_table(self, width: int, rest: str) -> None:
        """Add a jump table."""
        if self.section != "text":
            raise AssemblyError("a jump table belongs into .text, after a bru")
        self.add(JumpTable(self.place, self.group, width, [self.expression(target) for target in _split(rest)]))

    def common(self, rest: str) -> None:
        """Reserve zeros with a name: ``.comm name, size, alignment``."""
        name, size, alignment = [*_split(rest), "4", "4"][:3]
        before, self.section = self.section, "bss"
        self.align(".balign", self.constant(alignment))
        self.label(name)
        self.object.exported.add(name)
        self.object.weak.add(name)
        self.add(Space(self.place, self.group, self.expression(size), 0))
        self.section = before

    def equate(self, rest: str) -> None:
        """Define a symbol by an expression."""
        name, comma, value = rest.partition(",")
        name = name.strip()
        if not comma or not _NAME.fullmatch(name):
            raise AssemblyError("it must be a name, a comma and a number, such as .equ SIZE, 4")
        if name in self.known:
            raise AssemblyError(f"{name} is defined twice in this source")
        if self.section or name not in self.object.constants:
            self.object.constants[name] = self.expression(value), self.place

    # Macros, repetitions and conditions

    def count(self, text: str) -> int:
        """A number of repetitions."""
        count = self.constant(text)
        if not 0 <= count <= _MOST_STATEMENTS:
            raise AssemblyError(f".rept takes 0 to {_MOST_STATEMENTS}, not {count}")
        return count

    def body(self, begin: str, end: str) -> list[str]:
        """Take the statements up to the end that belongs to a beginning."""
        depth = 1
        taken: list[str] = []
        while self.waiting:
            _, statement = self.waiting.popleft()
            word = statement.split(maxsplit=1)[0]
            depth += (word == begin) - (word == end)
            if not depth:
                return taken
            taken.append(statement)
        raise AssemblyError(f"{begin} lacks its {end}")

    def repeat(self, statements: list[str]) -> None:
        """Have statements parsed next, as if they were in this line."""
        if len(statements) > _MOST_STATEMENTS:
            raise AssemblyError(f"this makes {len(statements)} statements; {_MOST_STATEMENTS} are allowed")
        here = self.place
        places = [(here._replace(text=f"{here.text}: {' '.join(text.split())}"), text) for text in statements]
        self.waiting.extendleft(reversed(places))

    def define_macro(self, rest: str) -> None:
        """Keep a macro: ``.macro name a, b=default`` to ``.endm``."""
        body = self.body(".macro", ".endm")
        name, *parameters = re.split(r"[\s,]+", rest.strip()) if rest.strip() else [""]
        if not _NAME.fullmatch(name) or name in mnemonics():
            raise AssemblyError(f"{name!r} is no name for a macro")
        pairs = [parameter.partition("=") for parameter in parameters if parameter]
        self.macros[name] = [(parameter, default) for parameter, _, default in pairs], body

    def expand(self, name: str, rest: str) -> None:
        """Put a macro's statements in the place of its name."""
        parameters, body = self.macros[name]
        given = _split(rest) if rest else []
        if len(given) > len(parameters):
            raise AssemblyError(f"the macro {name} takes {len(parameters)} operands, not {len(given)}")
        values = dict(parameters)
        values |= {parameter: value for (parameter, _), value in zip(parameters, given, strict=False)}
        self.expansions += 1
        if self.expansions > _MOST_STATEMENTS // 10:
            self.waiting.clear()
            raise AssemblyError("the macros expand without end")
        values["@"] = str(self.expansions)
        names = "|".join(map(re.escape, sorted(values, key=len, reverse=True)))
        parts = re.compile(rf"\\(?:({names})|\(\))")
        self.repeat([parts.sub(lambda found: values[found[1]] if found[1] else "", statement) for statement in body])

    def condition(self, word: str, rest: str) -> None:
        """Begin, turn or end a condition."""
        if word in (".else", ".endif") and not self.conditions:
            raise AssemblyError(f"{word} without an .if before it")
        if word == ".endif":
            self.conditions.pop()
        elif word == ".else":
            self.conditions[-1] = not self.conditions[-1]
        elif word == ".if":
            self.conditions.append(False)
            if all(self.conditions[:-1]):
                self.conditions[-1] = self.constant(rest) != 0
        else:
            there = rest in self.defines or rest in self.object.constants or rest in self.known
            self.conditions.append(there == (word == ".ifdef"))


def _without_comment(found: re.Match[str]) -> str:
    """Strings stay; a comment leaves its ends of lines."""
    return found[0] if found[0].startswith('"') else " " + "\n" * found[0].count("\n")


def _statements(line: str) -> Iterator[str]:
    """The statements of a line, without comments."""
    statement = ""
    for piece in _PIECE.findall(line):
        if piece in ("#", "//"):
            break
        if piece == ";":
            if statement.strip():
                yield statement.strip().replace("\t", " ")
            statement = ""
        else:
            statement += piece
    if statement.strip():
        yield statement.strip() if '"' in statement else statement.strip().replace("\t", " ")


def _section(name: str) -> str | None:
    """The section of a name; None for what is not loaded."""
    large = "large " if ".large" in name else ""
    if name.startswith(".text"):
        return "text"
    if name.startswith((".cp", ".rodata")):
        return "cp"
    if name.startswith((".dp.bss", ".bss")):
        return f"{large}bss"
    if name.startswith((".dp", ".data")):
        return f"{large}data"
    if name.startswith((".note", ".debug", ".comment", ".llvm", ".eh_frame")):
        return None
    raise AssemblyError(f"the section {name} is not known; use .text, .cp.rodata, .dp.data or .dp.bss")


def _split(text: str) -> list[str]:
    """Parts between commas that are in no string or bracket."""
    parts, depth = [""], 0
    for piece in re.findall(r'"(?:\\.|[^"\\])*"|\'\\?.\'|.', text):
        depth += piece in "([" if len(piece) == 1 else 0
        depth -= piece in ")]" if len(piece) == 1 else 0
        if piece == "," and not depth:
            parts.append("")
        else:
            parts[-1] += piece
    parts = [part.strip() for part in parts]
    if "" in parts:
        raise AssemblyError("an operand is missing" if text else "it lacks its operands")
    return parts


def _string(text: str) -> bytes:
    """The bytes of a string in quotes."""
    if len(text) < 2 or text[0] != '"' or text[-1] != '"':
        raise AssemblyError(f"{text} is no string in double quotes")
    content = bytearray()
    place = 1
    while place < len(text) - 1:
        if match := _ESCAPE.match(text, place):
            content += _escaped(match[1])
            place = match.end()
        else:
            content += text[place].encode()
            place += 1
    return bytes(content)


def _escaped(text: str) -> bytes:
    """The byte after a backslash."""
    if text[0] in "01234567":
        return bytes([int(text, 8) & 255])
    if text[0] == "x" and len(text) > 1:
        return bytes([int(text[1:], 16)])
    if text not in ESCAPES:
        raise AssemblyError(f"\\{text} is no escape in a string")
    return bytes([ESCAPES[text]])
