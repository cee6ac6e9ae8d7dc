"""Judges and their answers: closed constructions, and everything in which a judge must not do better than chance."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.hil.study.judging import (
    PAPER_TRIALS,
    TABLE_1,
    UNPLACED,
    Confusion,
    chance_at_most,
    judged,
)
from scipy.stats import binom, norm

pytestmark = pytest.mark.slow  # classifiers learn

SHAPES = ("cone", "cube", "sphere")


def test_table_1_is_the_papers() -> None:
    for shape, answers in TABLE_1.items():
        assert sum(answers.values()) + sum(UNPLACED.get(shape, ())) == PAPER_TRIALS, shape
    right = [row[shape] for shape, row in TABLE_1.items()]
    assert sum(right) / (PAPER_TRIALS * len(right)) == 0.8
    shares = {shape: round(100 * row[shape] / PAPER_TRIALS, 1) for shape, row in TABLE_1.items()}
    assert (shares["sphere"], shares["pyramid"]) == (61.1, 94.4)


def test_answers_are_counted_by_what_was_presented() -> None:
    presented = ["cube", "cube", "cube", "sphere"]
    answered = ["cube", "cone", "cube", "cube"]
    found = Confusion.of(presented, answered, [0, 0, 1, 1], SHAPES)
    assert found.shapes == ("cube", "sphere")
    assert found.counts.tolist() == [[1, 2, 0], [0, 1, 0]]
    assert found.accuracy == 0.5
    assert found.persons.tolist() == [0.5, 0.5]
    assert found.record()["counts"] == {"cube": [1, 2, 0], "sphere": [0, 1, 0]}


def test_the_error_of_a_shape_is_the_papers_and_of_all_that_between_persons() -> None:
    counts = np.array([[17, 1], [0, 18]])
    found = Confusion(("pyramid", "cube"), ("pyramid", "cube"), counts, np.array([0.8, 0.9, 1.0]))
    share, error = found.by_shape()["pyramid"]
    assert (round(100 * share, 1), round(100 * error, 1)) == (94.4, 5.6)  # section 5
    assert found.error == pytest.approx(0.1 / 3**0.5)


@pytest.mark.parametrize("choices", [3, 5])
def test_chance_is_the_binomials(choices: int) -> None:
    limit = chance_at_most(200, choices)
    right = round(200 * limit)
    assert binom.sf(right, 200, 1 / choices) <= 0.01 < binom.sf(right - 1, 200, 1 / choices)


def test_a_judge_comes_near_bayes() -> None:
    chance = np.random.default_rng(1)
    labels = chance.permutation(np.repeat(["cube", "sphere"], 300))
    features = chance.standard_normal((600, 3))
    features[labels == "cube", 0] += 2
    said = judged(features, labels.tolist(), np.tile(np.arange(3), 200).tolist())
    best, right = norm.cdf(1), (said == labels).mean()  # 84 %
    assert best - 0.08 < right < best + 3 * (best * (1 - best) / 600) ** 0.5


def test_a_judge_guesses_if_features_say_nothing() -> None:
    chance = np.random.default_rng(2)
    labels = chance.permutation(np.repeat(SHAPES, 60))
    said = judged(chance.standard_normal((180, 10)), labels.tolist(), np.tile(np.arange(6), 30).tolist())
    assert (said == labels).mean() <= chance_at_most(180, 3, 0.999)


def test_what_a_judge_learns_of_a_person_does_not_help_with_another() -> None:
    """Each person has a code for each shape, which tells all about it, but only for this person."""
    chance = np.random.default_rng(3)
    persons, labels = np.repeat(np.arange(30), 6), np.tile(np.repeat(SHAPES, 2), 30)
    codes = {(who, shape): chance.standard_normal(8) for who in range(30) for shape in SHAPES}
    features = np.array([codes[who, shape] for who, shape in zip(persons.tolist(), labels.tolist(), strict=True)])
    said = judged(features, labels.tolist(), persons.tolist())
    assert (said == labels).mean() <= chance_at_most(90, 3, 0.999)  # both of a person's trials are one draw


def test_only_what_may_be_answered_is() -> None:
    chance = np.random.default_rng(4)
    labels = np.tile(SHAPES, 40)
    said = judged(
        chance.standard_normal((120, 4)), labels.tolist(), np.arange(120).tolist(), answers=("cube", "sphere")
    )
    assert set(said.tolist()) == {"cube", "sphere"}


def test_one_person_cannot_be_judged() -> None:
    with pytest.raises(ValueError, match=r"1 person cannot be divided"):
        judged(np.zeros((2, 1)), ["cube", "sphere"], [0, 0])
