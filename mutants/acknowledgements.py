"""Broken acknowledgements: what they say, when they come, and in which order (chapter ACK)."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..emulator.control import controller
from ..emulator.door import Door
from ..emulator.interfaces.serial_line import SerialLine
from ..emulator.interfaces.usb_functions import ArrayFunction
from ..protocol.blocks import Output, Sequence, Update
from ..protocol.board import CYCLES_PER_MS, TICKS_PER_PERIOD
from ..protocol.codes import Action, Kind, State
from ..protocol.replies import ENABLED, Ack, ClockReading
from .patching import Patch, mutant
from .seams import mangle_acks, one_by_one, sealed_record

VERSION, REASON, KIND, RESERVED = 2, 3, 3, 27
NOW = slice(16, 24)
COMPANY_CYCLES = 50 * CYCLES_PER_MS
TICKS_PER_MS = 2000


def _tell_now_as(patch: Patch, told: Any) -> None:
    def mangle(record: bytearray) -> bytes:
        record[NOW] = told(int.from_bytes(record[NOW], "little")).to_bytes(8, "little")
        return sealed_record(record)

    mangle_acks(patch, mangle)


@mutant("ACK-002")
def now_is_in_periods(patch: Patch) -> None:
    """The field `now` counts periods, as everything else in a block does."""
    _tell_now_as(patch, lambda now: now // TICKS_PER_PERIOD)


@mutant("ACK-002")
def now_is_that_of_the_millisecond(patch: Patch) -> None:
    """The field `now` stands still for a millisecond: it is taken from a timer that interrupts so often."""
    _tell_now_as(patch, lambda now: now - now % TICKS_PER_MS)


@mutant("ACK-002", "VER-002", by=mangle_acks)
def acks_are_of_version_2(record: bytearray) -> bytes:
    """Acknowledgements name version 2, the newest that their author thought of."""
    record[VERSION] = 2
    return sealed_record(record)


@mutant("ACK-002")
def ack_checksum_covers_27_bytes(patch: Patch) -> None:
    """The checksum of an acknowledgement leaves out the reserved byte, which was added last."""
    mangle_acks(patch, lambda record: record[:28] + zlib.crc32(record[:27]).to_bytes(4, "little"))


@mutant("ACK-002", by=mangle_acks)
def reserved_byte_of_an_ack_is_not_cleared(record: bytearray) -> bytes:
    """The reserved byte of an acknowledgement is what the memory held before: the number's lowest byte."""
    record[RESERVED] = record[4]
    return sealed_record(record)


@mutant("ACK-002", "BLK-024")
def free_is_counted_before_the_change(patch: Patch) -> None:
    """The acknowledgement of a change says one free place too many: it is counted before the change has its own."""
    taken: list[bool] = [False]

    @patch.around(controller.Controller, "_carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        change = original(self, body, door)
        taken[0] = change is not None
        return change

    @patch.around(controller.Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
        taken[0] = False
        original(self, packet, door, *rest)

    @patch.around(controller.Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        return replace(said, free=said.free + taken[0])

    one_by_one(patch)


@mutant("ACK-002")
def state_is_that_after_the_change(patch: Patch) -> None:
    """The state in an acknowledgement is the one that the change will lead to, not that of when it was judged."""
    leads_to: list[State | None] = [None]

    @patch.around(controller.Controller, "_carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        leads_to[0] = _state_after(body)
        return original(self, body, door)

    @patch.around(controller.Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        state, leads_to[0] = leads_to[0], None
        return said if state is None or said.reason else replace(said, state=state)

    one_by_one(patch)


def _state_after(body: Any) -> State | None:
    match body:
        case Update():
            return State.PLAYING
        case Sequence():
            return State.UNATTENDED if body.unattended else State.PLAYING
        case Output(action=Action.SILENCE):
            return State.READY
        case Output(action=Action.DISABLE):
            return State.OFF
    return None


@mutant("ACK-002")
def refused_change_says_the_period_that_it_named(patch: Patch) -> None:
    """The acknowledgement of a refused block repeats its period: the field is filled in before the judgement."""
    named = [0]

    @patch.around(controller.Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
        named[0] = int.from_bytes(packet[8:16], "little")
        original(self, packet, door, *rest)

    @patch.around(controller.Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        return replace(said, commit_period=named[0]) if said.reason else said


@mutant("ACK-002", "BLK-005")
def late_change_says_the_period_that_it_named(patch: Patch) -> None:
    """The acknowledgement of a late change has the flag, and the period that it named instead of the one it gets."""
    named = [0]

    @patch.around(controller.Controller, "_carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        change = original(self, body, door)
        named[0] = getattr(body, "period", 0)
        return change

    @patch.around(controller.Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        return replace(said, commit_period=named[0]) if said.late else said

    one_by_one(patch)


@mutant("BLK-019", "ACK-002")
def clock_says_no_period(patch: Patch) -> None:
    """The acknowledgement of a CLOCK says period 0: it is filled in for changes alone."""
    patch.replace(controller, "Clock", type("NoBody", (), {}))


@mutant("BLK-019", "ACK-002", wraps=(controller.Controller, "accept"))
def clock_says_its_own_period(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
    """The acknowledgement of a CLOCK says the period in which it arrived, not that of the last sync pulse."""
    own = self.time.period(self._now)
    vars(self)["clock"] = lambda: ClockReading(self.now_tick, own, 0)
    try:
        original(self, packet, door, *rest)
    finally:
        del vars(self)["clock"]


@mutant("ACK-001", wraps=(ArrayFunction, "acknowledge"))
def refusals_overtake(original: Any, self: Any, record: bytes) -> None:
    """On USB a refusal is sent before the acknowledgements that wait: it comes from the thread that receives."""
    if record[REASON]:
        self._records.appendleft(record)
    else:
        original(self, record)


class _Mute:
    """A door that lets no acknowledgement out."""

    def __init__(self, door: Any) -> None:
        self.notify = door.notify

    def acknowledge(self, record: bytes) -> None:
        """Drop it."""


@mutant("ACK-001", wraps=(controller.Controller, "accept"))
def no_ops_are_not_acknowledged(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
    """A NO_OP gets no acknowledgement: nothing was done, so that nothing seems to need one."""
    is_no_op = len(packet) > KIND and packet[KIND] == Kind.NO_OP
    original(self, packet, _Mute(door) if is_no_op else door, *rest)


@mutant("ACK-005")
def lone_ack_waits_for_company(patch: Patch) -> None:
    """On USB a single record waits up to 50 ms for another one: packets were to be filled."""

    @patch.around(ArrayFunction, "acknowledge")
    def acknowledge(original: Any, self: Any, record: bytes) -> None:
        due = self._scheduler.now + COMPANY_CYCLES
        vars(self)["company_due"] = due
        self._scheduler.at(due, lambda: None)
        original(self, record)

    @patch.around(ArrayFunction, "_take_records")
    def take(original: Any, self: Any, room: int) -> bytes:
        is_alone = len(self._records) == 1 and self._records[0] is not self._unasked
        if is_alone and self._scheduler.now < vars(self)["company_due"]:
            return b""
        taken: bytes = original(self, room)
        return taken


@mutant("ACK-005", "USB-019", wraps=(ArrayFunction, "_take_records"), url="emulator:?speed=full")
def records_are_cut_at_the_end_of_a_packet(original: Any, self: Any, room: int) -> bytes:
    """On USB a status record is split over two packets where it does not fit: bytes are sent as from a stream."""
    packet: bytes = original(self, room)
    if self._records and len(packet) < room:
        cut, whole = room - len(packet), self._records.popleft()
        if whole is self._unasked:
            self._unasked = b""
        packet += whole[:cut]
        self._records.appendleft(whole[cut:])
    return packet


@mutant("ACK-006", wraps=(ArrayFunction, "notify"))
def unasked_status_overtakes(original: Any, self: Any, record: bytes) -> None:
    """On USB a status record of the device's own accord is sent before the acknowledgements that wait."""
    original(self, record)
    self._records.rotate(1)


@mutant("ACK-006", wraps=(ArrayFunction, "notify"))
def unasked_statuses_pile_up(original: Any, self: Any, record: bytes) -> None:
    """On USB each change of the state leaves a status record of its own, however many wait already."""
    self._unasked = b""
    original(self, record)


def _speak_later(patch: Patch, milliseconds: int, hears: Callable[[Door, Door | None], bool]) -> None:
    """Let a record that nobody asked for go to some doors later, given each and the one that changed the state."""

    @patch.around(controller.Controller, "_speak")
    def speak(_: Any, self: Any, besides: Door | None = None) -> None:
        status = self.status().encode()

        def tell(later: bool) -> None:
            for door in self._doors:
                if later is hears(door, besides) and (later or door is not besides):
                    door.notify(status)

        tell(False)
        self._scheduler.at(self._now + milliseconds * CYCLES_PER_MS, lambda: tell(True))


@mutant("ACK-006")
def what_nobody_asked_for_is_told_50_ms_late(patch: Patch) -> None:
    """Status records of the device's own accord come 50 ms late: a task of low priority sends them."""
    _speak_later(patch, 50, lambda door, besides: door is not besides)


@mutant("ACK-006", "SER-016")
def the_door_that_changed_the_state_is_told_too(patch: Patch) -> None:
    """What came through a door is told unasked at that door as well, 15 ms later: every door polls the state."""
    _speak_later(patch, 15, lambda door, besides: door is besides)


@mutant("ACK-006", "STA-002")
def serial_lines_are_told_nothing_unasked(patch: Patch) -> None:
    """Status records of the device's own accord go out over USB alone: serial lines were an afterthought."""
    patch.replace(SerialLine, "notify", lambda _self, _record: None)


def _keep_quiet(patch: Patch, handler: str) -> None:
    """Let other doors be told nothing of what a block does when it takes effect."""

    @patch.around(controller.Controller, handler)
    def take_effect(original: Any, self: Any, *arguments: Any) -> None:
        vars(self)["_speak"] = lambda *_, **_besides: None
        try:
            original(self, *arguments)
        finally:
            del vars(self)["_speak"]


@mutant("ACK-006", "SER-016", "BLK-018")
def other_doors_are_not_told_of_a_block_that_disables(patch: Patch) -> None:
    """After an OUTPUT block with DISABLE the other doors get no status record: only the request DISABLE sends them."""
    _keep_quiet(patch, "_disable_as_planned")


@mutant("ACK-006", "SER-016", "BLK-018")
def other_doors_are_not_told_of_a_block_that_silences(patch: Patch) -> None:
    """After an OUTPUT block with SILENCE the other doors get no status record, and believe that it plays."""
    _keep_quiet(patch, "_fall_silent")


@mutant("ACK-006", "SER-016")
def other_doors_are_not_told_of_sequences(patch: Patch) -> None:
    """When a sequence begins the other doors get no status record: an UPDATE alone sends them."""
    _keep_quiet(patch, "_begin_sequence")


@mutant("ACK-006", wraps=(controller.Controller, "_happen"))
def states_are_told_only_when_asked_for(original: Any, self: Any, *arguments: Any, **more: Any) -> None:
    """No status record comes when the state changes, be it by the watchdog: faults alone are told unasked."""
    vars(self)["_speak"] = lambda *_, **_besides: None
    try:
        original(self, *arguments, **more)
    finally:
        vars(self).pop("_speak", None)


@mutant("STA-001", "ACK-002", wraps=(controller.Controller, "_fall_silent"))
def silence_counts_as_playing(original: Any, self: Any, door: Any, period: int) -> None:
    """Behind a SILENCE the device says PLAYING: the state is left as it was until the outputs are disabled."""
    state = self._state
    original(self, door, period)
    if state in ENABLED:
        self._state = state
