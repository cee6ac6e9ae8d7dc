"""What the fields of a fault may be, as values that check and explain themselves."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import Annotated, SupportsIndex

from ...protocol.board import BOARDS, CHANNELS_PER_PROCESSOR, PROCESSORS

__all__ = [
    "BoardNumber",
    "ByteBit",
    "Limits",
    "OneOf",
    "Period",
    "Periods",
    "PortBit",
    "ProcessorNumber",
    "Real",
    "Times",
    "Whole",
]


@dataclass(frozen=True)
class Whole:
    """Whole numbers from `least` to `most`, or without end."""

    least: int
    most: int | None = None

    def __contains__(self, value: object) -> bool:
        """Whether a value is one of them."""
        if isinstance(value, bool) or not isinstance(value, SupportsIndex):
            return False
        return self.least <= operator.index(value) and (self.most is None or operator.index(value) <= self.most)

    def __str__(self) -> str:
        """For people."""
        return f"a whole number, {self.least} or more" if self.most is None else f"{self.least} to {self.most}"


@dataclass(frozen=True)
class Real:
    """Numbers from `least` to `most`."""

    least: float
    most: float

    def __contains__(self, value: object) -> bool:
        """Whether a value is one of them."""
        return isinstance(value, int | float) and not isinstance(value, bool) and self.least <= value <= self.most

    def __str__(self) -> str:
        """For people."""
        return f"a number from {self.least:g} to {self.most:g}"


@dataclass(frozen=True)
class OneOf:
    """A few values."""

    values: tuple[int | str, ...]

    def __contains__(self, value: object) -> bool:
        """Whether a value is one of them."""
        return not isinstance(value, bool | float) and value in self.values

    def __str__(self) -> str:
        """For people."""
        return f"one of {', '.join(map(str, self.values))}"


Limits = Whole | Real | OneOf

Period = Annotated[int, Whole(0)]
Periods = Annotated[int, Whole(1)]
Times = Annotated[int, Whole(1, 1_000_000)]
BoardNumber = Annotated[int, Whole(0, BOARDS - 1)]
ProcessorNumber = Annotated[int, Whole(0, PROCESSORS - 1)]
PortBit = Annotated[int, Whole(0, CHANNELS_PER_PROCESSOR - 1)]
ByteBit = Annotated[int, Whole(0, 7)]
