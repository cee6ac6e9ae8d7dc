"""Frames to a device, or to several in step, at a rate, each in its own carrier period.

Frame k is due at period start + ⌊k · 40 000 / rate⌋ of the device's clock, and is sent a little earlier: the *look-
ahead*. Frames that are there already go many in a transfer, as soon as there are enough of them or half of the
look-ahead is used up, a third on a line that carries blocks by itself; those of a live source go one by one. What the
device's queue cannot hold yet waits in the transfer, held back by NAK or by credit, but not for long. If source or host
come too late for a frame, that is an *underrun*: the rest of the stream is moved to a later start, so that frames keep
their distance and their order. Several devices get each frame for the same period, and are moved together.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from math import ceil, floor, inf

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import real
from ...base.errors import DeviceError, DeviceLostError, DeviceStalledError, DeviceTimeoutError
from ...protocol.board import CARRIER_HZ
from ...protocol.codes import Fault
from ...protocol.quantise import PulseFrames
from ...protocol.replies import Ack
from .common_clock import CommonClock, common_time
from .frames import FrameSource, checked_rate
from .lanes import ACCEPTED, DAMAGED, LANE_COUNTS, LATE, NEVER, NO_FAULTS, POSTED_PERIODS, Lane, naming
from .session import Session

__all__ = ["FIRST_READINGS", "LOOK_AHEAD_SECONDS", "Stream", "StreamReport", "most_blocks_per_second", "time_to_play"]

LOOK_AHEAD_SECONDS = 0.01
MOST_SECONDS = 1e8
"""For which a device is kept playing at most: three years."""
MOST_LOOK_AHEAD_SECONDS = 10.0
FIRST_READINGS = 8
READING_SECONDS = 0.25
PROGRESS_SECONDS = 0.1
MOST_LATE_SHARE = 0.01
"""Share of the frames; one pause of a computer is no reason to choose another rate."""


@dataclass(frozen=True)
class StreamReport:
    """The results of a stream.

    Of one device, each frame is counted once as accepted, damaged, refused or unanswered. Of several devices each
    number is the worst of all, such as the fewest accepted frames and the most late ones: they need not add up.

    Parameters
    ----------
    rate : float
        Frames per second, as requested.
    sent : int
        Frames that were passed to the line.
    accepted : int
        Frames that the device has accepted.
    late : int
        How many of these could not begin in their named period, and began later.
    damaged : int
        Frames that arrived damaged, and so were not played.
    refused : int
        Frames that the device refused, at which the stream ended.
    unanswered : int
        Frames that may or may not have arrived: the line or the device was lost before it could answer.
    underruns : int
        How often source or host was too late, and the rest of the stream was moved.
    moved_periods : int
        How many carrier periods in all.
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
    apart : float or None
        The greatest distance of periods that should coincide, in seconds: 0 on one sync line, else
        as estimated. None for one device.
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
    apart: float | None = None

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
        parts.append(f"clock {self.drift_ppm:+.1f} ppm")
        if self.apart:
            parts.append(f"devices up to {self.apart * 1e6:.0f} µs apart")
        return ", ".join(parts)


def time_to_play(seconds: float) -> float:
    """A time to play in seconds, checked; infinity is until it is interrupted."""
    return inf if seconds == inf else real("seconds", seconds, 0, MOST_SECONDS, "s")


def most_blocks_per_second(sessions: Sequence[Session]) -> float:
    """What the lines to several devices can carry of one frame for all.

    Lines that do not carry blocks by themselves are used one after the other, unless each keeps a time of its own.
    """
    most = inf
    for _, those in groupby(sorted(sessions, key=lambda each: id(each.time)), key=lambda each: id(each.time)):
        lines = [session.line() for session in those]
        waiting = sum(1 / line.most_blocks_per_second for line in lines if not line.posts)
        by_themselves = [line.most_blocks_per_second for line in lines if line.posts]
        most = min([most, *by_themselves, *([1 / waiting] if waiting else [])])
    return most


class Stream:
    """One run of frames to a device, or to several in step.

    Parameters
    ----------
    lanes : sequence of Lane
        One for each device.
    source : FrameSource
        The frames of all.
    rate : float
        Frames per second.
    look_ahead : float
        Seconds before its period at which a frame is sent at the earliest.
    common : CommonClock, optional
        Relates the periods of several devices.
    """

    def __init__(
        self,
        lanes: Sequence[Lane],
        source: FrameSource,
        rate: float,
        *,
        look_ahead: float,
        common: CommonClock | None = None,
    ) -> None:
        sessions = [lane.session for lane in lanes]
        device_most = min(session.info.max_updates_per_second for session in sessions)
        line_most = most_blocks_per_second(sessions)
        rate = checked_rate(rate)
        if rate > line_most and line_most < device_most:
            raise ValueError(
                f"a rate of {rate:g} frames/s must be at most {line_most:g} on this line; if it is a serial line with "
                "a higher rate, its URL says so: ?baud=RATE"
            )
        if rate > device_most:
            raise ValueError(f"a rate of {rate:g} frames/s must be at most {device_most:g} with this device")
        look_ahead = real("look_ahead", look_ahead, 0, MOST_LOOK_AHEAD_SECONDS, "s")
        self._lanes, self._source, self._common = lanes, source, common
        self._time = common_time(session.time for session in sessions)
        self._spacing = CARRIER_HZ / rate
        self._most_blocks = min(lane.most_blocks for lane in lanes)
        self._asked = max(ceil(look_ahead * CARRIER_HZ), 2 * max(lane.block_lead for lane in lanes))
        self._plan()
        self._next = 0
        self._start = 0.0
        self._read_at = 0.0
        self._accepted_before = -1  # the frame at the last loss; without a later one, reconnecting does not help
        self._rate = rate
        self._counts = Counter[str]()

    def _plan(self) -> None:
        """Set how early frames are sent.

        A line that carries blocks by itself needs more look-ahead, by some times what an answer takes at the most.
        Frames that were late all the same go as much earlier afterwards. Whether it is too late for a frame says what a
        block takes as a rule: by the slowest answer of a busy computer it would be too late for every frame.
        """
        ready = self._source.ready
        self._horizon = min(lane.horizon(self._asked, self._spacing, ready) for lane in self._lanes)
        part = self._horizon / (3 if ready and any(lane.posts for lane in self._lanes) else 2)
        # a longer one is never left
        self._least_lead = max(lane.block_lead + min(lane.way, int(self._horizon / 3)) for lane in self._lanes)
        together = min(part, self._most_blocks * self._spacing) if ready else 0.0
        enough = min(self._least_lead + self._spacing, self._horizon)
        self._refill = max(self._horizon - together, enough)

    @property
    def report(self) -> StreamReport:
        """Its present state."""
        first, lanes = self._lanes[0], self._lanes
        counts = {name: max(lane.counts[name] for lane in lanes) for name in LANE_COUNTS}
        counts["accepted"] = min(lane.counts["accepted"] for lane in lanes)
        least = min(lane.least for lane in lanes)
        faults = NO_FAULTS
        for lane in lanes:
            faults |= lane.faults
        return StreamReport(
            self._rate,
            **counts,
            **{name: self._counts[name] for name in ("underruns", "moved_periods", "reconnects")},
            faults=faults,
            first_period=first.first,
            last_period=first.last,
            least_lead_periods=None if least == NEVER else least,
            drift_ppm=first.clock.drift_ppm,
            uncertainty=max(lane.clock.uncertainty for lane in lanes),
            apart=None if self._common is None else self._common.error,
        )

    def run(self, on_progress: Callable[[StreamReport], None] | None = None) -> StreamReport:
        """Play all frames, and wait for the end of the last."""
        frames = self._source.take(1)
        for lane in self._lanes:
            lane.load(frames)
        for lane in self._lanes:
            with naming(lane.name), lane.session.lock:
                lane.permit()
                lane.begin()
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
        for lane in self._lanes:
            self._finish(lane, lane.session.settle)
        self._wait_until(self._due(self._next))
        self._read_clocks()

    def _come_back_if_lost(self, step: Callable[[], None]) -> None:
        """Take a step; if the device is lost in it, wait until it is back, and prepare for the next frame."""
        try:
            step()
        except (DeviceLostError, DeviceStalledError, DeviceTimeoutError):
            (restore, accepted), *others = [(lane.restore, lane.counts["accepted"]) for lane in self._lanes]
            if restore is None or others or accepted == self._accepted_before:
                raise
            self._accepted_before = accepted
            restore()
            self._counts["reconnects"] += 1
            self._find_clock()

    # The devices' time

    def _find_clock(self) -> None:
        """Read the devices' time afresh, and let the next frame begin a look-ahead from now."""
        for lane in self._lanes:
            lane.forget_clock()
        for _ in range(FIRST_READINGS):
            self._read_clocks()
        self._begin_at(ceil(self._now() + self._horizon))

    def _read_clocks(self) -> None:
        """Read each device's time, and its status."""
        for lane in self._lanes:
            with naming(lane.name):
                lane.read_clock()
        self._plan()
        self._read_at = self._time.monotonic()
        if self._common is not None:
            self._common.follow([lane.clock for lane in self._lanes], self._read_at)
            for lane, offset in zip(self._lanes, self._common.offsets, strict=True):
                lane.offset = offset

    def _keep_time(self) -> None:
        """Read the clocks if the last reading is old: they drift away from the host's."""
        if self._time.monotonic() - self._read_at > READING_SECONDS:
            self._read_clocks()

    def _now(self) -> float:
        """Carrier period of the device that has come furthest, with its fraction."""
        return max(lane.now() for lane in self._lanes)

    def _due(self, index: int) -> int:
        """Period in which a frame begins."""
        return floor(self._start + index * self._spacing)

    def _begin_at(self, period: int) -> None:
        """Set the period of the next frame."""
        self._start = period - self._next * self._spacing

    def _wait_until(self, period: float) -> None:
        """Let time pass until a period begins, with signs of life to the devices, and readings of their clocks."""
        clock = self._lanes[0].clock
        while (left := clock.moment_of(period) - self._time.monotonic()) > 0:
            pause = min(lane.session.pause_seconds for lane in self._lanes)
            self._time.sleep(min(left, pause))
            if left > pause:
                for lane in self._lanes:
                    with naming(lane.name):
                        lane.session.check_enabled()
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
        with ExitStack() as held:
            for lane in self._lanes:
                held.enter_context(lane.session.lock)
                with naming(lane.name):
                    lane.permit()
            self._keep_up()  # the source may have taken its time
            first, count = self._next, len(frames.phase)
            periods = np.floor(self._start + np.arange(first, first + count) * self._spacing).astype(np.uint64)
            self._next += count
            for lane in self._lanes:
                self._finish(lane, partial(lane.post, frames, first, periods))
        if self._common is not None:
            self._time.sleep(0)  # brings emulated devices to one moment
        self._keep_time()

    def _finish(self, lane: Lane, sending: Callable[[], None]) -> None:
        """Send, or wait for sent frames, and count the results; raises for a refused frame."""
        with naming(lane.name):
            try:
                sending()
            except BaseException:
                for each in self._lanes:
                    self._count_posted(each, len(each.posted), follow=False)
                raise
            known = sum(parcel.settled for _, parcel in lane.posted)
            refused = self._count_posted(lane, known)
            if refused is not None:
                with suppress(DeviceError):
                    lane.session.settle()
                self._count_posted(lane, len(lane.posted), follow=False)
                lane.session.check(refused)

    def _count_posted(self, lane: Lane, parcels: int, *, follow: bool = True) -> Ack | None:
        """Count the frames of the first posted parcels; returns the first one that was refused for its contents.

        At the end of a stream nothing follows, and the line may be closed.
        """
        first = None
        for _ in range(parcels):
            last, parcel = lane.posted.popleft()
            acks = parcel.answers.acks[parcel.answers.answered]
            lane.account(acks)
            if follow and parcel.answers.answered[-1:].all():
                self._follow(lane, last, parcel.answers.acks[-1])
            first = first or _refused(acks)
        return first

    def _follow(self, lane: Lane, index: int, ack: np.void) -> None:
        """Move what follows if a device is late with the frame of an acknowledgement.

        Frames in flight are late by as much. A device that takes frames no faster than they are due would stay late for
        ever. A delay may come again, so frames go earlier from now on.
        """
        behind = int(ack["commit_period"]) - lane.offset - self._due(index)
        if lane.posts and ack["flags"] & LATE and behind > 0:
            self._start += (moved := behind + lane.session.info.queue_blocks)
            self._counts["underruns"] += 1
            self._counts["moved_periods"] += moved
            spread = max(self._horizon - self._refill, self._spacing)  # by as much some frames go earlier than others
            lane.held_up = min(lane.held_up + behind + ceil(spread), POSTED_PERIODS)
            self._plan()


def _refused(acks: NDArray[np.void]) -> Ack | None:
    """The first acknowledgement of a frame that was refused for its contents."""
    for row in acks[acks["reason"] != ACCEPTED]:
        if int(row["reason"]) not in DAMAGED:
            return Ack.of(row)
    return None
