"""LLVM's disassembler and compiler for the XS1, if they are installed: what the assembler is compared with."""

import re
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache

import pytest

XCORE = ("--triple=xcore", "--disassemble")


@cache
def find(program: str) -> str | None:
    """The path of a program of LLVM that knows the XS1, or None."""
    asks = "--version" if program == "llvm-mc" else "--print-targets"
    for name in (program, *(f"{program}-{version}" for version in range(25, 12, -1))):
        if path := shutil.which(name):
            targets = subprocess.run([path, asks], capture_output=True, text=True, check=True).stdout
            if re.search(r"^\s+xcore\b", targets, re.MULTILINE):
                return path
    return None


needs_llvm = pytest.mark.skipif(find("llvm-mc") is None, reason="not installed: llvm-mc with xcore")
needs_clang = pytest.mark.skipif(
    find("clang") is None or find("llvm-mc") is None, reason="not installed: clang and llvm-mc with xcore"
)


def disassembled(rows: Sequence[bytes]) -> list[str | None]:
    """The text of each instruction, None if LLVM knows no such instruction."""
    program = find("llvm-mc")
    assert program
    text = "".join("[" + " ".join(f"0x{byte:02x}" for byte in row) + "]\n" for row in rows)
    ran = subprocess.run([program, *XCORE], input=text, capture_output=True, text=True, check=False)
    bad = {int(number) for number in re.findall(r"<stdin>:(\d+):\d+: warning", ran.stderr)}
    lines = iter([" ".join(line.split()) for line in ran.stdout.splitlines() if line.strip() not in ("", ".text")])
    texts = [None if number in bad else next(lines) for number in range(1, len(rows) + 1)]
    assert next(lines, None) is None
    return texts


def compiled(source: str, *options: str) -> str:
    """What clang makes of C."""
    program = find("clang")
    assert program
    command = [program, "--target=xcore", "-w", "-S", "-x", "c", "-", "-o", "-", *options]
    return subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout
