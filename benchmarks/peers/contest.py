"""What every contestant's script shares: reading the task, timing, writing the results.

It runs in each peer's own environment, so it may import the standard library and NumPy only, and never phasewire: the
score of a drive is not a contestant's to compute, but the judge's in ``run.py``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

LEAST, MOST = 3, 200  # timed calls of one case
WARM_UP = 0.03  # seconds, and at least one call
FIELD_CALLS = 2  # timed passes over the plane, which can take seconds each
SAME_ITERATIONS = 20
"""Iterations at which contestants are compared like with like: phasewire's default for its phases."""


@dataclass(frozen=True)
class Task:
    """What is to be solved; lengths in metres, in the array's coordinates.

    Parameters
    ----------
    array : (n, 3) float
        Places of the transducers; all look along z.
    problems : dict of (m, 3) float
        Control points by the problem's name; all want the same pressure.
    plane : (rows, columns, 3) float
        Points of the field to compute.
    wavelength, frequency, radius, strength : float
        Wavelength and frequency of the sound, m and Hz; radius and strength of a piston, m and Pa·m (peak).
    budget : float
        Seconds to spend on timing one case.
    """

    array: NDArray[np.float64]
    problems: dict[str, NDArray[np.float64]]
    plane: NDArray[np.float64]
    wavelength: float
    frequency: float
    radius: float
    strength: float
    budget: float

    def save(self, path: Path) -> None:
        """Write the task as NPZ."""
        problems = {f"problem {name}": points for name, points in self.problems.items()}
        numbers = [self.wavelength, self.frequency, self.radius, self.strength, self.budget]
        np.savez(path, array=self.array, plane=self.plane, numbers=np.array(numbers), **problems)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path) -> Task:
        """Read a task back."""
        with np.load(path, allow_pickle=False) as archive:
            prefix = "problem "
            problems = {name[len(prefix) :]: archive[name] for name in archive.files if name.startswith(prefix)}
            return cls(archive["array"], problems, archive["plane"], *archive["numbers"].tolist())


@dataclass(frozen=True)
class Contestant:
    """One way to solve.

    Parameters
    ----------
    name, iterations : str
        What the table shows; the iterations with ``*`` if they are the package's default.
    prepare : callable
        Takes control points (m, 3) in metres, puts them into the package's own type and returns the call to be timed.
    drive : callable
        Turns what that call returned into (n,) complex drives for time factor e^{-iωt}, 1 being full drive.
    used : callable, optional
        The number of iterations that were really used, from what that call returned.
    """

    name: str
    iterations: str
    prepare: Callable[[NDArray[np.float64]], Callable[[], Any]]
    drive: Callable[[Any], NDArray[Any]]
    used: Callable[[Any], int] | None = None


@dataclass(frozen=True)
class Field:
    """One way to compute the pressure over the task's plane: ``evaluate`` makes one pass over all of it."""

    name: str
    transducers: int
    evaluate: Callable[[], object]


@dataclass(frozen=True)
class Set:
    """What a driver sets all scripts, a dataclass of numbers."""

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read it back."""
        return cls(**json.loads(path.read_text(encoding="utf-8")))


@dataclass(frozen=True)
class Entry:
    """Everything that a package enters: its contestants, the array that they really use, and what one must know."""

    array: NDArray[np.float64]
    contestants: list[Contestant]
    fields: list[Field]
    notes: list[str] = field(default_factory=list)


def measure(
    call: Callable[[], Any], budget: float, least: int = LEAST, warm_up: float = WARM_UP
) -> tuple[Any, dict[str, Any]]:
    """Call until the budget is spent, after a warm-up, if any; return the last result and the times in seconds.

    ``processor`` is the mean processor time of a call, of all threads, and ``cpu_share`` is processor time over wall
    time: above 1 more than one thread was at work, below 1 the machine was busy with something else.
    """
    result: Any = None
    warm_until = perf_counter() + warm_up
    while perf_counter() < warm_until:
        result = call()
    seconds: list[float] = []
    processor, wall = process_time(), perf_counter()
    while len(seconds) < least or (len(seconds) < MOST and perf_counter() - wall < budget):
        begun = perf_counter()
        result = call()
        seconds.append(perf_counter() - begun)
    used, passed = process_time() - processor, perf_counter() - wall
    low, middle, high = np.quantile(seconds, [0.25, 0.5, 0.75]).tolist()
    times = {"fastest": min(seconds), "low": low, "median": middle, "high": high}
    return result, {**times, "processor": used / len(seconds), "calls": len(seconds), "cpu_share": used / passed}


def attempt(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The work's result, or its error in words: a contestant that fails must not stop the others."""
    try:
        return work()
    except Exception as error:  # whatever a foreign package raises
        return {"error": f"{type(error).__name__}: {error}"}


def solve_case(contestant: Contestant, points: NDArray[np.float64], budget: float) -> dict[str, Any]:
    """Time one contestant on one problem and keep the drives that it found."""
    result, times = measure(contestant.prepare(points), budget)
    drive = np.asarray(contestant.drive(result), dtype=np.complex128)
    used = contestant.used and contestant.used(result)
    return {"times": times, "used": used, "drive": [drive.real.tolist(), drive.imag.tolist()]}


def field_case(entered: Field, task: Task) -> dict[str, Any]:
    """Time one way to compute the field."""
    _, times = measure(entered.evaluate, task.budget, FIELD_CALLS)
    return {"times": times, "pairs": task.plane[..., 0].size * entered.transducers}


def main(enter: Callable[[Task], Entry]) -> None:
    """Run a contestant's script: ``script TASK.npz RESULT.json``."""
    task_path, result_path = map(Path, sys.argv[1:])
    task = Task.load(task_path)
    entry = enter(task)
    solved = [
        {
            "name": one.name,
            "iterations": one.iterations,
            "cases": {
                name: attempt(lambda one=one, points=points: solve_case(one, points, task.budget))  # type: ignore[misc]
                for name, points in task.problems.items()
            },
        }
        for one in entry.contestants
    ]
    fields = [
        {"name": one.name, **attempt(lambda one=one: field_case(one, task))}  # type: ignore[misc]
        for one in entry.fields
    ]
    record = {"array": entry.array.tolist(), "contestants": solved, "fields": fields, "notes": entry.notes}
    result_path.write_text(json.dumps(record), encoding="utf-8")
