"""Bugs as changes of a source's text, put into programs that are not Python: the C reference device, the firmware.

An entry of a TOML file is one: its name, `what` is wrong, the `file`, the text that it `was` and that it `is`, more
pairs of these in `also`, the cases or groups that catch it, `only`, and the `case` among these that runs first.
"""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ..running import RunOptions
from .running import WARM, Attempt, Fate, MutantRun, search

__all__ = ["TextMutant", "TextOutcome", "judge_all", "read_text_mutants", "run_cases"]

WORKERS = os.cpu_count() or 1
JUDGE_SECONDS = 900
ENTRY = {"what", "file", "was", "is", "also", "only", "case"}
"""The keys of an entry that all have."""


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
        The beginnings of the cases that catch it, or their groups.
    case : str
        One of these that has caught it before; empty if none is known.
    others : mapping
        Further keys of the entry.
    """

    name: str
    what: str
    file: str
    changes: tuple[tuple[str, str], ...]
    only: tuple[str, ...]
    case: str
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
            yield TextMutant(
                name, entry["what"], entry["file"], changes, tuple(entry["only"]), entry.get("case", ""), others
            )


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


def judge_cases(runs: Sequence[MutantRun], environment: Mapping[str, str], out: Path) -> None:
    """Judge a device in a process that is used for nothing else, with further variables of the environment."""
    os.environ.update(environment)
    search(runs, out)


def run_cases(
    device: RunOptions,
    mutant: TextMutant,
    *,
    passes: bool = False,
    environment: Mapping[str, str] | None = None,
    warm: str = WARM,
) -> TextOutcome:
    """Run the cases of a mutant against a device, in a process of their own.

    Parameters
    ----------
    device : RunOptions
        The device, and what acts on it.
    mutant : TextMutant
        Its ``case`` runs first, and ``only`` if this does not fail.
    passes : bool
        Whether all cases should pass; otherwise one should fail, and the first that does ends the run.
    environment : mapping, optional
        Further variables of the environment.
    warm : str
        The module that the process finds imported.
    """
    device = replace(device, again=False)
    runs = [MutantRun.of_cases(device, [mutant.case])] if mutant.case else []
    last = MutantRun.of_cases(device, mutant.only)
    runs.append(last._replace(options=replace(last.options, enough=None if passes else 1), least=0))
    found = Attempt(judge_cases, runs, environment or {}, most=JUDGE_SECONDS, warm=warm).finding()
    right = found.fate is Fate.SURVIVED if passes else found.fate.is_catch
    return TextOutcome(right, ", ".join(found.cases) or found.why or "PASS")


def judge_all(
    names: Sequence[str],
    known: Sequence[TextMutant],
    judge: Callable[[TextMutant], TextOutcome],
) -> int:
    """Judge mutants and print what came of each.

    Parameters
    ----------
    names : sequence of str
        The names of those to judge; none for all.
    known : sequence of TextMutant
        All that there are.
    judge : callable
        Runs the cases that should catch a mutant.

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
    with ThreadPoolExecutor(WORKERS) as pool:
        for mutant, found in zip(chosen, pool.map(judge, chosen), strict=True):
            escaped += not found.right
            sys.stdout.write(f"{'caught ' if found.right else 'ESCAPED'}  {mutant.name}: {found.words}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{len(chosen) - escaped} caught, {escaped} escaped\n")
    return 1 if escaped else 0
