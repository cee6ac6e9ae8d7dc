"""A surgeon's hand in a CT scan feels the edge of a tumour, and its width.

Run it with ``.venv/bin/python examples/ct_volume.py``; it needs the extra ``volumes``. The scan is made here: noisy
tissue in air, and in it a tumour of 50 mm that takes up more contrast agent. The hand goes down into it.
"""

import numpy as np
import phasewire as pw

VOXEL_M, CORNER_M, SHAPE = 2e-3, np.array([-0.07, -0.07, 0.1]), (70, 70, 60)
CENTRE_M, RADIUS_M, BODY_M = np.array([0.0, 0.005, 0.17]), 0.025, 0.06
AIR, TISSUE, TUMOUR, NOISE = -1000, 40, 110, 5  # Hounsfield units

places = np.moveaxis(np.indices(SHAPE), 0, -1) * VOXEL_M + CORNER_M
edges = RADIUS_M - VOXEL_M, RADIUS_M + VOXEL_M, BODY_M - VOXEL_M, BODY_M + VOXEL_M  # a scanner blurs them
volume = np.interp(np.linalg.norm(places - CENTRE_M, axis=-1), edges, (TUMOUR, TISSUE, TISSUE, AIR))
np.save("scan.npy", volume + np.random.default_rng(1).normal(0, NOISE, SHAPE))  # or NIfTI, or a folder of DICOM slices

tumour = pw.read_volume_mesh("scan.npy", (TISSUE + TUMOUR) / 2, spacing=VOXEL_M).moved(CORNER_M)
array = pw.TransducerArray.grid()
for height in np.arange(0.205, 0.165, -0.005):
    touch = pw.touch(pw.Hand.flat([0, 0, height]), tumour)
    if touch.points is None:
        print(f"{height * 1000:3.0f} mm up: nothing")
        continue
    length = sum(float(np.linalg.norm(np.diff(arc, axis=0), axis=1).sum()) for arc in touch.arcs)
    felt = np.abs(pw.pressure(array, pw.solve(array, touch.points).drive, touch.points.positions)).mean()
    print(f"{height * 1000:3.0f} mm up: a ring {length / np.pi * 1000:.0f} mm wide, felt with {felt:.0f} Pa")
