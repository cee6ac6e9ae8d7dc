"""The USB controller: validates blocks, sorts them by the wiring table and sends each processor its slice."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from ..errors import BlockError
from ..protocol.blocks import Block, Clock, NoOp, Output, Update, pack_pulses, unpack
from ..protocol.board import (
    BOARDS,
    CARRIER_HZ,
    CHANNELS,
    COLUMNS,
    CORE_HZ,
    CYCLES_PER_PERIOD,
    CYCLES_PER_TICK,
    MAX_WIDTH_TICKS,
    PITCH_M,
    PROCESSORS,
    PROCESSORS_PER_BOARD,
    ROWS,
    TICKS_PER_PERIOD,
    WATCHDOG_MS,
)
from ..protocol.chain import SLICE_BYTES, Commit, Message, Slice
from ..protocol.codes import (
    HORIZON_PERIODS,
    PROTOCOL_VERSION,
    SYNC_PERIODS,
    AckFlag,
    Action,
    Bank,
    Fault,
    Feature,
    Hardware,
    Reason,
    State,
    StatusFlag,
)
from ..protocol.numbering import follows, missing
from ..protocol.pulses import Pulses
from ..protocol.replies import ENABLED, Ack, ClockReading, Info, ProcessorReport, Status
from ..protocol.states import Event, after
from ..protocol.timing import (
    HOP_CYCLES,
    RASTERISE_CYCLES,
    SORT_CYCLES,
    Budget,
    Link,
    slices_cycles,
    update_cycles,
)
from ..protocol.wiring import Wiring
from .processor import Processor
from .scheduler import Scheduler

__all__ = ["Controller"]

QUEUE_BLOCKS = 8
RECORDS = 64
FIRMWARE = (0, 1, 0)
FEATURES = Feature(0)
TEMPERATURE_C = 25
NO_FLAGS = AckFlag(0)


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
    unique_id : bytes
        Eight bytes that no other device has.
    log : callable
        Takes a line about each thing that happens.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        processors: Sequence[Processor],
        wiring: Wiring,
        link: Link,
        unique_id: bytes,
        log: Callable[[str], None],
    ) -> None:
        self._scheduler = scheduler
        self._processors = processors
        self.wiring = wiring
        self._link = link
        self._unique_id = unique_id
        self._periods_per_update = Budget.of(link).periods_per_update
        self._log = log
        self._records: deque[bytes] = deque()
        self._unasked = b""  # the newest status that nobody asked for
        self._state = State.OFF
        self._faults = Fault(0)
        self._watchdog_fired = False
        self._watchdog_ms = WATCHDOG_MS
        self._drive_limit = CHANNELS
        self._last_refusal = Reason.ACCEPTED
        self._last_sequence: int | None = None
        self._last_named: int | None = None
        self._since_period = 0
        self._accepted = self._refused = self._late = self._lost = 0
        self._queued = 0
        self._era = 0  # advanced whenever the outputs go off; updates of an earlier era are dropped
        self._planned = Tail(0, 0)  # behind everything that is queued
        self._certain = Tail(0, 0)  # behind what is on the chain and can no longer be dropped
        self._fed = 0
        self._armed = 0  # the last time that the watchdog was set; earlier ones count no more

    @property
    def now_period(self) -> int:
        """Carrier period since power-up."""
        return self._scheduler.now // CYCLES_PER_PERIOD

    @property
    def can_accept(self) -> bool:
        """Whether the OUT endpoint takes another block; it answers NAK otherwise."""
        return self._queued < QUEUE_BLOCKS and len(self._records) < RECORDS

    def take_records(self, room: int) -> bytes:
        """The records that wait for the host, as many as fit."""
        packet = b""
        while self._records and len(packet) + len(self._records[0]) <= room:
            packet += self._records.popleft()
        if len(packet) + len(self._unasked) <= room:
            packet, self._unasked = packet + self._unasked, b""
        return packet

    def accept(self, packet: bytes) -> None:
        """Judge a packet from the OUT endpoint and queue the acknowledgement."""
        try:
            block = unpack(packet)
            self._judge(block)
        except BlockError as error:
            sequence = int.from_bytes(packet[4:8], "little")
            self._refused += 1
            self._last_refusal = Reason(error.reason)
            self._log(f"refuses block {sequence}: {error}")
            self._acknowledge(self._last_refusal, sequence, commit_period=0)
            return
        self.feed_watchdog()
        self._carry_out(block)

    def _judge(self, block: Block) -> None:
        """Refuse what cannot be done now, with the first reason in the order of the specification."""
        body, sequence, restart = block
        if not isinstance(body, Update | Output | Clock | NoOp) or body == Output(Action.END_MODULATION):
            raise BlockError(f"{body.KIND.name} is a feature that this device lacks", Reason.UNSUPPORTED)
        changes = isinstance(body, Update | Output)
        if changes and self._state not in ENABLED:
            raise BlockError("the outputs are not enabled", Reason.DISABLED)
        if not restart and self._last_sequence is not None and not follows(sequence, self._last_sequence):
            raise BlockError(f"number {sequence} does not follow {self._last_sequence}", Reason.SEQUENCE)
        if isinstance(body, Update | Output) and body.period > self.now_period + HORIZON_PERIODS:
            raise BlockError(f"period {body.period} is too far ahead", Reason.HORIZON)
        if isinstance(body, Update):
            last = self._last_named
            if body.period and last is not None and 0 < body.period - last < self._periods_per_update:
                raise BlockError(f"period {body.period} follows {last} more closely than the chain can", Reason.RATE)
            if body.pulses.total_drive > 1000 * self._drive_limit:
                raise BlockError(
                    f"a total drive of {body.pulses.total_drive / 1000} transducers is above {self._drive_limit}",
                    Reason.DRIVE,
                )

    def _carry_out(self, block: Block) -> None:
        body, sequence, restart = block
        gap = 0 if restart or self._last_sequence is None else missing(sequence, self._last_sequence)
        self._last_sequence = sequence
        self._accepted += 1
        self._lost += gap
        flags = AckFlag.GAP if gap else NO_FLAGS
        if isinstance(body, Update):
            self._last_named = body.period or self._last_named
            commit_period = self._plan(body.pulses, body.period, Event.PLAY)
        elif isinstance(body, Output):
            ends = Event.DISABLE if body.action is Action.DISABLE else Event.END
            commit_period = self._plan(Pulses.silent(CHANNELS), body.period, ends)
        else:
            commit_period = self.clock().sync_period if isinstance(body, Clock) else 0
        if isinstance(body, Update | Output):
            self._log(f"accepts block {sequence} for period {commit_period}")
            if body.period and body.period < commit_period:
                self._late += 1
                flags |= AckFlag.LATE
        self._acknowledge(Reason.ACCEPTED, sequence, commit_period, flags)

    def _acknowledge(self, reason: Reason, sequence: int, commit_period: int, flags: AckFlag = NO_FLAGS) -> None:
        ack = Ack(reason, sequence, commit_period, self._now, flags, QUEUE_BLOCKS - self._queued, self._state)
        self._records.append(ack.encode())

    @property
    def _now(self) -> int:
        return self._scheduler.now // CYCLES_PER_TICK

    def _plan(self, pulses: Pulses, period: int, event: Event) -> int:
        """Let pulses begin to play at a period, or as soon after as can be; at which they do."""
        start = self._first_start(self._scheduler.now + SORT_CYCLES, self._planned)
        commit_period = max(self._first_boundary(start), period)
        # A processor holds no more than one update that waits, so a distant one waits here.
        start = max(start, (commit_period - 1) * CYCLES_PER_PERIOD - self._forward_cycles())
        self._planned = self._tail(start, commit_period)
        self._queued += 1
        self._scheduler.at(start, partial(self._forward_queued, pulses, commit_period, event, self._era))
        return commit_period

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

    def _forward_queued(self, pulses: Pulses, period: int, event: Event, era: int) -> None:
        if era == self._era:
            self._queued -= 1
            self._certain = self._tail(self._scheduler.now, period)
            self._forward(pulses, period)
            self._scheduler.at(period * CYCLES_PER_PERIOD, partial(self._take_effect, period, event, era))

    def _take_effect(self, period: int, event: Event, era: int) -> None:
        if era != self._era:
            return
        if event is Event.DISABLE:
            self.disable()
            return
        self._state = after(self._state, event)
        self._since_period = period if event is Event.PLAY else 0

    def _forward(self, pulses: Pulses, period: int) -> None:
        by_channel = Pulses(self.wiring.sort(pulses.phase), self.wiring.sort(pulses.width))
        packed = pack_pulses(by_channel)
        slices = [Slice(node, packed[node * SLICE_BYTES :][:SLICE_BYTES]) for node in range(PROCESSORS)]
        self._log(f"sorted into {len(slices)} slices of {SLICE_BYTES} bytes, sent for period {period}")
        messages: list[Message] = [*slices, *(Commit.of(period, piece) for piece in slices)]
        leaves = self._scheduler.now
        for message in messages:
            leaves += message.TOKENS * self._link.cycles_per_token
            deliver = partial(self._processors[message.node].receive, message.encode())
            self._scheduler.at(leaves + (message.node + 1) * HOP_CYCLES, deliver)

    def enable(self) -> None:
        """Let updates through."""
        self.feed_watchdog()
        if self._state is not State.OFF:
            return
        self._state = after(self._state, Event.ENABLE)
        self._watchdog_fired = False
        self._last_named = None
        self._log("outputs enabled")
        self._arm_watchdog()

    def disable(self, event: Event = Event.DISABLE) -> None:
        """Silence all outputs as soon as the chain can, and drop what is queued."""
        if self._state not in ENABLED:
            return
        self._state = after(self._state, event)
        self._since_period = 0
        self._era += 1
        self._queued = 0
        self._log("outputs disabled")
        start = self._first_start(self._scheduler.now, self._certain)
        period = self._first_boundary(start)
        self._planned = self._certain = self._tail(start, period)
        self._scheduler.at(start, partial(self._forward, Pulses.silent(CHANNELS), period))

    def set_watchdog(self, milliseconds: int) -> None:
        """Choose after how long a silence of the host the outputs go off."""
        self._watchdog_ms = milliseconds
        self._arm_watchdog()

    def set_limit(self, transducers: int) -> bool:
        """Choose the most power that an update may ask for; only while the outputs are off."""
        if self._state is not State.OFF:
            return False
        self._drive_limit = transducers
        return True

    def identify(self, board: int) -> None:
        """Let a board's light blink."""
        self._log(f"board {board} blinks")

    def reset_endpoints(self) -> None:
        """Forget what belonged to the last session, as a host that (re)configures the device expects."""
        self.disable(Event.BUS_RESET)
        self._records.clear()
        self._unasked = b""
        self._last_sequence = None

    def feed_watchdog(self) -> None:
        """The host is alive."""
        self._fed = self._scheduler.now

    def _arm_watchdog(self) -> None:
        self._armed += 1
        due = max(self._scheduler.now, self._fed + self._watchdog_ms * CORE_HZ // 1000)
        self._scheduler.at(due, partial(self._watch, self._fed, self._armed))

    def _watch(self, fed: int, armed: int) -> None:
        if armed != self._armed or self._state not in ENABLED:
            return
        if self._fed > fed:
            self._arm_watchdog()
            return
        self._log(f"watchdog: no word from the host for {self._watchdog_ms} ms")
        self._watchdog_fired = True
        self.disable(Event.WATCHDOG)
        self._unasked = self.status().encode()

    def status(self) -> Status:
        """Answer the STATUS request."""
        return Status(
            state=self._state,
            faults=self._faults,
            last_refusal=self._last_refusal,
            flags=StatusFlag.WATCHDOG_FIRED if self._watchdog_fired else StatusFlag(0),
            now=self._now,
            since_period=self._since_period,
            accepted=self._accepted % 2**32,
            refused=self._refused % 2**32,
            late=self._late % 2**32,
            lost=self._lost % 2**32,
            missed_commits=sum(processor.missed_commits for processor in self._processors) % 2**32,
            damaged_messages=0,
            free=QUEUE_BLOCKS - self._queued,
            temperature_c=TEMPERATURE_C,
            watchdog_ms=self._watchdog_ms,
            drive_limit=self._drive_limit,
            dropped_frames=0,
        )

    def clock(self) -> ClockReading:
        """Answer the CLOCK request."""
        pulses = self.now_period // SYNC_PERIODS  # besides the first, at period 0
        return ClockReading(self._now, pulses * SYNC_PERIODS, pulses + 1)

    def reports(self) -> list[ProcessorReport]:
        """Answer the PROCESSORS request."""
        return [
            ProcessorReport(Fault(0), TEMPERATURE_C, Bank.FACTORY, processor.missed_commits % 2**32, 0, FIRMWARE)
            for processor in self._processors
        ]

    def info(self) -> Info:
        """Answer the INFO request."""
        return Info(
            oldest_version=PROTOCOL_VERSION,
            newest_version=PROTOCOL_VERSION,
            hardware=Hardware.FIVE_BOARDS,
            firmware=FIRMWARE,
            boards=BOARDS,
            unique_id=self._unique_id,
            carrier_hz=CARRIER_HZ,
            features=FEATURES,
            channels=CHANNELS,
            columns=COLUMNS,
            rows=ROWS,
            pitch_um=round(PITCH_M * 1e6),
            processors_per_board=PROCESSORS_PER_BOARD,
            ticks_per_period=TICKS_PER_PERIOD,
            max_width_ticks=MAX_WIDTH_TICKS,
            link_wires=self._link.wires,
            cycles_per_symbol=self._link.cycles_per_symbol,
            queue_blocks=QUEUE_BLOCKS,
            periods_per_update=self._periods_per_update,
            queue_records=RECORDS,
            slots=0,
            sequence_entries=0,
            modulation_samples=0,
            drive_limit=CHANNELS,
            watchdog_ms=WATCHDOG_MS,
        )
