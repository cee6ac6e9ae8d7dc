"""Points from frame to frame: a surviving point keeps its identity and moves within its bound."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Hand, Mesh, Toucher
from phasewire.solver import Touch
from phasewire.solver.contact.feeling import curvature_of
from phasewire.solver.contact.scene import Scene
from phasewire.solver.contact.touch import FRAME_SECONDS
from phasewire.solver.contact.tracking import FOLLOW, JUMP, SETTLE, STRANGE, STRAY

from tests.solver.contact import literal_tracking
from tests.solver.contact.literal_density import lines
from tests.solver.contact.moving import moving_hand

Floats = NDArray[np.float64]
SHAPES = ["cone", "sphere", "pyramid", "horizontal_prism", "vertical_prism", "cube"]


def some_hand(rng: np.random.Generator) -> Hand:
    hand = Hand.flat(curl=rng.uniform(0, 0.6)).rotated(rng.uniform(0, 360), rng.normal(size=3))
    return hand.moved(rng.uniform(-0.03, 0.03, 3))


def places(felt: Touch) -> dict[int, Floats]:
    return dict(zip(felt.ids.tolist(), felt.points.positions, strict=True)) if felt.points else {}


def motion(one: Hand, other: Hand) -> float:
    return float(np.linalg.norm(one.quads - other.quads, axis=2).max())


def nearest(position: Floats, arc: Floats) -> tuple[float, float]:
    """The distance of a position from a polyline, and the place of its nearest point in pieces from the beginning."""
    step = np.diff(arc, axis=0)
    share = np.clip(((position - arc[:-1]) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-300), 0, 1)
    distance = np.linalg.norm(arc[:-1] + share[:, None] * step - position, axis=1)
    i = int(np.argmin(distance))
    return float(distance[i]), float(i + share[i])


def from_arcs(position: Floats, arcs: list[Floats]) -> float:
    """Distance of a position from the nearest of some polylines."""
    return min((nearest(position, arc)[0] for arc in arcs), default=np.inf)


def sweep(seed: int, frames: int, step: float) -> Iterator[Hand]:
    """A hand in a straight line that turns a little."""
    rng = np.random.default_rng(seed)
    hand, way, axis = some_hand(rng), rng.normal(size=3), rng.normal(size=3)
    way *= step / np.linalg.norm(way)
    for k in range(frames):
        yield hand.moved(way * (k - frames / 2)).rotated(step * 300 * k, axis)


@pytest.mark.parametrize("shape", SHAPES)
@given(seed=st.integers(0, 2**32 - 1), step=st.floats(1e-5, 1e-2))
@settings(max_examples=15, deadline=None)
def test_survivors_move_within_their_bound(shape: str, seed: int, step: float) -> None:
    """Not farther than their arcs have moved and a multiple of the hand's motion; if the arcs run away, they end."""
    mesh, toucher = getattr(Mesh, shape)(), Toucher()
    seen: set[int] = set()
    for (before, one), (after, other) in itertools.pairwise(
        (hand, toucher.touch(hand, mesh)) for hand in sweep(seed, 25, step)
    ):
        old, new, moved = places(one), places(other), motion(before, after)
        for identity in old.keys() & new.keys():
            distance = float(np.linalg.norm(new[identity] - old[identity]))
            away = from_arcs(old[identity], other.arcs)
            assert distance <= min(STRAY * moved + JUMP, moved + 0.015) + FOLLOW * moved + SETTLE + 1e-9
            if not (other.anchors[other.ids == identity] or one.anchors[one.ids == identity]):
                # The arc of its own quadrilateral may be this much farther than the nearest arc.
                assert distance <= away + STRANGE + FOLLOW * moved + SETTLE + 1e-9
        seen |= old.keys()
        assert not (new.keys() - old.keys()) & seen  # no identity twice
        assert len(new) == len(other.ids)
        for identity, position in new.items():
            assert from_arcs(position, other.arcs) < 1e-9, identity


@pytest.mark.parametrize("shape", SHAPES)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_a_hand_at_rest_has_points_at_rest(shape: str, seed: int) -> None:
    """After some frames the points have settled: they stay, evenly spaced."""
    mesh, toucher = getattr(Mesh, shape)(), Toucher(corners=False, most_points=500)
    for hand in sweep(seed, 12, 3e-3):
        toucher.touch(hand, mesh)
    for _ in range(round(0.015 / SETTLE) + 30):
        before = toucher.touch(hand, mesh)
    after = toucher.touch(hand, mesh)
    np.testing.assert_array_equal(after.ids, before.ids)
    if after.points is None or before.points is None:
        return
    np.testing.assert_allclose(after.points.positions, before.points.positions, rtol=0, atol=1e-7)
    found = 0
    for line in lines(after.cuts, np.zeros(len(after.cuts.vertices)), 0.015):
        length = line.reached[-1]
        every = [nearest(position, line.vertices) for position in after.points.positions]
        places_in_pieces = [place for distance, place in every if distance < 1e-9]
        at = np.sort(np.interp(places_in_pieces, np.arange(len(line.reached)), line.reached))
        found += len(at)
        if line.closed and len(at):
            np.testing.assert_allclose(np.diff(at, append=at[0] + length), length / len(at), atol=1e-6)
        elif len(at):
            np.testing.assert_allclose(at, length * (np.arange(len(at)) + 0.5) / len(at), atol=1e-6)
        steps = length / 0.015
        assert len(at) < 2 or abs(steps - len(at)) <= 1 + 1e-6 or 1 / 1.5 - 1e-6 <= len(at) / steps <= 1.5 + 1e-6
    assert found >= len(after.ids)


@pytest.mark.parametrize("corners", [True, False])
@pytest.mark.parametrize("motion", ["sweep", "flex", "explore"])
@pytest.mark.parametrize("name", ["sphere", "cube"])
def test_it_is_the_literal_tracking(name: str, motion: str, corners: bool) -> None:
    """Frame after frame, on two objects at once; the literal one begins anew from the points of the compiled one."""
    mesh = getattr(Mesh, name)(0.08)
    meshes, toucher = [mesh.moved((-0.03, 0.01, 0)), mesh.moved((0.04, 0.03, 0.03))], Toucher(0.012, corners, 4096)
    scene, quads, seen = Scene.of(meshes, corners), None, 0
    for _, hand in moving_hand(motion, 100, 0.3, 3):
        moved = np.full((2, 1), np.inf if quads is None else np.linalg.norm(hand.quads - quads, axis=2).max())
        before = [
            literal_tracking.Point(identity, position, of, quad, bool(anchor), wait)
            for position, (identity, of, quad, anchor, wait) in zip(
                toucher._positions, toucher._marks.T.tolist(), strict=True
            )
        ]
        fresh, quads = toucher._fresh, hand.quads
        felt = toucher.touch(hand, meshes)
        curvature = curvature_of(scene, felt.cuts.along, felt.cuts.names, felt.cuts.rows)
        arcs = lines(felt.cuts, curvature, 0.012)
        literal = literal_tracking.follow(arcs, moved, before, fresh, 10_000, 0.012)
        order = np.argsort(toucher._marks[0])
        marks = [(each.identity, each.object, each.quad, each.anchor, each.wait) for each in literal]
        np.testing.assert_array_equal(toucher._marks[:, order].T, np.reshape(marks, (-1, 5)))
        expected = np.reshape([each.position for each in literal], (-1, 3))
        np.testing.assert_allclose(toucher._positions[order], expected, rtol=0, atol=1e-9)
        seen += len(felt.ids)
    assert seen > 100


@pytest.mark.parametrize("shape", SHAPES)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_points_move_with_a_hand_that_carries_its_object(shape: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    hand, mesh, toucher = some_hand(rng), getattr(Mesh, shape)(), Toucher()
    first = toucher.touch(hand, mesh)
    offset = rng.uniform(-0.02, 0.02, 3)
    second = toucher.touch(hand.moved(offset), mesh.moved(offset))
    old, new = places(first), places(second)
    assert old.keys() == new.keys()
    for identity, position in old.items():
        np.testing.assert_allclose(new[identity], position + offset, rtol=0, atol=1e-6)


def test_points_come_and_go_one_by_one_and_keep_their_order() -> None:
    """A level palm rises through a cone in steps of half a millimetre: its circle shrinks from 28 cm to 0."""
    mesh, toucher = Mesh.cone(0.06, (0, 0, 0.17)), Toucher(corners=False)
    frames = [toucher.touch(Hand.flat((0, 0, z)), mesh) for z in np.arange(0.14, 0.202, 0.5e-3)]
    changes = 0
    for one, other in itertools.pairwise(frames[1:]):
        assert abs(len(one.ids) - len(other.ids)) <= 1
        changes += len(one.ids) != len(other.ids)
        both = [identity for identity in one.ids.tolist() if identity in other.ids]
        assert [identity for identity in other.ids.tolist() if identity in both] == both
    assert len(frames[1].ids) == 12
    assert not frames[-1]
    assert changes == 12
    assert max(felt.ids.max(initial=0) for felt in frames) < 16


@pytest.mark.parametrize("step", [None, 0.001, 0.008, 0.05])
def test_a_new_point_on_an_arc_that_grows_is_felt_after_30_ms(step: float | None) -> None:
    """The circle of a cone around a palm that sinks at once, and then stays; the first contact is felt at once."""
    mesh, toucher = Mesh.cone(0.06, (0, 0, 0.17)), Toucher(corners=False)
    times = itertools.repeat(None) if step is None else itertools.count(5.0, step)
    first = toucher.touch(Hand.flat((0, 0, 0.185)), mesh, next(times))
    felt, frames = first, 0
    while len(felt.ids) == len(first.ids) and frames < 100:
        felt, frames = toucher.touch(Hand.flat((0, 0, 0.15)), mesh, next(times)), frames + 1
    waited = frames - 1
    assert waited == math.ceil(0.03 / (step or FRAME_SECONDS) - 1e-9)
    assert set(first.ids.tolist()) < set(felt.ids.tolist())


def test_a_new_point_takes_the_index_of_one_that_ended() -> None:
    """Of two objects one goes and another comes: the points of the third keep their indices."""
    hand, toucher = Hand.flat(), Toucher(corners=False)
    left, right, middle = (Mesh.cube(0.012, (x, 0, 0.17)) for x in (-0.02, 0.02, 0))
    away = Mesh.cube(0.012, (0, 0, 0.4))
    first = toucher.touch(hand, [left, away, middle])
    second = toucher.touch(hand, [away, right, middle])
    assert len(first.ids) == len(second.ids)
    stays = first.objects == 2
    np.testing.assert_array_equal(second.ids[stays], first.ids[stays])
    assert not set(second.ids[~stays].tolist()) & set(first.ids.tolist())


def test_hands_are_matched_by_their_place() -> None:
    """Trackers change the order of hands, and lose them."""
    mesh, toucher = Mesh.cube(), Toucher()
    right = Hand.flat((0.05, 0, 0.17)).rotated(30, (1, 0, 0))
    left = Hand.flat((-0.08, 0, 0.16), "left").rotated(30, (1, 0, 0))
    first = toucher.touch([right, left], mesh)
    second = toucher.touch([left, right], mesh)
    assert first.ids.size
    old, new = places(first), places(second)
    assert old.keys() == new.keys()
    assert max(np.linalg.norm(new[identity] - old[identity]) for identity in old) < 1e-9
    alone = toucher.touch([right], mesh)
    assert set(alone.ids.tolist()) < set(first.ids.tolist())
    assert not toucher.touch([], mesh)
    assert not set(toucher.touch([right], mesh).ids.tolist()) & set(first.ids.tolist())


def test_identities_do_not_outlive_their_object_or_hand() -> None:
    hand, toucher = Hand.flat().rotated(30, (1, 0, 0)), Toucher()
    frames = [toucher.touch(hand, Mesh.cube())]
    frames.append(toucher.touch(hand, Mesh.cube()))  # of its own solid
    frames.append(toucher.touch(hand.moved((0.001, 0, 0)).rotated(60, (0, 1, 0)), Mesh.cube()))
    toucher.forget()
    frames.append(toucher.touch(hand, Mesh.cube()))
    identities = [identity for felt in frames for identity in felt.ids.tolist()]
    assert len(set(identities)) == len(identities) > 0


def test_points_of_a_closed_arc_turn_with_its_object() -> None:
    """No corner holds them, and they do not begin anew when another corner is the farthest in some direction."""
    toucher, mesh = Toucher(corners=False), Mesh.cube(0.034, (0, 0, 0.17))
    first = toucher.touch(Hand.flat(), mesh)
    assert first.points is not None
    for degrees in range(0, 91, 3):
        turned = mesh.rotated(degrees)
        felt = toucher.touch(Hand.flat(), turned)
        assert felt.points is not None
        np.testing.assert_array_equal(felt.ids, first.ids)
        on_cube = (felt.points.positions - turned.offset) @ turned.rotation
        np.testing.assert_allclose(on_cube, first.points.positions - mesh.offset, rtol=0, atol=1e-6)
