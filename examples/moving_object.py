"""Something that moves: a ball rolls through a hand that is held still, and the hand feels it pass.

Run it with ``.venv/bin/python examples/moving_object.py [PICTURE]``. The field follows the ball at 500 frames a second
on an emulated device; the pictures, ``moving_object.png`` unless told otherwise, show four moments of it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import phasewire as pw
from matplotlib.figure import Figure
from phasewire.solver import Touch
from phasewire.solver.picture import draw_field

BALL_M, TRACK_M, HEIGHT_M = 0.06, 0.03, 0.17
TURNS_PER_SECOND, SECONDS, RATE = 1.0, 1.0, 500
MM = 1e3

Felt = tuple[Touch, pw.Solution]


def main(picture: Path) -> None:
    """Let the ball roll once around, play what the hand feels, and draw it."""
    array = pw.TransducerArray.grid()
    hand = pw.Hand.flat([0, 0, HEIGHT_M])
    ball = pw.Mesh.sphere(BALL_M, (TRACK_M, 0, HEIGHT_M))
    toucher, solver = pw.Toucher(), pw.Solver(array)
    felt: list[Felt] = []

    def frames() -> Iterator[pw.Pulses]:
        for frame in range(round(SECONDS * RATE)):
            angle = 2 * math.pi * TURNS_PER_SECOND * frame / RATE
            place = [TRACK_M * (math.cos(angle) - 1), TRACK_M * math.sin(angle), 0]
            touch = toucher.touch(hand, ball.moved(place))  # the points keep their identities while the ball rolls
            assert touch.points is not None  # the track lies under the palm
            felt.append((touch, solver.solve(touch.points)))
            yield pw.Pulses.from_drive(felt[-1][1].drive)

    with pw.open_device("emulator:") as device:
        print(device.stream(frames(), rate=RATE))
    ids = [set(touch.ids) for touch, _ in felt]
    stay = sum(len(before & after) for before, after in pairwise(ids)) / sum(map(len, ids[1:]))
    print(f"{stay:.1%} of the points were there a frame before.")

    figure = Figure(figsize=(13, 9.5), layout="constrained")
    for axes, moment in zip(figure.subplots(2, 2).flat, range(0, len(felt), len(felt) // 4), strict=False):
        touch, solution = felt[moment]
        draw_field(axes, pw.sample_plane(array, solution.drive, HEIGHT_M), touch.points)
        for quad in hand.quads:
            axes.fill(*(quad[:, :2].T * MM), fill=False, color="gray", linewidth=0.6)
        for arc in touch.arcs:
            axes.plot(*(arc[:, :2].T * MM), color="white", linewidth=0.8)
        axes.set_title(f"after {moment / RATE:g} s")
    figure.savefig(picture, dpi=80)
    print(f"Drew {picture}.")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("moving_object.png"))
