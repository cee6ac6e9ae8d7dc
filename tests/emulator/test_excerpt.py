"""Excerpts and edges, against bits written by hand and a search tick by tick."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Wiring
from phasewire.emulator.ports import excerpt as module
from phasewire.emulator.ports.excerpt import Excerpt, edges

from tests.hand_made import HandMade


def test_edges_of_a_wave_written_by_hand() -> None:
    capture = HandMade.of({0: "1100110", 133: "0011001", 319: "0000000"})
    assert [found.tolist() for found in edges(capture, 0, 0, 7)] == [[0, 2, 4, 6], [1, 0, 1, 0]]
    assert [found.tolist() for found in edges(capture, 133, 0, 7)] == [[2, 4, 6], [1, 0, 1]]
    assert [found.tolist() for found in edges(capture, 319, 0, 7)] == [[], []]


def test_an_edge_on_the_first_tick_counts_and_one_on_the_tick_after_the_last_does_not() -> None:
    capture = HandMade.of({40: "0011001"})
    assert edges(capture, 40, 2, 4)[0].tolist() == [2]
    assert edges(capture, 40, 3, 4)[0].tolist() == []


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


def test_chunks_are_small_and_together_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CHUNK_TICKS", 3)
    capture = HandMade.of({7: "10010110", 300: "11110000"})
    chunks = list(Excerpt.of(capture, [300, 7], (1, 8)).chunks())
    assert [len(chunk) for chunk in chunks] == [3, 3, 1]
    assert np.concatenate(chunks).T.tolist() == [[1, 1, 1, 0, 0, 0, 0], [0, 0, 1, 0, 1, 1, 0]]


def test_the_default_is_everything() -> None:
    excerpt = Excerpt.of(HandMade.of({5: "0110"}))
    assert excerpt.channels == tuple(range(320))
    assert (excerpt.start, excerpt.stop) == (0, 4)


def test_names_and_transducers_follow_the_wiring(scrambled: Wiring) -> None:
    channels = [0, 31, 32, 64, 167, 319]
    excerpt = Excerpt.of(HandMade.of({0: "0"}, scrambled), channels)
    assert excerpt.names == ("b0p0_00", "b0p0_31", "b0p1_00", "b1p0_00", "b2p1_07", "b4p1_31")
    assert [int(scrambled.channels[transducer]) for transducer in excerpt.transducers] == channels


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
