"""A line that carries transfers by itself while the device's time passes, as a kernel or a USB/IP client does.

The bus is the emulator's, the time is the device's: what a stream meets here does not depend on this computer.
"""

from __future__ import annotations

from math import ceil

from phasewire import Emulator
from phasewire.emulator.doors.device_time import DeviceTime
from phasewire.emulator.doors.usb_bus import Transfer, UsbBus
from phasewire.protocol.board import CORE_HZ
from phasewire.protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Request
from phasewire.protocol.enumeration import CONFIGURATION_VALUE, ENDPOINT_IN, ENDPOINT_OUT
from phasewire.protocol.requests import Setup

MOST_OUT, MOST_IN = 8, 4
STEP_SECONDS = 0.0001
NO_SETUP = Setup(0, 0, 0, 0, 0)


class BusLine:
    """A transport to an emulated device in this process, which holds several transfers.

    Parameters
    ----------
    emulator : Emulator
        The device.

    Attributes
    ----------
    pauses : list of (float, float)
        The begin and the end of each time in which blocks stay on their way to the device, in its seconds.
    """

    name, serial, lossy, posts = "device on a bus", "", False, True
    most_blocks_per_second = float("inf")

    def __init__(self, emulator: Emulator) -> None:
        self._scheduler = emulator.scheduler
        self.time = DeviceTime(self._scheduler, self._pass_until)
        self.pauses: list[tuple[float, float]] = []
        self._records = bytearray()
        self._outs = self._ins = 0
        self._answer: bytes | None = None
        emulator.usb.reset()
        self._bus = UsbBus(emulator.usb, self._scheduler)
        self._control(Setup(0x00, 9, CONFIGURATION_VALUE, 0, 0))

    def _pass_until(self, cycle: int) -> None:
        while self._scheduler.now < cycle:
            turn = self._bus.next_time(self._scheduler.next_time())
            self._scheduler.run_until(cycle if turn is None else min(turn, cycle))
            self._bus.run()

    def _submit(self, endpoint: int, length: int, data: bytes = b"", setup: Setup = NO_SETUP) -> None:
        transfer = Transfer(endpoint, length, data, setup, False, False, lambda ended, _: self._end(ended))
        now = self.time.monotonic()
        arrives = max((end for begin, end in self.pauses if data and begin <= now < end), default=now)
        if arrives == now:
            self._bus.submit(transfer)
        else:
            self._scheduler.at(ceil(arrives * CORE_HZ), lambda: self._bus.submit(transfer))

    def _end(self, transfer: Transfer) -> None:
        if transfer.endpoint == ENDPOINT_IN:
            self._records += transfer.received
            self._ins -= 1
        elif transfer.endpoint == ENDPOINT_OUT:
            self._outs -= 1
        else:
            self._answer = bytes(transfer.received)

    def _control(self, setup: Setup) -> bytes:
        self._answer = None
        self._submit(0x80 if setup.is_in else 0x00, setup.length, setup=setup)
        while self._answer is None:
            self.time.sleep(STEP_SECONDS)
        return self._answer

    def window(self, _free: int | None, records: int) -> int:
        return 4 * records

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        end = self.time.monotonic() + seconds
        while self._outs == MOST_OUT:
            if self.time.monotonic() > end:
                return 0
            self.time.sleep(STEP_SECONDS)
        self._submit(ENDPOINT_OUT, len(blocks), blocks)
        self._outs += 1
        return len(blocks)

    def read_records(self, seconds: float) -> bytes:
        end = self.time.monotonic() + seconds
        while True:
            while self._ins < MOST_IN:
                self._submit(ENDPOINT_IN, 2048)
                self._ins += 1
            if self._records or self.time.monotonic() >= end:
                records = bytes(self._records)
                self._records.clear()
                return records
            self.time.sleep(STEP_SECONDS)

    def take_back(self) -> int:
        return 0

    def query(self, request: Request, size: int) -> bytes:
        return self._control(Setup(REQUEST_TYPE_IN, request, 0, 0, size))

    def command(self, request: Request, value: int = 0) -> None:
        self._control(Setup(REQUEST_TYPE_OUT, request, value, 0, 0))

    def reopen(self, seconds: float) -> None:
        raise NotImplementedError

    def close(self) -> None: ...
