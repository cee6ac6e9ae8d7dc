"""Points on hands that move as recorded ones do: few begin, none for a moment only, and none where nothing is cut."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from phasewire import Hand, Mesh, Toucher
from phasewire.solver import Touch

from tests.solver.contact.moving import felt_by, moving_hand, objects

Floats = NDArray[np.float64]
SECONDS = 3.0
MESHES = objects()
BIRTHS = {"sweep": 18, "flex": 6, "explore": 16}
"""A second at most, for each motion: about half of what a placement without hysteresis had."""


def distance(position: Floats, triangles: Floats) -> float:
    """Distance of a position from the nearest of (t, 3, 3) triangles, by trimesh."""
    closest_point: Any = trimesh.triangles.closest_point  # it has no types
    nearest = closest_point(triangles, np.tile(position, (len(triangles), 1)))
    return float(np.linalg.norm(nearest - position, axis=1).min())


def farthest_off(felt: Touch, hand: Hand, mesh: Mesh) -> float:
    """Of all points, the greatest distance from its quadrilateral, or from the mesh."""
    triangles, farthest = mesh.vertices[mesh.faces], 0.0
    for position, quad in zip(felt.points.positions if felt.points else (), felt.quads, strict=True):
        halves = hand.quads[quad][[[0, 1, 2], [0, 2, 3]]]
        farthest = max(farthest, distance(position, halves), distance(position, triangles))
    return farthest


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("motion", BIRTHS)
def test_few_points_begin_on_a_moving_hand(motion: str, name: str) -> None:
    steady = felt_by(motion, MESHES[name], 100, SECONDS, 0)
    assert steady.points > 3
    assert steady.births <= BIRTHS[motion]
    assert steady.short <= 1
    assert steady.replaced == 0
    assert steady.jump <= 1.5
    assert steady.bare_95 <= 12


@pytest.mark.parametrize("name", MESHES)
def test_no_point_begins_or_ends_on_a_hand_that_trembles(name: str) -> None:
    """By 0.2 mm rms. A quadrilateral that just grazes an object is another matter: its arcs come and go."""
    steady = [felt_by("tremble", MESHES[name], 100, 1.5, seed, 0.2e-3) for seed in (0, 2, 3, 4)]
    assert all(each.births == each.changed == 0 for each in steady)


@pytest.mark.parametrize("name", MESHES)
def test_no_point_slides_over_a_bridge(name: str) -> None:
    mesh, toucher, seen = MESHES[name], Toucher(), 0
    for k, (time, hand) in enumerate(moving_hand("explore", 100, 1.0, 2)):
        felt = toucher.touch(hand, mesh, time)
        if k % 4 == 0:
            assert farthest_off(felt, hand, mesh) < 1e-4
            seen += len(felt.ids)
    assert seen > 100
