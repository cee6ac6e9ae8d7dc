"""Hands: 21 landmarks, and the sixteen quadrilaterals that feel (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import as_points, frozen

__all__ = ["LANDMARKS", "QUADS", "Hand", "Side"]

LANDMARKS = 21
QUADS = 16
"""Quadrilaterals of a hand: the palm, then three of each finger from the thumb to the little finger, base first."""

Side: TypeAlias = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class Hand:
    """A hand at one moment.

    Parameters
    ----------
    landmarks : (21, 3) float
        In metres, in the array's coordinates, in the order of MediaPipe's hand landmarks: the wrist; then of thumb,
        index, middle, ring and little finger four each, from the base to the tip.
    side : str
        "left" or "right".
    """

    landmarks: NDArray[np.float64]
    side: Side

    def __init__(self, landmarks: ArrayLike, side: Side = "right") -> None:
        object.__setattr__(self, "landmarks", frozen(as_points(landmarks, "landmark")))
        object.__setattr__(self, "side", side)
