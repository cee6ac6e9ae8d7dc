"""Numbers of 32 bits that wrap, compared as in RFC 1982: of blocks (SPEC.md, chapter NUM) and of boot records."""

from __future__ import annotations

import operator

__all__ = ["follows", "missing", "successor"]

_MODULUS = 2**32
_AHEAD = 2**31


def successor(number: int) -> int:
    """The next number (clause NUM-001)."""
    return (operator.index(number) + 1) % _MODULUS


def follows(number: int, last: int) -> bool:
    """Whether a number comes after another, up to 2³¹ − 1 ahead of it round the wrap (clause NUM-002)."""
    return 0 < (operator.index(number) - operator.index(last)) % _MODULUS < _AHEAD


def missing(number: int, last: int) -> int:
    """How many numbers were left out between one and another that follows it (clause NUM-003)."""
    return (operator.index(number) - operator.index(last)) % _MODULUS - 1
