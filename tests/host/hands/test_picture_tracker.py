from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from phasewire.host.hands.picture_tracker import CameraView, PictureTracker, SeenHand
from phasewire.solver.contact.hand import Hand, Side

from tests.host.hands.pictures import project

VIEW = CameraView(fov=70)
ASPECT = 0.75


def hand_at(x: float, side: Side = "right") -> Hand:
    return Hand.flat([x, 0.02, 0.4], side, curl=0.2)


def seen(hand: Hand, view: CameraView = VIEW) -> SeenHand:
    if view.mirrored:
        side: Side = "left" if hand.side == "right" else "right"
        return SeenHand(project(hand.landmarks * [-1, 1, 1], ASPECT, view.fov), side)
    return SeenHand(project(hand.landmarks, ASPECT, view.fov), hand.side)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_hand_is_placed_where_it_is(side: Side, mirrored: bool) -> None:
    view = replace(VIEW, mirrored=mirrored)
    hand = hand_at(0.03, side)
    frame = PictureTracker(view).frame(12.5, [seen(hand, view)], ASPECT)
    assert (frame.time, frame.number, frame.notes, len(frame.hands)) == (12.5, 0, (), 1)
    assert frame.hands[0].hand.side == side
    np.testing.assert_allclose(frame.hands[0].hand.landmarks, hand.landmarks, atol=1e-12)


def test_an_impossible_hand_is_left_out_with_a_note() -> None:
    landmarks = np.full((21, 3), [0.5, 0.5, 0.0])
    frame = PictureTracker(VIEW).frame(0, [SeenHand(landmarks, "right"), seen(hand_at(0, "left"))], ASPECT)
    assert [tracked.hand.side for tracked in frame.hands] == ["left"]
    assert frame.notes == ("a right hand was left out: wrist and knuckles are one point in the picture",)
