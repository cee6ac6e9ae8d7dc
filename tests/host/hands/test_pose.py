from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import InputFileError
from phasewire.host.hands import HandFrame, TrackedHand
from phasewire.host.hands.pose import Pose
from phasewire.solver.contact.hand import Hand
from scipy.spatial.transform import Rotation

LYING = """\
translation_mm = [0, 121, 30]
rotation = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
scale = 1.02
"""


def load(text: str, path: Path) -> Pose:
    path.write_text(text)
    return Pose.load(path)


def test_a_pose_takes_hands_from_the_tracker_to_the_array(tmp_path: Path) -> None:
    pose = load(LYING, tmp_path / "pose.toml")
    hand = Hand.flat((0.01, 0.2, 0.03), "left")
    frame = pose.apply(HandFrame(3.0, (TrackedHand(hand, 5),), 7, ("note",)))
    assert (frame.time, frame.number, frame.notes, frame.hands[0].id) == (3.0, 7, ("note",), 5)
    moved = frame.hands[0].hand
    assert moved.side == "left"
    x, y, z = hand.landmarks.T * 1.02
    np.testing.assert_allclose(moved.landmarks, np.stack([x, 0.121 - z, 0.03 + y], axis=1))
    np.testing.assert_allclose(moved.widths, hand.widths * 1.02)


def test_a_hand_that_a_pose_makes_impossible_is_left_out_with_a_note() -> None:
    giant, usual = TrackedHand(Hand.flat(length=0.3), 5), TrackedHand(Hand.flat(side="left"), 6)
    frame = Pose(np.eye(3), np.zeros(3), 2.0).apply(HandFrame(0.0, (giant, usual), notes=("note",)))
    assert [each.id for each in frame.hands] == [6]
    assert frame.notes[0] == "note"
    assert frame.notes[1].startswith("the right hand 5 was left out after its pose was applied: the palm is 0.29")


@given(angles=st.tuples(*[st.floats(-180, 180)] * 3))
def test_degrees_turn_about_x_then_y_then_z_of_the_array(angles: tuple[float, float, float]) -> None:
    pose = Pose.from_table({"rotation_degrees": list(angles)})
    np.testing.assert_allclose(pose.rotation, Rotation.from_euler("xyz", angles, degrees=True).as_matrix(), atol=1e-9)


def test_a_rotation_of_three_digits_becomes_exact(tmp_path: Path) -> None:
    pose = load("rotation = [[0.866, -0.5, 0], [0.5, 0.866, 0], [0, 0, 1]]", tmp_path / "pose.toml")
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(pose.rotation, Rotation.from_euler("z", 30, degrees=True).as_matrix(), atol=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("translate = [0, 0, 0]", "there is no field 'translate'; the fields are translation_m, translation_mm"),
        ("translation_m = [0, 0]", r"translation_m is \[0, 0\]; it must be three finite numbers"),
        ("translation_mm = [0, 0, nan]", "translation_mm is .*; it must be three finite numbers"),
        ('translation_m = ["0", "0", "0"]', "it must be three finite numbers"),
        ("translation_m = [[0, 0], [0]]", "it must be three finite numbers"),
        ("translation_m = [0, 2e9, 0]", "translation .* must be three numbers of metres, at most 10 each"),
        ("translation_m = [0,0,0]\ntranslation_mm = [0,0,0]", "translation_m and translation_mm exclude each other"),
        ("rotation_degrees = [0,0,0]\nrotation = [[1,0,0],[0,1,0],[0,0,1]]", "rotation_degrees exclude each other"),
        ("rotation = 90", "rotation is 90; it must be three rows of three finite numbers"),
        ("rotation = [[1,0,0],[0,1,0],[0,0,1.1]]", "must have three perpendicular rows of length 1"),
        ("rotation = [[1,0,0],[0,1,0],[0,0,-1]]", "is a reflection: a left hand would become a right one"),
        ("rotation_degrees = [0, 0, inf]", "rotation_degrees is .*; it must be three finite numbers"),
        ("scale = 0.001", "scale 0.001 must be from 0.5 to 2"),
        ("scale = [1]", r"scale is \[1\]; it must be a finite number"),
        ("scale = true", "scale is True; it must be a finite number"),
        ("scale", "is no TOML file"),
    ],
)
def test_wrong_fields_are_named(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "pose.toml"
    path.write_text(text)
    with pytest.raises(InputFileError, match=rf"^{path}.*{message}"):
        Pose.load(path)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 20))
def test_a_pose_is_found_from_points(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    seen = rng.uniform(-0.2, 0.2, (count, 3))
    wanted = Pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3))
    true = seen @ wanted.rotation.T + wanted.translation
    found, missed = Pose.estimate(seen, true)
    np.testing.assert_allclose(found.rotation, wanted.rotation, atol=1e-6)
    np.testing.assert_allclose(found.translation, wanted.translation, atol=1e-6)
    assert missed < 1e-9


def test_an_inexact_pose_says_how_inexact() -> None:
    rng = np.random.default_rng(16)
    seen = rng.uniform(-0.2, 0.2, (400, 3))
    found, missed = Pose.estimate(seen, seen + rng.normal(0, 1e-3, seen.shape))
    assert missed == pytest.approx(np.sqrt(3) * 1e-3, rel=0.1)
    np.testing.assert_allclose(found.rotation, np.eye(3), atol=1e-3)


@pytest.mark.parametrize(
    ("seen", "true", "message"),
    [
        (np.eye(3)[:2], np.eye(3)[:2], "both must be 3 or more"),
        (np.eye(3), np.eye(3)[:2], "3 points were seen, 2 are given"),
        (np.outer(range(4), [1, 2, 3]), np.outer(range(4), [1, 2, 3]), "the points are in a line"),
        (np.zeros((4, 3)), np.zeros((4, 3)), "the points are in a line"),
    ],
)
def test_points_that_tell_no_pose_are_refused(seen: np.ndarray, true: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Pose.estimate(seen, true)
