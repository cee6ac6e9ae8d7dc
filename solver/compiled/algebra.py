"""Compiled steps of an update on matrices: Gram matrix, phases, factorisation, drives within limits, correction.

See `layout` for the arrays. They are parts, for the kernels of `updates`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .layout import ALONE, FLAT, PHASE, ROWS, SOLVED, TINY, F, _part
from .simd import LANES, inverse_root, load, spread, store, total, totals

TILE = 8
"""Rows of B that `fill_gram` uses with all others before it goes on; of 320 transducers they take 20 kB."""
BELOW = F(1 - 2**-20)  # rounding must not take a drive above its limit


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
