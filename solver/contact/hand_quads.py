"""The measures of a hand and its sixteen quadrilaterals, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...base.compiling import kernel

__all__ = ["WRIST", "hand_measures", "hand_quads"]

WRIST = 65.8 / 90.4
"""Breadth at the wrist as a part of that at the knuckles (Greiner, see `anatomy`)."""

STIFFNESS = 0.1
"""Weight of a finger's own rest axis against its bones; see `hand_quads`."""
THUMB_ALONG, THUMB_ACROSS = math.cos(math.radians(81)), math.sin(math.radians(81))
SMALL = 1e-9
"""Of unit vectors: keeps the turn of a finger that points straight back to the wrist finite."""


def _hand_quads(landmarks: NDArray[np.float64], widths: NDArray[np.float64], side_sign: float) -> NDArray[np.float64]:
    """The quadrilaterals (16, 4, 3) of a hand from its landmarks (21, 3), all in metres.

    All of a finger's quadrilaterals are broad along one axis u, so each of them is planar, and neighbours share a
    border. That axis is nearly perpendicular to the finger's bones b: it minimises Σ (b·u)² + λ |u - a|². The rest axis
    a is the palm's axis across the knuckles, turned as the finger's first bone is turned from the palm's axis to the
    fingers; the thumb's is rolled first. So u follows the bones of a bent finger, is the rest axis of a straight one,
    and changes smoothly between them.

    ``widths`` (5,) are those of the fingers; ``side_sign`` is 1 for a right hand, -1 for a left one. The palm comes
    first, then three of each finger from the thumb on, base first. Corners: base left, base right, tip right, tip left,
    as seen on the back of the hand with the fingertips up; so they run counterclockwise there.
    """
    quads = np.empty((16, 4, 3))
    across, along, axis, rest, bone = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    long_square = 0.0
    for i in range(3):
        across[i] = side_sign * (landmarks[17, i] - landmarks[5, i])
        along[i] = (landmarks[5, i] + landmarks[9, i] + landmarks[13, i] + landmarks[17, i]) / 4 - landmarks[0, i]
        long_square += along[i] * along[i]
    length = math.sqrt(long_square)
    overlap = (across[0] * along[0] + across[1] * along[1] + across[2] * along[2]) / long_square
    for i in range(3):
        across[i] -= overlap * along[i]
        along[i] /= length
    breadth = math.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
    for i in range(3):
        across[i] /= breadth
    back = np.array(
        [
            across[1] * along[2] - across[2] * along[1],
            across[2] * along[0] - across[0] * along[2],
            across[0] * along[1] - across[1] * along[0],
        ]
    )

    # The palm: from the wrist to the knuckles of index and little finger, in the plane of `across` and `along`.
    left, right = (5, 17) if side_sign > 0 else (17, 5)
    left_width, right_width = (widths[1], widths[4]) if side_sign > 0 else (widths[4], widths[1])
    left_x = left_y = right_x = right_y = 0.0
    for i in range(3):
        left_x += (landmarks[left, i] - landmarks[0, i]) * across[i]
        left_y += (landmarks[left, i] - landmarks[0, i]) * along[i]
        right_x += (landmarks[right, i] - landmarks[0, i]) * across[i]
        right_y += (landmarks[right, i] - landmarks[0, i]) * along[i]
    left_x -= left_width / 2
    right_x += right_width / 2
    wrist = WRIST * (right_x - left_x) / 2
    for i in range(3):
        quads[0, 0, i] = landmarks[0, i] - wrist * across[i]
        quads[0, 1, i] = landmarks[0, i] + wrist * across[i]
        quads[0, 2, i] = landmarks[0, i] + right_x * across[i] + right_y * along[i]
        quads[0, 3, i] = landmarks[0, i] + left_x * across[i] + left_y * along[i]

    for finger in range(5):
        first = 1 + 4 * finger
        for k in range(3):
            square = 0.0
            for i in range(3):
                bone[k, i] = landmarks[first + k + 1, i] - landmarks[first + k, i]
                square += bone[k, i] * bone[k, i]
            length = math.sqrt(square)
            for i in range(3):
                bone[k, i] = bone[k, i] / length

        # The rest axis: turned by the least turn that takes `along` to the first bone.
        onto = 1.0 + SMALL
        aside = 0.0
        for i in range(3):
            rest[i] = THUMB_ALONG * across[i] + side_sign * THUMB_ACROSS * back[i] if finger == 0 else across[i]
            onto += along[i] * bone[0, i]
            aside += rest[i] * bone[0, i]
        for i in range(3):
            rest[i] -= aside / onto * (along[i] + bone[0, i])

        # (Σ b bᵀ + λ I) u ∝ a, by the adjugate of a symmetric matrix, whose determinant is at least λ³.
        xx = yy = zz = STIFFNESS
        xy = xz = yz = 0.0
        for k in range(3):
            xx += bone[k, 0] * bone[k, 0]
            yy += bone[k, 1] * bone[k, 1]
            zz += bone[k, 2] * bone[k, 2]
            xy += bone[k, 0] * bone[k, 1]
            xz += bone[k, 0] * bone[k, 2]
            yz += bone[k, 1] * bone[k, 2]
        cross_xy, cross_xz, cross_yz = xz * yz - xy * zz, xy * yz - xz * yy, xy * xz - xx * yz
        axis[0] = (yy * zz - yz * yz) * rest[0] + cross_xy * rest[1] + cross_xz * rest[2]
        axis[1] = cross_xy * rest[0] + (xx * zz - xz * xz) * rest[1] + cross_yz * rest[2]
        axis[2] = cross_xz * rest[0] + cross_yz * rest[1] + (xx * yy - xy * xy) * rest[2]
        half = widths[finger] / 2 / math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
        for k in range(3):
            quad = 1 + 3 * finger + k
            for i in range(3):
                quads[quad, 0, i] = landmarks[first + k, i] - half * axis[i]
                quads[quad, 1, i] = landmarks[first + k, i] + half * axis[i]
                quads[quad, 2, i] = landmarks[first + k + 1, i] + half * axis[i]
                quads[quad, 3, i] = landmarks[first + k + 1, i] - half * axis[i]
    return quads


def _hand_measures(
    landmarks: NDArray[np.float64], bones: NDArray[np.float64]
) -> tuple[float, float, float, float, float, float]:
    """What `Hand` checks, of landmarks (21, 3) and the mean hand's ``bones`` (20,), both in metres and in one order.

    In metres: the mean length from the wrist to the knuckles; the length from the wrist to the middle of the knuckles;
    the breadth from the index finger's knuckle to the little finger's, across that. Then the shortest and the longest
    of the fingers' bones, each as a part of the mean hand's. Then, in radians, how far the outer joints of the four
    fingers bend to the back of the hand, on average, if it is a right one.
    """
    mean = 0.0
    along = np.zeros(3)
    for knuckle in (5, 9, 13, 17):
        square = 0.0
        for i in range(3):
            aside = landmarks[knuckle, i] - landmarks[0, i]
            along[i] += aside / 4
            square += aside * aside
        mean += math.sqrt(square) / 4
    long_square = along[0] ** 2 + along[1] ** 2 + along[2] ** 2
    broad_square = overlap = 0.0
    for i in range(3):
        across = landmarks[17, i] - landmarks[5, i]
        overlap += across * along[i]
        broad_square += across * across
    if long_square > 0:
        broad_square -= overlap * overlap / long_square
    shortest, longest = math.inf, 0.0
    for finger in range(5):
        for end in range(4 * finger + 2, 4 * finger + 5):
            square = 0.0
            for i in range(3):
                square += (landmarks[end, i] - landmarks[end - 1, i]) ** 2
            part = math.sqrt(square) / bones[end - 1]
            shortest, longest = min(shortest, part), max(longest, part)
    knuckles = math.sqrt(
        (landmarks[17, 0] - landmarks[5, 0]) ** 2
        + (landmarks[17, 1] - landmarks[5, 1]) ** 2
        + (landmarks[17, 2] - landmarks[5, 2]) ** 2
    )
    bend = 0.0
    if knuckles > 0:
        for finger in range(1, 5):
            for joint in range(4 * finger + 2, 4 * finger + 4):
                turned = straight = 0.0
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    inner_j, inner_k = (
                        landmarks[joint, j] - landmarks[joint - 1, j],
                        landmarks[joint, k] - landmarks[joint - 1, k],
                    )
                    outer_j, outer_k = (
                        landmarks[joint + 1, j] - landmarks[joint, j],
                        landmarks[joint + 1, k] - landmarks[joint, k],
                    )
                    turned += (inner_j * outer_k - inner_k * outer_j) * (landmarks[17, i] - landmarks[5, i]) / knuckles
                    straight += inner_j * outer_j
                bend += math.atan2(turned, straight) / 8
    return mean, math.sqrt(long_square), math.sqrt(max(broad_square, 0.0)), shortest, longest, bend


hand_quads = kernel(_hand_quads)
hand_measures = kernel(_hand_measures)
