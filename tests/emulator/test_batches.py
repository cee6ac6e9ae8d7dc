"""Batches: the device takes updates in one transfer exactly as one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire import Emulator, Pulses
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.control.controller import Controller
from phasewire.emulator.doors.backend import EmulatorBackend, Handle
from phasewire.protocol import Clock, NoOp, Output, Slot, State, Status, Update, pack
from phasewire.protocol.blocks import Block
from phasewire.protocol.codes import Action, Reason, Request
from phasewire.protocol.replies import Ack, records
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.passing import now

PULSES = [Pulses((np.arange(320) * seed) % 100, (np.arange(320) + seed) % 26) for seed in range(7)]
FULL = Pulses([0] * 320, [25] * 320)

Sent = tuple[str, int]


def packets(sent: list[Sent], since_period: int, number: int) -> list[bytes]:
    """The blocks of a program, numbered from a number on; some are made wrong."""
    made, named = [], since_period + 6
    for what, value in sent:
        body: Any = Update(PULSES[value % 7])
        match what:
            case "named":
                named += 1 + value % 3
                body = Update(PULSES[value % 7], named)
            case "late":
                body = Update(PULSES[value % 7], 1 + value)
            case "far":
                body = Update(PULSES[value % 7], 2**34)
            case "loud":
                body = Update(FULL)
            case "gap":
                number += value
            case "back":
                number -= value
            case "silence":
                body = Output(Action.SILENCE)
            case "slot":
                body = Slot(value, PULSES[value % 7])
            case "clock":
                body = Clock()
            case "nothing":
                body = NoOp()
        block = bytearray(pack(Block(body, number % 2**32, restart=what == "restart")))
        if what == "damaged":
            block[40 + value] ^= 1
        made.append(bytes(block))
        number += 1
    return made


def started(link: Link) -> tuple[Emulator, EmulatorBackend, Handle]:
    emulator = Emulator(link=link, serial="BATCH")
    bus = EmulatorBackend([emulator])
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    emulator.usb.control(Setup(0x41, Request.LIMIT, 200, 0, 0))
    emulator.usb.control(Setup(0x41, Request.ENABLE, 0, 0, 0))
    return emulator, bus, bus.open_device(next(bus.enumerate_devices()))


def outcome(emulator: Emulator) -> tuple[int, list[Any], Status, np.ndarray]:
    """The time of its end, all records, the status, and the bits from then on."""
    ended, said = now(emulator), []
    while isinstance(packet := emulator.usb.bulk_in(0x81), bytes):
        said += records(packet)
    status = Status.decode(emulator.usb.control(Setup(0xC1, Request.STATUS, 0, 0, 64)))
    emulator.run(30)
    capture = emulator.capture()
    return ended, said, status, capture.bits(0, capture.end_tick)


KINDS = ["now"] * 8 + ["named"] * 6 + ["late", "far", "loud", "gap", "back", "silence", "slot", "clock", "nothing"]


@settings(max_examples=60)
@given(
    st.sampled_from([FIVE_WIRE, TWO_WIRE]),
    st.lists(st.tuples(st.sampled_from([*KINDS, "restart", "damaged"]), st.integers(0, 60)), min_size=2, max_size=80),
    st.integers(1, 40),
    st.sampled_from([0, 0, QUEUE_BLOCKS - 2]),
    st.sampled_from([1, 2**32 - 5]),
)
def test_one_transfer_is_the_same_as_many(link: Link, sent: list[Sent], length: int, crowd: int, number: int) -> None:
    """Times, acknowledgements, counters and bits are the same, wherever transfers begin and end and numbers wrap."""
    results = []
    for per_transfer in (1, length):
        emulator, bus, handle = started(link)
        made = packets([("named", 2)] * crowd + sent, now(emulator) // 10_000, number)
        for first in range(0, len(made), per_transfer):
            data = b"".join(made[first : first + per_transfer])
            assert bus.bulk_write(handle, 0x01, 0, data, 10_000) == len(data)
        results.append(outcome(emulator))
    (ended, said, status, bits), (ended_too, said_too, status_too, bits_too) = results
    assert ended == ended_too
    assert said == said_too
    assert status == status_too
    assert np.array_equal(bits, bits_too)


@pytest.mark.parametrize(("link", "apart"), [(FIVE_WIRE, 1), (TWO_WIRE, 2)])
def test_a_fresh_field_in_every_period_can_be_streamed(link: Link, apart: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """500 updates in transfers of 100 are nearly all taken in batches, and all play at their period."""
    taken: list[int] = []
    genuine = Controller.take

    def noting(self: Controller, *arguments: Any) -> tuple[int, int]:
        count, ended = genuine(self, *arguments)
        taken.append(count)
        return count, ended

    monkeypatch.setattr(Controller, "take", noting)
    emulator, bus, handle = started(link)
    first = now(emulator) // 10_000 + 8
    made = [pack(Block(Update(PULSES[n % 7], first + apart * n), n)) for n in range(500)]
    said: list[Any] = []
    for begin in range(0, 500, 100):
        assert bus.bulk_write(handle, 0x01, 0, b"".join(made[begin : begin + 100]), 1000) == 51_200
        while isinstance(packet := emulator.usb.bulk_in(0x81), bytes):
            said += records(packet)
    assert sum(taken) > 480
    assert [(ack.reason, ack.commit_period) for ack in said if isinstance(ack, Ack)] == [
        (Reason.ACCEPTED, first + apart * n) for n in range(500)
    ]
    emulator.run(apart * QUEUE_BLOCKS + 20)
    for latches in emulator.capture().latches:
        assert latches == [50 * (first + apart * n) for n in range(500)]
    assert emulator.running.state is State.PLAYING


def test_a_time_out_takes_what_arrived_before() -> None:
    """At 40 000 a second 1 ms is enough for some 40 updates of 200, besides those that the queue holds."""
    emulator, bus, handle = started(FIVE_WIRE)
    made = b"".join(pack(Block(Update(PULSES[n % 7]), n)) for n in range(200))
    sent = bus.bulk_write(handle, 0x01, 0, made, 1)
    assert sent % 512 == 0
    assert 32 <= sent // 512 - QUEUE_BLOCKS <= 44
    assert bus.bulk_write(handle, 0x01, 0, made[sent:], 1000) == len(made) - sent
    acks = [ack for ack in outcome(emulator)[1] if isinstance(ack, Ack)]
    assert [ack.sequence for ack in acks] == list(range(200))
    assert {ack.reason for ack in acks} == {Reason.ACCEPTED}
