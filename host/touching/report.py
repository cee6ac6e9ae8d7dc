"""What became of a session of touch, in numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from .latency import Latency

__all__ = ["STAGES", "TouchReport"]

STAGES = ("wait", "cut", "solve", "send")
"""Of a pose: since its time stamp, prediction and cut, its fields, and its blocks until their acknowledgement."""


NOTHING = Latency()


@dataclass(frozen=True)
class TouchReport:
    """What became of the frames of a source of hands.

    Parameters
    ----------
    seconds : float
        How long it took, by the device's clock.
    frames : int
        The number of frames of hands that were taken.
    dropped : int
        Frames between these that the loop, or the source, came too late for.
    touching : int
        Frames in which a hand touched an object.
    stale : int
        Frames of a live source that were no news: repeated, gone back, or too old (`Liveness`). They are not played.
    stalls : int
        How often the source gave no news for so long that the outputs were silenced.
    points_mean : float
        Points that were played, on average of the poses that touched.
    points_most : int
        The most points.
    out_of_reach : int
        Points that were left out, over all frames, because the array cannot reach them.
    blocks : int
        Blocks that were sent for fields.
    late : int
        How many of these began later than the carrier period that they named.
    slipped : int
        Turns of the modulation for which the host came too late.
    held_up : int
        How often the device's watchdog had turned the outputs off because the host was held up.
    notes : int
        How often the source said what was wrong with its hands.
    last_note : str
        What it said last.
    frequency_hz : float
        The frequency at which the fields of the last pose were repeated, as it came out; 0 if there were none.
    stored : bool
        Whether the device took the turns from its memory, because the way of rendering has more than two fields, or the
        line is too slow for a block each.
    least_gain : float
        The smallest factor by which a limit has turned a pose down; 1 without a limit.
    latency : Latency
        The time from the time stamp of a frame to the answer to the last block sent for it. Time stamps are by the
        device's
        clock, and work between them by the computer's: of an emulated device, whose time stands still meanwhile, both
        count.
    stages : dict of str to Latency
        The parts of that for each of `STAGES`.
    """

    seconds: float = 0.0
    frames: int = 0
    dropped: int = 0
    touching: int = 0
    stale: int = 0
    stalls: int = 0
    points_mean: float = 0.0
    points_most: int = 0
    out_of_reach: int = 0
    blocks: int = 0
    late: int = 0
    slipped: int = 0
    held_up: int = 0
    notes: int = 0
    last_note: str = ""
    frequency_hz: float = 0.0
    stored: bool = False
    least_gain: float = 1.0
    latency: Latency = NOTHING
    stages: dict[str, Latency] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """Frames per second."""
        return self.frames / self.seconds if self.seconds > 0 else 0.0

    def __str__(self) -> str:
        """One line for people."""
        parts = [f"{self.frames} hand frames at {self.rate:.0f}/s", f"{self.touching} touching"]
        if self.touching:
            parts += [f"{self.points_mean:.0f} points", f"latency {self.latency}"]
        for count, what in (
            (self.dropped, "dropped"),
            (self.out_of_reach, "points out of reach"),
            (self.late, "blocks late"),
            (self.slipped, "turns slipped"),
            (self.stale, "frames that were no news"),
            (self.stalls, "stalls"),
            (self.held_up, "times held up"),
            (self.notes, "notes on hands"),
        ):
            if count:
                parts.append(f"{count} {what}")
        return ", ".join(parts)

    def record(self) -> dict[str, Any]:
        """All of it, for JSON."""
        return asdict(self) | {"rate": self.rate}
