"""From an STL file and a recorded hand to a field: the three lines in the middle.

Run it with ``.venv/bin/python examples/mesh_in_hand.py``. It makes both files itself, and draws ``mesh_in_hand.png``.
"""

import numpy as np
import phasewire as pw
from phasewire.base.extras import needing
from phasewire.hil.loop.touch_picture import save_touch_picture

with needing("meshes", "this example"):
    import trimesh

trimesh.creation.torus(major_radius=30, minor_radius=12).apply_translation([0, 0, 170]).export("ring.stl")  # in mm
np.save("hand.npy", pw.Hand.flat([0, 0, 0.17]).landmarks)  # 21 landmarks as MediaPipe has them, in m

ring, hand = pw.read_mesh("ring.stl", scale=1e-3), pw.Hand(np.load("hand.npy"), side="right")
touch = pw.touch(hand, ring)
assert touch.points is not None  # they meet
halves = pw.two_sided(array := pw.TransducerArray.grid(), touch.points).modulation

print(f"The hand meets the ring in {len(touch.arcs)} arcs, which are felt as {len(touch.points)} control points.")
save_touch_picture("mesh_in_hand.png", [hand], [ring], touch, halves, array, None)
print("Drew mesh_in_hand.png.")
