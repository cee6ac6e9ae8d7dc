"""Broken safety: watchdog, silence, drive limit, and what may play without a host (chapters SAF and STA)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ....base.errors import BlockError
from ....emulator import machine
from ....emulator.boards.package import ALL_BITS
from ....emulator.boards.processor import Processor
from ....emulator.control import agenda, requests, state_machine
from ....emulator.control.admission import CHANGES, Admission
from ....emulator.control.chain import Chain, ModelledChain
from ....emulator.control.controller import Controller
from ....emulator.control.dispatch import Dispatch
from ....emulator.control.execution import Execution
from ....emulator.control.requests import Requests
from ....emulator.control.state_machine import StateMachine
from ....emulator.control.stores import Stores
from ....emulator.control.watchdog import Watchdog
from ....emulator.door import Handshake
from ....emulator.interfaces.usb_functions import ArrayFunction
from ....protocol.blocks import PlaySequence, Slot, Update
from ....protocol.board import CHANNELS, CYCLES_PER_MS, CYCLES_PER_PERIOD, PROCESSORS_PER_BOARD, WATCHDOG_MS
from ....protocol.chain import SLICE_BYTES
from ....protocol.codes import Reason, State, StatusFlag
from ....protocol.replies import ENABLED
from ....protocol.states import StateEvent
from .patching import Patch, mutant
from .seams import allow_drive, misread_bodies, one_by_one

DEAF_BOARD = 4
FULL_PULSE = 25 << 7
FLASH_PERIODS = 40


# The watchdog


@mutant("SAF-005", "SAF-003", wraps=(Execution, "end_sequence"))
def watchdog_never_bites_after_a_sequence(original: Any, self: Any) -> None:
    """After the last repeat of a sequence the watchdog stays at rest until the next ENABLE: it is not started again."""
    ran = self._device.runs is not None
    original(self)
    if ran and self._device.runs is None:
        self._machine.watchdog.rest()


@mutant("SAF-003", wraps=(Controller, "_refuse"))
def refused_blocks_feed_the_watchdog(original: Any, self: Any, error: Any, what: str) -> None:
    """A refused block is a sign of life: any block resets the watchdog."""
    original(self, error, what)
    self._machine.watchdog.feed()


@mutant("SAF-003", wraps=(Controller, "_refuse"))
def blocks_refused_for_what_they_would_play_feed_the_watchdog(original: Any, self: Any, error: Any, what: str) -> None:
    """A sound block that is refused with RATE, DRIVE, EMPTY or IN_USE is a sign of life: it counts too early."""
    original(self, error, what)
    if error.reason in (Reason.RATE, Reason.DRIVE, Reason.EMPTY, Reason.IN_USE):
        self._machine.watchdog.feed()


@mutant("SAF-003", "BLK-009", wraps=(ArrayFunction, "_take"))
def nak_feeds_the_watchdog(original: Any, self: Any, packet: bytes) -> Any:
    """On USB a block that gets NAK is a sign of life: the endpoint's interrupt resets the watchdog."""
    handshake = original(self, packet)
    if handshake is Handshake.NAK:
        self._controller._machine.watchdog.feed()
    return handshake


@mutant("SAF-003", wraps=(Requests, "request"))
def every_request_feeds_the_watchdog(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
    """CLOCK, INFO and every other request are signs of life; only STATUS and ENABLE should be."""
    self._machine.watchdog.feed()
    return original(self, setup, data, door)


@mutant("SAF-003")
def status_does_not_feed_the_watchdog(patch: Patch) -> None:
    """STATUS is no sign of life: only requests that change something reset the watchdog."""
    patch.wrap(Requests, "_answer_status", lambda _: lambda self, _value: self.status().encode())


@mutant("REQ-005", "SAF-003", wraps=(Requests, "_enable"))
def enable_does_not_feed_the_watchdog(original: Any, self: Any, door: Any) -> None:
    """ENABLE is no sign of life while the outputs are enabled: it returns early."""
    if self._device.state not in ENABLED:
        original(self, door)


@mutant("SAF-003", wraps=(Execution, "carry_out"))
def stores_do_not_feed_the_watchdog(original: Any, self: Any, body: Any, door: Any) -> Any:
    """SLOT, ENTRIES, SAMPLES, CLOCK and NO_OP are no signs of life; every accepted block should be."""
    fed = self._machine.watchdog._fed
    change = original(self, body, door)
    if change is None:
        self._machine.watchdog._fed = fed
    return change


def _fire_later(patch: Patch, cycles: int) -> None:
    patch.wrap(Watchdog, "_due", lambda original: lambda self: original(self) + cycles)


@mutant("SAF-003")
def watchdog_bites_a_period_early(patch: Patch) -> None:
    """The watchdog fires one period too soon: its time is rounded down to whole periods, less the current one."""
    _fire_later(patch, -CYCLES_PER_PERIOD)


@mutant("SAF-003")
def watchdog_bites_2_ms_late(patch: Patch) -> None:
    """The watchdog fires 2 ms too late: it is polled every few milliseconds."""
    _fire_later(patch, 2 * CYCLES_PER_MS)


@mutant("SAF-003", "REQ-003", wraps=(Requests, "status"))
def watchdog_is_never_said_to_have_fired(original: Any, self: Any) -> Any:
    """STATUS never has the flag WATCHDOG_FIRED: the device is off as after DISABLE."""
    told = original(self)
    return replace(told, flags=told.flags & ~StatusFlag.WATCHDOG_FIRED)


@mutant("REQ-003", "SAF-003", wraps=(Requests, "_enable"))
def enable_does_not_clear_watchdog_fired(original: Any, self: Any, door: Any) -> None:
    """After the watchdog has fired once, STATUS keeps the flag WATCHDOG_FIRED for ever, even after ENABLE."""
    fired = self._device.watchdog_fired
    original(self, door)
    self._device.watchdog_fired = fired


@mutant("REQ-009")
def watchdog_time_holds_from_the_next_sign_of_life(patch: Patch) -> None:
    """A new watchdog time holds only from the next sign of life; until then the old one holds."""

    def hold(self: Any) -> None:
        if vars(self).get("holds", WATCHDOG_MS) != self.milliseconds:
            vars(self)["holds"] = self.milliseconds
            if self._watching:
                self._arm()

    def set_time(_: Any) -> Any:
        return lambda self, milliseconds: setattr(self, "milliseconds", milliseconds)

    @patch.around(Watchdog, "feed")
    def feed(original: Any, self: Any) -> None:
        original(self)
        hold(self)

    @patch.around(Watchdog, "watch")
    def watch(original: Any, self: Any, since: int) -> None:
        vars(self)["holds"] = self.milliseconds
        original(self, since)

    def due(_: Any) -> Any:
        return lambda self: self._fed + vars(self).get("holds", WATCHDOG_MS) * CYCLES_PER_MS

    patch.wrap(Watchdog, "set_time", set_time)
    patch.wrap(Watchdog, "_due", due)


@mutant("REQ-009", "ACK-006", wraps=(StateMachine, "_watchdog_fires"))
def watchdog_tells_when_its_time_was_over(original: Any, self: Any) -> None:
    """If the watchdog's time is shortened to the past, its record names the new time's end instead of the firing."""
    due, status = self._dispatch.time.tick(self.watchdog._due), self._status
    self._status = lambda: replace(status(), now=due)
    try:
        original(self)
    finally:
        self._status = status


@mutant("REQ-009", "SAF-003", wraps=(Watchdog, "set_time"))
def watchdog_time_begins_anew_with_watchdog(original: Any, self: Any, milliseconds: int) -> None:
    """The request WATCHDOG is a sign of life: the new time counts from the request."""
    self.feed()
    original(self, milliseconds)


# Silence


def _keep_from_silence(patch: Patch, place_is_deaf: Any) -> None:
    """Let a silence that a state causes miss some processors."""

    @patch.around(agenda.Agenda, "add")
    def add(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        change = original(self, *arguments, **more)
        if not more.get("asked", True):
            vars(change)["is_silence"] = True
        return change

    @patch.around(ModelledChain, "apply")
    def apply(original: Any, self: Any, item: Any, begun: int = 0) -> None:
        everybody = self._models
        if vars(item).get("is_silence"):
            self._models = [processor for processor in everybody if not place_is_deaf(processor.place)]
        original(self, item, begun)
        self._models = everybody

    @patch.around(Chain, "send")
    def send(original: Any, self: Any, change: Any) -> None:
        if vars(change).get("is_silence"):
            passing = self.pass_down
            vars(self)["pass_down"] = lambda message: None if place_is_deaf(message.node) else passing(message)
        original(self, change)
        vars(self).pop("pass_down", None)


@mutant("SAF-004")
def disable_leaves_a_board_playing(patch: Patch) -> None:
    """Board 4 plays on when the outputs are disabled: the loop over the boards ends one early."""
    _keep_from_silence(patch, lambda place: place // PROCESSORS_PER_BOARD == DEAF_BOARD)


@mutant("SAF-004", wraps=(Dispatch, "send_silence"))
def disable_takes_ten_periods(original: Any, self: Any, stops: Any) -> None:
    """The outputs fall silent ten periods after DISABLE and similar events: the silence waits its turn."""
    leaves = self.loading.leaves
    self.loading.leaves = max(self.now, leaves) + 8 * CYCLES_PER_PERIOD
    original(self, stops)
    self.loading.leaves = leaves


@mutant("SAF-004", "TIM-003")
def disable_cuts_within_a_period(patch: Patch) -> None:
    """The outputs fall low at the moment of DISABLE, in mid-period: a gate is closed directly."""

    @patch.around(Dispatch, "send_silence")
    def send(original: Any, self: Any, stops: Any) -> None:
        original(self, stops)
        for processor in self.chain.processors:
            processor.force(low=ALL_BITS)
        self.scheduler.at(self.time.boundary(self.agenda.tail.period), lambda: let_go(self))

    def let_go(self: Any) -> None:
        for processor in self.chain.processors:
            processor.let_go(low=ALL_BITS)


@mutant("SAF-004")
def queued_changes_begin_after_disable(patch: Patch) -> None:
    """After DISABLE the first queued change still begins at its period: the queue drops from the wrong end."""
    left: dict[int, Any] = {}

    @patch.around(agenda.Agenda, "drop_queued")
    def drop(original: Any, self: Any, now: int) -> None:
        queued = [change for change in self if change.start > now and change.packed is not None]
        original(self, now)
        left[id(self)] = queued[0] if queued else None

    @patch.around(Dispatch, "send_silence")
    def send_silence(original: Any, self: Any, stops: Any) -> None:
        original(self, stops)
        ghost = left.pop(id(self.agenda), None)
        if ghost is not None and ghost.period > self.agenda.tail.period:
            self.scheduler.at(self.time.boundary(ghost.period), lambda: play(self, ghost))

    def play(self: Any, ghost: Any) -> None:
        self.settle()
        for processor in self.chain.processors:
            piece = ghost.packed[processor.place * SLICE_BYTES :][:SLICE_BYTES]
            processor.play(np.array([ghost.period]), np.frombuffer(piece, np.uint8)[None])

    one_by_one(patch)


@mutant("SAF-003", "SAF-004", wraps=(StateMachine, "_watchdog_fires"))
def watchdog_stops_the_state_alone(original: Any, self: Any) -> None:
    """When the watchdog fires the device reports OFF, but its outputs go on: only requests send the silence."""
    vars(self._dispatch)["send_silence"] = lambda _stops: None
    original(self)
    del vars(self._dispatch)["send_silence"]


@mutant("BLK-018", "SAF-004", wraps=(Execution, "_disable_as_planned"), also=one_by_one)
def changes_behind_a_disabling_block_are_played(original: Any, self: Any, door: Any, period: int) -> None:
    """A change accepted after a disabling OUTPUT plays when it is due, although the outputs are disabled."""
    queue, tail = self._dispatch.agenda._changes.copy(), self._dispatch.agenda.tail
    original(self, door, period)
    self._dispatch.agenda._changes, self._dispatch.agenda.tail = queue, tail
    for change in queue:
        change.effect = None


@mutant("SAF-002", "BLK-018", wraps=(Admission, "_judge_state"))
def changes_are_taken_while_disabled(original: Any, self: Any, body: Any) -> None:
    """Changes are accepted before ENABLE and after DISABLE, and move the outputs: the state is not checked."""
    try:
        original(self, body)
    except BlockError as error:
        if error.reason != Reason.DISABLED:
            raise


@mutant("STA-006", "SAF-002", wraps=(Controller, "__init__"), url="emulator:?door=serial")
def outputs_are_enabled_at_power_up(original: Any, self: Any, *arguments: Any, **more: Any) -> None:
    """The device starts in READY instead of OFF; on USB, SET_CONFIGURATION hides it."""
    original(self, *arguments, **more)
    if self._device.state is State.OFF:
        self._device.state = State.READY


@mutant("SAF-001", wraps=(Processor, "start"))
def outputs_are_high_at_power_up(original: Any, self: Any, time: Any) -> None:
    """In the first millisecond every output plays old memory: the port starts before it is cleared."""
    original(self, time)
    pair = (FULL_PULSE | FULL_PULSE << 12).to_bytes(3, "little")
    pulses = np.frombuffer(pair * (SLICE_BYTES // 3), np.uint8)[None]
    self.history.play(np.array([0]), pulses)
    self.history.silence(FLASH_PERIODS)


@mutant("SAF-001", "REQ-013")
def reset_leaves_the_outputs_playing(patch: Patch) -> None:
    """After RESET the outputs go on with what they played until a new change: the ports are not stopped."""
    playing: dict[int, list[bytes]] = {}

    @patch.around(machine.Emulator, "restart")
    def restart(original: Any, self: Any) -> None:
        if self.controller is not None:
            self.controller.settle()
            period = self._time.period(self.scheduler.now)
            playing[id(self)] = [processor.playing(period).packed for processor in self.processors]
        original(self)

    @patch.around(machine.Emulator, "_come_up")
    def come_up(original: Any, self: Any, *arguments: Any) -> None:
        original(self, *arguments)
        for processor, packed in zip(self.processors, playing.pop(id(self), []), strict=False):
            processor.history.play(np.array([0]), np.frombuffer(packed, np.uint8)[None])


# The drive limit


@mutant("SAF-006")
def drive_of_slots_is_not_judged(patch: Patch) -> None:
    """A SLOT above the drive limit is stored; a SEQUENCE that would play it is refused."""
    allow_drive(patch, Slot, lambda _pulses, _limit: True)


@mutant("SAF-006")
def drive_of_sequences_is_not_judged(patch: Patch) -> None:
    """A SEQUENCE plays slots that were stored before the limit was lowered: only SLOT checks the limit."""
    patch.wrap(Stores, "check_power", lambda _: lambda _self, _body, _limit: None)


@mutant("SAF-006", wraps=(Admission, "_judge_stores"), also=one_by_one)
def drive_at_the_limit_is_refused(original: Any, self: Any, body: Any) -> None:
    """An UPDATE or a SLOT with a total drive exactly at the limit is refused: `>=` stands in place of `>`."""
    if isinstance(body, Update | Slot) and body.pulses.total_drive == 1000 * self._device.drive_limit:
        raise BlockError("the total drive is at the limit", Reason.DRIVE)
    original(self, body)


@mutant("SAF-006")
def drive_is_compared_in_whole_transducers(patch: Patch) -> None:
    """A total drive of up to 0.999 transducers above the limit passes: the thousandths are cut off."""
    allow_drive(patch, Update | Slot, lambda pulses, limit: pulses.total_drive // 1000 <= limit)


@mutant("SAF-006")
def drive_is_the_sum_of_widths(patch: Patch) -> None:
    """Pulses pass if their widths sum up to at most 25 times the limit, although wide ones have more power."""
    allow_drive(patch, Update | Slot, lambda pulses, limit: int(pulses.width.astype(np.int64).sum()) <= 25 * limit)


@mutant("REQ-010")
def limit_is_taken_while_enabled(patch: Patch) -> None:
    """LIMIT is carried out while the outputs are enabled; STALL should answer."""
    patch.wrap(
        Requests,
        "_set_limit",
        lambda _: lambda self, transducers: setattr(self._device, "drive_limit", transducers),
    )


@mutant("REQ-010", "SAF-006", wraps=(StateMachine, "_drop_all"))
def limit_goes_back_with_disable(original: Any, self: Any) -> None:
    """DISABLE resets the drive limit to that of INFO: it was meant to hold for a session."""
    original(self)
    self._device.drive_limit = CHANNELS


# States


@mutant("SAF-007", "STA-003")
def enable_is_possible_in_fault(patch: Patch) -> None:
    """ENABLE leads from FAULT to READY while a fault is not cleared; changes are still refused with FAULT."""

    def after(original: Any, state: State, event: StateEvent) -> Any:
        leaves_fault = state is State.FAULT and event is StateEvent.ENABLE
        return State.READY if leaves_fault else original(state, event)

    for module in (requests, state_machine):
        patch.around(module, "after")(after)


@mutant("SAF-007", wraps=(Admission, "_judge_state"))
def blocks_are_taken_in_fault(original: Any, self: Any, body: Any) -> None:
    """While a silencing fault is not cleared stores are accepted, and changes are refused with DISABLED."""
    try:
        original(self, body)
    except BlockError as error:
        if error.reason != Reason.FAULT:
            raise
        if isinstance(body, CHANGES):
            raise BlockError("the outputs are not enabled", Reason.DISABLED) from None


@mutant("SAF-005", "BLK-015")
def unattended_is_ignored(patch: Patch) -> None:
    """A sequence with the flag UNATTENDED plays like any other: the watchdog and suspend end it."""
    misread_bodies(patch, lambda body: replace(body, unattended=False) if isinstance(body, PlaySequence) else body)


@mutant("SAF-005", "STA-001")
def every_sequence_is_unattended(patch: Patch) -> None:
    """A sequence without the flag UNATTENDED goes on without its host: stored data seem to need none."""
    misread_bodies(patch, lambda body: replace(body, unattended=True) if isinstance(body, PlaySequence) else body)


@mutant("SAF-005", "USB-003", "STA-003", wraps=(StateMachine, "new_session"))
def unattended_sequence_survives_a_new_session(original: Any, self: Any, door: Any) -> None:
    """A bus reset and SET_CONFIGURATION leave an unattended sequence playing: it was made for no host."""
    self._dispatch.settle()
    if self._device.state is State.UNATTENDED:
        self._device.last_sequence = None
    else:
        original(self, door)


@mutant("SAF-005", "USB-020", "STA-003", wraps=(StateMachine, "suspend"))
def suspend_ends_what_is_unattended(original: Any, self: Any) -> None:
    """Suspend ends an unattended sequence: the outputs are disabled whatever plays."""
    self._dispatch.settle()
    if self._device.state is State.UNATTENDED:
        self.happen(StateEvent.DISABLE, self._dispatch.now)
    original(self)


@mutant("SAF-005", wraps=(Execution, "begin_update"))
def update_does_not_wake_the_watchdog(original: Any, self: Any, door: Any, period: int) -> None:
    """An UPDATE that ends an unattended sequence does not start the watchdog: only ENABLE does."""
    was_unattended = self._device.state is State.UNATTENDED
    original(self, door, period)
    if was_unattended:
        self._machine.watchdog.rest()
