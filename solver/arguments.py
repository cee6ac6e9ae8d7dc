"""Arguments of a wrong type or range: errors that name the argument, its value and what would be right."""

from __future__ import annotations

import math
import reprlib
from numbers import Real
from typing import TypeVar

__all__ = ["check_number", "check_positive", "instance_of"]

Kind = TypeVar("Kind")


def instance_of(value: object, kind: type[Kind], what: str, hint: str) -> Kind:
    """The value; `ValueError` if it is of another kind. ``hint`` ends the message, as in "such as Circle()"."""
    if not isinstance(value, kind):
        raise ValueError(f"{what} is {reprlib.repr(value)}; it must be a {kind.__name__}, {hint}")
    return value


def check_number(value: object, what: str, units: str) -> None:
    """Raise `ValueError` if a value is no real number; ``units`` says of what it must be one."""
    if not isinstance(value, Real):
        raise ValueError(f"{what} is {reprlib.repr(value)}; it must be a number of {units}")


def check_positive(value: float, what: str) -> None:
    """Raise `ValueError` if a length in metres is no number, or not positive and finite."""
    check_number(value, what, "metres")
    if not 0 < value < math.inf:
        raise ValueError(f"{what} {value} m must be positive and finite")
