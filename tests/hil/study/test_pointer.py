"""Flat shapes in two ways: what is played is what is meant, and the ordering as it comes out."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.hil.study.judging import Confusion
from phasewire.hil.study.noticing import WINDOW_SECONDS
from phasewire.hil.study.pointer import (
    FLAT_SHAPES,
    LOOP_SECONDS,
    PALM,
    WAYS,
    Pointer,
    drawn_on_palm,
    features_on_palm,
    felt_on_palm,
    run_pointer,
    walk,
)

WINDOWS = round(LOOP_SECONDS / WINDOW_SECONDS)


def answers(*counts: list[int]) -> Confusion:
    return Confusion(tuple(FLAT_SHAPES), tuple(FLAT_SHAPES), np.array(counts), np.array([0.5, 0.7]))


def test_the_pointer_pauses_at_corners_as_published() -> None:
    for shape, corners, pause in (("square", 4, 0.300), ("triangle", 3, 0.467)):
        places = walk(shape, 4000)
        rests = (np.linalg.norm(np.diff(places, axis=0), axis=1) < 1e-9).mean()
        assert rests == pytest.approx(corners * pause / LOOP_SECONDS, abs=0.005)
    steps = np.linalg.norm(np.diff(walk("circle", 4000), axis=0), axis=1)
    assert steps.max() < 1.01 * steps.min()


def test_a_drawing_is_on_the_outline() -> None:
    for way in WAYS:
        levels = drawn_on_palm("circle", way)
        assert levels.shape == (WINDOWS, PALM.mask.size)
        strongest = PALM.positions[levels.mean(axis=0).argmax()]
        assert np.hypot(*strongest[:2]) == pytest.approx(0.03, abs=PALM.spacing)


def test_the_emitted_pointer_is_felt_where_it_is_meant() -> None:
    """The circle of 3 cm: the strongest place of each window goes round with it."""
    levels = felt_on_palm("circle", "pointer")
    assert levels.shape == (WINDOWS, PALM.mask.size)
    meant = walk("circle", WINDOWS)
    found = PALM.positions[levels.argmax(axis=1)]
    assert np.linalg.norm(found - meant, axis=1).max() < 0.01
    assert levels.max(axis=1).min() > 1


def test_features_are_relative() -> None:
    levels = drawn_on_palm("square", "pointer")
    one, other = (features_on_palm(factor * levels, np.random.default_rng(0)) for factor in (100, 1000))
    np.testing.assert_allclose(one, other, atol=5e-3)  # what is below the threshold differs a little
    assert not np.isnan(features_on_palm(0 * levels, np.random.default_rng(0))).any()


def test_the_difference_has_the_error_within_persons() -> None:
    outline, pointer = answers([1, 1, 0], [0, 2, 0], [0, 1, 1]), answers([2, 0, 0], [0, 2, 0], [0, 0, 2])
    both = Pointer(outline, pointer)
    assert both.better == pytest.approx(1 / 3)
    assert both.error == 0.0  # both persons differ alike
    assert both.record()["pointer_minus_outline"] == both.better


@pytest.mark.slow
def test_the_pointer_is_better_than_the_outline() -> None:
    """The ordering of Hajas et al. (2020); no number was set for it."""
    for both in run_pointer(8, 3, seed=0).values():
        assert both.better > 2 * both.error
