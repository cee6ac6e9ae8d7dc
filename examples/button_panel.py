"""A panel that needs no eyes: a finger taps one of five buttons in mid-air, and feels which one.

Run it with ``.venv/bin/python examples/button_panel.py``. It draws the field of the deepest moment, ``panel.png``.
"""

from pathlib import Path

import numpy as np
import phasewire as pw
from phasewire.solver.pictures.picture import save_field_picture

NAMES = ("colder", "warmer", "fan", "radio", "phone")
SIDE_M, APART_M, HEIGHT_M = 0.03, 0.045, 0.16
xs = APART_M * (np.arange(len(NAMES)) - 2)
buttons = [pw.Mesh.cube(SIDE_M, (x, 0, HEIGHT_M)) for x in xs]

toucher = pw.Toucher(spacing=6e-3)  # a fingertip is small
deepest, before = toucher.touch([], buttons), ""
with pw.open_hands(f"gesture:tap?x={xs[NAMES.index('radio')]}&z={HEIGHT_M}&seconds=0.6") as hands:
    for frame in hands:
        touch = toucher.touch([tracked.hand for tracked in frame.hands], buttons)
        felt = ", ".join(NAMES[button] for button in np.unique(touch.objects))
        if felt != before:
            print(f"after {1000 * frame.time:3.0f} ms the finger feels {felt or 'no button'}")
        before = felt
        deepest = max(deepest, touch, key=lambda each: len(each.ids))

array, points = pw.TransducerArray.grid(), deepest.points
assert points is not None  # the finger has tapped
field = pw.sample_plane(array, pw.solve(array, points).drive, float(points.positions[0, 2]), extent=0.24)
save_field_picture(Path("panel.png"), field, points)
print("Drew panel.png.")
