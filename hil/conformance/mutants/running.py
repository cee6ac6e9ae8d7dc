"""Run the suite against mutants, each in a process of its own, and judge the results.

A mutant changes the emulator of a whole process, and may crash or hang it. Neither is a catch: a case must fail.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from multiprocessing import connection, get_all_start_methods, get_context
from multiprocessing.context import ForkServerContext, SpawnContext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ....base.signals import postponing
from .patching import Mutant, applied

__all__ = ["DEFAULT_JOBS", "Fate", "MutantResult", "MutantWatcher", "run_mutants"]

TIME_OUT_SECONDS = 180.0
LOOK_SECONDS = 1.0
"""How long to wait for the end of a process before all are looked at: one may have exceeded its time."""
MOST_JOBS = 4
DEFAULT_JOBS = min(os.cpu_count() or 1, MOST_JOBS)
WARM = "phasewire.hil.conformance.mutants.warm"
ENOUGH = 2
"""After so many broken cases it is known that more than one catches the mutant."""
DOCUMENT = Path(__file__).parents[3] / "docs" / "reference" / "mutants.md"
ROW = re.compile(r"^\| `([^`]+)` \|.*\|([^|]*)\|$", re.MULTILINE)
CASE = re.compile(r"`([^`]+)`")


class Fate(StrEnum):
    """The fate of a mutant."""

    SURVIVED = "survived"
    CRASHED = "crashed"
    """The run crashed, or had trouble of its own."""
    HUNG = "hung"
    ONE_CASE = "one case"
    """Caught by a single case."""
    CAUGHT = "caught"

    @property
    def is_catch(self) -> bool:
        """Whether a case has shown the defect."""
        return self in (Fate.CAUGHT, Fate.ONE_CASE)


@dataclass(frozen=True)
class MutantResult:
    """The result of one mutant.

    Parameters
    ----------
    mutant : Mutant
    fate : Fate
    cases : tuple of str
        The cases that broke.
    why : str
        How the run crashed or hung; empty if it did not.
    seconds : float
        Duration by the wall clock.
    """

    mutant: Mutant
    fate: Fate
    cases: tuple[str, ...]
    why: str
    seconds: float


class MutantWatcher:
    """Receives the progress; this one does nothing."""

    def goes_on(self, mutants: Sequence[str], ended: int, of: int) -> None:
        """These mutants run now, and ``ended`` of all have ended."""

    def ended(self, result: MutantResult) -> None:
        """A mutant has ended."""


def recorded() -> dict[str, tuple[str, ...]]:
    """The cases that caught the mutants before, by the document that `reports.markdown` writes."""
    text = DOCUMENT.read_text("utf-8") if DOCUMENT.exists() else ""
    return {name: tuple(CASE.findall(cases)) for name, cases in ROW.findall(text)}


def judge_alone(name: str, enough: int | None, out: Path) -> None:
    """Judge a mutant of the catalogue in a process that is used for nothing else.

    The cases that caught it before run first. If one of them does not any more, cases of its clauses and its group run,
    and the others only if none of these catches it.

    Parameters
    ----------
    name : str
    enough : int or None
        The run ends after so many cases caught the mutant; None runs all cases.
    out : path
        The file for the result, as JSON.
    """
    from ..running import RunOptions, run_conformance
    from .warm import CASES, MUTANTS

    mutant = MUTANTS[name]
    plain = RunOptions(mutant.url, enough=enough, again=False)
    searches = [(plain, 0)]
    if enough:
        searches = [(replace(plain, only=mutant.names), 1), (replace(plain, enough=1), 1)]
        before = [case for case in recorded().get(name, ()) if case in CASES][:enough]
        if before:
            groups = tuple(dict.fromkeys(case.partition("/")[0] for case in before))
            again = replace(plain, only=tuple(before), groups=groups, enough=len(before))
            searches.insert(0, (again, len(before)))
    with applied(mutant):
        for options, least in searches:
            run = run_conformance(options)
            cases = list(dict.fromkeys(result.whole for result in run.results if result.breaks))
            if len(cases) >= least or run.trouble:
                break
    out.write_text(json.dumps({"cases": cases, "trouble": run.trouble}), encoding="utf-8")


Judgement = Callable[[str, int | None, Path], None]
"""Judges a mutant by its name until so many cases broke, and writes the result to a file; see `judge_alone`."""


def run_mutants(
    chosen: Sequence[Mutant],
    jobs: int,
    watcher: MutantWatcher,
    *,
    thorough: bool = False,
    judge: Judgement = judge_alone,
) -> list[MutantResult]:
    """Run the suite against each mutant.

    Parameters
    ----------
    chosen : sequence of Mutant
    jobs : int
        How many run at a time.
    watcher : MutantWatcher
    thorough : bool
        Whether all cases run, even after more than one has caught it.
    judge : callable
        The function that runs in each process; see `judge_alone`.

    Returns
    -------
    list of MutantResult
        In the order of the mutants. The processes end with this function, even after an exception.
    """
    waiting, running, results = deque(chosen), list[_Attempt](), dict[str, MutantResult]()
    with TemporaryDirectory() as folder, _ended_at_last(running):
        while waiting or running:
            while waiting and len(running) < jobs:
                with postponing():  # until the process is in `running`, which ends it in any case
                    running.append(_Attempt(waiting.popleft(), Path(folder), None if thorough else ENOUGH, judge))
                watcher.goes_on([attempt.mutant.name for attempt in running], len(results), len(chosen))
            connection.wait([attempt.sentinel for attempt in running], LOOK_SECONDS)
            for attempt in [attempt for attempt in running if attempt.is_over]:
                result = results[attempt.mutant.name] = attempt.result()
                running.remove(attempt)
                watcher.ended(result)
    return [results[mutant.name] for mutant in chosen]


@contextmanager
def _ended_at_last(attempts: list[_Attempt]) -> Iterator[None]:
    """End all processes in any case."""
    try:
        yield
    finally:
        for attempt in attempts:
            attempt.end()


class _Attempt:
    """A process that judges a mutant."""

    def __init__(self, mutant: Mutant, folder: Path, enough: int | None, judge: Judgement) -> None:
        self.mutant = mutant
        self._began = time.monotonic()
        self._out, self._errors = folder / f"{mutant.name}.json", folder / f"{mutant.name}.txt"
        self._process = _context().Process(
            target=_apart, args=(judge, mutant.name, enough, self._out, self._errors), daemon=True
        )
        self._process.start()

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._began

    @property
    def sentinel(self) -> int:
        """What is ready when the process has ended."""
        return self._process.sentinel

    @property
    def is_over(self) -> bool:
        """Whether it has ended or has exceeded its time."""
        return not self._process.is_alive() or self._seconds > TIME_OUT_SECONDS

    def result(self) -> MutantResult:
        """Its result; this ends the process."""
        code, seconds = self._process.exitcode, self._seconds
        self.end()
        found = judged(code, _text(self._out), _text(self._errors))
        return MutantResult(self.mutant, *found, seconds)

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()


@cache
def _context() -> ForkServerContext | SpawnContext:
    """How processes begin: if the system can do so, as forks of one that has loaded all modules that they need."""
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload(["__main__", WARM])
    return context


def _apart(judge: Judgement, name: str, enough: int | None, out: Path, errors: Path) -> None:
    """Judge in this process. Its output goes to a file, and keys of the terminal do not reach it."""
    if hasattr(os, "setsid"):
        os.setsid()
    with errors.open("wb") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    judge(name, enough, out)


def _text(path: Path) -> str:
    return path.read_text("utf-8", "replace") if path.exists() else ""


class MutantFinding(NamedTuple):
    """The judgement of a mutant, from the end of its process."""

    fate: Fate
    cases: tuple[str, ...] = ()
    why: str = ""


def judged(code: int | None, out: str, errors: str) -> MutantFinding:
    """Judge a mutant by the end of its process.

    Parameters
    ----------
    code : int or None
        Exit code; None if it did not end in time.
    out : str
        What `judge_alone` has written; empty if it wrote nothing.
    errors : str
        Its other output.
    """
    last = errors.strip().rpartition("\n")[2]
    if code is None:
        return MutantFinding(Fate.HUNG, why=f"not over after {TIME_OUT_SECONDS:g} s; last output: {last or 'none'}")
    if code or not out:
        return MutantFinding(Fate.CRASHED, why=f"exit code {code}: {last or 'no output'}")
    record = json.loads(out)
    cases = tuple(record["cases"])
    if record["trouble"]:
        return MutantFinding(Fate.CRASHED, cases, "; ".join(record["trouble"]))
    return MutantFinding((Fate.SURVIVED, Fate.ONE_CASE, Fate.CAUGHT)[min(len(cases), 2)], cases)
