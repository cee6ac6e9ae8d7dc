"""A panel that needs no eyes: a finger taps one of five buttons in mid-air, and feels which one.

Run it with ``.venv/bin/python examples/button_panel.py``. It draws the field of the deepest moment, ``panel.png``.
"""

import numpy as np
import phasewire as pw
from phasewire.hil.loop.touch_picture import save_touch_picture

NAMES = ("colder", "warmer", "fan", "radio", "phone")
SIDE_M, APART_M, HEIGHT_M = 0.03, 0.045, 0.16
xs = APART_M * (np.arange(len(NAMES)) - 2)
buttons = [pw.Mesh.cube(SIDE_M, (x, 0, HEIGHT_M)) for x in xs]

toucher = pw.Toucher(spacing=6e-3)  # a fingertip is small
deepest, finger, before = toucher.touch([], buttons), list[pw.Hand](), ""
with pw.open_hands(f"gesture:tap?x={xs[NAMES.index('radio')]}&z={HEIGHT_M}&seconds=0.6") as hands:
    for frame in hands:
        here = [tracked.hand for tracked in frame.hands]
        touch = toucher.touch(here, buttons)
        felt = ", ".join(NAMES[button] for button in np.unique(touch.objects))
        if felt != before:
            print(f"after {1000 * frame.time:3.0f} ms the finger feels {felt or 'no button'}")
        before = felt
        if len(touch.ids) > len(deepest.ids):
            deepest, finger = touch, here

array = pw.TransducerArray.grid()
assert deepest.points is not None  # the finger has tapped
solved = pw.Modulation.on_off(pw.solve(array, deepest.points).drive)
save_touch_picture("panel.png", finger, buttons, deepest, solved, array, None)
print("Drew panel.png.")
