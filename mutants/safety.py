"""Broken safety: the watchdog, silence, the drive limit, and what may go on without a host (chapters SAF and STA)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..emulator import machine
from ..emulator.boards.processor import ALL_BITS, Processor
from ..emulator.control import agenda, controller
from ..emulator.control.chain import Chain
from ..emulator.control.stores import Stores
from ..emulator.control.watchdog import Watchdog
from ..emulator.door import Handshake
from ..emulator.interfaces.usb_functions import ArrayFunction
from ..errors import BlockError
from ..protocol.blocks import Sequence, Slot, Update
from ..protocol.board import CHANNELS, CYCLES_PER_MS, CYCLES_PER_PERIOD, PROCESSORS_PER_BOARD, WATCHDOG_MS
from ..protocol.chain import SLICE_BYTES
from ..protocol.codes import Reason, State, StatusFlag
from ..protocol.replies import ENABLED
from ..protocol.states import Event
from .patching import Patch, mutant
from .seams import misread_bodies, one_by_one

DEAF_BOARD = 4
FULL_PULSE = 25 << 7
FLASH_PERIODS = 40


# The watchdog


@mutant("SAF-005", "SAF-003", wraps=(controller.Controller, "_end_sequence"))
def watchdog_never_bites_after_a_sequence(original: Any, self: Any) -> None:
    """Behind the last repeat of a sequence the watchdog rests until the next ENABLE: nobody starts it again."""
    ran = self._runs is not None
    original(self)
    if ran and self._runs is None:
        self._watchdog.rest()


@mutant("SAF-003", wraps=(controller.Controller, "_refuse"))
def refused_blocks_feed_the_watchdog(original: Any, self: Any, error: Any, what: str) -> None:
    """A refused block is a sign of life: whatever arrives resets the watchdog."""
    original(self, error, what)
    self._watchdog.feed()


@mutant("SAF-003", wraps=(controller.Controller, "_refuse"))
def blocks_refused_for_what_they_would_play_feed_the_watchdog(original: Any, self: Any, error: Any, what: str) -> None:
    """A block that is sound, and refused with RATE, DRIVE, EMPTY or IN_USE, is a sign of life: it was fed before."""
    original(self, error, what)
    if error.reason in (Reason.RATE, Reason.DRIVE, Reason.EMPTY, Reason.IN_USE):
        self._watchdog.feed()


@mutant("SAF-003", "BLK-009", wraps=(ArrayFunction, "_take"))
def nak_feeds_the_watchdog(original: Any, self: Any, packet: bytes) -> Any:
    """On USB a block that is answered with NAK is a sign of life: the interrupt of the endpoint resets the watchdog."""
    handshake = original(self, packet)
    if handshake is Handshake.NAK:
        self._controller._watchdog.feed()
    return handshake


@mutant("SAF-003", wraps=(controller.Controller, "request"))
def every_request_feeds_the_watchdog(original: Any, self: Any, setup: Any, data: bytes, door: Any) -> Any:
    """CLOCK, INFO and every other request are signs of life, where only STATUS and ENABLE should be."""
    self._watchdog.feed()
    return original(self, setup, data, door)


@mutant("SAF-003")
def status_does_not_feed_the_watchdog(patch: Patch) -> None:
    """STATUS is no sign of life: only what changes something resets the watchdog."""
    patch.wrap(controller.Controller, "_answer_status", lambda _: lambda self, _value: self.status().encode())


@mutant("REQ-005", "SAF-003", wraps=(controller.Controller, "_enable"))
def enable_does_not_feed_the_watchdog(original: Any, self: Any, door: Any) -> None:
    """ENABLE is no sign of life where the outputs are enabled: nothing is to be done then."""
    if self._state not in ENABLED:
        original(self, door)


@mutant("SAF-003", wraps=(controller.Controller, "_carry_out"))
def stores_do_not_feed_the_watchdog(original: Any, self: Any, body: Any, door: Any) -> Any:
    """SLOT, ENTRIES, SAMPLES, CLOCK and NO_OP are no signs of life, where every accepted block should be."""
    fed = self._watchdog._fed
    change = original(self, body, door)
    if change is None:
        self._watchdog._fed = fed
    return change


def _bite_later(patch: Patch, cycles: int) -> None:
    patch.wrap(Watchdog, "_due", lambda original: lambda self: original(self) + cycles)


@mutant("SAF-003")
def watchdog_bites_a_period_early(patch: Patch) -> None:
    """The watchdog bites one period too soon: its time is rounded down to whole periods, less the one that runs."""
    _bite_later(patch, -CYCLES_PER_PERIOD)


@mutant("SAF-003")
def watchdog_bites_2_ms_late(patch: Patch) -> None:
    """The watchdog bites 2 ms too late: it is looked at every few milliseconds."""
    _bite_later(patch, 2 * CYCLES_PER_MS)


@mutant("SAF-003", "REQ-003", wraps=(controller.Controller, "status"))
def watchdog_is_never_said_to_have_fired(original: Any, self: Any) -> Any:
    """STATUS never has the flag WATCHDOG_FIRED: the device is off as after any DISABLE."""
    told = original(self)
    return replace(told, flags=told.flags & ~StatusFlag.WATCHDOG_FIRED)


@mutant("REQ-003", "SAF-003", wraps=(controller.Controller, "_enable"))
def enable_does_not_clear_watchdog_fired(original: Any, self: Any, door: Any) -> None:
    """STATUS has the flag WATCHDOG_FIRED from the first time on for ever, though the outputs were enabled since."""
    fired = self._watchdog_fired
    original(self, door)
    self._watchdog_fired = fired


@mutant("REQ-009")
def watchdog_time_holds_from_the_next_sign_of_life(patch: Patch) -> None:
    """A new watchdog time counts from the next sign of life on; until then the old one holds."""

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


@mutant("REQ-009", "ACK-006", wraps=(controller.Controller, "_fall_to_watchdog"))
def watchdog_tells_when_its_time_was_over(original: Any, self: Any) -> None:
    """The record of a watchdog that was made too short says when the new time was over, not when it has fired."""
    due, status = self.time.tick(self._watchdog._due), self.status
    vars(self)["status"] = lambda: replace(status(), now=due)
    try:
        original(self)
    finally:
        del vars(self)["status"]


@mutant("REQ-009", "SAF-003", wraps=(Watchdog, "set_time"))
def watchdog_time_begins_anew_with_watchdog(original: Any, self: Any, milliseconds: int) -> None:
    """The request WATCHDOG is itself a sign of life: the new time is counted from it."""
    self.feed()
    original(self, milliseconds)


# Silence


def _keep_from_silence(patch: Patch, place_is_deaf: Any) -> None:
    """Let silence that comes of a state not reach some processors."""

    @patch.around(agenda.Agenda, "add")
    def add(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        change = original(self, *arguments, **more)
        if not more.get("asked", True):
            vars(change)["is_silence"] = True
        return change

    @patch.around(Chain, "apply")
    def apply(original: Any, self: Any, item: Any, begun: int = 0) -> None:
        everybody = self.processors
        if vars(item).get("is_silence"):
            self.processors = [processor for processor in everybody if not place_is_deaf(processor.place)]
        original(self, item, begun)
        self.processors = everybody

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


@mutant("SAF-004", wraps=(controller.Controller, "_send_silence"))
def disable_takes_ten_periods(original: Any, self: Any, stops: Any) -> None:
    """The outputs fall silent ten periods after DISABLE and all that acts like it: silence waits for its turn."""
    leaves = self._loading.leaves
    self._loading.leaves = max(self._now, leaves) + 8 * CYCLES_PER_PERIOD
    original(self, stops)
    self._loading.leaves = leaves


@mutant("SAF-004", "TIM-003")
def disable_cuts_within_a_period(patch: Patch) -> None:
    """The outputs fall low the moment that DISABLE arrives, in the middle of a period: a gate is closed by hand."""

    @patch.around(controller.Controller, "_send_silence")
    def send(original: Any, self: Any, stops: Any) -> None:
        original(self, stops)
        for processor in self._chain.processors:
            processor.force(low=ALL_BITS)
        self._scheduler.at(self.time.boundary(self._agenda.tail.period), lambda: let_go(self))

    def let_go(self: Any) -> None:
        for processor in self._chain.processors:
            processor.let_go(low=ALL_BITS)


@mutant("SAF-004")
def queued_changes_begin_after_disable(patch: Patch) -> None:
    """The first change that is queued still begins at its period after DISABLE: it is dropped from the wrong end."""
    left: dict[int, Any] = {}

    @patch.around(agenda.Agenda, "drop_queued")
    def drop(original: Any, self: Any, now: int) -> None:
        queued = [change for change in self if change.start > now and change.packed is not None]
        original(self, now)
        left[id(self)] = queued[0] if queued else None

    @patch.around(controller.Controller, "_send_silence")
    def send_silence(original: Any, self: Any, stops: Any) -> None:
        original(self, stops)
        ghost = left.pop(id(self._agenda), None)
        if ghost is not None and ghost.period > self._agenda.tail.period:
            self._scheduler.at(self.time.boundary(ghost.period), lambda: play(self, ghost))

    def play(self: Any, ghost: Any) -> None:
        self.settle()
        for processor in self._chain.processors:
            piece = ghost.packed[processor.place * SLICE_BYTES :][:SLICE_BYTES]
            processor.play(np.array([ghost.period]), np.frombuffer(piece, np.uint8)[None])

    one_by_one(patch)


@mutant("SAF-003", "SAF-004", wraps=(controller.Controller, "_fall_to_watchdog"))
def watchdog_stops_the_state_alone(original: Any, self: Any) -> None:
    """Where the watchdog bites the device says OFF, and its outputs go on: silence is sent on request alone."""
    vars(self)["_send_silence"] = lambda _stops: None
    original(self)
    del vars(self)["_send_silence"]


@mutant("BLK-018", "SAF-004", wraps=(controller.Controller, "_disable_as_planned"), also=one_by_one)
def changes_behind_a_disabling_block_are_played(original: Any, self: Any, door: Any, period: int) -> None:
    """What was accepted behind an OUTPUT that disables plays when it is due, with the outputs disabled before."""
    queue, tail = self._agenda._changes.copy(), self._agenda.tail
    original(self, door, period)
    self._agenda._changes, self._agenda.tail = queue, tail
    for change in queue:
        change.effect = None


@mutant("SAF-002", "BLK-018", wraps=(controller.Controller, "_judge_state"))
def changes_are_taken_while_disabled(original: Any, self: Any, body: Any) -> None:
    """Changes are accepted before ENABLE and after DISABLE, and move the outputs: the state is not looked at."""
    try:
        original(self, body)
    except BlockError as error:
        if error.reason != Reason.DISABLED:
            raise


@mutant("STA-006", "SAF-002", wraps=(controller.Controller, "__init__"), url="emulator:?door=serial")
def outputs_are_enabled_at_power_up(original: Any, self: Any, *arguments: Any, **more: Any) -> None:
    """The device starts in READY, where it should be OFF until ENABLE; on USB SET_CONFIGURATION makes good for it."""
    original(self, *arguments, **more)
    if self._state is State.OFF:
        self._state = State.READY


@mutant("SAF-001", wraps=(Processor, "start"))
def outputs_are_high_at_power_up(original: Any, self: Any, time: Any) -> None:
    """For the first millisecond every output plays what stood in its memory: the port starts before it is cleared."""
    original(self, time)
    pair = (FULL_PULSE | FULL_PULSE << 12).to_bytes(3, "little")
    pulses = np.frombuffer(pair * (SLICE_BYTES // 3), np.uint8)[None]
    self.reel.play(np.array([0]), pulses)
    self.reel.silence(FLASH_PERIODS)


@mutant("SAF-001", "REQ-013")
def reset_leaves_the_outputs_playing(patch: Patch) -> None:
    """After RESET the outputs go on with what they played, until something else does: the ports are not stopped."""
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
            processor.reel.play(np.array([0]), np.frombuffer(packed, np.uint8)[None])


# The drive limit


@mutant("SAF-006", wraps=(controller.Controller, "_judge_content"))
def drive_of_slots_is_not_judged(original: Any, self: Any, body: Any) -> None:
    """A SLOT above the drive limit is kept; a SEQUENCE that would play it is refused."""
    if isinstance(body, Slot):
        self._stores.check_free(body, self.time.period(self._now))
    else:
        original(self, body)


@mutant("SAF-006")
def drive_of_sequences_is_not_judged(patch: Patch) -> None:
    """A SEQUENCE plays slots that were stored before the limit was lowered: they were judged once."""
    patch.wrap(Stores, "check_power", lambda _: lambda _self, _body, _limit: None)


@mutant("SAF-006", wraps=(controller.Controller, "_judge_content"), also=one_by_one)
def drive_at_the_limit_is_refused(original: Any, self: Any, body: Any) -> None:
    """An UPDATE or a SLOT whose total drive is just the limit is refused: `>=` stands where `>` should."""
    original(self, body)
    if isinstance(body, Update | Slot) and body.pulses.total_drive == 1000 * self._drive_limit:
        raise BlockError("the total drive is at the limit", Reason.DRIVE)


def _allow_drive(patch: Patch, allowed: Any) -> None:
    """Accept an UPDATE or a SLOT that is refused with DRIVE, if its pulses are allowed under the limit."""

    @patch.around(controller.Controller, "_judge_content")
    def judge(original: Any, self: Any, body: Any) -> None:
        limit = self._drive_limit
        if isinstance(body, Update | Slot) and allowed(body.pulses, limit):
            self._drive_limit = 2 * CHANNELS
        try:
            original(self, body)
        finally:
            self._drive_limit = limit


@mutant("SAF-006")
def drive_is_compared_in_whole_transducers(patch: Patch) -> None:
    """A total drive of up to 0.999 transducers above the limit passes: the thousandths are cut off first."""
    _allow_drive(patch, lambda pulses, limit: pulses.total_drive // 1000 <= limit)


@mutant("SAF-006")
def drive_is_the_sum_of_widths(patch: Patch) -> None:
    """Pulses pass whose widths sum up to 25 times the limit at most, though wide ones have more power than that."""
    _allow_drive(patch, lambda pulses, limit: int(pulses.width.astype(np.int64).sum()) <= 25 * limit)


@mutant("REQ-010")
def limit_is_taken_while_enabled(patch: Patch) -> None:
    """LIMIT is carried out while the outputs are enabled, where STALL should answer."""
    patch.wrap(
        controller.Controller,
        "_set_limit",
        lambda _: lambda self, transducers: setattr(self, "_drive_limit", transducers),
    )


@mutant("REQ-010", "SAF-006", wraps=(controller.Controller, "_drop_all"))
def limit_goes_back_with_disable(original: Any, self: Any) -> None:
    """The drive limit is that of INFO again after DISABLE: it was meant to hold for a session."""
    original(self)
    self._drive_limit = CHANNELS


# States


@mutant("SAF-007", "STA-003", wraps=(controller, "after"))
def enable_is_possible_in_fault(original: Any, state: State, event: Event) -> State:
    """ENABLE leads from FAULT to READY though no fault was cleared; changes are refused with FAULT all the same."""
    leaves_fault = state is State.FAULT and event is Event.ENABLE
    return State.READY if leaves_fault else original(state, event)


@mutant("SAF-007", wraps=(controller.Controller, "_judge_state"))
def blocks_are_taken_in_fault(original: Any, self: Any, body: Any) -> None:
    """Stores are accepted while a silencing fault is not cleared, and changes are refused with DISABLED."""
    try:
        original(self, body)
    except BlockError as error:
        if error.reason != Reason.FAULT:
            raise
        if isinstance(body, controller.CHANGES):
            raise BlockError("the outputs are not enabled", Reason.DISABLED) from None


@mutant("SAF-005", "BLK-015")
def unattended_is_ignored(patch: Patch) -> None:
    """A sequence with the flag UNATTENDED plays as any other: the watchdog and a suspended bus end it."""
    misread_bodies(patch, lambda body: replace(body, unattended=False) if isinstance(body, Sequence) else body)


@mutant("SAF-005", "STA-001")
def every_sequence_is_unattended(patch: Patch) -> None:
    """A sequence without the flag UNATTENDED goes on without its host as well: whatever is stored needs none."""
    misread_bodies(patch, lambda body: replace(body, unattended=True) if isinstance(body, Sequence) else body)


@mutant("SAF-005", "USB-003", "STA-003", wraps=(controller.Controller, "new_session"))
def unattended_sequence_survives_a_new_session(original: Any, self: Any, door: Any) -> None:
    """A bus reset and SET_CONFIGURATION leave an unattended sequence playing: no host is what it was made for."""
    self.settle()
    if self._state is State.UNATTENDED:
        self._last_sequence = None
    else:
        original(self, door)


@mutant("SAF-005", "USB-020", "STA-003", wraps=(controller.Controller, "suspend"))
def suspend_ends_what_is_unattended(original: Any, self: Any) -> None:
    """A suspended bus ends an unattended sequence: the outputs are disabled whatever plays."""
    self.settle()
    if self._state is State.UNATTENDED:
        self._happen(Event.DISABLE, self._now)
    original(self)


@mutant("SAF-005", wraps=(controller.Controller, "_begin_update"))
def update_does_not_wake_the_watchdog(original: Any, self: Any, door: Any, period: int) -> None:
    """An UPDATE that ends an unattended sequence leaves the watchdog at rest: only ENABLE starts it."""
    was_unattended = self._state is State.UNATTENDED
    original(self, door, period)
    if was_unattended:
        self._watchdog.rest()
