"""A view as a program or a notebook uses it: what it is given is what a page gets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from phasewire import (
    Calibration,
    Circle,
    ControlPoints,
    Hand,
    Mesh,
    Pulses,
    Solution,
    TransducerArray,
    Wiring,
    pressure,
    solve,
    two_sided,
)
from phasewire.view import Emitter, Snapshot, View
from phasewire.view.settings import Settings

from .pages import Message, Page, page_of

ARRAY = TransducerArray.grid()
POINTS = ControlPoints([(0.02, 0.01, 0.17), (-0.03, 0.0, 0.17)], [1.0, 0.5])


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(ARRAY, POINTS)


@pytest.fixture
def view() -> Iterator[View]:
    with View(Emitter(ARRAY, "the array", Wiring.strips())) as opened:
        yield opened


@pytest.fixture
def page(view: View) -> Iterator[Page]:
    with page_of(view.url) as opened:
        yield opened


def emitted(frame: Message) -> Any:
    return frame.array("amplitude") / 255 * np.exp(2j * np.pi * frame.array("phase") / 256)


def test_what_is_given_is_what_the_page_gets(view: View, page: Page, solution: Solution) -> None:
    hand, cube = Hand.flat((0.01, 0, 0.2), "left"), Mesh.cube(0.05)
    view.update(solution, hands=hand, objects=cube)
    frame = page.until(lambda message: message["sides"] == ["left"])
    np.testing.assert_allclose(emitted(frame), solution.drive, atol=0.03)
    np.testing.assert_allclose(frame.array("landmarks")[0], hand.landmarks, atol=1e-6)
    np.testing.assert_allclose(frame.array("quads")[0], hand.quads, atol=1e-6)
    np.testing.assert_allclose(frame.array("points")[:, :3], POINTS.positions, atol=1e-6)
    np.testing.assert_allclose(frame.array("points")[:, 3], [1, 0.5])
    objects = page.kept["objects"]
    np.testing.assert_allclose(objects.array("vertices0"), cube.vertices, atol=1e-6)
    np.testing.assert_array_equal(objects.array("faces0"), cube.faces)
    moved = cube.moved((0, 0.01, 0))
    view.update(objects=moved)
    frame = page.until(lambda message: "mesh0" in message["arrays"])
    np.testing.assert_allclose(frame.array("mesh0"), moved.vertices, atol=1e-6)
    assert frame["sides"] == ["left"]  # what was not given has stayed
    view.update(objects=[])
    page.until(lambda message: page.kept["objects"]["count"] == 0)


def test_settings_of_the_page_change_the_picture(view: View, page: Page, solution: Solution) -> None:
    view.update(solution)
    page.set(xy=False, xz=True, xz_at=0.01, quantity="phase", probe=[0.02, 0.01, 0.17], pick=7)
    frame = page.until(lambda message: [plane["name"] for plane in message["planes"]] == ["xz"])
    assert frame["scale"]["unit"] == "°"
    at = [(0.02, 0.01, 0.17)]
    assert frame["probe"]["pascals"] == pytest.approx([abs(pressure(ARRAY, solution.drive, at)[0])], rel=1e-3)
    lines = dict(frame["pick"]["lines"])
    pulses = Pulses.from_drive(solution.drive)
    assert lines["Pulse"].startswith(f"{pulses.width[7]} ticks wide, centred at {pulses.phase[7]} ")
    channel = int(Wiring.strips().channels[7])
    assert [lines["Board"], lines["Processor"], lines["Bit"]] == [
        str(channel // 64),
        str(channel // 32 % 2),
        str(channel % 32),
    ]
    assert page.kept["settings"]["values"]["xz_at"] == 0.01


def test_all_pages_show_the_same_settings_and_one_that_comes_later_has_a_frame(view: View, page: Page) -> None:
    page.frame()
    with page_of(view.url) as other:
        other.frame()
        page.set(yz=True)
        other.until(lambda _: other.kept["settings"]["values"]["yz"])


def test_what_is_refused_is_said_and_changes_nothing(view: View, page: Page) -> None:
    page.set(xz=True, xy_at=7)
    assert "xy_at 7 must be from 0.03 to 1" in page.notice()
    page.set(amplitude=0.5)
    assert "only watches" in page.notice()
    page.socket.send("no JSON")
    assert "command" in page.notice()
    assert view.settings == Settings()


def test_two_fields_are_shown_by_their_stronger_one(view: View, page: Page) -> None:
    both = two_sided(ARRAY, ControlPoints([(0.03, 0, 0.17), (-0.03, 0, 0.17)]))
    view.update(both)
    page.set(quantity="felt")
    frame = page.until(lambda message: message["scale"]["label"].startswith("Change") and message.array("xy").any())
    np.testing.assert_allclose(frame.array("amplitude") / 255, np.abs(both.drives).max(axis=0), atol=0.003)


def test_another_method_is_shown_beside(view: View, page: Page) -> None:
    ring = Circle(0.03, 0.17).sample(0.01)
    view.settle(lambda settings: replace(settings, compare="multiplex"))
    page.until(lambda message: message["side"] == {"incomplete": "no control point is touched"})
    view.update(two_sided(ARRAY, ring))
    frame = page.until(lambda message: not message["side"]["incomplete"])
    side = frame["side"]
    assert (side["method"], side["other"]) == ("wgs", "multiplex")
    assert frame.array("other").shape == frame.array("this").shape == frame.array("xy").shape
    assert (frame.array("other") != frame.array("this")).any()
    np.testing.assert_array_equal(frame.array("this"), frame.array("xy"))
    other = two_sided(ARRAY, ring, method="multiplex").drives
    mean = np.max([np.abs(pressure(ARRAY, drive, ring.positions)) for drive in other], axis=0).mean()
    shown = {label: that for label, _, that in side["numbers"]}["Mean at the points"]
    assert float(shown.split()[0]) == pytest.approx(mean, rel=0.05)


def is_at(height: float, message: Message) -> bool:
    return bool(abs(message["planes"][0]["corner"][2] - height) <= 0.001)


def test_a_plane_follows_the_palm_or_the_points(view: View, page: Page) -> None:
    view.update(hands=Hand.flat((0, 0, 0.15)), points=[(0, 0, 0.2), (0, 0, 0.21)])
    for follow, height in (("palm", 0.15), ("points", 0.205), (None, 0.17)):
        page.set(follow=follow)
        page.until(partial(is_at, height))
    page.set(follow="palm")
    for height, shown in ((0.19, 0.19), (0.015, 0.03)):  # the latter is too close to the array
        view.update(hands=Hand.flat((0, 0, height)))
        page.until(partial(is_at, shown))
    view.update(hands=[])
    assert page.until(lambda message: not message["sides"])["planes"][0]["corner"][2] == pytest.approx(0.03)
    assert view.settings.xy_at == 0.17


def test_it_goes_back_to_what_was(view: View, page: Page) -> None:
    for number in range(5):
        view.show(Snapshot(np.full((1, 320), number / 5), period=1000 * number))
    live = page.until(lambda message: message["period"] == 4000)
    assert (live["live"], live["oldest"], live["newest"]) == (True, 0, 4000)
    page.set(at=2999)
    past = page.until(lambda message: not message["live"])
    assert past["period"] == 2000
    assert past.array("amplitude")[0] == round(255 * 2 / 5)
    view.show(Snapshot(np.ones((1, 320)), period=5000))
    assert page.until(lambda message: message["newest"] == 5000)["period"] == 2000
    page.set(at=None)
    assert page.until(lambda message: message["live"])["period"] == 5000


def test_a_calibration_is_told() -> None:
    calibration = Calibration(np.full(320, 0.8), np.full(320, -12.0), -np.ones(320), np.zeros(320))
    with View(Emitter(ARRAY, calibration=calibration), settings=Settings(pick=3)) as view, page_of(view.url) as page:
        assert dict(page.frame()["pick"]["lines"])["Calibration"] == "gain 0.800, -12.0°, reversed"


def test_an_array_of_any_size_and_form_can_be_seen() -> None:
    array = TransducerArray.grid(3, 2).rotated(30, (0, 1, 0))
    with View(array) as view, page_of(view.url) as page:
        view.update(np.array([1, 1j, -1, 0.5, 0, 1]))
        frame = page.until(lambda message: message.array("amplitude").any())
        assert frame.array("amplitude").tolist() == [255, 255, 255, 128, 0, 255]
        assert frame.array("phase").tolist()[:3] == [0, 64, 128]


@pytest.mark.parametrize("compare", [None, "multiplex"])
def test_a_plane_that_is_too_close_is_turned_off_and_said(compare: str | None) -> None:
    close = Settings(xy_at=0.03, compare=compare)
    with View(ARRAY.rotated(90, (1, 0, 0)), settings=close) as view, page_of(view.url) as page:
        assert page.frame()["planes"] == []
        assert not view.settings.xy


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"drive": np.zeros(7)}, "320 transducers"),
        ({"drive": np.zeros((3, 320))}, "one or two fields"),
        ({"drive": np.full(320, 2)}, "has magnitude 2; at most 1 is possible"),
        ({"drive": np.full(320, np.nan)}, "finite"),
        ({"points": [(0, 0)]}, r"\(m, 3\)"),
        ({"points": [(0, 0, np.inf)]}, r"\(m, 3\)"),
        ({"hands": [5]}, "must be a Hand"),
        ({"hands": "ab"}, "must be a Hand"),
        ({"objects": [None]}, "must be a Mesh"),
        ({"objects": 5}, "must be a Mesh"),
    ],
)
def test_what_cannot_be_shown_is_refused(view: View, given: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        view.update(**given)


@pytest.mark.parametrize("array", [5, "x", [], np.zeros((4, 3))])
def test_what_is_no_array_is_refused(array: Any) -> None:
    with pytest.raises(ValueError, match="TransducerArray"):
        View(array)


def test_a_probe_that_is_too_close_leaves_the_planes(view: View, page: Page) -> None:
    page.set(probe=ARRAY.positions[0].tolist())
    assert "the probe is off" in page.notice()
    frame = page.until(lambda message: page.kept["settings"]["values"]["probe"] is None)
    assert [plane["name"] for plane in frame["planes"]] == ["xy"]


def test_a_notebook_shows_it_in_a_frame(view: View) -> None:
    assert f'src="{view.url}"' in view._repr_html_()


def test_it_ends_with_pages_open_and_twice(view: View, page: Page) -> None:
    page.frame()
    view.close()
    view.close()
    with pytest.raises(ValueError, match="closed"):
        view.update(np.zeros(320))


def test_an_error_of_painting_is_said_once_and_the_next_frame_comes(
    view: View, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    page.frame()
    real = view._comparison.hold
    monkeypatch.setattr(view._comparison, "hold", lambda *_: 1 / 0)
    for number in range(3):
        view.show(Snapshot(np.zeros((1, 320)), period=number))
    assert "division by zero" in page.notice()
    monkeypatch.setattr(view._comparison, "hold", real)
    view.show(Snapshot(np.zeros((1, 320)), period=7))
    page.until(lambda message: message["period"] == 7)
    assert len(page.notices) == 1


def test_many_notices_at_once_arrive_in_order(view: View, page: Page) -> None:
    page.frame()
    for number in range(50):
        view.say(str(number))
    while len(page.notices) < 50:
        page.receive()
    assert page.notices == [str(number) for number in range(50)]


@pytest.mark.parametrize("number", ["1" + 400 * "0", "-1" + 400 * "0", "1e999", "NaN", "Infinity"])
def test_a_number_beyond_all_bounds_is_refused_and_the_page_stays(view: View, page: Page, number: str) -> None:
    for name in ("xy_at", "at"):
        page.socket.send(f'{{"set": {{"{name}": {number}}}}}')
        assert name in page.notice()
    view.update(np.ones(320))
    page.until(lambda message: message.array("amplitude").all())


def test_a_calibrated_array_emits_what_its_transducers_do() -> None:
    """Half of them are reversed; pulses that are corrected for it make the focus all the same."""
    polarity = np.where(np.arange(320) % 2, -1, 1)
    calibration = Calibration(np.ones(320), np.zeros(320), polarity, np.zeros(320))
    focus = (0.02, 0.0, 0.17)
    drive = solve(ARRAY, ControlPoints([focus])).drive
    with (
        View(Emitter(ARRAY, calibration=calibration), settings=Settings(probe=focus)) as view,
        page_of(view.url) as other,
    ):
        view.update(calibration.apply(drive))
        frame = other.until(lambda message: message.array("amplitude").any())
        assert frame["probe"]["pascals"] == pytest.approx([abs(pressure(ARRAY, drive, [focus])[0])], rel=1e-3)
