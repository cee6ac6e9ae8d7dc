"""What the kernels' arrays hold: rows of tables and of the work space, and how each kernel is compiled.

Kernels are of three topics: `propagation`, from points to pressures; `algebra`, of matrices over control points; and
`updates`, from points to drives. They work in float32. Each does what a readable complex128 function of
`methods.reference` or `acoustics.propagation` does, and is tested against it. They see plain arrays that
`acoustics.tables` and `methods.engine` prepare and check, and know no class of this package. numba compiles them at
their first call and keeps the result on disk.

A complex matrix is two real ones, ``re`` and ``im``. B, the weighted transfer matrix, has a row for each control point
and a column for each transducer; rows are padded with zeros to a multiple of `ROWS`, columns with transducers of gain 0
to a multiple of `LANES`. Matrices over control points have their rows padded by `pad`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ...base.compiling import kernel
from .simd import LANES

ROWS = 4
"""Rows of B that are read together."""

X, Y, Z, NX, NY, NZ, GAIN, LEAD, LIMIT, ELEMENT_ROWS = range(10)
"""Rows of the table of transducers: position/m, normal, gain, phase of the response in turns, largest drive."""

RESPONSE, INVERSE, WANTED, SCRATCH, RHS, SOLUTION, FELT = (0, 0), (0, 1), (1, 0), 2, 3, 4, 5
"""In `Parts.vectors`: the response of (9), 1/diag(L), and the amplitudes, the largest of which is 1; scratch; and,
complex, the wanted pressure, which `substitute` uses up, the y that this finds, and the pressure that `reproduce`
finds."""

REACH, WEIGHT, DRIVE, UNWEIGHED, SEARCH, TURN = (0, 0), (0, 1), 1, 2, 3, 4
"""In `Parts.spans`: reach and weight as in `weigh`; and, complex, the drive and scratch of `reproduce` and of
`find_turns`."""

SOLVED, PHASE, LIMITED = range(3)
"""Output policies."""

COLD = 0
"""Place of the cold phases among those that an engine keeps."""

TURNS, GAMMA, MU, HEADROOM, TOLERANCE, FLAT, BETTER, KEPT, ALONE, NUDGE, SETTINGS = range(11)
"""Numbers in an update's settings, float32: wave fronts per metre, and those of the method."""

F = np.float32
TINY = F(1e-30)

FAST = {"contract", "arcp", "nsz", "nnan", "ninf", "afn", "reassoc"}

Function = TypeVar("Function", bound=Callable[..., Any])


def _kernel(function: Function) -> Function:
    """For what Python calls.

    A kernel may call nothing but parts: numba would link another kernel to it, and a process that compiled both would
    run another copy of that, with other roundings, than one that loads them from the cache.
    """
    return kernel(function, error_model="numpy", fastmath=FAST)


def _part(function: Function) -> Function:
    """For parts of kernels, compiled into them."""
    return cast(Function, njit(inline="always", error_model="numpy", fastmath=FAST)(function))


def _shared(function: Function) -> Function:
    """For a long part: numba translates it once for all kernels of a process, and LLVM puts a copy into each.

    Without ``forceinline`` they would call it. A process that compiles would then run the copy that numba made first,
    and one that loads a kernel from the cache the kernel's own, which LLVM has rounded otherwise.
    """
    return cast(Function, njit(error_model="numpy", fastmath=FAST, forceinline=True)(function))


def _jitable(function: Function) -> Function:
    """For what kernels and Python both call."""
    jitable: Function = register_jitable(inline="always")(function)
    return jitable


class Parts(NamedTuple):
    """Views of a work space: B, G, L, vectors over points, (6, 2, padded), and over transducers, (5, 2, columns).

    ``slopes``, (2·rows of B, columns), is that of `differentiate`.
    """

    re: Any
    im: Any
    gram_re: Any
    gram_im: Any
    lower_re: Any
    lower_im: Any
    vectors: Any
    spans: Any
    slopes: Any


@_jitable
def pad(rows: int) -> int:
    """Length of a row of a matrix over control points.

    Walking down the columns of G and L meets few sets of the cache if a row is a multiple of 1 KB long: 20 steps of the
    phases then took three times as long at 1024 points, and the factorisation 1.8 times.
    """
    padded = (rows + LANES - 1) // LANES * LANES
    return padded + LANES if padded % 256 == 0 else padded


@_jitable
def carve(work: Any, m: int, columns: int) -> Parts:
    """The parts of the work space of m points."""
    rows = (m + ROWS - 1) // ROWS * ROWS
    padded = pad(rows)
    big, square = rows * columns, padded * padded
    at = 0
    re = work[at : at + big].reshape(rows, columns)
    at += big
    im = work[at : at + big].reshape(rows, columns)
    at += big
    gram_re = work[at : at + square].reshape(padded, padded)
    at += square
    gram_im = work[at : at + square].reshape(padded, padded)
    at += square
    lower_re = work[at : at + square].reshape(padded, padded)
    at += square
    lower_im = work[at : at + square].reshape(padded, padded)
    at += square
    vectors = work[at : at + 12 * padded].reshape(6, 2, padded)
    at += 12 * padded
    spans = work[at : at + 10 * columns].reshape(5, 2, columns)
    at += 10 * columns
    slopes = work[at : at + 2 * big].reshape(2 * rows, columns)
    return Parts(re, im, gram_re, gram_im, lower_re, lower_im, vectors, spans, slopes)


def work_size(m: int, columns: int) -> int:
    """Length of the work space of m points, in float32: B, the slopes, G and L once each, and some vectors.

    1024 points and 16 384 transducers need 286 MB: 134 for B, and as much for slopes, of which half are those of nulls.
    """
    rows = -(-m // ROWS) * ROWS
    padded = pad(rows)
    return 4 * rows * columns + 4 * padded * padded + 12 * padded + 10 * columns
