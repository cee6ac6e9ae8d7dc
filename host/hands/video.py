"""Hands in the pictures of a video or a camera, found by MediaPipe's hand landmarker.

``video:FILE`` and ``camera:NUMBER`` need the extra ``video``, which brings MediaPipe and with it OpenCV, and the file
of MediaPipe's model, which is in no package.

MediaPipe also gives "world landmarks" in metres, without a place in space. They are not used: in a picture that was
tried, they made the index finger's first bone 0.30 of the length from wrist to knuckle, and the picture shows 0.55. So
metres come from `pinhole.in_space`, which places the landmarks on the lines on which the camera sees them.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import Event, Thread
from typing import Any, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputFileError, TrackerError, TrackerLostError, TrackerNotFoundError
from ...base.extras import install_command, needing
from ...base.storage import FilePath, open_plain, read_file
from ...solver.contact.hand import Side
from ..transports.transport import Timekeeper
from .frames import HandFrame
from .picture_tracker import CameraView, PictureTracker, SeenHand
from .sources import HandSource, LiveHands, PlayedHands, Readiness, TrackerScheme, read_options

__all__ = ["CAMERA", "VIDEO", "CameraHands", "Landmarker", "video_frames"]

MODEL_VARIABLE = "PHASEWIRE_HAND_MODEL"
MODEL_PAGE = "https://ai.google.dev/edge/mediapipe/solutions/vision/hand_landmarker#models"
MOST_MODEL_BYTES = 1 << 26
MOST_PIXELS = 1 << 25
"""Of a picture: 8192 × 4096."""

REPEAT_SECONDS = 5e-3
"""After a picture that is repeated, the next one is read after this: a driver that hangs may not wait for one."""

USUAL_RATE = 30.0
"""Pictures per second of a video or camera that does not say."""

MOST_SECONDS = 1e9
"""That a time in a video may be; a later one is damage."""

POSITION_MS, RATE = 0, 5  # OpenCV's CAP_PROP_POS_MSEC and CAP_PROP_FPS

Picture: TypeAlias = NDArray[np.uint8]


class _Finder(Protocol):
    def find(self, picture: Picture, time: float) -> list[SeenHand]:
        """The hands in a picture in RGB, taken at a time in seconds that never decreases."""

    def close(self) -> None:
        """Give back what it holds."""


class Landmarker:
    """MediaPipe's hand landmarker.

    Parameters
    ----------
    model : str or Path
        ``hand_landmarker.task``.
    hands : int
        How many hands to look for.

    Raises
    ------
    MissingExtraError
        If MediaPipe is not installed.
    InputFileError
        If MediaPipe cannot use the model.
    OSError
        If its file cannot be read.
    """

    def __init__(self, model: FilePath, hands: int) -> None:
        data = read_file(model, MOST_MODEL_BYTES)
        with _muted():
            self._mediapipe = _imported("mediapipe")
        tasks = self._mediapipe.tasks
        options = tasks.vision.HandLandmarkerOptions(
            base_options=tasks.BaseOptions(model_asset_buffer=data),
            running_mode=tasks.vision.RunningMode.VIDEO,
            num_hands=hands,
        )
        try:
            with _muted():
                self._landmarker = tasks.vision.HandLandmarker.create_from_options(options)
        except (RuntimeError, ValueError, OSError) as error:
            raise InputFileError(
                f"{model} is no model of MediaPipe's hand landmarker ({error}); get one at {MODEL_PAGE}"
            ) from error
        self._last_ms, self._found = -1, False

    def find(self, picture: Picture, time: float) -> list[SeenHand]:
        """See `_Finder`; MediaPipe wants times in whole milliseconds that increase."""
        self._last_ms = max(self._last_ms + 1, round(time * 1e3))
        image = self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=picture)
        first, self._found = not self._found, True
        try:
            with _muted() if first else nullcontext():
                found = self._landmarker.detect_for_video(image, self._last_ms)
        except (RuntimeError, ValueError) as error:
            raise TrackerError(f"MediaPipe failed at a picture: {error}") from error
        return [
            SeenHand(
                np.array([[mark.x, mark.y, mark.z] for mark in landmarks]), cast(Side, sides[0].category_name.lower())
            )
            for landmarks, sides in zip(found.hand_landmarks, found.handedness, strict=True)
        ]

    def close(self) -> None:
        """Give back what it holds."""
        self._landmarker.close()


@contextmanager
def _muted() -> Iterator[None]:
    """Keep off standard error what MediaPipe's native code writes there while it starts: it has no switch for that."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _imported(name: str) -> Any:
    """MediaPipe or OpenCV."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # our errors say it; both load OpenCV, which reads this then
    with needing("video", "finding hands in pictures"):
        return import_module(name)


def _captured(source: str | int) -> Any:
    """OpenCV's pictures of a file or of a camera with a number."""
    return _imported("cv2").VideoCapture(source)


def _rate(capture: Any) -> float:
    rate = float(capture.get(RATE))
    return rate if math.isfinite(rate) and 0 < rate <= 1000 else USUAL_RATE


def _rgb(picture: Picture, name: str) -> Picture:
    """OpenCV's order of colours turned into MediaPipe's.

    Raises
    ------
    InputFileError
        If the picture is too large.
    """
    if picture.shape[0] * picture.shape[1] > MOST_PIXELS:
        raise InputFileError(
            f"{name} has pictures of {picture.shape[1]} × {picture.shape[0]} pixels; at most {MOST_PIXELS} may be"
        )
    return np.ascontiguousarray(picture[:, :, ::-1])


def video_frames(name: str, capture: Any, finder: _Finder, view: CameraView) -> Iterator[HandFrame]:
    """The frames of a video, with the times that are written in it; by its rate if they do not increase.

    Raises
    ------
    InputFileError
        If it has no picture, or one that is too large.
    TrackerError
        If MediaPipe fails.
    """
    tracker, period, last = PictureTracker(view), 1 / _rate(capture), -math.inf
    while True:
        good, picture = capture.read()
        if not good and last == -math.inf:
            raise InputFileError(f"{name} has no picture that OpenCV can read")
        if not good:
            return
        time = float(capture.get(POSITION_MS)) / 1e3
        last = time if last < time < MOST_SECONDS else max(last, -period) + period
        yield tracker.frame(last, finder.find(_rgb(picture, name), last), picture.shape[0] / picture.shape[1])


class CameraHands(LiveHands):
    """Hands before a camera, found in a thread of their own.

    The time of a frame is when OpenCV handed over the picture; how long the camera itself took is unknown. A live
    sensor has noise, so a picture that repeats the one before in every pixel gives the same frame again: no news.
    """

    def __init__(self, name: str, capture: Any, finder: _Finder, view: CameraView) -> None:
        super().__init__(name, _rate(capture))
        self._capture, self._finder, self._sight = capture, finder, PictureTracker(view)
        self._stopped = Event()
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        before: Picture | None = None
        try:
            while not self._stopped.is_set():
                good, picture = self._capture.read()
                now = time.monotonic()
                if not good:
                    raise TrackerLostError(
                        f"{self.name} gives no more pictures: it was unplugged, or its driver failed"
                    )
                shown = _rgb(picture, self.name)
                if before is None or not np.array_equal(shown, before):
                    before = shown
                    seen = self._finder.find(shown, now)
                    frame = self._sight.frame(now, seen, picture.shape[0] / picture.shape[1])
                else:
                    self._stopped.wait(REPEAT_SECONDS)
                self.put(frame)
        except TrackerError as error:
            self.end(error)
        except Exception as error:  # of OpenCV or MediaPipe; otherwise the reader would wait for ever
            self.end(TrackerLostError(f"{self.name} failed: {error}"))
        finally:
            self._capture.release()
            self._finder.close()

    def close(self) -> None:
        """Stop it, and give the camera back."""
        self._stopped.set()
        super().close()
        self._thread.join(2)


def _number(low: float, high: float, unit: str) -> Callable[[str], float]:
    def read(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise ValueError(f"it must lie between {low:g} and {high:g} {unit}")
        return value

    return read


def _yes(text: str) -> bool:
    if text not in ("yes", "no"):
        raise ValueError("it must be yes or no")
    return text == "yes"


def _hands(text: str) -> int:
    if text not in ("1", "2", "3", "4"):
        raise ValueError("it must be 1, 2, 3 or 4")
    return int(text)


OPTIONS: dict[str, Callable[[str], Any]] = {
    "model": str,
    "fov": _number(10, 170, "degrees"),
    "length": _number(0.06, 0.35, "metres"),
    "mirrored": _yes,
    "hands": _hands,
}
TAIL = "model=hand_landmarker.task&fov=60&length=0.189&mirrored=no&hands=2"


def _taken_apart(rest: str, form: str) -> tuple[str, Path, CameraView]:
    """What is looked at, the model and the view that a URL names."""
    where, options = read_options(rest, OPTIONS, form)
    model = options.pop("model", None) or os.environ.get(MODEL_VARIABLE)
    if not model:
        _imported("mediapipe")  # without it a model is of no use
        raise ValueError(
            f"the file of MediaPipe's hand model is missing: name it by ?model=hand_landmarker.task, or in "
            f"${MODEL_VARIABLE}; it can be downloaded at {MODEL_PAGE}"
        )
    return where, Path(model), CameraView(**options)


def _probed() -> Readiness:
    missing = [name for name in ("mediapipe", "cv2") if find_spec(name) is None]
    if missing:
        return Readiness(False, f"no {' and no '.join(missing)} here: {install_command('video')}")
    model = os.environ.get(MODEL_VARIABLE)
    if not model:
        return Readiness(True, f"MediaPipe is installed; name its model by ?model=FILE or in ${MODEL_VARIABLE}")
    if not Path(model).is_file():
        return Readiness(False, f"${MODEL_VARIABLE} names {model}, which is no file; get the model at {MODEL_PAGE}")
    return Readiness(True, f"MediaPipe is installed, with the model {model}")


@dataclass(frozen=True)
class _Video:
    form: str = f"video:FILE?{TAIL}"
    help: str = "Hands in a video, found by MediaPipe."

    def open(self, rest: str, clock: Timekeeper = time) -> HandSource:
        where, model, view = _taken_apart(rest, self.form)
        if not where:
            raise ValueError(f"video: names no file; such a URL has the form {self.form}")
        with open_plain(Path(where)):
            pass  # OpenCV does not say what is wrong with a file, and would take some names for URLs
        finder = Landmarker(model, view.hands)
        capture = _captured(str(Path(where).absolute()))
        if not capture.isOpened():
            finder.close()
            raise InputFileError(f"{where} is no video that OpenCV can read")

        def close() -> None:
            capture.release()
            finder.close()

        return PlayedHands(f"video {where}", video_frames(where, capture, finder, view), _rate(capture), clock, close)

    def probe(self) -> Readiness:
        return _probed()


@dataclass(frozen=True)
class _Camera:
    form: str = f"camera:NUMBER?{TAIL}"
    help: str = "Hands before a camera of this computer, found by MediaPipe."

    def open(self, rest: str, clock: Timekeeper = time) -> HandSource:  # noqa: ARG002  # a camera has its own time
        where, model, view = _taken_apart(rest, self.form)
        if not (where.isascii() and where.isdecimal() and len(where) <= 3):
            raise ValueError(f"{where!r} is no number of a camera; such a URL has the form {self.form}; 0 is the first")
        finder = Landmarker(model, view.hands)
        capture = _captured(int(where))
        if not capture.isOpened():
            finder.close()
            raise TrackerNotFoundError(
                f"camera {where} does not answer: is it plugged in, free of other programs, and may this user read it "
                f"(on Linux /dev/video{where})? camera:0 is the first one"
            )
        return CameraHands(f"camera {where}", capture, finder, view)

    def probe(self) -> Readiness:
        return _probed()


VIDEO: TrackerScheme = _Video()
CAMERA: TrackerScheme = _Camera()
