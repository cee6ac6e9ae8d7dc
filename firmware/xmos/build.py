"""Builds the chain processors' program: compile, assemble, link, and check that it fits memory, stacks and threads.

Sources are in `firmware/xmos/processor`. The assembly that clang makes of the C is kept beside them, so that a build
needs no clang (`kept`). The built image and its map are kept too.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ...base.errors import PhasewireError
from ..xs1.assembler import AssemblySource, assemble, runtime
from ..xs1.clang import find_clang
from ..xs1.program import MEMORY_BYTES, RAM_BASE, LinkedProgram, read_map
from .kept import KeptAssembly

__all__ = [
    "FIRST_VERSION",
    "Budget",
    "BuildError",
    "Part",
    "Stack",
    "budget",
    "build_processor",
    "c_files",
    "compiled_with",
    "kept_sources",
    "load_processor",
    "processor_segment",
    "program_of",
    "stale",
    "stored",
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
_MOST_THREADS = 4
_IDENT = re.compile(r'\.ident\s+"([^"]*)"')
_FUNCTION = re.compile(r"^\s*\.cc_top (\S+)\.function,")
_FRAME = re.compile(r"^\s*(?:entsp|extsp) (\d+)")
_CALL = re.compile(r"^\s*bl (\S+)")
_OTHER_CALL = re.compile(r"^\s*bla\b")
_THREAD = re.compile(r"^\s*bl begin_thread\b", re.MULTILINE)
_VERSION_SYMBOLS = ("VERSION_MAJOR", "VERSION_MINOR", "VERSION_PATCH")

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


def c_files(folder: Path | None = None) -> list[KeptAssembly]:
    """The program's C, with its kept assembly.

    Parameters
    ----------
    folder : Path, optional
        Folder of other C by the same names.
    """
    return [KeptAssembly((folder or FOLDER) / name, GENERATED) for name in _C]


def stale() -> list[str]:
    """The sources in C whose kept assembly was made from something else."""
    return [each.source.name for each in c_files() if each.stale]


def compiled_with() -> str:
    """The compiler that made the kept assembly, by its own name for itself."""
    found = _IDENT.search(c_files()[0].read().text)
    return found[1] if found else "unknown"


def kept_sources() -> list[AssemblySource]:
    """The program's sources in assembly, those that clang made included.

    Raises
    ------
    BuildError
        If the kept assembly is older than the C.
    """
    if old := stale():
        raise BuildError(
            f"the kept assembly of {', '.join(old)} is older than the C; run `python -m phasewire.firmware.xmos.build`"
        )
    return [*_written(), *(each.read() for each in c_files())]


def program_of(sources: Sequence[AssemblySource]) -> LinkedProgram:
    """Link sources into the chain processors' program; its version is `FIRST_VERSION`.

    Raises
    ------
    BuildError
        If the program does not fit the processor.
    InputFileError
        If a source does not assemble.
    """
    defines = dict(zip(_VERSION_SYMBOLS, FIRST_VERSION, strict=True))
    program = assemble([*sources, runtime()], defines=defines)
    _check(budget(program, sources))
    return program


def build_processor(*, compile: bool | None = None) -> LinkedProgram:
    """Build the chain processors' program; its version is `FIRST_VERSION`.

    Parameters
    ----------
    compile : bool, optional
        Whether to compile the C; if not, the kept assembly is used. By default it is compiled only if the kept assembly
        is older than the C.

    Raises
    ------
    BuildError
        If the kept assembly is older than the C and is to be used, or if the program does not fit the processor.
    CompilerMissingError
        If the C must be compiled and there is no clang.
    InputFileError
        If a source does not compile or assemble.
    """
    if bool(stale()) if compile is None else compile:
        return program_of([*_written(), *(each.compiled() for each in c_files())])
    return program_of(kept_sources())


@cache
def load_processor() -> LinkedProgram:
    """The program that is kept in the repository, with its symbols; its version is `FIRST_VERSION`."""
    return read_map(MAP.read_text(encoding="utf-8"), IMAGE.read_bytes(), file=MAP.name)


def processor_segment(version: tuple[int, int, int]) -> bytes:
    """The program with a version, as it is written to flash and loaded to the beginning of memory.

    What begins as 0 at its end is left out; the program clears it.

    Parameters
    ----------
    version : (int, int, int)
        Numbers that the program reports, each 0 to 255.

    Raises
    ------
    ValueError
        If the version has other numbers.
    """
    if len(version) != len(FIRST_VERSION) or not all(0 <= number <= 255 for number in version):
        raise ValueError(f"a version is three numbers of 0 to 255, such as (1, 2, 3); not {version}")
    program = load_processor()
    image = bytearray(stored(program))
    at = program.symbols["firmware_version"] - RAM_BASE
    image[at : at + len(version)] = bytes(version)
    return bytes(image)


def budget(program: LinkedProgram, sources: Sequence[AssemblySource] | None = None) -> Budget:
    """What a program takes of a processor.

    Parameters
    ----------
    program : LinkedProgram
    sources : sequence of AssemblySource, optional
        What it was linked from; the kept ones by default.

    Raises
    ------
    BuildError
        If functions call themselves, or by their address, so that their stack has no limit that can be found.
    """
    sources = kept_sources() if sources is None else sources
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


def _check(found: Budget) -> None:
    for stack in found.stacks:
        if stack.needs > stack.has:
            raise BuildError(
                f"thread {stack.thread} needs {stack.needs} words of stack and has {stack.has}; "
                f"raise {_STACKS[stack.thread]} in start.s"
            )
    if found.threads > _MOST_THREADS:
        raise BuildError(f"the program starts {found.threads} threads; more than {_MOST_THREADS} slow each other down")


def _written() -> list[AssemblySource]:
    """The sources that are written in assembly."""
    return [AssemblySource.read(FOLDER / name) for name in _ASSEMBLY]


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
            raise BuildError(
                f"function {name} calls by an address ({line.strip()}); its need of "
                "stack cannot be computed; call the function by its name"
            )
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


def _size(program: LinkedProgram, symbol: str) -> int:
    """From a symbol to the next one or the end of its section."""
    address = program.symbols[symbol]
    later = [value for name, value in program.symbols.items() if value > address and name not in program.constants]
    return min([*later, program.end]) - address


def stored(program: LinkedProgram) -> bytes:
    """The image of a program without the data that begin as 0."""
    begins = next((section.address for section in program.sections if section.name == "bss"), program.end)
    return program.image[: begins - program.base]


def main() -> None:
    """Compile the C if there is a clang, and write the kept assembly, the image and its map; print the budget."""
    if find_clang() is not None:
        for each in c_files():
            each.keep()
    sources = kept_sources()
    program = program_of(sources)
    IMAGE.write_bytes(stored(program))
    MAP.write_text(program.map_text(), encoding="utf-8")
    sys.stdout.write(budget(program, sources).text() + "\n")


if __name__ == "__main__":
    main()
