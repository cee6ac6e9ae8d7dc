"""The form of a vector: values of the protocol in plain words, numbers and hexadecimal, as JSON can hold them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import is_dataclass
from enum import Enum, IntFlag
from itertools import groupby
from typing import Any

from ..pulses import Pulses

__all__ = ["Section", "Vector", "plain", "section", "vector"]

Vector = dict[str, Any]
"""One case: its name, what it shows, bytes, and what they mean."""

Section = dict[str, Any]
"""What cases of one kind have in common, and the cases."""


def plain(value: Any) -> Any:
    """A value of the protocol as JSON can hold it: codes by their names, bytes in hexadecimal, pulses in runs."""
    match value:
        case bytes():
            return value.hex()
        case IntFlag():
            unknown = value.value & ~sum(flag.value for flag in type(value))
            return [flag.name for flag in type(value) if flag in value] + ([unknown] if unknown else [])
        case Enum():
            return value.name
        case Pulses():
            return _runs(value)
        case tuple() | list():
            return [plain(item) for item in value]
        case dict():
            return {key: plain(item) for key, item in value.items()}
    if is_dataclass(value):
        return plain(vars(value))
    return value


def _runs(pulses: Pulses) -> list[list[int]]:
    """Pulses as [phase, width, how many in a row]."""
    pairs = zip(pulses.phase.tolist(), pulses.width.tolist(), strict=True)
    return [[*pair, len(list(equal))] for pair, equal in groupby(pairs)]


def vector(name: str, shows: str, **rest: Any) -> Vector:
    """A case, with everything in it made plain."""
    return {"name": name, "shows": shows} | {key: plain(value) for key, value in rest.items()}


def section(about: str, vectors: Iterable[Vector]) -> Section:
    """Cases of one kind under what they have in common."""
    return {"about": about, "vectors": list(vectors)}
