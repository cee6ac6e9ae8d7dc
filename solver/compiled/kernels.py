"""Compiled float32 kernels: transfer matrix, Gram matrix, phases, factorisation and correction of one update; pressure.

Each does what a readable complex128 function of `reference` or `propagation` does, and is tested against it. They see
plain arrays that `acoustics.tables` and `methods.engine` prepare and check, and know no class of this package. numba
compiles them at their first call and keeps the result on disk.

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
from numpy.polynomial.chebyshev import Chebyshev
from numpy.polynomial.polynomial import Polynomial

from ...base.compiling import kernel
from .simd import LANES, if_positive, inverse_root, load, magnitude, nearest, spread, store, total, totals

ROWS = 4
"""Rows of B that are read together."""
TILE = 8
"""Rows of B that `fill_gram` uses with all others before it goes on; of 320 transducers they take 20 kB."""

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

TURNS, GAMMA, MU, HEADROOM, TOLERANCE, FLAT, KEPT, ALONE, NUDGE, SETTINGS = range(10)
"""Numbers in an update's settings, float32: wave fronts per metre, and those of the method."""

DIRECTIVITY_TERMS = 7
"""Enough for ka up to 6, a radius of 8 mm at 40 kHz."""
MAX_NEPERS = 2.0

POINTS = 256  # whose pressure stays in the first-level cache

F = np.float32
TINY = F(1e-30)
BELOW = F(1 - 2**-20)  # rounding must not take a drive above its limit

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
    """For a long part, compiled once for all kernels of a process, which call it."""
    return cast(Function, njit(error_model="numpy", fastmath=FAST)(function))


def _jitable(function: Function) -> Function:
    """For what kernels and Python both call."""
    jitable: Function = register_jitable(inline="always")(function)
    return jitable


def _even_polynomial(function: Any, degree: int) -> tuple[np.float32, ...]:
    """Coefficients in t² of an even function of t on [-1/2, 1/2]."""
    fitted = Chebyshev.interpolate(lambda s: function(np.sqrt(s)), degree, domain=[0, 0.25])
    return tuple(F(c) for c in fitted.convert(kind=Polynomial).coef)


# sin(2πt)/t and cos(2πt) to 8e-7 on one turn: far faster in a vectorised loop than libm's.
S0, S1, S2, S3, S4, S5 = _even_polynomial(lambda t: 2 * np.pi * np.sinc(2 * t), 5)
C0, C1, C2, C3, C4, C5, C6 = _even_polynomial(lambda t: np.cos(2 * np.pi * t), 6)


@_part
def _wave(turns: Any) -> Any:
    """Cosine and sine of 2π·turns."""
    t = turns - nearest(turns)
    s = t * t
    sine = t * (S0 + s * (S1 + s * (S2 + s * (S3 + s * (S4 + s * S5)))))
    cosine = C0 + s * (C1 + s * (C2 + s * (C3 + s * (C4 + s * (C5 + s * C6)))))
    return cosine, sine


@_part
def _directivity(c: Any, s: Any) -> Any:
    """The polynomial in s = sin²θ with coefficients c."""
    return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * (c[5] + s * c[6])))))


@_part
def _decay(nepers: Any) -> Any:
    """exp(−nepers) for 0 … `MAX_NEPERS`."""
    y = F(0.125) * nepers
    e = F(1) - y * (F(1) - y * (F(1 / 2) - y * (F(1 / 6) - y * (F(1 / 24) - y * F(1 / 120)))))
    e = e * e
    e = e * e
    return e * e


@_part
def _arrival(
    dx: Any, dy: Any, dz: Any, nx: Any, ny: Any, nz: Any, gain: Any, lead: Any, c: Any, turns: Any, nepers: Any
) -> Any:
    """Signed amplitude and phase in turns of a transducer's wave at an offset; ``nepers`` None for no absorption."""
    d2 = dx * dx + dy * dy + dz * dz + TINY
    inverse = inverse_root(d2)
    r = d2 * inverse
    cosine = (dx * nx + dy * ny + dz * nz) * inverse
    amplitude = gain * inverse * _directivity(c, F(1) - cosine * cosine)
    if nepers is not None:
        amplitude = amplitude * _decay(nepers * r)
    return if_positive(cosine, amplitude), turns * r + lead


@_part
def _looked_up(
    dx: Any, dy: Any, dz: Any, nx: Any, ny: Any, nz: Any, gain: Any, lead: Any,
    table: Any, nearest: Any, cosines: int, growth: Any, turns: Any, nepers: Any,
) -> Any:  # fmt: skip
    """Magnitude and complex wave of a transducer at an offset, its residual by `table.ResidualTable`.

    ``table``, (rows, columns, 2), is over sin²θ and ``nearest``/r; ``cosines`` is the power of cosθ before it, and
    ``growth`` the squared root of r before it, per √m, or 0 for none.
    """
    d2 = dx * dx + dy * dy + dz * dz + TINY
    r = np.sqrt(d2)
    inverse = F(1) / r
    cosine = (dx * nx + dy * ny + dz * nz) * inverse
    x = min(max(F(1) - cosine * cosine, F(0)), F(1)) * F(table.shape[0] - 1)
    y = min(nearest * inverse, F(1)) * F(table.shape[1] - 1)
    i, j = min(int(x), table.shape[0] - 2), min(int(y), table.shape[1] - 2)
    down, right = x - F(i), y - F(j)
    a, b = (F(1) - down) * (F(1) - right), (F(1) - down) * right
    c, d = down * (F(1) - right), down * right
    re = a * table[i, j, 0] + b * table[i, j + 1, 0] + c * table[i + 1, j, 0] + d * table[i + 1, j + 1, 0]
    im = a * table[i, j, 1] + b * table[i, j + 1, 1] + c * table[i + 1, j, 1] + d * table[i + 1, j + 1, 1]
    amplitude = gain * inverse
    if nepers is not None:
        amplitude = amplitude * _decay(nepers * r)
    if cosines == 1:
        amplitude *= cosine
    if growth > F(0):
        amplitude *= growth * np.sqrt(r)
    amplitude = amplitude if cosine > F(0) else F(0)
    wave_re, wave_im = _wave(turns * r + lead)
    return (
        amplitude * np.sqrt(re * re + im * im),
        amplitude * (wave_re * re - wave_im * im),
        amplitude * (wave_re * im + wave_im * re),
    )


LEVEL = 1e-6
"""Height in metres over the plane of a transducer up to which a point is in it: single precision loses less."""


@_part
def first_suspect(points: Any, bounds: Any, farthest: Any) -> int:
    """First point that needs a closer look, or -1.

    None is needed outside the box from ``bounds[0]`` to ``bounds[1]`` around the array, in front of the transducer at
    ``bounds[2]`` that looks along ``bounds[3]``, and within ``farthest`` of it.
    """
    suspect = -1
    for i in range(len(points)):
        outside, along, distance2 = False, 0.0, 0.0
        for k in range(3):
            away = points[i, k] - bounds[2, k]
            outside = outside or not bounds[0, k] < points[i, k] < bounds[1, k]
            along += away * bounds[3, k]
            distance2 += away * away
        if suspect < 0 and not (outside and along > LEVEL and distance2 < farthest * farthest):
            suspect = i
    return suspect


@_kernel
def suspect(points: Any, bounds: Any, farthest: Any) -> int:
    """What `first_suspect` finds."""
    return int(first_suspect(points, bounds, farthest))


@_part
def fill_transfer(
    elements: Any, directivity: Any, turns: Any, nepers: Any, points: Any, origin: Any, wanted: Any,
    re: Any, im: Any, reach: Any,
) -> None:  # fmt: skip
    """Write the transfer matrix into re and im, and Σ_i |A_iq|·wanted_i, of (11), into reach.

    A row's amplitudes and phases come before its waves: a processor then has more independent work at hand.
    """
    m, columns = len(points), re.shape[1]
    c = (directivity[0], directivity[1], directivity[2], directivity[3], directivity[4], directivity[5], directivity[6])
    reached = reach.reshape(1, columns)
    for q in range(0, columns, LANES):
        store(reached, 0, q, spread(F(0)))
    for i in range(m):
        px, py, pz = F(points[i, 0] - origin[0]), F(points[i, 1] - origin[1]), F(points[i, 2] - origin[2])
        weight = wanted[i]
        for q in range(0, columns, LANES):
            amplitude, phase = _arrival(
                px - load(elements, X, q), py - load(elements, Y, q), pz - load(elements, Z, q),
                load(elements, NX, q), load(elements, NY, q), load(elements, NZ, q),
                load(elements, GAIN, q), load(elements, LEAD, q), c, turns, nepers,
            )  # fmt: skip
            store(reached, 0, q, load(reached, 0, q) + weight * magnitude(amplitude))
            store(re, i, q, amplitude)
            store(im, i, q, phase)
        for q in range(0, columns, LANES):
            amplitude = load(re, i, q)
            cosine, sine = _wave(load(im, i, q))
            store(re, i, q, amplitude * cosine)
            store(im, i, q, amplitude * sine)


@_part
def fill_transfer_by_table(
    elements: Any, table: Any, nearest: Any, cosines: int, growth: Any, turns: Any, nepers: Any,
    points: Any, origin: Any, wanted: Any, re: Any, im: Any, reach: Any,
) -> None:  # fmt: skip
    """What `fill_transfer` does, for models whose residual is looked up."""
    m, columns = len(points), re.shape[1]
    for q in range(columns):
        reach[q] = F(0)
    for i in range(m):
        px, py, pz = F(points[i, 0] - origin[0]), F(points[i, 1] - origin[1]), F(points[i, 2] - origin[2])
        for q in range(columns):
            magnitude, re[i, q], im[i, q] = _looked_up(
                px - elements[X, q], py - elements[Y, q], pz - elements[Z, q],
                elements[NX, q], elements[NY, q], elements[NZ, q], elements[GAIN, q], elements[LEAD, q],
                table, nearest, cosines, growth, turns, nepers,
            )  # fmt: skip
            reach[q] += wanted[i] * magnitude


@_kernel
def transfer(
    elements: Any, directivity: Any, turns: Any, nepers: Any, points: Any, origin: Any, wanted: Any,
    re: Any, im: Any, reach: Any,
) -> None:  # fmt: skip
    """Call `fill_transfer` from Python: a part alone would be compiled in each run."""
    fill_transfer(elements=elements, directivity=directivity, turns=turns, nepers=nepers, points=points, origin=origin,
                  wanted=wanted, re=re, im=im, reach=reach)  # fmt: skip


@_kernel
def transfer_by_table(
    elements: Any, table: Any, nearest: Any, cosines: int, growth: Any, turns: Any, nepers: Any,
    points: Any, origin: Any, wanted: Any, re: Any, im: Any, reach: Any,
) -> None:  # fmt: skip
    """As `transfer`, for models whose residual is looked up."""
    fill_transfer_by_table(elements=elements, table=table, nearest=nearest, cosines=cosines, growth=growth, turns=turns,
                           nepers=nepers, points=points, origin=origin, wanted=wanted, re=re, im=im,
                           reach=reach)  # fmt: skip


@_part
def fill_gram(re: Any, im: Any, gram_re: Any, gram_im: Any) -> None:
    """G = B·Bᴴ, both triangles, two rows by two at a time, of a tile of rows that stays in the first-level cache.

    With a = x + iy and c = u + iv: Re(a·c*) = xu + yv and Im(a·c*) = (x + y)(u − v) − xu + yv, three products for four.
    """
    rows, columns = re.shape
    for tile in range(0, rows, TILE):
        for i in range(tile, rows, 2):
            for j in range(tile, min(i + 2, tile + TILE), 2):
                r00, r01, r10, r11, s00, s01, s10, s11 = products(re, im, i, j, columns)
                enter(gram_re, gram_im, i, j, r00, s00)
                enter(gram_re, gram_im, i, j + 1, r01, s01)
                enter(gram_re, gram_im, i + 1, j, r10, s10)
                enter(gram_re, gram_im, i + 1, j + 1, r11, s11)


@_part
def products(re: Any, im: Any, i: int, j: int, columns: int) -> Any:
    """Rows i and i + 1 times the conjugates of rows j and j + 1: four real parts, then the imaginary ones."""
    p00 = p01 = p10 = p11 = q00 = q01 = q10 = q11 = s00 = s01 = s10 = s11 = spread(F(0))
    for q in range(0, columns, LANES):
        ar, ai, br, bi = load(re, i, q), load(im, i, q), load(re, i + 1, q), load(im, i + 1, q)
        cr, ci, dr, di = load(re, j, q), load(im, j, q), load(re, j + 1, q), load(im, j + 1, q)
        p00, p01, p10, p11 = p00 + ar * cr, p01 + ar * dr, p10 + br * cr, p11 + br * dr
        q00, q01, q10, q11 = q00 + ai * ci, q01 + ai * di, q10 + bi * ci, q11 + bi * di
        a, b, c, d = ar + ai, br + bi, cr - ci, dr - di
        s00, s01, s10, s11 = s00 + a * c, s01 + a * d, s10 + b * c, s11 + b * d
    return totals((
        p00 + q00, p01 + q01, p10 + q10, p11 + q11,
        s00 - p00 + q00, s01 - p01 + q01, s10 - p10 + q10, s11 - p11 + q11,
    ))  # fmt: skip


@_part
def enter(gram_re: Any, gram_im: Any, i: int, j: int, re: Any, im: Any) -> None:
    """Write an entry of a Hermitian matrix and its mirror image."""
    gram_re[i, j], gram_im[i, j] = re, im
    gram_re[j, i], gram_im[j, i] = re, -im


@_part
def weigh(re: Any, im: Any, reach: Any, points: int, gamma: Any, weight: Any) -> None:
    """Turn A into B = A·diag(weight) with weight = σ^{−γ}, σ² = reach/points; 0 if no point is reached."""
    columns = len(reach)
    if gamma == F(1):
        for q in range(columns):
            weight[q] = F(1) / np.sqrt(max(reach[q] / F(points), TINY))
    elif gamma == F(0):
        for q in range(columns):
            weight[q] = F(1)
    else:
        for q in range(columns):
            weight[q] = max(reach[q] / F(points), TINY) ** (F(-0.5) * gamma)
    for q in range(columns):
        weight[q] = weight[q] if reach[q] > F(0) else F(0)
    for i in range(len(re)):
        for q in range(columns):
            re[i, q] *= weight[q]
            im[i, q] *= weight[q]


@_part
def iterate_phases(
    gram_re: Any, gram_im: Any, response: Any, rows: int, steps: int, power: bool, u: Any, z: Any
) -> None:
    """Improve the phases u: u ← R·u with R = G·diag(response), to unit modulus, or to unit norm if ``power``."""
    padded = gram_re.shape[1]
    zero = spread(F(0))
    weights = response.reshape(1, padded)
    for _ in range(steps):
        for i in range(0, padded, LANES):
            weight = load(weights, 0, i)
            store(z, 0, i, weight * load(u, 0, i))
            store(z, 1, i, weight * load(u, 1, i))
        size2 = TINY
        for i in range(0, padded, LANES):
            rr0 = ii0 = ri0 = ir0 = rr1 = ii1 = ri1 = ir1 = (
                zero  # eight chains, because each sum waits for its last one
            )
            for j in range(0, rows, 2):  # column j of G is the conjugate of row j
                g, h = load(gram_re, j, i), load(gram_im, j, i)
                rr0, ii0 = rr0 + g * z[0, j], ii0 + h * z[1, j]
                ri0, ir0 = ri0 + g * z[1, j], ir0 + h * z[0, j]
                g, h = load(gram_re, j + 1, i), load(gram_im, j + 1, i)
                rr1, ii1 = rr1 + g * z[0, j + 1], ii1 + h * z[1, j + 1]
                ri1, ir1 = ri1 + g * z[1, j + 1], ir1 + h * z[0, j + 1]
            re, im = rr0 + ii0 + (rr1 + ii1), ri0 - ir0 + (ri1 - ir1)
            squares = re * re + im * im
            if power:
                size2 += total(squares)
            else:
                scale = inverse_root(squares + TINY)
                re, im = re * scale, im * scale
            store(u, 0, i, re)
            store(u, 1, i, im)
        if power:
            norm = F(1) / np.sqrt(size2)
            for i in range(padded):
                u[0, i] *= norm
                u[1, i] *= norm


@_part
def _less(re: Any, im: Any, ar: Any, ai: Any, br: Any, bi: Any) -> Any:
    """A difference of complex numbers, re + i·im − a·b*."""
    return re - ar * br - ai * bi, im - ai * br + ar * bi


@_part
def _inverse_pivot(pivot: Any, k: int, m: int, mu: Any, mean: Any) -> Any:
    """1/diag(L) in column k, from the pivot without regularisation."""
    return F(1) / np.sqrt(max(pivot + (mu * mean if k < m else mean), F(1e-7) * mean))


@_part
def _store(re: Any, im: Any, row: int, column: int, a: Any, b: Any) -> None:
    """Write a complex vector into two real matrices."""
    store(re, row, column, a)
    store(im, row, column, b)


@_part
def factorise(
    gram_re: Any, gram_im: Any, m: int, rows: int, mu: Any, lower_re: Any, lower_im: Any, inverse: Any
) -> None:
    """Cholesky of G + μ·tr(G)/m·I = L·Lᴴ, four columns at a time; μ keeps it from being singular.

    Below its diagonal L stands in ``lower`` twice, in the columns and, transposed, in the rows, so that `substitute`
    reads along rows both ways; ``inverse`` is 1/diag(L). Rows from m on are those of a multiple of the unit matrix.
    """
    padded = gram_re.shape[1]
    mean = TINY
    for j in range(m):
        mean += gram_re[j, j] / F(m)
    zero = spread(F(0))
    for j in range(0, rows, 4):
        for i in range(j // LANES * LANES, padded, LANES):
            r0, i0 = load(gram_re, j, i), zero - load(gram_im, j, i)  # column j of G is the conjugate of row j
            r1, i1 = load(gram_re, j + 1, i), zero - load(gram_im, j + 1, i)
            r2, i2 = load(gram_re, j + 2, i), zero - load(gram_im, j + 2, i)
            r3, i3 = load(gram_re, j + 3, i), zero - load(gram_im, j + 3, i)
            for k in range(j):
                a, b = load(lower_re, k, i), load(lower_im, k, i)
                r0, i0 = _less(r0, i0, a, b, lower_re[k, j], lower_im[k, j])
                r1, i1 = _less(r1, i1, a, b, lower_re[k, j + 1], lower_im[k, j + 1])
                r2, i2 = _less(r2, i2, a, b, lower_re[k, j + 2], lower_im[k, j + 2])
                r3, i3 = _less(r3, i3, a, b, lower_re[k, j + 3], lower_im[k, j + 3])
            _store(lower_re, lower_im, j, i, r0, i0)
            _store(lower_re, lower_im, j + 1, i, r1, i1)
            _store(lower_re, lower_im, j + 2, i, r2, i2)
            _store(lower_re, lower_im, j + 3, i, r3, i3)
        n0 = _inverse_pivot(lower_re[j, j], j, m, mu, mean)
        a1, b1 = lower_re[j, j + 1] * n0, lower_im[j, j + 1] * n0
        a2, b2 = lower_re[j, j + 2] * n0, lower_im[j, j + 2] * n0
        a3, b3 = lower_re[j, j + 3] * n0, lower_im[j, j + 3] * n0
        n1 = _inverse_pivot(lower_re[j + 1, j + 1] - (a1 * a1 + b1 * b1), j + 1, m, mu, mean)
        c2, d2 = _less(lower_re[j + 1, j + 2], lower_im[j + 1, j + 2], a2, b2, a1, b1)
        c3, d3 = _less(lower_re[j + 1, j + 3], lower_im[j + 1, j + 3], a3, b3, a1, b1)
        c2, d2, c3, d3 = c2 * n1, d2 * n1, c3 * n1, d3 * n1
        n2 = _inverse_pivot(lower_re[j + 2, j + 2] - (a2 * a2 + b2 * b2) - (c2 * c2 + d2 * d2), j + 2, m, mu, mean)
        e3, f3 = _less(lower_re[j + 2, j + 3], lower_im[j + 2, j + 3], a3, b3, a2, b2)
        e3, f3 = _less(e3, f3, c3, d3, c2, d2)
        e3, f3 = e3 * n2, f3 * n2
        n3 = _inverse_pivot(
            lower_re[j + 3, j + 3] - (a3 * a3 + b3 * b3) - (c3 * c3 + d3 * d3) - (e3 * e3 + f3 * f3), j + 3, m, mu, mean
        )
        inverse[j], inverse[j + 1], inverse[j + 2], inverse[j + 3] = n0, n1, n2, n3
        for i in range(j // LANES * LANES, padded, LANES):
            r0, i0 = load(lower_re, j, i) * n0, load(lower_im, j, i) * n0
            r1, i1 = _less(load(lower_re, j + 1, i), load(lower_im, j + 1, i), r0, i0, a1, b1)
            r1, i1 = r1 * n1, i1 * n1
            r2, i2 = _less(load(lower_re, j + 2, i), load(lower_im, j + 2, i), r0, i0, a2, b2)
            r2, i2 = _less(r2, i2, r1, i1, c2, d2)
            r2, i2 = r2 * n2, i2 * n2
            r3, i3 = _less(load(lower_re, j + 3, i), load(lower_im, j + 3, i), r0, i0, a3, b3)
            r3, i3 = _less(r3, i3, r1, i1, c3, d3)
            r3, i3 = _less(r3, i3, r2, i2, e3, f3)
            _store(lower_re, lower_im, j, i, r0, i0)
            _store(lower_re, lower_im, j + 1, i, r1, i1)
            _store(lower_re, lower_im, j + 2, i, r2, i2)
            _store(lower_re, lower_im, j + 3, i, r3 * n3, i3 * n3)
    for i in range(rows):
        for k in range(i):
            lower_re[i, k], lower_im[i, k] = lower_re[k, i], lower_im[k, i]


@_part
def substitute(lower_re: Any, lower_im: Any, inverse: Any, rows: int, b: Any, y: Any) -> None:
    """Solve L·Lᴴ·y = b; b is used up."""
    padded = b.shape[1]
    for k in range(rows):
        zr, zi = b[0, k] * inverse[k], b[1, k] * inverse[k]
        y[0, k], y[1, k] = zr, zi
        fr, fi = spread(zr), spread(zi)
        for i in range(k // LANES * LANES, padded, LANES):  # what it does to b up to k is never read
            c, d = load(lower_re, k, i), load(lower_im, k, i)
            store(b, 0, i, load(b, 0, i) - c * fr + d * fi)
            store(b, 1, i, load(b, 1, i) - c * fi - d * fr)
    for i in range(padded):
        b[0, i], b[1, i] = y[0, i], y[1, i]
    for k in range(rows - 1, -1, -1):
        zr, zi = b[0, k] * inverse[k], b[1, k] * inverse[k]
        y[0, k], y[1, k] = zr, zi
        fr, fi = spread(zr), spread(zi)
        for i in range(0, k + 1, LANES):  # nor from k on
            c, d = load(lower_re, k, i), load(lower_im, k, i)
            store(b, 0, i, load(b, 0, i) - c * fr - d * fi)
            store(b, 1, i, load(b, 1, i) - c * fi + d * fr)


@_part
def back_project(re: Any, im: Any, weight: Any, y: Any, x: Any) -> None:
    """X = diag(weight)·Bᴴ·y."""
    rows, columns = re.shape
    for q in range(columns):
        x[0, q] = x[1, q] = F(0)
    for i in range(0, rows, ROWS):
        r0, r1, r2, r3 = y[0, i], y[0, i + 1], y[0, i + 2], y[0, i + 3]
        i0, i1, i2, i3 = y[1, i], y[1, i + 1], y[1, i + 2], y[1, i + 3]
        for q in range(columns):
            a0, a1, a2, a3 = re[i, q], re[i + 1, q], re[i + 2, q], re[i + 3, q]
            b0, b1, b2, b3 = im[i, q], im[i + 1, q], im[i + 2, q], im[i + 3, q]
            x[0, q] += (a0 * r0 + b0 * i0) + (a1 * r1 + b1 * i1) + (a2 * r2 + b2 * i2) + (a3 * r3 + b3 * i3)
            x[1, q] += (a0 * i0 - b0 * r0) + (a1 * i1 - b1 * r1) + (a2 * i2 - b2 * r2) + (a3 * i3 - b3 * r3)
    for q in range(columns):
        x[0, q] *= weight[q]
        x[1, q] *= weight[q]


@_part
def limit_drive(x: Any, limit: Any, output: int, headroom: Any) -> None:
    """Bring drives within their limits by an output policy, in place."""
    columns = len(limit)
    if output == PHASE:
        for q in range(columns):
            size2 = x[0, q] * x[0, q] + x[1, q] * x[1, q]
            scale = BELOW * limit[q] / np.sqrt(size2 + TINY)
            x[0, q] *= scale
            x[1, q] *= scale
    elif output == SOLVED:
        worst = F(0)
        for q in range(columns):
            size2 = x[0, q] * x[0, q] + x[1, q] * x[1, q]
            relative = size2 / (limit[q] * limit[q] + TINY)
            worst = relative if relative > worst else worst
        scale = BELOW / np.sqrt(worst + TINY)
        for q in range(columns):
            x[0, q] *= scale
            x[1, q] *= scale
    else:
        power = allowed = F(0)
        for q in range(columns):
            power += x[0, q] * x[0, q] + x[1, q] * x[1, q]
            allowed += limit[q] * limit[q]
        scale = headroom * np.sqrt(allowed / (power + TINY))
        for q in range(columns):
            size = scale * np.sqrt(x[0, q] * x[0, q] + x[1, q] * x[1, q]) + TINY
            relative = BELOW * limit[q] / size
            factor = scale * (relative if relative < F(1) else F(1))
            x[0, q] *= factor
            x[1, q] *= factor


@_part
def reproduce(re: Any, im: Any, weight: Any, x: Any, v: Any, p: Any) -> None:
    """Write A·x = B·diag(1/weight)·x into p; v is scratch."""
    rows, columns = re.shape
    for q in range(columns):
        inverse = F(1) / max(weight[q], TINY)
        inverse = inverse if weight[q] > F(0) else F(0)
        v[0, q] = x[0, q] * inverse
        v[1, q] = x[1, q] * inverse
    for i in range(0, rows, 2):
        r0 = r1 = i0 = i1 = F(0)
        for q in range(columns):
            ar, ai, br, bi = re[i, q], im[i, q], re[i + 1, q], im[i + 1, q]
            r0 += ar * v[0, q] - ai * v[1, q]
            i0 += ar * v[1, q] + ai * v[0, q]
            r1 += br * v[0, q] - bi * v[1, q]
            i1 += br * v[1, q] + bi * v[0, q]
        p[0, i], p[1, i], p[0, i + 1], p[1, i + 1] = r0, i0, r1, i1


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


@_part
def set_wanted(amplitudes: Any, m: int, columns: int, work: Any) -> None:
    """Enter amplitudes into the work space, the largest as 1."""
    wanted = carve(work, m, columns).vectors[WANTED]
    largest = 0.0
    for i in range(m):
        largest = max(largest, amplitudes[i])
    for i in range(m):
        wanted[i] = F(amplitudes[i] / largest)


@_part
def _model(elements: Any, directivity: Any, turns: Any, nepers: Any, origin: Any, points: Any, amplitudes: Any,
           work: Any) -> None:  # fmt: skip
    """Fill the transfer matrix and reach."""
    m, columns = len(points), elements.shape[1]
    parts = carve(work, m, columns)
    set_wanted(amplitudes, m, columns, work)
    fill_transfer(elements=elements, directivity=directivity, turns=turns, nepers=nepers, points=points, origin=origin,
                  wanted=parts.vectors[WANTED], re=parts.re[:m], im=parts.im[:m], reach=parts.spans[REACH])  # fmt: skip


@_kernel
def model_by_table(
    elements: Any, table: Any, nearest: Any, cosines: int, growth: Any, turns: Any, nepers: Any, origin: Any,
    bounds: Any, farthest: Any, points: Any, amplitudes: Any, work: Any,
) -> int:  # fmt: skip
    """What `model` does, for models whose residual is looked up."""
    m, columns = len(points), elements.shape[1]
    parts = carve(work, m, columns)
    set_wanted(amplitudes, m, columns, work)
    fill_transfer_by_table(
        elements=elements, table=table, nearest=nearest, cosines=cosines, growth=growth, turns=turns, nepers=nepers,
        points=points, origin=origin,
        wanted=parts.vectors[WANTED], re=parts.re[:m], im=parts.im[:m], reach=parts.spans[REACH],
    )  # fmt: skip
    return int(first_suspect(points, bounds, farthest))


@_part
def _begin(m: int, columns: int, gamma: Any, phase_steps: int, power: bool, u: Any, work: Any) -> None:
    """From the transfer matrix and reach to B, G, the response of (9), and the phases u."""
    parts = carve(work, m, columns)
    weigh_all(m, columns, gamma, work)
    gram_re, gram_im, rows = parts.gram_re, parts.gram_im, len(parts.re)
    for i in range(len(gram_re)):
        for j in range(rows if i < rows else 0, len(gram_re)):
            gram_re[i, j] = gram_im[i, j] = F(0)
    fill_gram(parts.re, parts.im, gram_re, gram_im)
    align(m, columns, phase_steps, power, u, work)


@_part
def weigh_all(m: int, columns: int, gamma: Any, work: Any) -> None:
    """From the transfer matrix and reach to B."""
    parts = carve(work, m, columns)
    re, im, spans = parts.re, parts.im, parts.spans
    for i in range(m, len(re)):
        for q in range(columns):
            re[i, q] = im[i, q] = F(0)
    weigh(re[:m], im[:m], spans[REACH], m, gamma, spans[WEIGHT])


@_part
def align(m: int, columns: int, phase_steps: int, power: bool, u: Any, work: Any) -> None:
    """From G to the response of (9) and the phases u."""
    parts = carve(work, m, columns)
    gram_re, vectors = parts.gram_re, parts.vectors
    wanted, response = vectors[WANTED], vectors[RESPONSE]
    for i in range(len(gram_re)):
        response[i] = wanted[i] / max(gram_re[i, i], TINY) if i < m else F(0)
    iterate_phases(gram_re, parts.gram_im, response, len(parts.re), phase_steps, power, u, vectors[SCRATCH])


@_kernel
def model(elements: Any, directivity: Any, turns: Any, nepers: Any, origin: Any, bounds: Any, farthest: Any,
          points: Any, amplitudes: Any, work: Any) -> int:  # fmt: skip
    """Fill the transfer matrix and reach. Returns what `first_suspect` does."""
    _model(elements, directivity, turns, nepers, origin, points, amplitudes, work)
    return int(first_suspect(points, bounds, farthest))


@_kernel
def begin(m: int, columns: int, gamma: Any, phase_steps: int, power: bool, u: Any, work: Any) -> None:
    """From the transfer matrix and reach to B, G, the response of (9), and the phases u."""
    _begin(m, columns, gamma, phase_steps, power, u, work)


@_part
def _carry(m: int, ids: Any, before_ids: Any, before: Any, cold: Any, nudge: Any, u: Any) -> None:
    """Phases u to begin with: of points that were there those in which they ended, nudged to the cold start."""
    size2, carried, count = TINY, 0, len(before_ids)
    for i in range((m + LANES - 1) // LANES * LANES):
        u[0, i] = u[1, i] = F(0)
    for i in range(m):
        j = i if i < count and before_ids[i] == ids[i] else 0  # nearly always in the same place
        while j < count and before_ids[j] != ids[i]:
            j += 1
        if j < count:
            u[0, i], u[1, i] = before[0, j], before[1, j]
            size2 += u[0, i] * u[0, i] + u[1, i] * u[1, i]
            carried += 1
    scale = np.sqrt(F(carried) / size2)  # their mean square becomes 1
    part = nudge if carried else F(0)
    for i in range(m):
        if u[0, i] == F(0) and u[1, i] == F(0):
            u[0, i], u[1, i] = cold[0, i], cold[1, i]
        else:
            u[0, i], u[1, i] = u[0, i] * scale, u[1, i] * scale
        u[0, i] += part * cold[0, i]
        u[1, i] += part * cold[1, i]


@_kernel
def carry(m: int, ids: Any, before_ids: Any, before: Any, cold: Any, nudge: Any, u: Any) -> None:
    """Phases to begin with; see `_carry`."""
    _carry(m, ids, before_ids, before, cold, nudge, u)


@_kernel
def more_phases(m: int, columns: int, steps: int, power: bool, u: Any, work: Any) -> None:
    """Improve the phases u by some steps more."""
    parts = carve(work, m, columns)
    response, scratch = parts.vectors[RESPONSE], parts.vectors[SCRATCH]
    iterate_phases(parts.gram_re, parts.gram_im, response, len(parts.re), steps, power, u, scratch)


@_part
def differentiate(re: Any, im: Any, v: Any, p: Any, wanted: Any, m: int, slopes: Any) -> int:
    """Write how |p|, p = B·v, changes if an entry of v turns, a row for each point; returns the number of rows.

    A null has a second row, for p at right angles to what it is, after the rows of all points. Rows are padded with
    zeros to a multiple of `ROWS`.
    """
    columns = re.shape[1]
    rows = m
    for i in range(m):
        size2 = p[0, i] * p[0, i] + p[1, i] * p[1, i]
        inverse = F(1) / np.sqrt(size2 + TINY)
        c, s = spread(p[0, i] * inverse), spread(p[1, i] * inverse)
        for q in range(0, columns, LANES):
            v_re, v_im = load(v, 0, q), load(v, 1, q)
            store(slopes, i, q, load(re, i, q) * (s * v_re - c * v_im) - load(im, i, q) * (c * v_re + s * v_im))
        if wanted[i] == F(0):
            for q in range(0, columns, LANES):
                v_re, v_im = load(v, 0, q), load(v, 1, q)
                store(slopes, rows, q, load(re, i, q) * (c * v_re + s * v_im) + load(im, i, q) * (s * v_re - c * v_im))
            rows += 1
    padded = (rows + ROWS - 1) // ROWS * ROWS
    for i in range(rows, padded):
        for q in range(columns):
            slopes[i, q] = F(0)
    return padded


@_part
def find_turns(
    slopes: Any, rows: int, wanted: Any, m: int, iterations: int, settings: Any,
    residual: Any, image: Any, search: Any, turn: Any,
) -> None:  # fmt: skip
    """Phases ``turn[0]`` for which slopes·turn comes near the residual, but for a part of ``wanted``.

    By conjugate gradients, as `reference.conjugate_gradients`. ``residual``, which is used up, and ``image`` have a
    number for each row; ``search`` and the rest of ``turn`` are scratch.
    """
    columns = slopes.shape[1]
    first, before, norm = F(0), F(0), F(0)
    for i in range(m):
        norm += wanted[i] * wanted[i]
    for q in range(columns):
        turn[0, q] = search[0, q] = F(0)
    for iteration in range(iterations):
        for q in range(columns):
            search[1, q] = F(0)
        for i in range(0, rows, ROWS):
            a, b, c, d = spread(residual[i]), spread(residual[i + 1]), spread(residual[i + 2]), spread(residual[i + 3])
            for q in range(0, columns, LANES):
                two = load(slopes, i, q) * a + load(slopes, i + 1, q) * b
                four = two + (load(slopes, i + 2, q) * c + load(slopes, i + 3, q) * d)
                store(search, 1, q, load(search, 1, q) + four)
        gradient2 = F(0)
        for q in range(columns):
            gradient2 += search[1, q] * search[1, q]
        if iteration == 0:
            first = gradient2
        elif gradient2 <= settings[FLAT] * settings[FLAT] * first:
            break
        ratio = gradient2 / before if iteration > 0 else F(0)
        before = gradient2
        for q in range(columns):
            search[0, q] = search[1, q] + ratio * search[0, q]
        for i in range(0, rows, ROWS):
            a = b = c = d = spread(F(0))
            for q in range(0, columns, LANES):
                along = load(search, 0, q)
                a, b = a + load(slopes, i, q) * along, b + load(slopes, i + 1, q) * along
                c, d = c + load(slopes, i + 2, q) * along, d + load(slopes, i + 3, q) * along
            image[i], image[i + 1], image[i + 2], image[i + 3] = total(a), total(b), total(c), total(d)
        level = image2 = whole2 = F(0)
        for i in range(m):
            level += wanted[i] * image[i] / norm
        for i in range(rows):
            whole2 += image[i] * image[i]
        for i in range(m):
            image[i] -= level * wanted[i]
        for i in range(rows):
            image2 += image[i] * image[i]
        if image2 <= settings[ALONE] * whole2:
            break
        length = gradient2 / image2
        for i in range(rows):
            residual[i] -= length * image[i]
        for q in range(columns):
            turn[0, q] += length * search[0, q]


@_shared
def _correct(m: int, settings: Any, gradients: int, steps: int, limit: Any, work: Any, drive: Any) -> None:
    """Turn the phases of the drive until the pressures are even, in at most ``steps`` steps.

    The best one is kept of those that keep the strength.
    """
    parts = carve(work, m, len(limit))
    vectors, spans = parts.vectors, parts.spans
    wanted, p, x, v = vectors[WANTED], vectors[FELT], spans[DRIVE], spans[UNWEIGHED]
    residual, image = vectors[SCRATCH].reshape(vectors[SCRATCH].size), vectors[RHS].reshape(vectors[RHS].size)
    best, least = F(1e30), F(0)
    for step in range(steps + 1):
        reproduce(parts.re, parts.im, spans[WEIGHT], x, v, p)
        fit, norm, error = F(0), F(0), F(0)
        for i in range(m):
            residual[i] = np.sqrt(p[0, i] * p[0, i] + p[1, i] * p[1, i])
            fit += wanted[i] * residual[i]
            norm += wanted[i] * wanted[i]
        fit /= norm
        if step == 0:
            least = settings[KEPT] * fit
        if not fit > TINY:
            return
        for i in range(m):
            residual[i] = wanted[i] - residual[i] / fit
            error += residual[i] * residual[i]
        error = np.sqrt(error / F(m))
        if error < best and fit >= least:
            best = error
            for q in range(len(drive)):
                size = np.sqrt(x[0, q] * x[0, q] + x[1, q] * x[1, q]) + TINY
                scale = min(F(1), BELOW * limit[q] / size)  # turning rounds
                drive[q] = complex(x[0, q] * scale, x[1, q] * scale)
        if best < settings[TOLERANCE] or step == steps:
            return
        rows = differentiate(parts.re, parts.im, v, p, wanted, m, parts.slopes)
        for i in range(m, rows):
            residual[i] = F(0)
        find_turns(parts.slopes, rows, wanted, m, gradients, settings, residual, image, spans[SEARCH], spans[TURN])
        for q in range(x.shape[1]):
            half = F(0.5) * fit * spans[TURN][0, q]
            scale = F(1) / (F(1) + half * half)
            c, s = scale * (F(1) - half * half), scale * (half + half)
            x[0, q], x[1, q] = c * x[0, q] - s * x[1, q], s * x[0, q] + c * x[1, q]


@_part
def _finish(elements: Any, m: int, u: Any, settings: Any, output: int, gradients: int, steps: int, work: Any,
            drive: Any) -> None:  # fmt: skip
    """Solve for the drive with the phases u, and correct it as `_correct` does."""
    parts = carve(work, m, elements.shape[1])
    vectors, x, limit = parts.vectors, parts.spans[DRIVE], elements[LIMIT]
    inverse, wanted, b, y = vectors[INVERSE], vectors[WANTED], vectors[RHS], vectors[SOLUTION]
    rows = len(parts.re)
    factorise(parts.gram_re, parts.gram_im, m, rows, settings[MU], parts.lower_re, parts.lower_im, inverse)
    for i in range(b.shape[1]):
        b[0, i] = b[1, i] = F(0)
    for i in range(m):
        scale = wanted[i] / np.sqrt(u[0, i] * u[0, i] + u[1, i] * u[1, i] + TINY)
        b[0, i], b[1, i] = scale * u[0, i], scale * u[1, i]
    substitute(parts.lower_re, parts.lower_im, inverse, rows, b, y)
    back_project(parts.re, parts.im, parts.spans[WEIGHT], y, x)
    limit_drive(x, limit, output, settings[HEADROOM])
    for q in range(len(drive)):
        drive[q] = complex(x[0, q], x[1, q])
    if steps > 0:
        _correct(m, settings, gradients, steps, limit, work, drive)


@_kernel
def finish(elements: Any, m: int, u: Any, settings: Any, output: int, gradients: int, steps: int, work: Any,
           drive: Any) -> None:  # fmt: skip
    """Solve for the drive with the phases u, and correct it; see `_finish`."""
    _finish(elements, m, u, settings, output, gradients, steps, work, drive)


@_part
def _level(m: int, columns: int, weighed: bool, work: Any, drive: Any) -> float:
    """|p| per wanted amplitude, the largest of which is 1, by least squares, for the drive that was solved just now."""
    parts = carve(work, m, columns)
    re, im, vectors, spans = parts.re, parts.im, parts.vectors, parts.spans
    wanted, p = vectors[WANTED], vectors[FELT]
    weight, x, v = spans[WEIGHT], spans[DRIVE], spans[UNWEIGHED]
    for q in range(columns):
        x[0, q] = drive[q].real if q < len(drive) else F(0)
        x[1, q] = drive[q].imag if q < len(drive) else F(0)
        if not weighed:
            weight[q] = F(1)
    for i in range(m, len(re)):
        for q in range(columns):
            re[i, q] = im[i, q] = F(0)
    reproduce(re, im, weight, x, v, p)
    fit = norm = 0.0
    for i in range(m):
        fit += wanted[i] * np.sqrt(p[0, i] * p[0, i] + p[1, i] * p[1, i])
        norm += wanted[i] * wanted[i]
    return float(fit / norm)


@_kernel
def level(m: int, columns: int, weighed: bool, work: Any, drive: Any) -> float:
    """|p| per wanted amplitude; see `_level`."""
    return float(_level(m, columns, weighed, work, drive))


@_part
def _update(
    elements: Any, directivity: Any, nepers: Any, origin: Any, settings: Any, phase_steps: int, power: int,
    output: int, steps: int, gradients: int, points: Any, amplitudes: Any, ids: Any, before_ids: Any, before: Any,
    cold: Any, work: Any, u: Any, drive: Any,
) -> None:  # fmt: skip
    """One update from points to drives; the phases u begin as `_carry` has them."""
    m = len(points)
    _carry(m, ids, before_ids, before, cold, settings[NUDGE], u)
    _model(elements=elements, directivity=directivity, turns=settings[TURNS], nepers=nepers, origin=origin,
           points=points, amplitudes=amplitudes, work=work)  # fmt: skip
    _begin(m, elements.shape[1], settings[GAMMA], phase_steps, power != 0, u, work)
    _finish(elements=elements, m=m, u=u, settings=settings, output=output, gradients=gradients, steps=steps, work=work,
            drive=drive)  # fmt: skip


@_kernel
def update(
    elements: Any, directivity: Any, nepers: Any, origin: Any, bounds: Any, farthest: Any, power: int,
    output: int, steps: int, gradients: int, settings: Any, phase_steps: int, points: Any, amplitudes: Any, ids: Any,
    before_ids: Any, phases: Any, last: int, work: Any, drive: Any, sure: int,
) -> int:  # fmt: skip
    """One update without Python in between.

    ``phases``, (3, 2, most), are the cold ones, those of the last update at ``last``, and, at the other place, those
    that this one finds. Returns what `first_suspect` does; if there is a suspect point and they are not ``sure``,
    nothing was done.
    """
    found = -1 if sure else first_suspect(points, bounds, farthest)
    if found < 0:
        _update(
            elements=elements, directivity=directivity, nepers=nepers, origin=origin, settings=settings,
            phase_steps=phase_steps, power=power, output=output, steps=steps, gradients=gradients,
            points=points, amplitudes=amplitudes, ids=ids,
            before_ids=before_ids, before=phases[last], cold=phases[COLD], work=work, u=phases[3 - last], drive=drive,
        )  # fmt: skip
    return int(found)


@_kernel
def update_frames(
    elements: Any, directivity: Any, nepers: Any, origin: Any, bounds: Any, farthest: Any, power: int,
    output: int, steps: int, gradients: int, settings: Any, phase_steps: int, points: Any, amplitudes: Any, begins: Any,
    first: int, stride: int, ids: Any, phases: Any, work: Any, drives: Any,
) -> int:  # fmt: skip
    """Every ``stride``-th frame from ``first`` on, each from a cold start, without Python in between.

    Frame f has the points from ``begins[f]`` to ``begins[f + 1]``. Returns the first frame with a suspect point,
    or -1.
    """
    suspect = -1
    for f in range(first, len(begins) - 1, stride):
        frame = points[begins[f] : begins[f + 1]]
        if first_suspect(frame, bounds, farthest) >= 0 and suspect < 0:
            suspect = f
        _update(
            elements=elements, directivity=directivity, nepers=nepers, origin=origin, settings=settings,
            phase_steps=phase_steps, power=power, output=output, steps=steps, gradients=gradients,
            points=frame, amplitudes=amplitudes[begins[f] : begins[f + 1]],
            ids=ids, before_ids=ids[:0], before=phases[1], cold=phases[COLD], work=work, u=phases[2],
            drive=drives[f],
        )  # fmt: skip
    return suspect


@_kernel
def sum_foci(elements: Any, m: int, output: int, headroom: Any, work: Any, drive: Any) -> None:
    """Linear multiplexing of (12), from the transfer matrix to drives within their limits."""
    columns = elements.shape[1]
    parts = carve(work, m, columns)
    re, im, wanted, x = parts.re, parts.im, parts.vectors[WANTED], parts.spans[DRIVE]
    for q in range(columns):
        x[0, q] = x[1, q] = F(0)
    for i in range(m):
        for q in range(columns):
            scale = wanted[i] / np.sqrt(re[i, q] * re[i, q] + im[i, q] * im[i, q] + TINY)
            x[0, q] += scale * re[i, q]
            x[1, q] -= scale * im[i, q]
    limit_drive(x, elements[LIMIT], output, headroom)
    for q in range(len(drive)):
        drive[q] = complex(x[0, q], x[1, q])


@_part
def _misfit2(p: Any, wanted: Any, m: int) -> Any:
    """Mean square misfit of |p| to the wanted amplitudes, relative to the scale that fits best; in double precision."""
    power = fit = norm = 0.0
    for i in range(m):
        size2 = np.float64(p[0, i]) ** 2 + np.float64(p[1, i]) ** 2
        power += size2
        fit += np.float64(wanted[i]) * np.sqrt(size2)
        norm += np.float64(wanted[i]) ** 2
    return (power * (norm / max(fit, 1e-30)) ** 2 - norm) / m


@_kernel
def polish(m: int, columns: int, levels: int, sweeps: int, least_gain: float, work: Any, drive: Any) -> None:
    """Coordinate descent over quantised phases after `finish`, in place: each drive tries the next phase either way."""
    parts = carve(work, m, columns)
    re, im, vectors, spans = parts.re, parts.im, parts.vectors, parts.spans
    wanted, p, trial = vectors[WANTED], vectors[FELT], vectors[SOLUTION]
    weight, x, v = spans[WEIGHT], spans[DRIVE], spans[UNWEIGHED]
    step = F(2 * np.pi) / F(levels)
    level = np.zeros(columns, np.int64)
    for q in range(columns):
        x[0, q] = x[1, q] = F(0)
    for q in range(len(drive)):
        level[q] = int(np.rint(np.arctan2(drive[q].imag, drive[q].real) / step))
        size = abs(drive[q])
        x[0, q], x[1, q] = size * np.cos(step * F(level[q])), size * np.sin(step * F(level[q]))
    reproduce(re, im, weight, x, v, p)
    best = _misfit2(p, wanted, m)
    for _ in range(sweeps):
        for q in range(len(drive)):
            size = abs(drive[q])
            if size == F(0) or weight[q] == F(0):
                continue
            for way in (1, -1):
                to_re = size * np.cos(step * F(level[q] + way))
                to_im = size * np.sin(step * F(level[q] + way))
                change_re, change_im = (to_re - x[0, q]) / weight[q], (to_im - x[1, q]) / weight[q]
                for i in range(m):
                    trial[0, i] = p[0, i] + re[i, q] * change_re - im[i, q] * change_im
                    trial[1, i] = p[1, i] + re[i, q] * change_im + im[i, q] * change_re
                error = _misfit2(trial, wanted, m)
                if error < best - least_gain:
                    best = error
                    level[q] += way
                    x[0, q], x[1, q] = to_re, to_im
                    for i in range(m):
                        p[0, i], p[1, i] = trial[0, i], trial[1, i]
                    break
    for q in range(len(drive)):
        drive[q] = complex(x[0, q], x[1, q])


@_kernel
def first_too_close(elements: Any, n: int, origin: Any, bounds: Any, nearest: float, points: Any, start: int) -> int:
    """First of (k, 3) points from ``start`` on that may be nearer than ``nearest`` to one of n transducers, or -1.

    Only those in the box from ``bounds[0]`` to ``bounds[1]`` can be.
    """
    limit = F(nearest * nearest * 1.0001)
    for i in range(start, len(points)):
        inside = True
        for k in range(3):
            inside = inside and bounds[0, k] < points[i, k] < bounds[1, k]
        if inside:
            x, y, z = F(points[i, 0] - origin[0]), F(points[i, 1] - origin[1]), F(points[i, 2] - origin[2])
            close = 0
            for q in range(n):
                dx, dy, dz = x - elements[X, q], y - elements[Y, q], z - elements[Z, q]
                close += 1 if dx * dx + dy * dy + dz * dz < limit else 0
            if close > 0:
                return i
    return -1


@_kernel
def sum_pressure(elements: Any, directivity: Any, turns: Any, nepers: Any, origin: Any, drive: Any, scale: Any,
                 points: Any, pressure: Any) -> None:  # fmt: skip
    """Pressure of all transducers at (k, 3) points times ``scale`` into (k,) complex, a block of points at a time.

    The drives, (2, columns), are those that the transducers emit, gain and lead included.
    """
    c = (directivity[0], directivity[1], directivity[2], directivity[3], directivity[4], directivity[5], directivity[6])
    px, py, pz = np.empty(POINTS, np.float32), np.empty(POINTS, np.float32), np.empty(POINTS, np.float32)
    re, im = np.empty(POINTS, np.float32), np.empty(POINTS, np.float32)
    for first in range(0, len(points), POINTS):
        part = points[first : first + POINTS]
        for i in range(len(part)):
            px[i], py[i], pz[i] = part[i, 0] - origin[0], part[i, 1] - origin[1], part[i, 2] - origin[2]
            re[i] = im[i] = F(0)
        for q in range(elements.shape[1]):
            x, y, z = elements[X, q], elements[Y, q], elements[Z, q]
            nx, ny, nz, dr, di = elements[NX, q], elements[NY, q], elements[NZ, q], drive[0, q], drive[1, q]
            for i in range(len(part)):
                amplitude, phase = _arrival(px[i] - x, py[i] - y, pz[i] - z, nx, ny, nz, F(1), F(0), c, turns, nepers)
                wave_re, wave_im = _wave(phase)
                re[i] += amplitude * (wave_re * dr - wave_im * di)
                im[i] += amplitude * (wave_re * di + wave_im * dr)
        for i in range(len(part)):
            pressure[first + i] = scale * complex(re[i], im[i])


@_kernel
def sum_pressure_by_table(
    elements: Any, table: Any, nearest: Any, cosines: int, growth: Any, turns: Any, nepers: Any,
    origin: Any, drive: Any, scale: Any, points: Any, pressure: Any,
) -> None:  # fmt: skip
    """What `sum_pressure` does, for models whose residual is looked up."""
    for i in range(len(points)):
        px, py, pz = F(points[i, 0] - origin[0]), F(points[i, 1] - origin[1]), F(points[i, 2] - origin[2])
        re = im = F(0)
        for q in range(elements.shape[1]):
            _, wave_re, wave_im = _looked_up(
                px - elements[X, q], py - elements[Y, q], pz - elements[Z, q],
                elements[NX, q], elements[NY, q], elements[NZ, q], F(1), F(0),
                table, nearest, cosines, growth, turns, nepers,
            )  # fmt: skip
            re += wave_re * drive[0, q] - wave_im * drive[1, q]
            im += wave_re * drive[1, q] + wave_im * drive[0, q]
        pressure[i] = scale * complex(re, im)
