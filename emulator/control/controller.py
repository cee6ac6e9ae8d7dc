"""The USB controller: judges blocks, plans when each takes effect, and keeps the device's state.

It knows no packets and no lines: whoever carries blocks is a `Door`. Plans stand in the `Agenda`, what was stored in
the `Stores`, the way to the processors is the `Chain`, the watch over them the `Supervisor`.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Seq
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import BlockError
from ...protocol.blocks import (
    Block,
    Body,
    Clock,
    Entries,
    Modulation,
    Output,
    Samples,
    Sequence,
    Slot,
    Update,
    pack_entries,
    pack_pulses,
    unpack,
    unpack_pulses,
)
from ...protocol.board import (
    BOARDS,
    CARRIER_HZ,
    CHANNELS,
    COLUMNS,
    CORE_HZ,
    CYCLES_PER_MS,
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
from ...protocol.chain import SLICE_BYTES, Identity, Program, loads
from ...protocol.codes import (
    HEADER_BYTES,
    HORIZON_PERIODS,
    MODULATION_SAMPLES,
    PROTOCOL_VERSION,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    SEQUENCE_ENTRIES,
    SILENCING_FAULTS,
    SLOTS,
    SYNC_PERIODS,
    AckFlag,
    Action,
    Bank,
    Fault,
    Feature,
    Hardware,
    Memory,
    Reason,
    Request,
    State,
    StatusFlag,
)
from ...protocol.console import TEST_WIDTH_TICKS
from ...protocol.numbering import follows, missing
from ...protocol.pulses import POWER, Pulses
from ...protocol.replies import (
    ENABLED,
    Ack,
    ClockReading,
    Info,
    ReadBack,
    Status,
    encode_acks,
    encode_reports,
    encode_wiring,
)
from ...protocol.requests import VALUES, Setup
from ...protocol.states import Event, after
from ...protocol.timing import PACKET_CYCLES, SORT_CYCLES, Budget
from ...protocol.updates import Updates, unpack_updates
from ...protocol.wiring import Wiring
from ..door import Door, Stall
from ..ports.clock import Timebase
from ..scheduler import Scheduler
from .agenda import QUEUE_BLOCKS, Agenda, Change, Stream
from .chain import Chain
from .loading import Loading
from .stores import Store, Stores
from .supervisor import BROKEN, Supervisor
from .watchdog import Watchdog

__all__ = ["FEATURES", "QUEUE_BLOCKS", "RECORDS", "Controller", "Identification"]

RECORDS = 256
QUEUE_BITS, STATE_BITS = QUEUE_BLOCKS.bit_length(), 3
STORES = 16
"""Stores that may wait to go onto the chain before the device answers NAK."""
FEATURES = ~Feature(0)
NO_FLAGS = AckFlag(0)
RESET_DELAY_CYCLES = CYCLES_PER_MS // 10
WAKE_CYCLES = CORE_HZ
READ_TIMEOUT_CYCLES = 10 * CYCLES_PER_MS
IDENTIFY_CYCLES = 5 * CORE_HZ
CLEARED_BELOW_C = 80
ATTEMPTS_TO_READ = 3
SPOKEN = (Event.WATCHDOG, Event.FAULT, Event.SUSPEND, Event.RESUME)
"""Events after which the device says its state unasked (clause ACK-006)."""
WATCHED = (State.READY, State.PLAYING)
SILENCE = bytes(PROCESSORS * SLICE_BYTES)
STOP_MODULATION = Program(0, Memory.SAMPLES, 0, 0, 0)
PLACES = range(PROCESSORS)
CHANGES = (Update, Sequence, Modulation, Output)
STORED = (Slot, Entries, Samples)


@dataclass(frozen=True, eq=False)
class Run:
    """A sequence that plays."""

    duration: int | None
    """Periods, None for without end."""
    unattended: bool
    ends: int | None = None
    """Period at which it has played its last repeat, once it has begun."""

    def begun(self, period: int) -> Run:
        """The same from a period on."""
        return replace(self, ends=None if self.duration is None else period + self.duration)


class Identification(NamedTuple):
    """What does not change while the device is powered."""

    unique_id: bytes
    """Eight bytes that no other device has."""
    firmware: tuple[int, int, int]
    bank: Bank
    """Where the firmware came from."""
    wiring: Wiring
    """The table by which pulses are sorted."""


class Controller:
    """The device behind its doors.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    time : Timebase
        The device's periods.
    chain : Chain
        The way to the processors.
    identities : sequence of Identity
        What the processors answered when they were numbered.
    identification : Identification
    log : callable
        Takes a line about each thing that happens.
    restart : callable
        Starts the device anew, as at power-up.
    revert : callable
        Does the same, and goes back to the factory image on the way.
    confirm : callable
        Told once that the firmware has come up (clause FWU-020).
    faults : Fault
        That are known from the beginning.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        time: Timebase,
        chain: Chain,
        identities: Seq[Identity],
        identification: Identification,
        *,
        log: Callable[[str], None],
        restart: Callable[[], None],
        revert: Callable[[], None],
        confirm: Callable[[], None],
        faults: Fault,
    ) -> None:
        self._scheduler = scheduler
        self.time = time
        self._chain = chain
        self._identification = identification
        self._log = log
        self._restart = restart
        self._revert = revert
        self._wakes_at: int | None = None
        self._turn = 0  # advanced with each time that it is to wake; earlier ones count no more
        self._confirm = confirm
        self._tracer = chain.tracer
        self._confirmed = False
        self._agenda = Agenda(time, chain.link)
        self._stores = Stores()
        self._supervisor = Supervisor(
            scheduler,
            time,
            chain,
            identities,
            identification.bank,
            self.raise_fault,
            self._heed_miss,
            self._question_time,
            lambda: self._commits_due,
            self._reading_time,
            self.settle,
        )
        chain.stuck = self._lose_chain
        self._periods_per_update = Budget.of(chain.link).periods_per_update
        self._transducers = np.argsort(identification.wiring.channels)
        self._doors: list[Door] = []
        self._state = State.OFF
        self.faults = Fault(0)
        self.dropped_frames = 0
        self._watchdog_fired = False
        self._watchdog = Watchdog(scheduler, self.settle, self._fall_to_watchdog)
        self._drive_limit = CHANNELS
        self._last_refusal = Reason.ACCEPTED
        self._last_sequence: int | None = None
        self._last_named: int | None = None
        self._since_period = 0
        self._runs: Run | None = None
        self._modulation_plays = False
        self._bus_suspended = False
        self._accepted = self._refused = self._late = self._lost = 0
        self._commits_due = 0
        self._loading = Loading(scheduler, time, chain, self._agenda, self.settle, self._announce_room)
        self._disabled_from: int | None = None
        self._lights: dict[int, int] = {}
        self._room_waiters: list[Callable[[], None]] = []
        if found := faults | self._supervisor.found:
            self.raise_fault(found, "found at start")

    def attach(self, door: Door) -> None:
        """From now on tell a door what nobody asked for."""
        self._doors.append(door)

    # Time

    @property
    def _now(self) -> int:
        return self._scheduler.now

    @property
    def now_tick(self) -> int:
        """Ticks since period 0."""
        return self.time.tick(self._now)

    @property
    def state(self) -> State:
        """The state of the device."""
        self.settle()
        return self._state

    def settle(self) -> None:
        """Let everything that is planned up to now have taken effect."""
        for item in self._agenda.due(self._now):
            if isinstance(item, Change):
                if item.folded:
                    self._chain.apply(item)
                self._commits_due += item.packed is not None
                if item.effect is not None:
                    item.effect(item.period)
            else:
                stream, begun = item
                self._chain.apply(stream, begun)
                self._commits_due += stream.next - begun
                if stream.effect is not None:
                    stream.effect(int(stream.periods[stream.next - 1]))

    # Blocks

    @property
    def can_accept(self) -> bool:
        """Whether there is room for another block; the OUT endpoint answers NAK otherwise (clause BLK-009)."""
        return self._agenda.room_at <= self._now and self._loading.blocks < STORES

    @property
    def _free(self) -> int:
        """Changes that can still be queued."""
        return QUEUE_BLOCKS - self._agenda.queued(self._now) if self._loading.blocks < STORES else 0

    def accept(self, packet: bytes, door: Door, arrived: int | None = None) -> None:
        """Judge a block and give its acknowledgement to the door that it came by.

        Parameters
        ----------
        packet : bytes
            Of any length.
        door : Door
        arrived : int, optional
            Tick at which its last byte had arrived; now by default.
        """
        self.settle()
        if arrived is None:
            arrived = self.now_tick
        try:
            block = unpack(packet)
            self._judge(block, arrived // TICKS_PER_PERIOD)
        except BlockError as error:
            sequence = int.from_bytes(packet[4:8], "little")
            self._refuse(error, f"block {sequence}")
            door.acknowledge(self._ack(arrived, self._last_refusal, sequence).encode())
            return
        gap = self._count(block)
        change = self._carry_out(block.body, door)
        self._tracer.span(self._now, self._now + SORT_CYCLES, "controller", "sort")
        self._trace_queue()
        flags, commit_period = (AckFlag.GAP if gap else NO_FLAGS), 0
        if change is not None:
            commit_period = change.period
            flags |= AckFlag.LATE if _is_late(block.body, change.period) else NO_FLAGS
        elif isinstance(block.body, Clock):
            commit_period = self.clock().sync_period
        door.acknowledge(self._ack(arrived, Reason.ACCEPTED, block.sequence, commit_period, flags).encode())

    def _ack(
        self,
        arrived: int,
        reason: Reason,
        sequence: int,
        commit_period: int = 0,
        flags: AckFlag = NO_FLAGS,
    ) -> Ack:
        return Ack(reason, sequence, commit_period, arrived, flags, self._free, self._state)

    def _refuse(self, error: BlockError, what: str) -> None:
        self._refused += 1
        self._last_refusal = Reason(error.reason)
        self._log(f"refuses {what}: {error}")

    def _count(self, block: Block) -> int:
        """Count an accepted block; how many numbers were left out before it (clause NUM-003)."""
        gap = 0
        if not block.restart and self._last_sequence is not None:
            gap = missing(block.sequence, self._last_sequence)
        self._last_sequence = block.sequence
        self._lost += gap
        return gap

    def _judge(self, block: Block, arrived: int) -> None:
        """Refuse what cannot be done now, of a block that had arrived in a period, by the order of clause ACK-003."""
        body, sequence, restart = block
        self._judge_state(body)
        if not restart and self._last_sequence is not None and not follows(sequence, self._last_sequence):
            raise BlockError(f"number {sequence} does not follow {self._last_sequence}", Reason.SEQUENCE)
        if isinstance(body, CHANGES) and body.period > arrived + HORIZON_PERIODS:
            raise BlockError(f"period {body.period} is too far ahead", Reason.HORIZON)
        self._judge_content(body)

    def _judge_state(self, body: Body) -> None:
        if isinstance(body, CHANGES + STORED) and self.faults & SILENCING_FAULTS:
            raise BlockError(f"{self.faults.name} is not cleared", Reason.FAULT)
        if isinstance(body, CHANGES) and self._state not in ENABLED:
            raise BlockError("the outputs are not enabled", Reason.DISABLED)

    def _judge_content(self, body: Body) -> None:
        limit = 1000 * self._drive_limit
        if isinstance(body, Update) and body.period and self._last_named is not None:
            ahead = body.period - self._last_named
            if 0 < ahead < self._periods_per_update:
                raise BlockError(
                    f"period {body.period} follows {self._last_named} more closely than the chain can", Reason.RATE
                )
        if isinstance(body, Update | Slot) and (power := body.pulses.total_drive) > limit:
            raise BlockError(f"a total drive of {power / 1000} transducers is above {self._drive_limit}", Reason.DRIVE)
        if isinstance(body, Sequence):
            self._stores.check_power(body, limit)
        if isinstance(body, Sequence | Modulation):
            self._stores.check_there(body)
        if isinstance(body, STORED):
            self._stores.check_free(body, self.time.period(self._now))

    def _carry_out(self, body: Body, door: Door) -> Change | None:
        """Do what a block that came by a door and was judged asks for; the change that it plans."""
        self._watchdog.feed()
        self._accepted += 1
        match body:
            case Update():
                self._last_named = body.period or self._last_named
                begin = partial(self._begin_update, door)
                return self._plan(body.period, self._sorted(body.pulses), (), begin, sequences=True, is_update=True)
            case Sequence():
                duration = self._stores.duration(body)
                start = Program(0, Memory.ENTRIES, 0, body.first, body.count, repeats=body.repeats)
                begin_run = partial(self._begin_sequence, Run(duration, body.unattended), door)
                change = self._plan(body.period, None, (start,), begin_run, sequences=True)
                use = self._stores.use(body, self.time.period(self._now))
                if duration is not None:
                    use.ends(change.period + duration)
                return change
            case Modulation():
                start = Program(0, Memory.SAMPLES, 0, body.first, body.count, hold=body.hold)
                change = self._plan(body.period, None, (start,), self._begin_modulation, modulations=True)
                self._stores.use(body, self.time.period(self._now))
                return change
            case Output(action=Action.END_MODULATION):
                return self._plan(body.period, None, (STOP_MODULATION,), self._end_modulation, modulations=True)
            case Output():
                disables = body.action is Action.DISABLE
                effect = partial(self._disable_as_planned if disables else self._fall_silent, door)
                stops = (STOP_MODULATION,) if self._agenda.tail.modulated else ()
                change = self._plan(body.period, SILENCE, stops, effect, sequences=True, modulations=True)
                if disables and self._disabled_from is None:
                    self._disabled_from = change.period
                return change
            case Slot() | Entries() | Samples():
                self._store(body)
        return None

    def _sorted(self, pulses: Pulses) -> bytes:
        wiring = self._identification.wiring
        return pack_pulses(Pulses(wiring.sort(pulses.phase), wiring.sort(pulses.width)))

    def _plan(
        self,
        requested: int,
        packed: bytes | None,
        programs: tuple[Program, ...],
        effect: Callable[[int], None],
        *,
        sequences: bool = False,
        modulations: bool = False,
        is_update: bool = False,
    ) -> Change:
        """Plan a change, which ends what plays of these sorts."""
        ready = self._now + SORT_CYCLES
        if self._loading and any(program.count for program in programs):
            ready = max(ready, self._agenda.loads_gone(ready, len(self._loading)))
        if self._disabled_from is not None:  # what is accepted after that is dropped by then (clause BLK-018)
            ready = max(ready, self.time.boundary(self._disabled_from) + 1)
        change = self._agenda.add(
            ready, requested, packed, programs, effect, folded=self._chain.folded, is_update=is_update
        )
        self._stores.end(change.period, sequences=sequences, modulations=modulations)
        self._dispatch(change)
        if requested and requested < change.period:
            self._late += 1
        self._log(f"sorted, planned for period {change.period}")
        return change

    def _dispatch(self, change: Change) -> None:
        if not change.folded:
            self._scheduler.at(change.start, lambda: self._send(change))
        self._plan_to_wake()

    def _plan_to_wake(self) -> None:
        """Come back when the next thing takes effect that somebody could notice.

        A far one is approached in steps, as plans change: nothing that was planned once is left behind for years.
        """
        effect = self._next_effect
        if effect is None:
            return
        at = max(self._now, min(effect, self._now + WAKE_CYCLES))
        if self._wakes_at is None or at < self._wakes_at:
            self._wakes_at = at
            self._turn += 1
            self._scheduler.at(at, partial(self._wake, self._turn))

    @property
    def _next_effect(self) -> int | None:
        """Core cycle; None if nothing is planned, or only that another update takes the place of one that plays."""
        effects = []
        more_of_the_same = self._state is State.PLAYING and self._runs is None and self._agenda.only_updates
        if self._agenda and not more_of_the_same:
            effects.append(self.time.boundary(self._agenda.first_period))
        if self._runs is not None and self._runs.ends is not None:
            effects.append(self.time.boundary(self._runs.ends))
        return min(effects, default=None)

    def _wake(self, turn: int) -> None:
        if turn != self._turn:
            return
        self._wakes_at = None
        self.settle()
        self._end_sequence()
        self._plan_to_wake()

    def _send(self, change: Change) -> None:
        self._trace_queue()
        if any(item is change for item in self._agenda):
            self._chain.send(change)

    def _trace_queue(self) -> None:
        self._tracer.value(self._now, "controller.queue", QUEUE_BITS, self._agenda.queued(self._now))

    def stream(self, packets: NDArray[np.uint8], began: int, deadline: int, door: Door) -> tuple[int, int]:
        """Accept a stream of updates that arrive back to back over USB, as far as nothing else comes between.

        Parameters
        ----------
        packets : (k, 512) uint8
            Whole blocks.
        began : int
            Core cycle at which the first of them began to arrive.
        deadline : int
            Core cycle by which the last must have arrived.
        door : Door
            Takes the acknowledgements.

        Returns
        -------
        taken : int
            How many were taken; each exactly as `accept` would have. The next one may be no update, be refused, or have
            to wait for something.
        ended : int
            Core cycle at which the last of them had arrived; time may have passed further.
        """
        taken = 0
        while taken < len(packets):
            self.settle()
            if not self._streams or self._agenda.room_at > deadline:
                break
            more, began = self._stream_until_event(packets[taken:], began, deadline, door)
            taken += more
            upcoming = self._scheduler.next_time()
            arrival = max(began + PACKET_CYCLES, self._agenda.room_at)
            if taken == len(packets) or upcoming is None or upcoming > min(arrival, deadline):
                break
            self._scheduler.run_until(upcoming)
        return taken, began

    @property
    def _streams(self) -> bool:
        """Whether the next update can be judged and planned like the one before."""
        quiet = self._chain.folded and not self._loading and self._runs is None and self._agenda.only_updates
        return quiet and self._state in WATCHED and self._last_sequence is not None

    def _stream_until_event(self, packets: NDArray[np.uint8], began: int, deadline: int, door: Door) -> tuple[int, int]:
        """The same, but no further than to the next thing that happens."""
        from .streams import plan_stream, sort_pulses

        upcoming = self._scheduler.next_time()
        end = deadline if upcoming is None else min(deadline, upcoming - 1)
        packets = packets[
            : QUEUE_BLOCKS + max(end - began, 0) // CYCLES_PER_PERIOD + 1
        ]  # more do not find room by then
        updates, tail, cost = unpack_updates(packets), self._agenda.tail, self._agenda.update_cost
        named = -1 if self._last_named is None else self._last_named
        numbers = np.array(
            [self._last_sequence, named, 1000 * self._drive_limit, self._periods_per_update, HORIZON_PERIODS, 0]
        )
        times = np.array(
            [self.time.origin, began, PACKET_CYCLES, SORT_CYCLES, end, tail.sent, tail.period, tail.table, *cost]
        )
        arrivals, starts, periods, free = np.empty((4, len(packets)), np.int64)
        requested = np.minimum(updates.period, 2**62).astype(np.int64)
        taken = plan_stream(
            len(packets),
            updates.reason,
            updates.restart,
            updates.sequence.astype(np.int64),
            requested,
            updates.width,
            POWER,
            self._agenda.recent,
            numbers,
            times,
            arrivals,
            starts,
            periods,
            free,
        )
        if not taken:
            return 0, began
        packed = np.empty((taken, PROCESSORS * SLICE_BYTES), np.uint8)
        sort_pulses(packets[:taken, HEADER_BYTES:], self._transducers, packed)
        begin = partial(self._begin_update, door)
        self._agenda.add_stream(Stream(starts[:taken], periods[:taken], packed, cost, tail, begin))
        self._plan_to_wake()
        self._stores.end(int(periods[0]), sequences=True, modulations=False)
        self._acknowledge_stream(door, updates, arrivals[:taken], periods[:taken], requested[:taken], free[:taken])
        self._last_sequence, self._last_named = int(numbers[0]), None if numbers[1] < 0 else int(numbers[1])
        self._accepted += taken
        self._lost += int(numbers[5])
        self._scheduler.run_until(int(arrivals[taken - 1]))
        self._watchdog.feed()
        return taken, self._now

    def _acknowledge_stream(
        self,
        door: Door,
        updates: Updates,
        arrivals: NDArray[np.int64],
        periods: NDArray[np.int64],
        requested: NDArray[np.int64],
        free: NDArray[np.int64],
    ) -> None:
        first_effect = self.time.boundary(self._agenda.first_period)
        assert self._last_sequence is not None
        sequences = updates.sequence[: len(arrivals)].astype(np.int64)
        gaps = np.diff(sequences, prepend=self._last_sequence) % 2**32 - 1
        late = (requested != 0) & (requested < periods)
        self._late += int(late.sum())
        playing = (arrivals >= first_effect) | (self._state is State.PLAYING)
        flags = np.where(late, AckFlag.LATE, 0) | np.where(gaps > 0, AckFlag.GAP, 0)
        ticks = (arrivals - self.time.origin) // CYCLES_PER_TICK
        states = np.where(playing, State.PLAYING, State.READY)
        for record in encode_acks(sequences, periods, ticks, flags, free, states):
            door.acknowledge(record)

    def await_room(self, waiter: Callable[[], None]) -> None:
        """Call somebody once, as soon as there is room for another block."""
        self._room_waiters.append(waiter)
        if self._agenda.room_at > self._now:
            self._scheduler.at(self._agenda.room_at, self._announce_room)

    def _announce_room(self) -> None:
        if self.can_accept:
            waiters, self._room_waiters = self._room_waiters, []
            for waiter in waiters:
                waiter()

    def test_transducer(self, transducer: int, door: Door) -> None:
        """Drive one transducer alone, weakly, if there is room for it (clause CON-008).

        Raises
        ------
        BlockError
            If an update would be refused.
        """
        self.settle()
        width = np.zeros(CHANNELS, np.uint8)
        width[transducer] = TEST_WIDTH_TICKS
        update = Update(Pulses(np.zeros(CHANNELS, np.uint8), width))
        try:
            self._judge_state(update)
            self._judge_content(update)
        except BlockError as error:
            self._refuse(error, f"a test of transducer {transducer}")
            raise
        self._carry_out(update, door)

    # Stores

    def _store(self, body: Store) -> None:
        """Keep what a store brings, and let it go to the processors between changes."""
        self._stores.keep(body)
        match body:
            case Slot():
                packed = self._sorted(body.pulses)
                pieces = [(Memory.SLOTS, body.number, packed[place * SLICE_BYTES :][:SLICE_BYTES]) for place in PLACES]
            case Entries():
                pieces = [(Memory.ENTRIES, body.first, pack_entries(body.entries))] * PROCESSORS
            case Samples():
                pieces = [(Memory.SAMPLES, body.first, body.samples)] * PROCESSORS
        to_all = [
            load
            for place, (memory, first, data) in zip(PLACES, pieces, strict=True)
            for load in loads(place, memory, first, data)
        ]
        self._loading.add(to_all, self._now + SORT_CYCLES)

    def _question_time(self) -> int:
        """When a question to a processor can go without holding up a change; loads make way for it."""
        asking = self._gap_for_question()
        self._loading.make_way(asking)
        return asking

    def _reading_time(self) -> int:
        """When a question what a processor plays can go, which may hold up no loads that a program counts on either."""
        asking = self._gap_for_question()
        return max(asking, self._agenda.loads_gone(self._now, len(self._loading))) if self._loading else asking

    def _gap_for_question(self) -> int:
        self.settle()
        return self._agenda.gap(max(self._now, self._chain.free_at), self._agenda.question_cycles)

    # What changes mean

    def _begin_update(self, door: Door, period: int) -> None:
        self._runs = None
        self._since_period = period
        self._happen(Event.PLAY, self.time.boundary(period), door)

    def _begin_sequence(self, run: Run, door: Door, period: int) -> None:
        self._runs = run.begun(period)
        self._since_period = period
        self._happen(Event.PLAY_UNATTENDED if run.unattended else Event.PLAY, self.time.boundary(period), door)
        self._plan_to_wake()

    def _end_sequence(self) -> None:
        """When a sequence has played its last repeat, fall silent, as the processors do by themselves."""
        run = self._runs
        if run is not None and run.ends is not None and self._now >= self.time.boundary(run.ends):
            self._runs = None
            self._since_period = 0
            self._happen(Event.END, self._now)
            self._speak()

    def _begin_modulation(self, _: int) -> None:
        self._modulation_plays = True

    def _end_modulation(self, _: int) -> None:
        self._modulation_plays = False

    def _fall_silent(self, door: Door, period: int) -> None:
        self._runs, self._modulation_plays, self._since_period = None, False, 0
        self._happen(Event.END, self.time.boundary(period), door)

    def _disable_as_planned(self, door: Door, period: int) -> None:
        self._stores.end(period, sequences=True, modulations=True)
        self._happen(Event.DISABLE, self.time.boundary(period), door, silent=True)

    # State

    def _happen(self, event: Event, at: int, door: Door | None = None, *, silent: bool = False) -> None:
        """Something happened at a core cycle, by what came through a door if any: follow clause STA-003.

        `silent` says that the outputs have just fallen silent, with nothing on the chain after that.
        """
        was, self._state = self._state, after(self._state, event)
        if self._state is was:
            return
        self._log(f"{event.name}: {was.name} to {self._state.name}")
        self._tracer.value(at, "controller.state", STATE_BITS, self._state)
        if was in ENABLED and self._state not in ENABLED:
            self._drop_all()
            if not silent:
                self._send_silence((STOP_MODULATION,) if self._agenda.tail.modulated else ())
            self._announce_room()
        if self._state in WATCHED and was not in WATCHED:
            self._watchdog.watch(at)
        elif self._state not in WATCHED:
            self._watchdog.rest()
        if self._bus_suspended and after(self._state, Event.SUSPEND) is not self._state:
            self._happen(Event.SUSPEND, at)  # clause STA-004
        elif event in SPOKEN or door is not None:
            self._speak(besides=door)

    def _fall_to_watchdog(self) -> None:
        self._log(f"watchdog: no word from the host for {self._watchdog.milliseconds} ms")
        self._watchdog_fired = True
        self._happen(Event.WATCHDOG, self._now)

    def _drop_all(self) -> None:
        """Drop what is queued, and forget what plays (clause SAF-004)."""
        self._agenda.drop_queued(self._now)
        self._agenda.mute()
        self._loading.wake()
        self._disabled_from = None
        self._runs, self._modulation_plays, self._since_period = None, False, 0
        self._log("outputs disabled")

    def _send_silence(self, stops: tuple[Program, ...]) -> None:
        """Silence all outputs as soon as the chain can."""
        # A load or a question may just have begun.
        ready = max(self._now, self._loading.leaves) + self._agenda.question_cycles
        change = self._agenda.add(ready, 0, SILENCE, stops, None, folded=self._chain.folded, asked=False)
        self._stores.end(change.period, sequences=True, modulations=True)
        self._dispatch(change)

    def _heed_miss(self, processor: int) -> None:
        """A processor missed a commit; if that may be the silence, see to it that it falls silent all the same.

        It is sent once more. If that is missed too, for the same reason, the processor falls silent because nobody asks
        it anything meanwhile (clause CHN-018). By then it is silent for sure, until the outputs are enabled.
        """
        self.settle()
        if self._state not in ENABLED and self._supervisor.leave_alone(processor):
            self._log(f"processor {processor} may have missed the silence: sends it again, and leaves it alone")
            self._send_silence((STOP_MODULATION,))

    def _speak(self, besides: Door | None = None) -> None:
        """Say the state unasked, but not to the door that changed it (clause ACK-006)."""
        status = self.status().encode()
        for door in self._doors:
            if door is not besides:
                door.notify(status)

    def raise_fault(self, fault: Fault, what: str) -> None:
        """Something is wrong (clause SAF-008)."""
        self.settle()
        new = fault & ~self.faults
        if not new:
            return
        self.faults |= fault
        self._log(f"fault {new.name}: {what}")
        was = self._state
        if new & SILENCING_FAULTS:
            self._happen(Event.FAULT, self._now)
        if self._state is was:
            self._speak()

    def _lose_chain(self) -> None:
        """A message cannot leave: nothing is sent any more, stores that wait included."""
        self._loading.drop()
        self.raise_fault(BROKEN, "a message cannot leave: the chain is broken")
        self._announce_room()

    def _clear_faults(self) -> None:
        supervisor, kept = self._supervisor, self.faults & (Fault.SYNC | Fault.FLASH)
        if self._chain.broken:
            kept |= self.faults & Fault.CHAIN
        if not supervisor.all_answer:
            kept |= self.faults & Fault.PROCESSOR
        if supervisor.temperature_c >= CLEARED_BELOW_C:
            kept |= self.faults & Fault.TEMPERATURE
        if supervisor.persists(Fault.SUPPLY):
            kept |= self.faults & Fault.SUPPLY
        cleared, self.faults = self.faults & ~kept, kept
        supervisor.forget(cleared)
        if not kept & SILENCING_FAULTS:
            self._happen(Event.CLEAR, self._now)
        if cleared:
            self._speak()

    def new_session(self, door: Door) -> None:
        """The bus was reset, or the host (re)configured the device (clauses USB-003 and NUM-004)."""
        self.settle()
        self._happen(Event.BUS_RESET, self._now, door)
        self._last_sequence = None

    def suspend(self) -> None:
        """The bus that had configured the device is suspended."""
        self.settle()
        self._bus_suspended = True
        self._happen(Event.SUSPEND, self._now)

    def resume(self) -> None:
        """The bus resumes, or is gone for good."""
        self.settle()
        self._bus_suspended = False
        self._happen(Event.RESUME, self._now)

    def detach(self, door: Door) -> bool:
        """The device is asked through a door to detach; whether it does, in its state."""
        self.settle()
        if after(self._state, Event.DETACH) is self._state:
            return False
        self._happen(Event.DETACH, self._now, door)
        return True

    def host_arrived(self) -> None:
        """A host configured the device, or something was answered on a serial line: the firmware has come up."""
        if not self._confirmed and self._supervisor.complete:
            self._confirmed = True
            self._confirm()

    def unfold(self) -> None:
        """From now on let every message travel: something may go wrong, or somebody looks on."""
        self.settle()
        self._tracer.value(self._now, "controller.state", STATE_BITS, self._state)
        if not self._chain.folded:
            return
        self._chain.folded = False
        for item in self._agenda:  # what is under way arrives as it would have
            self._scheduler.at(self.time.boundary(item.tail.period), self.settle)
        for change in self._agenda.unfold(self._now):
            self._dispatch(change)
        self._supervisor.unfold()

    @property
    def tail_period(self) -> int:
        """The period at which the last change that was accepted takes effect."""
        return self._agenda.tail.period

    # Requests

    def request(self, setup: Setup, data: bytes, door: Door) -> bytes:
        """Carry out a vendor request that came by a door (chapter REQ).

        Raises
        ------
        Stall
            If the device does not know the request, or not in this state.
        """
        self.settle()
        answers: dict[tuple[int, int], Callable[[int], bytes]] = {
            (REQUEST_TYPE_IN, Request.INFO): lambda _: self.info().encode(),
            (REQUEST_TYPE_IN, Request.STATUS): self._answer_status,
            (REQUEST_TYPE_IN, Request.WIRING): lambda _: encode_wiring(self._identification.wiring),
            (REQUEST_TYPE_IN, Request.CLOCK): lambda _: self.clock().encode(),
            (REQUEST_TYPE_IN, Request.PULSES): lambda _: self._read_back().encode(),
            (REQUEST_TYPE_IN, Request.PROCESSORS): lambda _: encode_reports(self._supervisor.reports()),
        }
        orders: dict[tuple[int, int], Callable[[int], None]] = {
            (REQUEST_TYPE_OUT, Request.ENABLE): lambda _: self._enable(door),
            (REQUEST_TYPE_OUT, Request.DISABLE): lambda _: self._happen(Event.DISABLE, self._now, door),
            (REQUEST_TYPE_OUT, Request.WATCHDOG): self._watchdog.set_time,
            (REQUEST_TYPE_OUT, Request.LIMIT): self._set_limit,
            (REQUEST_TYPE_OUT, Request.CLEAR_FAULTS): lambda _: self._clear_faults(),
            (REQUEST_TYPE_OUT, Request.IDENTIFY): self._identify,
            (REQUEST_TYPE_OUT, Request.RESET): lambda _: self._depart(self._restart),
            (REQUEST_TYPE_OUT, Request.REVERT): lambda _: self._depart(self._revert),
        }
        key = setup.request_type, setup.request
        if key not in answers and key not in orders:
            raise Stall(f"request 0x{setup.request:02x} of type 0x{setup.request_type:02x} is unknown")
        request = Request(setup.request)
        values = VALUES.get(request, range(1))
        if setup.index or setup.value not in values:
            raise Stall(
                f"{request.name} has index 0 and value {values[0]} to {values[-1]}, not index {setup.index} and value "
                f"{setup.value}"
            )
        if key in answers:
            return answers[key](setup.value)[: setup.length]
        if setup.length or data:
            raise Stall(f"no vendor request takes data, and this one is sent with {setup.length} bytes")
        orders[key](setup.value)
        return b""

    def _enable(self, door: Door) -> None:
        if self._state in ENABLED:
            self._watchdog.feed()
            return
        if after(self._state, Event.ENABLE) is self._state:
            raise Stall(f"the outputs cannot be enabled in state {self._state.name}")
        self._watchdog_fired = False
        self._last_named = None
        self._supervisor.attend()
        self._happen(Event.ENABLE, self._now, door)

    def _depart(self, restart: Callable[[], None]) -> None:
        """Start anew once the request has been answered (clause REQ-001)."""
        self._scheduler.at(self._now + RESET_DELAY_CYCLES, restart)

    def _set_limit(self, transducers: int) -> None:
        if self._state in ENABLED:
            raise Stall("a limit is set while the outputs are off")
        self._drive_limit = transducers

    def _identify(self, board: int) -> None:
        self._lights[board] = self._now + IDENTIFY_CYCLES
        self._log(f"board {board} blinks")

    @property
    def blinking(self) -> list[int]:
        """Boards whose light blinks now (clause REQ-012)."""
        return [board for board, until in sorted(self._lights.items()) if until > self._now]

    def _answer_status(self, _: int) -> bytes:
        self._watchdog.feed()
        return self.status().encode()

    def status(self) -> Status:
        """What the device is doing (clause REQ-003)."""
        flags = StatusFlag.WATCHDOG_FIRED if self._watchdog_fired else StatusFlag(0)
        flags |= StatusFlag.SEQUENCE if self._runs is not None else StatusFlag(0)
        flags |= StatusFlag.MODULATION if self._modulation_plays else StatusFlag(0)
        return Status(
            state=self._state,
            faults=self.faults,
            last_refusal=self._last_refusal,
            flags=flags,
            now=self.now_tick,
            since_period=self._since_period,
            accepted=self._accepted % 2**32,
            refused=self._refused % 2**32,
            late=self._late % 2**32,
            lost=self._lost % 2**32,
            missed_commits=self._supervisor.missed_commits % 2**32,
            damaged_messages=self._supervisor.damaged_messages % 2**32,
            free=self._free,
            temperature_c=self._supervisor.temperature_c,
            watchdog_ms=self._watchdog.milliseconds,
            drive_limit=self._drive_limit,
            dropped_frames=self.dropped_frames % 2**32,
        )

    def clock(self) -> ClockReading:
        """Answer the CLOCK request."""
        pulses = self.time.period(self._now) // SYNC_PERIODS  # besides the first, at period 0
        return ClockReading(self.now_tick, pulses * SYNC_PERIODS, (pulses + 1) % 2**32)

    def _read_back(self) -> ReadBack:
        """Collect what plays from the processors (clause REQ-007)."""
        silent = ReadBack(0, 0, Pulses.silent(CHANNELS))
        for _ in range(ATTEMPTS_TO_READ):
            begun = self.time.period(self._now)
            found, read_period = self._supervisor.collect_playing(READ_TIMEOUT_CYCLES)
            self.settle()
            if len(found) < PROCESSORS:
                raise Stall("a processor does not say what it plays")
            since = {playing.period for playing in found}
            if len(since) == 1 and max(since) <= begun:
                break
        if self._state not in (State.PLAYING, State.UNATTENDED):
            return replace(silent, read_period=read_period)
        packed = b"".join(playing.packed for playing in found)
        by_channel, wiring = unpack_pulses(packed), self._identification.wiring
        pulses = Pulses(wiring.unsort(by_channel.phase), wiring.unsort(by_channel.width))
        return ReadBack(since.pop() if len(since) == 1 else ReadBack.MIXED, read_period, pulses)

    def info(self) -> Info:
        """Answer the INFO request."""
        return Info(
            oldest_version=PROTOCOL_VERSION,
            newest_version=PROTOCOL_VERSION,
            hardware=Hardware.FIVE_BOARDS,
            firmware=self._identification.firmware,
            boards=BOARDS,
            unique_id=self._identification.unique_id,
            carrier_hz=CARRIER_HZ,
            features=FEATURES,
            channels=CHANNELS,
            columns=COLUMNS,
            rows=ROWS,
            pitch_um=round(PITCH_M * 1e6),
            processors_per_board=PROCESSORS_PER_BOARD,
            ticks_per_period=TICKS_PER_PERIOD,
            max_width_ticks=MAX_WIDTH_TICKS,
            link_wires=self._chain.link.wires,
            cycles_per_symbol=self._chain.link.cycles_per_symbol,
            queue_blocks=QUEUE_BLOCKS,
            periods_per_update=self._periods_per_update,
            queue_records=RECORDS,
            slots=SLOTS,
            sequence_entries=SEQUENCE_ENTRIES,
            modulation_samples=MODULATION_SAMPLES,
            drive_limit=CHANNELS,
            watchdog_ms=WATCHDOG_MS,
        )


def _is_late(body: Body, period: int) -> bool:
    return isinstance(body, CHANGES) and 0 < body.period < period
