"""A UART with its baud rate: bytes take their time on the line, in both directions at once, in device time.

A byte has ten bits: a start bit, eight of data, a stop bit (clause SER-001). The far end is a client that may come and
go; the device's output without a client is lost, as on a real line.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ...protocol.board import CORE_HZ
from ...protocol.framing import UART_BITS_PER_BYTE
from ..scheduler import Scheduler

__all__ = ["MOST_BAUD", "ByteLine", "Uart"]

MOST_BAUD = 12_000_000
"""The fastest line in SER-014."""

CLUSTER_SECONDS = 1e-4
"""How long bytes are collected before they are passed on together, if a single one takes less."""

MOST_WAITING = 1 << 16
"""Bytes that may wait in either direction before no more are taken."""


class ByteLine(Protocol):
    """A serial line of the device, without time between bytes."""

    @property
    def pending(self) -> int:
        """Bytes that wait for the host."""

    def receive(self, data: bytes) -> None:
        """Take bytes of the host, which arrive now."""

    def take(self, room: int) -> bytes:
        """Return at most so many bytes for the host."""

    def hang_up(self) -> None:
        """The host has gone."""


class _Way:
    """One direction of the line: how many bytes it has had time for since it was last idle."""

    def __init__(self, scheduler: Scheduler, baud: int) -> None:
        self._scheduler = scheduler
        self._baud = baud
        self._cluster = max(1, int(baud / UART_BITS_PER_BYTE * CLUSTER_SECONDS))
        self._busy = False
        self._begin = 0
        self._carried = 0

    def keep_busy(self, waiting: int) -> None:
        """Note that bytes wait, or that none wait any more."""
        if waiting and not self._busy:
            self._begin, self._carried = self._scheduler.now, 0
        self._busy = waiting > 0

    def allowance(self) -> int:
        """How many bytes have had their time but were not carried yet."""
        passed = (self._scheduler.now - self._begin) * self._baud // (UART_BITS_PER_BYTE * CORE_HZ)
        return passed - self._carried

    def carry(self, count: int) -> None:
        """Note that bytes were carried."""
        self._carried += count

    def next_time(self, waiting: int) -> int | None:
        """When the next bytes will have had their time; None if no bytes wait."""
        if not waiting:
            return None
        if not self._busy:
            return self._scheduler.now
        count = self._carried + min(waiting, self._cluster)
        return self._begin - (-count * UART_BITS_PER_BYTE * CORE_HZ // self._baud)


class Uart:
    """A conversation over a serial line.

    Parameters
    ----------
    line : callable
        Returns the device's present end: a device that restarts gets a new one, and one in DFU mode has none.
    scheduler : Scheduler
        The device's time.
    baud : int
        Bits per second, from 1 to `MOST_BAUD`.

    Raises
    ------
    ValueError
        If the baud rate is out of range.
    """

    over = False
    stuck = False

    def __init__(self, line: Callable[[], ByteLine | None], scheduler: Scheduler, baud: int) -> None:
        if not 1 <= baud <= MOST_BAUD:
            raise ValueError(f"{baud} baud; a serial line has 1 to {MOST_BAUD}")
        self._line = line
        self._to_device = bytearray()
        self._to_client = bytearray()
        self._inward = _Way(scheduler, baud)
        self._outward = _Way(scheduler, baud)
        self._leaving = False
        self._scheduler = scheduler
        self.connected = False
        self.last_word: int | None = None

    @property
    def pending(self) -> int:
        """Bytes that wait for the client."""
        return len(self._to_client)

    @property
    def full(self) -> bool:
        """Whether the client should pause its output."""
        return len(self._to_device) > MOST_WAITING or len(self._to_client) > MOST_WAITING

    @property
    def presses(self) -> bool:
        """Whether some data are under way, so that time must pass at the fast pace too."""
        return bool(self._to_device or self._sayable)

    @property
    def _sayable(self) -> int:
        """Bytes of the device that can go on the line now."""
        line = self._line()
        return line.pending if line and len(self._to_client) <= MOST_WAITING else 0

    def connect(self) -> None:
        """A client has come."""
        if self._leaving:
            self._finish_leaving()
        self.connected = True

    def receive(self, data: bytes) -> None:
        """Take bytes of the client."""
        self._to_device += data
        self._inward.keep_busy(len(self._to_device))

    def take(self, room: int) -> bytes:
        """Return at most so many bytes for the client."""
        data = bytes(self._to_client[:room])
        del self._to_client[:room]
        return data

    def hang_up(self) -> None:
        """The client has gone; the device is told after it has received the client's data."""
        self.connected = False
        self._to_client.clear()
        self._leaving = True
        if not self._to_device:
            self._finish_leaving()

    def next_time(self, _event: int | None) -> int | None:
        """When the next bytes will have gone over the line."""
        times = (self._inward.next_time(len(self._to_device)), self._outward.next_time(self._sayable))
        return min((time for time in times if time is not None), default=None)

    def run(self) -> None:
        """Pass on what has gone over the line."""
        line = self._line()
        if count := min(self._inward.allowance(), len(self._to_device)):
            data = bytes(self._to_device[:count])
            del self._to_device[:count]
            self._inward.carry(count)
            self._inward.keep_busy(len(self._to_device))
            if line:
                line.receive(data)
                self.last_word = self._scheduler.now
            if self._leaving and not self._to_device:
                self._finish_leaving()
        self._outward.keep_busy(self._sayable)
        if line and (count := min(self._outward.allowance(), self._sayable)):
            data = line.take(count)
            self._outward.carry(len(data))
            self._outward.keep_busy(self._sayable)
            if self.connected:
                self._to_client += data

    def _finish_leaving(self) -> None:
        self._leaving = False
        self._to_device.clear()
        self._inward.keep_busy(0)
        if line := self._line():
            line.hang_up()
