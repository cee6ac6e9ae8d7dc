from __future__ import annotations

from itertools import count, pairwise

import pytest
from phasewire.emulator.doors.station import Pace, Station
from phasewire.emulator.doors.uart import Uart
from phasewire.emulator.doors.usb_bus import Transfer, UsbBus
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.board import WATCHDOG_MS
from phasewire.protocol.requests import Setup

from tests.emulator.stand_ins import StandInDevice, StandInLine

SECOND = 400_000_000
MILLISECOND = SECOND // 1000


class Stand:
    """A station with one serial line of 10 000 bytes a second, and a clock that a test sets."""

    def __init__(self, pace: Pace) -> None:
        self.clock = 5.0
        self.scheduler = Scheduler()
        self.line = StandInLine()
        self.patient = False
        self.station = Station(self.scheduler, pace, lambda: self.clock, lambda: self.patient)
        self.uart = Uart(lambda: self.line, self.scheduler, 100_000)
        self.uart.connect()
        self.station.conversations.append(self.uart)


class Listening:
    """A conversation that has a bus alone."""

    pending, full, over, presses, stuck, last_word = 0, False, False, False, False, None

    def __init__(self, bus: UsbBus) -> None:
        self.next_time, self.run = bus.next_time, bus.run

    def receive(self, data: bytes) -> None: ...
    def take(self, room: int) -> bytes:
        return b""

    def hang_up(self) -> None: ...


def test_at_the_pace_of_the_wall_time_follows_the_clock() -> None:
    stand = Stand(Pace.WALL)
    happened: list[int] = []
    stand.scheduler.at(7 * MILLISECOND, lambda: happened.append(stand.scheduler.now))
    stand.clock += 0.006
    assert stand.station.pass_time(1.0)
    assert stand.scheduler.now == pytest.approx(6 * MILLISECOND, abs=1)
    assert happened == []
    stand.clock += 0.01
    assert stand.station.seconds_behind == pytest.approx(0.01)
    assert stand.station.pass_time(1.0)
    assert stand.scheduler.now == pytest.approx(16 * MILLISECOND, abs=1)
    assert happened == [7 * MILLISECOND]
    assert stand.station.seconds_behind == pytest.approx(0, abs=1e-8)
    stand.clock += 100.0
    assert stand.station.pass_time(1.0)
    assert stand.scheduler.now == pytest.approx(100.016 * SECOND, abs=10)  # at once, because no event was planned


def test_the_device_catches_up_slowly_enough_for_clients() -> None:
    """A client gives a sign of life every 33 ms; the program stops for a second; the watchdog has longer than both."""
    stand = Stand(Pace.WALL)
    signs: list[int] = []
    beat = SECOND // 40_000

    def carry_on() -> None:
        stand.scheduler.at(stand.scheduler.now + beat, carry_on)

    carry_on()
    stand.clock += 1.0
    while stand.station.pass_time(1.0) and stand.station.seconds_behind > 1e-6:
        for _ in range(33):
            stand.clock += 0.001
            stand.station.pass_time(1.0)
        signs.append(stand.scheduler.now)
        assert len(signs) < 100
    assert len(signs) == 30
    assert max(later - earlier for earlier, later in pairwise(signs)) <= 67 * MILLISECOND < WATCHDOG_MS * MILLISECOND
    assert signs[0] <= 106 * MILLISECOND


def test_a_pause_passes_at_once_for_a_patient_device() -> None:
    stand = Stand(Pace.WALL)
    stand.patient = True
    stand.scheduler.at(SECOND // 2, lambda: None)
    stand.clock += 1.0
    assert stand.station.pass_time(1.0)
    assert stand.scheduler.now == pytest.approx(SECOND, abs=1)


def test_at_the_pace_of_the_wall_each_turn_comes_when_it_is_due() -> None:
    stand = Stand(Pace.WALL)
    stand.uart.receive(b"abc")
    assert stand.station.seconds_to_wait() == pytest.approx(1e-4)
    stand.clock += 0.00025
    stand.station.pass_time(1.0)
    assert stand.line.heard == b"ab"
    assert stand.station.seconds_to_wait() == pytest.approx(0.5e-4)
    stand.clock += 0.01
    stand.station.pass_time(1.0)
    assert stand.uart.take(10) == b"ABC"
    assert stand.station.seconds_to_wait() is None
    stand.scheduler.at(stand.scheduler.now + 1, lambda: None)
    assert stand.station.seconds_to_wait() == 0.01  # the device is busy, and no client waits for it


def test_a_waiting_client_does_not_cost_the_device_time() -> None:
    """As a driver does with a transfer that waits for records; the next event is far away."""
    stand = Stand(Pace.WALL)
    device = StandInDevice()
    bus = UsbBus(device, stand.scheduler)
    stand.station.conversations.append(Listening(bus))
    bus.submit(Transfer(0x81, 512, b"", Setup(0, 0, 0, 0, 0), False, False, lambda *_: None))
    stand.scheduler.at(SECOND, lambda: None)
    for _ in range(60):
        wait = stand.station.seconds_to_wait()
        assert wait is not None
        stand.clock += wait + 1e-6  # a loop never comes early
        assert stand.station.pass_time(1.0)
    assert stand.clock > 5.5
    assert stand.scheduler.now / SECOND == pytest.approx(stand.clock - 5.0, abs=1e-4)


def test_a_model_that_is_slow_is_interrupted() -> None:
    stand = Stand(Pace.WALL)

    def take_long() -> None:
        stand.clock += 0.004  # of computing, four times what it models
        stand.scheduler.at(stand.scheduler.now + MILLISECOND, take_long)

    stand.scheduler.at(MILLISECOND, take_long)
    stand.clock += 0.01
    before = stand.clock
    assert not stand.station.pass_time(0.01)
    assert stand.clock - before < 0.02
    assert stand.station.seconds_behind > 0.01


def test_the_station_does_not_chase_a_clock_that_goes_on() -> None:
    ticks = count()
    station = Station(Scheduler(), Pace.WALL, lambda: next(ticks) / 1e4)
    assert station.pass_time(1.0)
    assert next(ticks) < 20


def test_at_the_fast_pace_time_passes_only_if_a_client_needs_it() -> None:
    stand = Stand(Pace.FAST)
    stand.scheduler.at(SECOND, lambda: None)
    stand.clock += 100.0
    assert stand.station.pass_time(1.0)
    assert (stand.scheduler.now, stand.station.seconds_behind) == (0, 0)
    stand.uart.receive(b"a" * 100)
    assert stand.station.pass_time(1.0)
    assert stand.scheduler.now == 101 * SECOND // 10_000  # a hundred bytes in, and the last one back
    assert stand.station.seconds_to_wait() is None


def test_at_the_fast_pace_the_device_comes_to_rest_after_each_message() -> None:
    stand = Stand(Pace.FAST)
    happened: list[int] = []
    for time in (MILLISECOND, 20 * MILLISECOND, 30 * MILLISECOND):
        stand.scheduler.at(time, lambda: happened.append(stand.scheduler.now // MILLISECOND))
    stand.station.pass_time(1.0)
    assert happened == []
    stand.uart.receive(b"a")
    stand.station.pass_time(1.0)
    assert (happened, stand.scheduler.now) == ([1, 20], 20 * MILLISECOND)
    stand.uart.receive(b"b")
    stand.station.pass_time(1.0)
    assert happened == [1, 20, 30]
