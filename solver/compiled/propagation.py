"""Compiled waves from transducers to points: the transfer matrix, pressures, and which points need a closer look.

See `layout` for the arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import Chebyshev
from numpy.polynomial.polynomial import Polynomial

from .layout import GAIN, LEAD, NX, NY, NZ, REACH, TINY, WANTED, F, X, Y, Z, _kernel, _part, carve
from .simd import LANES, if_positive, inverse_root, load, magnitude, nearest, spread, store

DIRECTIVITY_TERMS = 7
"""Enough for ka up to 6, a radius of 8 mm at 40 kHz."""
MAX_NEPERS = 2.0

POINTS = 256  # whose pressure stays in the first-level cache


def _even_polynomial(function: Any, degree: int) -> tuple[np.float32, ...]:
    """Coefficients in t² of an even function of t on [-1/2, 1/2]."""
    fitted = Chebyshev.interpolate(lambda s: function(np.sqrt(s)), degree, domain=[0, 0.25])
    return tuple(F(c) for c in fitted.convert(kind=Polynomial).coef)


# sin(2πt)/t and cos(2πt) to 8e-7 on one turn: far faster in a vectorised loop than libm's.
SINE = _even_polynomial(lambda t: 2 * np.pi * np.sinc(2 * t), 5)
COSINE = _even_polynomial(lambda t: np.cos(2 * np.pi * t), 6)
S0, S1, S2, S3, S4, S5 = SINE
C0, C1, C2, C3, C4, C5, C6 = COSINE


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


@_kernel
def model(elements: Any, directivity: Any, turns: Any, nepers: Any, origin: Any, bounds: Any, farthest: Any,
          points: Any, amplitudes: Any, work: Any) -> int:  # fmt: skip
    """Fill the transfer matrix and reach. Returns what `first_suspect` does."""
    _model(elements, directivity, turns, nepers, origin, points, amplitudes, work)
    return int(first_suspect(points, bounds, farthest))


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
