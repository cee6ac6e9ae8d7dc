"""Recorded port words, against the words that were recorded."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.ports.recording import PortRecording

TICKS = 50


@given(
    periods=st.lists(st.integers(0, 3), max_size=12),
    rest=st.integers(0, TICKS - 1),
    cuts=st.lists(st.integers(0, 700), max_size=5),
    start=st.integers(-60, 700),
    length=st.integers(0, 700),
)
def test_words_come_back_as_they_were(periods: list[int], rest: int, cuts: list[int], start: int, length: int) -> None:
    tables = np.random.default_rng(1).integers(0, 2**32, (4, TICKS), dtype=np.uint32)
    words = np.concatenate([tables[periods].reshape(-1), tables[1, :rest]])
    recording = PortRecording()
    for part in np.split(words, sorted(cuts)):
        recording.extend(part)
    assert recording.ticks == len(words)
    seen = recording.recorded()
    # The whole period in which the recording ends is known as far as it has come, and silent from there on.
    known = np.concatenate([np.zeros(60, np.uint32), words, np.zeros(-len(words) % TICKS, np.uint32)])
    stop = min(start + length, len(known) - 60)
    assert np.array_equal(seen.words(start, max(start, stop)), known[start + 60 : max(start, stop) + 60])


def test_what_stays_the_same_is_kept_once() -> None:
    recording = PortRecording()
    recording.extend(np.tile(np.arange(TICKS, dtype=np.uint32), 1000))
    seen = recording.recorded()
    assert seen.starts[1:].tolist() == [0]
    assert len(seen.tables) == 2


def test_what_is_over_can_be_forgotten() -> None:
    recording = PortRecording()
    words = np.repeat(np.arange(1, 11, dtype=np.uint32), TICKS)
    recording.extend(words)
    before = recording.recorded()
    recording.forget(6)
    assert len(recording.recorded().tables) == 4
    assert np.array_equal(recording.recorded().words(6 * TICKS, 10 * TICKS), words[6 * TICKS :])
    assert np.array_equal(before.words(0, 10 * TICKS), words)
