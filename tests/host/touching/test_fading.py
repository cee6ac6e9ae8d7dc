"""Ramps, against a literal version with a dictionary."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire.host.touching.fading import Fading

Given = dict[int, tuple[float, float]]
"""Of each id a coordinate and an amplitude."""

poses = st.lists(
    st.dictionaries(st.integers(0, 12), st.tuples(st.floats(-1, 1), st.floats(0.1, 1)), max_size=8), max_size=12
)


def arrays(pose: Given) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    return (
        np.array(list(pose), np.int64).reshape(-1),
        np.array([[x, 0, 0.2] for x, _ in pose.values()]).reshape(-1, 3),
        np.array([amplitude for _, amplitude in pose.values()]),
    )


@given(poses, st.floats(0.01, 1.5))
def test_levels_rise_and_fall_as_a_dictionary_says(sequence: list[Given], change: float) -> None:
    fading = Fading.nothing()
    expected: dict[int, tuple[float, float, float]] = {}
    for pose in sequence:
        fading = fading.step(*arrays(pose), change, 1000)
        following = {key: (x, a, min(expected.get(key, (0, 0, 0))[2] + change, 1.0)) for key, (x, a) in pose.items()}
        for key, (x, a, level) in expected.items():
            if key not in pose and level > change:
                following[key] = (x, a, level - change)
        expected = following
        assert fading.ids.tolist() == list(expected)
        assert fading.positions[:, 0].tolist() == [x for x, _, _ in expected.values()]
        assert fading.amplitudes.tolist() == [a for _, a, _ in expected.values()]
        np.testing.assert_allclose(fading.levels, [level for _, _, level in expected.values()], rtol=1e-12)
        assert ((fading.levels > 0) & (fading.levels <= 1)).all()


@given(poses, st.integers(8, 12))
def test_the_number_of_points_is_bounded_and_those_that_are_there_stay(sequence: list[Given], most: int) -> None:
    fading = Fading.nothing()
    for pose in sequence:
        fading = fading.step(*arrays(pose), 0.05, most)
        assert len(fading) <= most
        assert set(pose) <= set(fading.ids.tolist())


def test_of_points_that_fade_out_the_weakest_vanish_first() -> None:
    four = {0: (0.0, 1.0), 1: (0.0, 0.2), 2: (0.0, 0.9), 3: (0.0, 0.3)}
    fading = Fading.nothing().step(*arrays(four), 1.0, 4)
    fading = fading.step(*arrays({9: (0.5, 1.0)}), 0.1, 3)
    assert fading.ids.tolist() == [9, 0, 2]
    np.testing.assert_allclose(fading.levels, [0.1, 0.9, 0.9])
