"""Break the reference device in one way at a time, and see whether the conformance suite notices.

A mutant is an entry of `mutants/*.toml`: a bug as C programmers make them, as a replacement of text. Each is built as a
shared library and judged in virtual time by the groups that its entry names (`python/phasewire_reference.py`)::

    python reference/mutants.py             # all of them, two at a time; exit code 1 if one gets away
    python reference/mutants.py NAME ...    # some of them
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

REFERENCE = Path(__file__).resolve().parent
SCRATCH = REFERENCE / "build" / "mutants"
WORKERS = 2
BUILD_SECONDS, JUDGE_SECONDS = 300, 900
FAILED = 1
"""The exit code of `phasewire conformance` if a case failed."""


class Mutant(NamedTuple):
    """A bug: its description, its file and text, and the groups of cases that catch it."""

    name: str
    what: str
    file: str
    changes: list[tuple[str, str]]
    only: list[str]
    speed: str
    """Of the bus, "high" or "full"."""

    @classmethod
    def of(cls, name: str, entry: Mapping[str, Any]) -> Mutant:
        """A mutant of its entry in a file."""
        changes = [(entry["was"], entry["is"]), *map(tuple, entry.get("also", ()))]
        return cls(name, entry["what"], entry["file"], changes, entry["only"], entry.get("speed", "high"))


def mutants() -> Iterator[Mutant]:
    """All of them, in the order of their files."""
    for path in sorted((REFERENCE / "mutants").glob("*.toml")):
        for name, entry in tomllib.loads(path.read_text()).items():
            yield Mutant.of(name, entry)


def broken(mutant: Mutant) -> str:
    """The text of its file with the bug; raises `ValueError` if it does not fit the file any more."""
    text = (REFERENCE / mutant.file).read_text()
    for was, becomes in mutant.changes:
        if text.count(was) != 1:
            raise ValueError(f"{mutant.name}: {was!r} stands {text.count(was)} times in {mutant.file}, not once")
        text = text.replace(was, becomes)
    return text


def build(mutant: Mutant) -> Path:
    """Build the library with the bug, from the objects of the one without it."""
    folder = SCRATCH / mutant.name
    shutil.rmtree(folder, ignore_errors=True)
    for part in ("core", "library", "posix", "build/gcc/pic"):
        shutil.copytree(REFERENCE / part, folder / part)
    shutil.copy2(REFERENCE / "Makefile", folder)
    (folder / mutant.file).write_text(broken(mutant))
    make = ["make", "-s", "-C", str(folder), "library", "CFLAGS=-std=c99 -w", "OPTIMISE=-O1"]
    subprocess.run(make, check=True, timeout=BUILD_SECONDS)
    return folder / "build" / "gcc" / "libphasewire-reference.so"


def judge(mutant: Mutant) -> str:
    """What the suite says of it: empty if a case failed, otherwise what happened instead."""
    library = build(mutant)
    options = ["--device", "reference:", "--capture", "reference:", "--levers", "reference:", "--stop-after", "1"]
    allowed = ["--allow", "reset", "--allow", "flash", "--allow", "drive"]
    only = [word for group in mutant.only for word in ("--only", group)]
    done = subprocess.run(
        [sys.executable, "-m", "phasewire", "conformance", *options, *allowed, *only],
        env={
            **os.environ,
            "PYTHONPATH": str(REFERENCE / "python"),
            "PHASEWIRE_REFERENCE": str(library),
            "PHASEWIRE_REFERENCE_SPEED": mutant.speed,
        },
        capture_output=True,
        text=True,
        timeout=JUDGE_SECONDS,
        check=False,
    )
    shutil.rmtree(SCRATCH / mutant.name, ignore_errors=True)
    if done.returncode == FAILED:
        return ""
    return f"exit code {done.returncode}: {(done.stdout + done.stderr).strip().splitlines()[-1:]}"


def main(names: list[str]) -> int:
    """Judge mutants; the exit code."""
    chosen = [mutant for mutant in mutants() if not names or mutant.name in names]
    if unknown := set(names) - {mutant.name for mutant in chosen}:
        print(f"no mutant {', '.join(sorted(unknown))}; {REFERENCE / 'mutants'} has them", file=sys.stderr)
        return 2
    subprocess.run(["make", "-s", "-C", REFERENCE, "library"], check=True, timeout=BUILD_SECONDS)
    escaped = 0
    with ThreadPoolExecutor(WORKERS) as pool:
        for mutant, instead in zip(chosen, pool.map(judge, chosen), strict=True):
            escaped += bool(instead)
            print(f"{'ESCAPED' if instead else 'caught '}  {mutant.name}: {instead or mutant.what}", flush=True)
    print(f"{len(chosen) - escaped} caught, {escaped} escaped")
    return 1 if escaped else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
