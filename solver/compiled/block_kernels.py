"""The Gram matrix by blocks, for a transfer matrix that does not fit the cache; blocks are shared among threads.

It takes most of the time of a big problem. `algebra.fill_gram` reads every row of B again for every two others; here
a panel of columns is copied, so that it lies together, and used up block by block before the next. `begin` does
what `updates.begin` does, and is tested against it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .algebra import enter, products
from .layout import F, _kernel, _part, carve
from .simd import LANES, load, store
from .threads import share
from .updates import align, weigh_all

__all__ = ["BLOCKED_PAIRS", "begin"]

BLOCKED_PAIRS = 250_000
"""Points · transducers from which on the blocks are faster than `algebra.fill_gram`: 2 MB of B. By
``benchmarks/scaling.py``, on a core with 1 MB of second-level cache, they are there as fast with 1024 transducers, 1.3
times as fast with 4096, and over 3 times at 17 million. OpenBLAS's cherk is 0.4 times as fast as they are."""

BLOCK, DEPTH = 64, 512
"""Rows and columns of a block, 256 KB: two of them stay in the second-level cache."""


@_part
def _add_block(re: Any, im: Any, i0: int, j0: int, depth: int, is_last: bool, gram_re: Any, gram_im: Any) -> None:
    """Add to the block of G at (i0, j0), j0 ≤ i0, what the columns of a panel contribute, and mirror the last sum."""
    rows = len(re)
    for i in range(i0, min(i0 + BLOCK, rows), 2):
        for j in range(j0, min(j0 + BLOCK, i + 2), 2):
            r00, r01, r10, r11, s00, s01, s10, s11 = products(re, im, i, j, depth)
            r00, r01, r10, r11 = (
                r00 + gram_re[i, j], r01 + gram_re[i, j + 1], r10 + gram_re[i + 1, j], r11 + gram_re[i + 1, j + 1]
            )  # fmt: skip
            s00, s01, s10, s11 = (
                s00 + gram_im[i, j], s01 + gram_im[i, j + 1], s10 + gram_im[i + 1, j], s11 + gram_im[i + 1, j + 1]
            )  # fmt: skip
            if is_last:
                enter(gram_re, gram_im, i, j, r00, s00)
                enter(gram_re, gram_im, i, j + 1, r01, s01)
                enter(gram_re, gram_im, i + 1, j, r10, s10)
                enter(gram_re, gram_im, i + 1, j + 1, r11, s11)
            else:
                gram_re[i, j], gram_re[i, j + 1], gram_re[i + 1, j], gram_re[i + 1, j + 1] = r00, r01, r10, r11
                gram_im[i, j], gram_im[i, j + 1], gram_im[i + 1, j], gram_im[i + 1, j + 1] = s00, s01, s10, s11


@_kernel
def weigh_points(m: int, columns: int, gamma: Any, work: Any) -> None:
    """From the transfer matrix to B, see `weigh_all`, and zeros in G."""
    weigh_all(m, columns, gamma, work)
    parts = carve(work, m, columns)
    gram_re, gram_im = parts.gram_re, parts.gram_im  # numba forgets what is written to a part by its name
    for i in range(len(gram_re)):
        for j in range(len(gram_re)):
            gram_re[i, j] = gram_im[i, j] = F(0)


@_kernel
def add_blocks(m: int, columns: int, first: int, stride: int, work: Any) -> None:
    """Every ``stride``-th block of G from ``first`` on; G is 0 before."""
    parts = carve(work, m, columns)
    re, im = parts.re, parts.im
    rows = len(re)
    panel_re, panel_im = np.empty((rows, DEPTH), np.float32), np.empty((rows, DEPTH), np.float32)
    for low in range(0, columns, DEPTH):
        depth = min(DEPTH, columns - low)
        for i in range(rows):
            for q in range(0, depth, LANES):
                store(panel_re, i, q, load(re, i, low + q))
                store(panel_im, i, q, load(im, i, low + q))
        block = 0
        for i in range(0, rows, BLOCK):
            for j in range(0, i + 1, BLOCK):
                if block % stride == first:
                    _add_block(panel_re, panel_im, i, j, depth, low + depth == columns, parts.gram_re, parts.gram_im)
                block += 1


@_kernel
def align_points(m: int, columns: int, phase_steps: int, power: bool, u: Any, work: Any) -> None:
    """From G to the phases u; see `align`."""
    align(m, columns, phase_steps, power, u, work)


def begin(
    m: int, columns: int, gamma: Any, phase_steps: int, power: bool, u: Any, work: Any, *, threads: int = 1
) -> None:
    """What `updates.begin` does, with the same bits for any number of threads.

    Each thread copies a panel of m · `DEPTH` columns at a time, 4 MB at 1024 points.
    """
    weigh_points(m, columns, gamma, work)
    share(lambda first: add_blocks(m, columns, first, threads, work), threads)
    align_points(m, columns, phase_steps, power, u, work)
