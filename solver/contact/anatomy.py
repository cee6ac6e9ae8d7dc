"""The proportions of a hand of mean size, and hands that are posed by them.

The hand is 189.3 mm long from the wrist's crease to the middle fingertip, and 85 mm broad at the knuckles: means of men
and women in ANSUR II, the US Army's survey of 2012. Its bones are those of Buryanov and Kotiuk (Proportions of hand
segments, Int. J. Morphol. 28(3), 2010, table I), the fingertip's soft tissue included. Its finger breadths, at the
middle joints, are Greiner's (Hand anthropometry of US Army personnel, Natick TR-92/011,
1991), in proportion to the breadth of the hand, 90.4 mm there.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..geometry import frozen

__all__ = ["BONES", "FINGERS", "LENGTH", "NEUTRAL", "PALM", "PARENTS", "WIDTHS", "Side", "posed"]

Side: TypeAlias = Literal["left", "right"]
FINGERS = ("thumb", "index finger", "middle finger", "ring finger", "little finger")
LENGTH = 0.1893
"""Of the mean hand, in metres."""
WIDTHS = frozen(np.array([24.0, 23.0, 22.5, 21.4, 19.2]) * 85 / 90.4 * 1e-3)
"""(5,) breadth of each finger of the mean hand, in metres."""
PALM = frozen(np.array([5, 9, 13, 17]))
"""Landmarks at the knuckles."""
PARENTS = frozen(np.array([0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19]))
"""(20,) the landmark from which a bone leads to each landmark but the wrist."""
_BONES_MM = (
    (46.22, 31.57, 21.67 + 5.67),
    (39.78, 22.38, 15.82 + 3.84),
    (44.63, 26.33, 17.40 + 3.95),
    (41.37, 25.65, 17.30 + 3.95),
    (32.74, 18.11, 15.96 + 3.73),
)
_BASES_MM = ((-22, 20, -10), (-32.9, 91.3, 0), (-10.5, 96.4, 0), (11.1, 91.3, 0), (31.2, 79, 0))
"""Of the right hand's fingers, from the wrist: x to the right, y to the fingertips, z to the back of the hand. The
knuckles are as far apart as fingers side by side, and as far from the wrist as Greiner's fingertips say."""
_FAN_DEGREES = (-40, -5, 0, 5, 11)
"""How far each finger of the open hand points away from the middle one, to the little finger's side."""
_CURLED_DEGREES = ((10, 40, 50), (75, 95, 60), (75, 95, 60), (75, 95, 60), (75, 95, 60))
"""How far each joint of each finger bends in a fist, the base joint first."""
_THUMB_ROLL_DEGREES = 81
"""How far the thumb is turned about its length: Cooney et al., The kinesiology of the thumb trapeziometacarpal joint,
J. Bone Joint Surg. 63, 1981."""
_FAN = np.deg2rad(_FAN_DEGREES)[:, None]
_ROLL = np.deg2rad([_THUMB_ROLL_DEGREES, 0, 0, 0, 0])[:, None]
_ALONG = np.hstack([np.sin(_FAN), np.cos(_FAN), 0 * _FAN])
"""(5, 3) direction of each straight finger."""
_BACK = np.cos(_ROLL) * np.array([0, 0, 1]) - np.sin(_ROLL) * np.hstack([np.cos(_FAN), -np.sin(_FAN), 0 * _FAN])
"""(5, 3) direction of its back."""
_BENDS = np.cumsum(np.deg2rad(_CURLED_DEGREES), axis=1)


def posed(side: Side, curl: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Landmarks (21, 3) of the mean hand with its fingers bent, in metres.

    The wrist is at the origin, the fingertips are to +y, the back of the hand to +z. ``curl`` is that of all fingers,
    or of each from the thumb on: 0 is straight, 1 as in a fist.
    """
    angles = (_BENDS * np.reshape(curl, (-1, 1)))[:, :, None]
    bones = (np.cos(angles) * _ALONG[:, None] - np.sin(angles) * _BACK[:, None]) * np.array(_BONES_MM)[:, :, None]
    fingers = np.cumsum(np.concatenate([np.array(_BASES_MM)[:, None], bones], axis=1), axis=1)
    points = np.vstack([np.zeros(3), fingers.reshape(20, 3)]) * 1e-3
    return points if side == "right" else points * np.array([-1, 1, 1])


NEUTRAL = frozen(posed("right"))
BONES = frozen(np.linalg.norm(NEUTRAL[1:] - NEUTRAL[PARENTS], axis=1))
"""(20,) lengths of the mean hand's bones in metres, each named by the landmark at its end less 1."""
