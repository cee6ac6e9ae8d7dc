"""What the device knows of itself: its state, its faults, what plays, its limits and its counters.

STATUS tells these values, and blocks are judged by them. They are plain values that the other parts of the controller
read and write. This module knows no clock, no chain and no door, and it plans nothing: `state_machine` alone changes
the state, and `known_faults` the faults.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...protocol.blocks import Block
from ...protocol.board import CHANNELS
from ...protocol.codes import Fault, Reason, State
from ...protocol.numbering import missing

__all__ = ["DeviceState", "SequenceRun"]


@dataclass(frozen=True, eq=False)
class SequenceRun:
    """A sequence that plays."""

    duration: int | None
    """Periods, None for without end."""
    unattended: bool
    ends: int | None = None
    """Period at which it has played its last repeat, once it has begun."""

    def begun(self, period: int) -> SequenceRun:
        """The same from a period on."""
        return replace(self, ends=None if self.duration is None else period + self.duration)


class DeviceState:
    """The device as it is after power-up, until something changes it."""

    def __init__(self) -> None:
        self.state = State.OFF
        self.faults = Fault(0)
        self.watchdog_fired = False
        self.bus_suspended = False
        self.drive_limit = CHANNELS
        self.last_refusal = Reason.ACCEPTED
        self.last_sequence: int | None = None
        """Number of the last block that was accepted in this session."""
        self.last_named: int | None = None
        """The last period that an update has named since the outputs were enabled."""
        self.runs: SequenceRun | None = None
        """The sequence that plays."""
        self.modulation_plays = False
        self.since_period = 0
        """Since which period plays what plays, 0 if nothing does."""
        self.accepted = self.refused = self.late = self.lost = self.dropped_frames = 0

    def count(self, block: Block) -> int:
        """Count an accepted block; how many numbers were left out before it (clause NUM-003)."""
        gap = 0
        if not block.restart and self.last_sequence is not None:
            gap = missing(block.sequence, self.last_sequence)
        self.last_sequence = block.sequence
        self.lost += gap
        return gap

    def play_nothing(self) -> None:
        """From now on nothing plays."""
        self.runs, self.modulation_plays, self.since_period = None, False, 0
