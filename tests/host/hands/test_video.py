"""Videos and cameras, with OpenCV and MediaPipe played by the few names that are used of them."""

from __future__ import annotations

import math
import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire.base.errors import (
    InputFileError,
    MissingExtraError,
    TrackerError,
    TrackerLostError,
    TrackerNotFoundError,
)
from phasewire.base.extras import install_command
from phasewire.host.hands import open_hands
from phasewire.host.hands import video as video_module
from phasewire.host.hands.picture_tracker import CameraView, SeenHand
from phasewire.host.hands.video import CAMERA, MODEL_VARIABLE, VIDEO, CameraHands, Landmarker, video_frames
from phasewire.solver.contact.hand import Hand

from tests.host.hands.pictures import project

HAND = Hand.flat([0.02, 0, 0.4], "left")
MARKS = project(HAND.landmarks, 0.75, 60)
BLUE = np.zeros((30, 40, 3), np.uint8)
BLUE[..., 0] = 255  # OpenCV's first colour


class Capture:
    """A stand-in for `cv2.VideoCapture`: one picture after another, of which one pixel differs until it hangs."""

    def __init__(
        self, times_ms: list[float], rate: float = 25.0, picture: NDArray[np.uint8] = BLUE, hangs: int = 1000
    ) -> None:
        self.times, self.rate, self.picture, self.hangs = times_ms, rate, picture, hangs
        self.read_so_far = 0
        self.released = Event()

    def isOpened(self) -> bool:  # OpenCV's name
        return True

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        self.read_so_far += 1
        self.picture[-1, -1, -1] = min(self.read_so_far, self.hangs) % 256
        return (True, self.picture) if self.read_so_far <= len(self.times) else (False, None)

    def get(self, number: int) -> float:
        return {0: self.times[self.read_so_far - 1] if self.read_so_far else 0.0, 5: self.rate}[number]

    def release(self) -> None:
        self.released.set()


class Finder:
    """Sees the same hand in each picture."""

    def __init__(self, fails: Exception | None = None) -> None:
        self.asked: list[tuple[list[int], float]] = []
        self.closed = Event()
        self.fails = fails

    def find(self, picture: NDArray[np.uint8], time: float) -> list[SeenHand]:
        assert picture.flags.c_contiguous
        self.asked.append((picture[0, 0].tolist(), time))
        if self.fails is not None:
            raise self.fails
        return [SeenHand(MARKS, "left")]

    def close(self) -> None:
        self.closed.set()


# Videos


def test_a_video_gives_the_hands_of_each_picture_with_its_time() -> None:
    finder = Finder()
    frames = list(video_frames("wave.mp4", Capture([0, 40, 90]), finder, CameraView()))
    assert [frame.time for frame in frames] == [0, 0.04, 0.09]
    assert finder.asked[0] == ([0, 0, 255], 0)  # red, green, blue
    for frame in frames:
        np.testing.assert_allclose(frame.hands[0].hand.landmarks, HAND.landmarks, atol=1e-12)
        assert (frame.hands[0].hand.side, frame.hands[0].id) == ("left", 0)


@pytest.mark.parametrize(
    ("times", "rate", "expected"),
    [
        ([0, 0, 0], 20.0, [0, 0.05, 0.1]),
        ([0, math.nan, 200, 100], 10.0, [0, 0.1, 0.2, 0.3]),
        ([math.nan, 0], 10.0, [0, 0.1]),
        ([0, 0], 0.0, [0, 1 / 30]),
        ([0, 0], math.nan, [0, 1 / 30]),
        ([0, 0], 1e9, [0, 1 / 30]),
        ([0, 1e300, math.inf, 90], 25.0, [0, 0.04, 0.08, 0.09]),
    ],
)
def test_times_that_are_missing_are_made_by_the_rate(times: list[float], rate: float, expected: list[float]) -> None:
    frames = video_frames("wave.mp4", Capture(times, rate), Finder(), CameraView())
    assert [frame.time for frame in frames] == pytest.approx(expected, abs=1e-12)


def test_a_video_without_a_picture_is_refused() -> None:
    with pytest.raises(InputFileError, match=r"wave\.mp4 has no picture"):
        list(video_frames("wave.mp4", Capture([]), Finder(), CameraView()))


def test_a_picture_that_is_too_large_is_refused() -> None:
    vast = np.zeros((8192, 4097, 3), np.uint8)
    with pytest.raises(InputFileError, match="pictures of 4097 × 8192 pixels"):
        list(video_frames("wave.mp4", Capture([0], picture=vast), Finder(), CameraView()))


# Cameras


def test_a_camera_gives_frames_as_they_come_and_says_when_it_is_gone() -> None:
    capture, finder = Capture([0] * 3), Finder()
    before = time.monotonic()
    with CameraHands("camera 0", capture, finder, CameraView()) as camera:
        frames = [next(camera) for _ in range(3)]
        with pytest.raises(TrackerLostError, match="camera 0 gives no more pictures"):
            next(camera)
        assert camera.ended
    assert camera.live
    assert camera.rate == 25
    assert finder.closed.wait(10)
    assert capture.released.is_set()
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert [frame.time for frame in frames] == [asked for _, asked in finder.asked]
    assert before <= frames[0].time <= frames[2].time <= time.monotonic()


def test_a_camera_that_repeats_its_picture_repeats_its_frame() -> None:
    finder = Finder()
    with CameraHands("camera 0", Capture([0] * 6, hangs=3), finder, CameraView()) as camera:
        frames = [next(camera) for _ in range(6)]
    assert [frame.number for frame in frames] == [0, 1, 2, 2, 2, 2]
    assert [frame.time for frame in frames[3:]] == [frames[2].time] * 3
    assert len(finder.asked) == 3


@pytest.mark.parametrize(
    ("fails", "kind"), [(RuntimeError("out of order"), TrackerLostError), (TrackerError("out of order"), TrackerError)]
)
def test_what_fails_in_the_thread_reaches_the_reader(fails: Exception, kind: type[Exception]) -> None:
    capture = Capture([0] * 3)
    camera = CameraHands("camera 0", capture, Finder(fails), CameraView())
    with pytest.raises(kind, match="out of order"):
        next(camera)
    camera.close()
    assert capture.released.wait(10)


class Endless(Capture):
    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        time.sleep(0.001)
        return True, self.picture


def test_a_camera_that_is_closed_is_given_back() -> None:
    capture = Endless([0])
    with CameraHands("camera 0", capture, Finder(), CameraView()) as camera:
        frame = next(camera)
        assert frame.hands
    assert capture.released.wait(10)
    assert camera.ended


# MediaPipe


class Vision:
    """``mediapipe``, as far as it is used; names and forms as in its version 1.2.2."""

    def __init__(self, unusable: Exception | None = None) -> None:
        self.options: Any = None
        self.pictures: list[tuple[Any, int]] = []
        self.closed = False
        self.unusable = unusable
        self.fails: Exception | None = None
        mark = [SimpleNamespace(x=x, y=y, z=z) for x, y, z in MARKS.tolist()]
        self.found = SimpleNamespace(
            hand_landmarks=[mark], handedness=[[SimpleNamespace(category_name="Left", score=0.9)]]
        )

    def module(self) -> ModuleType:
        module: Any = ModuleType("mediapipe")
        module.Image = lambda image_format, data: (image_format, data)
        module.ImageFormat = SimpleNamespace(SRGB="sRGB")
        vision = SimpleNamespace(
            HandLandmarkerOptions=lambda **options: SimpleNamespace(**options),
            RunningMode=SimpleNamespace(VIDEO="video"),
            HandLandmarker=SimpleNamespace(create_from_options=self.create),
        )
        module.tasks = SimpleNamespace(BaseOptions=lambda **options: options, vision=vision)
        return module  # type: ignore[no-any-return]  # it is one, with more in it

    def create(self, options: Any) -> Vision:
        os.write(2, b"I0000 a log line of native code")
        if self.unusable is not None:
            raise self.unusable
        self.options = options
        return self

    def detect_for_video(self, image: Any, ms: int) -> Any:
        if not self.pictures:
            os.write(2, b"W0000 a log line of native code")
        if self.fails is not None:
            raise self.fails
        self.pictures.append((image, ms))
        return self.found

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "hand_landmarker.task"
    path.write_bytes(b"a model")
    return path


def installed(monkeypatch: pytest.MonkeyPatch, vision: Vision, capture: Capture | None = None) -> list[Any]:
    """Put MediaPipe and OpenCV in their places; what OpenCV was asked to open."""
    asked: list[Any] = []
    cv2: Any = ModuleType("cv2")
    closed = SimpleNamespace(isOpened=lambda: False)

    def opened(source: str | int) -> Any:
        asked.append(source)
        return capture or closed

    cv2.VideoCapture = opened
    monkeypatch.setenv("OPENCV_LOG_LEVEL", "SILENT")
    monkeypatch.setitem(sys.modules, "mediapipe", vision.module())
    monkeypatch.setitem(sys.modules, "cv2", cv2)
    return asked


def test_mediapipe_gets_increasing_milliseconds_and_gives_landmarks(
    monkeypatch: pytest.MonkeyPatch, model: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    vision = Vision()
    installed(monkeypatch, vision)
    landmarker = Landmarker(model, 3)
    assert vision.options.base_options == {"model_asset_buffer": b"a model"}
    assert (vision.options.running_mode, vision.options.num_hands) == ("video", 3)
    seen = [landmarker.find(BLUE, at) for at in (0.0, 0.0002, 0.04, 0.0396)]
    assert [ms for _, ms in vision.pictures] == [0, 1, 40, 41]
    (colours, picture), _ = vision.pictures[0]
    assert colours == "sRGB"
    assert picture is BLUE
    assert [[hand.side for hand in hands] for hands in seen] == [["left"]] * 4
    np.testing.assert_array_equal(seen[0][0].landmarks, MARKS)
    assert capfd.readouterr().err == ""
    landmarker.close()
    assert vision.closed
    vision.fails = RuntimeError("graph has errors")
    with pytest.raises(TrackerError, match="MediaPipe failed at a picture: graph has errors"):
        landmarker.find(BLUE, 1.0)


def test_a_model_that_mediapipe_rejects_is_an_error(monkeypatch: pytest.MonkeyPatch, model: Path) -> None:
    installed(monkeypatch, Vision(RuntimeError("Unable to open zip archive.")))
    with pytest.raises(InputFileError, match=r"hand_landmarker\.task is no model .*zip archive.*https://ai\.google"):
        Landmarker(model, 2)


# URLs


@pytest.fixture(params=["video", "camera"])
def scheme(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    (tmp_path / "wave.mp4").write_bytes(b"a video")
    return f"video:{tmp_path / 'wave.mp4'}" if request.param == "video" else "camera:0"


def test_the_model_is_asked_for(scheme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(MODEL_VARIABLE, raising=False)
    installed(monkeypatch, Vision())
    for url in (scheme, f"{scheme}?model="):
        with pytest.raises(ValueError, match=r"\?model=hand_landmarker\.task.*\$PHASEWIRE_HAND_MODEL.*https://"):
            open_hands(url)


def test_a_missing_extra_is_named(scheme: str, model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mediapipe", None)  # as if it was not installed
    monkeypatch.delenv(MODEL_VARIABLE, raising=False)
    for url in (scheme, f"{scheme}?model={model}"):
        with pytest.raises(MissingExtraError, match=f"package mediapipe, .*: {re.escape(install_command('video'))}"):
            open_hands(url)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("fov=5", "fov=5: it must lie between 10 and 170 degrees; .*&fov=60&"),
        ("fov=nan", "fov=nan: it must lie between"),
        ("length=19", "length=19: it must lie between 0.06 and 0.35 metres"),
        ("mirrored=maybe", "mirrored=maybe: it must be yes or no"),
        ("hands=9", "hands=9: it must be 1, 2, 3 or 4"),
        ("speed=2", "there is no option 'speed'"),
    ],
)
def test_wrong_options_are_named(scheme: str, options: str, message: str, model: Path) -> None:
    with pytest.raises(ValueError, match=message):
        open_hands(f"{scheme}?model={model}&{options}")


@pytest.fixture
def vision(monkeypatch: pytest.MonkeyPatch) -> Iterator[Vision]:
    vision = Vision()
    yield vision
    if vision.options is not None:
        assert vision.closed


def test_a_video_is_opened_by_its_url(monkeypatch: pytest.MonkeyPatch, model: Path, vision: Vision) -> None:
    capture = Capture([0, 40])
    asked = installed(monkeypatch, vision, capture)
    film = model.with_name("wave.mp4")
    film.write_bytes(b"a video")
    monkeypatch.setenv(MODEL_VARIABLE, str(model))
    with open_hands(f"video:{film}?fov=60&hands=1") as source:
        assert (source.rate, source.live, source.name) == (25, False, f"video {film}")
        frames = list(source)
    assert [frame.time for frame in frames] == [0, 0.04]
    assert asked == [str(film)]
    assert vision.options.num_hands == 1
    assert capture.released.is_set()
    np.testing.assert_allclose(frames[0].hands[0].hand.landmarks, HAND.landmarks, atol=1e-12)


def test_a_file_that_is_no_video_is_refused(monkeypatch: pytest.MonkeyPatch, model: Path, vision: Vision) -> None:
    installed(monkeypatch, vision)
    with pytest.raises(InputFileError, match=r"hand_landmarker\.task is no video that OpenCV can read"):
        open_hands(f"video:{model}?model={model}")


@pytest.mark.parametrize("name", ["http://127.0.0.1/wave.mp4", "nowhere.mp4"])
def test_only_files_are_opened_as_videos(
    name: str, monkeypatch: pytest.MonkeyPatch, model: Path, vision: Vision
) -> None:
    asked = installed(monkeypatch, vision, Capture([0]))
    with pytest.raises(OSError, match="No such file"):
        open_hands(f"video:{name}?model={model}")
    assert asked == []


def test_a_camera_is_opened_by_its_number(monkeypatch: pytest.MonkeyPatch, model: Path, vision: Vision) -> None:
    asked = installed(monkeypatch, vision, Endless([0]))
    with open_hands(f"camera:2?model={model}") as source:
        frame = source.next_frame(10)
        assert frame is not None
        np.testing.assert_allclose(frame.hands[0].hand.landmarks, HAND.landmarks, atol=1e-12)
    assert asked == [2]


def test_a_missing_camera_is_an_error(monkeypatch: pytest.MonkeyPatch, model: Path, vision: Vision) -> None:
    installed(monkeypatch, vision)
    with pytest.raises(TrackerNotFoundError, match=r"camera 7 does not answer: .*camera:0 is the first one"):
        open_hands(f"camera:7?model={model}")


def test_a_video_has_a_name(model: Path) -> None:
    with pytest.raises(ValueError, match=r"video: names no file; such a URL has the form video:FILE\?"):
        open_hands(f"video:?model={model}")


@pytest.mark.parametrize("name", ["", "x", "-1", "1.5", "²", "9999"])
def test_a_camera_has_a_number(name: str, model: Path) -> None:
    with pytest.raises(ValueError, match="is no number of a camera"):
        open_hands(f"camera:{name}?model={model}")


def test_readiness(monkeypatch: pytest.MonkeyPatch, model: Path) -> None:
    monkeypatch.delenv(MODEL_VARIABLE, raising=False)
    monkeypatch.setattr(video_module, "find_spec", lambda name: None)
    for scheme in (VIDEO, CAMERA):
        assert not scheme.probe().ready
        assert install_command("video") in scheme.probe().says
    monkeypatch.setattr(video_module, "find_spec", lambda name: object())
    assert VIDEO.probe().ready
    assert "$PHASEWIRE_HAND_MODEL" in VIDEO.probe().says
    monkeypatch.setenv(MODEL_VARIABLE, str(model))
    assert VIDEO.probe().ready
    assert str(model) in VIDEO.probe().says
    monkeypatch.setenv(MODEL_VARIABLE, "nowhere.task")
    assert not VIDEO.probe().ready
