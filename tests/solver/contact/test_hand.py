from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire.solver.contact.anatomy import BONES, LENGTH, PARENTS, WIDTHS
from phasewire.solver.contact.hand import Hand, Side
from phasewire.solver.contact.hand_quads import STIFFNESS, WRIST, hand_quads
from scipy.spatial.transform import Rotation

SIDES: list[Side] = ["left", "right"]


@st.composite
def hands(draw: st.DrawFn) -> Hand:
    """Hands of any pose and size, whose landmarks are as inexact as a camera's."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    side = draw(st.sampled_from(SIDES))
    length, curl = draw(st.floats(0.08, 0.25)), draw(st.floats(0, 1))
    hand = Hand.flat((0, 0, 0), side, length, curl)
    landmarks = hand.landmarks + rng.normal(0, 0.02 * length, (21, 3))
    turned = Rotation.random(random_state=rng).apply(landmarks) + rng.uniform(-0.3, 0.3, 3)
    return Hand.repaired(turned, side)[0]


def unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)


def literal_quads(hand: Hand) -> NDArray[np.float64]:
    """`hand_quads` in terms of linear algebra."""
    points, sign = hand.landmarks, 1 if hand.side == "right" else -1
    along = unit(points[[5, 9, 13, 17]].mean(axis=0) - points[0])
    knuckles = sign * (points[17] - points[5])
    across = unit(knuckles - knuckles @ along * along)
    back = np.cross(across, along)
    left, right = (1, 4)[::sign]
    left_knuckle, right_knuckle = ((points[1 + 4 * finger] - points[0]) for finger in (left, right))
    left_x = left_knuckle @ across - hand.widths[left] / 2
    right_x = right_knuckle @ across + hand.widths[right] / 2
    wrist = WRIST / 2 * (right_x - left_x)
    flat = [(-wrist, 0), (wrist, 0), (right_x, right_knuckle @ along), (left_x, left_knuckle @ along)]
    quads = [[points[0] + x * across + y * along for x, y in flat]]
    for finger in range(5):
        joints = points[1 + 4 * finger : 5 + 4 * finger]
        bones = [unit(bone) for bone in np.diff(joints, axis=0)]
        rest = across
        if finger == 0:
            rest = np.cos(np.deg2rad(81)) * across + sign * np.sin(np.deg2rad(81)) * back
        turn = Rotation.align_vectors([bones[0]], [along])[0].as_matrix()
        matrix = sum(np.outer(bone, bone) for bone in bones) + STIFFNESS * np.eye(3)
        half = hand.widths[finger] / 2 * unit(np.linalg.solve(matrix, turn @ rest))
        quads += [[a - half, a + half, b + half, b - half] for a, b in pairwise(joints)]
    return np.array(quads)


def areas(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vector areas of quadrilaterals."""
    return np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]) / 2


# Quadrilaterals


@given(hand=hands())
def test_compiled_quads_are_those_of_linear_algebra(hand: Hand) -> None:
    np.testing.assert_allclose(hand.quads, literal_quads(hand), rtol=0, atol=1e-8)


@given(hand=hands())
def test_quads_of_a_finger_share_their_borders_bit_by_bit(hand: Hand) -> None:
    for finger in hand.quads[1:].reshape(5, 3, 4, 3):
        np.testing.assert_array_equal(finger[:-1, [3, 2]], finger[1:, [0, 1]])


@given(hand=hands(), seed=st.integers(0, 2**32 - 1))
def test_a_small_change_of_the_landmarks_is_a_small_change_of_the_quads(hand: Hand, seed: int) -> None:
    change = np.random.default_rng(seed).uniform(-1, 1, (21, 3)) * 1e-9
    changed = hand_quads(hand.landmarks + change, hand.widths, 1.0 if hand.side == "right" else -1.0)
    assert np.abs(changed - hand.quads).max() < 50e-9  # 1.5e-9 in most cases


@pytest.mark.parametrize("side", SIDES)
def test_the_back_of_a_flat_hand_is_up_and_its_fingers_are_level(side: Side) -> None:
    """Counterclockwise as seen on the back; a thumb's nail looks to the side and a little up."""
    normals = [unit(area) for area in areas(Hand.flat(side=side).quads)]
    for normal in (normals[0], *normals[4:]):
        np.testing.assert_allclose(normal, [0, 0, 1], atol=1e-12)
    for normal in normals[1:4]:
        assert normal[2] == pytest.approx(np.cos(np.deg2rad(81)), abs=0.01)
        assert normal[0] * (1 if side == "right" else -1) < -0.5


def test_the_palm_reaches_beyond_the_outer_knuckles_and_is_narrower_at_the_wrist() -> None:
    hand = Hand.flat((0, 0, 0))
    base_left, base_right, tip_right, tip_left = hand.quads[0]
    assert tip_left == pytest.approx(hand.landmarks[5], abs=0.6 * hand.widths[1])
    assert tip_right == pytest.approx(hand.landmarks[17], abs=0.6 * hand.widths[4])
    assert np.linalg.norm(tip_right - tip_left) == pytest.approx(0.085, abs=0.0005)  # ANSUR II
    assert np.linalg.norm(base_right - base_left) == pytest.approx(0.0619, rel=0.02)  # Greiner, in proportion
    np.testing.assert_allclose((base_left + base_right) / 2, hand.landmarks[0], atol=1e-12)


def test_a_finger_that_points_straight_back_has_quads() -> None:
    """Opposite to the palm's axis to the last bit: no turn from one to the other is then the least."""
    landmarks = Hand.flat().landmarks.copy()
    landmarks[:, 0] -= landmarks[0, 0]
    landmarks[0] = 0
    landmarks[[5, 9, 13, 17]] = [[-0.03, 0.09, 0], [-0.01, 0.09, 0], [0.01, 0.09, 0], [0.03, 0.09, 0]]
    for knuckle in (5, 9, 13, 17):
        landmarks[knuckle + 1 : knuckle + 4] = landmarks[knuckle] - np.outer([1, 2, 3], [0, 0.03, 0])
    quads = Hand.repaired(landmarks)[0].quads
    assert np.linalg.norm(areas(quads), axis=1).min() > 1e-5
    np.testing.assert_allclose(
        quads[4:, 1] - quads[4:, 0], [[width, 0, 0] for width in np.repeat(Hand(landmarks).widths[1:], 3)], atol=1e-12
    )


# Sizes


def test_the_mean_hand_has_the_published_size() -> None:
    hand = Hand.flat()
    assert np.linalg.norm(hand.landmarks[12] - hand.landmarks[0]) == pytest.approx(LENGTH, rel=0.005)
    bones = np.linalg.norm(hand.landmarks[1:] - hand.landmarks[PARENTS], axis=1)
    np.testing.assert_allclose(bones, BONES, rtol=1e-9)
    np.testing.assert_allclose(bones[[5, 6, 7]] * 1e3, [39.78, 22.38, 15.82 + 3.84], rtol=1e-9)
    np.testing.assert_allclose(hand.widths, WIDTHS, rtol=1e-9)
    np.testing.assert_allclose(hand.centre, [0, 0, 0.17], atol=1e-12)


def test_widths_grow_with_the_hand_and_can_be_given() -> None:
    np.testing.assert_allclose(Hand.flat(length=LENGTH / 2).widths, WIDTHS / 2, rtol=1e-9)
    np.testing.assert_allclose(Hand.flat(curl=1).widths, WIDTHS, rtol=1e-9)
    widths = [0.02, 0.01, 0.012, 0.013, 0.014]
    hand = Hand(Hand.flat().landmarks, widths=widths)
    quads = hand.quads[1:].reshape(5, 3, 4, 3)
    np.testing.assert_allclose(np.linalg.norm(quads[:, 1, 1] - quads[:, 1, 0], axis=1), widths, rtol=1e-9)
    np.testing.assert_array_equal(hand.moved([0.1, 0, 0]).widths, widths)


@given(hand=hands(), degrees=st.floats(-360, 360))
def test_moved_and_rotated_hands_are_the_same_hand(hand: Hand, degrees: float) -> None:
    moved = hand.moved([0.01, -0.02, 0.03])
    np.testing.assert_allclose(moved.landmarks - hand.landmarks, [[0.01, -0.02, 0.03]] * 21, atol=1e-12)
    turned = hand.rotated(degrees, (1, 2, 3))
    np.testing.assert_allclose(turned.centre, hand.centre, atol=1e-9)
    axis = np.array([1, 2, 3]) / np.sqrt(14)
    wanted = Rotation.from_rotvec(np.deg2rad(degrees) * axis).apply(hand.landmarks - hand.centre) + hand.centre
    np.testing.assert_allclose(turned.landmarks, wanted, atol=1e-9)
    assert turned.side == moved.side == hand.side


# Impossible hands


def around_the_wrist() -> NDArray[np.float64]:
    """Knuckles on all sides of the wrist: the palm has breadth and size, but no length."""
    landmarks = Hand.flat((0, 0, 0)).landmarks.copy()
    landmarks[[5, 9, 13, 17]] = landmarks[0] + 0.09 * np.array([[-1, 0, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0]])
    return landmarks


def bent(landmark: int, *values: float) -> NDArray[np.float64]:
    landmarks = Hand.flat().landmarks.copy()
    landmarks[landmark] = values
    return landmarks


@pytest.mark.parametrize(
    ("landmarks", "message"),
    [
        (np.zeros((20, 3)), "a hand has 21 landmarks, not 20"),
        (np.zeros((21, 2)), r"must have the shape \(m, 3\).*not \(21, 2\)"),
        ("palm", "must be numbers: they are text"),
        (bent(8, 0, np.inf, 0), "landmark 8 is .*finite"),
        (bent(8, 0, 1e9, 0), "landmark 8 is .*coordinates are metres"),
        (np.zeros((21, 3)), "the palm is 0 m long, .*it must be from 0.028 to 0.19 m$"),
        (
            Hand.flat((0, 0, 0.2)).landmarks * 1000,
            "landmark 0 is .*; coordinates are metres, at most 10: 150 mm is 0.15",
        ),
        (Hand.flat().landmarks * 12, r"the palm is 1.1\d m long.*0.19 m$"),
        (Hand.flat().landmarks * [0, 1, 0], "the palm has no breadth: landmarks 5 and 17 are 0.0 mm apart across it"),
        (around_the_wrist(), "the palm has no length: its knuckles are on all sides of landmark 0"),
        (
            bent(8, -0.04, 0.2, 0.6),
            r"the index finger's bone from landmark 7 to 8 is 4\d\d.\d mm long; in .* it has 3.9 to 59.0",
        ),
        (bent(11, *Hand.flat().landmarks[10]), "the middle finger's bone from landmark 10 to 11 is 0.0 mm long"),
    ],
)
def test_impossible_hands_are_refused(landmarks: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Hand(landmarks)  # type: ignore[arg-type]  # that is what is tested


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"side": "Right"}, "'left' or 'right', not 'Right'"),
        ({"widths": [0.02] * 4}, "5 numbers"),
        ({"widths": "broad"}, "widths must be numbers: they are text"),
        ({"widths": [0.02] * 4 + [0]}, "above 0"),
        ({"widths": [0.02] * 4 + [np.nan]}, "above 0"),
        ({"widths": [20] * 5}, "up to 0.1 m"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Hand(Hand.flat().landmarks, **arguments)  # type: ignore[arg-type]  # that is what is tested


@pytest.mark.parametrize("curl", [-0.1, 1.1, np.nan, [0.5] * 4, [0.5] * 4 + [2]])
def test_a_curl_is_from_0_to_1(curl: float | list[float]) -> None:
    with pytest.raises(ValueError, match="must be one number or 5, from 0, straight, to 1"):
        Hand.flat(curl=curl)


def test_each_finger_bends_by_itself() -> None:
    straight, fist = Hand.flat(), Hand.flat(curl=1)
    pointing = Hand.flat(curl=[1, 0, 1, 1, 1])
    np.testing.assert_array_equal(pointing.landmarks[5:9], straight.landmarks[5:9])
    np.testing.assert_array_equal(pointing.landmarks[9:], fist.landmarks[9:])


def test_a_finger_without_length_is_repaired_with_a_note() -> None:
    landmarks = Hand.flat().landmarks.copy()
    landmarks[6:9] = landmarks[5]
    hand, notes = Hand.repaired(landmarks)
    assert [note.split(" mm long")[0] for note in notes] == [
        f"the index finger's bone from landmark {a} to {a + 1} is 0.0" for a in (5, 6, 7)
    ]
    assert all(note.endswith("it was repaired") for note in notes)
    finger = hand.landmarks[5:9]
    assert (np.linalg.norm(np.diff(finger, axis=0), axis=1) > 0.002).all()
    np.testing.assert_array_equal(np.delete(hand.landmarks, [6, 7, 8], axis=0), np.delete(landmarks, [6, 7, 8], axis=0))


def test_a_bone_of_half_a_metre_is_repaired_and_keeps_its_direction() -> None:
    landmarks = Hand.flat().landmarks.copy()
    landmarks[7:9] += [0, 0.5, 0.5]
    hand, notes = Hand.repaired(landmarks)
    assert len(notes) == 1
    np.testing.assert_allclose(unit(hand.landmarks[7] - hand.landmarks[6]), unit(landmarks[7] - landmarks[6]))
    np.testing.assert_allclose(hand.landmarks[8] - hand.landmarks[7], landmarks[8] - landmarks[7], atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1), side=st.sampled_from(SIDES))
def test_any_hand_with_a_palm_is_repaired(seed: int, side: Side) -> None:
    rng = np.random.default_rng(seed)
    landmarks = Hand.flat(side=side).landmarks.copy()
    wrong = rng.choice([1, 2, 3, 4, 6, 7, 8, 10, 11, 12, 14, 15, 16, 18, 19, 20], rng.integers(0, 10), replace=False)
    landmarks[wrong] = landmarks[rng.choice([0, 1, 5, 9, 12], len(wrong))] + rng.choice([0, 1]) * rng.normal(
        0, 0.3, (len(wrong), 3)
    )
    hand, notes = Hand.repaired(landmarks, side)
    assert np.isfinite(hand.quads).all()
    if not len(wrong):
        assert notes == ()


@pytest.mark.parametrize("side", SIDES)
def test_a_hand_with_the_wrong_label_is_taken_for_the_other(side: Side) -> None:
    other: Side = "left" if side == "right" else "right"
    bent = Hand.flat(side=side, curl=0.6)
    hand, notes = Hand.repaired(bent.landmarks, other)
    assert hand.side == side
    assert notes == (f"the {other} hand's fingers bend to its back; it was taken for the other hand",)
    for curl in (0, 0.1, 0.6, 1):  # straight fingers do not tell
        bent = Hand.flat(side=side, curl=curl)
        assert Hand.repaired(bent.landmarks, side)[1] == ()
    assert Hand.repaired(Hand.flat(side=side).landmarks, other)[0].side == other


def test_a_thumb_that_begins_at_the_wrist_is_valid() -> None:
    landmarks = Hand.flat().landmarks.copy()
    landmarks[1] = landmarks[0]
    assert Hand.repaired(landmarks)[1] == ()
    landmarks[2:5] = landmarks[0]
    assert np.isfinite(Hand.repaired(landmarks)[0].quads).all()
