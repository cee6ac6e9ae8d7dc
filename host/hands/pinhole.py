"""From a picture to space: where the landmarks are that a camera sees.

A camera has no measure of depth, so two things must be known: how wide the camera sees, and how long the hand is. Then
the palm's apparent length gives the distance, and each landmark lies on its own line of sight.

Camera coordinates are in metres: x to the picture's right, y to its bottom, z away from the camera. They are
right-handed, as the array's are.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...solver.contact.anatomy import LENGTH, NEUTRAL, PALM, Side

__all__ = ["Landmarks", "in_space", "unmirrored"]

Landmarks: TypeAlias = NDArray[np.float64]

WRIST = 0


def unmirrored(landmarks: Landmarks, side: Side) -> tuple[Landmarks, Side]:
    """What would have been seen in the picture as the camera took it, if it was mirrored before anyone looked.

    Parameters
    ----------
    landmarks : (21, 3) float
        The landmarks in a mirrored picture; x from 0 at its left to 1 at its right.
    side : str
        The side of the hand, as it looks there: a mirror turns right hands into left ones.
    """
    return np.column_stack((1 - landmarks[:, 0], landmarks[:, 1:])), "left" if side == "right" else "right"


def in_space(landmarks: Landmarks, aspect: float, view_degrees: float, length: float = LENGTH) -> Landmarks:
    """Landmarks in camera coordinates: the pinhole camera turned around.

    A length s at depth Z fills s/(2·Z·tan(view/2)) of the picture's width. The landmarks' own z is on the same scale
    (weak perspective), so it is a part of the wrist's depth Z; and the palm's length settles Z.

    Parameters
    ----------
    landmarks : (21, 3) float
        The landmarks as MediaPipe gives them: x and y as parts of the picture's width and height, from its top left
        corner; z relative to the wrist, on the scale of x, and smaller if closer to the camera.
    aspect : float
        The picture's height divided by its width.
    view_degrees : float
        The angle that the picture's width fills.
    length : float
        The length of the hand, from the wrist's crease to the middle fingertip, in metres. Its palm has the mean hand's
        part of it: the mean distance from the wrist to the four knuckles.

    Returns
    -------
    (21, 3) float
        In metres.

    Raises
    ------
    ValueError
        If no hand can look like this: a number is not finite, a landmark lies in or behind the camera, or the
        palm is a point.
    """
    if not np.isfinite(landmarks).all():
        raise ValueError("a landmark is not finite")
    width = 2 * math.tan(math.radians(view_degrees) / 2)
    depth = 1 + width * (landmarks[:, 2] - landmarks[WRIST, 2])
    if depth.min() <= 0:
        raise ValueError("a landmark lies in or behind the camera")
    sight = np.column_stack(
        ((landmarks[:, 0] - 0.5) * width, (landmarks[:, 1] - 0.5) * width * aspect, np.ones(len(landmarks)))
    )
    shape = sight * depth[:, None]
    apparent = _palm(shape)
    if apparent < 1e-6:
        raise ValueError("wrist and knuckles are one point in the picture")
    return np.asarray(shape * (_palm(NEUTRAL) * length / LENGTH / apparent))


def _palm(landmarks: Landmarks) -> float:
    return float(np.linalg.norm(landmarks[PALM] - landmarks[WRIST], axis=1).mean())
