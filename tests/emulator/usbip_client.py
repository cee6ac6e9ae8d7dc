"""A USB/IP client, written from the Linux kernel's Documentation/usb/usbip_protocol.rst and nothing else.

It speaks over anything that can send bytes and wait for a number of them.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable
from typing import NamedTuple

GET_DESCRIPTOR, SET_CONFIGURATION = 6, 9


class Listed(NamedTuple):
    bus_id: str
    bus: int
    number: int
    speed: int
    vendor: int
    product: int
    interfaces: list[bytes]


class Answer(NamedTuple):
    """A RET_SUBMIT or a RET_UNLINK."""

    command: int
    number: int
    status: int
    length: int
    data: bytes


def setup(request_type: int, request: int, value: int, index: int, length: int) -> bytes:
    return struct.pack("<BBHHH", request_type, request, value, index, length)


def client_on(connection: socket.socket) -> Client:
    """A client that speaks over a socket."""

    def receive(count: int) -> bytes:
        data = b""
        while len(data) < count:
            try:
                part = connection.recv(count - len(data))
            except ConnectionResetError:  # we had sent something more
                part = b""
            if not part:
                raise EOFError
            data += part
        return data

    return Client(connection.sendall, receive)


class Client:
    """One connection.

    Parameters
    ----------
    send : callable
        Sends bytes.
    receive : callable
        Waits for a number of bytes; raises `EOFError` if the connection ends before.
    """

    def __init__(self, send: Callable[[bytes], object], receive: Callable[[int], bytes]) -> None:
        self.send = send
        self.receive = receive
        self.device_id = 0
        self.number = 0x1000
        self._asked: dict[int, bool] = {}  # whether a command's transfer goes in
        self._early: dict[int, Answer] = {}

    def list(self) -> list[Listed]:
        self.send(struct.pack(">HHI", 0x0111, 0x8005, 0))
        version, code, status, count = struct.unpack(">HHII", self.receive(12))
        assert (version, code, status) == (0x0111, 0x0005, 0)
        found = []
        for _ in range(count):
            listed, interfaces = self._device()
            found.append(listed._replace(interfaces=[self.receive(4) for _ in range(interfaces)]))
        return found

    def attach(self, bus_id: str) -> int:
        """Ask for a device; returns 0 or the error."""
        self.send(struct.pack(">HHI32s", 0x0111, 0x8003, 0, bus_id.encode()))
        version, code, status = struct.unpack(">HHI", self.receive(8))
        assert (version, code) == (0x0111, 0x0003)
        if status == 0:
            listed, _ = self._device()
            assert listed.bus_id == bus_id
            self.device_id = listed.bus << 16 | listed.number
        return int(status)

    def _device(self) -> tuple[Listed, int]:
        fields = struct.unpack(">256s32sIIIHHHBBBBBB", self.receive(312))
        bus_id = fields[1].rstrip(b"\0").decode()
        bus, number, speed, vendor, product = fields[2:7]
        return Listed(bus_id, bus, number, speed, vendor, product, []), fields[13]

    def submit(
        self,
        endpoint: int,
        length: int,
        data: bytes = b"",
        setup: bytes = bytes(8),
        flags: int = 0,
        number: int | None = None,
    ) -> int:
        """Begin a transfer; returns the number of its command. The endpoint has the bit 80h of its direction."""
        self.number = self.number + 1 if number is None else number
        is_in = endpoint >= 0x80
        self._asked[self.number] = is_in
        head = struct.pack(">5I", 1, self.number, self.device_id, is_in, endpoint & 15)
        self.send(head + struct.pack(">IIIII", flags, length, 0, 0xFFFF_FFFF, 0) + setup + data)
        return self.number

    def unlink(self, target: int, number: int | None = None) -> int:
        """Cancel a transfer; returns the number of the command."""
        self.number = self.number + 1 if number is None else number
        self.send(struct.pack(">6I24x", 2, self.number, self.device_id, 0, 0, target))
        return self.number

    def answer(self) -> Answer:
        """The next answer of the server."""
        command, number, *zeros, status, length, _, _, _ = struct.unpack(">5IiIIII8x", self.receive(48))
        assert zeros == [0, 0, 0]
        if command == 4:
            return Answer(command, number, status, 0, b"")
        assert command == 3
        return Answer(command, number, status, length, self.receive(length) if self._asked[number] else b"")

    def wait_for(self, number: int) -> Answer:
        """The answer to a command, whatever comes before it."""
        while number not in self._early:
            answer = self.answer()
            self._early[answer.number] = answer
        return self._early.pop(number)

    def request(self, request_type: int, request: int, value: int = 0, index: int = 0, length: int = 0) -> Answer:
        """Make a control request without data for the device."""
        endpoint = 0x80 if request_type >= 0x80 and length else 0x00
        stage = setup(request_type, request, value, index, length)
        return self.wait_for(self.submit(endpoint, length, setup=stage))

    def descriptor(self, kind: int, length: int, index: int = 0, language: int = 0) -> bytes:
        answer = self.request(0x80, GET_DESCRIPTOR, kind << 8 | index, language, length)
        assert answer.status == 0, answer
        return answer.data

    def enumerate(self) -> bytes:
        """Enumerate a new device as Linux does; returns its configuration."""
        first = self.descriptor(1, 64)
        assert self.descriptor(1, 18) == first[:18]
        head = self.descriptor(2, 9)
        (total,) = struct.unpack_from("<H", head, 2)
        configuration = self.descriptor(2, total)
        assert self.request(0x00, SET_CONFIGURATION, 1).status == 0
        return configuration

    def write(self, endpoint: int, data: bytes) -> Answer:
        return self.wait_for(self.submit(endpoint, len(data), data))

    def read(self, endpoint: int, length: int) -> Answer:
        return self.wait_for(self.submit(endpoint, length))
