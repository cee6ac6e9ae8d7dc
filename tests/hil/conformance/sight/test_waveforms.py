"""The suite's expectations of outputs, against pictures drawn by hand, the table of the vectors, and a slow loop."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import phasewire.protocol
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.hil.conformance.cases import Inconclusive
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import (
    SILENCE,
    Words,
    check_play,
    check_silent,
    expected_words,
    modulated,
    modulated_width,
    only,
    silent,
)
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.wiring import Wiring

WIRING = Wiring.strips()
ALL = np.full(10, 2**32 - 1, np.uint32)


def seen(words: Words, first: int = 100, observed: np.ndarray = ALL) -> Seen:
    return Seen(first, first + len(words) // 50, words, observed)


def levels(words: Words, channel: int) -> str:
    return "".join(".#"[int(word) >> channel % 32 & 1] for word in words[:, channel // 32])


@given(seed=st.integers(0, 2**32 - 1))
def test_all_outputs_are_those_of_a_slow_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wiring = Wiring(rng.permutation(320))
    pulses = Pulses(rng.integers(0, 100, 320), rng.integers(0, 26, 320))
    wanted = np.zeros((50, 10), np.uint32)
    for transducer in range(320):
        processor, bit = divmod(int(wiring.channels[transducer]), 32)
        phase, width = int(pulses.phase[transducer]), int(pulses.width[transducer])
        for tick in range(width):
            wanted[((phase - width) // 2 + tick) % 50, processor] |= np.uint32(1 << bit)
    assert np.array_equal(expected_words(pulses, wiring), wanted)


def test_modulated_widths_are_those_of_the_vectors() -> None:
    vectors = json.loads(Path(phasewire.protocol.__file__).with_name("vectors.json").read_text())
    table = {vector["sample"]: vector["widths"] for vector in vectors["modulated_widths"]["vectors"]}
    assert table == {sample: [modulated_width(width, sample) for width in range(26)] for sample in range(256)}
    pulses = Pulses(np.arange(26), np.arange(26))
    assert modulated(pulses, 100).width.tolist() == table[100]
    assert modulated(pulses, 100).phase.tolist() == list(range(26))


def test_the_first_difference_is_named() -> None:
    words = expected_words(only(3, 25, 25), WIRING)
    wrong = words.copy()
    wrong[7, 0] ^= 1 << 3
    with pytest.raises(AssertionError) as failure:
        check_play(seen(np.concatenate([SILENCE, words, wrong, words])), [(100, SILENCE), (101, words)])
    assert str(failure.value) == (
        "the first difference is in period 102, at tick 7, output b0p0_03; there\n"
        "#######.#################......................... is seen,\n"
        "#########################......................... should be, from period 101 on\n"
        "(in this period 1 outputs differ)"
    )


def test_what_is_not_observed_is_not_judged() -> None:
    here, there = expected_words(only(3), WIRING), expected_words(only(4), WIRING)
    others = ALL.copy()
    others[0] ^= 1 << 3
    check_play(seen(there, observed=others), [(100, here | there)])
    with pytest.raises(AssertionError):
        check_play(seen(there), [(100, here | there)])


def test_without_an_observed_output_that_plays_there_is_no_verdict() -> None:
    others = ALL.copy()
    others[0] ^= 1 << 3
    with pytest.raises(Inconclusive, match="none of the outputs that should play is observed"):
        check_play(seen(SILENCE.copy(), observed=others), [(100, expected_words(only(3), WIRING))])


@pytest.mark.parametrize("steps", [[(99, SILENCE)], [(100, SILENCE), (100, SILENCE)], [(102, SILENCE)]])
def test_steps_are_in_order_and_within_what_is_seen(steps: list[tuple[int, Words]]) -> None:
    with pytest.raises(AssertionError, match="should be"):
        check_play(seen(SILENCE.copy()), steps)


def test_long_stretches_are_judged_to_their_end() -> None:
    words = np.tile(SILENCE, (5000, 1))
    check_silent(seen(words))
    words = words.copy()
    words[-1, 9] = 1 << 31
    assert not silent(seen(words))
    assert silent(seen(words), 100, 5099)
    with pytest.raises(AssertionError, match="period 5099, at tick 49, output b4p1_31"):
        check_silent(seen(words))
