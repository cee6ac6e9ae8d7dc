"""Broken flow control: places in the queue, NAK, the rate of a stream, and losses under load (chapter BLK)."""

from __future__ import annotations

from typing import Any

from ....emulator.control import agenda, dispatch, requests
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.dispatch import Dispatch
from ....emulator.control.execution import Execution
from ....emulator.control.requests import Requests
from ....emulator.door import Handshake
from ....emulator.interfaces.serial_line import SerialLine
from ....emulator.interfaces.usb_functions import ArrayFunction
from ....protocol.blocks import Update
from ....protocol.board import CYCLES_PER_PERIOD
from ....protocol.codes import BLOCK_BYTES, Kind
from .patching import Patch, mutant
from .seams import one_by_one

RECORDS_KEPT, STORES_KEPT = 16, 4
LEAK_EVERY, LEAK_AT_MOST = 100, 8
KIND = 3


def _count_free_as(patch: Patch, counted: Any) -> None:
    patch.wrap(Dispatch, "free", lambda original: lambda self: max(counted(self, original(self)), 0))


@mutant("BLK-024", "REQ-002")
def queue_is_one_smaller_than_info_says(patch: Patch) -> None:
    """The queue holds one change fewer than INFO says: a ring buffer keeps one place empty."""
    patch.replace(agenda, "QUEUE_BLOCKS", agenda.QUEUE_BLOCKS - 1)
    _count_free_as(patch, lambda _, free: free - 1)


@mutant("BLK-009", "BLK-008")
def full_queue_overwrites_its_oldest(patch: Patch) -> None:
    """A block never gets NAK: if the queue is full, its oldest change is dropped silently."""

    def can_accept(_: Any) -> Any:
        return lambda self: self.loading.blocks < dispatch.STORES

    @patch.around(Dispatch, "plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        if self.agenda.room_at > self.now:
            oldest = next((change for change in self.agenda if change.start > self.now), None)
            if oldest is not None:
                oldest.packed, oldest.programs, oldest.effect = None, (), None
        return original(self, *arguments, **more)

    patch.wrap(Dispatch, "has_room", can_accept)
    one_by_one(patch)


@mutant("BLK-009", "BLK-008")
def full_queue_drops_what_comes(patch: Patch) -> None:
    """A change without room is acknowledged and dropped; NAK should hold it back."""

    def can_accept(_: Any) -> Any:
        return lambda self: self.loading.blocks < dispatch.STORES

    @patch.around(Dispatch, "plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        is_full = self.agenda.room_at > self.now
        change = original(self, *arguments, **more)
        if is_full:
            change.packed, change.programs, change.effect = None, (), None
        return change

    patch.wrap(Dispatch, "has_room", can_accept)
    one_by_one(patch)


@mutant("BLK-009")
def blocks_that_need_no_place_pass_a_full_queue(patch: Patch) -> None:
    """While the queue is full CLOCK and NO_OP are accepted: the kind is checked before NAK is sent."""

    @patch.around(ArrayFunction, "_take")
    def take(original: Any, self: Any, packet: bytes) -> Any:
        handshake = original(self, packet)
        needs_none = len(packet) == BLOCK_BYTES and packet[KIND] in (Kind.CLOCK, Kind.NO_OP)
        if handshake is Handshake.ACK or not needs_none or self._part:
            return handshake
        self._controller.accept(bytes(packet), self)
        return Handshake.ACK

    @patch.around(SerialLine, "_admit")
    def admit(original: Any, self: Any, block: bytes) -> None:
        needs_none = len(block) == BLOCK_BYTES and block[KIND] in (Kind.CLOCK, Kind.NO_OP)
        if needs_none and not self._waiting:
            self._controller.accept(block, self)
        else:
            original(self, block)


@mutant("BLK-024")
def stores_take_places_in_the_queue(patch: Patch) -> None:
    """A store occupies a place until it is on the chain: stores and changes share one queue."""
    _count_free_as(patch, lambda self, free: free - self.loading.blocks)

    @patch.around(Dispatch, "has_room")
    def can_accept(original: Any, self: Any) -> bool:
        queued = self.agenda.queued(self.now) + self.loading.blocks
        return bool(original(self)) and queued < agenda.QUEUE_BLOCKS


@mutant("BLK-024")
def clock_and_no_op_need_a_free_place(patch: Patch) -> None:
    """The acknowledgements of CLOCK and NO_OP report one free place too few: every block under judgement holds one."""

    @patch.around(Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
        vars(self._dispatch)["kind"] = packet[KIND] if len(packet) > KIND else 0
        original(self, packet, door, *rest)
        del vars(self._dispatch)["kind"]

    _count_free_as(patch, lambda self, free: free - (vars(self).get("kind") in (Kind.CLOCK, Kind.NO_OP)))


@mutant("BLK-024", "SAF-004", wraps=(agenda.Agenda, "drop_queued"))
def places_come_back_after_the_period_alone(original: Any, self: Any, now: int) -> None:
    """DISABLE drops the queue, but its places stay taken for up to 100 ms: they return one by one."""
    taken = self.recent.copy()
    original(self, now)
    self.recent[:] = taken.clip(max=now + 4000 * CYCLES_PER_PERIOD)


@mutant("BLK-023", url="emulator:?link=2wire")
def rate_is_never_refused(patch: Patch) -> None:
    """Updates for periods that are too close for the chain are accepted and become late."""
    _judge_rates(patch, lambda _update, _last: None)


@mutant("BLK-023", wraps=(Requests, "_enable"), url="emulator:?link=2wire")
def rate_is_refused_across_enable(original: Any, self: Any, door: Any) -> None:
    """The last named period survives ENABLE: an update shortly after it is refused."""
    last = self._device.last_named
    original(self, door)
    self._device.last_named = last


@mutant("BLK-023", url="emulator:?link=2wire")
def rate_is_refused_for_earlier_periods_too(patch: Patch) -> None:
    """An update for the same period as the last is refused with RATE; it should be late."""
    _judge_rates(patch, lambda update, last: last - 1 if update.period == last else last)
    one_by_one(patch)


def _judge_rates(patch: Patch, taken_for_last: Any) -> None:
    """Judge updates as if the last one had named another period."""

    @patch.around(Admission, "_judge_numbers")
    def judge(original: Any, self: Any, block: Any, arrived: int) -> None:
        last = self._device.last_named
        if isinstance(block.body, Update) and last is not None:
            self._device.last_named = taken_for_last(block.body, last)
        try:
            original(self, block, arrived)
        finally:
            self._device.last_named = last


@mutant("ACK-001", "REQ-002", wraps=(ArrayFunction, "acknowledge"))
def records_behind_the_sixteenth_are_dropped(original: Any, self: Any, record: bytes) -> None:
    """On USB only 16 records may wait, although INFO says more, and blocks are still accepted."""
    if len(self._records) < RECORDS_KEPT:
        original(self, record)


@mutant("ACK-001")
def nothing_waits_for_room_for_records(patch: Patch) -> None:
    """On USB blocks are accepted while the record buffer is full, and the newest records are lost."""

    @patch.around(ArrayFunction, "acknowledge")
    def acknowledge(original: Any, self: Any, record: bytes) -> None:
        if len(self._records) < requests.QUEUE_RECORDS:
            original(self, record)

    patch.wrap(ArrayFunction, "_room_for_records", lambda _: lambda _self: requests.QUEUE_RECORDS)


@mutant("BLK-024")
def places_leak(patch: Patch) -> None:
    """Every hundredth change never returns its place, up to eight in all: one exit path forgets it."""

    def leaked(self: Any) -> int:
        return int(min(vars(self).get("planned", 0) // LEAK_EVERY, LEAK_AT_MOST))

    @patch.around(Dispatch, "plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        vars(self)["planned"] = vars(self).get("planned", 0) + 1
        return original(self, *arguments, **more)

    @patch.around(Dispatch, "has_room")
    def can_accept(original: Any, self: Any) -> bool:
        room = agenda.QUEUE_BLOCKS - leaked(self)
        return bool(original(self)) and self.agenda.queued(self.now) < room

    @patch.around(Dispatch, "await_room")
    def await_room(original: Any, self: Any, waiter: Any) -> None:
        original(self, waiter)
        for start in self.agenda.recent.tolist():
            if start > self.now:
                self.scheduler.at(start, self.announce_room)

    _count_free_as(patch, lambda self, free: free - leaked(self))
    one_by_one(patch)


@mutant("BLK-024", "BLK-013", wraps=(Execution, "_store"))
def stores_in_a_hurry_are_lost(original: Any, self: Any, body: Any) -> None:
    """A store that arrives while four wait is acknowledged and lost: they share a buffer."""
    if self._dispatch.loading.blocks < STORES_KEPT:
        original(self, body)
    else:
        self._dispatch.stores.keep(body)


@mutant("BLK-007")
def programs_do_not_wait_for_stores(patch: Patch) -> None:
    """A SEQUENCE or MODULATION begins although stores before it still wait: it plays the old contents."""
    patch.replace(agenda.Agenda, "loads_gone", lambda _self, begin, _loads: begin)
