"""Bugs as changes of a source's text, put into programs that are not Python: the C reference device, the firmware.

An entry of a TOML file is one: its name, `what` is wrong, the `file`, the text that it `was` and that it `is`, more
pairs of these in `also`, and the cases that catch it, `only`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["TextMutant", "TextOutcome", "judge_all", "read_text_mutants", "run_cases"]

WORKERS = 2
JUDGE_SECONDS = 900
ENTRY = {"what", "file", "was", "is", "also", "only"}
"""The keys of an entry that all have."""
PASSED, FAILED = 0, 1
"""Exit codes of `phasewire conformance`."""
FAIL = "fail"
"""A case's verdict in its report."""


class TextMutant(NamedTuple):
    """A bug, as a change of text.

    Parameters
    ----------
    name : str
    what : str
        What is wrong.
    file : str
        The source.
    changes : tuple of (str, str)
        What the text was, and what it is; it stands once in the source.
    only : tuple of str
        The cases or groups that catch it.
    others : mapping
        Further keys of the entry.
    """

    name: str
    what: str
    file: str
    changes: tuple[tuple[str, str], ...]
    only: tuple[str, ...]
    others: Mapping[str, Any]

    def broken(self, text: str) -> str:
        """The source with the bug.

        Parameters
        ----------
        text : str
            The source.

        Raises
        ------
        ValueError
            If the bug does not fit it any more.
        """
        for was, becomes in self.changes:
            if text.count(was) != 1:
                raise ValueError(f"{self.name}: {was!r} stands {text.count(was)} times in {self.file}, not once")
            text = text.replace(was, becomes)
        return text


def read_text_mutants(*paths: Path) -> Iterator[TextMutant]:
    """All of some files, in their order."""
    for path in paths:
        for name, entry in tomllib.loads(path.read_text("utf-8")).items():
            changes = ((entry["was"], entry["is"]), *((was, becomes) for was, becomes in entry.get("also", ())))
            others = {key: value for key, value in entry.items() if key not in ENTRY}
            yield TextMutant(name, entry["what"], entry["file"], changes, tuple(entry["only"]), others)


class TextOutcome(NamedTuple):
    """What cases said of a device.

    Parameters
    ----------
    right : bool
        Whether it is what should happen: of a mutant, that a case failed.
    words : str
        The cases that failed, or what happened instead.
    """

    right: bool
    words: str


def run_cases(
    options: Sequence[str], only: Sequence[str], *, passes: bool = False, environment: Mapping[str, str] | None = None
) -> TextOutcome:
    """Run cases against a device in a process of their own.

    Parameters
    ----------
    options : sequence of str
        Of `phasewire conformance`: the device, and what acts on it.
    only : sequence of str
        The cases or groups.
    passes : bool
        Whether all cases should pass; otherwise one should fail, and the first that does ends the run.
    environment : mapping, optional
        Further variables of the environment.
    """
    chosen = [word for name in only for word in ("--only", name)]
    ends = [] if passes else ["--stop-after", "1"]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "phasewire", "conformance", *options, *ends, *chosen, "--json", "-"],
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            timeout=JUDGE_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return TextOutcome(False, f"not over after {JUDGE_SECONDS} s")
    right = done.returncode == (PASSED if passes else FAILED)
    if not done.stdout.startswith("{"):
        return TextOutcome(False, f"exit code {done.returncode}: {done.stderr.strip().splitlines()[-1:]}")
    report = json.loads(done.stdout)
    broken = [result["case"] for result in report["results"] if result["verdict"] == FAIL]
    return TextOutcome(right and not report["trouble"], ", ".join(broken) or f"{report['summary']} {report['trouble']}")


def judge_all(
    names: Sequence[str],
    known: Sequence[TextMutant],
    judge: Callable[[TextMutant], TextOutcome],
    *,
    workers: int = WORKERS,
) -> int:
    """Judge mutants and print what came of each.

    Parameters
    ----------
    names : sequence of str
        Of those to judge; none for all.
    known : sequence of TextMutant
        All that there are.
    judge : callable
        Runs the cases that should catch a mutant.
    workers : int
        How many are judged at a time.

    Returns
    -------
    int
        The exit code: 1 if one got away, 2 if a name is unknown.
    """
    if unknown := set(names) - {mutant.name for mutant in known}:
        sys.stderr.write(f"no mutant {', '.join(sorted(unknown))}\n")
        return 2
    chosen = [mutant for mutant in known if not names or mutant.name in names]
    escaped = 0
    with ThreadPoolExecutor(workers) as pool:
        for mutant, found in zip(chosen, pool.map(judge, chosen), strict=True):
            escaped += not found.right
            sys.stdout.write(f"{'caught ' if found.right else 'ESCAPED'}  {mutant.name}: {found.words}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{len(chosen) - escaped} caught, {escaped} escaped\n")
    return 1 if escaped else 0
