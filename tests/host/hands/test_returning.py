"""A tracker that restarts."""

from __future__ import annotations

import pytest
from phasewire.base.errors import TrackerLostError, TrackerNotFoundError
from phasewire.host.hands import HandFrame, returning
from phasewire.host.hands.sources import LiveHands


def test_a_lost_tracker_is_opened_again_and_nothing_comes_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(returning, "PAUSE", 0.01)
    first, second = LiveHands("run", 100), LiveHands("run", 120)
    opened = iter((first, TrackerNotFoundError("not yet"), second))

    def open_hands(_url: str, _clock: object) -> LiveHands:
        run = next(opened)
        if isinstance(run, Exception):
            raise run
        return run

    monkeypatch.setattr(returning, "open_hands", open_hands)
    told: list[TrackerLostError] = []
    hands = returning.open_returning("leap:", on_loss=told.append)
    first.put(HandFrame(1.0, (), 7))
    assert (frame := hands.next_frame(1)) is not None
    assert frame.number == 7
    lost = TrackerLostError("closed the connection")
    first.end(lost)
    assert hands.next_frame(1) is None
    assert (told, hands.ended, first.ended) == ([lost], False, True)
    second.put(HandFrame(2.0, (), 1))
    assert next(hands).number == 1
    assert (hands.rate, hands.ended) == (120, False)
    hands.close()
    assert second.ended


def test_what_cannot_come_back_reaches_the_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(returning, "PAUSE", 0.01)
    first = LiveHands("run", 100)
    runs = [first]
    monkeypatch.setattr(returning, "open_hands", lambda *_: runs.pop())
    hands = returning.open_returning("camera:0")
    first.end(TrackerLostError("unplugged"))
    with pytest.raises(IndexError):
        next(hands)
