"""Persons and their paths."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.hil.study.persons import Person
from phasewire.solver.contact.hand import LANDMARKS

TIMES = np.arange(0, 3, 1e-3)


@pytest.fixture(params=range(5))
def person(request: pytest.FixtureRequest) -> Person:
    return Person.drawn(request.param, seed=1)


def test_a_person_is_the_same_for_a_number_and_a_seed(person: Person) -> None:
    assert Person.drawn(person.number, person.seed) == person
    assert Person.drawn(person.number, person.seed + 1).pace != person.pace
    assert Person.drawn(person.number + 10, person.seed).length != person.length


def test_hands_have_the_deviation_of_a_survey() -> None:
    lengths = np.array([Person.drawn(number, 0).length for number in range(2000)])
    assert lengths.mean() == pytest.approx(0.1893, abs=1e-3)
    assert lengths.std() == pytest.approx(0.010, rel=0.1)
    assert abs(lengths - 0.1893).max() <= 0.0201
    sides = [Person.drawn(number, 0).side for number in range(2000)]
    assert sides.count("left") / 2000 == pytest.approx(0.1, abs=0.02)


def test_a_hand_moves_as_a_whole(person: Person) -> None:
    path = person.explores(0)
    early, late = (np.linalg.norm(hand.landmarks[:, None] - hand.landmarks, axis=2) for hand in map(path.at, (0.1, 2)))
    assert early.shape == (LANDMARKS, LANDMARKS)
    np.testing.assert_allclose(early, late, atol=1e-12)
    assert path.at(0.7).side == person.side
    np.testing.assert_allclose(path.at(0.7).centre, path.pose(0.7)[1], atol=1e-9)
