"""What happens inside the device, kept while somebody watches: spans of time on lanes, and signals.

The parts of the device tell a tracer what they do; it asks nothing of them, and nothing depends on it. Times are core
cycles since the beginning of period 0.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from operator import itemgetter
from typing import NamedTuple

from ..protocol.chain import Message, decode

__all__ = ["Signal", "Span", "Tracer"]

UNKNOWN = "x"
_SIGNAL_NAME = re.compile(r"([A-Za-z_]\w*\.)+[A-Za-z_]\w*", re.ASCII)
KEPT = 100_000
"""Spans, and values of each signal; older ones are forgotten."""


class Span(NamedTuple):
    """A stretch of time in which something is busy."""

    begins: int
    """Core cycles since the beginning of period 0."""
    ends: int
    lane: str
    """What is busy. Lanes that differ in a number at their end, such as ``link 3``, belong together."""
    label: str
    """With what; its first word is the kind: ``slice 3``."""

    @property
    def kind(self) -> str:
        """The first word of the label."""
        return self.label.split()[0]


class Signal(NamedTuple):
    """Something inside the device that changes with time."""

    name: str
    """Scopes and name with dots between, such as ``board0.processor1.mailbox``."""
    width: int
    """In bits."""
    changes: Sequence[tuple[int, int]]
    """Core cycles since the beginning of period 0, ascending, and the value from there on; unknown before the first."""

    def check(self) -> None:
        """Raise `ValueError` if this is no signal."""
        if not _SIGNAL_NAME.fullmatch(self.name):
            raise ValueError(f"{self.name!r} names no signal; scopes and a name, such as controller.state")
        if self.width < 1:
            raise ValueError(f"signal {self.name} has {self.width} bits; at least 1")
        before = None
        for cycle, value in self.changes:
            if before is not None and cycle <= before:
                raise ValueError(f"signal {self.name} changes at cycle {cycle} after {before}; cycles ascend")
            if not 0 <= value < 2**self.width:
                raise ValueError(f"signal {self.name} is {value} at cycle {cycle}; it has {self.width} bits")
            before = cycle

    def value_at(self, cycle: int) -> int | str:
        """What it is at a core cycle."""
        behind = bisect_right(self.changes, cycle, key=itemgetter(0))
        return self.changes[behind - 1][1] if behind else UNKNOWN


class Tracer:
    """Keeps the newest spans and signals from the time on that it watches."""

    def __init__(self) -> None:
        self.watching = False
        self.origin = 0
        """Core cycle at which period 0 began."""
        self._spans: deque[Span] = deque(maxlen=KEPT)
        self._open: dict[str, Span] = {}
        self._signals: dict[str, tuple[int, deque[tuple[int, int]]]] = {}

    def begin_anew(self, origin: int) -> None:
        """Another period 0 begins: what was kept counted from the one before."""
        self.origin = origin
        self._spans.clear()
        self._open.clear()
        self._signals.clear()

    def span(self, begins: int, ends: int, lane: str, label: str) -> None:
        """Something was or will be busy from one core cycle to another."""
        if self.watching and ends > begins:
            self._spans.append(Span(begins - self.origin, ends - self.origin, lane, label))

    def begin(self, cycle: int, lane: str, label: str) -> None:
        """Something becomes busy, until `end` or until it is said to begin again."""
        if self.watching:
            self.end(cycle, lane)
            self._open[lane] = Span(cycle - self.origin, cycle - self.origin, lane, label)

    def end(self, cycle: int, lane: str) -> None:
        """It is busy no more."""
        if (begun := self._open.pop(lane, None)) is not None and cycle - self.origin > begun.begins:
            self._spans.append(begun._replace(ends=cycle - self.origin))

    def value(self, cycle: int, name: str, width: int, value: int) -> None:
        """A signal of so many bits has a value from a core cycle on."""
        if not self.watching:
            return
        _, changes = self._signals.setdefault(name, (width, deque(maxlen=KEPT)))
        at = cycle - self.origin
        if changes and changes[-1][0] == at:
            changes.pop()
        if not changes or changes[-1][1] != value:
            changes.append((at, value))

    def passed(self, sent: Message | bytes, spans: Iterable[tuple[int, int | None, int | None]]) -> None:
        """A message, or the tokens of one, was sent, and holds each link from one core cycle to another."""
        if self.watching:
            message = sent if isinstance(sent, Message) else decode(sent)
            label = f"{type(message).__name__.lower()} {getattr(message, 'processor', message.node)}"
            for link, begins, ends in spans:
                if begins is not None and ends is not None:
                    self.span(begins, ends, f"link {link}", label)

    def spans(self, now: int) -> list[Span]:
        """What was busy so far, and what still is."""
        at = now - self.origin
        going_on = [span._replace(ends=at) for span in self._open.values() if span.begins < at]
        return sorted([*self._spans, *going_on])

    def signals(self) -> list[Signal]:
        """All signals, by name."""
        return [Signal(name, width, tuple(changes)) for name, (width, changes) in sorted(self._signals.items())]
