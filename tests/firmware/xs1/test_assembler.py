"""The assembler and linker, against clang's own text, LLVM's disassembler, and values worked out by hand."""

import re
from collections.abc import Mapping

import numpy as np
import pytest
from phasewire.base.errors import InputFileError
from phasewire.firmware.xs1.assembler import AssemblySource, assemble, runtime
from phasewire.firmware.xs1.encoding import Decoded, decode
from phasewire.firmware.xs1.program import MEMORY_BYTES, RAM_BASE, Function, Line, LinkedProgram, Section, read_map
from phasewire.firmware.xs1.syntax import render

from tests.firmware.xs1.llvm import compiled, disassembled, needs_clang
from tests.firmware.xs1.programs import ALL, STUBS

JUMP_TARGET = re.compile(r"(bt|bf|bu|bl|ldap) (?:(r\d+), )?([\w.$]+)$")


def linked(*texts: str, defines: Mapping[str, int] | None = None) -> LinkedProgram:
    """A program from sources called a.s, b.s, …"""
    sources = [AssemblySource(f"{chr(97 + place)}.s", text) for place, text in enumerate(texts)]
    return assemble(sources, defines=defines)


def code_of(text: str, **defines: int) -> bytes:
    """The bytes of a program's code."""
    program = linked(text, defines=defines)
    return program.image[: program.sections[0].size]


def texts_of(program: LinkedProgram) -> list[str]:
    """The instructions of a program's code."""
    content, address, texts = program.image, 0, []
    while address < program.sections[0].size:
        low, high = (int.from_bytes(content[address + k : address + k + 2], "little") for k in (0, 2))
        decoded = decode(low, high)
        assert decoded
        texts.append(render(decoded))
        address += decoded.size
    return texts


def errors_of(*texts: str, defines: Mapping[str, int] | None = None) -> list[str]:
    """The lines of the error that sources have."""
    with pytest.raises(InputFileError) as caught:
        linked(*texts, defines=defines)
    return str(caught.value).splitlines()


# Against clang


@needs_clang
@pytest.mark.parametrize("options", [("-O2",), ("-O0",), ("-Os", "-g"), ("-O2", "-mcmodel=large")], ids=" ".join)
@pytest.mark.parametrize("name", ALL)
def test_what_clang_wrote_is_what_llvm_reads(name: str, options: tuple[str, ...]) -> None:
    """Instruction by instruction: registers and numbers as text, targets by address, data by the memory they name."""
    text = compiled(ALL[name], *options)
    program = assemble([AssemblySource("c.s", text), AssemblySource("stubs.s", STUBS), runtime()])
    lines = [line for line in program.lines if line.file == "c.s"]
    theirs = disassembled(
        [program.image[line.address - RAM_BASE :][: line.size] for line in lines if not table(line, text)]
    )
    labels = label_addresses(text, program)
    rows = text.splitlines()
    constants = {f"value of {name}": int(value) for name, value in re.findall(r"(\.LCPI\w+):\n\s*\.long\s+(\d+)", text)}
    checked = 0
    for line, their in zip([line for line in lines if not table(line, text)], theirs, strict=True):
        ours = " ".join(rows[line.number - 1].split())
        if ";" in ours:
            continue  # several in a line, from C
        assert their
        checked += 1
        ours = re.sub(r"^mov (.*)$", r"add \1, 0", re.sub(r"^\d+: ", "", ours))
        compare(ours, their, line.address + line.size, labels | constants, program)
    assert checked > 60


def table(line: Line, text: str) -> bool:
    """Whether a line is a jump table."""
    return ".jmptable" in text.splitlines()[line.number - 1]


def label_addresses(text: str, program: LinkedProgram) -> dict[str, int]:
    """Where clang's labels are: in code by the next instruction's line, else by the program's symbols."""
    found = dict(program.symbols)
    by_line = {line.number: line.address for line in reversed(program.lines) if line.file == "c.s"}
    waiting: list[str] = []
    for number, row in enumerate(text.splitlines(), 1):
        if match := re.match(r"([\w.$]+):", row):
            waiting.append(match[1])
        if number in by_line:
            found |= dict.fromkeys(waiting, by_line[number])
            waiting = []
        elif row.strip().startswith((".section", ".long", ".asci", ".byte", ".space")):
            waiting = []
    return found


def compare(ours: str, theirs: str, end: int, labels: Mapping[str, int], program: LinkedProgram) -> None:
    """An instruction of clang with the one that LLVM read from the bytes."""
    if match := re.fullmatch(r"(.*)\b(cp|dp)\[([A-Za-z_.][\w.$]*)(?:\+(\d+))?\](.*)", ours):
        start, pointer, symbol, extra, rest = match.groups()
        found = re.fullmatch(rf"{re.escape(start)}{pointer}\[(\d+)\]{re.escape(rest)}", theirs)
        assert found, (ours, theirs)
        if symbol in program.symbols:
            assert program.symbols[f"_{pointer}"] + 4 * int(found[1]) == program.symbols[symbol] + int(extra or 0)
        elif f"value of {symbol}" in labels:
            place = program.symbols["_cp"] + 4 * int(found[1]) - RAM_BASE
            assert int.from_bytes(program.image[place : place + 4], "little") == labels[f"value of {symbol}"]
    elif match := JUMP_TARGET.fullmatch(ours):
        start = f"{match[1]} {match[2]}, " if match[2] else f"{match[1]} "
        found = re.fullmatch(rf"{re.escape(start)}(-?\d+)", theirs)
        assert found, (ours, theirs)
        assert end + 2 * int(found[1]) == labels[match[3]], (ours, theirs)
    else:
        assert ours == theirs


@needs_clang
def test_data_of_clang() -> None:
    """Strings, numbers and addresses, as C means them."""
    program = assemble(
        [AssemblySource("c.s", compiled(ALL["data"], "-O2")), AssemblySource("stubs.s", STUBS), runtime()]
    )

    def at(name: str, size: int, extra: int = 0) -> bytes:
        place = program.symbols[name] + extra - RAM_BASE
        return program.image[place : place + size]

    def word(name: str, extra: int = 0) -> int:
        return int.from_bytes(at(name, 4, extra), "little")

    assert word("g") == 5
    assert program.image[word("str") - RAM_BASE :][:6] == b"hello\0"
    assert word("pg") == program.symbols["g"] + 8
    assert at("st", 14) == b'\x01\0\x02\0\x03\0\0\0ab\n"c\0'
    assert at("real", 8).hex() == "0000000000000c40"
    assert at("q", 8) == 0x123456789ABCDEF.to_bytes(8, "little")
    assert program.symbols["al"] % 16 == 0
    assert program.symbols["by"] % 4 == program.symbols["w"] % 4 == 0  # clang reaches them by words
    assert at("by", 5) == b"\x01\x02\xff\0\x04"
    assert at("w", 41) == b"quote\" back\\ tab\t nul\0x \x7f\xff # end, // ; 'x"[:41]
    assert [word("table", 4 * k) for k in range(3)] == [program.symbols[name] for name in ("f1", "ld", "f1")]
    assert program.symbols["bss.globound"] == 300
    assert "bss.globound" in program.constants
    assert program.symbols["bss"] >= program.symbols["_bss"] > program.symbols["g"] > program.symbols["ctab"]


# Relaxation


@pytest.mark.parametrize(("between", "size"), [(0, 2), (63, 2), (64, 4), (1023, 4), (65535 - 40000, 4)])
@pytest.mark.parametrize("branch", ["bu", "bt r3,", "bf r11,"])
def test_a_branch_forwards_is_as_short_as_possible(branch: str, between: int, size: int) -> None:
    """6 bits count half words from the end of the instruction."""
    assert len(code_of(f"{branch} there\n .space {2 * between}\nthere:")) == size + 2 * between


@pytest.mark.parametrize(("between", "size"), [(0, 2), (62, 2), (63, 4), (1022, 4)])
def test_a_branch_backwards_counts_itself(between: int, size: int) -> None:
    """It goes back over its own half words too."""
    content = code_of(f"there: .space {2 * between}\n bu there")
    assert len(content) == size + 2 * between
    assert render(decoded_at(content, 2 * between)) == f"bu {-between - size // 2}"


@pytest.mark.parametrize(("between", "size"), [(1023, 2), (1024, 4), (20000, 4)])
@pytest.mark.parametrize("word", ["bl", "ldap r11,"])
def test_calls_have_10_bits(word: str, between: int, size: int) -> None:
    """And 20 with a prefix."""
    assert len(code_of(f"{word} there\n .space {2 * between}\nthere:")) == size + 2 * between
    assert len(code_of(f"there: .space {2 * between - 2}\n {word} there")) == size + 2 * between - 2


def test_growing_branches_make_others_grow() -> None:
    """Each of 31 branches reaches the end if all are short, but the first does not, and so none before the last few."""
    text = "\n".join(["bu end"] * 66) + "\nend:"
    content = code_of(text)
    assert len(content) == 4 * (66 - 64) + 2 * 64
    assert render(decoded_at(content, 0)) == "bu 66"
    assert render(decoded_at(content, 8)) == "bu 63"


def decoded_at(content: bytes, place: int) -> Decoded:
    """The instruction at a place."""
    found = decode(*(int.from_bytes(content[place + skip : place + skip + 2], "little") for skip in (0, 2)))
    assert found
    return found


def test_a_branch_that_has_grown_stays_long() -> None:
    """Even if padding shrinks later, so that a short one would reach."""
    text = "ssync\n ssync\n bu far\n bu there\n .space 124\n .p2align 3\nthere: clre\n .space 200\nfar: clre"
    content = code_of(text)
    assert decoded_at(content, 8)[-2:] == (124, 4)
    assert render(decoded_at(content, 136)) == "clre"


def test_alignment_between_a_branch_and_its_target_is_counted() -> None:
    """With no-ops in code."""
    program = linked("bu there\n .p2align 4\nthere: retsp 0")
    assert texts_of(program) == ["bu 7", *["add r0, r0, 0"] * 7, "retsp 0"]


@pytest.mark.parametrize(("words", "size"), [(63, 2), (64, 4), (5000, 4)])
def test_accesses_to_data_are_as_short_as_possible(words: int, size: int) -> None:
    """6 bits count words from dp or cp; for r11 and cp there are 10 bits."""
    for pointer, section in (("dp", ".dp.data"), ("cp", ".cp.rodata")):
        text = f"ldw r3, {pointer}[there+4]\n .section {section}\n .space {4 * words - 4}\nthere: .long 1, 2"
        assert texts_of(linked(text))[0] == f"ldw r3, {pointer}[{words}]"
        assert len(code_of(text)) == size
    text = f"ldw r11, cp[there]\n .section .cp.rodata\n .space {4 * words}\nthere: .long 1"
    assert len(code_of(text)) == (2 if words < 1024 else 4)


# Jump tables


def test_a_jump_table_of_short_branches() -> None:
    """Each entry is a branch of 2 bytes."""
    program = linked("bru r0\n.jmptable a, b, a\na: retsp 0\nb: retsp 1")
    assert texts_of(program) == ["bru r0", "bu 2", "bu 2", "bu 0", "retsp 0", "retsp 1"]


@pytest.mark.parametrize(("between", "size"), [(62, 4 + 124), (63, 12 + 126)])
def test_entries_of_a_jump_table_at_the_limit(between: int, size: int) -> None:
    """63 half words, and one more: then the first entry's longer branch puts the target out of the second's reach."""
    assert len(code_of(f".jmptable far, far\n .space {2 * between}\nfar:")) == size


def test_entries_that_do_not_reach_go_by_a_longer_branch() -> None:
    """After the table; every entry stays 2 bytes long, because clang does not scale the index."""
    program = linked("bru r0\n.jmptable far, near, far\nnear: .space 200\nfar: retsp 0")
    content = program.image
    assert [render(decoded_at(content, 2 * k)) for k in range(4)] == ["bru r0", "bu 2", "bu 5", "bu 2"]
    assert render(decoded_at(content, 8)) == "bu 102"
    assert render(decoded_at(content, 12)) == "bu 100"
    assert program.image[16 + 200 :][:2] == code_of("retsp 0")


def test_the_largest_jump_table_of_far_entries() -> None:
    """clang uses up to 32 entries of this kind, all of which may be far."""
    program = linked(f"bru r0\n.jmptable {', '.join(['far'] * 32)}\n .space 4000\nfar: retsp 0")
    for index in range(32):
        first = decoded_at(program.image, 2 + 2 * index)
        place = 4 + 2 * index + first.imm
        second = decoded_at(program.image, place)
        assert place + 4 + second.imm == 2 + 32 * 6 + 4000
    many = f"bru r0\n.jmptable {', '.join(['far'] * 40)}\n .space 4000\nfar: retsp 0"
    assert errors_of(many)[0].endswith("40 entries are too many for branches of 2 bytes; use .jmptable32")


def test_jmptable32_has_entries_of_4_bytes() -> None:
    """Near and far, forwards and backwards."""
    program = linked("back: bru r0\n.jmptable32 near, far, back\nnear: .space 200\nfar: retsp 0")
    assert [render(decoded_at(program.image, 2 + 4 * k)) for k in range(3)] == ["bu 4", "bu 102", "bu -7"]


# Expressions and directives


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2+3*4", 14), ("(2+3)*4", 20), ("1<<4|3", 19), ("-5+0x10", 11), ("~0 & 0xff", 255), ("'A'", 65), (r"'\n'", 10),
        ("7/2", 3), ("7%4", 3), ("0b101", 5), ("017", 15), ("A*B", 42), ("b-a", 8), ("(b-a)/4+1", 3), ("6^3", 5),
        ("256>>3", 32), ("3<<1&4", 4),
    ],
)  # fmt: skip
def test_expressions(text: str, value: int) -> None:
    """As in C."""
    program = linked(f".equ A, 6\n .section .dp.data\n a: .long 1, 2\n b: .long {text}", defines={"B": 7})
    assert program.image[-4:] == value.to_bytes(4, "little")


def test_constants_in_instructions() -> None:
    """A number counts words after dp, cp and sp; .equ may come later, and a define replaces it."""
    text = "ldw r0, dp[N]\n ldc r1, N*2\n shl r2, r2, N-1\n add r3, r4, N\n entsp N\n setc res[r0], 0x8*N\n .equ N, 5"
    expected = [
        "ldw r0, dp[{0}]",
        "ldc r1, {1}",
        "shl r2, r2, {2}",
        "add r3, r4, {0}",
        "entsp {0}",
        "setc res[r0], {3}",
    ]
    assert texts_of(linked(text)) == [row.format(5, 10, 4, 40) for row in expected]
    assert texts_of(linked(text, defines={"N": 3})) == [row.format(3, 6, 2, 24) for row in expected]


def test_numbered_labels() -> None:
    """1b is the last 1 before, 1f the next one."""
    text = "1: bu 1f\n1: bt r0, 1b\n bu 1b\n2: bu 2b"
    assert texts_of(linked(text)) == ["bu 0", "bt r0, -1", "bu -2", "bu -1"]


def test_macros_repetitions_and_conditions() -> None:
    """With operands, defaults, a counter and defines."""
    text = """
    .macro both first, second=r5   // a comment
    out res[\\first], \\second
    in\\()shr \\second, res[\\first]
here\\@: bu here\\@
    .endm
    both r0, r1; both r2
    .rept COUNT
    .if COUNT == 0
    .endif
    .endr
    """.replace(".if COUNT == 0", ".if COUNT - 2")
    text += ".ifdef COUNT\n waiteu\n .else\n clre\n .endif\n .ifndef COUNT\n clre\n .endif"
    assert texts_of(linked(text, defines={"COUNT": 2})) == [
        "out res[r0], r1", "inshr r1, res[r0]", "bu -1", "out res[r2], r5", "inshr r5, res[r2]", "bu -1", "waiteu",
    ]  # fmt: skip
    assert texts_of(linked(".rept 3\n .rept 2\n ssync\n .endr\n clre\n .endr")) == ["ssync", "ssync", "clre"] * 3


def test_comments_and_strings() -> None:
    """A sign of a comment in a string is none."""
    text = """
    .section .cp.rodata
    /* all of
    this */ .asciz "a#b//c;d/*e*/\\x41\\101\\n"   # end
    .asciiz"glued"
    .ascii "no", "end" // end
    """
    assert linked(text).image.startswith(b"a#b//c;d/*e*/AA\n\0glued\0noend")


def test_sections_and_linker_symbols() -> None:
    """In the order text, cp, dp, bss, each from a word on; large data last."""
    program = linked(
        "start: retsp 0\n .section .dp.bss\n z: .space 5\n .section .dp.data\n d: .byte 1\n .section .cp.rodata"
        "\n c: .byte 2\n .section .dp.data.large\n large: .long 3\n .comm shared, 8, 8"
        "\n .section .debug_info\n junk here",
        ".section .dp.data\n e: .byte 4",
    )
    assert program.sections == (
        Section("text", 0x10000, 2), Section("cp", 0x10004, 1), Section("dp", 0x10008, 12), Section("bss", 0x10014, 20),
    )  # fmt: skip
    names = ("start", "c", "d", "e", "large", "z", "shared", "_text", "_cp", "_dp", "_bss", "_end")
    assert [program.symbols[name] - RAM_BASE for name in names] == [0, 4, 8, 12, 16, 20, 32, 0, 4, 8, 20, 40]
    assert len(program.image) == 40


def test_symbols_are_local_without_globl() -> None:
    """Two sources may have the same local names, and weak symbols give way."""
    first = ".globl main\nmain: bl help\n bl other\nhelp: retsp 1\n.weak other\nother: retsp 9"
    second = ".globl other\nother: bl help\nhelp: retsp 2"
    program = linked(first, second)
    assert texts_of(program)[:4] == ["bl 1", "bl 2", "retsp 1", "retsp 9"]
    assert program.symbols["a.s:help"] == 0x10004
    assert program.symbols["b.s:help"] == program.symbols["other"] + 2
    assert texts_of(linked("bl nobody\n .weak nobody", ".globl nobody\nnobody: retsp 0"))[0] == "bl 1"
    assert linked(".long nobody\n .weak nobody").image == bytes(4)


def test_a_weak_symbol_gives_way() -> None:
    """To one of another source, wherever that is; of two weak ones the first counts."""
    strong, weak, other = (f"{word} twice\ntwice: {code}" for word, code in (
        (".globl", "retsp 1"), (".weak", "retsp 2"), (".weak", "retsp 3"),
    ))  # fmt: skip
    for texts, expected in (((strong, weak), 1), ((weak, strong), 1), ((weak, other), 2), ((other, weak), 3)):
        program = linked("bl twice", *texts)
        place = program.symbols["twice"] - RAM_BASE
        assert render(decoded_at(program.image, place)) == f"retsp {expected}"
        assert decoded_at(program.image, 0).imm == place - 2


def test_only_used_parts_of_a_library_are_linked() -> None:
    """And what these use."""
    library = AssemblySource("l.s", "".join(
        f".cc_top {name}.function, {name}\n.globl {name}\n{name}: {code}\n.cc_bottom {name}.function\n"
        for name, code in {"a": "bl b", "b": "retsp 1", "c": "retsp 2"}.items()
    ), library=True)  # fmt: skip
    program = assemble([AssemblySource("m.s", "bl a"), library])
    assert [function.name for function in program.functions] == ["a", "b"]
    assert "c" not in program.symbols
    assert len(assemble([AssemblySource("m.s", "retsp 0"), runtime()]).image) <= 4


def test_functions_lines_and_map() -> None:
    """Sizes from .size, or up to the next function; the map can be read again."""
    text = (
        ".globl main\nmain: entsp 1\n loop: bl sub\n bu loop\n .type sub, @function\nsub: retsp 0\n.size sub, .-sub\n"
    )
    program = linked(
        text
        + " .globl t\n .type t, @object\nt: .long 7\n .equ SIZE, -4\n.section .dp.data\n.globl store\nstore: .long SIZE"
    )
    assert program.functions == (Function("main", 0x10000, 6), Function("sub", 0x10006, 2))
    assert program.code == ((0x10000, 0x10008),)
    assert [(line.address, line.size, line.number) for line in program.lines] == [
        (0x10000, 2, 2), (0x10002, 2, 3), (0x10004, 2, 4), (0x10006, 2, 6),
    ]  # fmt: skip
    function = program.function_at(0x10005)
    assert function
    assert function.name == "main"
    assert program.function_at(0x10008) is None
    assert program.describe(0x10004) == "loop+0x2"
    assert program.describe(0x20000) == "0x20000"
    again = read_map(program.map_text(), program.image)
    assert again.map_text() == program.map_text()
    assert (again.symbols, again.functions, again.code, again.sections) == (
        program.symbols, program.functions, program.code, program.sections,
    )  # fmt: skip
    assert again.constants == {"SIZE"}
    assert again.symbols["SIZE"] == -4


def test_a_map_fills_an_image_without_the_zeros_at_its_end() -> None:
    """By what begins as 0 at most."""
    program = linked('main: retsp 0\n .section .dp.data\nd: .long 7\n.section .dp.bss, "awd", @nobits\n.space 100')
    size = len(program.image)
    for left_out in (1, 50, 100):
        assert read_map(program.map_text(), program.image[:-left_out]).image == program.image
    with pytest.raises(InputFileError, match=f"about {size} bytes, but the image has {size - 101}"):
        read_map(program.map_text(), program.image[:-101])
    with pytest.raises(InputFileError, match=f"about {size} bytes, but the image has {size + 1}"):
        read_map(program.map_text(), program.image + bytes(1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: '' is no map"),
        ("phasewire xs1 map 1\nsymbol main", "map, line 2: 'symbol main' is no row of a map"),
        ("phasewire xs1 map 1\nbase 0 end 20000", "131072 bytes long"),
        ("phasewire xs1 map 1\nbase 10000 end 10008", "about 8 bytes, but the image has 4"),
    ],
)
def test_damaged_maps_are_refused(text: str, message: str) -> None:
    """With the line."""
    with pytest.raises(InputFileError, match=re.escape(message)):
        read_map(text, b"1234")


# Errors


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mvo r0, r1", "a.s:1: mvo r0, r1: mvo is no instruction; is it mov?"),
        ("nop\n add r0, r1", "a.s:1: nop: nop is no instruction"),
        ("\n add r0, r1", "a.s:2: add r0, r1: these are not its operands; write add register, register, register"),
        ("add r0, r1, sp", "these are not its operands"),
        ("ldw r0, sp[r1]", "these are not its operands"),
        ("add r0, r1, 12", "12 is not from 0 to 11, as add takes it"),
        ("ldaw r0, r1[-12]", "12 is not from 0 to 11, as ldaw takes it"),
        ("shl r0, r1, 9", "9 is not one of the possible numbers of bits, 1 to 8, 16, 24 and 32"),
        ("ldc r0, 65536", "the immediate of ldc is 0 to 65535, not 65536"),
        ("ldc r0, -1", "the immediate of ldc is at least 0, not -1"),
        ("ldc r0, there\nthere:", "an address where a number must be; load an address by ldaw or ldap"),
        ("bu nowhere", "a.s:1: bu nowhere: nowhere is not defined in any source"),
        ("bt r0, far\n .space 99000\nfar:", "99004 bytes, but a processor's memory has 65536: text 99004"),
        (".space 140000", "a space of 140000 bytes; a memory has 65536"),
        ("a: a:", "a is defined twice in this source"),
        (".equ a, 1\na:", "a is defined twice in this source"),
        ("a b: retsp 0", "a is no instruction"),
        ("ldw r0, dp[a]\n .section .dp.data\n .byte 1\na: .byte 2", "1 bytes after dp, but only words can be reached"),
        (".byte 300", "300 does not fit into 1 bytes"),
        (".byte 1\n retsp 0", "an instruction at an odd address; write .p2align 1 before it"),
        (".byte 1\na: .byte 2\n bu a", "the label is at an odd address; write .p2align 1 before it"),
        (".section .dp.data\n retsp 0", "an instruction in the section of data; write .text before it"),
        (".section .strange", "the section .strange is not known; use .text, .cp.rodata, .dp.data or .dp.bss"),
        (".unknown 3", "the directive .unknown is not known"),
        (".long 1 +", "'1 +' has the end where a number or a symbol must be"),
        (".long (1", "'(1' lacks a )"),
        (".long 1 2", "'1 2' has 2 where an operator must be"),
        (".long 1, , 2", "an operand is missing"),
        (".long 4/0", "4 / 0 has no value"),
        (".long a*2\na:", "* takes numbers, not addresses; a difference of two labels is a number"),
        (".long a+a\na:", "a sum of addresses has no meaning; a difference has"),
        (".long @", "'@' is no number, symbol or expression"),
        (".long 08", "08 begins with 0 but is no octal number"),
        (".long " + "(" * 5000, "the expression has too many brackets"),
        (".long 1 << 1000000000", "a number shifted by 1000000000 bits is too large; shift by up to 64"),
        (".p2align 40", ".p2align takes 0 to 15, not 40"),
        (".align 3", ".align takes a power of two, not 3"),
        (".space -1", "a space of -1 bytes; a memory has 65536"),
        (".space b-a+1\n .section .dp.data\na: .space b-a+1\nb:", "the size of a .space depends on itself"),
        (".equ a, b\n.equ b, a\n ldc r0, a", "is defined by itself"),
        (".ascii 5", "5 is no string in double quotes"),
        (r'.ascii "\q"', r"\q is no escape in a string"),
        ("bu 1b", "there is no label 1: before this line"),
        (".macro m\n retsp 0", ".macro lacks its .endm"),
        (".macro m a\n.endm\n m r0, r1", "the macro m takes 1 operands, not 2"),
        (".macro m\n m\n.endm\n m", "the macros expand without end"),
        (".rept 10000000\n.endr", ".rept takes 0 to 1000000, not 10000000"),
        (".if 1\n retsp 0", "an .if lacks its .endif"),
        (".else", ".else without an .if before it"),
        (".section .dp.data\n .jmptable a", "a jump table belongs into .text, after a bru"),
    ],
)  # fmt: skip
def test_errors_say_where_and_what_would_be_right(text: str, message: str) -> None:
    """A line for each."""
    assert any(message in line for line in errors_of(text))


def test_errors_of_several_sources() -> None:
    """All are reported, up to a limit; a symbol of another source is named."""
    assert errors_of("bu here", "here: retsp 0") == [
        "a.s:1: bu here: here is only known in b.s; write .globl here there"
    ]
    twice = ".globl here\nhere: retsp 0"
    assert errors_of(twice, twice) == ["b.s:2: here: retsp 0: here is defined in a.s too; drop one of them"]
    lines = errors_of("wrong\n" * 30)
    assert len(lines) == 21
    assert lines[-1] == "and 10 more errors"


def test_the_whole_memory_can_be_used() -> None:
    """And not a byte more."""
    assert len(linked(f".space {MEMORY_BYTES}").image) == MEMORY_BYTES
    assert "the largest functions are main 65538" in errors_of(f".globl main\nmain: retsp 0\n.space {MEMORY_BYTES}")[0]
    with pytest.raises(ValueError, match="base is 2; it must be a multiple of 4"):
        assemble([], base=2)


def test_damaged_sources_are_refused_or_assembled() -> None:
    """Whatever the text, the only error is the documented one, and it names the file."""
    random = np.random.default_rng(8)
    rows = [*runtime().text.splitlines(), *STUBS.splitlines(), *MANY_FORMS.splitlines()]
    signs = "[]()+-*/,.:;#\"'\\ \t01xr@<>|&~%$_\0é"
    messages = []
    for _ in range(300):
        taken = [rows[place] for place in random.integers(0, len(rows), random.integers(1, 12))]
        text = list("\n".join(taken))
        for place in random.integers(0, max(len(text), 1), random.integers(0, 4)).tolist():
            if place < len(text):
                text[place] = signs[random.integers(0, len(signs))]
        try:
            assemble([AssemblySource("a.s", "".join(text))])
        except InputFileError as error:
            messages.append(str(error))
    assert all(message.startswith("a.s:") for message in messages)
    assert 100 < len(messages) < 300


MANY_FORMS = r"""
 .equ N, 3*(2+1)
 .macro m a, b=4
 add r0, \a, \b
 .endm
 m r1
 .rept 2
 .if N
 .else
 .endif
 .endr
 .section .dp.data
 .long N, .L1-.L1, -1
 .comm c, 4, 4
 .asciz "text\n"
 .space N, 1
 .text
.L1: bu .L1
 .jmptable .L1, .L1
1: bt r0, 1b
 .size x, .-x
x: ldw r0, dp[x]
"""


def test_an_expression_of_too_many_terms_is_refused() -> None:
    with pytest.raises(InputFileError, match=r"long\.s: an expression has too many terms"):
        assemble([AssemblySource("long.s", "ldc r0, " + "1 + " * 3000 + "1")])
