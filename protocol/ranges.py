"""Whole numbers within limits, for the values that check themselves when they are made."""

from __future__ import annotations

import operator
from typing import Any

__all__ = ["whole"]


def whole(name: str, value: Any, least: int, most: int) -> int:
    """A whole number from `least` to `most`, as an int.

    Raises
    ------
    TypeError
        If it is no whole number.
    ValueError
        If it is outside; the error has its name.
    """
    number = operator.index(value)
    if not least <= number <= most:
        raise ValueError(f"{name} {number} is outside {least} to {most}")
    return number
