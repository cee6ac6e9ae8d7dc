"""Sources of hands that are opened again when their tracker was lost, as one that restarts."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from threading import Event, Thread

from ...base.errors import TrackerError, TrackerLostError
from ..transports.transport import Timekeeper
from .frames import HandFrame
from .sources import HandFeed, HandSource, open_hands

__all__ = ["open_returning"]

PAUSE = 1.0
"""Seconds between two attempts."""


def open_returning(
    url: str, clock: Timekeeper = time, on_loss: Callable[[TrackerLostError], object] = lambda _: None
) -> HandSource:
    """Open a source of hands that outlives losses of its tracker; while that is away, no frames come.

    Parameters
    ----------
    url, clock
        As for `open_hands`, whose errors it raises. A source that is not live cannot be lost.
    on_loss : callable, optional
        A function that is called with the reason of each loss.
    """
    source = open_hands(url, clock)
    return _ReturningHands(source, partial(open_hands, url, clock), on_loss) if source.live else source


class _ReturningHands(HandFeed):
    live = True

    def __init__(
        self, source: HandSource, reopen: Callable[[], HandSource], on_loss: Callable[[TrackerLostError], object]
    ) -> None:
        super().__init__(source.name, source.rate)
        self._reopen, self._on_loss = reopen, on_loss
        self._source: HandSource | None = source
        self._failure: Exception | None = None
        self._back, self._closed = Event(), Event()

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The newest frame; None while the tracker is away. See `HandSource`."""
        if self._failure is not None:
            raise self._failure
        if (source := self._source) is None:
            self._back.wait(timeout)
            return None
        try:
            frame = source.next_frame(timeout)
        except TrackerLostError as error:
            self._on_loss(error)
            self._source = None
            self._back.clear()
            Thread(target=self._return, args=(source,), name="returning hands", daemon=True).start()
            return None
        self.notes, self.rate, self.ended = source.notes, source.rate, source.ended
        return frame

    def __next__(self) -> HandFrame:
        while not self.ended:
            if (frame := self.next_frame(PAUSE)) is not None:
                return frame
        raise StopIteration

    def close(self) -> None:
        """Stop it."""
        super().close()
        self._closed.set()
        if (source := self._source) is not None:
            source.close()

    def _return(self, lost: HandSource) -> None:
        """Open it again, in a thread of its own: the outputs must fall silent meanwhile, and closing may wait."""
        lost.close()
        while not self._closed.wait(PAUSE):
            try:
                source = self._reopen()
            except TrackerError:  # it is still away
                continue
            except Exception as error:  # a file that it needs is gone
                self._failure = error
                break
            self._source = source
            if self._closed.is_set():
                source.close()
            break
        self._back.set()
