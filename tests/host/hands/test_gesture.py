from __future__ import annotations

import itertools

import numpy as np
import pytest
from phasewire.host.hands import HandFrame, open_hands
from phasewire.host.hands.gesture import GESTURES
from phasewire.solver.contact.anatomy import BONES, PARENTS

from tests.host.hands.clocks import Clock


def some(url: str, count: int) -> list[HandFrame]:
    with open_hands(f"gesture:{url}", Clock()) as source:
        return list(itertools.islice(source, count))


def landmarks(frames: list[HandFrame]) -> np.ndarray:
    return np.array([frame.hands[0].hand.landmarks for frame in frames])


@pytest.mark.parametrize("name", GESTURES)
def test_gestures_are_hands_of_natural_size_that_move_smoothly(name: str) -> None:
    """The speed, too, is continuous: halving the step halves its greatest change."""
    changes = []
    for rate in (250, 500):
        points = landmarks(some(f"{name}?rate={rate}", 4 * rate + 10))
        bones = np.linalg.norm(points[:, 1:] - points[:, PARENTS], axis=2)
        np.testing.assert_allclose(bones, np.broadcast_to(BONES, bones.shape), rtol=1e-6)
        speeds = np.diff(points, axis=0) * rate
        assert np.linalg.norm(speeds, axis=2).max() < 2
        changes.append(np.abs(np.diff(speeds, axis=0)).max())
    assert changes[1] < 0.6 * changes[0]
    assert np.ptp(points, axis=0).max() > 0.02


@pytest.mark.parametrize("name", GESTURES)
def test_gestures_are_the_same_each_time_and_mirrored_for_the_other_hand(name: str) -> None:
    first, second, left = (landmarks(some(f"{name}?{options}", 300)) for options in ("", "", "side=left"))
    np.testing.assert_array_equal(first, second)
    if name != "sweep":  # which goes from left to right with either hand
        np.testing.assert_allclose(left, first * [-1, 1, 1], atol=1e-12)
    assert some(f"{name}?side=left", 1)[0].hands[0].hand.side == "left"


def test_gestures_are_about_the_place() -> None:
    moved = landmarks(some("grasp?x=0.02&z=0.1", 10)) - landmarks(some("grasp", 10))
    np.testing.assert_allclose(moved, np.broadcast_to([0.02, 0, 0.1 - 0.17], moved.shape), atol=1e-12)


def test_what_gestures_do() -> None:
    heights = landmarks(some("approach?rate=100", 401))[:, 9, 2]
    assert (heights[0], heights[200], heights[400]) == pytest.approx((0.32, 0.12, 0.32))
    places = landmarks(some("sweep?rate=100", 401))[:, 9, 0] - landmarks(some("sweep", 1))[0, 9, 0]
    assert (places[200], places[400]) == pytest.approx((0.3, 0))
    tips = landmarks(some("tap?rate=100", 201))[:, 8]
    np.testing.assert_allclose(tips[:, :2], 0, atol=1e-12)
    assert tips[[0, 25, 50, 75, 100, 125], 2] == pytest.approx([0.23, 0.17, 0.23, 0.23, 0.23, 0.17])
    closed = landmarks(some("grasp?rate=100", 301))
    spans = np.linalg.norm(closed[:, 12] - closed[:, 0], axis=1)
    assert spans.argmin() == 150


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        ("wave", "there is no gesture 'wave'; there are approach, sweep, grasp, tap"),
        ("", "there is no gesture ''"),
        ("tap?rate=0", "option rate=0: it must be from 1 to 10000 frames per second"),
        ("tap?rate=nan", "from 1 to 10000"),
        ("tap?seconds=-1", "from 0 to 1e\\+06 seconds"),
        ("tap?x=170", "option x=170: it must be from -1 to 1 metres"),
        ("tap?side=up", "option side=up: it must be left or right"),
        ("tap?hand=up", "there is no option 'hand' here; such a URL has the form gesture:approach"),
    ],
)
def test_wrong_urls_are_named(rest: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        open_hands(f"gesture:{rest}")
