"""phasewire's own entry: every method it offers, through its public interface and with its defaults.

It may use nothing but that interface: it measures what a user gets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import phasewire
from contest import Contestant, Entry, Field, Task, main
from numpy.typing import NDArray
from phasewire.solver import METHODS, Options


def solver(array: phasewire.TransducerArray, method: str) -> Callable[[phasewire.ControlPoints], phasewire.Solution]:
    """A function that solves one set of control points after another on this array, each from scratch."""
    kept = phasewire.Solver(array, method)

    def solve(points: phasewire.ControlPoints) -> phasewire.Solution:
        kept.forget()
        return kept.solve(points)

    return solve


def iterations(method: str) -> str:
    """The counts of steps among a method's options, as they are by default."""
    options = METHODS[method].options
    return ", ".join(f"{getattr(Options(), name)}*" for name in options if name.endswith("steps")) or "-"


def contestant(array: phasewire.TransducerArray, method: str) -> Contestant:
    """One method as a contestant."""
    solve = solver(array, method)

    def prepare(positions: NDArray[np.float64]) -> Callable[[], Any]:
        points = phasewire.ControlPoints(positions)
        return lambda: solve(points)

    return Contestant(f"phasewire {method}", iterations(method), prepare, lambda solution: np.asarray(solution.drive))


def enter(task: Task) -> Entry:
    """All methods, and the field by `phasewire.pressure`."""
    array = phasewire.TransducerArray(
        task.array,
        np.tile([0.0, 0.0, 1.0], (len(task.array), 1)),
        phasewire.Transducer(task.radius, task.strength),
    )
    plane = task.plane.reshape(-1, 3)
    drive = np.ones(len(array))
    return Entry(
        task.array,
        [contestant(array, method) for method in METHODS],
        [Field("phasewire.pressure", len(array), lambda: phasewire.pressure(array, drive, plane, precision="single"))],
        [
            "A call takes ControlPoints to a Solution: checks of the points, transfer matrix, phases and drives. The "
            "strongest transducer is at full drive; wgs, polish and paper drive most of them near to it."
        ],
    )


if __name__ == "__main__":
    main(enter)
