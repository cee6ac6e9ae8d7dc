"""The USB controller: validates blocks, sorts them by the wiring table and sends each processor its slice."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

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
    ChannelEnd,
    Commit,
    Link,
    Message,
    periods_per_update,
    slices_cycles,
    update_cycles,
)
from ..protocol.codes import PROTOCOL_VERSION, Reason
from ..protocol.pulses import Pulses
from ..protocol.replies import Ack, Info, Status
from ..protocol.wiring import Wiring
from .processor import RASTERISE_CYCLES, Processor
from .scheduler import Scheduler

__all__ = ["Controller"]

# CRC, validation and sorting of 320 pulses, split over the controller's free threads. An estimate, as RASTERISE_CYCLES.
SORT_CYCLES = 6_000
# Switch latency per hop is not published; 100 ns is assumed.
HOP_CYCLES = 40
QUEUE_BLOCKS = 8
ACKS = 64
FIRMWARE = (0, 1, 0)
WATCHDOG_CYCLES = WATCHDOG_MS * CORE_HZ // 1000


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
        self._sorter_free = 0
        self._chain_free = 0  # once everything planned is sent
        self._chain_busy_until = 0  # with what is being sent
        self._last_commit_period = 0
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
        self.feed_watchdog()
        try:
            update = unpack(packet)
        except BlockError as error:
            self._refuse(Reason(error.reason), int.from_bytes(packet[4:8], "little"), str(error))
            return
        if not self._enabled:
            self._refuse(Reason.DISABLED, update.sequence, Reason.DISABLED.text)
            return
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
        sorted_at = max(self._scheduler.now, self._sorter_free) + SORT_CYCLES
        self._sorter_free = sorted_at
        # A processor holds one table that plays and one that waits: commits may arrive only after the last swap.
        start = max(
            sorted_at,
            self._chain_free,
            self._last_commit_period * CYCLES_PER_PERIOD - slices_cycles(self._link),
        )
        earliest = self._first_period_after(start + self._forward_cycles())
        commit_period = earliest if update.period is None else max(earliest, update.period)
        late = update.period is not None and update.period < earliest
        # For the same reason a distant update waits here, not in the processors.
        start = max(start, commit_period * CYCLES_PER_PERIOD - self._forward_cycles() - CYCLES_PER_PERIOD)
        self._chain_free = start + update_cycles(self._link)
        self._last_commit_period = commit_period
        self._accepted += 1
        self._late += late
        self._queued += 1
        self._log(f"accepts block {update.sequence} for period {commit_period}")
        self._acknowledge(Reason.ACCEPTED, update.sequence, commit_period, late)
        self._scheduler.at(start, partial(self._forward_queued, update.pulses, commit_period, self._era))

    def _forward_cycles(self) -> int:
        """Worst time from the first token of an update to the last rasterised table."""
        return update_cycles(self._link) + PROCESSORS * HOP_CYCLES + RASTERISE_CYCLES

    @staticmethod
    def _first_period_after(cycle: int) -> int:
        return -(-cycle // CYCLES_PER_PERIOD)

    def _forward_queued(self, pulses: Pulses, period: int, era: int) -> None:
        if era == self._era:
            self._queued -= 1
            self._forward(pulses, period)

    def _forward(self, pulses: Pulses, period: int) -> None:
        by_channel = Pulses(self.wiring.sort(pulses.phase), self.wiring.sort(pulses.width))
        packed = pack_pulses(by_channel)
        size = len(packed) // PROCESSORS
        slices = [packed[size * node : size * (node + 1)] for node in range(PROCESSORS)]
        self._log(f"sorted into {PROCESSORS} slices of {size} bytes, sent for period {period}")
        messages = [Message(node, ChannelEnd.MAILBOX, piece) for node, piece in enumerate(slices)]
        messages += [
            Message(node, ChannelEnd.COMMIT, Commit.of(period, piece).encode()) for node, piece in enumerate(slices)
        ]
        leaves = self._scheduler.now
        self._chain_busy_until = leaves + update_cycles(self._link)
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
        start = max(self._scheduler.now, self._chain_busy_until)
        period = self._first_period_after(start + self._forward_cycles())
        self._chain_free = start + update_cycles(self._link)
        self._last_commit_period = period
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
            accepted=self._accepted,
            refused=self._refused,
            late=self._late,
            missed_commits=sum(processor.missed_commits for processor in self._processors),
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
