"""What is seen in one picture after the other, made into frames of hands in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ...solver.contact.anatomy import LENGTH
from ...solver.contact.hand import Hand, Side
from .following import Follower
from .frames import HandFrame, TrackedHand
from .pinhole import Landmarks, in_space, unmirrored

__all__ = ["CameraView", "PictureTracker", "SeenHand"]


@dataclass(frozen=True)
class CameraView:
    """How a camera sees.

    Parameters
    ----------
    fov : float
        The angle that the picture's width fills, in degrees.
    length : float
        The length of the hands that are seen, from the wrist's crease to the middle fingertip, in metres. All distances
        are in proportion to it.
    mirrored : bool
        Whether the picture is a mirror's, as programs for selfies show it.
    hands : int
        How many hands are looked for.
    """

    fov: float = 60.0
    length: float = LENGTH
    mirrored: bool = False
    hands: int = 2


@dataclass(frozen=True, eq=False)
class SeenHand:
    """A hand in a picture.

    Parameters
    ----------
    landmarks : (21, 3) float
        The landmarks as MediaPipe gives them; see `pinhole.in_space`.
    side : str
        The side as it looks in the picture.
    """

    landmarks: Landmarks
    side: Side


@dataclass
class PictureTracker:
    """Turns what is seen in pictures, one after the other, into frames of hands in camera coordinates.

    MediaPipe numbers no hands, so each one that is seen gets a new number, and a `Follower` finds which ones stay.
    """

    view: CameraView
    _follower: Follower = field(default_factory=Follower)
    _seen: int = 0
    _frames: int = 0

    def frame(self, time: float, seen: Sequence[SeenHand], aspect: float) -> HandFrame:
        """The hands that are seen in a picture whose height is ``aspect`` times its width."""
        notes, tracked = [], []
        for each in seen:
            landmarks, side = each.landmarks, each.side
            if self.view.mirrored:
                landmarks, side = unmirrored(landmarks, side)
            try:
                hand, repairs = Hand.repaired(in_space(landmarks, aspect, self.view.fov, self.view.length), side)
            except ValueError as error:
                notes.append(f"a {side} hand was left out: {error}")
                continue
            notes.extend(repairs)
            tracked.append(TrackedHand(hand, self._seen))
            self._seen += 1
        self._frames += 1
        return self._follower.follow(HandFrame(time, tuple(tracked), self._frames - 1, tuple(notes)))
