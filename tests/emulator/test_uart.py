from __future__ import annotations

import pytest
from phasewire.emulator.doors.uart import MOST_WAITING, Uart
from phasewire.emulator.scheduler import Scheduler

from tests.emulator.stand_ins import StandInLine

SECOND = 400_000_000


class Wire:
    """A serial line of 10 000 bytes a second, or another."""

    def __init__(self, baud: int = 100_000) -> None:
        self.scheduler = Scheduler()
        self.line = StandInLine()
        self.uart = Uart(lambda: self.line, self.scheduler, baud)
        self.uart.connect()

    def run_until(self, time: int) -> None:
        while (turn := self.uart.next_time(None)) is not None and turn <= time:
            self.scheduler.run_until(turn)
            self.uart.run()
        self.scheduler.run_until(time)
        self.uart.run()


@pytest.mark.parametrize("baud", [1, 300, 115_200, 1_000_000, 12_000_000])
def test_a_long_text_takes_its_time_to_the_cycle(baud: int) -> None:
    wire = Wire(baud)
    count = max(3, baud // 100)
    wire.uart.receive(b"x" * count)
    end = -(-count * 10 * SECOND // baud)
    wire.run_until(end - 1)
    assert len(wire.line.heard) < count
    wire.run_until(end)
    assert len(wire.line.heard) == count


def test_a_pause_gives_no_credit() -> None:
    wire = Wire()
    wire.uart.receive(b"a")
    wire.run_until(SECOND)
    wire.uart.receive(b"bc")
    wire.run_until(SECOND + SECOND // 10_000)
    assert wire.line.heard == b"ab"


def test_unsolicited_bytes_take_their_time_too() -> None:
    wire = Wire()
    wire.run_until(1000)
    wire.line.says = b"ok"
    assert wire.uart.next_time(None) == 1000
    wire.run_until(1000 + SECOND // 10_000)
    assert wire.uart.take(10) == b"o"


def test_bytes_without_a_client_are_lost() -> None:
    wire = Wire()
    wire.uart.hang_up()
    wire.line.says = b"hello"
    wire.run_until(SECOND)
    wire.uart.connect()
    assert (wire.uart.pending, wire.line.says) == (0, b"")


def test_the_bytes_of_a_client_that_leaves_arrive_first() -> None:
    wire = Wire()
    wire.uart.receive(b"off\r")
    wire.uart.hang_up()
    wire.run_until(SECOND // 10_000)
    assert (wire.line.heard, wire.line.hung_up) == (b"o", 0)
    wire.run_until(SECOND)
    assert (wire.line.heard, wire.line.hung_up, wire.uart.pending) == (b"off\r", 1, 0)


def test_the_next_client_cuts_off_the_bytes_of_the_last() -> None:
    wire = Wire()
    wire.uart.receive(b"off\r")
    wire.uart.hang_up()
    wire.uart.connect()
    assert wire.line.hung_up == 1
    wire.uart.receive(b"on")
    wire.run_until(SECOND)
    assert (wire.line.heard, wire.uart.take(10)) == (b"on", b"ON")


def test_a_client_that_does_not_read_or_sends_too_fast_is_held_up() -> None:
    wire = Wire(12_000_000)
    assert not wire.uart.full
    wire.uart.receive(bytes(MOST_WAITING + 1))
    assert wire.uart.full
    wire.run_until(SECOND)
    assert len(wire.line.heard) == MOST_WAITING + 1
    assert wire.uart.full  # now the answers wait
    said = wire.uart.pending
    wire.line.says += b"more"
    wire.run_until(2 * SECOND)
    assert wire.uart.pending == said
    wire.uart.take(said)
    wire.run_until(3 * SECOND)
    assert wire.uart.take(10)[-4:] == b"more"
