"""Frames to a device at a rate, each in its own carrier period.

Frame k is due at period start + ⌊k · 40 000 / rate⌋ of the device's clock, and is sent a little earlier: the *look-
ahead*. Frames that are there already go many in a transfer, as soon as there are enough of them or half of the
look-ahead is used up, a third on a line that carries blocks by itself; those of a live source go one by one. What the
device's queue cannot hold yet waits in the transfer, held back by NAK or by credit, but not for long. If source or host
come too late for a frame, that is an *underrun*: the rest of the stream is moved to a later start, so that frames keep
their distance and their order.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from ...errors import DeviceError, DeviceLostError, DeviceStalledError, DeviceTimeoutError
from ...protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from ...protocol.codes import AckFlag, Fault, Reason
from ...protocol.replies import Ack
from ...protocol.updates import pack_updates
from .clock import DeviceClock, Reading
from .frames import FrameSource, PulseFrames, check_rate
from .ledger import DAMAGE, Answers, Parcel
from .session import Session

__all__ = ["LOOK_AHEAD_SECONDS", "Stream", "StreamReport"]

LOOK_AHEAD_SECONDS = 0.01
MOST_LOOK_AHEAD_SECONDS = 10.0
LEAST_LEAD_PERIODS = 6
"""A change five periods after its arrival is in time (clause BLK-005); one more for the transfer."""
FIRST_READINGS = 8
READING_SECONDS = 0.25
ASTRAY_PPM, MOST_ASTRAY = 500_000, 8
"""A clock that seems to run at half the host's rate or less, or at one and a half times it, in so many consecutive
readings, 2 s, cannot time frames. A device that is only delayed catches up sooner."""
PROGRESS_SECONDS = 0.1
MOST_LATE_SHARE = 0.01
"""Share of the frames; one pause of a computer is no reason to choose another rate."""
COUNTS = (
    "sent",
    "accepted",
    "late",
    "damaged",
    "refused",
    "unanswered",
    "underruns",
    "moved_periods",
    "reconnects",
    "missed_commits",
)
NEVER = 2**63
NO_FAULTS = Fault(0)
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


@dataclass(frozen=True)
class StreamReport:
    """The results of a stream; each frame is counted once as accepted, damaged, refused or unanswered.

    Parameters
    ----------
    rate : float
        Frames per second, as requested.
    sent : int
        Frames that were passed to the line.
    accepted : int
        Frames that the device has accepted.
    late : int
        Of these, how many could not begin in their named period, and began later.
    damaged : int
        Frames that arrived damaged, and so were not played.
    refused : int
        Frames that the device refused, at which the stream ended.
    unanswered : int
        Frames that may or may not have arrived: the line or the device was lost before it could answer.
    underruns : int
        How often source or host was too late, and the rest of the stream was moved.
    moved_periods : int
        By how many carrier periods in all.
    reconnects : int
        How often the device was lost and came back.
    missed_commits : int
        How often a processor repeated a frame because the next one had not reached it, in all.
    faults : Fault
        All faults that the device has reported meanwhile.
    first_period, last_period : int
        The periods of the first and the last accepted frame, by the device's clock; 0 before.
    least_lead_periods : int or None
        The fewest periods between the arrival of a frame and its beginning, None before the first.
    drift_ppm : float
        How much faster than nominal the device's clock runs by the host's.
    uncertainty : float
        Uncertainty of the device's clock, in seconds.
    """

    rate: float
    sent: int = 0
    accepted: int = 0
    late: int = 0
    damaged: int = 0
    refused: int = 0
    unanswered: int = 0
    underruns: int = 0
    moved_periods: int = 0
    reconnects: int = 0
    missed_commits: int = 0
    faults: Fault = NO_FAULTS
    first_period: int = 0
    last_period: int = 0
    least_lead_periods: int | None = None
    drift_ppm: float = 0.0
    uncertainty: float = 0.0

    def __repr__(self) -> str:
        kept = f"{self.accepted} accepted, {self.late} late, {self.refused} refused, {self.underruns} underruns"
        return f"StreamReport({self.sent} sent at {self.rate:g} Hz, {kept})"

    @property
    def played_rate(self) -> float:
        """Frames per second that began, by the device's clock; 0 before the second."""
        span = self.last_period - self.first_period
        return (self.accepted - 1) * CARRIER_HZ / span if span else 0.0

    @property
    def holds(self) -> bool:
        """Whether the rate holds: at most one of a hundred frames was late or moved the rest."""
        return self.late + self.underruns <= MOST_LATE_SHARE * self.accepted

    def __str__(self) -> str:
        """One line for people."""
        parts = [f"{self.accepted} frames at {self.rate:g}/s", f"{self.late} late", f"{self.underruns} underruns"]
        if self.damaged or self.unanswered:
            parts.append(f"{self.damaged} damaged, {self.unanswered} unanswered")
        if self.missed_commits:
            parts.append(f"{self.missed_commits} commits missed")
        if self.faults:
            parts.append(f"faults {'+'.join(fault.name or '' for fault in self.faults)}")
        if self.reconnects:
            parts.append(f"{self.reconnects} reconnects")
        if self.least_lead_periods is not None:
            parts.append(f"least lead {self.least_lead_periods / CARRIER_HZ * 1e3:.2f} ms")
        if not self.holds:
            parts.append(f"the rate does not hold: {self.played_rate:.0f}/s played, choose a lower one")
        return ", ".join([*parts, f"clock {self.drift_ppm:+.1f} ppm"])


class Stream:
    """One run of frames to a device.

    Parameters
    ----------
    session : Session
        With the device.
    source : FrameSource
        The frames.
    rate : float
        Frames per second.
    look_ahead : float
        Seconds before its period at which a frame is sent at the earliest.
    permit : callable
        Raises a `DeviceError` if the stream must end.
    begin : callable
        Enables the outputs.
    restore : callable, optional
        Restores the state of a device that was lost and came back; without it, the stream ends there.
    """

    def __init__(
        self,
        session: Session,
        source: FrameSource,
        rate: float,
        *,
        look_ahead: float,
        permit: Callable[[], None],
        begin: Callable[[], None],
        restore: Callable[[], None] | None,
    ) -> None:
        device_most, line_most = session.info.max_updates_per_second, session.line().most_blocks_per_second
        check_rate(rate)
        if rate > line_most and line_most < device_most:
            raise ValueError(
                f"a rate of {rate:g} frames/s must be at most {line_most:g} on this line; if it is a serial line with "
                "a higher rate, its URL says so: ?baud=RATE"
            )
        if rate > device_most:
            raise ValueError(f"a rate of {rate:g} frames/s must be at most {device_most:g} with this device")
        if not 0 <= look_ahead <= MOST_LOOK_AHEAD_SECONDS:
            raise ValueError(f"a look-ahead of {look_ahead:g} s must lie between 0 and {MOST_LOOK_AHEAD_SECONDS:g} s")
        self._session, self._source = session, source
        self._permit, self._begin, self._restore = permit, begin, restore
        self._spacing = CARRIER_HZ / rate
        blocks_per_period = session.line().most_blocks_per_second / CARRIER_HZ  # of some lines infinite
        self._block_lead = LEAST_LEAD_PERIODS + ceil(1 / blocks_per_period)
        self._most_blocks = max(1, int(min(MOST_BLOCKS, TURN_PERIODS * blocks_per_period)))
        self._asked = max(ceil(look_ahead * CARRIER_HZ), 2 * self._block_lead)
        self._on_the_way = self._way = self._held_up = 0
        """Where a line carries blocks by itself: the periods that an answer takes at the most, those that a block takes
        as a rule, and those by which frames were late."""
        self._plan()
        self._posted = deque[tuple[int, Parcel]]()
        """Number of the last frame of each parcel, and the parcel."""
        self._next = 0
        self._start = 0.0
        self._read_at = 0.0
        self._astray = 0
        self._accepted_before = -1  # the frame at the last loss; without a later one, reconnecting does not help
        self._rate = rate
        self._clock = DeviceClock()
        self._counts = Counter[str]()
        self._missed_before: int | None = None
        self._faults = NO_FAULTS
        self._first = self._last = 0
        self._least = NEVER

    def _plan(self) -> None:
        """Set how early frames are sent.

        A line that carries blocks by itself needs more look-ahead, by some times what an answer takes at the most.
        Frames that were late all the same go as much earlier afterwards. Whether it is too late for a frame says what a
        block takes as a rule: by the slowest answer of a busy computer it would be too late for every frame.
        """
        early = self._session.line().posts and self._source.ready
        turn, asked = (POSTED_PERIODS, max(self._asked, POSTED_PERIODS)) if early else (TURN_PERIODS, self._asked)
        self._look_ahead = asked + ROUND_TRIPS * self._on_the_way + self._held_up
        self._horizon = min(self._look_ahead, self._session.info.queue_blocks * self._spacing + turn)
        part = self._horizon / 2
        if early:
            blocks = self._session.line().window(None, self._session.info.queue_records)
            self._horizon = min(self._horizon, POSTED_SHARE * blocks * self._spacing)
            part = self._horizon / 3
        self._least_lead = self._block_lead + min(self._way, int(self._horizon / 3))  # a longer one is never left
        together = min(part, self._most_blocks * self._spacing) if self._source.ready else 0.0
        enough = min(self._least_lead + self._spacing, self._horizon)
        self._refill = max(self._horizon - together, enough)

    @property
    def report(self) -> StreamReport:
        """Its present state."""
        return StreamReport(
            self._rate,
            **{name: self._counts[name] for name in COUNTS},
            faults=self._faults,
            first_period=self._first,
            last_period=self._last,
            least_lead_periods=None if self._least == NEVER else self._least,
            drift_ppm=self._clock.drift_ppm,
            uncertainty=self._clock.uncertainty,
        )

    def run(self, on_progress: Callable[[StreamReport], None] | None = None) -> StreamReport:
        """Play all frames, and wait for the end of the last."""
        frames = self._source.take(1)
        pack_updates(*frames, sequence=0)  # what is compiled or read now does not keep an enabled device waiting
        with self._session.lock:
            self._permit()
            self._begin()
        told = time.monotonic()
        self._find_clock()
        while len(frames.phase):
            self._come_back_if_lost(partial(self._send, frames))
            if on_progress is not None and time.monotonic() - told >= PROGRESS_SECONDS:
                told = time.monotonic()
                on_progress(self.report)
            frames = self._source.take(self._wait_for_turn())
        self._come_back_if_lost(self._wait_for_the_end)
        return self.report

    def _wait_for_the_end(self) -> None:
        """Wait for the end of the last frame, and collect the final results."""
        self._finish(self._session.settle)
        self._wait_until(self._due(self._next))
        self._read_clock()

    def _come_back_if_lost(self, step: Callable[[], None]) -> None:
        """Take a step; if the device is lost in it, wait until it is back, and prepare for the next frame."""
        try:
            step()
        except (DeviceLostError, DeviceStalledError, DeviceTimeoutError):
            if self._restore is None or self._counts["accepted"] == self._accepted_before:
                raise
            self._accepted_before = self._counts["accepted"]
            with self._session.lock:
                self._session.reopen()
                self._permit()
                self._restore()
            self._counts["reconnects"] += 1
            self._find_clock()

    # The device's time

    def _find_clock(self) -> None:
        """Read the device's time afresh, and let the next frame begin a look-ahead from now."""
        self._clock, self._missed_before = DeviceClock(), None
        for _ in range(FIRST_READINGS):
            self._read_clock()
        self._begin_at(ceil(self._now() + self._horizon))

    def _read_clock(self) -> None:
        """Read the device's time, and its status."""
        keeper = self._session.time
        with self._session.lock:
            before = keeper.monotonic()
            status = self._session.status()
            after = keeper.monotonic()
        self._clock.add(Reading(before, after, status.now))
        if self._session.line().posts:
            self._on_the_way = ceil(self._clock.longest * CARRIER_HZ)
            self._way = ceil(self._clock.usual / 2 * CARRIER_HZ)
            self._plan()
        self._read_at = after
        self._astray = self._astray + 1 if abs(self._clock.drift_ppm) > ASTRAY_PPM else 0
        if self._astray > MOST_ASTRAY:
            raise DeviceError(
                f"the time of {self._session.name} passes at {1 + self._clock.drift_ppm / 1e6:.3g} of this computer's, "
                "and a stream needs both to agree; `phasewire emulate --pace fast` does not stream, --pace wall does"
            )
        self._faults |= status.faults
        if self._missed_before is None:  # counts restart if a device was without power
            self._missed_before = status.missed_commits - self._counts["missed_commits"]
        self._counts["missed_commits"] = status.missed_commits - self._missed_before

    def _keep_time(self) -> None:
        """Read the device's clock if the last reading is old: the two clocks drift apart."""
        if self._session.time.monotonic() - self._read_at > READING_SECONDS:
            self._read_clock()

    def _now(self) -> float:
        """Carrier period of the device, with its fraction."""
        return self._clock.period_at(self._session.time.monotonic())

    def _due(self, index: int) -> int:
        """Period in which a frame begins."""
        return floor(self._start + index * self._spacing)

    def _begin_at(self, period: int) -> None:
        """Set the period of the next frame."""
        self._start = period - self._next * self._spacing

    def _wait_until(self, period: float) -> None:
        """Let time pass until a period begins, with signs of life to the device, and readings of its clock."""
        keeper = self._session.time
        while (left := self._clock.moment_of(period) - keeper.monotonic()) > 0:
            pause = self._session.pause_seconds
            keeper.sleep(min(left, pause))
            if left > pause:
                self._session.check_enabled()
                self._keep_time()

    # Frames

    def _wait_for_turn(self) -> int:
        """Wait until the next frame is to be sent; returns how many may go with it."""
        self._come_back_if_lost(lambda: self._wait_until(self._due(self._next) - self._refill))
        self._keep_up()
        due = floor((self._now() + self._horizon - self._start) / self._spacing) + 1 - self._next
        return min(max(due, 1), self._most_blocks)

    def _keep_up(self) -> None:
        """If it is too late for the next frame, move it and all that follow."""
        late_for, now = self._due(self._next), self._now()
        if late_for - now < self._least_lead:
            self._begin_at(ceil(now + self._horizon))
            self._counts["underruns"] += 1
            self._counts["moved_periods"] += self._due(self._next) - late_for

    def _send(self, frames: PulseFrames) -> None:
        """Send frames, and count the results."""
        count = len(frames.phase)
        with self._session.lock:
            self._permit()
            self._keep_up()  # the source may have taken its time
            periods = np.floor(self._start + np.arange(self._next, self._next + count) * self._spacing)
            number, restart = self._session.upcoming
            blocks = pack_updates(frames.phase, frames.width, number, periods.astype(np.uint64), restart=restart)
            self._next += count
            self._counts["sent"] += count
            self._counts["unanswered"] += count
            self._posted.append((self._next - 1, parcel := Parcel(number, Answers.none(count))))
            self._finish(partial(self._session.post, blocks, parcel))
        self._keep_time()

    def _finish(self, sending: Callable[[], None]) -> None:
        """Send, or wait for sent frames, and count the results; raises for a refused frame."""
        try:
            sending()
        except BaseException:
            self._count_posted(len(self._posted))
            raise
        known = sum(parcel.settled for _, parcel in self._posted)
        refused = self._count_posted(known)
        if refused is not None:
            with suppress(DeviceError):
                self._session.settle()
            self._count_posted(len(self._posted))
            self._session.check(refused)

    def _count_posted(self, parcels: int) -> Ack | None:
        """Count the frames of the first posted parcels; returns the first one that was refused for its contents."""
        first = None
        for _ in range(parcels):
            last, parcel = self._posted.popleft()
            acks = parcel.answers.acks[parcel.answers.answered]
            self._account(acks)
            if parcel.answers.answered[-1:].all():
                self._follow(last, parcel.answers.acks[-1])
            first = first or _refused(acks)
        return first

    def _follow(self, index: int, ack: np.void) -> None:
        """Move what follows if the device is late with the frame of an acknowledgement.

        Frames in flight are late by as much. A device that takes frames no faster than they are due would stay late for
        ever. A delay may come again, so frames go earlier from now on.
        """
        behind = int(ack["commit_period"]) - self._due(index)
        if self._session.line().posts and ack["flags"] & AckFlag.LATE and behind > 0:
            self._start += (moved := behind + self._session.info.queue_blocks)
            self._counts["underruns"] += 1
            self._counts["moved_periods"] += moved
            spread = max(self._horizon - self._refill, self._spacing)  # by as much some frames go earlier than others
            self._held_up = min(self._held_up + behind + ceil(spread), POSTED_PERIODS)
            self._plan()

    def _account(self, acks: NDArray[np.void]) -> None:
        if not len(acks):
            return
        count = self._counts
        count["unanswered"] -= len(acks)
        accepted = acks[acks["reason"] == Reason.ACCEPTED]
        if len(accepted):
            begins = accepted["commit_period"]
            count["accepted"] += len(accepted)
            count["late"] += int(np.count_nonzero(accepted["flags"] & AckFlag.LATE))
            self._first = self._first or int(begins[0])
            self._last = int(begins[-1])
            self._least = min(self._least, int((begins - accepted["now"] // TICKS_PER_PERIOD).min()))
        if refused := len(acks) - len(accepted):
            damaged = int(np.isin(acks["reason"], DAMAGED).sum())
            count["damaged"] += damaged
            count["refused"] += refused - damaged


def _refused(acks: NDArray[np.void]) -> Ack | None:
    """The first acknowledgement of a frame that was refused for its contents."""
    for row in acks[acks["reason"] != Reason.ACCEPTED]:
        if int(row["reason"]) not in DAMAGED:
            return Ack.of(row)
    return None
