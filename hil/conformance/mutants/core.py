"""Break the reference device in one way at a time, and see whether the conformance suite notices.

A mutant is an entry of `core/*.toml`: a bug as C programmers make them, in the form of `texts`.
Each is built as a shared library and judged in virtual time by the groups that its entry names
(`firmware/python/phasewire_reference.py`)::

    python -m phasewire.hil.conformance.mutants.core             # all, two at a time; exit code 1 if one gets away
    python -m phasewire.hil.conformance.mutants.core NAME ...    # some of them
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from phasewire.hil.conformance.mutants.texts import TextMutant, TextOutcome, judge_all, read_text_mutants, run_cases

HERE = Path(__file__).resolve().parent
REFERENCE = HERE.parents[2] / "firmware"
SCRATCH = REFERENCE / "build" / "mutants"
BUILD_SECONDS = 300
OPTIONS = ("--device", "reference:", "--door", "reference-uart:", "--capture", "reference:", "--levers", "reference:")
ALLOWED = ("--allow", "reset", "--allow", "flash", "--allow", "drive")
SPEED = "speed"
"""The key of an entry that names the speed of the bus, "high" or "full"."""


def build(mutant: TextMutant) -> Path:
    """Build the library with the bug, from the objects of the one without it."""
    folder = SCRATCH / mutant.name
    shutil.rmtree(folder, ignore_errors=True)
    for part in ("core", "library", "posix", "build/gcc/pic"):
        shutil.copytree(REFERENCE / part, folder / part)
    shutil.copy2(REFERENCE / "Makefile", folder)
    (folder / mutant.file).write_text(mutant.broken((REFERENCE / mutant.file).read_text()))
    make = ["make", "-s", "-C", str(folder), "library", "CFLAGS=-std=c99 -w", "OPTIMISE=-O1"]
    subprocess.run(make, check=True, timeout=BUILD_SECONDS)
    return folder / "build" / "gcc" / "libphasewire-reference.so"


def judge(mutant: TextMutant) -> TextOutcome:
    """What the suite says of it."""
    environment = {
        "PYTHONPATH": str(REFERENCE / "python"),
        "PHASEWIRE_REFERENCE": str(build(mutant)),
        "PHASEWIRE_REFERENCE_SPEED": mutant.others.get(SPEED, "high"),
    }
    found = run_cases([*OPTIONS, *ALLOWED], mutant.only, environment=environment)
    shutil.rmtree(SCRATCH / mutant.name, ignore_errors=True)
    return found


def main(names: list[str]) -> int:
    """Judge mutants; the exit code."""
    subprocess.run(["make", "-s", "-C", REFERENCE, "library"], check=True, timeout=BUILD_SECONDS)
    return judge_all(names, list(read_text_mutants(*sorted((HERE / "core").glob("*.toml")))), judge)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
