"""The disassembler, against LLVM's, and against the assembler, which must make the same bytes of its text."""

import re

import numpy as np
import pytest
from phasewire.firmware.xs1.assembler import AssemblySource, assemble, runtime
from phasewire.firmware.xs1.disassembler import DisassembledLine, disassemble, listing
from phasewire.firmware.xs1.encoding import decode
from phasewire.firmware.xs1.instructions import BY_NAME
from phasewire.firmware.xs1.program import RAM_BASE, LinkedProgram, read_map

from tests.firmware.xs1.llvm import compiled, disassembled, needs_clang, needs_llvm
from tests.firmware.xs1.programs import ALL, STUBS

TEXT = """
	.globl start
start:	entsp 2
	ldw r0, dp[counter+4]
	ldaw r11, cp[table]
again:	bt r0, again
	bl other
	ldap r11, start
	.long 0x12345678
	.byte 1, 2
	.globl other
	.type other, @function
other:	retsp 0
	.section .cp.rodata
	.long 5
table:	.long 6
	.section .dp.data
counter: .long 7, 8
	.byte 9
"""


def as_source(lines: list[DisassembledLine]) -> str:
    """Lines as assembly again."""
    rows = []
    for line in lines:
        rows += [f"{label}:" for label in line.labels if not re.fullmatch("_(text|cp|dp|bss|end)", label)]
        rows.append(line.text)
    return "\n".join(rows)


def random_code(count: int) -> bytes:
    """Random instructions of all formats, and some half words that are none."""
    random = np.random.default_rng(4)
    content = bytearray()
    while len(content) < 2 * count:
        low, high = (int(number) for number in random.integers(0, 1 << 16, 2))
        if random.integers(0, 2):
            low |= 0xF000
            high = high & ~0x7F0 | 0x7E0 if random.integers(0, 2) else high
        decoded = decode(low, high)
        content += low.to_bytes(2, "little")
        if decoded and decoded.size == 4:
            content += high.to_bytes(2, "little")
    return bytes(content)


@needs_llvm
def test_random_code_against_llvm() -> None:
    """Line by line, for plain memory."""
    lines = disassemble(random_code(20_000))
    known = [line for line in lines if line.code is not None]
    assert [line.text for line in known] == disassembled([line.content for line in known])
    unknown = [line for line in lines if line.code is None]
    assert unknown
    assert all(re.fullmatch(r"\.short 0x[0-9a-f]{4}", line.text) for line in unknown)
    assert b"".join(line.content for line in lines) == random_code(20_000)


def test_assembling_the_text_gives_the_same_text() -> None:
    """For random code; bytes may be fewer, because the assembler writes the shortest form."""
    texts = [line.text for line in disassemble(random_code(5_000)) if line.code is not None]
    program = assemble([AssemblySource("a.s", "\n".join(texts))])
    assert [line.text for line in disassemble(program.image[: program.sections[0].size])] == texts


def test_assembling_an_instruction_gives_its_bytes() -> None:
    """Unless the same text has another encoding, which the assembler prefers."""
    same = 0
    for line in disassemble(random_code(4_000)):
        if line.code is not None:
            program = assemble([AssemblySource("a.s", line.text)])
            content = program.image[: program.sections[0].size]
            same += content == line.content
            assert content == line.content or has_other_form(line.content, len(content)), line
    assert same > 1_500


def has_other_form(content: bytes, size: int) -> bool:
    """Whether a prefix is superfluous, a distance is 0, or 32 bits or an access by cp have two codes."""
    decoded = decode(*(int.from_bytes(content[place : place + 2], "little") for place in (0, 2)))
    assert decoded
    name = decoded.instruction.name
    prefixed = content[1] >> 2 == 0b111100 and size == 2
    return prefixed or (decoded.imm == 0 and decoded.instruction.backwards) or decoded.imm == 32 or name[:5] == "ldwcp"


def test_names_labels_and_targets() -> None:
    """Of a program, in which data are data."""
    program = assemble([AssemblySource("a.s", TEXT)])
    lines = disassemble(program)
    assert [(line.address - RAM_BASE, line.text) for line in lines] == [
        (0, "entsp 2"),
        (2, "ldw r0, dp[counter+0x4]"),
        (4, "ldaw r11, cp[table]"),
        (6, "bt r0, again"),
        (8, "bl other"),
        (10, "ldap r11, start"),
        (12, ".long 0x12345678"),
        (16, ".short 0x0201"),
        (18, "retsp 0"),
    ]
    assert [line.labels for line in lines if line.labels] == [("start", "_text"), ("again",), ("other",)]
    assert [line.target for line in lines[1:6]] == [
        program.symbols["counter"] + 4,
        program.symbols["table"],
        RAM_BASE + 6,
        RAM_BASE + 18,
        RAM_BASE,
    ]
    assert lines[3].code == BY_NAME["brbt"]
    assert lines[6].code is None
    data = disassemble(program, program.symbols["_cp"], program.end)
    assert [line.text for line in data] == [f".long 0x{number:08x}" for number in (5, 6, 7, 8, 9)]
    assert b"".join(line.content for line in data) == program.image[program.symbols["_cp"] - RAM_BASE :]


def test_targets_of_long_branches() -> None:
    """They count from the end of 4 bytes."""
    program = assemble([AssemblySource("a.s", "back: bt r0, far\n .space 3000\nfar: bl back\n bu far")])
    lines = [line for line in disassemble(program) if line.code is not None]
    assert [line.text for line in lines] == ["bt r0, far", "bl back", "bu far"]
    assert [len(line.content) for line in lines] == [4, 4, 2]


def test_listing() -> None:
    """Labels, addresses, bytes and text."""
    text = listing(disassemble(assemble([AssemblySource("a.s", "main: mul r0, r1, r2\n bu main")])))
    assert text == "main:\n_text:\n   10000  06f8 ec3f    mul r0, r1, r2\n   10004  0377         bu main\n"
    assert listing([]) == ""


def test_memory_with_the_names_of_a_program() -> None:
    """As a debugger shows it: other bytes than the program's, at its addresses; or with a map alone."""
    program = assemble([AssemblySource("a.s", TEXT)])
    memory = np.zeros(1 << 16, np.uint8)
    memory[: len(program.image)] = np.frombuffer(program.image, np.uint8)
    assert disassemble(memory, RAM_BASE, RAM_BASE + 20, program=program) == disassemble(program)
    memory[18:20] = (0xC1, 0x77)
    assert disassemble(memory, RAM_BASE + 18, RAM_BASE + 20, program=program)[0].text == "retsp 1"
    assert disassemble(read_map(program.map_text(), program.image)) == disassemble(program)
    assert disassemble(memory, RAM_BASE + 6, RAM_BASE + 8)[0].text == "bt r0, -1"


@pytest.mark.parametrize(
    ("start", "stop"), [(0x10001, 0x10004), (0x10004, 0x10002), (0xFFFE, 0x10002), (0x10000, 0x10006)]
)
def test_addresses_outside_are_refused(start: int, stop: int) -> None:
    """With the range."""
    with pytest.raises(ValueError, match="they must be even, in order, and from 0x10000 to 0x10004"):
        disassemble(bytes(4), start, stop)


def test_an_instruction_cut_off_is_data() -> None:
    """At the end of a memory."""
    assert [line.text for line in disassemble(b"\x06\xf8")] == [".short 0xf806"]
    assert [line.text for line in disassemble(b"\x06\xf8\xec\x3f", stop=RAM_BASE + 2)] == ["mul r0, r1, r2"]


@needs_clang
@pytest.mark.parametrize("name", sorted(ALL.keys() - {"branches"}))  # entries of .jmptable32 are longer than their text
def test_a_program_of_clang_can_be_assembled_again(name: str) -> None:
    """Its code, with names, gives the same bytes."""
    program = assemble([AssemblySource("c.s", compiled(ALL[name], "-O2")), AssemblySource("stubs.s", STUBS), runtime()])
    again = assembled_again(program)
    assert again.image == program.image


def assembled_again(program: LinkedProgram) -> LinkedProgram:
    """Disassemble everything and assemble the text, with .p2align where sections begin."""
    parts = [".text", as_source(disassemble(program))]
    for name, section in (("cp", ".cp.rodata"), ("dp", ".dp.data"), ("bss", ".dp.bss")):
        part = next(part for part in program.sections if part.name == name)
        parts += [f".section {section}", as_source(disassemble(program, part.address, part.address + part.size))]
    return assemble([AssemblySource("again.s", "\n".join(parts))])
