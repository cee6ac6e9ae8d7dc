"""A ball rolls through a hand that is held still, and the hand feels it pass: 500 fields a second.

Run it with ``.venv/bin/python examples/moving_object.py [URL]``; the default device is emulated.
"""

import math
import sys
from collections.abc import Iterator
from itertools import pairwise

import phasewire as pw

BALL_M, TRACK_M, HEIGHT_M = 0.06, 0.03, 0.17
TURNS_PER_SECOND, SECONDS, RATE = 1.0, 1.0, 500

hand = pw.Hand.flat([0, 0, HEIGHT_M])
ball = pw.Mesh.sphere(BALL_M, (TRACK_M, 0, HEIGHT_M))
toucher, solver = pw.Toucher(), pw.Solver(pw.TransducerArray.grid())
ids: list[set[int]] = []


def frames() -> Iterator[pw.Solution]:
    """Move the ball, find what the hand feels, and solve it."""
    for frame in range(round(SECONDS * RATE)):
        angle = 2 * math.pi * TURNS_PER_SECOND * frame / RATE
        touch = toucher.touch(hand, ball.moved([TRACK_M * (math.cos(angle) - 1), TRACK_M * math.sin(angle), 0]))
        assert touch.points is not None  # the track lies under the palm
        ids.append(set(touch.ids))  # points keep their identities while the ball rolls
        yield solver.solve(touch.points, ids=touch.ids)


with pw.open_device(sys.argv[1] if len(sys.argv) > 1 else None) as device:
    print(device.stream(frames(), RATE))
stay = sum(len(before & after) for before, after in pairwise(ids)) / sum(len(after) for after in ids[1:])
print(f"{stay:.1%} of the points were there a frame before.")
