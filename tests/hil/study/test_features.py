"""The picture in space, by sensations whose place is known."""

from __future__ import annotations

import numpy as np
from phasewire.hil.study.features import CUBE, FELT, LOW, SHAPE, picture_in_space
from phasewire.hil.study.noticing import Sensed

COUNT = int(np.prod(SHAPE))


def cube_of(*place: int) -> int:
    return int(np.ravel_multi_index(place, SHAPE))


def middle(*place: int) -> np.ndarray:
    return LOW + (np.array(place) + 0.5) * CUBE


def test_strength_is_where_the_skin_was_and_its_mean_over_visits() -> None:
    places = np.array([[middle(1, 2, 3), middle(0, 0, 0)], [middle(1, 2, 3), middle(5, 5, 5)]])
    found = picture_in_space(Sensed(np.array([[4.0, 0.0], [2.0, 7.0]]), places))
    assert found.shape == (2 * COUNT,)
    felt, visits = found[FELT], found[FELT.stop :]
    assert {int(at): float(felt[at]) for at in np.flatnonzero(felt)} == {cube_of(1, 2, 3): 3.0, cube_of(5, 5, 5): 7.0}
    assert (visits[cube_of(1, 2, 3)], visits[cube_of(0, 0, 0)], visits.sum()) == (0.5, 0.25, 1.0)


def test_what_is_outside_is_left_out() -> None:
    places = np.array([[middle(-1, 0, 0), middle(5, 5, 6)]])
    assert not picture_in_space(Sensed(np.ones((1, 2)), places)).any()


def test_if_nothing_is_felt_only_the_hand_is_left() -> None:
    places = np.random.default_rng(0).uniform(LOW, LOW + 6 * CUBE, (20, 9, 3))
    loud, silent = (picture_in_space(Sensed(np.full((20, 9), level), places)) for level in (3.0, 0.0))
    assert not silent[FELT].any()
    assert loud[FELT].any()
    assert silent[FELT.stop :].tolist() == loud[FELT.stop :].tolist()


def test_the_cubes_hold_the_objects() -> None:
    assert (LOW <= [-0.05, -0.05, 0.12]).all()
    assert (LOW + CUBE * np.array(SHAPE) >= [0.05, 0.05, 0.22]).all()
