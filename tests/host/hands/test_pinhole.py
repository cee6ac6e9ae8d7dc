from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.hands.pinhole import Landmarks, in_space
from phasewire.solver.contact.anatomy import LENGTH, NEUTRAL, PALM

from tests.host.hands.pictures import project


def length(hand: Landmarks) -> float:
    """The length of the hand whose palm this is."""
    palms = [np.mean([math.dist(each[knuckle], each[0]) for knuckle in PALM]) for each in (hand, NEUTRAL)]
    return float(LENGTH * palms[0] / palms[1])


@st.composite
def hands_before_a_camera(draw: st.DrawFn) -> Landmarks:
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    hand = generator.uniform(-0.08, 0.08, (21, 3))
    place = np.array([draw(st.floats(-0.3, 0.3)), draw(st.floats(-0.3, 0.3)), draw(st.floats(0.25, 1.5))])
    return np.asarray(hand + place)


@given(hands_before_a_camera(), st.floats(0.4, 2.5), st.floats(20, 120))
def test_a_hand_that_is_projected_comes_back(hand: Landmarks, aspect: float, view: float) -> None:
    np.testing.assert_allclose(in_space(project(hand, aspect, view), aspect, view, length(hand)), hand, atol=1e-11)


def test_a_palm_of_a_tenth_of_the_width_in_a_view_of_90_degrees_is_five_palms_away() -> None:
    landmarks = np.full((21, 3), [0.5, 0.5, 0.0])
    landmarks[[5, 9, 13, 17], 0] = [0.6, 0.6, 0.4, 0.4]
    placed = in_space(landmarks, 0.75, 90)  # the width is twice the distance
    palm = 0.0924  # of the mean hand: from its wrist to its knuckles
    np.testing.assert_allclose(
        placed[[0, 9, 17]], [[0, 0, 5 * palm], [palm, 0, 5 * palm], [-palm, 0, 5 * palm]], rtol=0.01
    )


@pytest.mark.parametrize(
    ("index", "value", "message"),
    [
        ((3, 1), math.nan, "not finite"),
        ((3, 2), -math.inf, "not finite"),
        ((20, 2), -0.9, "in or behind the camera"),
        ((slice(None), 0), 0.4, "one point"),
    ],
)
def test_what_no_hand_can_look_like_is_refused(index: tuple[int | slice, ...], value: object, message: str) -> None:
    landmarks = np.full((21, 3), [0.4, 0.4, 0.0])
    landmarks[9, 0] = 0.6
    landmarks[index] = value
    with pytest.raises(ValueError, match=message):
        in_space(landmarks, 0.75, 60)
