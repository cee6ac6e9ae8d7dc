"""Ctrl-C, SIGTERM and a closed terminal: how they end the program quietly and leave a device silent.

It imports almost nothing, because it must be ready before slow modules load.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from types import FrameType
from typing import Any

__all__ = ["SIGNALLED", "loading", "postponing", "unwinding"]

SIGNALLED = 128
"""An exit code is this plus the signal's number, as in shells: 130 is Ctrl-C."""
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
DEAF_SECONDS = 3.0
"""After a signal others are ignored for this time: more than it takes to turn the outputs off."""
AGAIN_SECONDS = 0.01
"""A signal that was lost in a callback is repeated after this time, when the callback has ended."""
Handler = Callable[[int, FrameType | None], None]


@contextmanager
def loading() -> Iterator[None]:
    """Let a signal end the program at once while modules load, when nothing is open yet.

    An exception would be worse: many imports catch it, or lose it in a callback of the interpreter.
    """
    with _handled(lambda number, _frame: os._exit(SIGNALLED + number), last=False):
        yield


@contextmanager
def unwinding(*, last: bool) -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and a closed terminal unwind the program, so that it leaves a device silent.

    Signals soon after the first are ignored: they find it turning outputs off, which must not be interrupted. Later
    ones count, since an exception may be lost: in a callback of the interpreter, such as ``__del__``, after which the
    signal is repeated, or in a library. Signals that were ignored when the program began, as under nohup, stay ignored.

    Parameters
    ----------
    last : bool
        Whether the program ends after this, so that no signal can interrupt anything more.
    """
    heard: int | None = None
    deaf_until = 0.0

    def unwind(number: int, _frame: FrameType | None) -> None:
        nonlocal heard, deaf_until
        if monotonic() < deaf_until:
            return
        heard, deaf_until = number, monotonic() + DEAF_SECONDS
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(SIGNALLED + number)

    def lose(unraisable: Any) -> None:
        nonlocal deaf_until
        if heard is None or not issubclass(unraisable.exc_type, (KeyboardInterrupt, SystemExit)):
            before(unraisable)
            return
        import threading

        main = threading.main_thread().ident
        again = threading.Timer(AGAIN_SECONDS, signal.pthread_kill, (main, heard))
        again.daemon = True
        deaf_until = 0.0
        again.start()

    before, sys.unraisablehook = sys.unraisablehook, lose
    try:
        with _handled(unwind, last=last):
            yield
    finally:
        sys.unraisablehook = before


@contextmanager
def postponing() -> Iterator[None]:
    """Delay signals until the block ends, which must be short: its output is not cut off."""
    waiting: list[int] = []
    with _handled(lambda number, _frame: waiting.append(number), last=False):
        yield
    for number in waiting[:1]:
        signal.raise_signal(number)


@contextmanager
def _handled(handler: Handler, *, last: bool) -> Iterator[None]:
    """Install a handler for the signals that end a program; afterwards restore the earlier one, or at the end none."""
    before = {}
    for name in ENDING:
        number = getattr(signal, name, None)  # some systems lack some of them
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, handled in before.items():
            signal.signal(number, signal.SIG_IGN if last else handled)
