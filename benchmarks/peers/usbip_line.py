"""A line to a device that a USB/IP server offers: the least that a kernel does between a program and such a device.

It makes phasewire's own emulator in another process reachable by USB without a kernel's help, so that both contestants
can stream through a socket. As a host controller does, it has some transfers on their way at a time. The layouts are
those of the Linux kernel's Documentation/usb/usbip_protocol.rst.
"""

from __future__ import annotations

import json
import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

from phasewire.host.streaming.device import Device
from phasewire.host.transports.transport import Timekeeper
from phasewire.protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Request, StandardRequest
from phasewire.protocol.enumeration import CONFIGURATION_VALUE, ENDPOINT_IN, ENDPOINT_OUT
from phasewire.protocol.requests import DIRECTION_IN, Setup

VERSION, IMPORT, SUBMIT = 0x0111, 0x8003, 1
REQUEST, REPLY_HEAD, DEVICE = struct.Struct(">HHI32s"), struct.Struct(">HHI"), struct.Struct(">288xII16x")
COMMAND, ANSWER = struct.Struct(">9Ii8s"), struct.Struct(">5IiI20x")
READ_BYTES = 4 * BLOCK_BYTES
NO_SETUP = bytes(8)
END_SECONDS = 10.0
MOST_OUT, MOST_IN = 8, 4
"""Transfers on their way at a time."""
WINDOWS = 4
"""How many times as many blocks may be unanswered as the device can acknowledge: NAK holds the rest back."""
PATIENCE_SECONDS = 10.0


@contextmanager
def served(*doors: str) -> Iterator[tuple[dict[str, Any], int]]:
    """A device emulated by a process of its own: what it prints of the device and its doors, and the process's id."""
    command = [sys.executable, "-m", "phasewire", "emulate", *doors, "--json=-"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline()), process.pid
        finally:
            process.terminate()
            try:
                process.wait(END_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()


@contextmanager
def by_usbip() -> Iterator[tuple[Device, int]]:
    """Such a device, by USB/IP, and the id of its process."""
    with (
        served("--usbip", "--port=0") as (found, process),
        Device(UsbIpLine(found["usbip"]["port"], found["devices"][0]["bus_id"])) as device,
    ):
        yield device, process


class UsbIpLine:
    """A transport to a device.

    Parameters
    ----------
    port : int
        Port of the server on this machine.
    bus_id : str
        Bus id of the device.
    """

    name = "device by USB/IP"
    serial = ""
    lossy = False
    posts = True
    most_blocks_per_second = float("inf")
    time: Timekeeper = time

    def __init__(self, port: int, bus_id: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._numbers = count(1)
        self._lengths: dict[int, tuple[int, int]] = {}
        self._came, self._records = bytearray(), bytearray()
        self._outs = self._ins = 0
        self._answer: bytes | None = None
        self._socket.sendall(REQUEST.pack(VERSION, IMPORT, 0, bus_id.encode()))
        *_, status = REPLY_HEAD.unpack(self._received(REPLY_HEAD.size))
        if status:
            raise ConnectionError(f"device {bus_id} cannot be had: status {status}")
        bus, device = DEVICE.unpack(self._received(DEVICE.size))
        self._device = bus << 16 | device
        setup = Setup(0, StandardRequest.SET_CONFIGURATION, CONFIGURATION_VALUE, 0, 0)
        self._control(0, setup)
        for _ in range(MOST_IN):
            self._submit(ENDPOINT_IN, room=READ_BYTES)

    def _received(self, size: int) -> bytes:
        """Wait for so many bytes."""
        while len(self._came) < size:
            self._listen(PATIENCE_SECONDS)
        data = bytes(self._came[:size])
        del self._came[:size]
        return data

    def _listen(self, seconds: float) -> None:
        """Read what has arrived, or arrives in time."""
        if select.select([self._socket], [], [], seconds)[0]:
            data = self._socket.recv(1 << 17)
            if not data:
                raise ConnectionError(f"{self.name} is gone")
            self._came += data

    def _submit(self, endpoint: int, data: bytes = b"", room: int = 0, setup: bytes = NO_SETUP) -> None:
        """Begin a transfer."""
        number, is_in = next(self._numbers), bool(endpoint & DIRECTION_IN)
        length = room if is_in else len(data)
        self._lengths[number] = endpoint, length
        head = COMMAND.pack(SUBMIT, number, self._device, is_in, endpoint & 0x0F, 0, length, 0, 2**32 - 1, 0, setup)
        self._socket.sendall(head + data)

    def _take(self, seconds: float) -> None:
        """Read what has arrived, or arrives in time, and note which transfers have ended."""
        self._listen(seconds)
        while len(self._came) >= ANSWER.size:
            _, number, *_, status, actual = ANSWER.unpack_from(self._came)
            endpoint, length = self._lengths[number]
            is_in = bool(endpoint & DIRECTION_IN)
            size = ANSWER.size + (actual if is_in else 0)
            if len(self._came) < size:
                return
            if status or (actual != length and not is_in):
                raise ConnectionError(f"a transfer at endpoint {endpoint:#x} ended after {actual} bytes with {status}")
            data = bytes(self._came[ANSWER.size : size])
            del self._came[:size], self._lengths[number]
            if endpoint == ENDPOINT_IN:
                self._records += data
                self._submit(ENDPOINT_IN, room=READ_BYTES)
            elif endpoint == ENDPOINT_OUT:
                self._outs -= 1
            else:
                self._answer = data

    def _control(self, endpoint: int, setup: Setup) -> bytes:
        """Make a control transfer, and wait for its end."""
        self._answer = None
        self._submit(endpoint, room=setup.length, setup=setup.encode())
        while self._answer is None:
            self._take(PATIENCE_SECONDS)
        return self._answer

    def window(self, _free: int | None, records: int) -> int:
        """Some times as many as the device can acknowledge."""
        return WINDOWS * records

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks in one transfer, once there are not too many on their way."""
        end = time.monotonic() + seconds
        while self._outs == MOST_OUT:
            left = end - time.monotonic()
            if left < 0:
                return 0
            self._take(left)
        self._submit(ENDPOINT_OUT, blocks)
        self._outs += 1
        return len(blocks)

    def read_records(self, seconds: float) -> bytes:
        """Wait for acknowledgements."""
        self._take(0)
        end = time.monotonic() + seconds
        while not self._records and (left := end - time.monotonic()) > 0:
            self._take(left)
        records = bytes(self._records)
        self._records.clear()
        return records

    def take_back(self) -> int:
        """Do nothing: what was sent stays sent."""
        return 0

    def query(self, request: Request, size: int) -> bytes:
        """Make a control request that is answered."""
        return self._control(DIRECTION_IN, Setup(REQUEST_TYPE_IN, request, 0, 0, size))

    def command(self, request: Request, value: int = 0) -> None:
        """Make a control request that is only carried out."""
        self._control(0, Setup(REQUEST_TYPE_OUT, request, value, 0, 0))

    def reopen(self, _seconds: float) -> None:
        """Raise: such a line does not come back."""
        raise ConnectionError(f"{self.name} is gone")

    def close(self) -> None:
        """Hang up."""
        self._socket.close()
