"""What a person senses: the physics against the readable twin, and the errors against the numbers that they state."""

from __future__ import annotations

import math

import numpy as np
import pytest
from phasewire import Mesh, TransducerArray
from phasewire.feel.unfolding import SkinPatch, Unfolded
from phasewire.hil.sound.emission import emitted_waves
from phasewire.hil.study.noticing import (
    BLUR,
    HAND_ERROR,
    WEBER,
    blurred,
    cells_of,
    felt_on_hand,
    noticed,
    sensed,
)
from phasewire.hil.study.persons import Exploration, Person
from phasewire.hil.study.trials import explored
from phasewire.solver.contact.hand import Hand

pytestmark = pytest.mark.slow  # devices, skin and ears of whole trials

ARRAY = TransducerArray.grid()
STILL = Exploration(Hand.flat((0, 0, 0)), np.array([0, 0, 0.2]), np.zeros(3), np.zeros(5), np.zeros(5), np.zeros(2))
"""A level hand, at rest after it has come down, its palm over the middle of the array."""
SECONDS = 0.8
PATCH = SkinPatch((0, 0, 0.2), 0.1, 0.1, 2e-3)


@pytest.fixture(scope="module")
def ball() -> tuple[np.ndarray, Unfolded]:
    """What is felt of a ball of 2 cm on the palm."""
    return felt_on_hand(explored(Mesh.sphere(0.02, (0, 0, 0.2)), STILL, SECONDS, ARRAY), STILL, ARRAY)


def test_what_is_felt_most_is_where_the_object_is(ball: tuple[np.ndarray, Unfolded]) -> None:
    levels, skin = ball
    assert levels.shape == (16, len(skin.positions))
    late = levels[-4:].mean(axis=0)
    place = skin.at(STILL.at(SECONDS)).positions[late.argmax()]
    assert np.linalg.norm(place - [0, 0, 0.2]) < 0.02
    assert late.max() > 1


def test_before_the_hand_is_there_nothing_is_felt(ball: tuple[np.ndarray, Unfolded]) -> None:
    """It begins 8 cm above its place, and the ball has a radius of 1 cm."""
    levels, _ = ball
    assert levels[0].max() < 1e-2 * levels.max()


def test_a_silent_device_is_not_felt() -> None:
    silent = explored(Mesh.sphere(0.02, (0, 0, 0.2)), STILL, SECONDS, ARRAY, silent=True)
    assert not emitted_waves(silent.capture, ARRAY, silent.first, silent.last).waves.any()
    levels, _ = felt_on_hand(silent, STILL, ARRAY)
    assert not levels.any()


def test_the_same_path_makes_the_same_bits() -> None:
    path, mesh = Person.drawn(0, 0).explores(0), Mesh.cube()
    one, other = (explored(mesh, path, 0.6, ARRAY) for _ in range(2))
    assert (one.first, one.last) == (other.first, other.last)
    assert one.last - one.first == 24_000
    first, second = (each.capture.drives(each.first, each.last) for each in (one, other))
    assert first.any()
    assert np.array_equal(first, second)


def test_a_point_is_blurred_to_the_error_of_its_place() -> None:
    levels = np.zeros((1, PATCH.mask.size))
    levels[0, PATCH.mask.size // 2] = 1
    spread = blurred(levels, PATCH)[0]
    offset = PATCH.positions - PATCH.positions[PATCH.mask.size // 2]
    for axis in (0, 1):
        deviation = math.sqrt(spread @ offset[:, axis] ** 2 / spread.sum())
        assert deviation == pytest.approx(BLUR, rel=0.02)
    # The mean distance of points of such a distribution is the published mean error.
    assert spread @ np.linalg.norm(offset, axis=1) / spread.sum() == pytest.approx(8.5e-3, rel=0.02)


def test_an_even_strength_stays_even_up_to_the_border_of_the_skin() -> None:
    skin = Unfolded.of(Hand.flat(), 5e-3)
    np.testing.assert_allclose(blurred(np.full((2, len(skin.positions)), 3.0), skin), 3.0, rtol=1e-9)


def test_strength_has_webers_error() -> None:
    found = noticed(np.full(200_000, 10.0), np.random.default_rng(1))
    assert found.mean() == pytest.approx(10, rel=2e-3)
    assert found.std() / found.mean() == pytest.approx(WEBER, rel=0.01)


def test_what_is_below_the_threshold_is_not_noticed() -> None:
    chance = np.random.default_rng(2)
    assert not noticed(np.full(10_000, 0.4), chance).any()
    assert (noticed(np.full(10_000, 1.0), chance) > 0).mean() == pytest.approx(0.5, abs=0.02)
    found = noticed(np.full(10_000, 2.0), chance)
    assert (found[found > 0] >= 1).all()


def test_the_hand_seems_elsewhere_by_one_error_throughout_a_trial() -> None:
    path = Person.drawn(0, 0).explores(0)
    skin = Unfolded.of(path.hand, 6e-3)
    levels = np.zeros((4, len(skin.positions)))
    chance = np.random.default_rng(3)
    found = np.array([sensed(levels, skin, path, 1.0, chance).places for _ in range(400)])
    true = np.stack([cells_of(skin) @ skin.at(path.at(time)).positions for time in (0.125, 0.375, 0.625, 0.875)])
    error = found - true
    np.testing.assert_allclose(error, error[:, :1, :1] + 0 * error, atol=1e-12)
    assert error[:, 0, 0].std(axis=0) == pytest.approx(HAND_ERROR, rel=0.15)
