"""A thread that does the newest of what it is given."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from threading import Event, Thread

__all__ = ["NewestTask"]

_log = logging.getLogger(__name__)


class NewestTask:
    """Does one task at a time in a thread of its own, which has a name; of those that wait only the newest is kept.

    ``on_error`` is called there with an exception of a task; the next task is done all the same.
    """

    def __init__(self, name: str, on_error: Callable[[Exception], None]) -> None:
        self._on_error = on_error
        self._waiting: deque[Callable[[], None]] = deque(maxlen=1)
        self._changed, self._closing = Event(), Event()
        self._thread = Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def offer(self, task: Callable[[], None]) -> None:
        """Do this next, instead of a task that waits."""
        self._waiting.append(task)
        self._changed.set()

    def close(self) -> None:
        """Do what waits, and end."""
        self._closing.set()
        self._changed.set()
        self._thread.join()

    def _work(self) -> None:
        while True:
            self._changed.wait()
            self._changed.clear()
            closing = self._closing.is_set()  # before looking: what is offered later is not waited for
            while self._waiting:
                self._do(self._waiting.popleft())
            if closing:
                return

    def _do(self, task: Callable[[], None]) -> None:
        try:
            task()
        except Exception as error:
            _log.exception("%s", self._thread.name)
            self._on_error(error)
