"""The entry of AcousTools: WGS, GS-PAT and iterative backpropagation, and its field.

It runs in the environment of ``acoustools.txt`` and may not import phasewire.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from acoustools.Solvers import gspat, iterative_backpropagation, wgs
from acoustools.Utilities import DTYPE, device, propagate
from contest import SAME_ITERATIONS, Contestant, Entry, Field, Task, main
from numpy.typing import NDArray

DEFAULT_ITERATIONS = 200
POINTS_AT_A_TIME = 4000
SOLVERS = {"WGS": wgs, "GS-PAT": gspat, "IBP": iterative_backpropagation}


def tensor(points: NDArray[np.float64]) -> Any:
    """Points (m, 3) as the package wants them, a batch of one: (1, 3, m)."""
    return torch.tensor(points.T[None], dtype=torch.float32, device=device)


def contestant(name: str, iterations: int, model: dict[str, Any]) -> Contestant:
    """One solver with a number of iterations."""

    def prepare(points: NDArray[np.float64]) -> Callable[[], Any]:
        batch = tensor(points)
        return lambda: SOLVERS[name](batch, iterations=iterations, **model)

    mark = "*" if iterations == DEFAULT_ITERATIONS else ""
    return Contestant(
        f"acoustools {name}", f"{iterations}{mark}", prepare, lambda hologram: hologram.reshape(-1).cpu().numpy()
    )


def enter(task: Task) -> Entry:
    """Three solvers at two numbers of iterations, and the field by `propagate`."""
    torch.set_num_threads(1)
    model = {
        "board": torch.tensor(task.array, dtype=torch.float32, device=device),
        "norms": torch.tensor([[0, 0, 1]], dtype=DTYPE, device=device).expand(len(task.array), 3),
        "k": 2 * math.pi / task.wavelength,
        "transducer_radius": task.radius,
        "p_ref": task.strength,
    }
    plane = task.plane.reshape(-1, 3)
    parts = [tensor(part) for part in np.array_split(plane, -(-len(plane) // POINTS_AT_A_TIME))]
    drive = torch.ones((1, len(task.array), 1), dtype=DTYPE, device=device)
    return Entry(
        task.array,
        [contestant(name, count, model) for name in SOLVERS for count in (DEFAULT_ITERATIONS, SAME_ITERATIONS)],
        [Field("acoustools propagate", len(task.array), lambda: [propagate(drive, part, **model) for part in parts])],
        [
            f"A call takes a tensor of points to a tensor of drives on {device}, in {DTYPE}: transfer matrix (piston, "
            "its directivity as a polynomial) and iterations. The drives are phases at full amplitude.",
            f"The field is computed in parts of {POINTS_AT_A_TIME} points, to bound its memory.",
        ],
    )


if __name__ == "__main__":
    main(enter)
