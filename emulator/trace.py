"""What happens inside the device, as spans of time on named lanes and as the values of signals."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from ..protocol.chain import Message
from .links import Span as LinkSpan

__all__ = ["Span", "Tracer"]

KEPT = 100_000


class Span(NamedTuple):
    """Something that took a while."""

    begin: int
    """Core cycle."""
    end: int
    lane: str
    """Where."""
    what: str


class Tracer:
    """Keeps the newest spans and values, where it was told to watch."""

    def __init__(self) -> None:
        self.watching = False
        self.spans: deque[Span] = deque(maxlen=KEPT)
        self.values: dict[str, deque[tuple[int, int]]] = {}

    def span(self, begin: int, end: int, lane: str, what: str) -> None:
        """Something took from one core cycle to another."""
        if self.watching:
            self.spans.append(Span(begin, end, lane, what))

    def value(self, cycle: int, signal: str, value: int) -> None:
        """A signal has a value from a core cycle on."""
        if self.watching:
            self.values.setdefault(signal, deque(maxlen=KEPT)).append((cycle, value))

    def passed(self, message: Message, spans: Sequence[LinkSpan]) -> None:
        """A message was sent: how long it holds each link."""
        if self.watching:
            name = type(message).__name__.lower()
            whom = getattr(message, "processor", message.node)
            for link, begins, ends in spans:
                if begins is not None and ends is not None:
                    self.spans.append(Span(begins, ends, f"link {link}", f"{name} {whom}"))
