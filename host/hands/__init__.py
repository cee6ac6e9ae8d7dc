"""Where hands come from: trackers, recordings and gestures, each found by the scheme of its URL.

This room gives hands with the time at which they were seen, in the array's coordinates. It knows no device, and nothing
of what hands touch.
"""

from __future__ import annotations

from .frames import HandFrame, TrackedHand
from .placing import PlacedHands
from .pose import Pose
from .recording import HandRecorder, HandRecording
from .sources import HandSource, Readiness, TrackerScheme, open_hands

__all__ = [
    "HandFrame",
    "HandRecorder",
    "HandRecording",
    "HandSource",
    "PlacedHands",
    "Pose",
    "Readiness",
    "TrackedHand",
    "TrackerScheme",
    "open_hands",
]
