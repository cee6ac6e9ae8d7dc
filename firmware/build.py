"""Builds the chain processors' program: compile, assemble, link, and check that it fits memory, stacks and threads.

Sources are in `firmware/processor`. The assembly that clang makes of the C is kept beside them, so that a build needs
no clang; each file names the source that it was made from, with a hash. The built image and its map are kept too.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ..errors import PhasewireError
from ..xs1.assembler import AssemblySource, assemble, runtime
from ..xs1.clang import compile_c, find_clang
from ..xs1.program import MEMORY_BYTES, RAM_BASE, Program, read_map

__all__ = [
    "FIRST_VERSION",
    "Budget",
    "BuildError",
    "Part",
    "Stack",
    "budget",
    "build_processor",
    "compiled_with",
    "load_processor",
    "processor_segment",
    "stale",
]

FOLDER = Path(__file__).parent / "processor"
GENERATED = FOLDER / "generated"
IMAGE = FOLDER / "processor.bin"
MAP = FOLDER / "processor.map"

FIRST_VERSION = (0, 1, 0)
"""Of the image that is kept in the repository."""

_ASSEMBLY = ("start.s", "events.s", "port.s", "raster.s", "receive.s")
"""The first holds the entry point."""
_C = ("play.c", "tables.c", "handle.c")
_HEADERS = ("hardware.h", "processor.h")
_MOST_THREADS = 4
_HASH = re.compile(r"^# from (\S+) and headers, sha256 ([0-9a-f]{64})$", re.MULTILINE)
_IDENT = re.compile(r'\.ident\s+"([^"]*)"')
_FUNCTION = re.compile(r"^\s*\.cc_top (\S+)\.function,")
_FRAME = re.compile(r"^\s*(?:entsp|extsp) (\d+)")
_CALL = re.compile(r"^\s*bl (\S+)")
_OTHER_CALL = re.compile(r"^\s*bla\b")
_THREAD = re.compile(r"^\s*bl begin_thread\b", re.MULTILINE)
_VERSION_BYTES = 3

_MEMORY = {
    "slots": ("slots",),
    "entries": ("entries",),
    "samples": ("samples",),
    "pulse edges": ("pulse_begins", "pulse_ends"),
    "modulated widths": ("widths",),
    "words of the port": ("tables", "silent_table", "no_edges"),
    "messages": ("play_ring", "handle_ring"),
    "slices": ("pool", "silence"),
}
"""Symbols by part of the memory; stacks, code and the rest are counted besides."""
_STACKS = {"port": "PORT_STACK", "receive": "RECEIVE_STACK", "play": "PLAY_STACK", "handle": "HANDLE_STACK"}


class BuildError(PhasewireError):
    """The firmware cannot be built, or does not fit the processor."""


class Part(NamedTuple):
    """A part of the memory."""

    name: str
    bytes: int


class Stack(NamedTuple):
    """The stack of a thread, in words: what its calls need at most, and what it has."""

    thread: str
    needs: int
    has: int


class Budget(NamedTuple):
    """What a program takes of a processor."""

    memory: tuple[Part, ...]
    stacks: tuple[Stack, ...]
    threads: int

    @property
    def bytes(self) -> int:
        """Of memory, all together."""
        return sum(part.bytes for part in self.memory)

    def text(self) -> str:
        """A table."""
        rows = [f"{part.bytes:6} bytes  {part.name}" for part in self.memory]
        rows.append(f"{self.bytes:6} bytes  of {MEMORY_BYTES}, {MEMORY_BYTES - self.bytes} are free")
        rows += [f"{stack.needs:6} words  of {stack.has} on the stack of {stack.thread}" for stack in self.stacks]
        rows.append(f"{self.threads:6} threads of {_MOST_THREADS} at full speed")
        return "\n".join(rows)


def stale() -> list[str]:
    """The sources in C whose kept assembly was made from something else."""
    return [name for name in _C if _kept_hash(name) != _hash(name)]


def compiled_with() -> str:
    """The compiler that made the kept assembly, by its own name for itself."""
    found = _IDENT.search((GENERATED / _assembly_of(_C[0])).read_text(encoding="utf-8"))
    return found[1] if found else "unknown"


def build_processor(version: tuple[int, int, int] = FIRST_VERSION, *, compile: bool | None = None) -> Program:
    """Build the chain processors' program.

    Parameters
    ----------
    version : (int, int, int)
        That it reports, each 0 to 255.
    compile : bool, optional
        Whether to compile the C; if not, the kept assembly is used. By default it is compiled only if the kept assembly
        is older than the C.

    Raises
    ------
    BuildError
        If the kept assembly is older than the C and there is no clang, or if the program does not fit the processor.
    InputFileError
        If a source does not compile or assemble.
    ValueError
        If the version has other numbers.
    """
    sources = _sources(bool(stale()) if compile is None else compile)
    program = assemble([*sources, runtime()], defines=_version_defines(version))
    _check(program, budget(program, sources))
    return program


@cache
def load_processor() -> Program:
    """The program that is kept in the repository, with its symbols; its version is `FIRST_VERSION`."""
    text = MAP.read_text(encoding="utf-8")
    base, end = (int(found, 16) for found in re.findall(r"^base (\w+) end (\w+)$", text, re.MULTILINE)[0])
    return read_map(text, IMAGE.read_bytes().ljust(end - base, b"\0"), file=MAP.name)


def processor_segment(version: tuple[int, int, int]) -> bytes:
    """The program with a version, as it is written to flash and loaded to the beginning of memory.

    What begins as 0 at its end is left out; the program clears it.

    Parameters
    ----------
    version : (int, int, int)
        That it reports, each 0 to 255.

    Raises
    ------
    ValueError
        If the version has other numbers.
    """
    _version_defines(version)
    program = load_processor()
    image = bytearray(_stored(program))
    at = program.symbols["firmware_version"] - RAM_BASE
    image[at : at + _VERSION_BYTES] = bytes(version)
    return bytes(image)


def budget(program: Program, sources: Sequence[AssemblySource] | None = None) -> Budget:
    """What a program takes of a processor.

    Parameters
    ----------
    program : Program
    sources : sequence of Source, optional
        What it was linked from; the kept ones by default.

    Raises
    ------
    BuildError
        If functions call themselves, or by their address, so that their stack has no limit that can be found.
    """
    sources = _sources(compile=False) if sources is None else sources
    frames, calls = _functions([*sources, runtime()])
    stacks = []
    for thread, symbol in _STACKS.items():
        roots = ("start", thread) if thread == "handle" else (thread,)
        needs = max(_depth(root, frames, calls, ()) for root in roots)
        stacks.append(Stack(thread, needs, program.symbols[symbol]))
    memory = [Part(name, sum(_size(program, symbol) for symbol in symbols)) for name, symbols in _MEMORY.items()]
    memory.append(Part("stacks", 4 * sum(stack.has + 1 for stack in stacks)))
    code = {section.name: section.size for section in program.sections}
    memory.append(Part("code and constants", code["text"] + code["cp"] - _size(program, "silence")))
    rest = program.end - program.base - sum(part.bytes for part in memory)
    memory.append(Part("variables", rest))
    return Budget(tuple(memory), tuple(stacks), 1 + len(_THREAD.findall("\n".join(source.text for source in sources))))


def _check(program: Program, found: Budget) -> None:
    for stack in found.stacks:
        if stack.needs > stack.has:
            raise BuildError(
                f"thread {stack.thread} needs {stack.needs} words of stack and has {stack.has}; "
                f"raise {_STACKS[stack.thread]} in start.s"
            )
    if found.threads > _MOST_THREADS:
        raise BuildError(f"the program starts {found.threads} threads; more than {_MOST_THREADS} slow each other down")
    if program.end > RAM_BASE + MEMORY_BYTES:
        raise BuildError(f"the program takes {program.end - RAM_BASE} bytes; a processor has {MEMORY_BYTES}")


def _version_defines(version: tuple[int, int, int]) -> dict[str, int]:
    if len(version) != _VERSION_BYTES or not all(0 <= number <= 255 for number in version):
        raise ValueError(f"a version is three numbers of 0 to 255, such as (1, 2, 3); not {version}")
    return dict(zip(("VERSION_MAJOR", "VERSION_MINOR", "VERSION_PATCH"), version, strict=True))


def _sources(compile: bool) -> list[AssemblySource]:
    made = [AssemblySource.read(FOLDER / name) for name in _ASSEMBLY]
    if compile:
        if find_clang() is None:
            raise BuildError(
                f"the kept assembly of {', '.join(stale()) or 'the C'} cannot be made anew: no clang with the target "
                "xcore is installed; install clang, or take back the change"
            )
        return made + [_compiled(name) for name in _C]
    if old := stale():
        raise BuildError(
            f"the kept assembly of {', '.join(old)} is older than the C; run `python -m phasewire.firmware.build`"
        )
    return made + [AssemblySource.read(GENERATED / _assembly_of(name)) for name in _C]


def _compiled(name: str) -> AssemblySource:
    made = compile_c(FOLDER / name)
    lines = [line.rstrip() for line in made.text.splitlines() if not line.strip().startswith((".file", "#APP", "#NO_"))]
    head = f"# Made by clang; do not edit.\n# from {name} and headers, sha256 {_hash(name)}\n"
    return AssemblySource(_assembly_of(name), head + "\n".join(lines) + "\n")


def _assembly_of(name: str) -> str:
    return str(Path(name).with_suffix(".s"))


def _hash(name: str) -> str:
    """Of a source and what it includes."""
    digest = hashlib.sha256()
    for each in (name, *_HEADERS):
        digest.update((FOLDER / each).read_bytes())
    return digest.hexdigest()


def _kept_hash(name: str) -> str:
    path = GENERATED / _assembly_of(name)
    if not path.exists():
        return ""
    found = _HASH.search(path.read_text(encoding="utf-8"))
    return found[2] if found else ""


def _functions(sources: Sequence[AssemblySource]) -> tuple[dict[str, int], dict[str, set[str]]]:
    """The words of stack of each function, and what it calls."""
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    for name, line in _lines(sources):
        if name not in frames:
            frames[name], calls[name] = 0, set()
        if found := _FRAME.match(line):
            frames[name] += int(found[1])
        elif found := _CALL.match(line):
            calls[name].add(found[1])
        elif _OTHER_CALL.match(line):
            raise BuildError(f"function {name} calls by an address ({line.strip()}): nobody knows the stack that takes")
    return frames, calls


def _lines(sources: Sequence[AssemblySource]) -> Iterator[tuple[str, str]]:
    for source in sources:
        name = ""
        for line in source.text.splitlines():
            if found := _FUNCTION.match(line):
                name = found[1]
            if name:
                yield name, line


def _depth(name: str, frames: Mapping[str, int], calls: Mapping[str, set[str]], above: tuple[str, ...]) -> int:
    if name in above:
        raise BuildError(f"function {name} calls itself, by way of {' and '.join(above)}: its stack has no limit")
    if name not in frames:
        raise BuildError(f"function {name} is called, and no source has it between .cc_top and .cc_bottom")
    deepest = max((_depth(each, frames, calls, (*above, name)) for each in calls[name]), default=0)
    return frames[name] + deepest


def _size(program: Program, symbol: str) -> int:
    """From a symbol to the next one or the end of its section."""
    address = program.symbols[symbol]
    later = [value for name, value in program.symbols.items() if value > address and name not in program.constants]
    return min([*later, program.end]) - address


def _stored(program: Program) -> bytes:
    """The image without the data that begin as 0."""
    begins = next((section.address for section in program.sections if section.name == "bss"), program.end)
    return program.image[: begins - program.base]


def main() -> None:
    """Compile the C if there is a clang, and write the kept assembly, the image and its map; print the budget."""
    if find_clang() is not None:
        GENERATED.mkdir(exist_ok=True)
        for name in _C:
            made = _compiled(name)
            (GENERATED / made.name).write_text(made.text, encoding="utf-8")
    program = build_processor(compile=False)
    IMAGE.write_bytes(_stored(program))
    MAP.write_text(program.map_text(), encoding="utf-8")
    load_processor.cache_clear()
    sys.stdout.write(budget(program).text() + "\n")


if __name__ == "__main__":
    main()
