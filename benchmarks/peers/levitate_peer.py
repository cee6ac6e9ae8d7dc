"""The entry of levitate 3: its optimiser on the pressure at the control points, and its field.

It runs in the environment of ``levitate.txt`` and may not import phasewire.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import levitate
import numpy as np
from contest import SAME_ITERATIONS, Contestant, Entry, Field, Task, main
from numpy.typing import NDArray

MOST_ITERATIONS = 200
POINTS_AT_A_TIME = 4000
GOLDEN = 0.6180339887


def build_array(task: Task) -> Any:
    """The task's array, with its pistons and its air."""
    air = levitate.materials.Air()
    air.c = task.wavelength * task.frequency
    piston = levitate.transducers.CircularPiston(
        effective_radius=task.radius, freq=task.frequency, p0=task.strength, medium=air
    )
    up = np.tile([[0.0], [0.0], [1.0]], len(task.array))
    return levitate.arrays.TransducerArray(task.array.T, up, transducer=piston)


def superposition(array: Any, points: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Phases of the sum of all single foci, each turned by another angle so that they do not cancel."""
    foci = [np.exp(1j * (array.focus_phases(point) + 2 * np.pi * GOLDEN * i**2)) for i, point in enumerate(points)]
    return np.asarray(np.exp(1j * np.angle(np.sum(foci, axis=0))))


def optimise(array: Any, points: NDArray[np.float64], iterations: int) -> Any:
    """Minimise the squared deviations of |p| from the mean |p| of the superposition, over the phases."""
    start = superposition(array, points)
    magnitude = abs(levitate.fields.Pressure(array))
    deviation = (magnitude - np.mean(magnitude(start, points.T))) ** 2
    return levitate.optimization.minimize(
        levitate.fields.sum(*[deviation @ point for point in points]),
        array,
        start_values=start,
        minimize_kwargs={"options": {"maxiter": iterations, "gtol": 1e-9, "ftol": 1e-15}},
        return_optim_status=True,
    )


def contestant(array: Any, iterations: int) -> Contestant:
    """The optimiser with a limit on its iterations."""

    def prepare(points: NDArray[np.float64]) -> Callable[[], Any]:
        return lambda: optimise(array, points, iterations)

    return Contestant(
        "levitate L-BFGS-B", f"≤{iterations}", prepare, lambda result: result[0], lambda result: int(result[1].nit)
    )


def enter(task: Task) -> Entry:
    """The optimiser with two limits, and the field by `Pressure`."""
    array = build_array(task)
    field = levitate.fields.Pressure(array)
    plane, drive = task.plane.reshape(-1, 3).T, np.ones(len(task.array), dtype=complex)
    parts = np.array_split(plane, -(-plane.shape[1] // POINTS_AT_A_TIME), axis=1)
    return Entry(
        task.array,
        [contestant(array, MOST_ITERATIONS), contestant(array, SAME_ITERATIONS)],
        [Field("levitate Pressure", len(task.array), lambda: [field(drive, part) for part in parts])],
        [
            "It has no multi-focus solver; this is its optimiser, over phases only, on a cost function written for "
            "this benchmark: Σ(|p| − target)², from a superposition of foci, whose mean |p| is the target.",
            "A call contains that start, the construction of the cost function, the transfer matrix and the optimiser. "
            f"Its own settings (gtol 1e-9, ftol 1e-15) are kept; it sets no limit, so the one of {MOST_ITERATIONS} is "
            "this benchmark's, and often not reached.",
            f"The field is computed in parts of {POINTS_AT_A_TIME} points, to bound its memory.",
        ],
    )


if __name__ == "__main__":
    main(enter)
