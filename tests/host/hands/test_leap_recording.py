from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import lzstring
import numpy as np
import pytest
from phasewire.base.errors import InputFileError
from phasewire.host.hands import open_hands
from phasewire.host.hands.leap_recording import LeapRecording, read_leap_recording

from tests.host.hands.leap_service import leap_frame

FRAMES = [leap_frame(100 + 2 * n, 7e9 + 10_000 * n, {4: "right"} if n < 5 else {}, (n, 170, 0)) for n in range(8)]
METADATA = {"formatVersion": 1, "generatedBy": "a test", "protocolVersion": 6}
HAND_NAMES = ["id", "type", "direction", "palmPosition", "palmWidth"]
FINGER_NAMES = ["id", "direction", "handId", "tipPosition", "mcpPosition", "pipPosition", "dipPosition", "carpPosition"]
NAMES = [
    "id",
    "timestamp",
    {"hands": [HAND_NAMES]},
    {"pointables": [FINGER_NAMES]},
    {"interactionBox": ["center", "size"]},
]


def packed_rows(frames: list[dict[str, Any]]) -> list[Any]:
    """Frames as version 2 of the format has them: the names, then rows of values."""
    rows = [
        [
            frame["id"],
            frame["timestamp"],
            [[hand.get(name) for name in HAND_NAMES] for hand in frame["hands"]],
            [[finger.get(name) for name in FINGER_NAMES] for finger in frame["pointables"]],
            [[0, 200, 0], [235, 235, 147]],
        ]
        for frame in frames
    ]
    return [NAMES, *rows]


def written(folder: Path, frames: object, name: str = "wave.json") -> Path:
    text = json.dumps({"metadata": METADATA, "frames": frames})
    path = folder / name
    path.write_text(lzstring.LZString().compressToBase64(text) if name.endswith(".lz") else text)
    return path


def as_numbers(recording: LeapRecording) -> list[Any]:
    return [
        (frame.time, frame.number, [(hand.id, hand.hand.side, hand.hand.landmarks.tolist()) for hand in frame.hands])
        for frame in recording.frames
    ]


def test_frames_have_their_hands_and_times_from_zero(tmp_path: Path) -> None:
    recording = read_leap_recording(written(tmp_path, FRAMES))
    assert recording.rate == pytest.approx(100)
    assert [frame.number for frame in recording.frames] == list(range(100, 116, 2))
    np.testing.assert_allclose([frame.time for frame in recording.frames], np.arange(8) * 0.01)
    assert [len(frame.hands) for frame in recording.frames] == [1] * 5 + [0] * 3
    tips = [frame.hands[0].hand.landmarks[12] for frame in recording.frames[:5]]
    np.testing.assert_allclose(np.diff(tips, axis=0), [[1e-3, 0, 0]] * 4, atol=1e-12)


@pytest.mark.parametrize("name", ["wave.json.lz", "wave.JSON", "wave.LZ"])
@pytest.mark.parametrize("packed", [False, True])
def test_every_form_says_the_same(name: str, packed: bool, tmp_path: Path) -> None:
    expected = as_numbers(read_leap_recording(written(tmp_path, FRAMES)))
    path = written(tmp_path, packed_rows(FRAMES) if packed else FRAMES, name.lower())
    found = read_leap_recording(path.rename(tmp_path / name))
    assert as_numbers(found) == expected


def test_packed_values_may_be_missing(tmp_path: Path) -> None:
    rows = packed_rows(FRAMES)
    rows[1][4] = None
    assert len(read_leap_recording(written(tmp_path, rows)).frames[0].hands) == 1


def test_it_is_played_at_another_speed_and_again(tmp_path: Path) -> None:
    path = written(tmp_path, FRAMES[:2])
    with open_hands(f"leap:{path}?speed=2&loop=1") as source:
        assert source.rate == pytest.approx(200)
        frames = [next(source) for _ in range(4)]
    np.testing.assert_allclose([frame.time for frame in frames], [0, 0.005, 0.01, 0.015])
    for wrong in ("speed=0", "loop=yes", "sped=1"):
        with pytest.raises(ValueError, match="such a URL has the form leap:"):
            open_hands(f"leap:{path}?{wrong}")


def test_ids_and_times_that_jump_are_kept_in_order(tmp_path: Path) -> None:
    frames = [leap_frame(9, 5e6, {30: "right"}), leap_frame(3, 1e6, {31: "right"}), leap_frame(4, 5.5e6, {})]
    frames[1]["id"] = 2**64
    recording = read_leap_recording(written(tmp_path, frames))
    assert [(frame.time, frame.number) for frame in recording.frames] == [(0, 9), (0, 1), (0.5, 4)]
    assert [[hand.id for hand in frame.hands] for frame in recording.frames] == [[30], [31], []]


def test_a_hand_that_is_left_out_is_noted(tmp_path: Path) -> None:
    frame = leap_frame()
    frame["pointables"].pop()
    (found,) = read_leap_recording(written(tmp_path, [frame])).frames
    assert found.notes == ("hand 4 is left out: it has no little finger",)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (None, "there are no frames in it"),
        ([], "there are no frames in it"),
        ([NAMES], "there are no frames in it"),
        ({}, "there are no frames in it"),
        ([1], "frame 0: it is no object"),
        ([*FRAMES, {}], "frame 8: a frame has a list of pointables"),
        ([FRAMES[0] | {"timestamp": None}], "frame 0: its timestamp is None"),
        ([FRAMES[0], FRAMES[0] | {"timestamp": 1e300}], "frame 1: its timestamp is 1e"),
        ([FRAMES[0], FRAMES[0] | {"timestamp": float("nan")}], "frame 1: its timestamp is nan"),
        ([FRAMES[0] | {"timestamp": 10**400}, FRAMES[0]], "frame 0: "),
        ([["id"], [1, 2]], "have 2 values for 1 names"),
        ([["id"], 5], "a list is missing"),
        ([["id", {"hands": [["id"]]}], [1, 5]], "a list is missing"),
        ([["id", 5], [1, 5]], "its first row does not name"),
        ([["id", {"hands": 5}], [1, [5]]], "its first row does not name"),
        ([[[["id"]]], [[[1]]]], "frame 0: it is no object"),
    ],
)
def test_what_is_no_recording(frames: object, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, frames)
    start = re.escape(f"{path} is no usable recording of the Leap: ")
    with pytest.raises(InputFileError, match=f"^{start}.*{message}"):
        read_leap_recording(path)


@pytest.mark.parametrize("text", ["", "5", "[]", "hello", '{"frames": ', "[" * 100_000, "9" * 10_000, "\ufeff{}"])
def test_what_is_no_json_of_frames(text: str, tmp_path: Path) -> None:
    for name, said in (("a.json", text), ("a.json.lz", lzstring.LZString().compressToBase64(text))):
        (tmp_path / name).write_text(said)
        with pytest.raises(InputFileError, match="is no usable recording of the Leap"):
            read_leap_recording(tmp_path / name)


def test_names_that_are_nested_without_end(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"frames": [' + "[" * 900 + "]" * 900 + "," + "[" * 900 + "]" * 900 + "]}")
    with pytest.raises(InputFileError, match="is no usable recording of the Leap"):
        read_leap_recording(path)
