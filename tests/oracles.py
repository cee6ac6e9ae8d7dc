"""Closed forms that several tests compare with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def quantisation_bound(magnitude: ArrayLike) -> NDArray[np.float64]:
    """Largest distance from a drive of this magnitude to its nearest exact pulse.

    Exact pulses form a staggered lattice in polar coordinates. Around magnitude r its cells measure
    d = (π/50)·√(1 − r²) along the radius and t = (π/50)·r across it, and a point of such a lattice is never further
    than (d² + t²)/(2·max(d, t)) from its nearest neighbour. Two per cent are added because the cells are bent.
    """
    r = np.asarray(magnitude, dtype=np.float64)
    side = np.maximum(r, np.sqrt(np.maximum(0.0, 1 - r * r)))
    return np.asarray(1.02 * np.pi / 50 / 2 / side)
