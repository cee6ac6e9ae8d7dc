"""An emulated device's UART as a port of pyserial, in this process and in the device's time.

Each byte takes its time by the baud rate. Time passes while a caller reads, or waits by `EmulatedPort.time`, and while
a write waits for room. The device's output while the port is closed is lost, and a device without power, in DFU mode or
just starting sends nothing, as on a real line. One caller at a time may have the port open.
"""

from __future__ import annotations

import errno
import math
from collections.abc import Callable
from typing import ClassVar
from weakref import WeakSet

from serial import PortNotOpenError, SerialBase, SerialException, SerialTimeoutException

from ...base.errors import DeviceNotFoundError
from ...protocol.board import CORE_HZ
from ..interfaces.serial_line import SerialLine
from ..interfaces.usb_device import PRODUCT
from ..machine import NOT_OPEN, Emulator, open_emulator, open_emulators
from ..scheduler import NEVER
from .address import EmulatorUrl
from .device_time import DeviceTime
from .uart import Uart

__all__ = ["EmulatedPort", "port_for_url"]


def port_for_url(url: str) -> EmulatedPort:
    """The UART for an ``emulator:`` URL (`EmulatorUrl.parse`), not yet opened.

    Raises
    ------
    DeviceNotFoundError
        If the URL is wrong, or no device of this serial number is plugged in.
    InputFileError
        If its scenario cannot be used.
    """
    address = EmulatorUrl.parse(url)
    if not address.serial:
        return EmulatedPort(address.make(), address.baud)
    emulator = open_emulator(address.serial)
    if emulator is None:
        names = ", ".join(repr(each.serial) for each in open_emulators())
        there = f"there are {names}" if names else "nothing is plugged in"
        raise DeviceNotFoundError(f"no device at {url!r}: {there}{NOT_OPEN}")
    return EmulatedPort(emulator, address.baud)


class EmulatedPort(SerialBase):
    """The UART of an emulated device. It is created closed, and may be opened more than once.

    The device does not notice when it is closed; as with a real UART it has by then received what was written.

    Parameters
    ----------
    emulator : Emulator
        The device.
    baud : int
        The rate of both ends, in bits per second; the host's end cannot use another.

    Attributes
    ----------
    time : DeviceTime
        The clock by which a host must wait; the wall clock does not apply.
    product, serial_number : str
        The device's, under pyserial's names for ports on USB.
    """

    _in_use: ClassVar[WeakSet[Emulator]] = WeakSet()

    def __init__(self, emulator: Emulator, baud: int) -> None:
        super().__init__(baudrate=baud)
        self.port = emulator.url
        self.product, self.serial_number = PRODUCT, emulator.serial
        self._emulator = emulator
        self._baud = baud
        self._uart = Uart(lambda: self._line, emulator.scheduler, baud)
        self.time = DeviceTime(emulator.scheduler, self._pass_until)

    # The interface that pyserial requires

    def open(self) -> None:
        """Open the port.

        Raises
        ------
        SerialException
            If it is in use.
        """
        if self._emulator in self._in_use:
            raise SerialException(errno.EBUSY, f"port {self.port} is in use")
        self._reconfigure_port()
        self._in_use.add(self._emulator)
        self.is_open = True
        self._uart.connect()
        self.reset_input_buffer()

    def close(self) -> None:
        """Close the port after all written data have gone over the line."""
        if self.is_open:
            self.flush()
            self.is_open = False
            self._in_use.discard(self._emulator)

    @property
    def in_waiting(self) -> int:
        """Received bytes that were not read."""
        self._check_open()
        return self._uart.pending

    def read(self, size: int = 1) -> bytes:
        """Wait for so many bytes, or until the time-out; returns those that have come."""
        self._check_open()
        self._pass_until(self._deadline(self.timeout), lambda: self._uart.pending >= size)
        return self._uart.take(size)

    def write(self, data: bytes) -> int:
        """Put bytes on the line.

        Raises
        ------
        SerialTimeoutException
            If there is no room for them before the time-out ends.
        """
        self._check_open()
        self._pass_until(self._deadline(self.write_timeout), lambda: not self._uart.full)
        if self._uart.full:
            raise SerialTimeoutException("Write timeout")
        self._uart.receive(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Wait until all written data have gone over the line."""
        self._check_open()
        self._pass_until(NEVER, lambda: not self._uart.presses)

    def reset_input_buffer(self) -> None:
        """Drop the received data."""
        self._uart.take(self._uart.pending)

    def send_break(self, duration: float = 0.25) -> None:
        """Hold the line low for so many seconds."""
        self.break_condition = True
        self.time.sleep(duration)
        self.break_condition = False

    def _reconfigure_port(self) -> None:
        if self.baudrate != self._baud:
            raise ValueError(f"{self.baudrate} baud; {self.port} has {self._baud}")

    def _update_break_state(self) -> None:
        if self.break_condition:
            self.flush()
            if line := self._line:
                line.hang_up()

    def _update_dtr_state(self) -> None:
        """The UART has three wires."""

    _update_rts_state = _update_dtr_state

    # Time

    @property
    def _line(self) -> SerialLine | None:
        """The device's end, if the device can receive or send."""
        return None if self._emulator.closed else self._emulator.line

    def _check_open(self) -> None:
        if not self.is_open:
            raise PortNotOpenError

    def _deadline(self, seconds: float | None) -> int:
        return NEVER if seconds is None else self._emulator.scheduler.now + math.ceil(seconds * CORE_HZ)

    def _pass_until(self, cycle: int, enough: Callable[[], bool] = lambda: False) -> None:
        """Let time pass until a core cycle, until there is enough data, or until no event will ever come."""
        scheduler = self._emulator.scheduler
        self._uart.run()
        while not enough() and scheduler.now < cycle:
            event = scheduler.next_time()
            turns = (event, self._uart.next_time(event), cycle)
            stop = min(turn for turn in turns if turn is not None)
            if stop == NEVER:
                return
            scheduler.run_until(max(stop, scheduler.now))
            self._uart.run()
