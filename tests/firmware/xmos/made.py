"""Pulses and words for the tests of the firmware, written from the clauses alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def pack(phases: NDArray[np.int64], widths: NDArray[np.int64]) -> bytes:
    """32 pulses (PUL-005)."""
    codes = phases | widths << 7
    return sum(int(code) << 12 * place for place, code in enumerate(codes)).to_bytes(48, "little")


def random_slice(rng: np.random.Generator) -> bytes:
    return pack(rng.integers(0, 100, 32), rng.integers(0, 26, 32))


def modulated(width: int, sample: int) -> int:
    """PUL-006."""
    return math.floor(50 / math.pi * math.asin(sample / 255 * math.sin(math.pi * width / 50)) + 0.5)


def literal_words(packed: bytes, sample: int = 255) -> NDArray[np.uint32]:
    """The 50 words of a period (PUL-004)."""
    words = np.zeros(50, np.uint32)
    pulses = int.from_bytes(packed, "little")
    for bit in range(32):
        code = pulses >> 12 * bit & 0xFFF
        phase, width = code & 127, modulated(code >> 7, sample)
        for tick in range(width):
            words[((phase - width) // 2 + tick) % 50] |= np.uint32(1 << bit)
    return words
