"""Compiled kernels of the time domain: many resonators rung by bits, and the delayed sum of their waves.

They see plain arrays that the caller prepares and checks. The first does what `resonator.OnePole.ring` does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from ..compiling import kernel

__all__ = ["WORD_BITS", "ring", "sum_delayed"]

WORD_BITS = 32
FAST = {"contract", "nsz", "nnan", "ninf", "reassoc"}

Function = TypeVar("Function", bound=Callable[..., Any])


def _fast_kernel(function: Function) -> Function:
    return kernel(function, fastmath=FAST)


@kernel
def ring(words: Any, drives: Any, decay: Any, rate: Any, before: Any, state: Any, re: Any, im: Any) -> None:
    """Ring one resonator for each bit of some words.

    Parameters
    ----------
    words : (t, w) uint32
        Levels in each step; bit b of word v is resonator 32·v + b.
    drives : (2, 2) float64
        The drive in a step, by the level in the step before (row) and in this one (column).
    decay, rate : complex128
        z ← decay·z + rate·drive.
    before : (w,) uint32
        Levels in the step before the first; afterwards, in the last.
    state : (32 w,) complex128
        Before the first step; afterwards, after the last.
    re, im : (32 w, t) float32
        Written: the states at the beginning of each step.
    """
    steps = words.shape[0]
    for q in range(state.size):
        word, bit = q // WORD_BITS, np.uint32(q % WORD_BITS)
        z, earlier = state[q], before[word] >> bit & np.uint32(1)
        for step in range(steps):
            now = words[step, word] >> bit & np.uint32(1)
            re[q, step], im[q, step] = z.real, z.imag
            z = decay * z + rate * drives[earlier, now]
            earlier = now
        state[q] = z
    if steps:
        before[:] = words[steps - 1]


@_fast_kernel
def sum_delayed(re: Any, im: Any, first: Any, here: Any, following: Any, total: Any) -> None:
    """Add up waves that arrive after different times: the real part of Σ_q here·z[q, c] + following·z[q, c + 1].

    Parameters
    ----------
    re, im : (n, columns) float32
        States z; like `total` contiguous, or the loop is no fast one.
    first : (k, n) int64
        For each point and source the column c that counts for the first sample; it moves on by one a sample.
    here, following : (k, n) complex64
    total : (k, t) float32
        Written.
    """
    samples = total.shape[1]
    for i in range(total.shape[0]):
        total[i] = np.float32(0)
        for q in range(re.shape[0]):
            c, a, b = first[i, q], here[i, q], following[i, q]
            ar, ai, br, bi = a.real, a.imag, b.real, b.imag
            if ar == 0 and ai == 0 and br == 0 and bi == 0:
                continue
            x, y, row = re[q, c : c + samples + 1], im[q, c : c + samples + 1], total[i]
            for k in range(samples):
                row[k] += ar * x[k] - ai * y[k] + br * x[k + 1] - bi * y[k + 1]
