"""Following hands through what trackers do: numbers that change, hands that vanish for a moment or jump."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

from .frames import HandFrame, TrackedHand

__all__ = ["Follower"]

Place: TypeAlias = list[float]
"""The middle of a palm, (x, y, z) in metres."""

FASTEST = 5.0
"""Metres per second that a palm may move; boxers are at twice that, hands that feel at a tenth."""
SLACK = 0.03
"""Metres that a tracker may be wrong by from one frame to the next."""
GAP = 0.3
"""Seconds for which a hand that has vanished keeps its number."""
DOUBT = 0.05
"""Seconds for which a hand must stay at a place to which it cannot have moved."""
APART = 0.03
"""Metres between the palms of two hands of one side; what is nearer is one hand that is seen twice."""


@dataclass
class _Track:
    """A hand that is followed."""

    id: int
    theirs: int
    side: str
    place: Place
    time: float
    elsewhere: Place | None = None
    since: float = 0.0

    def reach(self, time: float) -> float:
        """How far from its place the hand may be at a time, in metres."""
        return SLACK + FASTEST * max(time - self.time, 0.0)


class Follower:
    """Gives hands numbers of its own, which stay the same as long as it is the same hand.

    A hand is the same if it is where it can have moved to since it was last seen, and has the tracker's number or, if
    that has changed, the same side. One that vanishes keeps its number for `GAP`. A hand that is suddenly elsewhere
    with the tracker's number unchanged is left out until it has stayed there for `DOUBT`; then it is a new hand. A hand
    that is seen twice is given once. What was left out stands in the frame's notes.
    """

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._next = 0

    def forget(self) -> None:
        """Follow no hand any longer; numbers are not used again."""
        self._tracks.clear()

    def follow(self, frame: HandFrame) -> HandFrame:
        """The same frame with numbers of the follower's own, without hands that cannot be."""
        self._tracks = [track for track in self._tracks if frame.time - track.time <= GAP]
        notes = list(frame.notes)
        places = [each.hand.centre.tolist() for each in frame.hands]
        matched = self._matched(frame, places)
        hands: list[TrackedHand] = []
        kept: list[Place] = []
        for number, (each, place) in enumerate(zip(frame.hands, places, strict=True)):
            track, side = matched.get(number), each.hand.side
            if any(
                math.dist(place, at) < APART and other.hand.side == side for other, at in zip(hands, kept, strict=True)
            ):
                notes.append(f"the {side} hand {each.id} was left out: another one is at the same place")
                continue
            if track is None and (doubtful := self._doubted(each.id, place, frame.time, matched)) is not None:
                moved = math.dist(place, doubtful.place)
                notes.append(f"the {side} hand {each.id} was left out: it is suddenly {moved:.2f} m elsewhere")
                continue
            if track is None:
                track = _Track(self._next, each.id, side, place, frame.time)
                self._next += 1
                self._tracks.append(track)
            track.theirs, track.side, track.place, track.time = each.id, side, place, frame.time
            track.elsewhere = None
            hands.append(TrackedHand(each.hand, track.id))
            kept.append(place)
        return HandFrame(frame.time, tuple(hands), frame.number, tuple(notes))

    def _matched(self, frame: HandFrame, places: list[Place]) -> dict[int, _Track]:
        """Which of the frame's hands is which one that is followed: the tracker's number first, then the nearest."""
        pairs = []
        for track in self._tracks:
            for number, (each, place) in enumerate(zip(frame.hands, places, strict=True)):
                away = math.dist(track.place, place)
                same = each.id == track.theirs
                if away <= track.reach(frame.time) and (same or each.hand.side == track.side):
                    pairs.append((not same, away, number, track))
        found: dict[int, _Track] = {}
        for _, _, number, track in sorted(pairs, key=lambda pair: pair[:3]):
            if number not in found and all(track is not other for other in found.values()):
                found[number] = track
        return found

    def _doubted(self, theirs: int, place: Place, time: float, matched: dict[int, _Track]) -> _Track | None:
        """The hand that this would be by its number if it were not too far away, unless it has been there for long."""
        for track in self._tracks:
            if track.theirs != theirs or any(track is other for other in matched.values()):
                continue
            near = track.elsewhere is not None and math.dist(track.elsewhere, place) <= SLACK + FASTEST * DOUBT
            if not near:
                track.since = time
            track.elsewhere = place
            if near and time - track.since >= DOUBT:
                self._tracks.remove(track)
                return None
            return track
        return None
