"""A device that runs for days: memory does not grow, and what is still needed is kept."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from phasewire import Emulator, Pulses
from phasewire.emulator import faults
from phasewire.emulator.boards.processor import Processor
from phasewire.emulator.ports.clock import BoardClock
from phasewire.emulator.ports.excerpt import Excerpt
from phasewire.protocol import (
    AmplitudeModulation,
    Entries,
    Entry,
    Fault,
    PlaySequence,
    Samples,
    Slot,
    State,
    Update,
)
from phasewire.protocol.codes import Request

from tests.emulator.hosts import Device

HALF = Pulses(np.full(320, 25), np.full(320, 12))
FULL = Pulses(np.full(320, 25), np.full(320, 25))


def events(emulator: Emulator) -> int:
    """The number of waiting plans, far and near."""
    return len(emulator.scheduler._queue)


def models(device: Device) -> list[Processor]:
    """The processors of a device, all of them models."""
    found = [processor for processor in device.emulator.processors if isinstance(processor, Processor)]
    assert len(found) == 10
    return found


@pytest.mark.parametrize("rate", [0, 1000, -1_000_000])
def test_a_board_s_clock_is_right_for_months(rate: int) -> None:
    clock = BoardClock(3)
    clock.set_rate(1000, rate)
    for tick in (0, 999, 10**10, 50 * 2**32):
        assert clock.own_ticks(tick, tick + 3).tolist() == [clock.own_tick(tick + n) for n in range(3)]
    assert clock.own_tick(50 * 2**32) == 997 + (50 * 2**32 - 1000) * (10**9 + rate) // 10**9


def test_a_stuck_bit_does_not_silence_its_port_after_hours() -> None:
    device = Device(Emulator(), enabled=True)
    for body in (Slot(0, FULL), Entries((Entry(0, 100),)), PlaySequence(0, 1, unattended=True)):
        device.send(body)
    device.run(30)
    device.emulator.inject(faults.StuckHigh(processor=0, bit=5))
    device.run(5 * 3600 * 40_000)
    capture = device.emulator.capture()
    last = capture.end_tick // 50 * 50
    counts = np.bitwise_count(capture.bits(last - 50, last)).sum(axis=0)
    assert counts.tolist() == [31 * 25 + 50, *[32 * 25] * 9]


def test_dropped_plans_take_no_memory() -> None:
    """Far changes that are dropped, and sequences that would end in years."""
    device = Device(Emulator())
    device.send(Slot(0, HALF))
    device.send(Entries((Entry(0, 65_535),)))
    counts = []
    for _ in range(60):
        device.order(Request.ENABLE)
        device.send_in_time(PlaySequence(0, 1, 0, 65_535))
        device.run(10)
        device.send_at(Update(HALF), device.period + 2**31)
        device.order(Request.DISABLE)
        device.run(40_000)
        counts.append(events(device.emulator))
    assert max(counts[10:]) <= max(counts[:10])


def test_the_list_of_what_is_in_use_is_bounded() -> None:
    device = Device(Emulator(history_periods=200), enabled=True)
    device.send(Slot(0, FULL))
    device.send(Entries((Entry(0, 100),)))
    device.send(Samples(b"\x80"))
    device.send(PlaySequence(0, 1, unattended=True))
    for _ in range(100):
        device.send_in_time(AmplitudeModulation(0, 1, 1))
        device.run(30)
    assert len(device.emulator.running._dispatch.stores._uses) < 20
    assert max(len(model.history.segments().overlays) for model in models(device)) < 40


def test_a_device_that_restarted_is_not_kept() -> None:
    device = Device(Emulator(), enabled=True)
    device.send_at(Update(HALF), device.period + 2**31)
    before = weakref.ref(device.emulator.running)
    device.order(Request.RESET)
    device.run_until_started()
    device.emulator.past.clear()
    device.emulator.events.clear()
    gc.collect()
    assert before() is None


def test_a_late_sequence_does_not_begin_on_a_processor_that_was_silenced_meanwhile() -> None:
    """SAF-007: the table is 12 periods late, and the board gets too hot before."""
    device = Device(Emulator(unfolded=True), enabled=True)
    device.send(Slot(0, FULL))
    device.send(Entries((Entry(0, 1000),)))
    ack = device.send_at(PlaySequence(0, 1, unattended=True), device.period + 60)
    device.emulator.run_until(ack.commit_period - 1)
    device.emulator.inject(faults.SlowProcessor(processor=3, slowness=30))
    device.run(5)
    device.emulator.inject(faults.HotBoard(board=1, celsius=90))
    device.run(100)
    for model in models(device):
        starts = model.history.segments().starts
        assert (np.diff(starts) >= 0).all()
    end = device.emulator.capture().end_tick
    assert not device.emulator.capture().bits(end - 2000, end)[:, 3].any()


def test_a_listener_whose_first_pulse_never_comes_has_no_sync() -> None:
    driver = Emulator()
    listener = Emulator(sync=driver.sync)
    listener.run_until(50_000)
    listener.restart()
    while listener.scheduler.now < driver.scheduler.now or listener.controller is None:
        if listener.scheduler.now > 50_010 * 10_000:
            break
        upcoming = listener.scheduler.next_time()
        assert upcoming is not None
        if upcoming - listener.scheduler.now > 100_000:  # it waits for the pulse
            break
        listener.scheduler.run_until(upcoming)
    assert listener.controller is None
    driver.scheduler.run_until(listener.scheduler.now)
    driver.power_down()
    listener.run_until_started()
    device = Device(listener)
    assert (device.state, device.status().faults) == (State.FAULT, Fault.SYNC)


def test_an_excerpt_begins_where_the_capture_s_memory_does() -> None:
    device = Device(Emulator(history_periods=100), enabled=True)
    device.send(Update(FULL))
    device.run(1000)
    capture = device.emulator.capture()
    assert capture.start_tick > 0
    excerpt = Excerpt.of(capture)
    assert (excerpt.start, excerpt.stop) == (capture.start_tick, capture.end_tick)
    ticks = np.concatenate([changes.ticks for changes in excerpt.changes()])
    assert set(np.diff(np.unique(ticks)).tolist()) == {25}
    with pytest.raises(ValueError, match="no stretch within the captured"):
        Excerpt.of(capture, None, (0, capture.end_tick))
