"""Pictures for tests: what a pinhole camera sees of a hand."""

from __future__ import annotations

import math

import numpy as np
from phasewire.host.hands.pinhole import Landmarks

__all__ = ["project"]


def project(hand: Landmarks, aspect: float, view_degrees: float) -> Landmarks:
    """Landmarks as MediaPipe defines them, of (21, 3) landmarks in camera coordinates, in metres."""
    right, down, away = hand.T
    half = math.tan(math.radians(view_degrees) / 2)
    return np.column_stack(
        (
            (right / (away * half) + 1) / 2,
            (down / (away * half * aspect) + 1) / 2,
            (away - away[0]) / (2 * half * away[0]),
        )
    )
