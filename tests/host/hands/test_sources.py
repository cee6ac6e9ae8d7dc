from __future__ import annotations

import time
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from itertools import count
from threading import Thread

import pytest
from phasewire.base import plugins
from phasewire.base.errors import TrackerNotFoundError
from phasewire.host.hands import HandFrame, open_hands
from phasewire.host.hands.sources import MOST_WAITING, LiveHands, PlayedHands, read_options

from tests.host.hands.clocks import Clock


def frames(period: float = 0.5, first: float = 7.0) -> Iterator[HandFrame]:
    return (HandFrame(first + number * period, number=number) for number in count())


def three() -> Iterator[HandFrame]:
    return iter([HandFrame(0.0), HandFrame(0.5, number=1), HandFrame(0.5, number=2)])


# By URL


def test_the_mouse_belongs_to_the_page() -> None:
    with pytest.raises(TrackerNotFoundError, match="mouse: is the hand of the page"):
        open_hands("mouse:")


def test_what_another_package_cannot_load_is_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = EntryPoint("theirs", "no_such_package:SCHEME", "phasewire.hands")
    monkeypatch.setattr(plugins, "entries", lambda group: {"theirs": theirs})
    with pytest.raises(TrackerNotFoundError, match="cannot be loaded: No module named 'no_such"):
        open_hands("theirs:1")


def test_options_of_a_url() -> None:
    known = {"speed": float, "loop": int}
    assert read_options("a%3Fb?speed=2&loop=1", known, "") == ("a?b", {"speed": 2.0, "loop": 1})
    assert read_options("a", known, "") == ("a", {})
    for rest, message in [
        ("a?sped=2", "there is no option 'sped' here; such a URL has the form f:A"),
        ("a?speed=2&speed=3", "option 'speed' stands twice"),
        ("a?speed=fast", "option speed=fast: could not convert .*; such a URL has the form f:A"),
        ("a?speed", "option speed=: could not convert"),
        ("?" + "speed=1&" * 200, "[Mm]ax number of fields"),
    ]:
        with pytest.raises(ValueError, match=message):
            read_options(rest, known, "f:A")


# Frames that are there already


def test_a_late_loop_gets_the_newest_frame_with_the_time_that_it_was_due() -> None:
    clock = Clock()
    source = PlayedHands("endless", frames(), 2, clock)
    source.next_frame(0)
    clock.now += 2.2
    newest = source.next_frame(5)
    assert newest is not None
    assert (newest.time, newest.number, clock.now) == (1002.0, 4, 1002.2)


# Live frames


def test_a_loop_gets_the_newest_frame_and_what_it_missed_is_counted() -> None:
    source = LiveHands("tracker", 100)
    assert source.next_frame(0) is None
    assert not source.ended
    for frame in three():
        source.put(frame)
    newest = source.next_frame(0)
    assert newest is not None
    assert newest.number == 2
    assert source.dropped == 2


def test_an_iterator_waits_for_each_frame_until_the_end() -> None:
    source = LiveHands("tracker", 100)

    def send() -> None:
        for frame in three():
            source.put(frame)
            time.sleep(0.01)
        source.end()

    thread = Thread(target=send)
    thread.start()
    assert [frame.number for frame in source] == [0, 1, 2]
    assert source.ended
    thread.join()


def test_a_flood_takes_no_memory() -> None:
    source = LiveHands("tracker", 100)
    for number in range(3 * MOST_WAITING):
        source.put(HandFrame(0.0, number=number))
    assert source.dropped == 2 * MOST_WAITING
    assert next(source).number == 2 * MOST_WAITING
