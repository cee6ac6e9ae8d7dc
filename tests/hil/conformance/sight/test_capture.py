"""The observed outputs, against the capture of the emulator and the words of chapter PUL."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire import Emulator
from phasewire.hil.conformance.sight.capture import EmulatorObserver, Seen, Unseen

from tests import from_spec
from tests.hand_made import HandMade

ALL = np.full(10, 2**32 - 1, np.uint32)
NONE = np.zeros(10, np.uint32)


def seen_of(waves: dict[int, str], first_period: int = 0, observed: np.ndarray = ALL) -> Seen:
    words = HandMade.of(waves).words
    return Seen(first_period, first_period + len(words) // 50, words, observed)


def test_what_is_not_over_or_forgotten_is_unseen() -> None:
    with Emulator(history_periods=100) as emulator:
        observer = EmulatorObserver(emulator)
        emulator.run_until(50)
        observer.seen(49, 50)
        with pytest.raises(Unseen, match="periods 49 to 51 are not among those that the emulator kept, 0 to 50"):
            observer.seen(49, 51)
        emulator.run_until(1000)
        kept = emulator.capture().start_tick // 50
        assert kept > 0
        observer.seen(kept, kept + 1)
        with pytest.raises(Unseen, match=f"emulator kept, {kept} to 1000"):
            observer.seen(kept - 1, kept + 1)


def test_only_the_present_life_is_seen() -> None:
    with Emulator() as emulator:
        observer = EmulatorObserver(emulator)
        emulator.run_until(1000)
        emulator.restart()
        with pytest.raises(Unseen, match="does not run"):
            observer.seen(0, 1)
        emulator.run_until_started()
        emulator.run_until(20)
        with pytest.raises(Unseen, match="0 to 20"):
            observer.seen(900, 901)


@pytest.mark.parametrize(("first", "last"), [(-1, 3), (3, 3), (4, 3)])
def test_no_stretch_is_a_wrong_question(first: int, last: int) -> None:
    with Emulator() as emulator, pytest.raises(ValueError, match="no interval of periods"):
        EmulatorObserver(emulator).seen(first, last)


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_pulses_are_read_as_start_and_width(seed: int) -> None:
    """Against PUL-002 and PUL-004, word for word; more periods than are worked on at a time."""
    rng = np.random.default_rng(seed)
    waves, wanted = {}, {}
    for channel in rng.permutation(320)[:10].tolist():
        pulse = int(rng.integers(0, 100)), int(rng.integers(0, 26))
        high = from_spec.high_ticks(pulse)
        waves[channel] = "".join("01"[tick in high] for tick in range(50)) * 260
        wanted[channel] = (from_spec.start_tick(pulse) if pulse[1] else 0, pulse[1])
    pulses = seen_of(waves, 40).pulses(41, 299)
    assert pulses.start.shape == pulses.width.shape == (258, 320)
    for channel, (start, ticks) in wanted.items():
        assert (pulses.start[:, channel] == start).all()
        assert (pulses.width[:, channel] == ticks).all()
    others = [channel for channel in range(320) if channel not in wanted]
    assert not pulses.start[:, others].any()
    assert not pulses.width[:, others].any()


def test_a_period_without_exactly_one_pulse_is_marked() -> None:
    waves = {
        0: "110" + "0" * 46 + "1",  # one, round the end
        1: "101" + "0" * 47,
        2: "1" * 50,
        3: "1" + "0" * 48 + "1",
        4: "0" * 20 + "1" * 26 + "0" * 4,  # one, too wide: the caller's to judge
        5: "10" * 25,
        6: "1" * 49 + "0",
    }
    pulses = seen_of(waves).pulses(0, 1)
    assert pulses.start[0, :8].tolist() == [49, -1, -1, 49, 20, -1, 0, 0]
    assert pulses.width[0, :8].tolist() == [3, -1, -1, 2, 26, -1, 49, 0]


def test_outputs_that_were_not_observed_are_no_silence() -> None:
    observed = NONE.copy()
    observed[9] = 1 << 31
    seen = seen_of({319: "0" * 50}, 8, observed)
    assert np.flatnonzero(seen.channels).tolist() == [319]
    pulses = seen.pulses(8, 9)
    assert np.flatnonzero(pulses.width[0] == 0).tolist() == np.flatnonzero(pulses.start[0] == 0).tolist() == [319]
    assert seen.excerpt(8, 318) == "period 8 b4p1_30: not observed"
    assert seen.excerpt(8, 319) == "period 8 b4p1_31: " + "." * 50


def test_an_excerpt_shows_a_pulse() -> None:
    seen = seen_of({167: "0" * 50 + "0000" + "1" * 4 + "0" * 42}, 999)
    assert seen.excerpt(1000, 167) == "period 1000 b2p1_07: ....####" + "." * 42


def test_the_wrong_shape_and_the_wrong_period_are_named() -> None:
    with pytest.raises(ValueError, match=r"periods 3 to 5 have words of the shape \(100, 10\), not \(99, 10\)"):
        Seen(3, 5, np.zeros((99, 10), np.uint32), ALL)
    seen = seen_of({0: "0" * 100}, 3)
    with pytest.raises(ValueError, match="periods 5 to 6 are not within what was seen, 3 to 5"):
        seen.period(5)
    with pytest.raises(ValueError, match="periods 2 to 4 are not within"):
        seen.pulses(2, 4)
    with pytest.raises(ValueError, match="read-only"):
        seen.words[0, 0] = 1
