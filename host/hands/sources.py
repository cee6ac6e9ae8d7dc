"""Sources of hands, found by the scheme of a URL.

A scheme is an entry point in the group ``phasewire.hands`` that names a `TrackerScheme`. Other packages may add their
own. A source that has its frames at once, such as a recording, is a `PlayedHands`; one whose frames come by themselves
is a `LiveHands`.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from threading import Condition
from types import TracebackType
from typing import Any, Protocol, Self
from urllib.parse import parse_qsl, unquote

from ...base.errors import TrackerError, TrackerNotFoundError
from ...base.plugins import entries
from ..transports.opening import load_by_scheme
from ..transports.transport import Timekeeper
from .frames import HandFrame

__all__ = [
    "SCHEMES",
    "HandSource",
    "LiveHands",
    "PlayedHands",
    "Readiness",
    "TrackerScheme",
    "files_of",
    "open_hands",
    "read_options",
    "schemes",
]

SCHEMES = "phasewire.hands"
MOST_WAITING = 256
"""Frames that a live source keeps for a reader that is late; then it drops the oldest."""


class HandSource(Protocol):
    """Hands over time. Use it in a ``with`` statement, in one thread.

    There are two ways to read it. As an iterator it gives every frame: those of a recording at once, with the times
    that were recorded. `next_frame` is for a live loop: it gives frames when they are due, with times by the clock, and
    skips those that the loop came too late for.
    """

    @property
    def name(self) -> str:
        """What it is, for people."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong with the source as a whole, such as a recording that was cut off."""

    @property
    def rate(self) -> float:
        """Frames per second that can be expected."""

    @property
    def live(self) -> bool:
        """Whether frames come by themselves, as from a tracker.

        Their times are by ``time.monotonic`` then. Numbers and times are the tracker's own, not those of packets that
        arrive: only a frame in which both are new keeps touch alive (`Liveness`).
        """

    @property
    def ended(self) -> bool:
        """Whether no further frame will come."""

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The newest frame that is due and has not been given yet.

        Parameters
        ----------
        timeout : float
            How many seconds to wait for one; 0 does not wait.

        Returns
        -------
        HandFrame or None
            A frame with its time by the clock that the source was opened with. None if there was none in time; `ended`
            says whether to wait again.

        Raises
        ------
        TrackerError
            If the tracker is lost.
        InputFileError
            If the source is a file, and it is damaged there.
        """

    def __iter__(self) -> Iterator[HandFrame]: ...

    def __next__(self) -> HandFrame: ...

    def close(self) -> None:
        """Stop it; it may be closed twice."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None: ...


@dataclass(frozen=True)
class Readiness:
    """Whether hands can come from a scheme now.

    Parameters
    ----------
    ready : bool
        Whether it would open.
    says : str
        What was found, or what is missing and what to do about it.
    """

    ready: bool
    says: str


class TrackerScheme(Protocol):
    """All sources of hands whose URLs begin alike."""

    @property
    def form(self) -> str:
        """How its URLs look, for people, such as ``recording:FILE?speed=1&loop=0``."""

    @property
    def help(self) -> str:
        """Where its hands come from, in one sentence."""

    def open(self, rest: str, clock: Timekeeper) -> HandSource:
        """Open the source whose URL has this text after the scheme and the colon.

        Raises
        ------
        ValueError
            If the text is wrong.
        TrackerError
            If nothing answers.
        InputFileError, OSError
            If a file cannot be read.
        """

    def probe(self) -> Readiness:
        """Whether it could be opened, without a URL; this takes a second at most, and disturbs nothing."""


def schemes() -> dict[str, TrackerScheme]:
    """All schemes that are installed and can be loaded, by name."""
    found = {}
    for name in sorted(entries(SCHEMES)):
        try:
            found[name] = _scheme(f"{name}:")
        except TrackerNotFoundError:  # another package's, or one whose extra is not installed
            continue
    return found


def open_hands(url: str, clock: Timekeeper = time) -> HandSource:
    """Open the source of hands that a URL names.

    Parameters
    ----------
    url : str
        A URL such as ``recording:wave.hands``, ``gesture:grasp`` or ``leap:``.
    clock : Timekeeper
        The clock by which frames of recordings and gestures are due; the computer's by default.

    Raises
    ------
    TrackerError
        If the scheme is unknown, or nothing answers.
    ValueError
        If the rest of the URL is wrong.
    InputFileError, OSError
        If it names a file that cannot be read.
    MissingExtraError
        If a package that it needs is not installed.
    """
    if url.startswith("mouse:"):
        raise TrackerNotFoundError("mouse: is the hand of the page in a browser; it cannot be opened here")
    return _scheme(url).open(url.partition(":")[2], clock)


def _scheme(url: str) -> TrackerScheme:
    found: TrackerScheme = load_by_scheme(SCHEMES, url, "tracker", TrackerNotFoundError)
    return found


def files_of(url: str) -> list[Path]:
    """The file that a URL of a source of hands names, which nothing may be written over; none if it names no file."""
    path = Path(unquote(url.partition(":")[2].partition("?")[0]))
    return [path] if path.is_file() else []


def read_options(rest: str, known: Mapping[str, Callable[[str], Any]], form: str) -> tuple[str, dict[str, Any]]:
    """Take apart what follows a scheme's colon: ``WHERE?name=value&name=value``.

    Parameters
    ----------
    rest : str
        The text after the colon.
    known : mapping
        What reads the value of each option; it raises ValueError for a bad one.
    form : str
        How such URLs look, for the error.

    Returns
    -------
    str, dict
        WHERE, and the values by name.

    Raises
    ------
    ValueError
        If an option is unknown, stands twice, or has no or a wrong value.
    """
    where, _, query = rest.partition("?")
    values: dict[str, Any] = {}
    for name, text in parse_qsl(query, keep_blank_values=True, max_num_fields=100):
        if name not in known:
            raise ValueError(f"there is no option {name!r} here; such a URL has the form {form}")
        if name in values:
            raise ValueError(f"option {name!r} stands twice")
        try:
            values[name] = known[name](text)
        except ValueError as error:
            raise ValueError(f"option {name}={text}: {error}; such a URL has the form {form}") from error
    return unquote(where), values


class HandFeed:
    """What all sources have."""

    notes: tuple[str, ...] = ()

    def __init__(self, name: str, rate: float) -> None:
        self.name, self.rate = name, rate
        self.ended = False

    def __iter__(self) -> Self:
        return self

    def close(self) -> None:
        """Stop it."""
        self.ended = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


class PlayedHands(HandFeed):
    """Frames that can be read at any speed, given when they are due.

    Parameters
    ----------
    name : str
        The name for people.
    frames : iterator of HandFrame
        Frames with times that never decrease.
    rate : float
        Frames per second that can be expected.
    clock : Timekeeper
        The clock by which they are due: the first at the first call of `next_frame`.
    close : callable
        A function that is called when the source is closed.
    """

    live = False

    def __init__(
        self,
        name: str,
        frames: Iterator[HandFrame],
        rate: float,
        clock: Timekeeper = time,
        close: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(name, rate)
        self._frames, self._clock, self._close = frames, clock, close
        self._gap = 1 / rate
        self._waiting: HandFrame | None = None
        self._origin: float | None = None

    def close(self) -> None:
        """Stop it, and close what it reads."""
        super().close()
        self._close()

    def _peek(self) -> HandFrame | None:
        """The next frame, which stays the next one; None at the end."""
        if self._waiting is None and not self.ended:
            self._waiting = next(self._frames, None)
            self.ended = self._waiting is None
        return self._waiting

    def __next__(self) -> HandFrame:
        if (frame := self._peek()) is None:
            raise StopIteration
        self._waiting = None
        return frame

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The newest frame that is due, with its time by the clock; see `HandSource`.

        The one after it is looked at if it must be due too by the rate, and else at the next call: to make a frame
        takes time.
        """
        now = self._clock.monotonic()
        until = now + timeout
        newest = None
        while (frame := self._peek()) is not None:
            if self._origin is None:
                self._origin = now - frame.time
            due = self._origin + frame.time
            if due <= now:
                newest = HandFrame(due, frame.hands, frame.number, frame.notes)
                self._waiting = None
                if now < due + self._gap:
                    break
            elif newest is not None or now >= until:
                break
            else:
                self._clock.sleep(min(due, until) - now)
                now = self._clock.monotonic()
        return newest


class LiveHands(HandFeed):
    """Frames that a thread of the source's own receives, for the thread that reads them.

    A source derives from it, starts its thread, and ends that in `close`. The thread calls `put` and `end`.

    Parameters
    ----------
    name : str
        The name for people.
    rate : float
        Frames per second that can be expected.

    Attributes
    ----------
    dropped : int
        Frames that no reader took in time.
    """

    live = True

    def __init__(self, name: str, rate: float) -> None:
        super().__init__(name, rate)
        self.dropped = 0
        self._arrived: deque[HandFrame] = deque()
        self._changed = Condition()
        self._error: TrackerError | None = None
        self._over = False

    def put(self, frame: HandFrame) -> None:
        """Hand over a frame."""
        with self._changed:
            if len(self._arrived) == MOST_WAITING:
                self._arrived.popleft()
                self.dropped += 1
            self._arrived.append(frame)
            self._changed.notify_all()

    def end(self, error: TrackerError | None = None) -> None:
        """Say that no further frame will come, and the error that is the reason; the first reason counts."""
        with self._changed:
            if not self._over:
                self._over, self._error = True, error
            self._changed.notify_all()

    def close(self) -> None:
        """Stop it."""
        super().close()
        self.end()

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The newest frame, after those that came before it are dropped; see `HandSource`."""
        with self._changed:
            self._wait(timeout)
            if not self._arrived:
                return None
            newest = self._arrived.pop()
            self.dropped += len(self._arrived)
            self._arrived.clear()
            return newest

    def __next__(self) -> HandFrame:
        with self._changed:
            self._wait(None)
            if not self._arrived:
                raise StopIteration
            return self._arrived.popleft()

    def _wait(self, timeout: float | None) -> None:
        """Wait for a frame or the end, and raise the error that is the reason of the end."""
        self._changed.wait_for(lambda: self._arrived or self._over, timeout)
        if not self._arrived and self._over:
            self.ended = True
            if self._error is not None:
                raise self._error
