"""Touch: hands that sweep through the paper's shapes, moving objects, several of each, and wrong arguments."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from phasewire import Hand, Mesh, Toucher, touch
from phasewire.solver.contact.density import CLOSEST
from phasewire.solver.contact.touch import MOST_OBJECTS, MOST_POINTS

Floats = NDArray[np.float64]
SIDE = 0.04
CENTRE = np.array([0, 0, 0.17])
TALL = {"horizontal_prism": SIDE * math.sqrt(0.75)}


def _circle(radius: float) -> Floats:
    angle = np.linspace(0, 2 * np.pi, 400)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _rectangle(x: float, y: float) -> Floats:
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]]) / 2


def _triangle() -> Floats:
    low, high = -math.sqrt(0.75) / 2, math.sqrt(0.75) / 2
    return SIDE * np.array([[-0.5, low], [0.5, low], [0, high], [-0.5, low]])


# The outline of each shape at a height above its base, 0 to 1 of its own height.
SECTIONS: dict[str, Callable[[float], Floats]] = {
    "cube": lambda _: _rectangle(SIDE, SIDE),
    "sphere": lambda up: _circle(SIDE * math.sqrt(0.25 - (up - 0.5) ** 2)),
    "cone": lambda up: _circle(SIDE / 2 * (1 - up)),
    "pyramid": lambda up: _rectangle(SIDE * (1 - up), SIDE * (1 - up)),
    "horizontal_prism": lambda up: _rectangle(SIDE, SIDE * (1 - up)),
    "vertical_prism": lambda _: _triangle(),
}


def length_of(line: Floats) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def distance(points: Floats, line: Floats) -> Floats:
    """Of (m, 2) points from a polyline."""
    start, step = line[:-1], np.diff(line, axis=0)
    share = ((points[:, None] - start) * step).sum(axis=2) / (step**2).sum(axis=1)
    nearest = start + np.clip(share, 0, 1)[:, :, None] * step
    return np.asarray(np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1))


@pytest.mark.parametrize("corners", [True, False])
@pytest.mark.parametrize("shape", SECTIONS)
def test_a_palm_that_sweeps_through_a_small_shape_feels_its_outline(shape: str, corners: bool) -> None:
    """One closed arc on the outline at each height, and none above and below."""
    mesh, tall = getattr(Mesh, shape)(SIDE, CENTRE), TALL.get(shape, SIDE)
    toucher = Toucher(corners=corners)
    for up in np.linspace(-0.08, 1.12, 25):
        hand = Hand.flat(CENTRE + np.array([0, 0, (up - 0.5) * tall]))
        felt = toucher.touch(hand, mesh)
        if not 0 <= up <= 1:
            assert not felt
            assert felt.arcs == []
            assert felt.points is None
            continue
        outline = SECTIONS[shape](up)
        (arc,) = felt.arcs
        np.testing.assert_array_equal(arc[0], arc[-1])
        np.testing.assert_allclose(arc[:, 2], hand.quads[0, 0, 2], atol=1e-9)
        assert length_of(arc) == pytest.approx(length_of(outline), rel=0.005, abs=1e-3)
        if felt.points is None:
            assert length_of(arc) < 0.003
            continue
        positions = felt.points.positions - [*CENTRE[:2], 0]
        assert distance(positions[:, :2], outline).max() < 2e-4
        np.testing.assert_allclose(positions[:, 2], hand.quads[0, 0, 2], atol=1e-9)
        assert (felt.quads == 0).all()
        assert (felt.objects == 0).all()


@pytest.mark.parametrize("shape", SECTIONS)
def test_points_lie_on_the_object_in_their_own_quadrilateral(shape: str) -> None:
    """A level hand in shapes of full size."""
    mesh = getattr(Mesh, shape)()
    for height in (0.141, 0.17, 0.199):
        hand = Hand.flat((0.02, -0.03, height))
        felt = touch(hand, mesh, spacing=0.004, most_points=500)
        assert felt.points is not None
        for position, quad in zip(felt.points.positions, felt.quads, strict=True):
            corners = hand.quads[quad]
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            inside = np.cross(np.roll(corners, -1, axis=0) - corners, position - corners) @ normal
            edges = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1) * np.linalg.norm(normal)
            assert (inside / edges >= -1e-9).all()
        surface = trimesh.Trimesh(mesh.vertices, mesh.faces)
        offset = felt.points.positions[:, None] - surface.triangles[:, 0]
        outside = np.einsum("mfk,fk->mf", offset, surface.face_normals)
        assert np.abs(outside.max(axis=1)).max() < 1e-3  # all six are convex


def test_several_hands_feel_several_objects() -> None:
    hands = [Hand.flat((-0.2, 0, 0.17), "left"), Hand.flat((0.2, 0, 0.17), "right")]
    meshes = [Mesh.cube(SIDE, (x, 0, 0.17)) for x in (0.2, 0, -0.2)]
    felt = touch(hands, meshes, most_points=64)
    assert felt.points is not None
    assert len(felt.arcs) == 2
    assert set(felt.objects.tolist()) == {0, 2}
    assert ((felt.objects == 0) == (felt.quads == 16)).all()
    assert ((felt.points.positions[:, 0] > 0) == (felt.objects == 0)).all()
    assert len(felt.ids) == 2 * len(touch(hands[0], meshes[2]).ids)


def test_without_hands_or_objects_no_point_is_felt() -> None:
    for felt in (touch([], Mesh.cube()), touch(Hand.flat(), []), touch(Hand.flat((0.5, 0, 0.5)), Mesh.cube())):
        assert not felt
        assert felt.points is None
        assert felt.arcs == []
        assert felt.ids.size == felt.objects.size == felt.quads.size == felt.anchors.size == 0


def test_corners_are_stronger_on_request() -> None:
    hand, mesh = Hand.flat(), Mesh.cube(SIDE, CENTRE)
    strong, even = touch(hand, mesh), touch(hand, mesh, corners=False)
    assert strong.points is not None
    assert even.points is not None
    corners = strong.points.positions[strong.anchors]
    np.testing.assert_allclose(np.abs(corners - CENTRE)[:, :2], SIDE / 2, atol=1e-9)
    np.testing.assert_allclose(strong.points.amplitudes[strong.anchors], math.sqrt(2), rtol=1e-3)
    assert len(corners) == 4
    assert not even.anchors.any()
    assert (even.points.amplitudes == 1).all()
    assert len(even.ids) == round(4 * SIDE / 0.015)


def test_points_have_a_cap_and_a_spacing() -> None:
    hand, mesh = Hand.flat(), Mesh.cube(SIDE, CENTRE)
    assert len(touch(hand, mesh, spacing=2e-3, corners=False).ids) == MOST_POINTS
    assert len(touch(hand, mesh, spacing=2e-3, corners=False, most_points=1000).ids) == 80
    few = touch(hand, mesh, most_points=5)
    assert len(few.ids) <= 5
    assert few.anchors.sum() == 4
    dense = touch(hand, mesh, spacing=1e-3, most_points=1000)
    assert dense.points is not None
    assert len(dense.ids) == 160  # below 6 mm, edges make nothing denser
    assert CLOSEST > 1e-3


def test_other_things_than_hands_and_objects_are_refused() -> None:
    hand, mesh = Hand.flat(), Mesh.cube()
    with pytest.raises(ValueError, match="hands are a Mesh; they must be a Hand or a sequence of them"):
        touch(mesh, hand)  # type: ignore[arg-type]  # on purpose
    with pytest.raises(ValueError, match="object 1 is a Hand; it must be a Mesh"):
        touch(hand, [mesh, hand])  # type: ignore[list-item]  # on purpose
    with pytest.raises(ValueError, match=f"there are {MOST_OBJECTS + 1} objects; at most {MOST_OBJECTS} are possible"):
        touch(hand, [mesh] * (MOST_OBJECTS + 1))
    with pytest.raises(ValueError, match="there are 17 hands; at most 16 are possible"):
        touch([hand] * 17, mesh)
