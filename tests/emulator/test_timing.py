"""The emulated device keeps the times that the model promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Emulator, Pulses
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.protocol.codes import Request
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Budget, Link

from tests.emulator.passing import pass_until
from tests.strategies import update

BLOCK = update(Pulses(np.full(320, 25), np.full(320, 25)), 1)


def ready(link: Link) -> Emulator:
    emulator = Emulator(link=link)
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    emulator.usb.control(Setup(0x41, Request.ENABLE, 0, 0, 0))
    return emulator


def first_tick(link: Link, begins: int) -> int:
    """The tick at which an update plays whose first bit is sent at a core cycle."""
    emulator = ready(link)
    pass_until(emulator, begins)
    bus = EmulatorBackend([emulator])
    bus.bulk_write(bus.open_device(next(bus.enumerate_devices())), 0x01, 0, BLOCK, 1000)
    emulator.run(12)
    capture = emulator.capture()
    return int(np.argmax(capture.channels(0, capture.end_tick).all(axis=1)))


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE, Link("slow", 2, 10, cycles_per_symbol=3, token_delay=7)])
@given(begins=st.integers(0, 30_000))
def test_an_update_plays_at_the_period_that_the_model_predicts(link: Link, begins: int) -> None:
    assert first_tick(link, begins) == 50 * Budget.of(link).first_period(begins)


@pytest.mark.parametrize(("link", "just_in_time"), [(FIVE_WIRE, 30_000 - 21_086), (TWO_WIRE, 30_000 - 29_246)])
def test_a_cycle_too_late_for_a_boundary_is_a_period_too_late(link: Link, just_in_time: int) -> None:
    """The sums by hand: 3846 + 6000 + 5440 or 13 600 + 400 + 4400 cycles before period 3, at 30 000."""
    assert first_tick(link, just_in_time) == 150
    assert first_tick(link, just_in_time + 1) == 200
