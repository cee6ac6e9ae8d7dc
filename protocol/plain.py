"""Values of the protocol as JSON can hold them: plain words, numbers and hexadecimal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass
from enum import Enum, IntFlag
from itertools import groupby
from typing import Any

import numpy as np

from .pulses import Pulses

__all__ = ["flag_names", "plain", "runs"]


def flag_names(flags: IntFlag) -> str:
    """The names of the flags that are set, with commas between; nothing if none is."""
    return ", ".join(flag.name or "" for flag in flags)


def runs(pulses: Pulses) -> list[list[int]]:
    """Pulses as [phase, width, how many in a row]."""
    pairs = zip(pulses.phase.tolist(), pulses.width.tolist(), strict=True)
    return [[*pair, len(list(equal))] for pair, equal in groupby(pairs)]


def plain(value: Any, pulses: Callable[[Pulses], Any] = runs) -> Any:
    """A value with codes by their names, flags as lists of names, bytes in hexadecimal, and fields in mappings.

    Parameters
    ----------
    value : object
        A number, a text, a code, bytes, pulses, an array, a dataclass, or a list or mapping of these.
    pulses : callable
        What becomes of pulses.
    """
    match value:
        case bytes():
            return value.hex()
        case IntFlag():
            unknown = value.value & ~sum(flag.value for flag in type(value))
            return [flag.name for flag in type(value) if flag in value] + ([unknown] if unknown else [])
        case Enum():
            return value.name
        case Pulses():
            return pulses(value)
        case np.ndarray():
            return value.tolist()
        case tuple() | list():
            return [plain(item, pulses) for item in value]
        case dict():
            return {key: plain(item, pulses) for key, item in value.items()}
    return plain(vars(value), pulses) if is_dataclass(value) else value
