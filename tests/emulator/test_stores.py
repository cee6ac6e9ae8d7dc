"""What a conformance case cannot see of stores and requests: messages one by one, slow links, lights that blink."""

from __future__ import annotations

import pytest
from phasewire import Emulator
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Entries,
    Entry,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.codes import Fault, Request, State
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import FULL, HALF, PERIOD, Device, pulses
from tests.from_spec import modulated_width


@pytest.fixture(params=[False, True], ids=["folded", "unfolded"])
def unfolded(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


def heard(device: Device, first: int, last: int) -> list[int]:
    """The widths of the pulses from a period up to, not including, another."""
    device.run_until(last * PERIOD)
    return list(device.widths()[first:last].tolist())


# Sequences (BLK-013 to BLK-015)


@pytest.mark.parametrize(("link", "apart"), [(FIVE_WIRE, 1), (TWO_WIRE, 2)], ids=["5wire", "2wire"])
def test_stores_go_between_updates_at_the_rate_that_holds(unfolded: bool, link: Link, apart: int) -> None:
    """Clause BLK-007; they make no update late, and arrive in time themselves."""
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
    sequence, modulation = device.send_in_time(PlaySequence(500, 120), AmplitudeModulation(0, 2, 1))
    assert modulation.commit_period == sequence.commit_period + 1
    updates = [1 + n % 25 for n in range(60)]
    assert heard(device, at, at + 60 * apart)[::apart] == updates
    begins = sequence.commit_period
    assert heard(device, begins, begins + 7) == [20, modulated_width(21, 128)] * 3 + [20]
    assert (device.status().late, device.status().missed_commits) == (0, 0)


SLOW = Link("slow", 5, 4, cycles_per_symbol=40)


def test_processors_are_asked_under_any_load_of_stores() -> None:
    """Clauses CHN-017 and CHN-018: loads without a gap make way, or all would fall silent in 50 ms."""
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
    begins = device.send_in_time(*stores, PlaySequence(0, 120))[-1].commit_period
    device.run_until((begins + 120) * PERIOD)
    words = device.emulator.capture().bits(begins * 50, (begins + 120) * 50)[:, 9] & 1
    assert words.reshape(-1, 50).sum(axis=1).tolist() == [9] * 120


# When changes take effect (BLK-005, BLK-007, BLK-012 and BLK-018)


# Read-back (REQ-007)


def test_pulses_that_change_meanwhile_are_read_again() -> None:
    """Message by message, at every moment around a change: never parts of two updates."""
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


# Requests


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
