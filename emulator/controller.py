"""The USB controller: validates blocks, sorts them by the wiring table and sends each processor its slice."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from ..errors import BlockError
from ..protocol.blocks import Update, pack_pulses, unpack
from ..protocol.board import (
    BOARDS,
    CARRIER_HZ,
    CHANNELS,
    COLUMNS,
    CORE_HZ,
    CYCLES_PER_PERIOD,
    MAX_WIDTH_TICKS,
    PITCH_M,
    PROCESSORS,
    PROCESSORS_PER_BOARD,
    ROWS,
    TICKS_PER_PERIOD,
    WATCHDOG_MS,
)
from ..protocol.chain import (
    SLICE_BYTES,
    ChannelEnd,
    Commit,
    Link,
    Message,
    periods_per_update,
    slices_cycles,
    update_cycles,
)
from ..protocol.codes import HORIZON_PERIODS, PROTOCOL_VERSION, Reason
from ..protocol.pulses import Pulses
from ..protocol.replies import Ack, Info, Status
from ..protocol.wiring import Wiring
from .processor import RASTERISE_CYCLES, Processor
from .scheduler import Scheduler

__all__ = ["Controller"]

# CRC, validation and sorting of 320 pulses, split over the controller's free threads. An estimate, as RASTERISE_CYCLES;
# less than the period that lies between two updates on the chain, so that sorting never holds up the next.
SORT_CYCLES = 6_000
# Switch latency per hop is not published; 100 ns is assumed.
HOP_CYCLES = 40
QUEUE_BLOCKS = 8
ACKS = 64
FIRMWARE = (0, 1, 0)
WATCHDOG_CYCLES = WATCHDOG_MS * CORE_HZ // 1000


class Tail(NamedTuple):
    """Where the last update on the chain ends."""

    sent: int
    """Cycle at which its last token has left."""
    period: int
    """Period at which it begins to play."""


class Controller:
    """Judges blocks, plans when each can take effect, and drives the chain.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    processors : sequence of Processor
        The ten processors in the order of the chain.
    wiring : Wiring
        The table by which pulses are sorted.
    link : Link
        Set-up of the chain's links.
    log : callable
        Takes a line about each thing that happens.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        processors: Sequence[Processor],
        wiring: Wiring,
        link: Link,
        log: Callable[[str], None],
    ) -> None:
        self._scheduler = scheduler
        self._processors = processors
        self.wiring = wiring
        self._link = link
        self._log = log
        self.acks: deque[Ack] = deque()
        self._enabled = False
        self._watchdog_fired = False
        self._last_refusal = Reason.ACCEPTED
        self._accepted = self._refused = self._late = 0
        self._queued = 0
        self._era = 0  # advanced whenever the outputs go off; updates of an earlier era are dropped
        self._planned = Tail(0, 0)  # behind everything that is queued
        self._certain = Tail(0, 0)  # behind what is on the chain and can no longer be dropped
        self._fed = 0

    @property
    def now_period(self) -> int:
        """Carrier period since power-up."""
        return self._scheduler.now // CYCLES_PER_PERIOD

    @property
    def can_accept(self) -> bool:
        """Whether the OUT endpoint takes another block; it answers NAK otherwise."""
        return self._queued < QUEUE_BLOCKS and len(self.acks) < ACKS

    def accept(self, packet: bytes) -> None:
        """Judge a packet from the OUT endpoint and queue the acknowledgement."""
        try:
            update = unpack(packet)
        except BlockError as error:
            self._refuse(Reason(error.reason), int.from_bytes(packet[4:8], "little"), str(error))
            return
        if not self._enabled:
            self._refuse(Reason.DISABLED, update.sequence, Reason.DISABLED.text)
            return
        if update.period is not None and update.period > self.now_period + HORIZON_PERIODS:
            self._refuse(Reason.HORIZON, update.sequence, f"period {update.period} is too far ahead")
            return
        self.feed_watchdog()
        self._plan(update)

    def _refuse(self, reason: Reason, sequence: int, why: str) -> None:
        self._refused += 1
        self._last_refusal = reason
        self._log(f"refuses block {sequence}: {why}")
        self._acknowledge(reason, sequence, commit_period=0, late=False)

    def _acknowledge(self, reason: Reason, sequence: int, commit_period: int, late: bool) -> None:
        free = QUEUE_BLOCKS - self._queued
        self.acks.append(Ack(reason, sequence, commit_period, self.now_period, late, free))

    def _plan(self, update: Update) -> None:
        start = self._first_start(self._scheduler.now + SORT_CYCLES, self._planned)
        earliest = self._first_boundary(start)
        commit_period = earliest if update.period is None else max(earliest, update.period)
        late = update.period is not None and update.period < earliest
        # A processor holds no more than one update that waits, so a distant one waits here.
        start = max(start, (commit_period - 1) * CYCLES_PER_PERIOD - self._forward_cycles())
        self._planned = self._tail(start, commit_period)
        self._accepted += 1
        self._late += late
        self._queued += 1
        self._log(f"accepts block {update.sequence} for period {commit_period}")
        self._acknowledge(Reason.ACCEPTED, update.sequence, commit_period, late)
        self._scheduler.at(start, partial(self._forward_queued, update.pulses, commit_period, self._era))

    def _first_start(self, ready: int, tail: Tail) -> int:
        """First cycle at which an update that is ready may go onto the chain behind others.

        Its commits come after its slices, and may arrive only once no other table waits in the processors.
        """
        return max(ready, tail.sent, tail.period * CYCLES_PER_PERIOD - slices_cycles(self._link))

    def _first_boundary(self, start: int) -> int:
        """First period for which an update that goes onto the chain at a cycle is ready everywhere."""
        return -(-(start + self._forward_cycles()) // CYCLES_PER_PERIOD)

    def _tail(self, start: int, period: int) -> Tail:
        return Tail(start + update_cycles(self._link), period)

    def _forward_cycles(self) -> int:
        """Worst time from the first token of an update to the last rasterised table."""
        return update_cycles(self._link) + PROCESSORS * HOP_CYCLES + RASTERISE_CYCLES

    def _forward_queued(self, pulses: Pulses, period: int, era: int) -> None:
        if era == self._era:
            self._queued -= 1
            self._certain = self._tail(self._scheduler.now, period)
            self._forward(pulses, period)

    def _forward(self, pulses: Pulses, period: int) -> None:
        by_channel = Pulses(self.wiring.sort(pulses.phase), self.wiring.sort(pulses.width))
        packed = pack_pulses(by_channel)
        slices = [packed[first : first + SLICE_BYTES] for first in range(0, len(packed), SLICE_BYTES)]
        self._log(f"sorted into {len(slices)} slices of {SLICE_BYTES} bytes, sent for period {period}")
        messages = [Message(node, ChannelEnd.MAILBOX, piece) for node, piece in enumerate(slices)]
        messages += [
            Message(node, ChannelEnd.COMMIT, Commit.of(period, piece).encode()) for node, piece in enumerate(slices)
        ]
        leaves = self._scheduler.now
        for message in messages:
            leaves += message.tokens * self._link.cycles_per_token
            deliver = partial(self._processors[message.node].receive, message.channel_end, message.payload)
            self._scheduler.at(leaves + (message.node + 1) * HOP_CYCLES, deliver)

    def enable(self) -> None:
        """Let updates through."""
        self.feed_watchdog()
        if self._enabled:
            return
        self._enabled = True
        self._watchdog_fired = False
        self._log("outputs enabled")
        self._scheduler.at(self._fed + WATCHDOG_CYCLES, partial(self._watch, self._era))

    def disable(self) -> None:
        """Silence all outputs as soon as the chain can, and drop what is queued."""
        if not self._enabled:
            return
        self._enabled = False
        self._era += 1
        self._queued = 0
        self._log("outputs disabled")
        start = self._first_start(self._scheduler.now, self._certain)
        period = self._first_boundary(start)
        self._planned = self._certain = self._tail(start, period)
        self._scheduler.at(start, partial(self._forward, Pulses.silent(CHANNELS), period))

    def reset_endpoints(self) -> None:
        """Forget what belonged to the last session, as a host that (re)configures the device expects."""
        self.disable()
        self.acks.clear()

    def feed_watchdog(self) -> None:
        """The host is alive."""
        self._fed = self._scheduler.now

    def _watch(self, era: int) -> None:
        if era != self._era:
            return
        due = self._fed + WATCHDOG_CYCLES
        if self._scheduler.now < due:
            self._scheduler.at(due, partial(self._watch, era))
            return
        self._log(f"watchdog: no word from the host for {WATCHDOG_MS} ms")
        self._watchdog_fired = True
        self.disable()

    def status(self) -> Status:
        """Answer the STATUS request."""
        return Status(
            enabled=self._enabled,
            watchdog_fired=self._watchdog_fired,
            last_refusal=self._last_refusal,
            period=self.now_period,
            accepted=self._accepted % 2**32,
            refused=self._refused % 2**32,
            late=self._late % 2**32,
            missed_commits=sum(processor.missed_commits for processor in self._processors) % 2**32,
        )

    def info(self) -> Info:
        """Answer the INFO request."""
        return Info(
            protocol_version=PROTOCOL_VERSION,
            firmware=FIRMWARE,
            channels=CHANNELS,
            columns=COLUMNS,
            rows=ROWS,
            pitch=PITCH_M,
            boards=BOARDS,
            processors_per_board=PROCESSORS_PER_BOARD,
            ticks_per_period=TICKS_PER_PERIOD,
            max_width_ticks=MAX_WIDTH_TICKS,
            link_wires=self._link.wires,
            queue_blocks=QUEUE_BLOCKS,
            carrier_hz=CARRIER_HZ,
            max_updates_per_second=CARRIER_HZ // periods_per_update(self._link),
            watchdog=WATCHDOG_MS / 1000,
        )
