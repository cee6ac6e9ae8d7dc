"""Compiled kernels of two-sided modulation: a frame from its points to the drives of both halves in one call.

Each does what `split.split` and two engines do one after the other, and is tested against them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled.layout import _kernel, _part
from ..compiled.propagation import first_suspect
from ..compiled.updates import _level, _update
from .split import ACROSS, HOLD, KEEP, OBLIQUE, TILT

TURNED = -2


@_part
def holds(positions: Any, amplitudes: Any, ids: Any, axis: Any, before: Any, before_ids: Any, mask: Any) -> bool:
    """Split points by the axis of the last frame, as `split.split` does; false if the axis must turn.

    ``before`` is the mask of the last frame, of the points ``before_ids``.
    """
    m, sounding = len(positions), 0
    middle_x = middle_y = middle_z = 0.0
    for i in range(m):
        if amplitudes[i] > 0:
            sounding += 1
            middle_x += positions[i, 0]
            middle_y += positions[i, 1]
            middle_z += positions[i, 2]
    middle_x, middle_y, middle_z = middle_x / sounding, middle_y / sounding, middle_z / sounding
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(m):
        if amplitudes[i] > 0:
            x, y, z = positions[i, 0] - middle_x, positions[i, 1] - middle_y, positions[i, 2] - middle_z
            xx, xy, xz, yy, yz, zz = xx + x * x, xy + x * y, xz + x * z, yy + y * y, yz + y * z, zz + z * z
    a, b, c = axis[0], axis[1], axis[2]
    variance = a * a * xx + b * b * yy + c * c * zz + 2 * (a * b * xy + a * c * xz + b * c * yz)
    if not variance >= KEEP * largest_eigenvalue(xx, xy, xz, yy, yz, zz):
        return False
    across, tilted = np.empty(3), np.empty(3)
    for fixed in ACROSS:
        length2 = 0.0
        for k in range(3):
            across[k] = (1.0 if k == fixed else 0.0) - axis[fixed] * axis[k]
            length2 += across[k] * across[k]
        if length2 > OBLIQUE**2:
            break
    length = np.sqrt(length2)
    for k in range(3):
        across[k] /= length
    for k in range(3):
        after, last = (k + 1) % 3, (k + 2) % 3
        upright = axis[after] * across[last] - axis[last] * across[after]
        tilted[k] = axis[k] + TILT * across[k] + TILT**2 * upright
    along = np.empty(m)
    for i in range(m):
        x, y, z = positions[i, 0] - middle_x, positions[i, 1] - middle_y, positions[i, 2] - middle_z
        along[i] = x * tilted[0] + y * tilted[1] + z * tilted[2]
        j = i if i < len(before_ids) and before_ids[i] == ids[i] else 0  # nearly always in the same place
        while j < len(before_ids) and before_ids[j] != ids[i]:
            j += 1
        if j < len(before_ids):
            along[i] += -HOLD if before[j] else HOLD
    for i in range(m):
        rank = 0
        for j in range(m):
            if amplitudes[j] > 0 and (along[j] < along[i] or (along[j] == along[i] and j < i)):
                rank += 1
        mask[i] = amplitudes[i] > 0 and rank < (sounding + 1) // 2
    return True


@_part
def largest_eigenvalue(xx: Any, xy: Any, xz: Any, yy: Any, yz: Any, zz: Any) -> Any:
    """Of a symmetric matrix; see `split._largest_eigenvalue`."""
    mean = (xx + yy + zz) / 3
    xx, yy, zz = xx - mean, yy - mean, zz - mean
    scale = np.sqrt((xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if scale == 0:
        return mean
    xx, xy, xz, yy, yz, zz = xx / scale, xy / scale, xz / scale, yy / scale, yz / scale, zz / scale
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return mean + 2 * scale * np.cos(np.arccos(min(max(determinant / 2, -1.0), 1.0)) / 3)


@_kernel
def drive_pair(
    elements: Any, directivity: Any, nepers: Any, origin: Any, bounds: Any, farthest: Any, power: int,
    output: int, steps: int, gradients: int, settings: Any, phase_steps: int, positions: Any, amplitudes: Any, ids: Any,
    sure: int, split_is_known: int, axis: Any, before: Any, before_ids: Any, mask: Any,
    cold: Any, work: Any, u: Any, counts: Any, kept_ids: Any, kept: Any, drives: Any, levels: Any,
) -> int:  # fmt: skip
    """Split points in two halves, and find the drives of each, and the level by which it is to be turned down.

    ``mask`` is this split, known or to be found from the axis of the last one and which points were ``before`` in its
    first half. Of each half, ``counts``, ``kept_ids`` and ``kept`` are the points of the last frame and their phases.
    ``work`` and ``u`` are room.

    Returns `TURNED` if the axis must turn, or else the first suspect point if points are not ``sure``: then nothing was
    done. Otherwise -1.
    """
    m = len(positions)
    if not split_is_known and not holds(positions, amplitudes, ids, axis, before, before_ids, mask):
        return TURNED
    suspect = -1 if sure else first_suspect(positions, bounds, farthest)
    if suspect >= 0:
        return int(suspect)
    largest = 0.0
    for i in range(m):
        largest = max(largest, amplitudes[i])
    points, wanted, names = np.empty((m, 3)), np.empty(m), np.empty(m, np.int64)
    for half in range(2):
        k, loudest = 0, 0.0
        for i in range(m):
            if amplitudes[i] == 0 or mask[i] == (half == 0):
                points[k, 0], points[k, 1], points[k, 2] = positions[i, 0], positions[i, 1], positions[i, 2]
                wanted[k], names[k] = amplitudes[i] / largest, ids[i]
                loudest = max(loudest, wanted[k])
                k += 1
        if loudest == 0:  # only one point is no null
            levels[half] = levels[0]
            for q in range(drives.shape[1]):
                drives[half, q] = 0
            continue
        _update(
            elements=elements, directivity=directivity, nepers=nepers, origin=origin, settings=settings,
            phase_steps=phase_steps, power=power, output=output, steps=steps, gradients=gradients,
            points=points[:k], amplitudes=wanted[:k],
            ids=names, before_ids=kept_ids[half, : counts[half]], before=kept[half], cold=cold,
            work=work, u=u, drive=drives[half],
        )  # fmt: skip
        levels[half] = _level(k, elements.shape[1], True, work, drives[half]) / loudest
        counts[half] = k
        for i in range(k):
            kept_ids[half, i] = names[i]
            kept[half, 0, i], kept[half, 1, i] = u[0, i], u[1, i]
    lowest = min(levels[0], levels[1])
    levels[0], levels[1] = lowest / levels[0], lowest / levels[1]
    return -1
