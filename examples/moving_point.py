"""A point that goes round five times a second: 1000 new fields a second, each for its own carrier period.

Run it with ``.venv/bin/python examples/moving_point.py [URL]``; the default device is emulated.
"""

import math
import sys
from collections.abc import Iterator

import phasewire as pw
from phasewire.host import sine

RATE, SECONDS, TURNS_PER_SECOND, RADIUS_M = 1000, 1.0, 5, 0.02


def solutions() -> Iterator[pw.Solution]:
    """Solve each frame when it is needed; the solver begins with the phases of the frame before."""
    solver = pw.Solver(pw.TransducerArray.grid(), "tikhonov")
    for frame in range(round(RATE * SECONDS)):
        angle = 2 * math.pi * TURNS_PER_SECOND * frame / RATE
        yield solver.solve(pw.ControlPoints([[RADIUS_M * math.cos(angle), RADIUS_M * math.sin(angle), 0.2]]))


with pw.open_device(sys.argv[1] if len(sys.argv) > 1 else None) as device:
    print(device.stream(solutions(), RATE, envelope=sine(200)))  # late frames and underruns are counted
