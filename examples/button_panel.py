"""A panel for eyes that are busy: five buttons in mid-air, and a finger that taps one of them.

Run it with ``.venv/bin/python examples/button_panel.py [PICTURE]``. It says when which button is felt, and by how many
control points, and draws the field of the deepest moment, ``button_panel.png`` unless told otherwise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import phasewire as pw
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from phasewire.solver.picture import draw_field

NAMES = ("colder", "warmer", "fan", "radio", "phone")
SIDE_M, APART_M, HEIGHT_M = 0.03, 0.045, 0.16
PLACES_M = [(APART_M * (number - 2), 0, HEIGHT_M) for number in range(len(NAMES))]
MS = MM = 1e3


def main(picture: Path) -> None:
    """Let a finger tap the button, say what it feels, and draw the field."""
    buttons = [pw.Mesh.cube(SIDE_M, place) for place in PLACES_M]
    x = PLACES_M[NAMES.index("radio")][0]
    toucher = pw.Toucher(spacing=6e-3)  # a fingertip is small
    deepest, before = toucher.touch([], buttons), ""
    with pw.open_hands(f"gesture:tap?x={x}&z={HEIGHT_M}&seconds=0.6") as hands:
        for frame in hands:
            touch = toucher.touch([tracked.hand for tracked in frame.hands], buttons)
            counts = np.bincount(touch.objects, minlength=len(NAMES))
            felt = ", ".join(f"{name} ({count})" for name, count in zip(NAMES, counts, strict=True) if count)
            if felt != before:
                print(f"after {frame.time * MS:3.0f} ms the finger feels {felt or 'no button'}")
            before = felt
            deepest = max(deepest, touch, key=lambda each: len(each.ids))

    array = pw.TransducerArray.grid()
    assert deepest.points is not None  # the finger has tapped
    drive = pw.solve(array, deepest.points).drive
    figure = Figure(figsize=(9, 6), layout="compressed")
    axes = figure.subplots()
    draw_field(axes, pw.sample_plane(array, drive, float(deepest.points.positions[0, 2]), extent=0.24), deepest.points)
    for name, (x, y, _) in zip(NAMES, PLACES_M, strict=True):
        axes.add_patch(
            Rectangle(
                ((x - SIDE_M / 2) * MM, (y - SIDE_M / 2) * MM), SIDE_M * MM, SIDE_M * MM, fill=False, edgecolor="white"
            )
        )
        axes.annotate(name, (x * MM, (y - SIDE_M / 2) * MM - 8), color="white", ha="center")
    figure.savefig(picture, dpi=100)
    print(f"Drew {picture}.")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("button_panel.png"))
