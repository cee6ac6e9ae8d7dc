"""A surgeon's hand in a CT scan feels where the tumour begins, and how wide it is.

Run it with ``.venv/bin/python examples/ct_volume.py [PICTURE]``; it needs the extra ``volumes``. The scan is made here:
noisy tissue in air, and in it a tumour of 50 mm that takes up more contrast agent. The hand goes down into it. What it
feels is printed, and for the widest section drawn, slice and field, as ``ct_volume.png`` unless told otherwise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import phasewire as pw
from matplotlib.figure import Figure
from numpy.typing import NDArray
from phasewire.solver.picture import draw_field

VOXEL_M, CORNER_M, SHAPE = 2e-3, np.array([-0.07, -0.07, 0.1]), (70, 70, 60)
CENTRE_M, RADIUS_M, BODY_M = np.array([0.0, 0.005, 0.17]), 0.025, 0.06
AIR, TISSUE, TUMOUR, NOISE = -1000, 40, 110, 5  # Hounsfield units
MM = 1e3


def scan() -> NDArray[np.float64]:
    """What a CT scanner gives, in Hounsfield units."""
    places = np.moveaxis(np.indices(SHAPE), 0, -1) * VOXEL_M + CORNER_M
    away = np.linalg.norm(places - CENTRE_M, axis=-1)
    edges = RADIUS_M - VOXEL_M, RADIUS_M + VOXEL_M, BODY_M - VOXEL_M, BODY_M + VOXEL_M  # a scanner blurs them
    volume = np.interp(away, edges, (TUMOUR, TISSUE, TISSUE, AIR))
    return np.asarray(volume + np.random.default_rng(1).normal(0, NOISE, SHAPE))


def main(picture: Path) -> None:
    """Feel the surface of the tumour, half-way between its density and the tissue's."""
    volume, file = scan(), picture.with_suffix(".npy")  # or a NIfTI file, or a folder of DICOM slices
    np.save(file, volume)
    tumour = pw.Mesh.from_volume(file, (TISSUE + TUMOUR) / 2, spacing=VOXEL_M).moved(CORNER_M)
    found = []
    for height in np.arange(0.205, 0.165, -0.005):
        touch = pw.touch(pw.Hand.flat([0, 0, height]), tumour)
        length = sum(float(np.linalg.norm(np.diff(arc, axis=0), axis=1).sum()) for arc in touch.arcs)
        print(f"{height * MM:3.0f} mm up: " + (f"a ring {length / np.pi * MM:.0f} mm wide" if touch else "nothing"))
        found.append((length, height, touch))
    _, height, touch = max(found, key=lambda each: each[0])
    assert touch.points is not None  # the hand was in the tumour

    array = pw.TransducerArray.grid()
    figure = Figure(figsize=(13, 5.5), layout="compressed")
    left, right = figure.subplots(1, 2)
    low, high = ((CORNER_M + (np.array(corner) - 0.5) * VOXEL_M) * MM for corner in ((0, 0, 0), SHAPE))
    layer = volume[:, :, round((height - CORNER_M[2]) / VOXEL_M)]
    left.imshow(layer.T, "gray", origin="lower", extent=(low[0], high[0], low[1], high[1]), vmin=-100, vmax=200)
    left.set(title="the scan, and what the hand feels of it", xlabel="x / mm", ylabel="y / mm")
    draw_field(right, pw.sample_plane(array, pw.solve(array, touch.points).drive, height, 0.14), touch.points)
    for arc in touch.arcs:
        for axes in (left, right):
            axes.plot(*(arc[:, :2].T * MM), color="C1", linewidth=1)
    figure.savefig(picture, dpi=90)
    print(f"Drew {picture}.")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("ct_volume.png"))
