"""What a conformance case cannot see of stores and requests: messages one by one, slow links, lights that blink."""

from __future__ import annotations

import pytest
from phasewire import Emulator
from phasewire.protocol.blocks import (
    Entries,
    Entry,
    Update,
)
from phasewire.protocol.codes import Fault, Request, State
from phasewire.protocol.timing import Link

from tests.emulator.hosts import FULL, PERIOD, Device


@pytest.fixture(params=[False, True], ids=["folded", "unfolded"])
def unfolded(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


def heard(device: Device, first: int, last: int) -> list[int]:
    """The widths of the pulses from a period up to, not including, another."""
    device.run_until(last * PERIOD)
    return list(device.widths()[first:last].tolist())


# Sequences (BLK-013 to BLK-015)


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
