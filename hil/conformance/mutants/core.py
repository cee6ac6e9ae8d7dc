"""Break the reference device in one way at a time, and see whether the conformance suite notices.

A mutant is an entry of `core/*.toml`: a bug as C programmers make them, in the form of `texts`.
Each is built as a shared library and judged in virtual time by the cases that its entry names
(`firmware/python/phasewire_reference.py`)::

    python -m phasewire.hil.conformance.mutants.core             # all, one a core; exit code 1 if one gets away
    python -m phasewire.hil.conformance.mutants.core NAME ...    # some of them
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from ..cases import Risk
from ..running import RunOptions
from .texts import TextMutant, TextOutcome, judge_all, read_text_mutants, run_cases

HERE = Path(__file__).resolve().parent
REFERENCE = HERE.parents[2] / "firmware"
BUILD_SECONDS = 300
DEVICE = RunOptions(
    "reference:",
    "reference:",
    ("reference:",),
    frozenset({Risk.RESET, Risk.FLASH, Risk.DRIVE}),
    doors=("reference-uart:",),
)
SPEED = "speed"
"""The key of an entry that names the speed of the bus, "high" or "full"."""


def build(mutant: TextMutant, folder: Path) -> Path:
    """Build the library with the bug in an empty folder, from the objects of the one without it."""
    for part in ("core", "library", "posix", "build/gcc/pic"):
        shutil.copytree(REFERENCE / part, folder / part)
    shutil.copy2(REFERENCE / "Makefile", folder)
    (folder / mutant.file).write_text(mutant.broken((REFERENCE / mutant.file).read_text()))
    make = ["make", "-s", "-C", str(folder), "library", "CFLAGS=-std=c99 -w", "OPTIMISE=-O1"]
    subprocess.run(make, check=True, timeout=BUILD_SECONDS)
    return folder / "build" / "gcc" / "libphasewire-reference.so"


def judge(mutant: TextMutant) -> TextOutcome:
    """What the suite says of it."""
    with TemporaryDirectory() as folder:
        built = str(build(mutant, Path(folder)))
        environment = {
            "PHASEWIRE_REFERENCE": built,
            "PHASEWIRE_REFERENCE_SPEED": mutant.others.get(SPEED, "high"),
        }
        return run_cases(DEVICE, mutant, environment=environment)


def main(names: list[str]) -> int:
    """Judge mutants; the exit code."""
    subprocess.run(["make", "-s", "-C", REFERENCE, "library"], check=True, timeout=BUILD_SECONDS)
    python = str(REFERENCE / "python")
    sys.path.insert(0, python)  # for the judging processes, which get this list
    os.environ["PYTHONPATH"] = python + os.pathsep + os.environ.get("PYTHONPATH", "")  # for the one that they fork from
    return judge_all(names, list(read_text_mutants(*sorted((HERE / "core").glob("*.toml")))), judge)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
