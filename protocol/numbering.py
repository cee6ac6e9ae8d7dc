"""Numbers of 32 bits that wrap, compared as in RFC 1982: of blocks (SPEC.md, chapter NUM) and of boot records.

The emulator compiles `follows` and `missing` for many blocks (`emulator.control.batch_kernels`).
"""

from __future__ import annotations

__all__ = ["follows", "missing", "successor"]

_MODULUS = 2**32
_AHEAD = 2**31


def successor(number: int) -> int:
    """The next number (clause NUM-001)."""
    return (int(number) + 1) % _MODULUS


def follows(number: int, last: int) -> bool:
    """Whether a number comes after another, up to 2³¹ − 1 ahead of it round the wrap (clause NUM-002)."""
    return 0 < (int(number) - int(last)) % _MODULUS < _AHEAD


def missing(number: int, last: int) -> int:
    """How many numbers were left out between one and another that follows it (clause NUM-003)."""
    return (int(number) - int(last)) % _MODULUS - 1
