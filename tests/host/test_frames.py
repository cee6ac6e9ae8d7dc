from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Circle, ControlPoints, Pulses, Solution, Solver, TransducerArray
from phasewire.host.streaming.calibration import Calibration
from phasewire.host.streaming.frames import (
    FrameSource,
    LoopedFrames,
    PulseFrames,
    beginning,
    frame_source,
    limited_frames,
    solved,
    to_pulses,
)
from phasewire.host.streaming.limiting import TurnedDown
from phasewire.solver import Cycle

N = 6
GRID = TransducerArray.grid(3, 2)
CALIBRATION = Calibration([1, 0.5, 2, 1, 1, 1], [0, 90, -45, 10, 0, 0], [1, -1, 1, 1, -1, 1], [0, 0, 0, 0, 0, 1])
RNG = np.random.default_rng(12)
DRIVES = RNG.uniform(-0.7, 0.7, (40, N, 2)) @ [1, 1j]
SINGLE = DRIVES.astype(np.complex64)
FRAMES = PulseFrames(RNG.integers(0, 100, (40, N), dtype=np.uint8), RNG.integers(0, 26, (40, N), dtype=np.uint8))


def solution(drive: np.ndarray, array: TransducerArray = GRID) -> Solution:
    solver = Solver(array)
    return Solution(drive, array, ControlPoints([[0, 0, 0.2]]), solver.medium, "made up")


def drained(source: FrameSource, takes: list[int]) -> PulseFrames:
    """All that a source gives, by so many at a time in turn."""
    parts: list[PulseFrames] = []
    for turn in count():
        taken = source.take(takes[turn % len(takes)])
        assert taken.phase.shape == taken.width.shape
        assert len(taken.phase) <= takes[turn % len(takes)]
        if not len(taken.phase):
            assert not len(source.take(5).phase)
            return PulseFrames(*(np.concatenate(rows) for rows in zip(*parts, taken, strict=True)))
        parts.append(taken)
    raise AssertionError


def by_hand(drives: np.ndarray, calibration: Calibration | None) -> PulseFrames:
    rows = [Pulses.from_drive(drive if calibration is None else calibration.apply(drive)) for drive in drives]
    return PulseFrames(np.array([row.phase for row in rows]), np.array([row.width for row in rows]))


SOURCES: dict[str, Callable[[], Any]] = {
    "an array": lambda: DRIVES,
    "single precision": lambda: SINGLE,
    "a list of drives": lambda: list(DRIVES),
    "lists": lambda: DRIVES.tolist(),
    "a generator": lambda: (drive for drive in DRIVES),
    "solutions": lambda: map(solution, DRIVES),
}


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("calibration", [None, CALIBRATION], ids=["as they are", "calibrated"])
@given(takes=st.lists(st.integers(1, 50), min_size=1, max_size=5))
def test_drives_become_pulses(source: str, calibration: Calibration | None, takes: list[int]) -> None:
    frames = SOURCES[source]()
    expected = by_hand(SINGLE if source == "single precision" else DRIVES, calibration)
    found = drained(frame_source(frames, calibration, N), takes)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("calibration", [None, CALIBRATION], ids=["no calibration", "a calibration"])
@given(takes=st.lists(st.integers(1, 50), min_size=1, max_size=5))
def test_pulses_pass_as_they_are(calibration: Calibration | None, takes: list[int]) -> None:
    one_by_one = [Pulses(*pair) for pair in zip(*FRAMES, strict=True)]
    for source in (FRAMES, one_by_one, iter(one_by_one)):
        found = drained(frame_source(source, calibration, N), takes)
        np.testing.assert_array_equal(found, FRAMES)


def test_frames_of_different_kinds_may_follow_each_other() -> None:
    mixed = [DRIVES[0], Pulses(FRAMES.phase[1], FRAMES.width[1]), solution(DRIVES[2]), DRIVES[3].astype(np.complex64)]
    found = drained(frame_source(mixed, CALIBRATION, N), [3])
    expected = by_hand(DRIVES[[0, 0, 2, 3]], CALIBRATION)
    expected.phase[1], expected.width[1] = FRAMES.phase[1], FRAMES.width[1]
    np.testing.assert_array_equal(found, expected)


class Kept:
    """Stored frames that give no more than there is."""

    channels = N

    def __len__(self) -> int:
        return 40

    def read(self, start: int, stop: int) -> PulseFrames:
        assert 0 <= start <= stop <= 40
        return PulseFrames(FRAMES.phase[start:stop], FRAMES.width[start:stop])


@given(takes=st.lists(st.integers(1, 50), min_size=1, max_size=5), count=st.integers(0, 60))
def test_stored_frames_are_asked_for_no_more_than_there_is(takes: list[int], count: int) -> None:
    np.testing.assert_array_equal(drained(frame_source(Kept(), CALIBRATION, N), takes), FRAMES)
    found = drained(frame_source(beginning(Kept(), count), None, N), takes)
    np.testing.assert_array_equal(found, PulseFrames(FRAMES.phase[:count], FRAMES.width[:count]))


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("count", [0, 3, 40, 50])
def test_a_beginning_is_of_any_kind(source: str, count: int) -> None:
    first = drained(frame_source(beginning(SOURCES[source](), count), None, N), [7])
    whole = drained(frame_source(SOURCES[source](), None, N), [7])
    np.testing.assert_array_equal(first, PulseFrames(whole.phase[:count], whole.width[:count]))


def bad(at: int, frame: Any) -> list[Any]:
    return [*DRIVES[:at], frame]


def spoilt(frames: np.ndarray, value: complex) -> np.ndarray:
    frames = frames.copy()
    frames[23, 2] = value
    return frames


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (spoilt(DRIVES, np.nan), "drive of transducer 2 of frame 23 is .*nan"),
        (spoilt(DRIVES, 1.5), "drive of transducer 2 of frame 23 has magnitude 1.5; at most 1"),
        (list(spoilt(DRIVES, 1.5)), "drive of transducer 2 of frame 23 has magnitude 1.5; at most 1"),
        (bad(13, DRIVES[0, :5]), r"frame 13: a drive of the shape \(5,\) for a device with 6 transducers"),
        (bad(13, DRIVES), r"frame 13: a drive of the shape \(40, 6\)"),
        (bad(13, Pulses.silent(7)), "frame 13: 7 pulses for a device with 6 transducers"),
        (bad(13, "silence"), r"frame 13: a frame is Pulses, a Solution, or a drive \(6,\) complex, not str"),
        (bad(13, ControlPoints([[0, 0, 0.2]])), "frame 13: a frame is Pulses, .* not ControlPoints"),
        (bad(13, [[1], [2, 3]]), "frame 13: "),
        (FRAMES._replace(width=spoilt(FRAMES.width, 26)), "width 26 of transducer 2 of frame 23 is above 25"),
        (FRAMES._replace(phase=spoilt(FRAMES.phase, 100)), "phase 100 of transducer 2 of frame 23 is above 99"),
    ],
)
@pytest.mark.parametrize("calibration", [None, CALIBRATION], ids=["no calibration", "a calibration"])
def test_a_bad_frame_is_named_by_its_number(source: Any, message: str, calibration: Calibration | None) -> None:
    with pytest.raises(ValueError, match=message):
        drained(frame_source(source, calibration, N), [9])


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (DRIVES[0], r"drives of frames must have the shape \(k, 6\), not \(6,\)"),
        (DRIVES[:, :5], r"drives of frames must have the shape \(k, 6\), not \(40, 5\)"),
        (FRAMES._replace(phase=FRAMES.phase[:, :5]), r"phase of frames must have the shape \(k, 6\), not \(40, 5\)"),
        (FRAMES._replace(width=FRAMES.width.astype(int)), "width of frames must be uint8, not int64"),
        (FRAMES._replace(width=FRAMES.width[:7]), "40 frames of phases but 7 of widths"),
        (Pulses.silent(6), "Pulses is no source of frames; an array of drives"),
        (solution(DRIVES[0]), "Solution is no source of frames"),
        (12, "int is no source of frames"),
    ],
)
def test_what_is_no_source_is_named_at_once(source: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        frame_source(source, None, N)


def test_a_calibration_must_be_of_the_device() -> None:
    with pytest.raises(ValueError, match="a calibration of 5 transducers for a device with 6"):
        frame_source(DRIVES, Calibration.perfect(5), N)


def test_no_response_is_corrected_twice() -> None:
    """A solver that knew the responses has met them already."""
    known = solution(DRIVES[0], GRID.calibrated(CALIBRATION.response))
    assert to_pulses(known, None, N) == Pulses.from_drive(DRIVES[0])
    with pytest.raises(ValueError, match="responses of its own, which a calibration would correct again"):
        to_pulses(known, CALIBRATION, N)
    with pytest.raises(ValueError, match="frame 1: this was solved for an array with responses of its own"):
        frame_source([DRIVES[0], known], CALIBRATION, N).take(2)


def test_points_are_solved_as_they_come(array: TransducerArray) -> None:
    circle = Circle(radius=0.02).sample()
    points = [ControlPoints(circle.positions * (1 + step / 10)) for step in range(3)]
    found = drained(frame_source(solved(iter(points), Solver(array, "tikhonov")), None, 320), [2])
    solver = Solver(array, "tikhonov")
    expected = [Pulses.from_drive(solver.solve(each).drive) for each in points]
    np.testing.assert_array_equal(found.phase, [pulses.phase for pulses in expected])
    np.testing.assert_array_equal(found.width, [pulses.width for pulses in expected])


def test_points_that_cannot_be_solved_for_are_named(array: TransducerArray) -> None:
    points = [ControlPoints([[0, 0, 0.2]]), ControlPoints([[0, 0, -0.2]])]
    with pytest.raises(ValueError, match=r"frame 1: control point 0 at \[0.0, 0.0, -0.2\] m is on the array or behind"):
        drained(frame_source(solved(points, Solver(array)), None, 320), [1])


@given(st.integers(1, 40), st.integers(1, 7), st.integers(1, 50), st.booleans())
def test_looped_frames_are_those_of_the_cycle(count: int, hold: int, periods: int, calibrated: bool) -> None:
    """At any rate that is a whole number of carrier periods: what plays then, by counting periods."""
    corrected = CALIBRATION if calibrated else None
    source = frame_source(LoopedFrames(Cycle(SINGLE[:count], hold), 40_000 / periods, corrected, 90), corrected, N)
    assert source.ready
    found = drained(source, [7, 30])
    expected = [number * periods // hold % count for number in range(90)]
    wanted = drained(frame_source(SINGLE[:count], corrected, N), [50])
    assert (found.phase == wanted.phase[expected]).all()
    assert (found.width == wanted.width[expected]).all()


def test_limited_frames_keep_their_limit_and_stay_down() -> None:
    """Judged by the emission of the pulses: no more than so much from all transducers together."""

    def limit(emitted: np.ndarray) -> float:
        return min(1.0, 2.0 / float(np.abs(emitted).sum(axis=1).max()))

    strong, weak = np.full(N, 1.0 + 0j), np.full(N, 0.2 + 0j)
    strengths = [
        float(np.abs(pulses.to_drive()).sum())
        for pulses in limited_frames([weak, strong, weak], None, TurnedDown(limit))
    ]
    assert max(strengths) <= 2.0
    assert strengths[1] > 1.5
    assert strengths[2] < strengths[0]
    with pytest.raises(ValueError, match=r"^frame 1: "):
        list(limited_frames([weak, 3 * strong], None, TurnedDown(None)))
    with pytest.raises(ValueError, match="hold pulses"):
        next(limited_frames(FRAMES, None, TurnedDown(limit)))


def test_a_limit_judges_each_frame_after_the_one_before() -> None:
    seen: list[np.ndarray] = []

    def limit(emitted: np.ndarray) -> float:
        seen.append(emitted)
        return 1.0

    list(limited_frames([np.full(N, 1.0 + 0j), np.full(N, -1.0 + 0j)], None, TurnedDown(limit)))
    assert [len(each) for each in seen] == [1, 2]
    assert (seen[1][0] == seen[0][0]).all()
    assert np.abs(seen[1][1] + seen[1][0]).max() < 1e-6
