"""``phasewire xs1``: its output and files, and wrong use."""

from __future__ import annotations

import json
import re
from functools import partial
from itertools import pairwise
from pathlib import Path

import phasewire.cli.xs1
import phasewire.firmware.xs1.clang
import pytest
from phasewire.firmware.xs1.assembler import AssemblySource, assemble
from vcd.reader import TokenKind, tokenize

from tests.cli.runner import Run
from tests.firmware.xs1.llvm import needs_clang

PLAY = """
# Counts on port 32A, a word each 200 core cycles from PERIOD on.
    .globl start
    .type start, @function
start:
    ldap r11, _cp
    set cp, r11
    ldw r0, cp[PORT]
    setc res[r0], 8
    ldw r1, cp[CLOCK]
    setc res[r1], 8
    ldc r2, 25
    setd res[r1], r2
    setclk res[r0], r1
    setc res[r1], 15
    ldc r2, FIRST
next:
    out res[r0], r2
    add r2, r2, 1
    bu next
    .size start, . - start
    .section .cp.rodata, "ac", @progbits
PORT:
    .long 0x200000
CLOCK:
    .long 0x106
"""
WAIT = """
start:
    ldw r0, r0[0]
    setc res[r0], 8
again:
    in r1, res[r0]
    bf r1, again
done:
    waiteu
"""
END = "start:\n    ldc r0, 1\n    waiteu\n"
TRAP = "start:\n    ldc r1, 2\n    ldw r2, r1[0]\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in {"play.s": PLAY, "wait.s": WAIT, "trap.s": TRAP, "end.s": END}.items():
        (tmp_path / name).write_text(text)
        program = assemble([AssemblySource(name, text)], defines={"FIRST": 7})
        (tmp_path / name).with_suffix(".bin").write_bytes(program.image)
        (tmp_path / name).with_suffix(".map").write_text(program.map_text())
    return tmp_path


@pytest.fixture
def xs1(folder: Path, phasewire: Run) -> Run:
    return partial(phasewire, "xs1")


# asm and disasm


@needs_clang
def test_asm_compiles_c(xs1: Run, folder: Path) -> None:
    """A function of C is called with operands in registers, by a program that gives it a stack."""
    (folder / "divide.h").write_text("unsigned long long divide(unsigned long long, unsigned);\n")
    (folder / "divide.c").write_text(
        '#include "divide.h"\nunsigned long long divide(unsigned long long a, unsigned b) { return a / b + OFFSET; }\n'
    )
    (folder / "main.s").write_text("    bl divide\ndone:\n    waiteu\n")
    assert xs1("asm", "main.s", "divide.c", "-D", "OFFSET=3", "-o", "divide.bin").code == 0
    # 2³³ + 5 over 2³: 2³⁰, and the offset
    registers = [f"--reg={text}" for text in ("r0=5", "r1=2", "r2=8", "r3=0", "sp=0x1fff0")]
    outcome = xs1("run", "divide.bin", *registers, "--json", "-")
    assert json.loads(outcome.out)["runs"][0]["threads"][0]["registers"]["r0"] == 2**30 + 3
    (folder / "divide.c").write_text("int f( {\n")
    outcome = xs1("asm", "divide.c", "-o", "divide.bin")
    assert outcome.code == 2
    assert re.search(r"^phasewire: divide\.c does not compile:\n.*divide\.c:1:\d+: error:", outcome.err)


def test_c_needs_clang(xs1: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phasewire.firmware.xs1.clang, "find_clang", lambda: None)
    (folder / "one.c").write_text("int one(void) { return 1; }\n")
    outcome = xs1("asm", "one.c", "-o", "one.bin")
    assert outcome.code == 2
    assert "one.c is C, and no clang with the target xcore is installed" in outcome.err
    assert not (folder / "one.bin").exists()


def test_list_is_the_disassembly(xs1: Run, folder: Path) -> None:
    listed = xs1("asm", "play.s", "-D", "FIRST=7", "-o", "made.bin", "--list").out
    outcome = xs1("disasm", "play.bin")
    assert listed.startswith(outcome.out)
    rows = [line.split(None, 2) for line in outcome.out.splitlines() if line.startswith("   1")]
    program = assemble([AssemblySource("play.s", PLAY)], defines={"FIRST": 7})
    texts = [" ".join(line.split()) for line in PLAY.splitlines() if line.startswith("    ") and "." not in line]
    assert len(rows) == len(texts)
    assert [int(row[0], 16) for row in rows] == [line.address for line in program.lines]
    assert "start:" in outcome.out
    assert re.search(r"bu next$", outcome.out, re.MULTILINE)


def test_disasm_of_a_part_and_without_a_map(xs1: Run, folder: Path) -> None:
    whole = xs1("disasm", "play.bin", "--start", "next").out
    part = xs1("disasm", "play.bin", "--start", "next", "--stop", hex(0x10000 + 30), "--json", "part.json")
    assert whole.startswith(part.out.rstrip("\n"))
    record = json.loads((folder / "part.json").read_text())
    assert record["format"] == "phasewire-disassembly-1"
    assert record["lines"][0]["labels"] == ["next"]
    assert record["lines"][0]["text"] == "out res[r0], r2"
    (folder / "play.map").unlink()
    outcome = xs1("disasm", "play.bin")
    assert "start" not in outcome.out
    assert len(re.findall(r"^   1", outcome.out, re.MULTILINE)) >= 18


# run and trace


def test_run_shows_end_threads_words_and_profile(xs1: Run, folder: Path) -> None:
    outcome = xs1("run", "play.bin", "--ms", "0.02", "--watch", "32A", "--profile", "--json", "run.json")
    assert outcome.code == 0, outcome.err
    (ran,) = json.loads((folder / "run.json").read_text())["runs"]
    assert (ran["ending"], ran["cycle"], ran["executed_to_cycle"]) == ("REACHED", 7999, 7999)
    words, cycles = ran["ports"]["32A"]["words"], ran["ports"]["32A"]["cycles"]
    assert words == list(range(7, 7 + len(words)))
    assert {later - earlier for earlier, later in pairwise(cycles)} == {200}
    out = re.sub(r" +$", "", outcome.out, flags=re.MULTILINE)
    assert re.search(rf"^off +all cycles were executed +7,999 +20\.0000 +{ran['instructions']}$", out, re.MULTILINE)
    assert re.search(r"^thread 0 paused at next, waits for an output \(port 32A\), until cycle", out, re.MULTILINE)
    assert re.search(rf"^ *{cycles[0]} +{cycles[0] * 0.0025:.4f} +0x00000007$", out, re.MULTILINE)
    assert f"and {len(words) - 24} more" in out
    assert re.search(rf"^start +{ran['instructions']} +{ran['instructions']} +100\.0% +#+$", out, re.MULTILINE)


def test_run_writes_a_vcd_file_with_the_same_words(xs1: Run, folder: Path) -> None:
    assert xs1("run", "play.bin", "--ms", "0.02", "--watch", "32A", "--vcd", "p.vcd", "--json", "r.json").code == 0
    port = json.loads((folder / "r.json").read_text())["runs"][0]["ports"]["32A"]
    time, seen = 0, []
    with (folder / "p.vcd").open("rb") as file:
        for token in tokenize(file):
            if token.kind is TokenKind.VAR:
                assert (token.var.reference, token.var.size) == ("port_32A", 32)
            elif token.kind is TokenKind.CHANGE_TIME:
                time = token.time_change
            elif token.kind is TokenKind.CHANGE_VECTOR:
                seen.append((time, token.vector_change.value))
    expected = [(25 * cycle, word) for cycle, word in zip(port["cycles"], port["words"], strict=True)]
    assert [change for change in seen if change != (0, 0)] == expected
    assert time == 25 * 8000


def test_inputs_may_be_given_in_any_order(xs1: Run, folder: Path) -> None:
    text = WAIT + "    .p2align 2\ntable:\n    .long 0x10400\n"
    (folder / "wait.s").write_text(text)
    assert xs1("asm", "wait.s", "-o", "wait.bin").code == 0
    shown = [
        xs1("run", "wait.bin", "--reg", "r0=table", *inputs.split(), "--json", "-").out
        for inputs in ("--input 1F=0:0,9000:1", "--input 1F=9000:1,0:0", "--input 1F=9000:1 --input 0x10400=0:0")
    ]
    assert json.loads(shown[0])["runs"][0]["cycle"] >= 9000
    assert shown[0] == shown[1] == shown[2]


def test_run_ends_at_a_place(xs1: Run) -> None:
    outcome = xs1("run", "play.bin", "--until", "next", "--json", "-")
    (ran,) = json.loads(outcome.out)["runs"]
    assert (ran["ending"], ran["cycle"], ran["instructions"]) == ("PLACE", 44, 12)


def test_a_trap_is_named_and_the_exit_code_is_1(xs1: Run) -> None:
    outcome = xs1("run", "trap.bin", "--json", "r.json")
    said = "thread 0 trapped in cycle 4 at start+0x2 (ldw r2, r1[0]): load or store, data 0x2"
    assert outcome.code == 1
    assert said in outcome.out
    trap = json.loads(Path("r.json").read_text())["runs"][0]["trap"]
    assert (trap["type"], trap["data"], trap["pc"], trap["place"]) == (5, 2, 0x10002, "start+0x2")
    assert said in xs1("trace", "trap.bin").out


def test_messages_are_shown(xs1: Run, folder: Path) -> None:
    (folder / "send.s").write_text(
        "start:\n    ldap r11, to\n    ldw r1, r11[0]\n    getr r0, 2\n    setd res[r0], r1\n    ldc r2, 0x5a\n"
        "    outt res[r0], r2\n    outct res[r0], 1\n    waiteu\n    .p2align 2\nto:\n    .long 0x00ff0702\n"
    )
    assert xs1("asm", "send.s", "-o", "send.bin").code == 0
    outcome = xs1("run", "send.bin")
    assert "Messages to other nodes: 1." in outcome.out
    assert re.search(
        r"^cycles \d+ to \d+: from channel end 0 to node 0x00ff, channel end 7: 5a \[01\]$", outcome.out, re.M
    )


def test_trace_says_why_there_is_no_more(xs1: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phasewire.cli.xs1, "MOST_TRACED", 5000)
    outcome = xs1("trace", "play.bin", "--thread", "3")
    assert outcome.code == 0
    assert outcome.out.splitlines()[1] == "No more in the 5,000 cycles from cycle 0 on."
    outcome = xs1("trace", "wait.bin", "--reg", "r0=0x1fffc", "--count", "9")
    assert outcome.code == 0
    assert "illegal resource" in outcome.out
    assert "Nothing can happen any more after cycle" in xs1("trace", "end.bin").out
    view = xs1("trace", "play.bin", "--count", "0", "--view").out
    assert view.splitlines()[1].startswith("cycle ")


def masked(text: str) -> list[str]:
    """Lines without numbers, bars and spaces: another clang makes other code."""
    return [re.sub(r"[\d,.%#]+|\s+", "", line) for line in text.rstrip("…\n").splitlines()]


@needs_clang
def test_the_commands_of_the_document_show_what_it_shows(phasewire: Run, folder: Path) -> None:
    document = (Path(__file__).parents[2] / "docs/how-to/xs1.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", document, re.MULTILINE | re.DOTALL)
    play, mean, main = [text for _, text in blocks if text.startswith(("# Plays", "# Calls", "unsigned"))]
    for name, text in {"play.s": play, "main.s": main, "mean.c": mean}.items():
        (folder / name).write_text(text)
    command = said = ""
    for kind, text in blocks:
        if kind == "sh":
            for command in text.splitlines():
                outcome = phasewire(*command.split()[1:])
                assert outcome.code == 0, outcome.err
                said = outcome.out
        elif kind == "text" and text not in (play, main):
            shown, seen = text.rstrip("…\n").splitlines(), [line.rstrip() for line in said.splitlines()]
            if "play.bin" in command:
                assert seen[: len(shown)] == shown
            elif "trace" in command:
                assert seen[0] == shown[0]
            else:
                assert masked(said) == masked(text)
    assert (folder / "mine.dfu").exists()


# Wrong use


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("asm none.s -o x.bin", "none.s: No such file"),
        ("asm play.bin -o x.bin", "play.bin is no source; give assembly, FILE.s, or C, FILE.c"),
        ("asm play.s -o play.s", "play.s cannot be written: it is also what is read"),
        ("asm play.s -o x.map", "x.map cannot be written: it is to be written twice"),
        ("asm play.s -o x.bin", "play.s:16: ldc r2, FIRST: FIRST is not defined"),
        ("asm play.s -D FIRST -o x.bin", "-D FIRST: write NAME=VALUE with a number, such as PERIODS=40"),
        ("asm play.s -D 1=2 -o x.bin", "-D 1=2: write NAME=VALUE"),
        ("asm play.s -D FIRST=x -o x.bin", "-D FIRST=x: write NAME=VALUE"),
        ("asm large.s -o x.bin", "70000 bytes, but a processor's memory has 65536"),
        ("disasm none.bin", "none.bin: No such file"),
        ("disasm empty.bin", "empty.bin is empty; a program has 1 to 65536 bytes"),
        ("disasm large.bin", "large.bin has 70000 bytes; such a file may have at most 65536"),
        ("disasm play.bin --start strat", "unknown symbol 'strat': near it are start; or write an address"),
        ("disasm nomap.bin --start start", "unknown symbol 'start': there is no map; or write an address"),
        ("disasm play.bin --start 0x20000", "address 0x20000 is not in the program, which is from 0x10000 to 0x100"),
        ("disasm play.bin --start 0x10001", "they must be even"),
        ("disasm play.bin --map trap.map", "trap.map is about 4 bytes, but the image has"),
        ("disasm play.bin --map play.s", "is no map; it must be 'phasewire xs1 map 1'"),
        ("disasm play.bin --json play.bin", "play.bin cannot be written: it is also what is read"),
        ("run play.bin --watch 1Q", "unknown port '1Q'; known are 1A to 1P"),
        ("run play.bin --input 1Q=0:1", "unknown port '1Q'"),
        ("run play.bin --input 1F=0", "--input 1F=0: write PORT=CYCLE:VALUE,CYCLE:VALUE, such as 1F=0:0,4000:1"),
        ("run play.bin --input 1F", "--input 1F: write PORT=CYCLE:VALUE"),
        ("run play.bin --input 1F=-1:0", "--input 1F=-1:0: write PORT=CYCLE:VALUE"),
        ("run play.bin --input 1F=0:2", "--input 1F=0:2: 2 does not fit port 1F, whose width is 1 bit"),
        ("run play.bin --input 8C=0:-1", "-1 does not fit port 8C, whose width is 8 bit"),
        ("run play.bin --input 1F=999999999999999:1", "a cycle is 0 to 100,000,000,000"),
        ("run play.bin --reg r12=1", "--reg r12=1: unknown register 'r12'; known are r0, r1"),
        ("run play.bin --reg r0", "--reg r0: write REGISTER=VALUE with a number or a symbol, such as r0=0x20"),
        ("run play.bin --reg r0=0x100000000", "--reg r0=0x100000000: write REGISTER=VALUE"),
        ("run play.bin --cycles 5 --ms 1", "give --cycles or --ms, not both"),
        ("run play.bin --cycles 0", "Invalid value for '--cycles'"),
        ("run play.bin --ms nan", "--ms nan ms: give 0.0000025 ms (one cycle) to 250,000 ms"),
        ("run play.bin --ms 1e9", "--ms 1e+09 ms: give 0.0000025 ms"),
        ("run play.bin --fetch some", "--fetch some: it is off, pessimistic or both"),
        ("run play.bin --vcd x.vcd", "--vcd needs a port to write: name it by --watch, such as --watch 32A"),
        ("run play.bin --until 0x10001", "0x10001 is 0x10001, where no instruction can be"),
        ("run play.bin --until PORT --until _end", "_end is 0x10"),
        ("trace play.bin --fetch both", "--fetch both: it is off or pessimistic"),
        ("trace play.bin --from CLOCK", "--from CLOCK: the program does not come there within 40,000,000 cycles"),
        ("trace play.bin --from 999999999999999", "--from 999999999999999: a cycle is 0 to"),
        ("trace play.bin --count -1", "Invalid value for '--count'"),
    ],
)
def test_wrong_use_is_refused_and_changes_no_file(xs1: Run, folder: Path, line: str, said: str) -> None:
    (folder / "empty.bin").write_bytes(b"")
    (folder / "large.bin").write_bytes(bytes(70_000))
    (folder / "large.s").write_text("    .space 70000\n")
    (folder / "nomap.bin").write_bytes((folder / "play.bin").read_bytes())
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    outcome = xs1(*line.split())
    assert (outcome.code, outcome.out) == (2, "")
    assert said in " ".join(outcome.err.split())
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
