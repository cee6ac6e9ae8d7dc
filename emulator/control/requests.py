"""Requests: what the device answers to vendor requests, and what it does when it is asked to (chapter REQ).

What a host asks by USB, a serial line or the console comes here. It reads what the other parts know; what it changes
by itself is limits and lights. It judges no block and plans nothing: the rest it asks of the part that owns it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from ...protocol.blocks import unpack_pulses
from ...protocol.board import (
    BOARDS,
    CARRIER_HZ,
    CHANNELS,
    COLUMNS,
    CORE_HZ,
    CYCLES_PER_MS,
    MAX_WIDTH_TICKS,
    PITCH_M,
    PROCESSORS,
    PROCESSORS_PER_BOARD,
    ROWS,
    TICKS_PER_PERIOD,
    WATCHDOG_MS,
)
from ...protocol.codes import (
    MODULATION_SAMPLES,
    PROTOCOL_VERSION,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    SEQUENCE_ENTRIES,
    SLOTS,
    SYNC_PERIODS,
    Bank,
    Feature,
    Hardware,
    Request,
    State,
    StatusFlag,
)
from ...protocol.pulses import Pulses
from ...protocol.replies import ENABLED, ClockReading, Info, ReadBack, Status, encode_reports, encode_wiring
from ...protocol.requests import VALUES, Setup
from ...protocol.states import StateEvent, after
from ...protocol.wiring import Wiring
from ..door import Door, Stall
from .agenda import QUEUE_BLOCKS
from .device_state import DeviceState
from .dispatch import Dispatch
from .known_faults import KnownFaults
from .state_machine import StateMachine

__all__ = ["FEATURES", "QUEUE_RECORDS", "Identification", "Requests"]

QUEUE_RECORDS = 256
"""Records that can wait on bulk IN, which INFO tells (clause ACK-001)."""
FEATURES = ~Feature(0)
RESET_DELAY_CYCLES = CYCLES_PER_MS // 10
READ_TIMEOUT_CYCLES = 10 * CYCLES_PER_MS
IDENTIFY_CYCLES = 5 * CORE_HZ
ATTEMPTS_TO_READ = 3


class Identification(NamedTuple):
    """What does not change while the device is powered."""

    unique_id: bytes
    """Eight bytes that no other device has."""
    firmware: tuple[int, int, int]
    bank: Bank
    """Where the firmware came from."""
    wiring: Wiring
    """The table by which pulses are sorted."""


class Requests:
    """Carries out vendor requests."""

    def __init__(
        self,
        device: DeviceState,
        dispatch: Dispatch,
        machine: StateMachine,
        faults: KnownFaults,
        identification: Identification,
        *,
        restart: Callable[[], None],
        revert: Callable[[], None],
        log: Callable[[str], None],
    ) -> None:
        self._device = device
        self._dispatch = dispatch
        self._machine = machine
        self._faults = faults
        self._supervisor = faults.supervisor
        self._identification = identification
        self._restart = restart
        self._revert = revert
        self._log = log
        self._lights: dict[int, int] = {}

    def request(self, setup: Setup, data: bytes, door: Door) -> bytes:
        """Carry out a vendor request that came by a door (chapter REQ).

        Raises
        ------
        Stall
            If the device does not know the request, or not in this state.
        """
        self._dispatch.settle()
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
            (REQUEST_TYPE_OUT, Request.DISABLE): lambda _: self._machine.happen(
                StateEvent.DISABLE, self._dispatch.now, door
            ),
            (REQUEST_TYPE_OUT, Request.WATCHDOG): self._machine.watchdog.set_time,
            (REQUEST_TYPE_OUT, Request.LIMIT): self._set_limit,
            (REQUEST_TYPE_OUT, Request.CLEAR_FAULTS): lambda _: self._faults.clear(),
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
        if self._device.state in ENABLED:
            self._machine.watchdog.feed()
            return
        if after(self._device.state, StateEvent.ENABLE) is self._device.state:
            raise Stall(f"the outputs cannot be enabled in state {self._device.state.name}")
        self._device.last_named = None
        self._supervisor.attend()
        self._machine.happen(StateEvent.ENABLE, self._dispatch.now, door)

    def _depart(self, restart: Callable[[], None]) -> None:
        """Start anew once the request has been answered (clause REQ-001)."""
        self._dispatch.scheduler.at(self._dispatch.now + RESET_DELAY_CYCLES, restart)

    def _set_limit(self, transducers: int) -> None:
        if self._device.state in ENABLED:
            raise Stall("a limit is set while the outputs are off")
        self._device.drive_limit = transducers

    def _identify(self, board: int) -> None:
        self._lights[board] = self._dispatch.now + IDENTIFY_CYCLES
        self._log(f"board {board} blinks")

    @property
    def blinking(self) -> list[int]:
        """Boards whose light blinks now (clause REQ-012)."""
        return [board for board, until in sorted(self._lights.items()) if until > self._dispatch.now]

    def _answer_status(self, _: int) -> bytes:
        self._machine.watchdog.feed()
        return self.status().encode()

    def status(self) -> Status:
        """What the device is doing (clause REQ-003)."""
        flags = StatusFlag.WATCHDOG_FIRED if self._device.watchdog_fired else StatusFlag(0)
        flags |= StatusFlag.SEQUENCE if self._device.runs is not None else StatusFlag(0)
        flags |= StatusFlag.MODULATION if self._device.modulation_plays else StatusFlag(0)
        return Status(
            state=self._device.state,
            faults=self._device.faults,
            last_refusal=self._device.last_refusal,
            flags=flags,
            now=self._dispatch.now_tick,
            since_period=self._device.since_period,
            accepted=self._device.accepted % 2**32,
            refused=self._device.refused % 2**32,
            late=self._device.late % 2**32,
            lost=self._device.lost % 2**32,
            missed_commits=self._supervisor.missed_commits % 2**32,
            damaged_messages=self._supervisor.damaged_messages % 2**32,
            free=self._dispatch.free,
            temperature_c=self._supervisor.temperature_c,
            watchdog_ms=self._machine.watchdog.milliseconds,
            drive_limit=self._device.drive_limit,
            dropped_frames=self._device.dropped_frames % 2**32,
        )

    def clock(self) -> ClockReading:
        """Answer the CLOCK request."""
        pulses = self._dispatch.time.period(self._dispatch.now) // SYNC_PERIODS  # besides the first, at period 0
        return ClockReading(self._dispatch.now_tick, pulses * SYNC_PERIODS, (pulses + 1) % 2**32)

    def _read_back(self) -> ReadBack:
        """Collect what plays from the processors (clause REQ-007)."""
        silent = ReadBack(0, 0, Pulses.silent(CHANNELS))
        for _ in range(ATTEMPTS_TO_READ):
            begun = self._dispatch.time.period(self._dispatch.now)
            found, read_period = self._supervisor.collect_playing(READ_TIMEOUT_CYCLES)
            self._dispatch.settle()
            if len(found) < PROCESSORS:
                raise Stall("a processor does not say what it plays")
            since = {playing.period for playing in found}
            if len(since) == 1 and max(since) <= begun:
                break
        if self._device.state not in (State.PLAYING, State.UNATTENDED):
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
            link_wires=self._dispatch.chain.link.wires,
            cycles_per_symbol=self._dispatch.chain.link.cycles_per_symbol,
            queue_blocks=QUEUE_BLOCKS,
            periods_per_update=self._dispatch.periods_per_update,
            queue_records=QUEUE_RECORDS,
            slots=SLOTS,
            sequence_entries=SEQUENCE_ENTRIES,
            modulation_samples=MODULATION_SAMPLES,
            drive_limit=CHANNELS,
            watchdog_ms=WATCHDOG_MS,
        )
