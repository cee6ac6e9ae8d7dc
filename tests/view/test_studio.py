"""A studio on an emulated device, directed by a page: the bits that the boards played are what counts."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import Device, Emulator, Mesh, TransducerArray, open_device
from phasewire.base.errors import DeviceLostError
from phasewire.host.hands.frames import HandFrame
from phasewire.host.hands.sources import PlayedHands, open_hands
from phasewire.solver.objects.parsing import MovingObject, parse_object
from phasewire.view import View
from phasewire.view.hands import MouseHands, at_wall_pace
from phasewire.view.settings import HandSetting, ObjectSetting, Settings
from phasewire.view.shelf import Shelf
from phasewire.view.studio import Studio
from phasewire.view.tap import EXACT, emitter_of

from .pages import PATIENCE, Message, Page, page_of

pytestmark = pytest.mark.slow  # each plays for a while

ARRAY = TransducerArray.grid()
SECOND = 40_000
"""Carrier periods."""


class Session:
    """A studio that runs in a thread of its own."""

    def __init__(self, emulator: Emulator, device: Device, studio: Studio, view: View) -> None:
        self.emulator, self.device, self.studio, self.view = emulator, device, studio, view
        self._over = threading.Event()
        self._thread = threading.Thread(target=studio.run, args=(view, self._over.is_set))
        self._thread.start()

    def end(self) -> None:
        """Let it end; then the emulator is this thread's."""
        self._over.set()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def drives(self, first: int, last: int) -> NDArray[Any]:
        """What was played, after the end."""
        return np.asarray(self.emulator.capture().drives(first, last))


@contextmanager
def session(hand: str = "mouse:", objects: tuple[str, ...] = ("cube",), **options: Any) -> Iterator[Session]:
    shelf = Shelf([(text.partition(":")[0], parse_object(text)) for text in objects])
    settings = Settings(objects=shelf.settings, hand=HandSetting() if hand == "mouse:" else None)
    with Emulator(history_periods=60 * SECOND) as emulator, open_device(emulator.url) as device:
        source: Any = MouseHands(HandSetting()) if hand == "mouse:" else at_wall_pace(open_hands(hand, time))
        studio = Studio(device, ARRAY, shelf, source, settings, emulator=emulator, **options)
        studio.warm_up()
        with View(emitter_of(device, ARRAY), settings=settings, director=studio) as view:
            running = Session(emulator, device, studio, view)
            try:
                yield running
            finally:
                running.end()
                source.close()


@pytest.fixture
def stage() -> Iterator[tuple[Session, Page]]:
    with session() as running, page_of(running.view.url) as page:
        yield running, page


def sounding(frame: Message) -> bool:
    return bool(frame["state"] == "playing" and frame.array("amplitude").any())


def silent(frame: Message) -> bool:
    return not frame.array("amplitude").any()


def places(frame: Message) -> NDArray[Any]:
    return np.asarray(frame.array("points")[:, :3])


def test_the_page_shows_the_bits_that_the_boards_played(stage: tuple[Session, Page]) -> None:
    """Of both halves, that which plays in the frame's period, and the last one before it."""
    running, page = stage
    frames = [page.until(sounding) for _ in range(5)]
    running.end()
    for frame in frames:
        period = frame["period"]
        before = period // 100 * 100 - 1
        played = np.abs(np.stack([running.drives(each, each + 1)[0] for each in (period, before)])).max(axis=0)
        np.testing.assert_allclose(frame.array("amplitude") / 255, played, atol=0.003)
        assert frame["source"] == "bits of the emulated boards"


@pytest.mark.parametrize("hand", ["mouse:", "gesture:sweep"])
def test_a_method_beside_itself_emits_the_same(hand: str) -> None:
    """Like with like: the bits of all fields of a moment's points, and what was solved for these."""
    with session(hand) as running, page_of(running.view.url) as page:
        page.until(sounding)
        page.set(compare="wgs")
        for _ in range(20):
            frame = page.until(lambda message: sounding(message) and (message["side"] or {}).get("numbers"))
            assert all(this == that for _, this, that in frame["side"]["numbers"]), frame["side"]
            np.testing.assert_array_equal(frame.array("this"), frame.array("other"))
        page.set(compare="multiplex")
        # Where the hand touches a single point, both methods emit the same.
        page.until(
            lambda message: (
                (message["side"] or {}).get("other") == "multiplex"
                and (message.array("this") != message.array("other")).any()
            )
        )
        page.do("stop")
        page.until(lambda message: (message["side"] or {}).get("incomplete") == "no control point is touched")


def test_a_hand_that_is_moved_takes_the_points_with_it(stage: tuple[Session, Page]) -> None:
    _, page = stage
    before = page.until(sounding)
    page.set(hand={"x": 0.0, "y": 0.0, "z": 0.15})
    after = page.until(lambda message: sounding(message) and places(message)[:, 2].max() < 0.16)
    assert before.array("landmarks")[0, 0, 2] > after.array("landmarks")[0, 0, 2] + 0.01
    page.set(hand={"x": 0.3, "z": 0.3})
    page.until(lambda message: silent(message) and not len(places(message)))


def test_an_object_that_is_moved_or_exchanged_is_felt_where_it_is(stage: tuple[Session, Page]) -> None:
    _, page = stage
    page.until(sounding)
    page.set(objects=[{"kind": "sphere", "x": 0.03, "size": 0.06}])
    frame = page.until(lambda message: sounding(message) and places(message)[:, 0].min() > -0.005)
    sphere = Mesh.sphere(0.06).moved((0.03, 0, 0))
    distance = np.linalg.norm(places(frame) - (0.03, 0, 0.17), axis=1)
    assert np.abs(distance - 0.03).max() < 0.004
    np.testing.assert_allclose(
        page.kept["objects"].array("vertices0").mean(axis=0), sphere.vertices.mean(axis=0), atol=1e-3
    )
    page.set(objects=[])
    page.until(lambda message: silent(message) and not len(places(message)))


@pytest.mark.parametrize("how", ["stop", "close", "cut"])
def test_a_stop_or_the_end_of_the_last_page_turns_the_outputs_off(how: str) -> None:
    with session() as running:
        with page_of(running.view.url) as page:
            frame = page.until(sounding)
            if how == "stop":
                page.do("stop")
                page.until(lambda message: message["state"] == "stopped" and silent(message))
                page.set(hand={"z": 0.16})
                for _ in range(10):
                    assert silent(page.frame())
            elif how == "cut":
                page.socket.socket.close()
        end = time.monotonic() + PATIENCE
        while running.device.status().enabled:
            assert time.monotonic() < end
            time.sleep(0.01)
        running.end()
        last = running.emulator.capture().periods
        loudness = np.abs(running.drives(frame["period"], last)).mean(axis=1)
        sounding_periods = np.flatnonzero(loudness)
        assert len(sounding_periods)
        assert sounding_periods[-1] < len(loudness) - 10
        if how == "stop":  # at once, without the ramp of a hand that leaves
            assert loudness[sounding_periods[-1]] > 0.8 * loudness[sounding_periods].mean()


def test_a_stop_that_is_taken_back_at_once_is_no_refusal(stage: tuple[Session, Page]) -> None:
    _, page = stage
    for _ in range(5):
        period = page.until(sounding)["period"]
        page.do("stop")
        page.do("go")
        page.until(lambda message, period=period: sounding(message) and message["period"] > period + 4000)  # type: ignore[misc]
    page.do("stop")
    page.until(lambda message: message["state"] == "stopped")
    page.do("stop")
    page.do("go")
    page.until(sounding)
    assert page.notices == []


def test_one_of_two_pages_may_go(stage: tuple[Session, Page]) -> None:
    running, page = stage
    with page_of(running.view.url) as other:
        other.until(sounding)
    period = page.until(sounding)["period"]
    page.until(lambda message: sounding(message) and message["period"] > period + SECOND // 4)


def test_unwatched_it_begins_and_goes_on_without_a_page() -> None:
    with session(unwatched=True) as running:
        end = time.monotonic() + PATIENCE
        while not running.device.status().enabled:
            assert time.monotonic() < end
            time.sleep(0.01)
        with page_of(running.view.url) as page:
            page.until(sounding)
        time.sleep(0.2)
        assert running.device.status().enabled


def test_before_a_page_has_come_nothing_plays() -> None:
    with session() as running:
        time.sleep(0.3)
        assert not running.device.status().enabled


def test_amplitude_turns_everything_down(stage: tuple[Session, Page]) -> None:
    running, page = stage
    loud = page.until(lambda message: sounding(message) and message.array("amplitude").max() > 200)  # faded in
    page.set(amplitude=0.25)
    quiet = page.until(lambda message: sounding(message) and message.array("amplitude").max() < 80)
    running.end()
    for frame, most in ((loud, 1.0), (quiet, 0.25)):
        played = np.abs(running.drives(frame["period"] - 100, frame["period"] + 1)).max(axis=1)
        assert 0.7 * most < played.max() <= most + 0.03
    # widths are whole ticks: sin(π/50) = 0.063 is the least step


def test_a_transducer_can_be_silenced(stage: tuple[Session, Page]) -> None:
    running, page = stage
    page.until(sounding)
    page.set(silenced=[5, 100], pick=5)
    frame = page.until(lambda message: sounding(message) and not message.array("amplitude")[[5, 100]].any())
    assert frame["pick"]["silenced"]
    running.end()
    played = np.abs(running.drives(frame["period"] - 10, frame["period"] + 1))
    assert not played[:, [5, 100]].any()
    assert (played[:, np.delete(np.arange(320), [5, 100])].max(axis=0) > 0).mean() > 0.9


def test_method_and_frequency_begin_another_loop(stage: tuple[Session, Page]) -> None:
    running, page = stage
    page.until(sounding)
    page.set(frequency=100.0, method="multiplex")
    frame = page.until(lambda message: sounding(message) and message.array("amplitude").min() > 250)
    page.until(lambda message: message["period"] > frame["period"] + 1200)
    running.end()
    played = running.drives(frame["period"] + 400, frame["period"] + 1200)
    assert np.abs(np.abs(played) - 1).max() < 0.1  # linear multiplexing drives all fully, but for the ramps
    lengths = np.diff(np.flatnonzero(np.abs(np.diff(played, axis=0)).max(axis=1) > 0))
    assert lengths.max(initial=0) <= 400


def test_a_fault_that_is_injected_is_seen_on_its_board(stage: tuple[Session, Page]) -> None:
    _, page = stage
    page.until(sounding)
    page.do("fault", fault={"name": "hot-board", "board": 1, "celsius": 90})
    frame = page.until(lambda message: message["boards"][1])
    assert "TEMPERATURE" in frame["boards"][1]
    assert [bool(each) for each in frame["boards"]] == [False, True, False, False, False]
    assert dict(map(tuple, frame["figures"]))["Faults"] == "TEMPERATURE"


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"name": "flood"}, "flood"),
        ({"name": "dead-board"}, "board"),
        ({"name": "dead-board", "board": 9}, "0 to 4"),
        ({}, "name"),
    ],
)
def test_a_fault_that_is_none_is_refused(stage: tuple[Session, Page], fault: dict[str, Any], said: str) -> None:
    _, page = stage
    page.do("fault", fault=fault)
    assert said in page.notice()


def test_a_lost_device_is_said_and_play_tries_again(stage: tuple[Session, Page]) -> None:
    _, page = stage
    page.until(sounding)
    page.do("fault", fault={"name": "unplugged", "periods": 4000})
    assert "Play tries again" in page.notice()
    page.until(lambda message: message["state"] == "stopped" and silent(message))
    page.do("go")
    page.until(sounding)


def test_a_device_that_is_lost_while_it_rests_is_found_again(stage: tuple[Session, Page]) -> None:
    _, page = stage
    page.until(sounding)
    page.do("stop")
    page.until(lambda message: message["state"] == "stopped")
    page.do("fault", fault={"name": "unplugged", "periods": 8000})
    page.do("go")
    assert "Play tries again" in page.notice()
    page.until(lambda message: message["state"] == "stopped")
    page.do("go")
    page.until(sounding)


def test_without_power_it_says_that_it_is_stopped_so_that_play_can_be_tried() -> None:
    with pytest.raises(DeviceLostError), session() as running, page_of(running.view.url) as page:  # noqa: PT012
        page.until(sounding)
        page.do("fault", fault={"name": "power-cut"})
        page.notice()
        frame = page.until(lambda message: message["state"] == "stopped")
        assert frame["source"] == "the device is starting"


def test_a_fault_that_has_passed_is_named_no_more(stage: tuple[Session, Page]) -> None:
    _, page = stage
    page.until(sounding)
    page.do("fault", fault={"name": "stuck-low", "processor": 4, "bit": 1, "periods": 100_000})
    page.until(lambda message: message["boards"][2] == "stuck-low")
    page.do("clear-faults")
    page.until(lambda message: not message["boards"][2])


def test_a_stop_does_not_wait_for_an_object_that_is_prepared(
    stage: tuple[Session, Page], monkeypatch: pytest.MonkeyPatch
) -> None:
    running, page = stage
    page.until(sounding)
    prepared = threading.Event()
    monkeypatch.setattr(running.studio._shelf, "put", lambda _objects: prepared.wait(PATIENCE) and ())
    for size in (0.05, 0.06, 0.07):
        page.set(objects=[{"kind": "cube", "size": size}])
    page.do("stop")
    page.until(lambda message: message["state"] == "stopped" and silent(message))
    prepared.set()


def test_an_error_in_a_task_of_a_page_is_said(stage: tuple[Session, Page], monkeypatch: pytest.MonkeyPatch) -> None:
    running, page = stage
    page.until(sounding)

    def fails(_objects: Any) -> Any:
        raise RuntimeError("no such thing")

    monkeypatch.setattr(running.studio._shelf, "put", fails)
    page.set(objects=[{"kind": "cube"}])
    assert "no such thing" in page.notice()
    page.until(sounding)


def test_the_past_is_exact_to_the_period(stage: tuple[Session, Page]) -> None:
    running, page = stage
    page.set(watched=[3, 200])
    frame = page.until(sounding)
    page.until(lambda message: message["period"] > frame["period"] + 8000)
    shown = []
    for at in range(frame["period"] - 3, frame["period"] + 3):
        page.set(at=at)
        shown.append(page.until(lambda message, at=at: message["period"] == at and message["source"] == EXACT))  # type: ignore[misc]
    running.end()
    capture = running.emulator.capture()
    for past in shown:
        drive = running.drives(past["period"], past["period"] + 1)[0]
        np.testing.assert_allclose(past.array("amplitude") / 255, np.abs(drive), atol=0.003)
        bits = capture.channels(past["waves"]["first"], past["waves"]["first"] + 150)
        np.testing.assert_array_equal(past.array("waves"), bits[:, capture.wiring.channels[[3, 200]]])


def test_a_gesture_keeps_the_pace_of_the_wall_clock() -> None:
    began = time.monotonic()
    with session("gesture:sweep") as running, page_of(running.view.url) as page:
        first = page.frame()
        last = page.until(lambda message: message["period"] > first["period"] + 2 * SECOND)
        passed = time.monotonic() - began
        assert 2 < (last["period"] - first["period"]) / SECOND < passed  # by itself it would be faster
        page.set(hand={"x": 0.1})
        assert "only watches" in page.notice()


def test_a_recording_in_which_the_tracker_counted_anew_has_only_news_at_the_pace_of_the_wall_clock() -> None:
    recorded = (HandFrame(index / 100, number=number) for index, number in enumerate((7, 8, 8, 1, 2)))
    assert [frame.number for frame in at_wall_pace(PlayedHands("recorded", recorded, 100))] == [0, 1, 2, 3, 4]


def test_it_ends_with_the_hands() -> None:
    with session("gesture:approach?seconds=0.5") as running, page_of(running.view.url) as page:
        page.until(lambda message: message["state"] == "ended")
        assert not running.device.status().enabled


class TestShelf:
    """The objects that a page chooses among."""

    def test_the_commands_objects_are_where_it_put_them(self) -> None:
        text = "cube:size=0.06,x=0.02,y=-0.01,z=0.2,rotation=30,turn=90"
        thing = parse_object(text)
        shelf = Shelf([("cube", thing)])
        [again] = shelf.put(shelf.settings)
        np.testing.assert_allclose(again.mesh.vertices, thing.mesh.vertices, atol=1e-6)
        assert (again.spin, again.still) == (90, False)

    def test_an_object_keeps_its_motion_whatever_is_beside_it(self) -> None:
        shelf = Shelf([("cube", parse_object("cube:turn=90")), ("cube", parse_object("cube:x=0.1,vx=0.01"))])
        first, second = shelf.settings
        assert [thing.spin for thing in shelf.put([second, first])] == [0, 90]
        assert shelf.put([second])[0].velocity.tolist() == [0.01, 0, 0]
        assert shelf.put([ObjectSetting("cube")])[0].still

    def test_a_file_is_chosen_by_its_name_and_scaled_by_its_longest_side(self) -> None:
        box = Mesh.of(Mesh.cube(0.1).vertices * (1, 0.5, 0.2), Mesh.cube(0.1).faces)
        shelf = Shelf([("box.stl", MovingObject(box))])
        assert "box.stl" in shelf.kinds
        [setting] = shelf.settings
        assert setting.size == pytest.approx(0.1)
        from dataclasses import replace

        [larger] = shelf.put([replace(setting, size=0.2)])
        np.testing.assert_allclose(np.ptp(larger.mesh.vertices, axis=0), (0.2, 0.1, 0.04), atol=1e-6)
        np.testing.assert_allclose(larger.mesh.centre, box.centre, atol=1e-6)
