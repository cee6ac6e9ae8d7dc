"""A shape becomes a field: a star above the array, solved, and its pressure drawn to ``star.png``.

Run it with ``.venv/bin/python examples/field_of_a_shape.py``.
"""

from pathlib import Path

import phasewire as pw
from phasewire.solver.pictures.picture import save_field_picture

array = pw.TransducerArray.grid()
points = pw.parse_shape("star").sample()
solution = pw.solve(array, points)
height_m = float(points.positions[0, 2])
save_field_picture(Path("star.png"), pw.sample_plane(array, solution.drive, height_m), points)
print(f"Drew star.png: {len(points)} control points, {height_m * 1000:.0f} mm above the array.")
