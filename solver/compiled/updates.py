"""Compiled updates, from control points to drives: as a whole, for one frame or many, and in steps.

See `layout` for the arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .algebra import (
    BELOW,
    back_project,
    differentiate,
    factorise,
    fill_gram,
    find_turns,
    iterate_phases,
    limit_drive,
    reproduce,
    substitute,
    weigh,
)
from .layout import (
    BETTER,
    COLD,
    DRIVE,
    FELT,
    GAMMA,
    HEADROOM,
    INVERSE,
    KEPT,
    LIMIT,
    MU,
    NUDGE,
    REACH,
    RESPONSE,
    RHS,
    SCRATCH,
    SEARCH,
    SOLUTION,
    TINY,
    TOLERANCE,
    TURN,
    TURNS,
    UNWEIGHED,
    WANTED,
    WEIGHT,
    F,
    _kernel,
    _part,
    _shared,
    carve,
)
from .propagation import _model, first_suspect
from .simd import LANES


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
        if error < settings[BETTER] * best and fit >= least:
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
