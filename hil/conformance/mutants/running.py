"""Running the suite against mutants, each in a process of its own, and what came of them.

A mutant changes the emulator of a whole process, and may crash it or hang. That is no catch: a case has to fail.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ..reports.records import FORMAT
from .patching import Mutant

__all__ = ["DEFAULT_JOBS", "Fate", "MutantResult", "MutantWatcher", "run_mutants"]

TIME_OUT_SECONDS = 180.0
LOOK_SECONDS = 0.05
MOST_JOBS = 4
DEFAULT_JOBS = min(os.cpu_count() or 1, MOST_JOBS)
PASSED, FAILED = 0, 1
"""Exit codes of a run that came to its end."""
COMMAND = (sys.executable, "-m", "phasewire", "conformance", "--json", "-", "--mutant")
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


def run_mutants(
    chosen: Sequence[Mutant], jobs: int, watcher: MutantWatcher, *, thorough: bool = False
) -> list[MutantResult]:
    """Run the suite against each mutant, those cases first that show what it breaks.

    Parameters
    ----------
    chosen : sequence of Mutant
    jobs : int
        How many run at a time.
    watcher : MutantWatcher
    thorough : bool
        Whether all cases are run, even when more than one has caught it.

    Returns
    -------
    list of MutantResult
        In the order of the mutants. Whatever ends this before has ended the processes too.
    """
    waiting, running, results = deque(chosen), list[_Attempt](), dict[str, MutantResult]()
    with TemporaryDirectory() as folder, _ended_at_last(running):
        while waiting or running:
            while waiting and len(running) < jobs:
                running.append(_Attempt(waiting.popleft(), Path(folder), thorough=thorough))
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

    def __init__(self, mutant: Mutant, folder: Path, *, thorough: bool) -> None:
        self.mutant = mutant
        self._began = time.monotonic()
        self._out, self._errors = folder / f"{mutant.name}.json", folder / f"{mutant.name}.txt"
        with self._out.open("wb") as out, self._errors.open("wb") as errors:
            # In a session of its own Ctrl-C does not reach it, so that it does not tell of it either.
            self._process = subprocess.Popen(
                [*COMMAND, mutant.name, *([] if thorough else ["--stop-after", str(ENOUGH)])],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=errors,
                start_new_session=True,
            )

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._began

    @property
    def is_over(self) -> bool:
        """Whether it has come to its end, or has had its time."""
        return self._process.poll() is not None or self._seconds > TIME_OUT_SECONDS

    def result(self) -> MutantResult:
        """What came of it; it is ended."""
        code, seconds = self._process.poll(), self._seconds
        self.end()
        found = judged(code, self._out.read_text("utf-8"), self._errors.read_text("utf-8", "replace"))
        return MutantResult(self.mutant, *found, seconds)

    def end(self) -> None:
        """End it, wherever it is."""
        self._process.kill()
        self._process.wait()


class Found(NamedTuple):
    """What a run of a mutant tells of it."""

    fate: Fate
    cases: tuple[str, ...] = ()
    why: str = ""


def judged(code: int | None, out: str, errors: str) -> Found:
    """What a run tells of its mutant.

    Parameters
    ----------
    code : int or None
        Exit code; None where it did not end in time.
    out : str
        Standard output: the record of the run.
    errors : str
        Standard error.
    """
    last = errors.strip().rpartition("\n")[2]
    if code is None:
        return Found(
            Fate.HUNG, why=f"not over after {TIME_OUT_SECONDS:g} s; the last that it said: {last or 'nothing'}"
        )
    record = _record(out)
    if code not in (PASSED, FAILED) or record is None:
        return Found(Fate.CRASHED, why=f"exit code {code}: {last or 'without a word'}")
    cases = tuple(result["case"] for result in record["results"] if result["breaks"])
    if record["trouble"]:
        return Found(Fate.CRASHED, cases, "; ".join(record["trouble"]))
    return Found((Fate.SURVIVED, Fate.ONE_CASE, Fate.CAUGHT)[min(len(cases), 2)], cases)


def _record(out: str) -> dict[str, Any] | None:
    """The record of a run, None where there is none."""
    try:
        found = json.loads(out)
    except ValueError:
        return None
    return found if isinstance(found, dict) and found.get("format") == FORMAT else None
