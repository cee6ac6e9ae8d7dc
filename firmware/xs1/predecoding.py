"""Compiled decoding: the same look-ups as `encoding.decode`, for a whole memory, and for half words that change.

numba compiles these functions at their first call. They do not check bounds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.compiling import kernel, part
from .encoding import ILLEGAL, LONG, PREFIX, Tables, tables
from .encoding import split as _split_plain

__all__ = ["decode_pair", "predecode", "predecode_all", "redecode"]

_split = part(_split_plain)


def predecode(memory: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Decode the instruction at every half word of a memory; compiled.

    Parameters
    ----------
    memory : (n,) uint8
        n is even.

    Returns
    -------
    words : (n / 2,) int64
        Bits 0 to 7 are the code, or `ILLEGAL`; a to f follow with 4 bits each; bits 32 to 34 are the size in bytes.
    imm : (n / 2,) int32
        As in `Decoded`.

    Notes
    -----
    After a store into code decode that half word and the one before it again, by `redecode`.
    """
    words, imm = np.empty(len(memory) // 2, np.int64), np.empty(len(memory) // 2, np.int32)
    predecode_all(tables(), memory.view("<u2").astype(np.uint16, copy=False), words, imm)
    return words, imm


@part
def decode_pair(tables: Tables, low: int, high: int) -> tuple[int, int]:
    """Decode two half words, for kernels.

    Parameters
    ----------
    tables : Tables
    low, high : int
        Plain integers, not of 16 bits.

    Returns
    -------
    word : int
        As `predecode` returns it.
    imm : int
    """
    word, imm = tables.short[low], int(tables.imm[low])
    if word & 255 != ILLEGAL:
        return word, imm
    if low >> 10 == PREFIX:
        word = tables.short[high]
        bits = int(tables.bits[word & 255])
        if bits == 0:
            return ILLEGAL, 0
        return word + (2 << 32), ((low & 1023) << bits | high & (1 << bits) - 1) * int(tables.scale[word & 255])
    if low >> 11 != LONG:
        return ILLEGAL, 0
    first, count = _split(low)
    if count == 0:
        return ILLEGAL, 0
    word = tables.three[high] if count == 3 else tables.two[low >> 4 & 1, high]
    if word & 255 == ILLEGAL:
        return ILLEGAL, 0
    word |= first
    field = word >> 16 & 15
    last = tables.last[word & 255]
    return word, 0 if last == 0 else field if last == 1 else int(tables.positions[field])


@kernel
def predecode_all(tables: Tables, halves: NDArray[np.uint16], words: NDArray[np.int64], imm: NDArray[np.int32]) -> None:
    """Decode every half word of a memory.

    Parameters
    ----------
    tables : Tables
    halves : (n,) uint16
        The memory. A long instruction whose second half would lie after its end is illegal.
    words, imm : (n,) int64 and int32
        Become what `predecode` returns.
    """
    for index in range(len(halves)):
        redecode(tables, halves, words, imm, index)


@part
def redecode(tables: Tables, halves: Any, words: Any, imm: Any, index: int) -> None:
    """Decode the instruction at one half word, for kernels that store into code.

    Parameters
    ----------
    tables : Tables
    halves, words, imm
        As for `predecode_all`.
    index : int
        The index of the half word. After a store call it for the changed half words and the one before the first of
        them.
    """
    high = int(halves[index + 1]) if index + 1 < len(halves) else 0xFFFF  # which completes no instruction
    words[index], imm[index] = decode_pair(tables, int(halves[index]), high)
