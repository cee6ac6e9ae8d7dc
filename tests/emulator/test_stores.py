"""What a whole device stores and plays from its stores, and what requests say of it (SPEC.md, chapters BLK and REQ).

Almost everything is tried twice: with the way along the chain taken for granted, and message by message.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from phasewire import Emulator, Pulses
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.control.chain import Passing
from phasewire.emulator.door import Handshake, Stall
from phasewire.protocol.blocks import (
    Block,
    Body,
    Clock,
    Entries,
    Entry,
    Modulation,
    NoOp,
    Output,
    Samples,
    Sequence,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.codes import AckFlag, Action, ChannelEnd, Fault, Outcome, Reason, Request, State, StatusFlag
from phasewire.protocol.replies import Ack, ClockReading, ReadBack, Status, decode_reports
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import FULL, HALF, PERIOD, SILENT, Device, Terminal, pulses


@pytest.fixture(params=[False, True], ids=["folded", "unfolded"])
def unfolded(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture
def device(unfolded: bool) -> Device:
    """Enabled for long, with slots whose pulses are as wide as their number says, up to 9."""
    made = Device(Emulator(unfolded=unfolded))
    made.order(Request.WATCHDOG, 60_000)
    for width in range(10):
        made.send(Slot(width, pulses(width)))
    made.run(100)
    made.order(Request.ENABLE)
    return made


def entries(device: Device, *items: tuple[int, int], first: int = 0) -> None:
    ack = device.send(Entries(tuple(Entry(*item) for item in items), first))
    assert ack.reason is Reason.ACCEPTED


def heard(device: Device, first: int, last: int) -> list[int]:
    """How wide the pulses are from a period up to, not including, another."""
    device.run_until(last * PERIOD)
    return list(device.widths()[first:last].tolist())


# Sequences (BLK-013 to BLK-015)


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE], ids=lambda link: link.name)
@pytest.mark.parametrize("repeats", [1, 2, 3])
def test_a_sequence_plays_each_slot_for_its_periods_and_then_falls_silent(
    unfolded: bool, link: Link, repeats: int
) -> None:
    device = Device(Emulator(unfolded=unfolded, link=link), enabled=True)
    for width in range(4, 8):
        device.send(Slot(100 + width, pulses(width)))
    entries(device, (104, 1), (105, 3), (104, 2), (107, 1), first=1000)
    ack = device.send(Sequence(1000, 4, period=200, repeats=repeats))
    assert (ack.reason, ack.commit_period, ack.flags) == (Reason.ACCEPTED, 200, AckFlag(0))
    once = [4, 5, 5, 5, 4, 4, 7]
    assert heard(device, 198, 230) == [0, 0] + once * repeats + [0] * (30 - 7 * repeats)
    assert device.status().missed_commits == 0
    (told,) = device.told()
    assert (told.state, told.flags, told.since_period) == (State.READY, StatusFlag(0), 0)
    assert told.now == (200 + 7 * repeats) * 50


def test_a_sequence_without_end_goes_on_until_something_takes_its_place(device: Device) -> None:
    entries(device, (3, 2), (4, 1))
    begins = device.send(Sequence(0, 2)).commit_period
    device.run(10)
    assert (device.state, device.status().flags) == (State.PLAYING, StatusFlag.SEQUENCE)
    assert device.status().since_period == begins
    ends = begins + 20
    device.send(Update(pulses(9), ends))
    expected = [[3, 3, 4][n % 3] for n in range(20)] + [9] * 5
    assert heard(device, begins, ends + 5) == expected
    assert (device.state, device.status().flags) == (State.PLAYING, StatusFlag(0))
    assert device.status().since_period == ends
    assert device.told() == []


def test_a_sequence_takes_the_place_of_another_within_an_entry(device: Device) -> None:
    entries(device, (3, 100), (4, 2), (5, 2))
    first = device.send(Sequence(0, 1)).commit_period
    second = device.send(Sequence(1, 2, period=first + 7, repeats=1)).commit_period
    assert heard(device, first, first + 15) == [3] * 7 + [4, 4, 5, 5] + [0] * 4
    assert second == first + 7
    assert len(device.told()) == 1  # the end of the second


def test_the_end_of_a_sequence_that_something_ended_before_is_none(device: Device) -> None:
    """Nor is the end of one that began again."""
    entries(device, (3, 5))
    first = device.send(Sequence(0, 1, repeats=2)).commit_period
    device.send(Sequence(0, 1, period=first + 9, repeats=2))
    device.run_until((first + 9 + 10) * PERIOD - 1)
    assert (device.state, device.told()) == (State.PLAYING, [])
    device.run(1)
    assert (device.state, len(device.told())) == (State.READY, 1)
    assert heard(device, first, first + 20) == [3] * 19 + [0]


def test_an_update_in_the_period_in_which_a_sequence_ends_follows_without_a_gap(device: Device) -> None:
    entries(device, (3, 5))
    first = device.send(Sequence(0, 1, period=device.period + 30, repeats=2)).commit_period
    device.send(Update(pulses(8), first + 10))
    assert heard(device, first, first + 12) == [3] * 10 + [8] * 2
    assert (device.state, device.told()) == (State.PLAYING, [])


@pytest.mark.parametrize(("action", "state"), [(Action.SILENCE, State.READY), (Action.DISABLE, State.OFF)])
def test_an_output_block_ends_a_sequence(device: Device, action: Action, state: State) -> None:
    entries(device, (3, 100))
    first = device.send(Sequence(0, 1, unattended=True)).commit_period
    device.send(Output(action, first + 10))
    assert heard(device, first, first + 20) == [3] * 10 + [0] * 10
    assert device.state is state


def test_the_longest_sequence(device: Device) -> None:
    """1024 entries of up to 65 535 periods, the last of them at the end of the table."""
    for first in range(0, 1024, 120):
        count = min(120, 1024 - first)
        device.send_in_time(Entries(tuple(Entry(1 + n % 9, 1) for n in range(first, first + count)), first))
    device.send_in_time(Entries((Entry(9, 65_535),), 1023))
    begins = device.send_in_time(Sequence(0, 1024, repeats=2))[-1].commit_period
    device.run_until((begins + 1023 + 65_535 + 3) * PERIOD)
    capture = device.emulator.capture()
    channel = int(capture.wiring.channels[0])
    word = capture.bits((begins + 1020) * 50, (begins + 1026) * 50)[:, channel // 32] >> channel % 32 & 1
    assert word.reshape(-1, 50).sum(axis=1).tolist() == [1 + n % 9 for n in (1020, 1021, 1022)] + [9] * 3
    last = begins + 1023 + 65_535
    word = capture.bits((last - 2) * 50, (last + 3) * 50)[:, channel // 32] >> channel % 32 & 1
    assert word.reshape(-1, 50).sum(axis=1).tolist() == [9, 9, 1, 2, 3]


def test_stores_are_there_before_a_sequence_that_follows_at_once(device: Device) -> None:
    """Clause BLK-007, with the largest stores, in the queue before it."""
    acks = device.send_in_time(
        Slot(200, pulses(20)),
        Entries(tuple(Entry(200, 1) if n % 2 else Entry(9, 1) for n in range(120)), 500),
        Samples(bytes([128] * 480)),
        Sequence(500, 120),
    )
    begins = acks[-1].commit_period
    assert heard(device, begins, begins + 20) == [9, 20] * 10
    assert begins <= device.period
    assert device.status().faults == Fault(0)


@pytest.mark.parametrize(("link", "apart"), [(FIVE_WIRE, 1), (TWO_WIRE, 2)], ids=["5wire", "2wire"])
def test_stores_find_their_way_between_updates_at_the_rate_that_holds(unfolded: bool, link: Link, apart: int) -> None:
    """Clause BLK-007; no update is late for them, and what they bring is there in time."""
    device = Device(Emulator(unfolded=unfolded, link=link), enabled=True)
    stores: dict[int, Body] = {
        10: Slot(200, pulses(20)),
        20: Slot(201, pulses(21)),
        30: Entries(tuple(Entry(200 + n % 2, 1) for n in range(120)), 500),
        40: Samples(bytes([128, 255] * 240)),
    }
    at = device.period + 10
    for n in range(60):
        device.send_in_time(*([stores[n]] if n in stores else []), Update(pulses(1 + n % 25), at + n * apart))
    sequence, modulation = device.send_in_time(Sequence(500, 120), Modulation(0, 2, 1))
    assert modulation.commit_period == sequence.commit_period + 1
    updates = [1 + n % 25 for n in range(60)]
    assert heard(device, at, at + 60 * apart)[::apart] == updates
    begins = sequence.commit_period
    assert heard(device, begins, begins + 7) == [
        20,
        modulated(21, 128),
        20,
        modulated(21, 128),
        20,
        modulated(21, 128),
        20,
    ]
    assert (device.status().late, device.status().missed_commits) == (0, 0)


def test_loads_that_fit_before_what_is_queued_hold_up_nothing_behind_it(device: Device) -> None:
    """A slot is 12 µs of loads, and 40 periods are a millisecond."""
    at = device.period + 40
    device.send(Update(HALF, at))
    device.send(Slot(9, pulses(9)))
    entries(device, (9, 1))
    ack = device.send(Sequence(0, 1, at + 1))
    assert (ack.commit_period, ack.late) == (at + 1, False)


SLOW = Link("slow", 5, 4, cycles_per_symbol=40)


def test_processors_are_asked_however_many_stores_come() -> None:
    """Clauses CHN-017 and CHN-018: loads that come without a gap make way, or all would fall silent in 50 ms."""
    device = Device(Emulator(unfolded=True, link=SLOW), enabled=True)
    begins = device.send(Update(FULL)).commit_period
    device.run_until((begins + 2) * PERIOD)
    stores = [Entries((Entry(0, 1),) * 120)] * 48  # 2.4 ms each
    device.send_in_time(*stores)
    assert device.period > 70 * 40
    assert device.high_periods() >= set(range(begins, device.period))
    assert (device.state, device.status().faults) == (State.PLAYING, Fault(0))


def test_a_sequence_waits_for_questions_between_its_stores_too() -> None:
    """Fifty of them, at the last processor, whose loads are the last."""
    device = Device(Emulator(unfolded=True, link=Link("slower", 5, 4, cycles_per_symbol=60)), enabled=True)
    for slot, width in ((0, 5), (1, 9)):
        device.send(Slot(slot, pulses(width)))
    device.send(Entries((Entry(0, 1),) * 120))
    device.run(400)
    stores = [Entries((Entry(0, 1),) * 120, 120)] * 15 + [Entries((Entry(1, 1),) * 120)]
    begins = device.send_in_time(*stores, Sequence(0, 120))[-1].commit_period
    device.run_until((begins + 120) * PERIOD)
    words = device.emulator.capture().bits(begins * 50, (begins + 120) * 50)[:, 9] & 1
    assert words.reshape(-1, 50).sum(axis=1).tolist() == [9] * 120


def test_a_slot_that_was_stored_again_plays_what_was_stored_last(device: Device) -> None:
    entries(device, (3, 1))
    begins = device.send(Sequence(0, 1, repeats=2)).commit_period
    device.run(10)
    assert device.send(Slot(3, pulses(11))).reason is Reason.ACCEPTED
    again = device.send(Sequence(0, 1, repeats=2)).commit_period
    assert heard(device, begins, begins + 2) == [3, 3]
    assert heard(device, again, again + 3) == [11, 11, 0]


# Modulations (BLK-016 and BLK-017)


def modulated(width: int, sample: int) -> int:
    """Clause PUL-006."""
    return math.floor(50 / math.pi * math.asin(sample / 255 * math.sin(math.pi * width / 50)) + 0.5)


@pytest.mark.parametrize("hold", [1, 2, 7])
def test_a_modulation_narrows_what_plays_in_turn(device: Device, hold: int) -> None:
    samples = bytes([255, 200, 128, 64, 0, 31])
    device.send(Samples(samples, first=4090))
    device.send(Update(FULL))
    begins = device.send(Modulation(4090, 6, hold, device.period + 10)).commit_period
    expected = [modulated(25, samples[n // hold % 6]) for n in range(13 * hold)]
    assert heard(device, begins - 2, begins + 13 * hold) == [25, 25, *expected]
    assert device.status().flags == StatusFlag.MODULATION


def test_a_modulation_goes_on_whatever_plays_and_counts_from_its_own_beginning(device: Device) -> None:
    samples = bytes([255, 128, 0])
    device.send(Samples(samples))
    entries(device, (9, 4), (8, 1))
    begins = device.send(Modulation(0, 3, 1)).commit_period
    update = device.send(Update(FULL, begins + 5)).commit_period
    sequence = device.send(Sequence(0, 2, begins + 10, 1)).commit_period
    base = [0] * 5 + [25] * 5 + [9] * 4 + [8] + [0] * 5
    expected = [modulated(width, samples[n % 3]) for n, width in enumerate(base)]
    assert heard(device, begins, begins + 20) == expected
    assert (update, sequence) == (begins + 5, begins + 10)


def test_a_modulation_takes_the_place_of_another(device: Device) -> None:
    device.send(Samples(bytes([128, 64])))
    device.send(Update(FULL))
    first = device.send(Modulation(0, 1, 1)).commit_period
    second = device.send(Modulation(1, 1, 5, first + 6)).commit_period
    ends = device.send(Output(Action.END_MODULATION, second + 4)).commit_period
    assert heard(device, first, ends + 2) == [modulated(25, 128)] * 6 + [modulated(25, 64)] * 4 + [25] * 2
    assert (device.state, device.status().flags) == (State.PLAYING, StatusFlag(0))


@pytest.mark.parametrize("action", [Action.SILENCE, Action.DISABLE])
def test_silence_ends_a_modulation_too(device: Device, action: Action) -> None:
    device.send(Samples(bytes([64])))
    device.send(Update(FULL))
    device.send(Modulation(0, 1, 1))
    device.send(Output(action))
    device.run(20)
    assert device.status().flags == StatusFlag(0)
    device.order(Request.ENABLE)
    begins = device.send(Update(FULL)).commit_period
    assert heard(device, begins, begins + 3) == [25] * 3


def test_a_request_to_disable_ends_a_modulation_that_has_not_begun(device: Device) -> None:
    device.send(Samples(bytes([64])))
    begins = device.send(Modulation(0, 1, 1, device.period + 5)).commit_period
    device.run_until(begins * PERIOD - 5000)  # its programs are on the chain
    device.order(Request.DISABLE)
    device.order(Request.ENABLE)
    begins = device.send(Update(FULL)).commit_period
    assert heard(device, begins, begins + 3) == [25] * 3
    assert device.status().flags == StatusFlag(0)


def test_nothing_to_end_is_ended_all_the_same(device: Device) -> None:
    """Clause BLK-018."""
    for action in (Action.END_MODULATION, Action.SILENCE, Action.SILENCE):
        assert device.send(Output(action)).reason is Reason.ACCEPTED
        device.run(6)
    assert (device.state, device.told()) == (State.READY, [])
    assert device.high_periods() == set()
    assert device.status().missed_commits == 0


# When changes take effect (BLK-005, BLK-007, BLK-012 and BLK-018)


def test_two_changes_for_one_period_follow_each_other(device: Device) -> None:
    device.send(Samples(b"\x80"))
    update = device.send(Update(FULL, 200))
    modulation = device.send(Modulation(0, 1, 1, 200))
    earlier = device.send(Update(pulses(9), 150))
    assert [ack.commit_period for ack in (update, modulation, earlier)] == [200, 201, 202]
    assert [ack.late for ack in (update, modulation, earlier)] == [False, True, True]
    assert heard(device, 199, 204) == [0, 25, modulated(25, 128), modulated(9, 128), modulated(9, 128)]
    assert device.status().late == 2


def test_as_soon_as_possible_is_behind_everything_and_never_late(device: Device) -> None:
    device.send(Update(FULL, 1000))
    ack = device.send(Output(Action.SILENCE))
    assert (ack.commit_period, ack.late) == (1001, False)


def test_changes_behind_one_that_disables_are_dropped_uncounted(device: Device) -> None:
    """Clause BLK-018; as is the state, so are they judged as long as the outputs are enabled."""
    at = device.period + 50
    device.send(Update(pulses(5)))
    device.send(Output(Action.DISABLE, at))
    entries(device, (3, 5))
    for body in (Update(FULL, at + 20), Update(FULL), Sequence(0, 1)):
        assert device.send(body).reason is Reason.ACCEPTED
    before = device.status()
    device.run(100)
    after = device.status()
    assert max(device.high_periods()) == at - 1
    assert (after.state, after.free, after.faults) == (State.OFF, QUEUE_BLOCKS, Fault(0))
    assert (after.accepted, after.refused, after.late, after.lost) == (
        before.accepted,
        before.refused,
        before.late,
        before.lost,
    )
    assert after.missed_commits == 0


@pytest.mark.parametrize("wait", range(0, 3 * PERIOD, 700))
def test_a_change_that_comes_close_before_it_disables_is_dropped(unfolded: bool, wait: int) -> None:
    device = Device(Emulator(unfolded=unfolded), enabled=True)
    device.send(Output(Action.DISABLE, 20))
    device.run_until(17 * PERIOD + wait)
    device.send(Update(FULL))
    device.run(30)
    assert device.high_periods() == set()
    assert (device.status().faults, device.status().missed_commits) == (Fault(0), 0)
    assert device.state is State.OFF


def test_one_that_was_to_disable_and_is_dropped_itself_holds_nothing_back(device: Device) -> None:
    device.send(Output(Action.DISABLE, device.period + 5000))
    device.order(Request.DISABLE)
    device.order(Request.ENABLE)
    assert device.send(Update(FULL)).commit_period < device.period + 10


# EMPTY (BLK-021)


def test_what_was_never_stored_cannot_be_played(device: Device) -> None:
    entries(device, (3, 1), (77, 1), first=10)
    device.send(Samples(b"\x01\x00\x02", first=10))
    refused: list[Body] = [
        Sequence(9, 2),
        Sequence(10, 2),  # slot 77
        Sequence(11, 2),
        Sequence(1023, 1),
        Modulation(9, 2, 1),
        Modulation(12, 2, 1),
        Modulation(4095, 1, 1),
    ]
    for body in refused:
        assert device.send(body).reason is Reason.EMPTY, body
    assert device.status().last_refusal is Reason.EMPTY
    assert device.send(Sequence(10, 1)).reason is Reason.ACCEPTED
    assert device.send(Modulation(10, 3, 1)).reason is Reason.ACCEPTED  # a sample of 0 is there too
    device.send(Slot(77, HALF))
    assert device.send(Sequence(10, 2)).reason is Reason.ACCEPTED


def test_stores_outlive_sessions_but_not_a_reset(device: Device) -> None:
    """Clauses BLK-013 and USB-026."""
    entries(device, (3, 1))
    device.send(Samples(b"\x80"))
    device.run(20)
    for begin_anew in (device.set_interface, device.configure, device.usb.reset):
        begin_anew()
        device.configure()
        device.order(Request.ENABLE)
        assert device.send(Sequence(0, 1, repeats=1)).reason is Reason.ACCEPTED
        device.run(10)
        assert device.send(Modulation(0, 1, 1)).reason is Reason.ACCEPTED
    assert (device.status().watchdog_ms, device.status().drive_limit) == (60_000, 320)
    device.order(Request.RESET)
    device.run_until_started()
    device.configure()
    device.order(Request.ENABLE)
    assert device.send(Sequence(0, 1)).reason is Reason.EMPTY
    assert device.send(Modulation(0, 1, 1)).reason is Reason.EMPTY


# IN_USE (BLK-022)


def taken(device: Device) -> tuple[list[int], list[int], list[int]]:
    """Slots 2 to 5, entries 0 to 3 and samples 0 to 3 that cannot be stored now."""
    in_use = Reason.IN_USE
    return (
        [n for n in range(2, 6) if device.send(Slot(n, pulses(n))).reason is in_use],
        [n for n in range(4) if device.send(Entries((Entry(2 + n, 5),), n)).reason is in_use],
        [n for n in range(4) if device.send(Samples(b"\x80", n)).reason is in_use],
    )


NOTHING: tuple[list[int], list[int], list[int]] = ([], [], [])


def test_what_plays_or_will_play_cannot_be_overwritten(device: Device) -> None:
    """From acceptance on, be it with the same bytes."""
    assert taken(device) == NOTHING
    device.run(400)
    device.send(Sequence(1, 2, period=5000))
    assert taken(device) == ([3, 4], [1, 2], [])
    device.send(Modulation(2, 2, 1, period=6000))
    assert taken(device) == ([3, 4], [1, 2], [2, 3])
    overlapping = Entries((Entry(9, 1), Entry(9, 1)), 0)
    assert device.send(overlapping).reason is Reason.IN_USE
    assert device.send(Entries((Entry(9, 1),), 3)).reason is Reason.ACCEPTED
    assert device.send(Samples(b"\x10\x20", 1)).reason is Reason.IN_USE


@pytest.mark.parametrize("early", [1, 0])
@pytest.mark.parametrize(
    ("body", "freed"),
    [
        (Update(HALF), NOTHING[:2]),
        (Sequence(3, 1), ([5], [3])),
        (Output(Action.SILENCE), NOTHING[:2]),
        (Output(Action.DISABLE), NOTHING[:2]),
        (None, NOTHING[:2]),
    ],
    ids=["update", "sequence", "silence", "disable", "end"],
)
def test_a_sequence_is_in_use_until_what_ends_it_has_taken_effect(
    device: Device, body: Update | Sequence | Output | None, freed: tuple[list[int], list[int]], early: int
) -> None:
    taken(device)
    device.run(400)
    begins = device.send(Sequence(1, 2, repeats=0 if body else 7)).commit_period
    device.run(8)
    ends = begins + 70 if body is None else device.send_at(body, begins + 50).commit_period
    assert ends == begins + (50 if body else 70)
    device.run_until(ends * PERIOD - early)
    slots, rows, _ = taken(device)
    assert ([n for n in slots if n != 5], [n for n in rows if n != 3]) == (([3, 4], [1, 2]) if early else ([], []))
    if not early:
        assert (slots, rows) == freed


@pytest.mark.parametrize("early", [1, 0])
@pytest.mark.parametrize(
    "body",
    [Modulation(3, 1, 1), Output(Action.END_MODULATION), Output(Action.SILENCE)],
    ids=["other", "end", "silence"],
)
def test_a_modulation_is_in_use_until_what_ends_it_has_taken_effect(
    device: Device, body: Modulation | Output, early: int
) -> None:
    taken(device)
    device.run(400)
    begins = device.send(Modulation(0, 2, 3)).commit_period
    device.run(8)
    device.send(Update(HALF))
    ends = device.send_at(body, begins + 50).commit_period
    device.run_until(ends * PERIOD - early)
    assert [n for n in taken(device)[2] if n != 3] == ([0, 1] if early else [])


def test_a_request_to_disable_frees_what_was_in_use_once_it_is_silent(device: Device) -> None:
    """Also what had not begun."""
    taken(device)
    device.run(400)
    device.send(Sequence(0, 1))
    device.send(Modulation(0, 1, 1))
    device.send(Sequence(1, 1, period=device.period + 100_000))
    device.run(8)
    device.order(Request.DISABLE)
    asked = device.period
    assert taken(device) == ([2, 3], [0, 1], [0])
    device.run_until((asked + 6) * PERIOD)
    assert taken(device) == NOTHING
    assert max(device.high_periods()) < asked + 6


def test_a_store_that_is_refused_changes_nothing(device: Device) -> None:
    """Clause BLK-008."""
    entries(device, (3, 1))
    device.send(Samples(b"\xff"))
    device.send(Modulation(0, 1, 1))
    begins = device.send(Sequence(0, 1)).commit_period
    for body in (Slot(3, FULL), Entries((Entry(9, 1),)), Samples(b"\x00")):
        assert device.send(body).reason is Reason.IN_USE
    assert heard(device, begins, begins + 10) == [3] * 10
    again = device.send(Sequence(0, 1, repeats=1)).commit_period
    assert heard(device, again, again + 2) == [3, 0]


# DRIVE (SAF-006)


def test_the_drive_limit_holds_for_slots_and_what_plays_them(device: Device) -> None:
    """25 ticks are 1000 each, 12 ticks 469: 150 080 for all of them, so that 151 is enough and 150 is not."""
    entries(device, (20, 1), (9, 1), (21, 1))
    assert device.send(Slot(20, HALF)).reason is Reason.ACCEPTED
    device.order(Request.DISABLE)
    device.order(Request.LIMIT, 150)
    device.order(Request.ENABLE)
    for body in (Slot(21, HALF), Update(HALF), Sequence(0, 1), Sequence(0, 2), Sequence(0, 3)):
        assert device.send(body).reason is Reason.DRIVE, body
    assert device.send(Sequence(1, 2)).reason is Reason.EMPTY
    assert device.send(Sequence(1, 1, repeats=1)).reason is Reason.ACCEPTED
    device.order(Request.DISABLE)
    device.order(Request.LIMIT, 151)
    device.order(Request.ENABLE)
    assert device.send(Slot(21, HALF)).reason is Reason.ACCEPTED
    assert device.send(Sequence(0, 3)).reason is Reason.ACCEPTED


def test_no_drive_at_all(device: Device) -> None:
    device.order(Request.DISABLE)
    device.order(Request.LIMIT, 0)
    device.order(Request.ENABLE)
    assert device.send(Update(SILENT)).reason is Reason.ACCEPTED
    one = np.zeros(320, int)
    one[319] = 1
    assert device.send(Update(Pulses(one, one))).reason is Reason.DRIVE
    with pytest.raises(Stall):
        device.order(Request.LIMIT, 1)
    device.order(Request.DISABLE)
    with pytest.raises(Stall):
        device.order(Request.LIMIT, 321)


# The queue (BLK-009 and BLK-024)


def test_stores_clocks_and_no_ops_take_no_place_and_wait_like_changes(device: Device) -> None:
    at = device.period + 1000
    free: list[Body] = [Slot(30, HALF), Entries((Entry(30, 1),)), Samples(b"\x80"), Clock(), NoOp()]
    for body in free:
        assert device.send(body).free == QUEUE_BLOCKS
    for n in range(QUEUE_BLOCKS):
        assert device.send(Update(HALF, at + n)).free == QUEUE_BLOCKS - 1 - n
    held_back: list[Body] = [Slot(30, HALF), Clock(), NoOp(), Update(HALF)]
    for body in held_back:
        assert device.usb.bulk_out(0x01, pack(Block(body, 10**6))) is Handshake.NAK
    device.run_until(at * PERIOD)
    assert device.send(NoOp()).free > 0


def test_sixteen_stores_may_wait(device: Device) -> None:
    """Behind updates that leave no room for them; the free places say that there is none."""
    device.run(100)
    acks = [device.send(Entries((Entry(1, 1),) * 120)) for _ in range(16)]
    assert [ack.free for ack in acks] == [QUEUE_BLOCKS] * 15 + [0]
    assert device.usb.bulk_out(0x01, pack(Block(NoOp(), 10**6))) is Handshake.NAK
    device.run(50)
    assert device.send(NoOp()).free == QUEUE_BLOCKS


# What is read back (REQ-007)


def test_what_plays_is_read_back(device: Device) -> None:
    random = np.random.default_rng(5)
    made = Pulses(random.integers(0, 100, 320), random.integers(0, 26, 320))
    assert device.read_back() == ReadBack(0, device.period, SILENT)
    ack = device.send(Update(made, device.period + 20))
    device.run(10)
    assert device.read_back() == ReadBack(0, device.period, SILENT)
    device.run(20)
    read = device.read_back()
    assert (read.since_period, read.pulses) == (ack.commit_period, made)
    assert read.read_period in (device.period, device.period - 1)
    device.send(Samples(b"\x10"))
    device.send(Modulation(0, 1, 1))
    device.run(20)
    assert device.read_back().pulses == made
    device.send(Output(Action.SILENCE))
    device.run(20)
    assert device.read_back() == ReadBack(0, device.period, SILENT)


@pytest.mark.parametrize("unattended", [False, True])
def test_of_a_sequence_the_entry_that_plays_is_read_back(device: Device, unattended: bool) -> None:
    entries(device, (3, 50), (4, 30))
    begins = device.send(Sequence(0, 2, repeats=3, unattended=unattended)).commit_period
    for after, since, width in ((10, 0, 3), (49, 0, 3), (55, 50, 4), (90, 80, 3), (239, 210, 4)):
        device.run_until((begins + after) * PERIOD)
        read = device.read_back()
        assert (read.since_period, read.pulses) == (begins + since, pulses(width))
    device.run_until((begins + 240) * PERIOD)
    assert device.read_back() == ReadBack(0, begins + 240, SILENT)


def test_pulses_that_change_meanwhile_are_read_again() -> None:
    """Message by message, from every moment around a change: never two updates at once."""
    device = Device(Emulator(unfolded=True), enabled=True)
    device.send(Update(HALF))
    device.run(8)
    seen = set()
    for step in range(-20, 3):
        ack = device.send(Update(FULL if step % 2 else HALF, device.period + 10))
        device.run_until(ack.commit_period * PERIOD + step * 600)
        read = device.read_back()
        seen.add(read.since_period - ack.commit_period == 0)
        assert not read.mixed
        assert read.pulses in (FULL, HALF)
        assert len(set(read.pulses.width.tolist())) == 1
        device.run(12)
    assert seen == {False, True}


def test_a_processor_that_missed_a_commit_is_read_back_as_it_plays() -> None:
    device = Device(Emulator(unfolded=True), enabled=True)
    device.send(Update(HALF))
    device.run(8)

    def flip_a_bit(passing: Passing) -> Passing:
        is_slice = passing.node == 6 and passing.tokens[2] == ChannelEnd.SLICE
        return passing._replace(tokens=passing.tokens[:9] + b"\1" + passing.tokens[10:]) if is_slice else passing

    device.emulator.tampers.append(flip_a_bit)
    device.send(Update(FULL))
    device.run(8)
    read = device.read_back()
    assert read.mixed
    assert read.since_period == 2**64 - 1
    wiring = device.emulator.capture().wiring
    assert read.pulses.width.tolist() == [12 if channel // 32 == 6 else 25 for channel in wiring.channels]
    device.run_ms(12)
    assert (device.status().missed_commits, device.status().faults) == (1, Fault.CHAIN)
    device.emulator.tampers.clear()
    ack = device.send(Update(HALF))
    device.run(8)
    assert (device.read_back().since_period, device.read_back().pulses) == (ack.commit_period, HALF)


# Requests


def test_processors_report() -> None:
    device = Device(Emulator(unfolded=True))
    device.set_temperature(40, processor=7)
    reports = decode_reports(device.ask(Request.PROCESSORS, 160))
    assert [report.temperature_c for report in reports] == [25] * 7 + [40] + [25] * 2
    assert {(report.faults, report.missed_commits, report.damaged_messages) for report in reports} == {(Fault(0), 0, 0)}
    assert {report.firmware for report in reports} == {device.info().firmware}
    assert device.status().temperature_c == 40
    device.emulator.processors[2].receive(b"rubbish")
    device.set_temperature(90, processor=7)
    reports = decode_reports(device.ask(Request.PROCESSORS, 160))
    assert [report.faults for report in reports] == [
        {2: Fault.CHAIN, 7: Fault.TEMPERATURE}.get(place, Fault(0)) for place in range(10)
    ]
    assert [report.damaged_messages for report in reports] == [int(place == 2) for place in range(10)]
    device.set_temperature(25, processor=7)
    device.order(Request.CLEAR_FAULTS)
    assert {report.faults for report in decode_reports(device.ask(Request.PROCESSORS, 160))} == {Fault(0)}


@pytest.mark.parametrize(("period", "pulse", "count"), [(1, 0, 1), (4095, 0, 1), (4096, 4096, 2), (13_000, 12_288, 4)])
def test_the_clock_tells_the_last_pulse_of_the_sync_line(device: Device, period: int, pulse: int, count: int) -> None:
    fresh = Device(Emulator())
    fresh.run_until(period * PERIOD + 450)
    expected = ClockReading(period * 50 + 2, pulse, count)
    assert ClockReading.decode(fresh.ask(Request.CLOCK, 24)) == expected
    ack = fresh.send(Clock())
    assert (ack.now, ack.commit_period) == (expected.now, pulse)


def test_a_light_blinks_for_five_seconds() -> None:
    device = Device()
    controller = device.emulator.running
    assert controller.blinking == []
    device.order(Request.IDENTIFY, 4)
    device.run_ms(3000)
    device.order(Request.IDENTIFY, 0)
    device.run_ms(1999)
    assert controller.blinking == [0, 4]
    device.run_ms(2)
    assert controller.blinking == [0]
    device.run_ms(3000)
    assert controller.blinking == []


def test_requests_are_refused_that_are_not_as_they_should_be(device: Device) -> None:
    """Clause REQ-001; what is refused has no effect."""
    device.send(Update(HALF))
    device.run(8)
    before = device.status()
    wrong = [
        Setup(0x41, Request.DISABLE, 1, 0, 0),
        Setup(0xC1, Request.DISABLE, 0, 0, 0),
        Setup(0x41, Request.STATUS, 0, 0, 0),
        Setup(0xC1, Request.STATUS, 1, 0, 64),
        Setup(0x41, Request.RESET, 1, 0, 0),
        Setup(0x41, Request.REVERT, 1, 0, 0),
        Setup(0x41, 15, 0, 0, 0),
        Setup(0x41, 0, 0, 0, 0),
        Setup(0x41, Request.WATCHDOG, 0, 0, 0),
        Setup(0x41, Request.IDENTIFY, 5, 0, 0),
    ]
    for setup in wrong:
        with pytest.raises(Stall):
            device.usb.control(setup)
    with pytest.raises(Stall):
        device.usb.control(Setup(0x41, Request.DISABLE, 0, 0, 1), b"\0")
    assert device.status() == before
    for length in (0, 1, 63, 64, 1000):
        assert len(device.ask(Request.INFO, length)) == min(length, 64)


def test_every_request_needs_a_configured_device_on_usb_but_not_on_a_line() -> None:
    device = Device(configured=False)
    for setup in (Setup(0xC1, Request.INFO, 0, 0, 64), Setup(0x41, Request.ENABLE, 0, 0, 0)):
        with pytest.raises(Stall):
            device.usb.control(setup)
    assert device.state is State.OFF
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    assert terminal.order(Request.ENABLE) is Outcome.DONE
    assert terminal.ask_status().state is State.READY


def test_counters_count(device: Device) -> None:
    before = device.status()
    device.send(NoOp(), 100)
    device.send(NoOp(), 105)
    device.send(NoOp(), 105)
    device.send(Update(HALF, 1))
    after = device.ask_status()
    assert (after.accepted - before.accepted, after.refused - before.refused) == (3, 1)
    assert after.late - before.late == 1
    first = 100 - 10  # ten slots came before, 0 to 9
    assert after.lost == first + 4
    assert after.last_refusal is Reason.SEQUENCE


# Over a serial line


def test_a_reset_over_a_line_is_answered_before_it_happens() -> None:
    """Clause SER-010: the REPLY, then CONSOLE, and the device comes up with its console."""
    device = Device(enabled=True)
    device.send(Update(HALF))
    device.run(8)
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    line = terminal.line
    assert terminal.order(Request.RESET) is Outcome.DONE
    assert device.emulator.controller is not None
    device.run_until_started()
    assert (device.state, device.status().accepted) == (State.OFF, 0)
    assert device.emulator.line is not line
    assert Terminal(device.emulator.line).type("faults") == "faults\r\nfaults: none\r\nok\r\n> "


def test_a_reset_by_the_console_is_answered_before_it_happens() -> None:
    device = Device(enabled=True)
    assert Terminal(device.emulator.line).type("reset") == "reset\r\nok\r\n> "
    device.run_until_started()
    assert device.state is State.OFF


# Records go with what was asked


def test_every_block_is_answered_once_in_order(device: Device) -> None:
    """Clause ACK-001."""
    bodies: list[Body] = [NoOp(), Sequence(500, 1), Update(HALF), Slot(40, FULL), Clock(), Output(Action.SILENCE)]
    for body in bodies:
        assert device.usb.bulk_out(0x01, device.pack(body)) is Handshake.ACK
    acks = device.records()
    assert all(isinstance(ack, Ack) for ack in acks)
    first = device.number - len(bodies)
    numbers = [ack.sequence for ack in acks if isinstance(ack, Ack)]
    assert numbers == list(range(first, device.number))
    reasons = [ack.reason for ack in acks if isinstance(ack, Ack)]
    assert reasons == [Reason.ACCEPTED, Reason.EMPTY] + [Reason.ACCEPTED] * 4
    device.run(20)
    assert not any(isinstance(record, Status) for record in device.records())
