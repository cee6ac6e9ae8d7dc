"""The outline of a hand as it is drawn: fingers with round tips, webs between them, a palm with round corners.

What feels is the sixteen quadrilaterals of `Hand.quads`; an outline only shows where the hand is.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import frozen
from .hand import Hand

__all__ = ["seen_along", "silhouette"]

STEP = 1e-3
"""Metres between the places at which it is asked what is inside."""
SMOOTH = 2.5e-3
"""Metres, standard deviation of the smoothing: it closes slits of about twice that and rounds corners."""


def silhouette(
    joints: NDArray[np.float64], widths: NDArray[np.float64], palm: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Outlines of a hand in a plane: of the union of a capsule for each bone with the palm, smoothed; all in metres.

    ``joints`` (5, 4, 2) are each finger's from the base to the tip, ``widths`` (5,) the fingers', and ``palm`` (4, 2)
    is a convex quadrilateral. The outlines (k, 2) are closed; there is one, if fingers enclose nothing.
    """
    from contourpy import contour_generator
    from scipy.ndimage import gaussian_filter

    bones = joints[:, 3] - joints[:, 2]
    lengths = np.linalg.norm(bones, axis=1)
    ends = joints.copy()  # the round end of a capsule reaches to the fingertip
    ends[:, 3] -= bones * (np.minimum(widths / 2, lengths) / np.maximum(lengths, 1e-9))[:, None]
    margin = widths.max() / 2 + 4 * SMOOTH
    every = np.concatenate([joints.reshape(-1, 2), palm])
    x, y = (np.arange(low, high, STEP) for low, high in zip(every.min(0) - margin, every.max(0) + margin, strict=True))
    at = np.stack(np.meshgrid(x, y), axis=-1)
    outside = _outside(palm, at)
    for finger, width in zip(ends, widths, strict=True):
        for start, end in pairwise([palm.mean(axis=0), *finger]):
            bone = end - start
            part = np.clip((at - start) @ bone / max(bone @ bone, 1e-12), 0, 1)
            outside = np.minimum(outside, np.linalg.norm(at - start - part[..., None] * bone, axis=-1) - width / 2)
    inside = gaussian_filter(np.clip(0.5 - outside / STEP, 0, 1), SMOOTH / STEP)
    return [frozen(np.asarray(line)) for line in contour_generator(x, y, inside).lines(0.5)]


def seen_along(hand: Hand, axes: ArrayLike) -> list[NDArray[np.float64]]:
    """Outlines of a hand seen at right angles to two (2, 3) orthogonal unit vectors: (k, 2) along these, in metres."""
    plane = np.asarray(axes, dtype=np.float64).T
    return silhouette(hand.landmarks[1:].reshape(5, 4, 3) @ plane, hand.widths, hand.quads[0] @ plane)


def _outside(quad: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far places are outside of a convex quadrilateral; negative inside. One seen from its edge has no inside."""
    sides = np.roll(quad, -1, axis=0) - quad
    area = np.cross(np.append(quad[2] - quad[0], 0), np.append(quad[3] - quad[1], 0))[2]
    if abs(area) < STEP**2:
        return np.full(at.shape[:-1], np.inf)
    normals = np.sign(area) * np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return np.asarray(np.max((at @ normals.T) - np.einsum("si,si->s", normals, quad), axis=-1))
