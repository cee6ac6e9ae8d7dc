"""Ctrl-C, SIGTERM and a closed terminal: how they end the program, so that a device is left silent and nothing is said.

It imports next to nothing, for it takes charge before whatever takes long to load.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["SIGNALLED", "loading", "postponing", "unwinding"]

SIGNALLED = 128
"""An exit code is this and the signal's number, as shells have it: 130 is Ctrl-C."""
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
AGAIN_SECONDS = 0.01
"""After this a signal that was lost in a callback comes again; the callback is over then."""
Handler = Callable[[int, FrameType | None], None]


@contextmanager
def loading() -> Iterator[None]:
    """Let a signal end the program at once while modules load, when nothing is open that it could leave behind.

    An exception would do worse: many imports catch it, or lose it in a callback of the interpreter.
    """
    with _handled(lambda number, _frame: os._exit(SIGNALLED + number), last=False):
        yield


@contextmanager
def unwinding(*, last: bool) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and a closed terminal unwind the program, so that it leaves a device silent.

    Only the first of them does: those that follow find it turning outputs off, which they must not interrupt and which
    ends in bounded time. An exception in a callback of the interpreter, such as ``__del__``, is lost: then the signal
    comes again. What was ignored when the program began, as under nohup, stays so.

    Parameters
    ----------
    last : bool
        Whether the program ends after this, so that nothing is left that a signal could interrupt.
    """
    heard: int | None = None

    def unwind(number: int, _frame: FrameType | None) -> None:
        nonlocal heard
        if heard is not None:
            return
        heard = number
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(SIGNALLED + number)

    def lose(unraisable: Any) -> None:
        nonlocal heard
        if heard is None or not issubclass(unraisable.exc_type, (KeyboardInterrupt, SystemExit)):
            before(unraisable)
            return
        import threading

        main = threading.main_thread().ident
        again = threading.Timer(AGAIN_SECONDS, signal.pthread_kill, (main, heard))
        again.daemon = True
        heard = None
        again.start()

    before, sys.unraisablehook = sys.unraisablehook, lose
    try:
        with _handled(unwind, last=last):
            yield
    finally:
        sys.unraisablehook = before


@contextmanager
def postponing() -> Iterator[None]:
    """Let a signal wait until the block ends, which must be short: what it writes is not cut off."""
    waiting: list[int] = []
    with _handled(lambda number, _frame: waiting.append(number), last=False):
        yield
    for number in waiting[:1]:
        signal.raise_signal(number)


@contextmanager
def _handled(handler: Handler, *, last: bool) -> Iterator[None]:
    """Have a handler for the signals that end a program; afterwards what was there before, or at the last nothing."""
    before = {}
    for name in ENDING:
        number = getattr(signal, name, None)  # not every system has them all
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, handled in before.items():
            signal.signal(number, signal.SIG_IGN if last else handled)
