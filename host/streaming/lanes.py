"""One device's lane in a stream: its part of each frame, the limits of its line, its clock, and the results.

A stream has a lane for each of its devices. It plans frames by the periods of the first one; `Lane.offset` leads over
to the device's own.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import ceil

import numpy as np
from numpy.typing import NDArray

from ...base.errors import DeviceError
from ...protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from ...protocol.codes import PROMISED_PERIODS, AckFlag, Fault, Reason
from ...protocol.quantise import PulseFrames
from ...protocol.replies import Status
from ...protocol.updates import pack_updates
from .clock import DeviceClock, Reading
from .ledger import DAMAGE, Answers, Parcel
from .session import Session

__all__ = ["LANE_COUNTS", "NEVER", "Lane", "naming", "unchanged"]

LEAST_LEAD_PERIODS = PROMISED_PERIODS + 1
"""One more for the transfer."""
ASTRAY_PPM, MOST_ASTRAY = 500_000, 8
"""A clock that seems to run at half the host's rate or less, or at one and a half times it, in so many consecutive
readings, 2 s, cannot time frames. A device that is only delayed catches up sooner."""
LANE_COUNTS = ("sent", "accepted", "late", "damaged", "refused", "unanswered", "missed_commits")
NEVER = 2**63
NO_FAULTS = Fault(0)
# Plain numbers, for arrays: NumPy asks a member of an enum for attributes, and a Ctrl-C that comes meanwhile is lost.
ACCEPTED, LATE = int(Reason.ACCEPTED), int(AckFlag.LATE)
DAMAGED = [int(reason) for reason in DAMAGE]
TURN_PERIODS = 200
"""5 ms, for which a transfer may wait for room in the queue: others wait for their turn meanwhile."""
POSTED_PERIODS = 2400
"""60 ms, by which frames that are there already go early on a line that carries blocks by itself, the first of a
transfer by two thirds of it; as long they may wait for room, so that the host need not."""
POSTED_SHARE = 0.8
"""Of the blocks that may be unanswered: those that wait for their time. Answers to the others are on their way."""
ROUND_TRIPS = 3
"""The factor on an answer's time for the look-ahead on such a line: some answers take several times as long."""
MOST_BLOCKS = 128
"""The most in one transfer: at 40 000 frames a second others wait 3 ms for their turn."""


def unchanged(frames: PulseFrames) -> PulseFrames:
    """The part of a device that plays whole frames."""
    return frames


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Name one of several devices in its errors, once: the innermost name is right."""
    try:
        yield
    except DeviceError as error:
        if name and error.device is None:
            error.args, error.device = (f"{name}: {error}", *error.args[1:]), name
        raise


class Lane:
    """One device's lane in a stream.

    Parameters
    ----------
    session : Session
        The session with the device.
    permit : callable
        Raises a `DeviceError` if the stream must end.
    begin : callable
        Enables the outputs.

    Attributes
    ----------
    restore : callable or None
        Opens a lost device again when it is back, and restores its state; without it, the stream ends there.
    name : str
        The device's name in errors; empty if it needs none, as the only one.
    part : callable
        Its pulses of the frames of all.
    offset : int
        The number of periods by which its count is ahead of the first device's.
    clock : DeviceClock
        Its time by the host's.
    """

    def __init__(self, session: Session, *, permit: Callable[[], None], begin: Callable[[], object]) -> None:
        self.session, self.permit, self.begin = session, permit, begin
        self.restore: Callable[[], None] | None = None
        self.name = ""
        self.part: Callable[[PulseFrames], PulseFrames] = unchanged
        self.offset = 0
        self.clock = DeviceClock()
        blocks_per_period = session.line().most_blocks_per_second / CARRIER_HZ  # of some lines infinite
        self.block_lead = LEAST_LEAD_PERIODS + ceil(1 / blocks_per_period)
        self.most_blocks = max(1, int(min(MOST_BLOCKS, TURN_PERIODS * blocks_per_period)))
        self.held_up = 0
        """If the line carries blocks by itself: the periods by which frames were late."""
        self._on_the_way = self.way = 0
        """For such a line: the periods that an answer takes at the most, and those that a block takes as a rule."""
        self.posted = deque[tuple[int, Parcel]]()
        """Number of the last frame of each parcel, and the parcel."""
        self.counts = Counter[str]()
        self.faults = NO_FAULTS
        self.first = self.last = 0
        self.least = NEVER
        self._astray = 0
        self._missed_before: int | None = None

    @property
    def posts(self) -> bool:
        """Whether the line carries blocks by itself."""
        return self.session.line().posts

    # How early frames go

    def horizon(self, asked: int, spacing: float, ready: bool) -> float:
        """How many periods before its own a frame may be sent at the earliest.

        Parameters
        ----------
        asked : int
            The requested look-ahead, in periods.
        spacing : float
            Periods between frames.
        ready : bool
            Whether the frames are there already.
        """
        early = self.posts and ready
        turn = POSTED_PERIODS if early else TURN_PERIODS
        look_ahead = max(asked, turn if early else 0) + ROUND_TRIPS * self._on_the_way + self.held_up
        horizon = min(look_ahead, self.session.info.queue_blocks * spacing + turn)
        if early:
            blocks = self.session.line().window(None, self.session.info.queue_records)
            horizon = min(horizon, POSTED_SHARE * blocks * spacing)
        return horizon

    # Its time

    def forget_clock(self) -> None:
        """Begin with the clock afresh: the device may have restarted."""
        self.clock, self._missed_before = DeviceClock(), None

    def read_clock(self) -> Status:
        """Read the device's time, and its status."""
        keeper = self.session.time
        with self.session.lock:
            before = keeper.monotonic()
            status = self.session.status()
            after = keeper.monotonic()
        self.clock.add(Reading(before, after, status.now))
        if self.posts:
            self._on_the_way = ceil(self.clock.longest * CARRIER_HZ)
            self.way = ceil(self.clock.usual / 2 * CARRIER_HZ)
        self._astray = self._astray + 1 if abs(self.clock.drift_ppm) > ASTRAY_PPM else 0
        if self._astray > MOST_ASTRAY:
            raise DeviceError(
                f"the time of {self.session.name} passes at {1 + self.clock.drift_ppm / 1e6:.3g} of this computer's, "
                "and a stream needs both to agree; `phasewire emulate --pace fast` does not stream, --pace wall does"
            )
        self.faults |= status.faults
        if self._missed_before is None:  # counts restart if a device was without power
            self._missed_before = status.missed_commits - self.counts["missed_commits"]
        self.counts["missed_commits"] = status.missed_commits - self._missed_before
        return status

    def now(self) -> float:
        """The present period by the first device's count, with its fraction."""
        return self.clock.period_at(self.session.time.monotonic()) - self.offset

    # Its blocks

    def load(self, frames: PulseFrames) -> None:
        """Load and compile what packing frames needs, so that an enabled device is not kept waiting."""
        pack_updates(*self.part(frames), sequence=0)

    def post(self, frames: PulseFrames, first: int, periods: NDArray[np.uint64]) -> None:
        """Send the device's part of frames, numbered from the first on, each for a period of the first device."""
        count = len(frames.phase)
        number, restart = self.session.upcoming
        own = (periods.astype(np.int64) + self.offset).astype(np.uint64)
        blocks = pack_updates(*self.part(frames), number, own, restart=restart)
        self.counts["sent"] += count
        self.counts["unanswered"] += count
        self.posted.append((first + count - 1, parcel := Parcel(number, Answers.none(count))))
        self.session.post(blocks, parcel)

    def account(self, acks: NDArray[np.void]) -> None:
        """Count the results of blocks."""
        if not len(acks):
            return
        count = self.counts
        count["unanswered"] -= len(acks)
        accepted = acks[acks["reason"] == ACCEPTED]
        if len(accepted):
            begins = accepted["commit_period"]
            count["accepted"] += len(accepted)
            count["late"] += int(np.count_nonzero(accepted["flags"] & LATE))
            self.first = self.first or int(begins[0])
            self.last = int(begins[-1])
            self.least = min(self.least, int((begins - accepted["now"] // TICKS_PER_PERIOD).min()))
        if refused := len(acks) - len(accepted):
            damaged = int(np.isin(acks["reason"], DAMAGED).sum())
            count["damaged"] += damaged
            count["refused"] += refused - damaged
