"""Broken flow: places in the queue, NAK, the rate of a stream, and what gets lost where much waits (chapter BLK)."""

from __future__ import annotations

from typing import Any

from ..emulator.control import agenda, controller
from ..emulator.door import Handshake
from ..emulator.interfaces.serial_line import SerialLine
from ..emulator.interfaces.usb_functions import ArrayFunction
from ..protocol.blocks import Update
from ..protocol.board import CYCLES_PER_PERIOD
from ..protocol.codes import BLOCK_BYTES, Kind
from .patching import Patch, mutant
from .seams import one_by_one

RECORDS_KEPT, STORES_KEPT = 16, 4
LEAK_EVERY, LEAK_AT_MOST = 100, 8
KIND = 3


def _count_free_as(patch: Patch, counted: Any) -> None:
    patch.wrap(controller.Controller, "_free", lambda original: lambda self: max(counted(self, original(self)), 0))


@mutant("BLK-024", "REQ-002")
def queue_is_one_smaller_than_info_says(patch: Patch) -> None:
    """One change fewer than INFO says can be queued: a ring buffer keeps one place empty to tell full from empty."""
    patch.replace(agenda, "QUEUE_BLOCKS", agenda.QUEUE_BLOCKS - 1)
    _count_free_as(patch, lambda _, free: free - 1)


@mutant("BLK-009", "BLK-008")
def full_queue_overwrites_its_oldest(patch: Patch) -> None:
    """A block is never answered with NAK: where the queue is full, the oldest change in it gives way unheard."""

    def can_accept(_: Any) -> Any:
        return lambda self: self._loading.blocks < controller.STORES

    @patch.around(controller.Controller, "_plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        if self._agenda.room_at > self._now:
            oldest = next((change for change in self._agenda if change.start > self._now), None)
            if oldest is not None:
                oldest.packed, oldest.programs, oldest.effect = None, (), None
        return original(self, *arguments, **more)

    patch.wrap(controller.Controller, "can_accept", can_accept)
    one_by_one(patch)


@mutant("BLK-009", "BLK-008")
def full_queue_drops_what_comes(patch: Patch) -> None:
    """A change for which there is no room is acknowledged and dropped, where NAK should hold it back."""

    def can_accept(_: Any) -> Any:
        return lambda self: self._loading.blocks < controller.STORES

    @patch.around(controller.Controller, "_plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        is_full = self._agenda.room_at > self._now
        change = original(self, *arguments, **more)
        if is_full:
            change.packed, change.programs, change.effect = None, (), None
        return change

    patch.wrap(controller.Controller, "can_accept", can_accept)
    one_by_one(patch)


@mutant("BLK-009")
def blocks_that_need_no_place_pass_a_full_queue(patch: Patch) -> None:
    """While the queue is full CLOCK and NO_OP are taken all the same: the kind is looked at before NAK is sent."""

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
    """A store takes a place until it has gone onto the chain: one queue serves stores and changes."""
    _count_free_as(patch, lambda self, free: free - self._loading.blocks)

    @patch.around(controller.Controller, "can_accept")
    def can_accept(original: Any, self: Any) -> bool:
        queued = self._agenda.queued(self._now) + self._loading.blocks
        return bool(original(self)) and queued < controller.QUEUE_BLOCKS


@mutant("BLK-024")
def clock_and_no_op_need_a_free_place(patch: Patch) -> None:
    """The acknowledgements of CLOCK and NO_OP say one free place too few: whatever is judged has one."""

    @patch.around(controller.Controller, "accept")
    def accept(original: Any, self: Any, packet: bytes, door: Any, *rest: Any) -> None:
        vars(self)["kind"] = packet[KIND] if len(packet) > KIND else 0
        original(self, packet, door, *rest)
        del vars(self)["kind"]

    _count_free_as(patch, lambda self, free: free - (vars(self).get("kind") in (Kind.CLOCK, Kind.NO_OP)))


@mutant("BLK-024", "SAF-004", wraps=(agenda.Agenda, "drop_queued"))
def places_come_back_after_the_period_alone(original: Any, self: Any, now: int) -> None:
    """DISABLE drops what is queued, and its places stay taken for up to 100 ms: they come back one by one."""
    taken = self.recent.copy()
    original(self, now)
    self.recent[:] = taken.clip(max=now + 4000 * CYCLES_PER_PERIOD)


@mutant("BLK-023", url="emulator:?link=2wire")
def rate_is_never_refused(patch: Patch) -> None:
    """Updates that name periods closer than the chain can carry are accepted, and come late one by one."""
    _judge_rates(patch, lambda _update, _last: None)


@mutant("BLK-023", wraps=(controller.Controller, "_enable"), url="emulator:?link=2wire")
def rate_is_refused_across_enable(original: Any, self: Any, door: Any) -> None:
    """The last named period is remembered when the outputs are enabled again: an update close behind it is refused."""
    last = self._last_named
    original(self, door)
    self._last_named = last


@mutant("BLK-023", url="emulator:?link=2wire")
def rate_is_refused_for_earlier_periods_too(patch: Patch) -> None:
    """An update for the same period as the last is refused with RATE, where it should be late."""
    _judge_rates(patch, lambda update, last: last - 1 if update.period == last else last)
    one_by_one(patch)


def _judge_rates(patch: Patch, taken_for_last: Any) -> None:
    """Judge updates as if another period had been named last."""

    @patch.around(controller.Controller, "_judge_content")
    def judge(original: Any, self: Any, body: Any) -> None:
        last = self._last_named
        if isinstance(body, Update) and last is not None:
            self._last_named = taken_for_last(body, last)
        try:
            original(self, body)
        finally:
            self._last_named = last


@mutant("ACK-001", "REQ-002", wraps=(ArrayFunction, "acknowledge"))
def records_behind_the_sixteenth_are_dropped(original: Any, self: Any, record: bytes) -> None:
    """On USB no more than 16 records wait, though INFO says more, and blocks are taken all the same."""
    if len(self._records) < RECORDS_KEPT:
        original(self, record)


@mutant("ACK-001")
def nothing_waits_for_room_for_records(patch: Patch) -> None:
    """On USB blocks are taken while as many records wait as there is room for, and the newest take no more of it."""

    @patch.around(ArrayFunction, "acknowledge")
    def acknowledge(original: Any, self: Any, record: bytes) -> None:
        if len(self._records) < controller.RECORDS:
            original(self, record)

    patch.wrap(ArrayFunction, "_room_for_records", lambda _: lambda _self: controller.RECORDS)


@mutant("BLK-024")
def places_leak(patch: Patch) -> None:
    """Every hundredth change never gives its place back, up to eight of them: one way out of the queue forgets it."""

    def leaked(self: Any) -> int:
        return int(min(vars(self).get("planned", 0) // LEAK_EVERY, LEAK_AT_MOST))

    @patch.around(controller.Controller, "_plan")
    def plan(original: Any, self: Any, *arguments: Any, **more: Any) -> Any:
        vars(self)["planned"] = vars(self).get("planned", 0) + 1
        return original(self, *arguments, **more)

    @patch.around(controller.Controller, "can_accept")
    def can_accept(original: Any, self: Any) -> bool:
        room = controller.QUEUE_BLOCKS - leaked(self)
        return bool(original(self)) and self._agenda.queued(self._now) < room

    @patch.around(controller.Controller, "await_room")
    def await_room(original: Any, self: Any, waiter: Any) -> None:
        original(self, waiter)
        for start in self._agenda.recent.tolist():
            if start > self._now:
                self._scheduler.at(start, self._announce_room)

    _count_free_as(patch, lambda self, free: free - leaked(self))
    one_by_one(patch)


@mutant("BLK-024", "BLK-013", wraps=(controller.Controller, "_store"))
def stores_in_a_hurry_are_lost(original: Any, self: Any, body: Any) -> None:
    """A store that comes while four wait is acknowledged, and never reaches the processors: they share a buffer."""
    if self._loading.blocks < STORES_KEPT:
        original(self, body)
    else:
        self._stores.keep(body)


@mutant("BLK-007")
def programs_do_not_wait_for_stores(patch: Patch) -> None:
    """A SEQUENCE or a MODULATION begins although stores before it wait: it plays what was there before them."""
    patch.replace(agenda.Agenda, "loads_gone", lambda _self, begin, _loads: begin)
