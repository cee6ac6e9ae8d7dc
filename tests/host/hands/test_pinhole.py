from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.hands.pinhole import Landmarks, in_space, unmirrored


def project(hand: Landmarks, aspect: float, view_degrees: float) -> Landmarks:
    """A pinhole camera: what the definition of MediaPipe's landmarks says of a hand in camera coordinates."""
    right, down, away = hand.T
    half = math.tan(math.radians(view_degrees) / 2)
    return np.column_stack(
        (
            (right / (away * half) + 1) / 2,
            (down / (away * half * aspect) + 1) / 2,
            (away - away[0]) / (2 * half * away[0]),
        )
    )


@st.composite
def hands_before_a_camera(draw: st.DrawFn) -> Landmarks:
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    hand = generator.uniform(-0.08, 0.08, (21, 3))
    hand[9] = hand[0] + generator.uniform(0.03, 0.1, 3) * generator.choice([-1, 1], 3)
    return hand + [draw(st.floats(-0.3, 0.3)), draw(st.floats(-0.3, 0.3)), draw(st.floats(0.25, 1.5))]


@given(hands_before_a_camera(), st.floats(0.4, 2.5), st.floats(20, 120))
def test_a_hand_that_is_projected_comes_back(hand: Landmarks, aspect: float, view: float) -> None:
    palm = float(np.linalg.norm(hand[9] - hand[0]))
    np.testing.assert_allclose(in_space(project(hand, aspect, view), aspect, view, palm), hand, atol=1e-11)


def test_a_palm_of_a_tenth_of_the_width_in_a_view_of_90_degrees_is_five_palms_away() -> None:
    landmarks = np.full((21, 3), [0.5, 0.5, 0.0])
    landmarks[9, 0] = 0.6  # the width is 2 m at 1 m; 0.1 of it is the palm's 0.09 m at 0.45 m
    np.testing.assert_allclose(in_space(landmarks, 0.75, 90, 0.09)[[0, 9]], [[0, 0, 0.45], [0.09, 0, 0.45]], atol=1e-15)


def test_right_bottom_and_away_are_positive() -> None:
    landmarks = np.full((21, 3), [0.5, 0.5, 0.0])
    landmarks[9] = [0.6, 0.7, 0.1]
    wrist, knuckle = in_space(landmarks, 1, 60, 0.09)[[0, 9]]
    assert (knuckle > wrist).all()


def test_a_hand_of_twice_the_size_is_twice_as_far() -> None:
    hand = np.random.default_rng(5).uniform(-0.08, 0.08, (21, 3)) + [0, 0, 0.5]
    seen = project(hand, 0.75, 60)
    np.testing.assert_allclose(in_space(seen, 0.75, 60, 0.2), 2 * in_space(seen, 0.75, 60, 0.1))


@given(hands_before_a_camera())
def test_a_mirrored_picture_gives_the_same_hand(hand: Landmarks) -> None:
    palm = float(np.linalg.norm(hand[9] - hand[0]))
    mirrored = project(hand * [-1, 1, 1], 0.75, 60)  # as a mirror beside the camera would show it
    landmarks, side = unmirrored(mirrored, "left")
    assert side == "right"
    np.testing.assert_allclose(in_space(landmarks, 0.75, 60, palm), hand, atol=1e-11)
    again, other = unmirrored(landmarks, side)
    assert other == "left"
    np.testing.assert_allclose(again, mirrored, atol=1e-15)


@pytest.mark.parametrize(
    ("index", "value", "message"),
    [
        ((3, 1), math.nan, "not finite"),
        ((3, 2), -math.inf, "not finite"),
        ((20, 2), -0.9, "in or behind the camera"),
        ((9,), [0.4, 0.4, 0.0], "one point"),
    ],
)
def test_what_no_hand_can_look_like_is_refused(index: tuple[int, ...], value: object, message: str) -> None:
    landmarks = np.full((21, 3), [0.4, 0.4, 0.0])
    landmarks[9, 0] = 0.6
    landmarks[index] = value
    with pytest.raises(ValueError, match=message):
        in_space(landmarks, 0.75, 60, 0.09)
