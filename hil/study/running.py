"""The whole study: all trials, the answers, and the controls that say how much of them comes from the field."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ...solver import TransducerArray
from ...solver.contact.mesh import Mesh
from ...solver.contact.solids import SOLIDS
from .features import picture_in_space
from .judging import Confusion, judged, learners
from .noticing import felt_on_hand, sensed
from .persons import Person
from .pointer import Pointer, run_pointer
from .trials import explored

__all__ = ["PRACTISED", "SECONDS", "Study", "Trial", "run_study", "run_trial", "run_trials", "trials_of"]

PRACTISED = "cone"
"""The paper's participants practised with it, and knew that it would not be asked."""
SECONDS = 3.0
"""Of a trial: each axis is swept about once. People had minutes."""
PERSONS, REPEATS, SEED = 12, 2, 0
"""By default; the paper had 6 persons and 3 repeats."""
POINTER_REPEATS = 6
"""Of each flat shape, for each person and way."""


class Trial(NamedTuple):
    """One exploration."""

    shape: str
    """The right answer."""
    mesh: str
    """The object that is explored."""
    person: int
    number: int
    """Of the person's paths."""


class Features(NamedTuple):
    """Features of a trial."""

    felt: NDArray[np.float64]
    silent: NDArray[np.float64]
    """With the field switched off: nothing is felt, and the hand is where it is."""


@dataclass(frozen=True, eq=False)
class Study:
    """Answers of simulated persons, and of controls.

    Parameters
    ----------
    felt : Confusion
        Answers to the five shapes of the paper's test.
    with_cone : Confusion
        The same if the cone may be answered, too.
    silent : Confusion
        Answers if nothing is felt: only where the hand was.
    shuffled : Confusion
        Answers if the judge is trained and tested on labels in an order by chance.
    pointer : dict of str to Pointer
        A static outline against a moving pointer, by two judges; see `run_pointer`.
    """

    felt: Confusion
    with_cone: Confusion
    silent: Confusion
    shuffled: Confusion
    pointer: dict[str, Pointer]

    def record(self) -> dict[str, Any]:
        """The figures, for JSON."""
        figures = {name: getattr(self, name).record() for name in ("felt", "with_cone", "silent", "shuffled")}
        return figures | {"flat": {judge: answers.record() for judge, answers in self.pointer.items()}}


def trials_of(persons: int, repeats: int, shapes: Sequence[str] = tuple(SOLIDS)) -> list[Trial]:
    """Every person explores every shape so often, each time on a new path."""
    return [
        Trial(shape, shape, person, number * len(shapes) + place)
        for person in range(persons)
        for number in range(repeats)
        for place, shape in enumerate(shapes)
    ]


def run_trial(trial: Trial, seed: int, seconds: float) -> Features:
    """The features of a trial by the whole path."""
    array = TransducerArray.grid()
    path = Person.drawn(trial.person, seed).explores(trial.number)
    with threadpool_limits(1):  # the products are small; more threads wait for each other
        played = explored(getattr(Mesh, trial.mesh)(), path, seconds, array)
        levels, skin = felt_on_hand(played, path, array)
    noise = [seed, trial.person, trial.number, 1]  # beside the path's, which has no last number
    return Features(
        *(
            picture_in_space(sensed(each, skin, path, seconds, np.random.default_rng(noise)))
            for each in (levels, 0 * levels)
        )
    )


def run_study(
    persons: int = PERSONS,
    repeats: int = REPEATS,
    seed: int = SEED,
    *,
    seconds: float = SECONDS,
    processes: int = 1,
    on_trial: Callable[[int, int], None] | None = None,
) -> Study:
    """Run the study.

    Parameters
    ----------
    persons : int
        The number of persons, at least two: a judge is tested on persons that it does not know.
    repeats : int
        How often each explores each of the six shapes.
    seed : int
        The same seed gives the same answers.
    seconds : float
        The duration of each exploration.
    processes : int
        The number of processes that share the trials.
    on_trial : callable, optional
        A function that is called with the number of trials that are done, and of all.

    Raises
    ------
    ValueError
        If there are fewer than two persons, or no trials.
    MissingExtraError
        If scikit-learn is not installed.
    """
    if persons < 2 or repeats < 1:
        raise ValueError(f"{persons} persons, {repeats} repeats: a study needs at least 2 persons and 1 repeat")
    learners()  # before the work, which takes minutes
    trials = trials_of(persons, repeats)
    felt, silent = zip(*run_trials(trials, seed, seconds, processes, on_trial), strict=True)
    presented = [trial.shape for trial in trials]
    who = [trial.person for trial in trials]

    def confusion(features: Sequence[NDArray[np.float64]], labels: Sequence[str], answers: Sequence[str]) -> Confusion:
        said = judged(np.stack(features), labels, who, answers=answers, seed=seed)
        asked = np.array([label != PRACTISED for label in labels])
        return Confusion.of(np.array(labels)[asked], said[asked], np.array(who)[asked], answers)

    tested = tuple(shape for shape in SOLIDS if shape != PRACTISED)
    shuffled = np.random.default_rng([seed, len(trials)]).permutation(presented).tolist()
    return Study(
        confusion(felt, presented, tested),
        confusion(felt, presented, (*tested, PRACTISED)),
        confusion(silent, presented, tested),
        confusion(felt, shuffled, tested),
        run_pointer(persons, POINTER_REPEATS, seed),
    )


def run_trials(
    trials: Sequence[Trial],
    seed: int,
    seconds: float,
    processes: int = 1,
    on_trial: Callable[[int, int], None] | None = None,
) -> Iterator[Features]:
    """The features of all trials, in their order; parameters as of `run_study`."""
    run = partial(run_trial, seed=seed, seconds=seconds)
    with ExitStack() as stack:
        each: Callable[..., Iterator[Features]] = map
        if processes > 1:
            pool = ProcessPoolExecutor(processes, get_context("spawn"), _begin_worker)
            stack.callback(pool.shutdown, cancel_futures=True)
            each = pool.map
        for number, features in enumerate(each(run, trials), 1):
            yield features
            if on_trial is not None:
                on_trial(number, len(trials))


def _begin_worker() -> None:
    """Leave Ctrl-C to the first process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
