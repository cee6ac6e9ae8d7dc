from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.hands import HandFrame, TrackedHand
from phasewire.host.hands.following import DOUBT, FASTEST, GAP, Follower
from phasewire.solver.contact.hand import Hand, Side

PERIOD = 0.01


def hand(x: float, number: int = 1, side: Side = "right") -> TrackedHand:
    return TrackedHand(Hand.flat((x, 0, 0.17), side), number)


def numbers(follower: Follower, frames: Sequence[tuple[TrackedHand, ...]], begin: float = 5.0) -> list[list[int]]:
    """The numbers that hands get, frame by frame, `PERIOD` apart."""
    found = (follower.follow(HandFrame(begin + place * PERIOD, hands)) for place, hands in enumerate(frames))
    return [[each.id for each in frame.hands] for frame in found]


def test_a_hand_that_vanishes_for_a_moment_keeps_its_number() -> None:
    follower = Follower()
    assert numbers(follower, [(hand(0, 1),), *[()] * 20, (hand(0.05, 2),)]) == [[0], *[[]] * 20, [0]]
    late = [(hand(0.05, 2),), *[()] * round(1.1 * GAP / PERIOD), (hand(0.05, 2),)]
    assert numbers(follower, late, 6.0)[-1] == [2]


def test_two_hands_that_swap_the_tracker_s_numbers_keep_theirs() -> None:
    frames = [(hand(-0.15, 1, "left"), hand(0.15, 2)), (hand(0.15, 1), hand(-0.15, 2, "left"))] * 5
    assert numbers(Follower(), frames) == [[0, 1], [1, 0]] * 5


def test_of_two_hands_side_by_side_the_tracker_s_numbers_tell_which_is_which() -> None:
    """Each hand is nearer to the former place of the other."""
    assert numbers(Follower(), [(hand(0, 1), hand(0.06, 2)), (hand(0.05, 1), hand(0.11, 2))]) == [[0, 1], [0, 1]]


def test_a_hand_of_the_other_side_nearby_is_another_one() -> None:
    assert numbers(Follower(), [(hand(0, 1),), (hand(0.01, 2, "left"),)]) == [[0], [1]]


def test_a_label_that_changes_sides_does_not_change_the_number() -> None:
    assert numbers(Follower(), [(hand(0, 1),), (hand(0, 1, "left"),), (hand(0, 1),)]) == [[0], [0], [0]]


def test_a_hand_that_stays_elsewhere_is_a_new_one() -> None:
    jumped = numbers(Follower(), [(hand(0),), *[(hand(0.4),)] * 20])
    accepted = next(place for place, ids in enumerate(jumped[1:]) if ids)
    assert DOUBT <= accepted * PERIOD <= DOUBT + PERIOD
    assert jumped[1 + accepted :] == [[1]] * (20 - accepted)


def test_a_hand_that_jumps_from_place_to_place_is_never_given() -> None:
    frames = [(hand(3 if place % 2 else -3),) for place in range(20)]
    assert numbers(Follower(), [(hand(0),), *frames]) == [[0], *[[]] * 20]


def test_glitches_at_one_place_do_not_add_up() -> None:
    frames = [(hand(3 if place % 2 else 0),) for place in range(20)]
    assert numbers(Follower(), frames) == [[0], []] * 10


def test_a_new_hand_is_given_at_once() -> None:
    assert numbers(Follower(), [(hand(0, 1),), (hand(0, 1), hand(0.4, 2))]) == [[0], [0, 1]]


def test_a_hand_that_is_seen_twice_is_given_once() -> None:
    frame = Follower().follow(HandFrame(0.0, (hand(0, 1), hand(0.01, 2), hand(0.01, 3, "left"))))
    assert [each.id for each in frame.hands] == [0, 1]
    assert frame.notes == ("the right hand 2 was left out: another one is at the same place",)


def test_forgotten_hands_do_not_come_back() -> None:
    follower = Follower()
    assert numbers(follower, [(hand(0),)]) == [[0]]
    follower.forget()
    assert numbers(follower, [(hand(0),)], 5.01) == [[1]]


@given(seed=st.integers(0, 2**32 - 1))
def test_numbers_are_unique_and_hands_never_faster_than_they_can_be(seed: int) -> None:
    rng = np.random.default_rng(seed)
    follower = Follower()
    last: dict[int, tuple[float, np.ndarray]] = {}
    time = 0.0
    for _ in range(30):
        time += rng.choice([0.0, 0.001, 0.01, 0.1, 1.0])
        sides: list[Side] = ["left", "right"]
        hands = tuple(
            hand(rng.uniform(-0.5, 0.5), int(rng.integers(3)), sides[rng.integers(2)]) for _ in range(rng.integers(5))
        )
        frame = follower.follow(HandFrame(time, hands))
        ids = [each.id for each in frame.hands]
        assert len(set(ids)) == len(ids)
        assert len(ids) + len(frame.notes) == len(hands)
        for each in frame.hands:
            if each.id in last:
                before, place = last[each.id]
                assert np.linalg.norm(each.hand.centre - place) <= 0.0301 + FASTEST * (time - before)
            last[each.id] = (time, each.hand.centre)
        assert len(follower._tracks) < 100
