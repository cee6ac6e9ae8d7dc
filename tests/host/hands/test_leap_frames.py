from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.host.hands.leap_frames import hands_of
from phasewire.solver.contact.hand import Hand

from tests.host.hands.leap_service import FLAT, KNUCKLES, leap_frame, outcome

Said = dict[str, Any]


def only_hand(said: Said) -> Hand:
    hands, notes = hands_of(said)
    assert notes == ()
    assert len(hands) == 1
    return hands[0].hand


def test_joints_become_landmarks_in_metres_by_the_arrays_axes() -> None:
    hand = only_hand(leap_frame(palm=(10, 170, -30)))
    assert hand.side == "right"
    for finger, joints in FLAT.items():
        for number, (x, y, z) in enumerate(joints):
            expected = np.array([x + 10, -(z - 30), y + 170]) * 1e-3
            np.testing.assert_allclose(hand.landmarks[1 + 4 * finger + number], expected, atol=1e-12)


def test_a_missing_wrist_is_placed_behind_the_knuckles_by_the_size_of_the_hand() -> None:
    """Newer services say both: the wrist is 1.47 widths of the knuckles behind their middle."""
    said = leap_frame(palm=(0, 170, 0))
    expected = np.array([0, -(-20 + 1.47 * KNUCKLES), 170]) * 1e-3
    np.testing.assert_allclose(only_hand(said).landmarks[0], expected, atol=1e-9)
    said["hands"][0]["direction"] = [0, 0, -7]  # a direction has no length
    np.testing.assert_allclose(only_hand(said).landmarks[0], expected, atol=1e-9)
    del said["hands"][0]["direction"]
    np.testing.assert_allclose(only_hand(said).landmarks[0], expected, atol=1e-9)
    said["hands"][0]["wrist"] = [1, 2, 3]
    np.testing.assert_allclose(only_hand(said).landmarks[0], [1e-3, -3e-3, 2e-3])


def test_fingers_of_packed_recordings_are_identified_by_their_ids() -> None:
    said = leap_frame(hands={87: "left"})
    expected = only_hand(said).landmarks
    for finger in said["pointables"]:
        del finger["type"]
    said["pointables"].reverse()
    np.testing.assert_array_equal(only_hand(said).landmarks, expected)


def test_a_type_counts_more_than_an_id() -> None:
    said = leap_frame()
    expected = only_hand(said).landmarks
    for finger, number in zip(said["pointables"], (42, 43, 41, 40, 44), strict=True):
        finger["id"] = number
    np.testing.assert_array_equal(only_hand(said).landmarks, expected)


def test_tools_and_fingers_of_hands_that_are_gone_are_passed_over() -> None:
    said = leap_frame()
    tool = said["pointables"][1] | {"tool": True, "mcpPosition": None}
    said["pointables"] += [tool, {"id": 990, "handId": 99, "type": 0}, {"id": 3}, {"handId": [], "id": 4, "type": 1}]
    only_hand(said)


def test_fingers_are_as_wide_as_the_service_says() -> None:
    said = leap_frame()
    np.testing.assert_allclose(only_hand(said).widths, 0.018)
    usual = Hand(only_hand(said).landmarks).widths
    for wrong in (None, "18", 0, 41, float("nan")):
        said["pointables"][3]["width"] = wrong
        np.testing.assert_array_equal(only_hand(said).widths, usual)


def scaled(said: Said, factor: float) -> None:
    for finger in said["pointables"]:
        finger |= {name: [factor * x for x in finger[name]] for name in finger if name.endswith("Position")}


def set_joint(value: object) -> Callable[[Said], object]:
    return lambda said: said["pointables"][7].update(pipPosition=value)


BAD: dict[str, tuple[Callable[[Said], object], str]] = {
    "metres": (lambda said: scaled(said, 1e-3), "0.066 mm wide.*; its tracker seems to give metres instead of milli"),
    "centimetres": (lambda said: scaled(said, 0.1), r"its knuckles are 6.6 mm wide, not 30 to 130 mm$"),
    "a giant": (lambda said: scaled(said, 3), "its knuckles are 198 mm wide"),
    "far away": (lambda said: said["pointables"][7].update(tipPosition=[0, -6000, 0]), "it is 6e.03 mm away"),
    "a far wrist": (lambda said: said["hands"][1].update(wrist=[0, 0, 1e300]), "it is 1e.300 mm away"),
    "no wrist": (lambda said: said["hands"][1].update(wrist=[0, 0]), "its wrist are not all places"),
    "no side": (lambda said: said["hands"][1].pop("type"), "it is neither left nor right"),
    "a finger less": (lambda said: said["pointables"].pop(6), "it has no index finger"),
    "two less": (lambda said: said.update(pointables=said["pointables"][:8]), "it has no ring and no little finger"),
    "no direction": (lambda said: said["hands"][1].update(direction=[0, 0, 0]), "its direction is none"),
    "no palm": (lambda said: said["hands"][1].update(direction=None, palmPosition=None), "its palm are not all places"),
    "two of one id": (lambda said: said["hands"].append(said["hands"][0]), "its id is no whole number, or that of"),
    "an id of text": (lambda said: said["hands"][1].update(id="9"), "hand 9 is left out: its id is no whole number"),
    "an id without measure": (
        lambda said: said["hands"][1].update(id=2**63),
        "hand 9223372036854775808 is left out: its",
    ),
    "no id": (lambda said: said["hands"][1].pop("id"), "hand None is left out: its id is no whole number"),
    "NaN": (set_joint([0, float("nan"), 0]), "are not all places of three coordinates"),
    "an infinity": (set_joint([0, 0, float("inf")]), "are not all places of three coordinates"),
    "too many digits": (set_joint([0, 0, 10**400]), "are not all places of three coordinates"),
    "null": (set_joint(None), "are not all places of three coordinates"),
    "a plane": (set_joint([0, 0]), "are not all places of three coordinates"),
    "text": (set_joint("a place"), "are not all places of three coordinates"),
    "a table": (set_joint([[0], [0], [0]]), "are not all places of three coordinates"),
}


@pytest.mark.parametrize(("spoil", "message"), BAD.values(), ids=BAD)
def test_a_hand_that_cannot_be_used_is_left_out_and_the_others_are_kept(
    spoil: Callable[[Said], object], message: str
) -> None:
    said = leap_frame(hands={4: "right", 5: "left"})
    spoil(said)
    hands, notes = hands_of(said)
    assert [hand.id for hand in hands] in ([4], [4, 5], [])
    assert notes
    for note in notes:
        with pytest.raises(ValueError, match=message):
            raise ValueError(note)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({}, "has a list of pointables, and this has none"),
        ({"pointables": []}, "has a list of hands, and this has none"),
        ({"pointables": {}, "hands": []}, "has a list of pointables"),
        ({"pointables": [], "hands": [1]}, "has a list of hands"),
        ({"pointables": [], "hands": [{}] * 17}, "may have 16 hands, and this has 17"),
        ({"pointables": [{}] * 81, "hands": []}, "may have 80 pointables, and this has 81"),
    ],
)
def test_what_is_no_frame(said: Said, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        hands_of(said)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=4,
)
PLACES = [("hands", 0, name) for name in leap_frame()["hands"][0]]
PLACES += [("pointables", 3, name) for name in leap_frame()["pointables"][0]]


@given(
    st.lists(st.tuples(st.sampled_from(PLACES), VALUES), max_size=3), VALUES, st.sampled_from(["hands", "pointables"])
)
def test_whatever_a_frame_says_its_hands_are_finite(
    spoilt: list[tuple[tuple[str, int, str], object]], value: object, name: str
) -> None:
    said = json.loads(json.dumps(leap_frame()))
    for (group, place, key), wrong in spoilt:
        said[group][place][key] = wrong
    hands, notes = hands_of(said)
    assert len(hands) == 1 or "is left out" in notes[0]
    assert all(np.isfinite(hand.hand.landmarks).all() for hand in hands)
    said[name] = value
    refusal = outcome(lambda: hands_of(said))
    assert not isinstance(refusal, ValueError) or name in str(refusal)
