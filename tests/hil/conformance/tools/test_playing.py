"""When outputs fall silent, told from stretches of them that are made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import SILENCE
from phasewire.hil.conformance.tools.playing import check_falls_one_by_one, check_falls_silent, silent_from

WORDS = SILENCE.copy()
WORDS[10:20] = 0b101
FIRST = 100
ALL = np.full(10, 2**32 - 1, np.uint32)


def stretch(*ends: int, observed: np.ndarray = ALL) -> Seen:
    """Ten periods from 100 on, in which each processor plays until its period, or all until the same."""
    words = np.tile(WORDS, (10, 1))
    for place, end in enumerate(ends * 10 if len(ends) == 1 else ends):
        words[50 * (end - FIRST) :, place] = 0
    return Seen(FIRST, FIRST + 10, words, observed)


def test_silence_begins_behind_the_last_period_with_a_pulse() -> None:
    assert silent_from(stretch(104)) == 104
    assert silent_from(stretch(100)) == FIRST
    assert silent_from(stretch(110)) == FIRST + 10
    assert silent_from(stretch(*[102] * 9, 106)) == 106


@pytest.mark.parametrize(("first_tick", "last_tick"), [(5001, 5001), (5200, 5200), (4901, 4949)])
def test_silence_within_six_periods_is_in_time(first_tick: int, last_tick: int) -> None:
    check_falls_silent(stretch(104), WORDS, first_tick, last_tick)


@pytest.mark.parametrize(("first_tick", "last_tick"), [(5201, 5300), (4800, 4899)])
def test_silence_too_soon_or_too_late_fails(first_tick: int, last_tick: int) -> None:
    with pytest.raises(AssertionError, match="silent from period 104 on, should be from one of"):
        check_falls_silent(stretch(104), WORDS, first_tick, last_tick)


def test_processors_that_fall_silent_apart_do_not_fall_silent_together() -> None:
    with pytest.raises(AssertionError, match="first difference is in period 103"):
        check_falls_silent(stretch(*[104] * 9, 103), WORDS, 5001, 5049)


def test_a_pulse_that_is_cut_short_is_no_boundary() -> None:
    words = stretch(104).words.copy()
    words[50 * 3 + 15 : 50 * 4] = 0
    with pytest.raises(AssertionError, match="first difference is in period 103, at tick 15"):
        check_falls_silent(Seen(FIRST, FIRST + 10, words, ALL), WORDS, 5001, 5049)


def test_outputs_that_are_not_driven_show_nothing() -> None:
    with pytest.raises(Inconclusive):
        check_falls_silent(stretch(104, observed=ALL & np.uint32(0b010)), WORDS, 5001, 5049)


def test_each_processor_falls_silent_in_its_own_time() -> None:
    ends = [102, 103, 104, 105, 106, 107, 108, 109, 110, 101]
    check_falls_one_by_one(stretch(*ends), WORDS, ends, ends)
    for late, early in ((0, 1), (1, 0)):
        with pytest.raises(AssertionError, match="processor 0 of board 2 is silent from period 106 on"):
            check_falls_one_by_one(
                stretch(*ends),
                WORDS,
                [end + early * (place == 4) for place, end in enumerate(ends)],
                [end + early - late * (place == 4) for place, end in enumerate(ends)],
            )


def test_a_processor_that_is_not_seen_is_not_judged() -> None:
    observed = ALL.copy()
    observed[3] = 0
    check_falls_one_by_one(stretch(104, observed=observed), WORDS, [104] * 10, [104, 104, 104, 0, *[104] * 6])
