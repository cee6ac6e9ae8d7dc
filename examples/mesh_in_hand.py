"""From an STL file and a recorded hand to a field: the three lines in the middle.

Run it with ``.venv/bin/python examples/mesh_in_hand.py``. It makes both files itself, and draws ``mesh_in_hand.png``.
"""

from pathlib import Path

import numpy as np
import phasewire as pw
import trimesh
from phasewire.solver.pictures.picture import save_field_picture

trimesh.creation.torus(major_radius=30, minor_radius=12).apply_translation([0, 0, 170]).export("ring.stl")  # in mm
np.save("hand.npy", pw.Hand.flat([0, 0, 0.17]).landmarks)  # 21 landmarks as MediaPipe has them, in m

ring = pw.read_mesh("ring.stl", scale=1e-3)
touch = pw.touch(pw.Hand(np.load("hand.npy"), side="right"), ring)
assert touch.points is not None  # they meet
solution = pw.solve(pw.TransducerArray.grid(), touch.points)

print(f"The hand meets the ring in {len(touch.arcs)} arcs, which are felt as {len(touch.points)} control points.")
field = pw.sample_plane(pw.TransducerArray.grid(), solution.drive, 0.17)
save_field_picture(Path("mesh_in_hand.png"), field, touch.points)
print("Drew mesh_in_hand.png.")
