"""Features of a trial: the picture in space that a person could form of it, coarse and without knowledge of the object.

Each cell of skin seems to be somewhere at each moment. Space is divided into cubes of `CUBE`; of each, one feature is
the mean strength that was noticed in it, and one the share of all the time that skin spent in it. Nothing is measured
that supposes a shape: no edges, corners or radii.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .noticing import Sensed

__all__ = ["FELT", "picture_in_space"]

CUBE = 0.025
"""In metres: more than twice the error of the hand's place, and a quarter of the objects' size."""
LOW = np.array([-0.075, -0.075, 0.095])
HIGH = np.array([0.075, 0.075, 0.245])
"""The space that counts, in metres: the objects' cube of 10 cm with a cube of 2.5 cm on each side."""
SHAPE = tuple(np.rint((HIGH - LOW) / CUBE).astype(int).tolist())
FELT = slice(0, int(np.prod(SHAPE)))
"""The features that come from the skin; the others come from where the hand was."""


def picture_in_space(sensed: Sensed) -> NDArray[np.float64]:
    """The features of a trial, (2·cubes,): noticed strength in each cube, then the share of time spent in each."""
    bins = np.floor((sensed.places.reshape(-1, 3) - LOW) / CUBE).astype(int)
    inside = ((bins >= 0) & (bins < SHAPE)).all(axis=1)
    which = np.ravel_multi_index(tuple(bins[inside].T), SHAPE)
    count = int(np.prod(SHAPE))
    visits = np.bincount(which, minlength=count)
    strength = np.bincount(which, sensed.levels.ravel()[inside], minlength=count)
    return np.concatenate([strength / np.maximum(visits, 1), visits / max(len(bins), 1)])
