"""Changes are spread: the compiled rule against the readable one, and the limits for any sequence of frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.solver.rendering.cycle import Cycle
from phasewire.solver.rendering.quiet import Completion, Quieting, Rates, literal, quieted

RULES = [Completion(), Completion(1, 1), Completion(3, 7), Rates(), Rates(0.5, 1.0), Rates(1e-2, 1e-2)]


def frames(seed: int, count: int, hold: int) -> np.ndarray:
    """Random drives of three transducers, silent ones among them, each held for some periods."""
    rng = np.random.default_rng(seed)
    drives = rng.uniform(0, 1, (count, 3)) * np.exp(2j * np.pi * rng.uniform(size=(count, 3)))
    drives[rng.uniform(size=(count, 3)) < 0.2] = 0
    return np.repeat(drives, hold, axis=0).astype(np.complex64)


@given(st.integers(0, 2**32), st.sampled_from(RULES), st.integers(1, 60))
def test_the_kernel_does_what_the_literal_rule_does(seed: int, rule: Completion | Rates, hold: int) -> None:
    wanted = frames(seed, 5, hold)
    assert np.abs(Quieting(3, rule).follow(wanted) - literal(wanted, rule)).max() < 1e-5


@given(st.integers(0, 2**32), st.floats(1e-3, 1), st.floats(1e-3, np.pi), st.integers(1, 20))
def test_no_period_changes_more_than_the_rates(seed: int, amplitude: float, phase: float, hold: int) -> None:
    emitted = Quieting(3, Rates(amplitude, phase)).follow(frames(seed, 8, hold)).astype(complex)
    before, after = emitted[:-1], emitted[1:]
    assert np.abs(np.diff(np.abs(emitted), axis=0)).max() <= amplitude + 1e-6
    sounding = (np.abs(before) > 1e-3) & (np.abs(after) > 1e-3)
    assert np.abs(np.angle(after * before.conj()))[sounding].max(initial=0) <= phase + 1e-3


def test_the_pieces_of_a_course_join() -> None:
    wanted, whole, parts = frames(7, 9, 11), Quieting(3, Rates()), Quieting(3, Rates())
    assert (np.concatenate([parts.follow(wanted[:13]), parts.follow(wanted[13:])]) == whole.follow(wanted)).all()


def test_a_cycle_that_is_quieted_joins_its_own_beginning() -> None:
    cycle = Cycle(np.array([[1], [-1j]], np.complex64), 50)
    quiet = quieted(cycle, Completion())
    assert (len(quiet), quiet.hold, quiet.frequency) == (100, 1, cycle.frequency)
    steps = np.angle(quiet.drives[:, 0] * np.roll(quiet.drives[:, 0], 1).conj())
    assert np.abs(steps).max() == pytest.approx(np.pi / 2 / 40, rel=1e-3)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [(np.ones((10, 8)), r"must be \(t, 3\)"), (np.ones(3), "must be"), (np.full((2, 3), np.nan), "finite")],
)
def test_wanted_drives_of_another_shape_are_refused(wanted: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Quieting(3, Completion()).follow(wanted)
