"""Run the suite against mutants, each in a process of its own, and judge the results.

A mutant changes the emulator of a whole process, and may crash or hang it. Neither is a catch: a case must fail.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from multiprocessing import connection, get_all_start_methods, get_context
from multiprocessing.context import ForkServerContext, SpawnContext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ....base.signals import postponing
from ..running import RunOptions, run_conformance
from ..verdicts import Verdict
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
CRASH = re.compile(r"the suite did not expect this: (AttributeError|IndexError|NameError|TypeError)\b")
"""What cases say of a mutant that is broken in another way than it says: it names what the emulator does not have."""


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


class MutantRun(NamedTuple):
    """A run that may catch a mutant.

    Parameters
    ----------
    options : RunOptions
    least : int
        How many cases must break so that no further run is needed.
    """

    options: RunOptions
    least: int = 1

    @classmethod
    def of_cases(cls, plain: RunOptions, cases: Sequence[str]) -> MutantRun:
        """The run of some cases, by names that begin with their groups, until all break: it collects no other group."""
        groups = tuple(dict.fromkeys(case.partition("/")[0] for case in cases))
        return cls(replace(plain, only=tuple(cases), groups=groups, enough=len(cases)), len(cases))


def search(runs: Iterable[MutantRun], out: Path) -> None:
    """Make one run after the other until one has found enough; write what broke in it to a file, as JSON."""
    for options, least in runs:
        run = run_conformance(options)
        cases = list(dict.fromkeys(result.whole for result in run.results if result.breaks))
        if len(cases) >= least or run.trouble:
            break
    trouble = list(run.trouble)
    trouble += [f"{result.case}: {result.reason}" for result in run.results if CRASH.search(result.reason)]
    if not cases and not any(result.verdict is Verdict.PASS for result in run.results):
        trouble.append("no case was judged")
    out.write_text(json.dumps({"cases": cases, "trouble": trouble}), encoding="utf-8")


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
    from .warm import CASES, MUTANTS

    mutant = MUTANTS[name]
    plain = RunOptions(mutant.url, enough=enough, again=False)
    runs = [MutantRun(plain, 0)]
    if enough:
        runs = [MutantRun(replace(plain, only=mutant.names)), MutantRun(replace(plain, enough=1), 0)]
        if before := [case for case in recorded().get(name, ()) if case in CASES]:
            runs.insert(0, MutantRun.of_cases(plain, before[:enough]))
    with applied(mutant):
        search(runs, out)


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
        The results in the order of the mutants. The processes end with this function, even after an exception.
    """
    waiting, running, results = deque(chosen), dict[Mutant, Attempt](), dict[Mutant, MutantResult]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                mutant = waiting.popleft()
                with postponing():  # until the process is in `running`, which ends it in any case
                    running[mutant] = Attempt(judge, mutant.name, None if thorough else ENOUGH)
                watcher.goes_on([mutant.name for mutant in running], len(results), len(chosen))
            connection.wait([attempt.sentinel for attempt in running.values()], LOOK_SECONDS)
            for mutant, attempt in list(running.items()):
                if attempt.is_over:
                    finding = attempt.finding()
                    results[mutant] = MutantResult(mutant, *finding, attempt.seconds)
                    del running[mutant]
                    watcher.ended(results[mutant])
    finally:
        for attempt in running.values():
            attempt.end()
    return [results[mutant] for mutant in chosen]


class Attempt:
    """A process that judges a mutant: it calls a function, the last argument of which is the file for the result.

    Parameters
    ----------
    judge : callable
    *given
        Its other arguments.
    most : float
        The time that it has, s.
    warm : str
        The module that the process finds imported.
    """

    def __init__(
        self, judge: Callable[..., None], *given: object, most: float = TIME_OUT_SECONDS, warm: str = WARM
    ) -> None:
        self._began, self._most = time.monotonic(), most
        self._folder = TemporaryDirectory()
        self._out, self._errors = Path(self._folder.name) / "out.json", Path(self._folder.name) / "errors.txt"
        self._process = _context(warm).Process(target=_apart, args=(judge, given, self._out, self._errors), daemon=True)
        self._process.start()

    @property
    def seconds(self) -> float:
        """Duration so far, by the wall clock."""
        return time.monotonic() - self._began

    @property
    def sentinel(self) -> int:
        """What is ready when the process has ended."""
        return self._process.sentinel

    @property
    def is_over(self) -> bool:
        """Whether it has ended or has exceeded its time."""
        return not self._process.is_alive() or self.seconds > self._most

    def finding(self) -> MutantFinding:
        """The judgement, once it is over or its time is; this ends the process."""
        self._process.join(max(0.0, self._most - self.seconds))
        code = self._process.exitcode
        self._process.kill()
        self._process.join()
        found = judged(code, _text(self._out), _text(self._errors))
        self.end()
        return found

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self._folder.cleanup()


@cache
def _context(warm: str) -> ForkServerContext | SpawnContext:
    """How processes begin: if the system can do so, as forks of one that has loaded all modules that they need."""
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload([warm])
    return context


def _apart(judge: Callable[..., None], given: Sequence[object], out: Path, errors: Path) -> None:
    """Judge in this process. Its output goes to a file, and keys of the terminal do not reach it."""
    if hasattr(os, "setsid"):
        os.setsid()
    with errors.open("wb") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    judge(*given, out)


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
        return MutantFinding(Fate.HUNG, why=f"not over in time; last output: {last or 'none'}")
    if code or not out:
        return MutantFinding(Fate.CRASHED, why=f"exit code {code}: {last or 'no output'}")
    record = json.loads(out)
    cases = tuple(record["cases"])
    if record["trouble"]:
        return MutantFinding(Fate.CRASHED, cases, "; ".join(record["trouble"]))
    return MutantFinding((Fate.SURVIVED, Fate.ONE_CASE, Fate.CAUGHT)[min(len(cases), 2)], cases)
