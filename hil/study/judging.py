"""A judge who answers by what was sensed: a plain classifier, trained on other persons than those it is tested on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.extras import needing

__all__ = ["PAPER_TRIALS", "TABLE_1", "UNPLACED", "Confusion", "answered", "chance_at_most", "judged", "learners"]

TREES = 300
FOLDS = 6
"""Into which persons are divided at most; each is tested by a judge trained on the persons of the others."""

PAPER_TRIALS = 18
"""Of each shape in the paper's study: six persons, three times."""
TABLE_1: dict[str, dict[str, int]] = {
    "sphere": {"sphere": 11},
    "pyramid": {"sphere": 1, "pyramid": 17},
    "horizontal_prism": {"pyramid": 3, "horizontal_prism": 14, "cube": 1},
    "vertical_prism": {"sphere": 1, "horizontal_prism": 1, "vertical_prism": 16},
    "cube": {"cube": 14},
}
"""The paper's Table 1, answers by shape; the three complete rows follow from its text."""
UNPLACED: dict[str, tuple[int, ...]] = {"sphere": (2, 4, 1), "cube": (1, 2, 1)}
"""Wrong answers of Table 1 in the order of its columns. One column of each row is empty, and the text that we have does
not say which."""


@dataclass(frozen=True, eq=False)
class Confusion:
    """Answers against shapes.

    Parameters
    ----------
    shapes : tuple of str
        What was presented, one row each.
    answers : tuple of str
        What could be answered, one column each.
    counts : (r, c) int
        How often.
    persons : (p,) float
        Share of right answers of each person.
    """

    shapes: tuple[str, ...]
    answers: tuple[str, ...]
    counts: NDArray[np.int64]
    persons: NDArray[np.float64]

    @classmethod
    def of(cls, presented: ArrayLike, answered: ArrayLike, persons: ArrayLike, answers: Sequence[str]) -> Confusion:
        """Count the trials by the shapes that were presented and answered, and by who answered, (n,) each.

        Possible answers come in the order of the columns; shapes have the same order.
        """
        true, said, who = np.asarray(presented), np.asarray(answered), np.asarray(persons)
        shapes = tuple(shape for shape in answers if shape in true)
        counts = [[int(((true == shape) & (said == answer)).sum()) for answer in answers] for shape in shapes]
        right = [float((true == said)[who == person].mean()) for person in np.unique(who)]
        return cls(shapes, tuple(answers), np.array(counts), np.array(right))

    @property
    def right(self) -> NDArray[np.int64]:
        """Right answers by shape, (r,)."""
        return np.array([row[self.answers.index(shape)] for shape, row in zip(self.shapes, self.counts, strict=True)])

    @property
    def accuracy(self) -> float:
        """Share of right answers."""
        return float(self.right.sum() / self.counts.sum())

    @property
    def error(self) -> float:
        """Standard error of the accuracy, from the differences between persons; nan for one person."""
        if len(self.persons) < 2:
            return math.nan
        return float(self.persons.std(ddof=1) / math.sqrt(len(self.persons)))

    def by_shape(self) -> dict[str, tuple[float, float]]:
        """Share of right answers to each shape, and its standard error √(p(1−p)/(n−1))."""
        found = {}
        for shape, right, asked in zip(self.shapes, self.right, self.counts.sum(axis=1), strict=True):
            share = float(right / asked)
            found[shape] = share, math.sqrt(share * (1 - share) / (asked - 1)) if asked > 1 else math.nan
        return found

    def record(self) -> dict[str, Any]:
        """The figures, for JSON."""
        return {
            "answers": list(self.answers),
            "counts": {shape: row.tolist() for shape, row in zip(self.shapes, self.counts, strict=True)},
            "accuracy": self.accuracy,
            "standard_error": None if math.isnan(self.error) else self.error,
        }


class Learners(NamedTuple):
    """Classes of scikit-learn, which is an extra and slow to import."""

    forest: Any
    folds: Any


def learners() -> Learners:
    """A judge, and its training; raises `MissingExtraError` if scikit-learn is not installed."""
    with needing("study", "the judge of a study"):
        from sklearn.ensemble import RandomForestClassifier
        from sklearn.model_selection import GroupKFold
    return Learners(RandomForestClassifier, GroupKFold)


def judged(
    features: NDArray[np.float64],
    labels: Sequence[str],
    persons: Sequence[int],
    *,
    answers: Sequence[str] | None = None,
    seed: int = 0,
) -> NDArray[np.str_]:
    """The answer to each trial, by a random forest that was trained on the trials of other persons.

    It learns from what was sensed in each trial, (n, f), the shape and the person. The answer is the most probable of
    the possible ones; by default all shapes are. Raises `ValueError` if there are fewer than two persons, and
    `MissingExtraError` if scikit-learn is not installed.
    """
    count = len(np.unique(persons))
    if count < 2:
        raise ValueError(f"{count} person cannot be divided into trained on and tested; at least 2 must explore")
    shapes, groups = np.asarray(labels), np.asarray(persons)
    said = np.empty(len(shapes), shapes.dtype)
    for train, test in learners().folds(min(FOLDS, count)).split(features, shapes, groups):
        said[test] = answered(features[train], shapes[train], features[test], answers=answers, seed=seed)
    return said


def answered(
    known: NDArray[np.float64],
    labels: ArrayLike,
    features: NDArray[np.float64],
    *,
    answers: Sequence[str] | None = None,
    seed: int = 0,
) -> NDArray[np.str_]:
    """The answers, (n,), to features (n, f) by a random forest that was trained on known ones (k, f) with labels."""
    forest = learners().forest(TREES, random_state=seed).fit(known, np.asarray(labels))
    columns = np.arange(len(forest.classes_)) if answers is None else np.flatnonzero(np.isin(forest.classes_, answers))
    best = forest.predict_proba(features)[:, columns].argmax(axis=1)
    return np.asarray(forest.classes_[columns[best]])


def chance_at_most(trials: int, choices: int, confidence: float = 0.99) -> float:
    """The share of right answers that guessing exceeds with a probability of at most 1 − confidence."""
    from scipy.stats import binom

    return float(binom.ppf(confidence, trials, 1 / choices) / trials)
