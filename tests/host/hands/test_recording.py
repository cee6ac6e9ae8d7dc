from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import InputFileError
from phasewire.host.hands import HandFrame, TrackedHand, open_hands
from phasewire.host.hands.pose import Pose
from phasewire.host.hands.recording import MOST_LINE_BYTES, HandRecorder, HandRecording
from phasewire.solver.contact.hand import Hand

from tests.host.hands.clocks import Clock

FRAMES = [
    HandFrame(5.0, (), 10),
    HandFrame(5.01, (TrackedHand(Hand.flat(), 7),), 11),
    HandFrame(
        5.03, (TrackedHand(Hand.flat((0.1, 0, 0.2), "left"), 7), TrackedHand(Hand.flat(curl=0.5), 8)), 13, ("a",)
    ),
]


def write(path: Path, frames: list[HandFrame] = FRAMES, pose: Pose | None = None) -> Path:
    with HandRecorder(path, 100, "three", pose) as recorder:
        for frame in frames:
            recorder.write(frame)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write(tmp_path_factory.mktemp("whole") / "a.hands").read_bytes()


def changed(whole: bytes, line: int, change: Callable[[dict[str, Any]], object]) -> bytes:
    """A recording one of whose lines, the head being the first, says something else."""
    lines = whole.splitlines()
    record = json.loads(lines[line - 1])
    change(record)
    lines[line - 1] = json.dumps(record).encode()
    return b"\n".join(lines) + b"\n"


# Writing and reading


def test_what_is_recorded_is_read_again(tmp_path: Path) -> None:
    pose = Pose(np.eye(3), np.array([0, 0.1, 0.2]), 1.1)
    with HandRecording.open(write(tmp_path / "a.hands", pose=pose)) as recording:
        assert (recording.rate, recording.source, recording.complete) == (100, "three", True)
        assert recording.pose is not None
        assert recording.pose.to_table() == pose.to_table()
        for _ in range(2):
            found = list(recording)
            assert [(frame.number, frame.notes) for frame in found] == [(10, ()), (11, ()), (13, ("a",))]
            assert [frame.time for frame in found] == pytest.approx([0, 0.01, 0.03])
            for frame, wanted in zip(found, FRAMES, strict=True):
                assert [(hand.id, hand.hand.side) for hand in frame.hands] == [
                    (hand.id, hand.hand.side) for hand in wanted.hands
                ]
                for ours, theirs in zip(frame.hands, wanted.hands, strict=True):
                    np.testing.assert_allclose(ours.hand.landmarks, theirs.hand.landmarks, rtol=0, atol=0.51e-6)
                    np.testing.assert_allclose(ours.hand.widths, theirs.hand.widths, rtol=0, atol=0.51e-6)


def test_other_programs_may_write_millimetres_and_leave_out_what_they_do_not_know(tmp_path: Path) -> None:
    path = tmp_path / "theirs.hands"
    hand = {"id": 1, "side": "right", "landmarks": (Hand.flat().landmarks * 1000).tolist()}
    head = {"format": "phasewire-hands-1", "units": "mm", "rate_hz": 60}
    path.write_text("\n".join(map(json.dumps, (head, {"time": 0, "hands": [hand]}, {"frames": 1}))) + "\n")
    with HandRecording.open(path) as recording:
        (frame,) = recording
        assert (recording.complete, recording.source, recording.pose, frame.number) == (True, "", None, 0)
        np.testing.assert_allclose(frame.hands[0].hand.landmarks, Hand.flat().landmarks)


def test_a_clock_that_is_set_back_makes_no_recording_that_cannot_be_read(tmp_path: Path) -> None:
    with HandRecording.open(write(tmp_path / "a.hands", [HandFrame(3.0), HandFrame(4.0), HandFrame(2.0)])) as recording:
        assert [frame.time for frame in recording] == [0, 1, 1]


def test_a_recording_that_is_interrupted_is_whole(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), HandRecorder(tmp_path / "a.hands", 100) as recorder:  # noqa: PT012 that is the test
        recorder.write(FRAMES[1])
        raise KeyboardInterrupt
    with HandRecording.open(tmp_path / "a.hands") as recording:
        assert recording.complete
        assert len(list(recording)) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["a.hands"]


# Playing


def test_a_recording_is_played_at_its_own_speed_or_another_one(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hands")
    for speed in (1.0, 0.5, 4.0):
        clock = Clock()
        with open_hands(f"recording:{path}?speed={speed}", clock) as source:
            assert (source.rate, source.live, source.notes) == (100 * speed, False, ())
            times = [source.next_frame(1) for _ in range(3)]
            assert [frame.time - 1000 for frame in times if frame is not None] == pytest.approx(
                [0, 0.01 / speed, 0.03 / speed]
            )
            assert source.next_frame(1) is None
            assert source.ended


def test_a_loop_goes_on_with_times_and_numbers(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hands")
    with open_hands(f"recording:{path}?loop=1", Clock()) as source:
        found = [next(source) for _ in range(7)]
    assert [frame.time for frame in found] == pytest.approx([0, 0.01, 0.03, 0.04, 0.05, 0.07, 0.08])
    assert [frame.number for frame in found] == [10, 11, 13, 24, 25, 27, 38]


def test_an_empty_recording_ends_even_in_a_loop(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hands", [])
    with open_hands(f"recording:{path}?loop=1", Clock()) as source:
        assert list(source) == []


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        ("", "no file is named; such a URL has the form recording:FILE"),
        ("a.hands?speed=0", "option speed=0: it must be from 0.01 to 100"),
        ("a.hands?speed=nan", "from 0.01 to 100"),
        ("a.hands?loop=yes", "it must be 0 or 1"),
        ("a.hands?lop=1", "there is no option 'lop'"),
    ],
)
def test_wrong_urls_are_named(rest: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        open_hands(f"recording:{rest}")


# Damage


def test_a_recording_cut_at_any_byte_plays_to_its_last_whole_line_or_is_refused(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.hands"
    head = whole.index(b"\n") + 1
    ends = [place + 1 for place, byte in enumerate(whole) if byte == ord("\n")]
    for cut in sorted({*range(0, len(whole), 97), *ends, *(end - 1 for end in ends), *(end + 1 for end in ends[:-1])}):
        path.write_bytes(whole[:cut])
        if cut < head:
            with pytest.raises(InputFileError, match="is no recording of hands"):
                open_hands(f"recording:{path}")
            continue
        with open_hands(f"recording:{path}", Clock()) as source:
            frames = list(source)
        lines = whole[:cut].count(b"\n")
        assert len(frames) == min(lines - 1, 3)
        wanted = () if cut == len(whole) else (f"{path} was cut off; it plays up to its last whole line",)
        assert source.notes == wanted


HAND = json.dumps({"id": 1, "side": "left", "landmarks": Hand.flat(side="left").landmarks.tolist()})


@pytest.mark.parametrize(
    ("line", "change", "message"),
    [
        (1, lambda head: head.update(format="phasewire-hands-2"), "is no recording of hands"),
        (1, lambda head: head.update(units="inch"), r"line 1: units is 'inch'; it must be one of m, mm"),
        (1, lambda head: head.update(rate_hz=0), "line 1: rate_hz is 0; it must be above 0"),
        (1, lambda head: head.update(rate_hz="fast"), 'line 1: rate_hz is "fast"; it must be a finite number'),
        (1, lambda head: head.pop("rate_hz"), "line 1: rate_hz is null; it must be a finite number"),
        (1, lambda head: head.update(source=5), "line 1: source is 5; it must be a text"),
        (1, lambda head: head.update(pose=[1]), "line 1: pose is no table"),
        (1, lambda head: head.update(pose={"scale": 9}), "line 1: scale 9.0 must be from 0.5 to 2"),
        (2, lambda frame: frame.update(time=True), "line 2: time is true; it must be a finite number"),
        (2, lambda frame: frame.update(time=1e300), "line 2: time is 1e\\+300; it must be a finite number"),
        (2, lambda frame: frame.update(time=1e10), "line 2: time is 1e\\+10 s; it must be up to 1e\\+09"),
        (4, lambda frame: frame.update(time=0.005), "line 4: time is 0.005000 s, before the 0.010000 s of the frame"),
        (2, lambda frame: frame.update(hands={}), "line 2: hands must be a list of at most 16 hands"),
        (2, lambda frame: frame.update(hands=[json.loads(HAND)] * 17), "line 2: hands must be a list of at most 16"),
        (2, lambda frame: frame.update(hands=[1]), "line 2: hand 0 is no object"),
        (2, lambda frame: frame.update(number=1.5), "line 2: number is 1.5; it must be a whole number"),
        (2, lambda frame: frame.update(number=2**63), "line 2: number is 9.*; it must be a whole number"),
        (2, lambda frame: frame.update(notes="x"), "line 2: notes must be a list of texts"),
        (4, lambda frame: frame["hands"][1].update(side="up"), "line 4: hand 1: side is 'up'"),
        (4, lambda frame: frame["hands"][1].update(side=[]), r"line 4: hand 1: side is \[\]"),
        (4, lambda frame: frame["hands"][1].update(id=None), "line 4: hand 1: id is null"),
        (4, lambda frame: frame["hands"][1].pop("landmarks"), "line 4: hand 1: its landmarks are no table of numbers"),
        (4, lambda frame: frame["hands"][1].update(landmarks=[["1"] * 3] * 21), "no table of numbers"),
        (4, lambda frame: frame["hands"][1].update(landmarks=[[1], [1, 2]]), "no table of numbers"),
        (
            4,
            lambda frame: frame["hands"][1].update(landmarks=[[10**400] * 3] * 21),
            "hand 1: its landmarks are no table",
        ),
        (4, lambda frame: frame["hands"][1]["landmarks"].pop(), "line 4: hand 1: a hand has 21 landmarks, not 20"),
        (4, lambda frame: frame["hands"][1].update(landmarks=[[0, 0, 0]] * 21), "line 4: hand 1: the palm is 0 m long"),
        (4, lambda frame: frame["hands"][1].update(widths=[1] * 5), "line 4: hand 1: widths must be 5 numbers"),
        (5, lambda end: end.update(frames=4), "line 5: there should be 4 frames; there are 3"),
    ],
)
def test_wrong_lines_are_named(
    line: int, change: Callable[[dict[str, Any]], object], message: str, whole: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "wrong.hands"
    path.write_bytes(changed(whole, line, change))
    with pytest.raises(InputFileError, match=message) as refused, HandRecording.open(path) as recording:
        list(recording)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"[" * 100_000, "line 2: it is nested too deeply"),
        (b"{" * 10, "line 2: Expecting property name"),
        (b"[1, 2]", "line 2: it is no object of JSON"),
        (b"", "line 2: Expecting value"),
        (b"\xff\xfe", "line 2: .*codec can't decode"),
        (b'{"time": NaN, "hands": []}', "line 2: NaN is no finite number"),
        (b'{"time": Infinity, "hands": []}', "line 2: Infinity is no finite number"),
        (b'{"time": ' + b"9" * 5000 + b"}", "line 2: .*digits"),
        (b" " * (MOST_LINE_BYTES + 1), f"line 2 has more than {MOST_LINE_BYTES} bytes"),
    ],
)
def test_hostile_lines_are_refused(text: bytes, message: str, whole: bytes, tmp_path: Path) -> None:
    lines = whole.splitlines()
    (tmp_path / "hostile.hands").write_bytes(b"\n".join([lines[0], text, *lines[1:], b""]))
    with pytest.raises(InputFileError, match=message), HandRecording.open(tmp_path / "hostile.hands") as recording:
        list(recording)


def test_impossible_hands_are_repaired_with_a_note(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "short.hands"

    def shorten(frame: dict[str, Any]) -> None:
        frame["hands"][0]["landmarks"][8] = frame["hands"][0]["landmarks"][7]

    path.write_bytes(changed(whole, 3, shorten))
    with HandRecording.open(path) as recording:
        frames = list(recording)
    assert [len(frame.notes) for frame in frames] == [0, 1, 1]
    assert frames[1].notes[0].startswith("the index finger's bone from landmark 7 to 8 is 0.0 mm long")


@given(data=st.data())
def test_any_damage_is_refused_or_played(
    data: st.DataObject, whole: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    damaged = bytearray(whole)
    for place in data.draw(st.lists(st.integers(0, len(whole) - 1), min_size=1, max_size=5)):
        damaged[place] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "damaged.hands"
    path.write_bytes(damaged)
    with suppress(InputFileError), HandRecording.open(path) as recording:
        for frame in recording:
            for each in frame.hands:
                assert np.isfinite(each.hand.quads).all()
