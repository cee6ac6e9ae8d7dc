"""The page in a real Chromium, on an emulated device: what its controls do is judged by the bits that the boards play.

The frames that a test reads come from the page's own memory (``window.phasewire``); that they are the captured bits is
what test_studio.py shows. Pictures are judged by their pixels at places that the page's own camera names.
"""

from __future__ import annotations

import io
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import ControlPoints, Pulses, TransducerArray, Wiring, pressure, record, solve
from phasewire.base.errors import PhasewireError
from phasewire.base.pictures import CYCLIC, SEQUENTIAL
from phasewire.view import Emitter, Snapshot, View
from phasewire.view.browser import saved_from
from phasewire.view.recordings import open_tape
from phasewire.view.settings import Settings

from ..chromium import MARKS, PATIENCE, chromium, grave_faults
from .pages import page_of
from .test_studio import Session, session

pytestmark = MARKS
Browser = Any
Tab = Any
SIZE = {"width": 1000, "height": 700}
ARRAY = TransducerArray.grid()
WIDTHS, AUDITED = (320, 375, 430, 768, 1440), (320, 1440)
"""In pixels; and those at which axe-core looks, too."""
FITS = """() => {
    const stop = document.getElementById("stop"), { left, right, top, bottom } = stop.getBoundingClientRect();
    const corners = [[left + 3, top + 3], [right - 3, top + 3], [left + 3, bottom - 3], [right - 3, bottom - 3]];
    return {
        stop: corners.every(([x, y]) => stop.contains(document.elementFromPoint(x, y))),
        page: document.documentElement.scrollWidth <= innerWidth,
    };
}"""
FRAME = """() => {
    const { frame, settings, drawn, received } = window.phasewire ?? {};
    return { frame, settings, drawn, received };
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


class Window:
    """A tab with the page, and what went wrong in it."""

    def __init__(self, tab: Tab, url: str) -> None:
        self.tab, self.wrong = tab, list[str]()
        tab.set_default_timeout(PATIENCE * 1000)
        own = urlsplit(url).netloc
        tab.on("pageerror", lambda error: self.wrong.append(str(error)))
        tab.on("console", lambda said: self.wrong.extend([said.text] if said.type in ("error", "warning") else []))
        tab.on(
            "request", lambda asked: self.wrong.extend([] if urlsplit(asked.url).netloc in (own, "") else [asked.url])
        )
        tab.goto(url)
        self.until(lambda seen: (seen["drawn"] or 0) >= 2 and seen["frame"] is not None)

    def seen(self) -> dict[str, Any]:
        """What the page has."""
        found: dict[str, Any] = self.tab.evaluate(FRAME)
        return found

    def until(self, holds: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """What the page has once something holds; the policy forbids playwright's own way, which evaluates text."""
        end = time.monotonic() + PATIENCE
        while True:
            seen = self.seen()
            if holds(seen):
                return seen
            assert time.monotonic() < end, seen
            time.sleep(0.05)

    def says(self, words: str, part: Any) -> None:
        """Wait until a part of the page shows a text, a regular expression. The page draws a moment after it has it."""
        self.until(lambda _: re.search(words, part.inner_text()))

    def press(self, name: str) -> None:
        """Press a button."""
        self.tab.get_by_role("button", name=name, exact=True).click()

    def open(self, panel: str) -> None:
        """Unfold a panel."""
        self.tab.evaluate(
            "(name) => { for (const each of document.querySelectorAll('details')) "
            "if (each.querySelector('summary').textContent.trim() === name) each.open = true; }",
            panel,
        )

    def slide(self, label: str, value: float) -> None:
        """Move a slider."""
        self.tab.get_by_label(label, exact=True).evaluate(
            "(input, value) => { input.value = value; input.dispatchEvent(new Event('input', { bubbles: true })); "
            "input.dispatchEvent(new Event('change', { bubbles: true })); }",
            value,
        )

    def choose(self, label: str, value: str) -> None:
        """Choose of a list."""
        self.tab.get_by_label(label, exact=True).select_option(value)

    def check(self, label: str, *, on: bool = True) -> None:
        """Tick a box."""
        self.tab.get_by_label(label, exact=True).set_checked(on)

    def pixels(self) -> NDArray[np.uint8]:
        """A picture of the page, (height, width, 3)."""
        from matplotlib.image import imread

        data = self.tab.screenshot(timeout=PATIENCE * 1000)
        return (np.asarray(imread(io.BytesIO(data), "png"))[..., :3] * 255).round().astype(np.uint8)

    def where(self, place: Any) -> tuple[int, int]:
        """The pixel of a place in space: column and row."""
        x, y = self.tab.evaluate("(place) => phasewire.project(place)", [float(each) for each in place])
        return round(x), round(y)

    def shows(self, period: int) -> None:
        """Wait until a snapshot of a period is drawn."""
        self.until(lambda seen: seen["frame"]["period"] == period)
        self.draws_on()

    def draws_on(self) -> None:
        """Wait until what has come is drawn: it is in the next picture."""
        for _ in range(2):
            self.tab.evaluate("() => new Promise(requestAnimationFrame)")


@pytest.fixture
def stage(browser: Browser) -> Iterator[tuple[Session, Window]]:
    with session() as running:
        tab = browser.new_page(viewport=SIZE)
        window = Window(tab, running.view.url)
        yield running, window
        tab.close()
        assert window.wrong == []


@pytest.fixture
def still(browser: Browser) -> Iterator[tuple[View, Window]]:
    """A view whose picture stands still."""
    with View(Emitter(ARRAY, "still", Wiring.strips()), settings=Settings(xy_at=0.17)) as view:
        tab = browser.new_page(viewport=SIZE, color_scheme="dark")
        window = Window(tab, view.url)
        yield view, window
        tab.close()
        assert window.wrong == []


def playing(seen: dict[str, Any]) -> bool:
    return bool(seen["frame"]["state"] == "playing")


# The picture


def near(picture: NDArray[np.uint8], at: tuple[int, int], colour: Any, reach: int = 3) -> bool:
    """Whether a colour is within some pixels of a place."""
    x, y = at
    part = picture[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1].astype(int)
    return bool((np.abs(part - np.asarray(colour)).max(axis=-1) <= 3).any())


def maps(window: Window) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The colours of a turn of the phase, and of a magnitude, as other pictures have them."""
    from matplotlib import colormaps

    places = np.arange(256) / 256
    drawn = (places * 360 + 180) % 360 / 360  # from -180 to 180 degrees, as the picture of an array has them
    cyclic, sequential = (
        np.asarray(colormaps[name](at, bytes=True))[:, :3] for name, at in ((CYCLIC, drawn), (SEQUENTIAL, places))
    )
    return cyclic, sequential


def test_it_draws_what_it_gets_and_asks_nobody_else(stage: tuple[Session, Window]) -> None:
    _, window = stage
    first = window.until(playing)
    later = window.until(lambda seen: seen["drawn"] > first["drawn"] + 20)
    assert later["received"] > first["received"]
    assert len(np.unique(window.pixels().reshape(-1, 3), axis=0)) > 200


def test_phases_and_amplitudes_are_on_the_right_transducers(still: tuple[View, Window]) -> None:
    """Each transducer has its own phase, so that a mirrored or turned array cannot look right."""
    view, window = still
    window.press("Top")
    window.check("xy plane", on=False)
    window.until(lambda seen: not seen["frame"]["planes"])
    turns = (np.arange(320) + 0.3) / 320  # none at the border of two of the 256 colours, where rounding decides
    drive = np.exp(2j * np.pi * turns)
    drive[[0, 19, 300]] = 0
    view.show(Snapshot(drive[None], 1))
    window.shows(1)
    picture, (cyclic, _) = window.pixels(), maps(window)
    right = 0
    for number, place in enumerate(ARRAY.positions):
        x, y = window.where(place)
        shown = near(picture, (x, y), cyclic[int(turns[number] * 256)], 1)
        right += shown
        assert shown or number in (0, 19, 300), number
    assert right == 317


def test_from_above_x_is_to_the_right_and_y_up(still: tuple[View, Window]) -> None:
    _, window = still
    window.press("Top")
    window.draws_on()
    middle, right, back = (window.where(place) for place in ((0, 0, 0), (0.05, 0, 0), (0, 0.05, 0)))
    assert right[0] > middle[0] + 30
    assert abs(right[1] - middle[1]) <= 1
    assert back[1] < middle[1] - 30
    assert abs(back[0] - middle[0]) <= 1


@pytest.mark.parametrize("size", [(1440, 900), (375, 700)])
def test_the_scene_fills_its_space_and_views_along_an_axis_are_orthographic(
    still: tuple[View, Window], size: tuple[int, int]
) -> None:
    """By the corners of the space above the array: within what buttons and colour bars leave free, in its middle."""
    _, window = still
    window.tab.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
    corners = np.array([(x, y, z) for x in (-0.1, 0.1) for y in (-0.08, 0.08) for z in (0, 0.25)])
    for camera, axis in (("3D", None), ("Top", 2), ("Front", 1), ("Side", 0)):
        window.press(camera)
        window.draws_on()
        at = np.array([window.where(corner) for corner in corners])
        stage, bars = (window.tab.locator(part).bounding_box() for part in ("#stage", "#legend"))
        below = size[0] < 600
        right, bottom = (stage["x"] + stage["width"], bars["y"]) if below else (bars["x"], stage["y"] + stage["height"])
        free = np.array([(stage["x"], stage["y"] + 36), (right, bottom)])
        assert (at > free[0]).all(), camera
        assert (at < free[1]).all(), camera
        used = np.ptp(at, axis=0) / np.ptp(free, axis=0)
        assert used.max() > 0.6, (camera, used)
        aside = (at.min(axis=0) + at.max(axis=0) - free.sum(axis=0)) / 2
        assert (np.abs(aside) < 0.12 * np.ptp(free, axis=0)).all(), (camera, aside)
        if axis is not None:
            low, high = (at[corners[:, axis] == corners[end, axis]] for end in (0, -1))
            assert np.abs(low - high).max() <= 1, camera


@pytest.mark.parametrize(("camera", "plane"), [("Top", "xy"), ("Front", "xz"), ("Side", "yz")])
def test_a_focus_is_drawn_where_it_is(still: tuple[View, Window], camera: str, plane: str) -> None:
    """By pixels: the brightest of the map at the focus, the darkest in the other corners; and it moves as it should."""
    view, window = still
    window.press(camera)
    for name in ("xy", "xz", "yz"):
        window.check(f"{name} plane", on=name == plane)
    _, sequential = maps(window)
    for number, focus in enumerate(((0.05, 0.03, 0.19), (-0.06, 0.03, 0.19), (-0.06, -0.04, 0.14)), 1):
        at = dict(zip(("yz_at", "xz_at", "xy_at"), focus, strict=True))
        view.settle(partial(replace, **at))
        view.show(Snapshot(solve(ARRAY, ControlPoints([focus])).drive[None], number))
        window.shows(number)
        picture = window.pixels().astype(int)
        levels = [level_at(picture, window.where(place), sequential) for place in around(focus, plane)]
        assert levels[0] > 120, levels
        assert max(levels[1:]) < levels[0] / 2, levels


def around(focus: tuple[float, float, float], plane: str) -> list[tuple[float, float, float]]:
    """A focus, and the places of which a mirrored picture would make it."""
    x, y, z = focus
    if plane == "xy":
        return [focus, (-x, y, z), (x, -y, z), (-x, -y, z)]
    return [focus, (-x, y, z)] if plane == "xz" else [focus, (x, -y, z)]


def level_at(picture: NDArray[np.int_], at: tuple[int, int], colours: NDArray[np.uint8]) -> int:
    """The level whose colour is nearest to that of a pixel."""
    distance = np.abs(colours.astype(int) - picture[at[1], at[0]]).sum(axis=1)
    return int(distance.argmin())


def test_a_board_with_a_fault_is_named(still: tuple[View, Window]) -> None:
    view, window = still
    view.show(Snapshot(np.zeros((1, 320)), boards=("", "", "TEMPERATURE", "", "")))
    window.until(lambda seen: seen["frame"]["boards"][2])
    window.draws_on()
    window.says("board 2: TEMPERATURE", window.tab.locator("body"))


# The controls


@pytest.mark.parametrize("how", ["button", "Escape", "Space"])
def test_stop_turns_the_outputs_off(stage: tuple[Session, Window], how: str) -> None:
    running, window = stage
    window.until(playing)
    if how == "button":
        window.tab.get_by_role("button", name=re.compile("^STOP")).click()
    else:
        window.tab.keyboard.press(how)
    stopped = window.until(lambda seen: seen["frame"]["state"] == "stopped")
    assert not running.device.status().enabled
    window.press("Play")
    window.until(lambda seen: playing(seen) and seen["frame"]["period"] > stopped["frame"]["period"])
    running.end()
    capture = running.emulator.capture()
    assert np.abs(capture.drives(capture.periods - 4000, capture.periods)).any()


def test_a_page_that_is_closed_turns_the_outputs_off(browser: Browser) -> None:
    with session() as running:
        tab = browser.new_page(viewport=SIZE)
        Window(tab, running.view.url).until(playing)
        tab.close()
        until(lambda: not running.device.status().enabled)


def test_a_connection_that_is_lost_is_said_and_the_outputs_are_off(browser: Browser) -> None:
    with session() as running:
        tab = browser.new_page(viewport=SIZE)
        window = Window(tab, running.view.url)
        window.until(playing)
        running.view.server.close()
        until(lambda: not running.device.status().enabled)
        tab.get_by_text("Connection lost").wait_for()
        tab.close()


def test_a_dragged_hand_is_felt_where_it_was_put(stage: tuple[Session, Window]) -> None:
    running, window = stage
    window.check("xy plane", on=False)
    window.press("Front")
    window.until(lambda seen: playing(seen) and seen["frame"]["sides"] == ["right"])
    window.draws_on()
    landmark = running.view.was(2**60).hands[0].landmarks[9]  # type: ignore[union-attr]
    x, y = window.where(landmark)
    to = window.where(landmark + np.array([0.04, 0, -0.03]))
    window.tab.mouse.move(x, y)
    window.tab.mouse.down()
    window.tab.mouse.move((x + to[0]) / 2, (y + to[1]) / 2, steps=4)
    window.tab.mouse.move(*to, steps=4)
    window.tab.mouse.up()
    hand = window.until(lambda seen: abs(seen["settings"]["hand"]["x"] - 0.04) < 0.004)["settings"]["hand"]
    assert hand["z"] == pytest.approx(0.14, abs=0.004)
    assert hand["y"] == pytest.approx(0, abs=0.002)
    until(lambda: abs(running.view.was(2**60).points[:, 2].mean() - 0.14) < 0.01)  # type: ignore[union-attr]
    snapshot = running.view.was(2**60)
    assert snapshot is not None
    felt = np.abs(pressure(ARRAY, snapshot.drives[0], snapshot.points[:, :3]))
    assert felt.max() > 3 * np.abs(pressure(ARRAY, snapshot.drives[0], [(-0.09, 0.09, 0.14)]))[0]


def until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


SLIDERS = [
    ("Field", "Height z", 150, ("xy_at",), 0.15),
    ("Field", "Position y", 20, ("xz_at",), 0.02),
    ("Field", "Position x", -20, ("yz_at",), -0.02),
    ("Method", "Frequency", 100, ("frequency",), 100),
    ("Method", "Amplitude", 30, ("amplitude",), 0.3),
    ("Method", "Point spacing", 8, ("spacing",), 0.008),
    ("Hand", "Hand x", 30, ("hand", "x"), 0.03),
    ("Hand", "Hand y", -20, ("hand", "y"), -0.02),
    ("Hand", "Hand z", 160, ("hand", "z"), 0.16),
    ("Hand", "Turn", 45, ("hand", "turn"), 45),
    ("Hand", "Curl", 40, ("hand", "curl"), 0.4),
    ("Objects", "Object x", 25, ("objects", 0, "x"), 0.025),
    ("Objects", "Object y", -15, ("objects", 0, "y"), -0.015),
    ("Objects", "Object z", 180, ("objects", 0, "z"), 0.18),
    ("Objects", "Size", 60, ("objects", 0, "size"), 0.06),
    ("Objects", "Rotation", 30, ("objects", 0, "rotation"), 30),
]


def test_every_slider_sets_what_it_says(stage: tuple[Session, Window]) -> None:
    running, window = stage
    window.until(playing)
    for panel, label, value, path, wanted in SLIDERS:
        window.open(panel)
        window.slide(label, value)

        def setting(seen: dict[str, Any], path: Any = path) -> float:
            found = seen["settings"]
            for step in path:
                found = found[step]
            return float(found)

        window.until(lambda seen, wanted=wanted: abs(setting(seen) - wanted) < 1e-6)  # type: ignore[misc]
    until(lambda: np.allclose(running.studio._objects[0].mesh.centre, (0.025, -0.015, 0.18)))
    studio = running.studio._settings
    assert (studio.amplitude, studio.frequency, studio.spacing) == (0.3, 100, 0.008)
    mesh = running.studio._objects[0].mesh
    corners = mesh.vertices - mesh.centre
    assert np.ptp(corners, axis=0)[2] == pytest.approx(0.06)


def test_lists_and_boxes_set_what_they_say(stage: tuple[Session, Window]) -> None:
    _, window = stage
    window.until(playing)
    for label, value, name in (
        ("Quantity", "intensity", "quantity"),
        ("Method", "tikhonov", "method"),
        ("Compare with", "multiplex", "compare"),
        ("Height follows", "palm", "follow"),
    ):
        window.choose(label, value)
        window.until(lambda seen, name=name, value=value: seen["settings"][name] == value)  # type: ignore[misc]
    window.until(
        lambda seen: (seen["frame"]["side"] or {}).get("numbers") and seen["frame"]["scale"]["unit"].startswith("W/m²")
    )
    window.says("multiplex", window.tab.get_by_label("Side by side"))
    for label, name in (("xz plane", "xz"), ("yz plane", "yz")):
        window.check(label)
        window.until(lambda seen, name=name: seen["settings"][name])  # type: ignore[misc]
    window.check("Points at corners", on=False)
    window.until(lambda seen: not seen["settings"]["corners"])
    window.open("Objects")
    window.choose("Kind", "sphere")
    window.until(lambda seen: seen["settings"]["objects"][0]["kind"] == "sphere")
    window.press("Add object")
    window.until(lambda seen: len(seen["settings"]["objects"]) == 2)
    window.press("Remove")
    window.until(lambda seen: len(seen["settings"]["objects"]) == 1)


def test_a_click_on_a_transducer_tells_its_place_and_silences_it(stage: tuple[Session, Window]) -> None:
    running, window = stage
    window.until(playing)
    window.check("xy plane", on=False)
    window.press("Top")
    window.slide("Amplitude", 100)
    window.open("Hand")
    window.slide("Hand x", -120)
    window.until(lambda seen: seen["settings"]["hand"]["x"] < -0.1)
    number = 19  # a corner, which no object covers
    until(lambda: abs(running.view.was(2**60).hands[0].centre[0] + 0.12) < 0.005)  # type: ignore[union-attr]
    window.draws_on()
    window.tab.mouse.click(*window.where(ARRAY.positions[number]))
    seen = window.until(lambda seen: (seen["frame"]["pick"] or {}).get("transducer") == number)
    channel = int(Wiring.strips().channels[number])
    told = dict(map(tuple, seen["frame"]["pick"]["lines"]))
    assert [int(told[name]) for name in ("Board", "Processor", "Bit")] == [
        channel // 64,
        channel // 32 % 2,
        channel % 32,
    ]
    window.check("Silence this transducer")
    window.until(lambda seen: seen["settings"]["silenced"] == [number])
    window.slide("Hand x", 0)
    window.until(lambda seen: abs(seen["settings"]["hand"]["x"]) < 1e-6)
    begun = window.seen()["frame"]["period"]
    last = window.until(lambda seen: seen["frame"]["period"] > begun + 40_000)["frame"]["period"]
    running.end()
    played = np.abs(running.drives(last - 400, last)).max(axis=0)
    assert played[number] == 0
    assert (played > 0).sum() > 300


def test_a_click_on_a_plane_tells_the_pressure_there(still: tuple[View, Window]) -> None:
    view, window = still
    focus = (0.03, -0.02, 0.17)
    drive = solve(ARRAY, ControlPoints([focus])).drive
    view.show(Snapshot(drive[None], 1))
    window.press("Top")
    window.shows(1)
    window.tab.mouse.click(*window.where(focus))
    probe = window.until(lambda seen: seen["frame"]["probe"])["frame"]["probe"]
    np.testing.assert_allclose(probe["at"], focus, atol=0.002)
    assert probe["pascals"][0] == pytest.approx(abs(pressure(ARRAY, drive, [probe["at"]])[0]), rel=1e-3)
    window.says(r"\d+ Pa\s+\d+\.\d dB\s+\d+°", window.tab.locator("#probe"))


def test_the_past_is_stepped_through_period_by_period(stage: tuple[Session, Window]) -> None:
    _, window = stage
    window.open("Square waves")
    window.tab.get_by_label("Watched transducers").fill("7")
    window.tab.keyboard.press("Enter")
    window.until(lambda seen: playing(seen) and seen["frame"]["waves"])
    begun = window.seen()["frame"]["period"]
    window.until(lambda seen: seen["frame"]["period"] > begun + 8000)
    window.press("−10 ms")
    at = window.until(lambda seen: seen["settings"]["at"] is not None and not seen["frame"]["live"])["settings"]["at"]
    for step, button in ((-1, "−1 period"), (1, "+1 period"), (400, "+10 ms")):
        at += step
        window.press(button)
        seen = window.until(partial(is_at, at))
        assert seen["frame"]["waves"]["first"] == 50 * (at - 2)
    window.press("Live")
    window.until(lambda seen: seen["frame"]["live"])


def test_a_fault_is_injected_and_seen(stage: tuple[Session, Window]) -> None:
    running, window = stage
    window.until(playing)
    window.open("Faults")
    window.choose("Fault", "dead-board")
    window.tab.get_by_label("board", exact=True).fill("3")
    window.press("Inject")
    window.until(lambda seen: seen["frame"]["boards"][3])
    running.end()
    last = running.emulator.capture().periods
    dead = running.emulator.capture().wiring.channels // 64 == 3
    assert not np.abs(running.drives(last - 40, last))[:, dead].any()


def is_at(period: int, seen: dict[str, Any]) -> bool:
    return bool(seen["frame"]["period"] == period and not seen["frame"]["live"])


def test_a_recording_is_paused_and_stepped_through(browser: Browser, tmp_path: Path) -> None:
    frames = [Pulses(np.full(320, 10), np.full(320, width)) for width in range(1, 26)]
    record(tmp_path / "widths.frames", frames, 10.0)
    with open_tape(tmp_path / "widths.frames") as tape, View(tape.emitter, tape=tape, settings=tape.settings) as view:
        over = threading.Event()
        playing = threading.Thread(target=tape.run, args=(view, over.is_set))
        playing.start()
        tab = browser.new_page(viewport=SIZE)
        window = Window(tab, view.url)
        window.until(lambda seen: seen["frame"]["period"] > 4000)
        window.press("Pause")
        window.until(lambda seen: not seen["settings"]["running"])
        at = window.seen()["settings"]["at"]
        window.press("+10 ms")
        window.until(partial(is_at, at + 400))
        window.slide("Moment", 40_000)
        window.until(partial(is_at, 40_000))
        tab.get_by_role("button", name="Play", exact=True).click()
        window.until(lambda seen: seen["frame"]["period"] > 42_000)
        over.set()
        playing.join()
        tab.close()
        assert window.wrong == []


# Whoever uses it


def test_it_is_used_by_the_keyboard_alone(stage: tuple[Session, Window]) -> None:
    _, window = stage
    window.until(playing)
    window.tab.get_by_label("Amplitude", exact=True).focus()
    for _ in range(3):
        window.tab.keyboard.press("ArrowLeft")
    window.until(lambda seen: seen["settings"]["amplitude"] < 0.98)
    window.tab.get_by_label("xz plane").focus()
    window.tab.keyboard.press("Space")
    window.until(lambda seen: seen["settings"]["xz"] and playing(seen))
    reached = set()
    window.tab.locator("body").evaluate("body => { body.tabIndex = -1; body.focus(); }")
    for _ in range(80):
        window.tab.keyboard.press("Tab")
        reached.add(window.tab.evaluate("document.activeElement.id || document.activeElement.textContent.trim()"))
    assert {"stop", "scene", "quantity", "amplitude", "at", "live", "Top"} <= reached


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_everyone_can_use_it_in_every_state_at_every_width(browser: Browser, scheme: str) -> None:
    """By axe-core, with all panels open; STOP is whole and uncovered, and the page does not scroll sideways."""
    with session() as running:
        tab = browser.new_page(viewport=SIZE, color_scheme=scheme)
        window = Window(tab, running.view.url)
        window.until(playing)
        assert "transducers" in (tab.locator("#scene").get_attribute("aria-label") or "")
        tab.evaluate("() => { for (const each of document.querySelectorAll('details')) each.open = true; }")
        window.check("Measure at a place")
        window.choose("Compare with", "tikhonov")
        tab.get_by_label("Side by side").wait_for()
        for enter, said in (
            (lambda: None, "playing"),
            (lambda: tab.get_by_role("button", name=re.compile("^STOP")).click(), "stopped"),
            (lambda: running.view.say("an error: what was wrong, and what would be right", error=True), "wrong"),
            (running.view.server.close, "Connection lost"),
        ):
            enter()
            tab.get_by_text(said).first.wait_for()
            for width in WIDTHS:
                tab.set_viewport_size({"width": width, "height": 800})
                assert tab.evaluate(FITS) == {"stop": True, "page": True}, (said, width)
                assert width not in AUDITED or grave_faults(tab) == [], (said, width)
        tab.close()


def test_two_tabs_show_the_same(browser: Browser) -> None:
    with session() as running:
        tabs = [browser.new_page(viewport=SIZE) for _ in range(2)]
        windows = [Window(tab, running.view.url) for tab in tabs]
        windows[0].choose("Quantity", "phase")
        for window in windows:
            window.until(lambda seen: playing(seen) and seen["frame"]["scale"]["cyclic"])
        assert tabs[1].get_by_label("Quantity").input_value() == "phase"
        for tab in tabs:
            tab.close()


def test_a_wrong_token_shows_nothing_and_says_so(browser: Browser) -> None:
    with View(ARRAY) as view:
        tab = browser.new_page(viewport=SIZE)
        tab.goto(view.url.split("#")[0] + "#wrong")
        tab.get_by_text("open the URL that the program printed").wait_for()
        assert view.server.pages == 0
        tab.close()


def test_a_page_of_a_stranger_gets_nothing(browser: Browser) -> None:
    """Even with the right token: the browser names the stranger as the origin."""
    with View(ARRAY) as view, View(ARRAY) as stranger:
        host, token = urlsplit(view.url).netloc, urlsplit(view.url).fragment
        tab = browser.new_page()
        tab.goto(stranger.url)
        said = tab.evaluate(
            "(url) => new Promise((done) => { const socket = new WebSocket(url); socket.onopen = () => done('open'); "
            "socket.onerror = () => done('refused'); })",
            f"ws://{host}/ws?token={token}",
        )
        assert said == "refused"
        assert view.server.pages == 0
        tab.close()


@pytest.mark.parametrize("embedded", [True, False])
def test_only_an_embedded_view_is_shown_within_another_page(browser: Browser, tmp_path: Path, embedded: bool) -> None:
    """As a notebook shows it: a page of another server of this computer has the view's own HTML."""
    with View(ARRAY, embedded=embedded) as view:
        (tmp_path / "index.html").write_text(f"<!doctype html><title>notebook</title>{view._repr_html_()}")
        handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
        with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            tab = browser.new_page(viewport=SIZE)
            tab.goto(f"http://127.0.0.1:{server.server_port}/")
            if embedded:
                frame = tab.frames[1]
                until(lambda: frame.evaluate("() => window.phasewire?.drawn ?? 0") > 1)
                view.update(np.ones(320))
                until(lambda: frame.evaluate("() => phasewire.frame?.state") == "playing")
            else:
                until(lambda: tab.frames[1].url.startswith("chrome-error"))
                assert view.server.pages == 0
            tab.close()
            server.shutdown()


def test_garbage_from_the_server_does_not_end_the_page(still: tuple[View, Window]) -> None:
    view, window = still
    for garbage in (b"", b"\xff" * 40, b"\x02\0\0\0{}", b'\x14\0\0\0{"kind": "frame"}   '):
        view.server.tell(garbage)
    window.tab.get_by_text("cannot be used").first.wait_for()
    view.update(np.ones(320))
    window.until(lambda seen: seen["frame"]["state"] == "playing")
    window.wrong.clear()


def test_a_page_that_hangs_holds_nothing_up(stage: tuple[Session, Window]) -> None:
    """The page is busy for seconds; another one, and the device, go on."""
    running, window = stage
    window.until(playing)
    with page_of(running.view.url) as other:
        before = other.until(lambda message: message["state"] == "playing")["period"]
        window.tab.evaluate(
            "() => { setTimeout(() => { const end = Date.now() + 3000; while (Date.now() < end); }, 0); }"
        )
        other.until(lambda message: message["period"] > before + 60_000)
    window.until(lambda seen: seen["frame"]["period"] > before + 60_000)


# Pictures without a window


@pytest.mark.parametrize("kind", ["png", "webm"])
def test_a_picture_is_saved_without_a_window(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"sphere.{kind}"
    command = [sys.executable, "-m", "phasewire", "view", "sphere", "--hand", "gesture:sweep", "--save", str(path)]
    ended = subprocess.run(
        [*command, "--seconds", "1"], capture_output=True, text=True, timeout=2 * PATIENCE, check=False
    )
    assert (ended.returncode, ended.stdout) == (0, "The outputs are off.\n"), ended.stderr
    data = path.read_bytes()
    if kind == "webm":
        assert data[:4] == b"\x1aE\xdf\xa3"  # EBML
        assert b"V_VP" in data[:400]
        return
    from matplotlib.image import imread

    picture = (np.asarray(imread(io.BytesIO(data), "png"))[..., :3] * 255).round().astype(np.uint8)
    assert picture.shape[0] > 400
    colours = {tuple(colour) for colour in picture.reshape(-1, 3).tolist()}
    from matplotlib import colormaps

    fields = {tuple(colour[:3]) for colour in colormaps[SEQUENTIAL](np.arange(256), bytes=True).tolist()}
    assert len(colours & fields) > 100


def test_a_browser_that_sends_nothing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASEWIRE_BROWSER", "true")
    with (
        View(ARRAY, saving=True) as view,
        pytest.raises(PhasewireError, match="has sent no picture"),
        saved_from(view, tmp_path / "nothing.png", 0) as saved,
    ):
        until(saved)
    assert list(tmp_path.iterdir()) == []
