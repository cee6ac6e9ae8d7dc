"""The whole study: its plan, that it repeats itself, and that it can fail."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from phasewire.hil.study.features import FELT
from phasewire.hil.study.judging import chance_at_most
from phasewire.hil.study.running import PRACTISED, Study, Trial, run_study, run_trial, run_trials, trials_of
from phasewire.solver.contact.solids import SOLIDS

SHORT = 0.8
"""Seconds in which a hand comes down, and feels a little."""


def test_every_person_explores_every_shape_on_paths_of_its_own() -> None:
    trials = trials_of(persons=3, repeats=2)
    assert Counter((trial.person, trial.shape) for trial in trials) == {
        (person, shape): 2 for person in range(3) for shape in SOLIDS
    }
    assert len({(trial.person, trial.number) for trial in trials}) == len(trials)
    assert all(trial.shape == trial.mesh for trial in trials)


@pytest.mark.slow
def test_a_trial_repeats_itself_and_feels_what_is_there() -> None:
    trial = Trial("cube", "cube", person=1, number=0)
    first, again = (run_trial(trial, seed=3, seconds=SHORT) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one, other)
    sphere = run_trial(trial._replace(mesh="sphere"), seed=3, seconds=SHORT)
    assert first.felt[FELT].any()
    assert not np.array_equal(first.felt[FELT], sphere.felt[FELT])
    assert not first.silent[FELT].any()
    # With the field off nothing is left of the object, and the label is not looked at.
    assert np.array_equal(first.silent, sphere.silent)
    labelled = run_trial(trial._replace(shape="sphere"), seed=3, seconds=SHORT)
    assert np.array_equal(first.felt, labelled.felt)


@pytest.mark.parametrize(("persons", "repeats"), [(1, 2), (2, 0)])
def test_too_few_persons_or_trials(persons: int, repeats: int) -> None:
    with pytest.raises(ValueError, match=r"at least 2 persons and 1 repeat"):
        run_study(persons, repeats)


@pytest.mark.slow
def test_processes_do_not_change_the_trials() -> None:
    trials = trials_of(2, 1, ("cube", "sphere"))
    told: list[int] = []
    alone, shared = (
        list(run_trials(trials, 0, SHORT, processes, lambda done, _total: told.append(done))) for processes in (1, 2)
    )
    for one, other in zip(alone, shared, strict=True):
        assert all(np.array_equal(*pair) for pair in zip(one, other, strict=True))
    assert told == [1, 2, 3, 4] * 2


@pytest.fixture(scope="module")
def study() -> Study:
    return run_study(6, 1, seconds=2.0, processes=2)


@pytest.mark.slow
def test_shapes_are_told_apart_by_the_field_and_by_nothing_else(study: Study) -> None:
    limit = chance_at_most(30, 5, 0.999)
    assert study.felt.counts.sum() == study.silent.counts.sum() == 30
    assert study.felt.accuracy > limit
    assert study.silent.accuracy <= limit
    assert study.shuffled.accuracy <= limit
    assert PRACTISED not in study.felt.answers
    assert study.with_cone.answers == (*study.felt.answers, PRACTISED)
