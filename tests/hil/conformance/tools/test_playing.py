"""The moment at which outputs fall silent, in stretches that are made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import SILENCE
from phasewire.hil.conformance.tools.playing import check_falls_one_by_one, check_falls_silent

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


@pytest.mark.parametrize(("first_tick", "last_tick"), [(5201, 5300), (4800, 4899)])
def test_silence_too_soon_or_too_late_fails(first_tick: int, last_tick: int) -> None:
    with pytest.raises(AssertionError, match="silent from period 104 on, should be from one of"):
        check_falls_silent(stretch(104), WORDS, first_tick, last_tick)


def test_outputs_that_are_not_driven_are_inconclusive() -> None:
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
