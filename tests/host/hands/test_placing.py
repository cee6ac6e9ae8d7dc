from __future__ import annotations

import numpy as np
from phasewire.host.hands import HandFrame, HandSource, Pose, TrackedHand
from phasewire.host.hands.placing import PlacedHands
from phasewire.host.hands.sources import PlayedHands
from phasewire.solver.contact.hand import Hand

from tests.host.hands.clocks import Clock

UP = Pose.from_table({"translation_mm": [0, 0, 100]})


def source() -> PlayedHands:
    """A hand whose number changes with each frame."""
    frames = (HandFrame(place / 100, (TrackedHand(Hand.flat(), 7 + place),), place) for place in range(3))
    played = PlayedHands("three", frames, 100, Clock())
    played.notes = ("a note",)
    return played


def test_frames_are_placed_and_hands_keep_their_numbers_either_way() -> None:
    looped, listed = PlacedHands(source(), UP), PlacedHands(source(), UP)
    in_turn = [looped.next_frame(1) for _ in range(3)]
    for frames in (list(listed), [frame for frame in in_turn if frame is not None]):
        assert [[each.id for each in frame.hands] for frame in frames] == [[0]] * 3
        for frame in frames:
            np.testing.assert_allclose(frame.hands[0].hand.landmarks, Hand.flat((0, 0, 0.27)).landmarks)
    assert looped.next_frame(1) is None
    assert looped.ended
    assert listed.ended


def test_a_placed_source_is_a_source_and_closes_the_other() -> None:
    inner = source()
    placed: HandSource = PlacedHands(inner)
    with placed:
        assert (placed.name, placed.rate, placed.live, placed.notes) == ("three", 100, False, ("a note",))
        assert not placed.ended
    assert inner.ended
    assert placed.next_frame(1) is None
