"""Excerpts and edges, against bits written by hand and a search tick by tick."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.emulator.ports import excerpt as module
from phasewire.emulator.ports.excerpt import Excerpt, edges

from tests.hand_made import HandMade


def test_edges_of_a_wave_written_by_hand() -> None:
    capture = HandMade.of({0: "1100110", 133: "0011001", 319: "0000000"})
    assert [found.tolist() for found in edges(capture, 0, 0, 7)] == [[0, 2, 4, 6], [1, 0, 1, 0]]
    assert [found.tolist() for found in edges(capture, 133, 0, 7)] == [[2, 4, 6], [1, 0, 1]]
    assert [found.tolist() for found in edges(capture, 319, 0, 7)] == [[], []]


@given(wave=st.text("01", min_size=2, max_size=60), channel=st.integers(0, 319), data=st.data())
def test_edges_are_where_neighbours_differ_in_any_chunks_of_time(wave: str, channel: int, data: st.DataObject) -> None:
    cut, chunk = data.draw(st.integers(1, len(wave) - 1)), data.draw(st.integers(1, 20))
    capture = HandMade.of({channel: wave})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "CHUNK_TICKS", chunk)
        pieces = [edges(capture, channel, 0, cut), edges(capture, channel, cut, len(wave))]
    ticks, levels = (np.concatenate(halves).tolist() for halves in zip(*pieces, strict=True))
    expected = [tick for tick in range(len(wave)) if wave[tick] != ("0" + wave)[tick]]
    assert ticks == expected
    assert levels == [int(wave[tick]) for tick in expected]


@pytest.mark.parametrize(
    ("channels", "ticks", "message"),
    [
        ([], (0, 4), "no output channel is chosen"),
        ([0, 320], (0, 4), "no output channel 320; 0 to 319"),
        ([-1], (0, 4), "no output channel -1"),
        ([3, 4, 3], (0, 4), "chosen twice"),
        ([3], (2, 2), "ticks 2 to 2 are no stretch within the captured 0 to 4"),
        ([3], (0, 5), "ticks 0 to 5 are no stretch"),
        ([3], (-1, 3), "ticks -1 to 3 are no stretch"),
    ],
)
def test_an_impossible_excerpt_is_refused(channels: list[int], ticks: tuple[int, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Excerpt.of(HandMade.of({5: "0110"}), channels, ticks)
