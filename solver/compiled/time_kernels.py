"""Compiled kernels of the time domain: many resonators rung by bits, and the delayed sum of their waves.

They see plain arrays that the caller prepares and checks; they do not check indices. `ring` does what
`resonator.OnePole.ring` does. Time is in steps, and a state between two of them is the sum of both, weighted; see
`resonator.OnePole.between`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from ...base.compiling import kernel, part
from .simd import LANES, load, spread, store

__all__ = ["POINTS_AT_ONCE", "WORD_BITS", "place_envelopes", "place_waves", "ring", "sum_bursts", "write_drives"]

WORD_BITS = 32
POINTS_AT_ONCE = 4
"""Points that `sum_bursts` reads a wave for at once."""
FAST = {"contract", "nsz", "nnan", "ninf", "reassoc"}

Function = TypeVar("Function", bound=Callable[..., Any])


def _fast_kernel(function: Function) -> Function:
    return kernel(function, fastmath=FAST)


@kernel
def ring(words: Any, drives: Any, decay: Any, rate: Any, before: Any, state: Any, states: Any) -> None:
    """Ring one resonator for each bit of some words: bit b of word v is resonator 32·v + b.

    ``words`` (t, w) are the levels in each step, and ``before`` (w,) those in the step before. The drive in a step is
    ``drives[level in the step before, level in this one]``, and z ← decay·z + rate·drive. ``state`` (32 w,) is that
    before the first step; afterwards that after the last. ``states`` (32 w, t + 1) is written: the states at the
    beginning of each step, and at the end of the last.
    """
    steps = words.shape[0]
    for q in range(state.size):
        word, bit = q // WORD_BITS, np.uint32(q % WORD_BITS)
        z, earlier = state[q], before[word] >> bit & np.uint32(1)
        for step in range(steps):
            now = words[step, word] >> bit & np.uint32(1)
            states[q, step] = z
            z = decay * z + rate * drives[earlier, now]
            earlier = now
        states[q, steps] = z
        state[q] = z


@kernel
def write_drives(words: Any, drives: Any, before: Any, rows: Any, written: Any) -> None:
    """Write out the drive of each bit of some words, see `ring`, into its row of ``written`` (32 w, t)."""
    for q in range(rows.size):
        word, bit = q // WORD_BITS, np.uint32(q % WORD_BITS)
        row, earlier = written[rows[q]], before[word] >> bit & np.uint32(1)
        for step in range(words.shape[0]):
            now = words[step, word] >> bit & np.uint32(1)
            row[step] = drives[earlier, now]
            earlier = now


@_fast_kernel
def place_waves(
    points: Any, sources: Any, arrival: Any, rate: float, turn: float, weight: Any, lag: Any, here: Any, following: Any
) -> None:
    """Delays and weights with which points (k, 3) receive the real waves of sources (n, 3), in metres.

    ``arrival`` (k, n) is the wave that arrives, without the phase of its path; a phase that is more than a sign is
    taken for a delay. ``rate`` is in steps per metre, ``turn`` in steps per radian. ``weight`` (d,) are the ascending
    coefficients of the weight of the following state, a polynomial in the part of a step that has passed. Written, (k,
    n) each: ``lag`` in whole steps, rounded up, and the weights of the state so many steps ago and of the one after it.
    """
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for q in range(sources.shape[0]):
            dx, dy, dz = x - sources[q, 0], y - sources[q, 1], z - sources[q, 2]
            re, im = float(arrival[i, q].real), float(arrival[i, q].imag)
            gain = math.hypot(re, im) * (-1 if re < 0 else 1)
            late = math.atan2(-im if re < 0 else im, abs(re)) if im != 0 else 0.0
            delay = rate * math.sqrt(dx * dx + dy * dy + dz * dz) + turn * late
            whole = math.ceil(delay)
            passed, ahead = whole - delay, 0j
            for power in range(weight.size - 1, -1, -1):
                ahead = ahead * passed + weight[power]
            lag[i, q] = int(whole)
            here[i, q], following[i, q] = np.complex64(gain * (1 - ahead)), np.complex64(gain * ahead)


@_fast_kernel
def place_envelopes(
    points: Any, sources: Any, arrival: Any, rate: float, weight: Any, fields: Any, first: int, re: Any, im: Any
) -> None:
    """Delays and weights with which points receive envelopes that each drive a field of sources.

    See `place_waves`; a step is a period of the carrier. ``fields`` (2, n, r) is the factor, real and imaginary part,
    that makes each of r envelopes the drive of each source. Written, (k, lags, r) each: ``re`` and ``im``, the weights
    of the envelopes so many steps ago, from ``first`` on.
    """
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        re[i], im[i] = np.float32(0), np.float32(0)
        for q in range(sources.shape[0]):
            dx, dy, dz = x - sources[q, 0], y - sources[q, 1], z - sources[q, 2]
            delay = rate * math.sqrt(dx * dx + dy * dy + dz * dz)
            whole = math.ceil(delay)
            passed, ahead = whole - delay, 0j
            for power in range(weight.size - 1, -1, -1):
                ahead = ahead * passed + weight[power]
            wave = complex(arrival[i, q]) * complex(math.cos(2 * math.pi * passed), -math.sin(2 * math.pi * passed))
            column = int(whole) - first
            for at, share in ((column, wave * (1 - ahead)), (column - 1, wave * ahead)):
                a, b = np.float32(share.real), np.float32(share.imag)
                for r in range(fields.shape[2]):
                    u, v = fields[0, q, r], fields[1, q, r]
                    re[i, at, r] += a * u - b * v
                    im[i, at, r] += a * v + b * u


@part
def _spread(here: Any, following: Any) -> Any:
    """Factors of the real and imaginary parts of two states, for the real part of their weighted sum."""
    return spread(here.real), spread(-here.imag), spread(following.real), spread(-following.imag)


@part
def _add(total: Any, row: int, column: int, vector: Any) -> None:
    store(total, row, column, load(total, row, column) + vector)


@_fast_kernel
def sum_bursts(waves: Any, lag: Any, here: Any, following: Any, total: Any) -> None:
    """Add up waves that begin alike and arrive after different times; for several such sets of waves.

    ``waves`` (4, r n, t) are, for each set and source, the states at the beginning of each step, real and imaginary
    parts, and at its end; t is filled up with zeros to a multiple of `LANES`. ``lag``, ``here`` and ``following`` are
    those of `place_waves`, the lags from the first column of ``total``; k is a multiple of `POINTS_AT_ONCE`. ``total``
    (k r, columns) is written; it has room for t steps after the greatest lag.
    """
    re, im, next_re, next_im = waves[0], waves[1], waves[2], waves[3]
    points, sources = lag.shape
    sets = re.shape[0] // sources
    total[:] = np.float32(0)
    for r in range(sets):
        for i in range(0, points, POINTS_AT_ONCE):
            k, m, n = i + 1, i + 2, i + 3
            for q in range(sources):
                s0, t0, u0, v0 = _spread(here[i, q], following[i, q])
                s1, t1, u1, v1 = _spread(here[k, q], following[k, q])
                s2, t2, u2, v2 = _spread(here[m, q], following[m, q])
                s3, t3, u3, v3 = _spread(here[n, q], following[n, q])
                c0, c1, c2, c3 = lag[i, q], lag[k, q], lag[m, q], lag[n, q]
                wave = r * sources + q
                for at in range(0, re.shape[1], LANES):
                    a, b = load(re, wave, at), load(im, wave, at)
                    c, d = load(next_re, wave, at), load(next_im, wave, at)
                    _add(total, i * sets + r, c0 + at, a * s0 + b * t0 + c * u0 + d * v0)
                    _add(total, k * sets + r, c1 + at, a * s1 + b * t1 + c * u1 + d * v1)
                    _add(total, m * sets + r, c2 + at, a * s2 + b * t2 + c * u2 + d * v2)
                    _add(total, n * sets + r, c3 + at, a * s3 + b * t3 + c * u3 + d * v3)
