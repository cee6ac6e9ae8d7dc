"""A line to a device that a USB/IP server offers: what a kernel does between a program and such a device, at its least.

It makes phasewire's own emulator in another process reachable by USB without a kernel's help, so that both contestants
can stream through a socket. One transfer is on its way at a time. The layouts are those of the Linux kernel's
Documentation/usb/usbip_protocol.rst.
"""

from __future__ import annotations

import socket
import struct
import time
from itertools import count

from phasewire.host.lines.transport import Timekeeper
from phasewire.protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Request, StandardRequest
from phasewire.protocol.enumeration import CONFIGURATION_VALUE, ENDPOINT_IN, ENDPOINT_OUT
from phasewire.protocol.requests import DIRECTION_IN, Setup

VERSION, IMPORT, SUBMIT = 0x0111, 0x8003, 1
REQUEST, REPLY_HEAD, DEVICE = struct.Struct(">HHI32s"), struct.Struct(">HHI"), struct.Struct(">288xII16x")
COMMAND, ANSWER = struct.Struct(">9Ii8s"), struct.Struct(">5IiI20x")
READ_BYTES = 32 * BLOCK_BYTES
NO_SETUP = bytes(8)


class UsbIpLine:
    """A transport to a device, for a host that waits for every answer.

    Parameters
    ----------
    port : int
        Of the server on this machine.
    bus_id : str
        Of the device.
    """

    name = "device by USB/IP"
    serial = ""
    lossy = False
    most_blocks_per_second = float("inf")
    time: Timekeeper = time

    def __init__(self, port: int, bus_id: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._file = self._socket.makefile("rb")
        self._numbers = count(1)
        self._socket.sendall(REQUEST.pack(VERSION, IMPORT, 0, bus_id.encode()))
        *_, status = REPLY_HEAD.unpack(self._file.read(REPLY_HEAD.size))
        if status:
            raise ConnectionError(f"device {bus_id} cannot be had: status {status}")
        bus, device = DEVICE.unpack(self._file.read(DEVICE.size))
        self._device = bus << 16 | device
        setup = Setup(0, StandardRequest.SET_CONFIGURATION, CONFIGURATION_VALUE, 0, 0)
        self._transfer(0, setup=setup.encode())

    def _transfer(self, endpoint: int, data: bytes = b"", room: int = 0, setup: bytes = NO_SETUP) -> bytes:
        """Make one transfer, and wait for what comes of it."""
        number, is_in = next(self._numbers), bool(endpoint & DIRECTION_IN)
        length = room if is_in else len(data)
        head = COMMAND.pack(SUBMIT, number, self._device, is_in, endpoint & 0x0F, 0, length, 0, 2**32 - 1, 0, setup)
        self._socket.sendall(head + data)
        *_, status, actual = ANSWER.unpack(self._file.read(ANSWER.size))
        if status or (actual != length and not is_in):
            raise ConnectionError(f"a transfer at endpoint {endpoint:#x} ended after {actual} bytes with {status}")
        return self._file.read(actual) if is_in else b""

    def window(self, _free: int | None, records: int) -> int:
        """As many as the device can acknowledge."""
        return records

    def write_blocks(self, blocks: bytes, _seconds: float) -> int:
        """Send blocks in one transfer."""
        self._transfer(ENDPOINT_OUT, blocks)
        return len(blocks)

    def read_records(self, _seconds: float) -> bytes:
        """Wait for acknowledgements."""
        return self._transfer(ENDPOINT_IN, room=READ_BYTES)

    def ask(self, request: Request, size: int) -> bytes:
        """Make a control request that is answered."""
        setup = Setup(REQUEST_TYPE_IN, request, 0, 0, size)
        return self._transfer(DIRECTION_IN, room=size, setup=setup.encode())

    def order(self, request: Request, value: int = 0) -> None:
        """Make a control request that is only carried out."""
        self._transfer(0, setup=Setup(REQUEST_TYPE_OUT, request, value, 0, 0).encode())

    def reopen(self, _seconds: float) -> None:
        """It does not come back."""
        raise ConnectionError(f"{self.name} is gone")

    def close(self) -> None:
        """Hang up."""
        self._file.close()
        self._socket.close()
