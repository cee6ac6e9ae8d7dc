"""Running the suite against mutants, each in a process of its own, and what came of them.

A mutant changes the emulator of a whole process, and may crash it or hang. That is no catch: a case has to fail.
"""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.context import ForkServerContext, SpawnContext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ..signals import postponing
from .patching import Mutant, applied

__all__ = ["DEFAULT_JOBS", "Fate", "MutantResult", "MutantWatcher", "run_mutants"]

TIME_OUT_SECONDS = 180.0
LOOK_SECONDS = 0.05
MOST_JOBS = 4
DEFAULT_JOBS = min(os.cpu_count() or 1, MOST_JOBS)
WARM = "phasewire.mutants.warm"
ENOUGH = 2
"""Cases that break, after which it is known that a mutant is caught by more than one."""


class Fate(StrEnum):
    """What became of a mutant."""

    SURVIVED = "survived"
    CRASHED = "crashed"
    """The run did not come to its end, or was not in order."""
    HUNG = "hung"
    ONE_CASE = "one case"
    """Caught, by a single case."""
    CAUGHT = "caught"

    @property
    def is_catch(self) -> bool:
        """Whether a case has shown what is wrong."""
        return self in (Fate.CAUGHT, Fate.ONE_CASE)


@dataclass(frozen=True)
class MutantResult:
    """What came of one mutant.

    Parameters
    ----------
    mutant : Mutant
    fate : Fate
    cases : tuple of str
        Those that broke.
    why : str
        How the run crashed or hung; empty where it did not.
    seconds : float
        How long it took by the wall clock.
    """

    mutant: Mutant
    fate: Fate
    cases: tuple[str, ...]
    why: str
    seconds: float


class MutantWatcher:
    """Told how it goes on; this one does nothing."""

    def goes_on(self, mutants: Sequence[str], ended: int, of: int) -> None:
        """These mutants run now, and so many of all have ended."""

    def ended(self, result: MutantResult) -> None:
        """A mutant has ended."""


def judge_alone(name: str, enough: int | None, out: Path) -> None:
    """Judge a mutant of the catalogue in a process that nothing else will use.

    Those cases come first that show its clauses, and its group; the others only where none of these has caught it.

    Parameters
    ----------
    name : str
    enough : int or None
        After so many cases that caught it, it ends; None for all cases, whoever caught it.
    out : path
        Where to write what came of it, as JSON.
    """
    from ..hil.conformance.running import Options, run_conformance
    from .catalogue import MUTANTS

    mutant = MUTANTS[name]
    with applied(mutant):
        run = run_conformance(Options(mutant.url, only=mutant.names if enough else (), enough=enough, again=False))
        if enough and run.passed:  # nobody of those who should have caught it
            run = run_conformance(Options(mutant.url, enough=1, again=False))
    cases = list(dict.fromkeys(result.whole for result in run.results if result.breaks))
    out.write_text(json.dumps({"cases": cases, "trouble": run.trouble}), encoding="utf-8")


Judgement = Callable[[str, int | None, Path], None]
"""Judges a mutant by its name until so many cases broke, and writes what came of it to a file; see `judge_alone`."""


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
        Whether all cases are run, even when more than one has caught it.
    judge : callable
        What runs in each process; see `judge_alone`.

    Returns
    -------
    list of MutantResult
        In the order of the mutants. Whatever ends this before has ended the processes too.
    """
    waiting, running, results = deque(chosen), list[_Attempt](), dict[str, MutantResult]()
    with TemporaryDirectory() as folder, _ended_at_last(running):
        while waiting or running:
            while waiting and len(running) < jobs:
                with postponing():  # until the process is known, which is ended then
                    running.append(_Attempt(waiting.popleft(), Path(folder), None if thorough else ENOUGH, judge))
                watcher.goes_on([attempt.mutant.name for attempt in running], len(results), len(chosen))
            time.sleep(LOOK_SECONDS)
            for attempt in [attempt for attempt in running if attempt.is_over]:
                result = results[attempt.mutant.name] = attempt.result()
                running.remove(attempt)
                watcher.ended(result)
    return [results[mutant.name] for mutant in chosen]


@contextmanager
def _ended_at_last(attempts: list[_Attempt]) -> Iterator[None]:
    """Leave no process behind, whatever happens."""
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
    def is_over(self) -> bool:
        """Whether it has come to its end, or has had its time."""
        return not self._process.is_alive() or self._seconds > TIME_OUT_SECONDS

    def result(self) -> MutantResult:
        """What came of it; it is ended."""
        code, seconds = self._process.exitcode, self._seconds
        self.end()
        found = judged(code, _text(self._out), _text(self._errors))
        return MutantResult(self.mutant, *found, seconds)

    def end(self) -> None:
        """End it, wherever it is."""
        self._process.kill()
        self._process.join()


@cache
def _context() -> ForkServerContext | SpawnContext:
    """How processes begin: where the system can, as copies of one that has loaded all that they need."""
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload([WARM])
    return context


def _apart(judge: Judgement, name: str, enough: int | None, out: Path, errors: Path) -> None:
    """Judge in this process, which says on a file what goes wrong, and which no key of the terminal reaches."""
    if hasattr(os, "setsid"):
        os.setsid()
    with errors.open("wb") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    judge(name, enough, out)


def _text(path: Path) -> str:
    return path.read_text("utf-8", "replace") if path.exists() else ""


class Found(NamedTuple):
    """What a run of a mutant tells of it."""

    fate: Fate
    cases: tuple[str, ...] = ()
    why: str = ""


def judged(code: int | None, out: str, errors: str) -> Found:
    """What a process tells of its mutant.

    Parameters
    ----------
    code : int or None
        Exit code; None where it did not end in time.
    out : str
        What `judge_alone` has written; empty where it did not come so far.
    errors : str
        What else it said.
    """
    last = errors.strip().rpartition("\n")[2]
    if code is None:
        return Found(
            Fate.HUNG, why=f"not over after {TIME_OUT_SECONDS:g} s; the last that it said: {last or 'nothing'}"
        )
    if code or not out:
        return Found(Fate.CRASHED, why=f"exit code {code}: {last or 'without a word'}")
    record = json.loads(out)
    cases = tuple(record["cases"])
    if record["trouble"]:
        return Found(Fate.CRASHED, cases, "; ".join(record["trouble"]))
    return Found((Fate.SURVIVED, Fate.ONE_CASE, Fate.CAUGHT)[min(len(cases), 2)], cases)
