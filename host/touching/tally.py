"""The counts of a loop, as they grow."""

from __future__ import annotations

from ..hands.frames import HandFrame
from .latency import Latencies
from .report import STAGES, TouchReport
from .turns import StoredTurns, Turns

__all__ = ["Tally"]


class Tally:
    """Counts what becomes of each frame, for a `TouchReport`.

    Attributes
    ----------
    stalls, held_up, out_of_reach : int
        As in `TouchReport`.
    """

    def __init__(self) -> None:
        self.stalls = self.held_up = self.out_of_reach = 0
        self._frames = self._dropped = self._stale = self._touching = self._notes = 0
        self._points_sum = self._points_most = 0
        self._last_note = ""
        self._number: int | None = None
        self._latency = Latencies()
        self._stages = {stage: Latencies() for stage in STAGES}

    def took(self, frame: HandFrame) -> None:
        """Count a frame, and those that are missing before it."""
        self._frames += 1
        if self._number is not None:
            self._dropped += max(frame.number - self._number - 1, 0)
        self._number = frame.number
        if frame.notes:
            self._notes, self._last_note = self._notes + len(frame.notes), frame.notes[-1]

    def passed_over(self, frame: HandFrame) -> None:
        """Count a frame that is no news; it is not missing before the next one."""
        self._stale += 1
        self._number = frame.number

    def touched(self, points: int) -> None:
        """Count a frame whose hands touch so many points in reach."""
        self._touching += points > 0
        self._points_sum += points
        self._points_most = max(self._points_most, points)

    def sent(self, *passed: float) -> None:
        """Count the seconds that a frame took in each of `STAGES`."""
        for stage, seconds in zip(self._stages.values(), passed, strict=True):
            stage.add(seconds)
        self._latency.add(sum(passed))

    def report(self, seconds: float, turns: Turns, least_gain: float) -> TouchReport:
        """As it stands after so many seconds."""
        return TouchReport(
            seconds,
            self._frames,
            self._dropped,
            self._touching,
            self._stale,
            self.stalls,
            self._points_sum / self._touching if self._touching else 0.0,
            self._points_most,
            self.out_of_reach,
            turns.blocks,
            turns.late,
            turns.slipped,
            self.held_up,
            self._notes,
            self._last_note,
            0.0 if turns.alternation is None else turns.alternation.frequency,
            isinstance(turns, StoredTurns),
            least_gain,
            self._latency.summary,
            {name: stage.summary for name, stage in self._stages.items()},
        )
