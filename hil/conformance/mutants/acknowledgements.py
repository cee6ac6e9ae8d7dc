"""Broken acknowledgements: what they say, when they come, and in which order (chapter ACK)."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ....emulator.control import controller
from ....emulator.control.controller import Controller
from ....emulator.control.execution import Execution
from ....emulator.control.state_machine import StateMachine
from ....emulator.door import Door
from ....emulator.interfaces.serial_line import SerialLine
from ....emulator.interfaces.usb_functions import ArrayFunction
from ....protocol.blocks import Output, PlaySequence, Update
from ....protocol.board import CYCLES_PER_MS, TICKS_PER_PERIOD
from ....protocol.codes import Action, Kind, State
from ....protocol.replies import ENABLED, Ack, ClockReading
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
    """The field `now` stands still for a millisecond at a time: it is copied from a timer interrupt at 1 kHz."""
    _tell_now_as(patch, lambda now: now - now % TICKS_PER_MS)


@mutant("ACK-002", "TIM-002", also=one_by_one, wraps=(ArrayFunction, "_take"))
def a_block_that_is_held_up_is_stamped_late(original: Any, self: Any, packet: bytes) -> Any:
    """A block by USB is judged a millisecond after it came, by another task, and `now` is the tick of that."""
    controller = self._controller

    def accept(block: bytes, door: Door) -> None:
        self._scheduler.at(self._scheduler.now + CYCLES_PER_MS, lambda: Controller.accept(controller, block, door))

    vars(controller)["accept"] = accept
    answer = original(self, packet)
    del vars(controller)["accept"]
    return answer


@mutant("ACK-002", "VER-002", by=mangle_acks)
def acks_are_of_version_2(record: bytearray) -> bytes:
    """Acknowledgements name version 2: the author wrote the newest version."""
    record[VERSION] = 2
    return sealed_record(record)


@mutant("ACK-002")
def ack_checksum_covers_27_bytes(patch: Patch) -> None:
    """The checksum of an acknowledgement leaves out the reserved byte, which was added last."""
    mangle_acks(patch, lambda record: record[:28] + zlib.crc32(record[:27]).to_bytes(4, "little"))


@mutant("ACK-002", by=mangle_acks)
def reserved_byte_of_an_ack_is_not_cleared(record: bytearray) -> bytes:
    """The reserved byte of an acknowledgement holds old memory: the lowest byte of the number."""
    record[RESERVED] = record[4]
    return sealed_record(record)


@mutant("ACK-002", "BLK-024")
def free_is_counted_before_the_change(patch: Patch) -> None:
    """The acknowledgement of a change reports one free place too many: it counts before the change takes its place."""
    taken: list[bool] = [False]

    @patch.around(Execution, "carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        change = original(self, body, door)
        taken[0] = change is not None
        return change

    @patch.around(Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
        taken[0] = False
        original(self, packet, door, *rest)

    @patch.around(Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        return replace(said, free=said.free + taken[0])

    one_by_one(patch)


@mutant("ACK-002")
def state_is_that_after_the_change(patch: Patch) -> None:
    """The acknowledgement holds the state after the change takes effect, not that in which the block was judged."""
    leads_to: list[State | None] = [None]

    @patch.around(Execution, "carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        leads_to[0] = _state_after(body)
        return original(self, body, door)

    @patch.around(Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        state, leads_to[0] = leads_to[0], None
        return said if state is None or said.reason else replace(said, state=state)

    one_by_one(patch)


def _state_after(body: Any) -> State | None:
    match body:
        case Update():
            return State.PLAYING
        case PlaySequence():
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

    @patch.around(Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
        named[0] = int.from_bytes(packet[8:16], "little")
        original(self, packet, door, *rest)

    @patch.around(Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        return replace(said, commit_period=named[0]) if said.reason else said


@mutant("ACK-002", "BLK-005")
def late_change_says_the_period_that_it_named(patch: Patch) -> None:
    """The acknowledgement of a late change has the flag, but names the requested period instead of the actual one."""
    named = [0]

    @patch.around(Execution, "carry_out")
    def carry_out(original: Any, self: Any, body: Any, door: Any) -> Any:
        change = original(self, body, door)
        named[0] = getattr(body, "period", 0)
        return change

    @patch.around(Controller, "_ack")
    def ack(original: Any, self: Any, *arguments: Any) -> Ack:
        said: Ack = original(self, *arguments)
        return replace(said, commit_period=named[0]) if said.late else said

    one_by_one(patch)


@mutant("BLK-019", "ACK-002")
def clock_says_no_period(patch: Patch) -> None:
    """The acknowledgement of a CLOCK names period 0: only changes fill the field in."""
    patch.replace(controller, "Clock", type("NoBody", (), {}))


@mutant("BLK-019", "ACK-002", wraps=(Controller, "accept"))
def clock_says_its_own_period(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
    """The acknowledgement of a CLOCK names the period of its arrival, not that of the last sync pulse."""
    own = self.time.period(self._dispatch.now)
    vars(self._requests)["clock"] = lambda: ClockReading(self._dispatch.now_tick, own, 0)
    try:
        original(self, packet, door, *rest)
    finally:
        del vars(self._requests)["clock"]


@mutant("ACK-001", wraps=(ArrayFunction, "acknowledge"))
def refusals_overtake(original: Any, self: Any, record: bytes) -> None:
    """On USB a refusal overtakes the acknowledgements that wait: the receiving thread sends it."""
    if record[REASON]:
        self._records.appendleft(record)
    else:
        original(self, record)


class _Mute:
    """A door that sends no acknowledgement."""

    def __init__(self, door: Any) -> None:
        self.notify = door.notify

    def acknowledge(self, record: bytes) -> None:
        """Drop it."""


@mutant("ACK-001", wraps=(Controller, "accept"))
def no_ops_are_not_acknowledged(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
    """A NO_OP gets no acknowledgement: the device did nothing, so it confirms nothing."""
    is_no_op = len(packet) > KIND and packet[KIND] == Kind.NO_OP
    original(self, packet, _Mute(door) if is_no_op else door, *rest)


@mutant("ACK-005")
def lone_ack_waits_for_company(patch: Patch) -> None:
    """On USB a single record waits up to 50 ms for another one: the firmware tries to fill packets."""

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
    """On USB a status record that does not fit is split over two packets: the endpoint is treated as a byte stream."""
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
    """On USB an unsolicited status record overtakes the acknowledgements that wait."""
    original(self, record)
    self._records.rotate(1)


@mutant("ACK-006", wraps=(ArrayFunction, "notify"))
def unasked_statuses_pile_up(original: Any, self: Any, record: bytes) -> None:
    """On USB each change of state queues a status record of its own, although older ones still wait."""
    self._unasked = b""
    original(self, record)


def _speak_later(patch: Patch, milliseconds: int, hears: Callable[[Door, Door | None], bool]) -> None:
    """Delay unsolicited records at some doors. The function is given each door and the one that changed the state."""

    @patch.around(StateMachine, "send_status")
    def send_status(_: Any, self: Any, except_to: Door | None = None) -> None:
        status = self._status().encode()

        def tell(later: bool) -> None:
            for door in self._doors:
                if later is hears(door, except_to) and (later or door is not except_to):
                    door.notify(status)

        tell(False)
        self._dispatch.scheduler.at(self._dispatch.now + milliseconds * CYCLES_PER_MS, lambda: tell(True))


@mutant("ACK-006")
def what_nobody_asked_for_is_told_50_ms_late(patch: Patch) -> None:
    """Unsolicited status records come 50 ms late: a task of low priority sends them."""
    _speak_later(patch, 50, lambda door, except_to: door is not except_to)


@mutant("ACK-006", "SER-016")
def the_door_that_changed_the_state_is_told_too(patch: Patch) -> None:
    """A door gets a status record 15 ms after a change that came through itself: every door polls the state."""
    _speak_later(patch, 15, lambda door, except_to: door is except_to)


@mutant("ACK-006", "STA-002")
def serial_lines_are_told_nothing_unasked(patch: Patch) -> None:
    """Unsolicited status records go out over USB alone: serial lines were an afterthought."""
    patch.replace(SerialLine, "notify", lambda _self, _record: None)


def _keep_quiet(patch: Patch, handler: str) -> None:
    """Keep other doors from learning what a block does when it takes effect."""

    @patch.around(Execution, handler)
    def take_effect(original: Any, self: Any, *arguments: Any) -> None:
        vars(self._machine)["send_status"] = lambda *_, **_except: None
        try:
            original(self, *arguments)
        finally:
            del vars(self._machine)["send_status"]


@mutant("ACK-006", "SER-016", "BLK-018")
def other_doors_are_not_told_of_a_block_that_disables(patch: Patch) -> None:
    """After an OUTPUT block with DISABLE the other doors get no status record: only the request DISABLE sends them."""
    _keep_quiet(patch, "_disable_as_planned")


@mutant("ACK-006", "SER-016", "BLK-018")
def other_doors_are_not_told_of_a_block_that_silences(patch: Patch) -> None:
    """After an OUTPUT block with SILENCE the other doors get no status record and still believe that it plays."""
    _keep_quiet(patch, "_fall_silent")


@mutant("ACK-006", "SER-016")
def other_doors_are_not_told_of_sequences(patch: Patch) -> None:
    """When a sequence begins the other doors get no status record: an UPDATE alone sends them."""
    _keep_quiet(patch, "_begin_sequence")


@mutant("ACK-006", wraps=(StateMachine, "happen"))
def states_are_told_only_when_asked_for(original: Any, self: Any, *arguments: Any, **more: Any) -> None:
    """No status record comes when the state changes, not even for the watchdog: only faults send one."""
    vars(self)["send_status"] = lambda *_, **_except: None
    try:
        original(self, *arguments, **more)
    finally:
        vars(self).pop("send_status", None)


@mutant("STA-001", "ACK-002", wraps=(Execution, "_fall_silent"))
def silence_counts_as_playing(original: Any, self: Any, door: Any, period: int) -> None:
    """After a SILENCE the device reports PLAYING: the state stays until the outputs are disabled."""
    state = self._device.state
    original(self, door, period)
    if state in ENABLED:
        self._device.state = state
