"""A controller for serial lines: it judges and answers by the oracle of the specification, and plays nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from phasewire.base.errors import BlockError
from phasewire.emulator.door import Door, Stall
from phasewire.protocol.codes import Reason, Request, State
from phasewire.protocol.requests import Setup

from tests.from_spec import CLOCK, NO_OP, UPDATE, build_ack, build_block, build_status, judge_block, pack_pulses

VECTORS = json.loads((Path(__file__).parents[2] / "protocol" / "vectors.json").read_text(encoding="utf-8"))
ANSWERS = {case["name"]: bytes.fromhex(case["hex"]) for case in VECTORS["answers"]["vectors"]}
ENABLED = (State.READY, State.PLAYING, State.UNATTENDED)


def no_op(sequence: int) -> bytes:
    return build_block({"kind": NO_OP, "sequence": sequence})


def update(sequence: int) -> bytes:
    return build_block({"kind": UPDATE, "sequence": sequence})


class Nowhere(Door):
    """A door without a host."""

    def acknowledge(self, record: bytes) -> None:
        """Does nothing."""

    def notify(self, record: bytes) -> None:
        """Does nothing."""


class ModelController:
    """The part of the controller that lines use; it records their calls.

    `room` is how many changes the queue can take; `status` are fields of the status record that differ from 0.
    """

    def __init__(self, room: int = 4) -> None:
        self.state = State.OFF
        self.room = room
        self.now_tick = 0
        self.dropped_frames = 0
        self.room_waiters: list[Callable[[], None]] = []
        self.doors: list[Door] = []
        self.accepted: list[bytes] = []
        self.asked: list[Setup] = []
        self.tested: int | None = None
        self.arrivals = 0
        self.status: dict[str, int] = {}
        self.processors = ANSWERS["processors"]

    @property
    def can_accept(self) -> bool:
        return self.room > 0

    def attach(self, door: Door) -> None:
        self.doors.append(door)

    def accept(self, packet: bytes, door: Door, arrived: int | None = None) -> None:
        reason = judge_block(packet)
        is_change = packet[3] not in (CLOCK, NO_OP)
        if reason == 0 and is_change and self.state not in ENABLED:
            reason = Reason.DISABLED
        self.accepted.append(packet)
        self.room -= reason == 0 and is_change
        sequence = int.from_bytes(packet[4:8], "little")
        fields = {"version": 1, "reason": reason, "sequence": sequence, "free": self.room, "state": self.state}
        fields["now"] = self.now_tick if arrived is None else arrived
        door.acknowledge(build_ack(fields))

    def drop_frames(self, count: int) -> None:
        """Count them."""
        self.dropped_frames += count

    def await_room(self, waiter: Callable[[], None]) -> None:
        self.room_waiters.append(waiter)

    def make_room(self) -> None:
        """One change leaves the queue."""
        self.room += 1
        waiters, self.room_waiters = self.room_waiters, []
        for waiter in waiters:
            waiter()

    def status_record(self) -> bytes:
        return build_status(
            {"state": self.state, "free": max(self.room, 0), "dropped_frames": self.dropped_frames, **self.status}
        )

    def request(self, setup: Setup, data: bytes, door: Door) -> bytes:
        self.asked.append(setup)
        if setup.index or data:
            raise Stall("not like this")
        match (setup.request_type, setup.request, setup.value):
            case (0xC1, Request.INFO, 0):
                return ANSWERS["info"]
            case (0xC1, Request.STATUS, 0):
                return self.status_record()
            case (0xC1, Request.CLOCK, 0):
                return ANSWERS["clock-reading"]
            case (0xC1, Request.PROCESSORS, 0):
                return self.processors
            case (0xC1, Request.PULSES, 0):
                pulses = [(0, 2 * (place == self.tested)) for place in range(320)]
                return bytes(16) + pack_pulses(pulses)
            case (0x41, Request.ENABLE, 0):
                self.state = State.READY
            case (0x41, Request.DISABLE, 0):
                self.state, self.tested = State.OFF, None
            case (0x41, Request.LIMIT, _):
                if self.state in ENABLED:
                    raise Stall("a limit is set while the outputs are off")
            case (0x41, Request.WATCHDOG | Request.IDENTIFY, _):
                pass
            case (0x41, Request.CLEAR_FAULTS | Request.RESET | Request.REVERT, 0):
                pass
            case _:
                raise Stall("unknown")
        return b""

    def test_transducer(self, transducer: int, door: Door) -> None:
        if self.state not in ENABLED:
            raise BlockError("refused", Reason.DISABLED)
        self.tested = transducer

    def host_arrived(self) -> None:
        self.arrivals += 1
