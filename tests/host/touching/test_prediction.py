"""Prediction: a steady hand is met exactly, a jump does not throw it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.hands.frames import HandFrame, TrackedHand
from phasewire.host.touching.prediction import MOST_AHEAD_SECONDS, MOST_SPEED, Predictor

from .ring import hand_at


def frame(time: float, *places: tuple[float, float, float], first: int = 0) -> HandFrame:
    return HandFrame(time, tuple(TrackedHand(hand_at(place), first + k) for k, place in enumerate(places)))


def centre(predictor: Predictor, seen: HandFrame, moment: float) -> np.ndarray:
    return np.asarray(predictor.hands(seen, moment)[0].centre)


@given(
    velocity=st.tuples(*[st.floats(-1, 1)] * 3),
    rate=st.sampled_from([60.0, 120.0, 1000.0]),
    ahead=st.floats(0, MOST_AHEAD_SECONDS),
)
def test_a_hand_of_constant_velocity_is_met(velocity: tuple[float, float, float], rate: float, ahead: float) -> None:
    predictor = Predictor()
    speed, begin = np.array(velocity), np.array([0.0, 0.0, 0.2])
    frames = round(0.2 * rate)
    for number in range(frames):
        time = number / rate
        x, y, z = begin + speed * time
        met = centre(predictor, frame(time, (x, y, z)), time + ahead)
    error = np.linalg.norm(met - (begin + speed * (time + ahead)))
    assert error <= 0.05 * np.linalg.norm(speed) * ahead + 1e-12


@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.floats(-1, 10))
def test_a_jump_of_the_tracking_does_not_throw_the_hand(jump: tuple[float, float, float], later: float) -> None:
    predictor = Predictor()
    for number in range(20):
        predictor.hands(frame(number / 100, (0, 0, 0.2)), number / 100)
    place = (jump[0], jump[1], 0.2 + jump[2])
    met = centre(predictor, frame(0.2, place), 0.2 + later)
    assert np.linalg.norm(met - place) <= MOST_SPEED * MOST_AHEAD_SECONDS
    if np.linalg.norm(jump) > MOST_SPEED * 0.0101:
        np.testing.assert_allclose(met, place, atol=1e-12)


@pytest.mark.parametrize("gap", [0.0, -0.1, 1.0])
def test_after_a_gap_a_hand_has_no_known_speed(gap: float) -> None:
    predictor = Predictor()
    for number in range(10):
        predictor.hands(frame(number / 100, (number / 100, 0, 0.2)), 0)
    time = 0.09 + gap
    np.testing.assert_allclose(centre(predictor, frame(time, (0.1, 0, 0.2)), time + 0.02), (0.1, 0, 0.2), atol=1e-12)


def test_hands_are_distinguished_by_their_number_and_forgotten_when_they_are_gone() -> None:
    predictor = Predictor()
    for number in range(50):
        time = number / 100
        predictor.hands(frame(time, (time, 0, 0.2), (0, -time, 0.2)), time)
    one, two = predictor.hands(frame(0.5, (0.5, 0, 0.2), (0, -0.5, 0.2)), 0.51)
    np.testing.assert_allclose(one.centre, (0.51, 0, 0.2), atol=3e-4)
    np.testing.assert_allclose(two.centre, (0, -0.51, 0.2), atol=3e-4)
    predictor.hands(frame(0.51), 0.51)
    np.testing.assert_allclose(centre(predictor, frame(0.52, (0.52, 0, 0.2)), 0.53), (0.52, 0, 0.2), atol=1e-12)
