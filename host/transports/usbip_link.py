"""A USB/IP server as a client sees it: which devices it offers, and the transfers of one that it has given.

Two threads carry the bytes of a connection. An exception in the main thread, such as Ctrl-C, could otherwise cut a
command in two, after which no device would understand the rest. All that they share with callers is changed by single
operations of built-in types, so that an interrupted caller holds no lock that they need.
"""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import count
from queue import Empty, SimpleQueue
from threading import Event, RLock, Thread
from typing import TypeVar
from weakref import finalize, ref

from usb.core import USBError, USBTimeoutError

from ...base.errors import DeviceNotFoundError
from ...protocol.requests import DIRECTION_IN, Setup
from ...protocol.usbip import (
    ANSWER_BYTES,
    MOST_URB_BYTES,
    Importing,
    ImportStatus,
    Listing,
    Offer,
    Submit,
    Unlink,
    encode_command,
    encode_request,
    read_answer,
    read_import,
    read_list,
)

__all__ = ["Urb", "UsbIpLink", "offers", "take"]

Reply = TypeVar("Reply")

SERVER_SECONDS = 10.0
"""For a server to connect and to answer a request."""
END_SECONDS = 1.0
"""For cancelled transfers to end; a server that needs longer is disconnected. So one that has fallen silent is noticed
within 2 s: a request may take one (`usb_find.REQUEST_MS`)."""
CHUNK_BYTES = 1 << 17
MOST_REPLY_BYTES = 1 << 20

TAKEN_BACK, GONE = -104, -19
"""Linux's ECONNRESET and ENODEV."""
ERRNOS = {-19: errno.ENODEV, -32: errno.EPIPE, -75: errno.EOVERFLOW, -108: errno.ENODEV}
"""Of Linux's numbers, as libusb has it; all others are an I/O error."""
REASONS: dict[int, str] = {
    ImportStatus.NOT_AVAILABLE: "it is not available now",
    ImportStatus.BUSY: "another client has it; detach it there",
    ImportStatus.NO_DEVICE: "there is no such device",
}
NO_SETUP = Setup(0, 0, 0, 0, 0)


def offers(host: str, port: int) -> list[Offer]:
    """The devices that a server offers; raises `DeviceNotFoundError` if it does not tell."""
    line, found = _ask(host, port, Listing(), read_list)
    line.close()
    return found


def take(host: str, port: int, bus_id: str) -> tuple[socket.socket, Offer]:
    """The connection to a device, and the device; raises `DeviceNotFoundError` if the server does not give it."""
    line, found = _ask(host, port, Importing(bus_id), read_import)
    if isinstance(found, Offer):
        return line, found
    line.close()
    raise DeviceNotFoundError(
        f"{host}:{port} does not give device {bus_id}: {REASONS.get(found) or f'it answers with status {found}'}"
    )


def _ask(
    host: str, port: int, request: Listing | Importing, read: Callable[[bytearray], tuple[Reply, int] | None]
) -> tuple[socket.socket, Reply]:
    """Connect to a server; returns the connection, without a time-out, and the answer to its first request."""
    try:
        line = socket.create_connection((host, port), timeout=SERVER_SECONDS)
        try:
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            line.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            line.sendall(encode_request(request))
            came = bytearray()
            while (found := read(came)) is None:
                data = line.recv(CHUNK_BYTES)
                if not data or len(came) > MOST_REPLY_BYTES:
                    raise EOFError("it has closed the connection" if not data else "its answer does not end")
                came += data
            line.settimeout(None)
        except BaseException:
            line.close()
            raise
    except (OSError, EOFError, ValueError) as error:
        why = f"it answers with {error}" if isinstance(error, ValueError) else error
        raise DeviceNotFoundError(
            f"the USB/IP server at {host}:{port} cannot be used: {why}; `phasewire emulate` starts one"
        ) from error
    return line, found[0]


class Urb:
    """A transfer, as Linux calls it; it can be submitted again after its end.

    Parameters
    ----------
    link : UsbIpLink
        The connection to the device.
    endpoint : int
        Address of the endpoint, with the bit of its direction.
    data : bytes or int
        The data to send, or the room for those to be received.
    setup : Setup
        The setup stage of a control transfer.
    ends : SimpleQueue, optional
        Receives a token at each end of a transfer; by default one of its own.
    """

    def __init__(
        self,
        link: UsbIpLink,
        endpoint: int,
        data: bytes | int,
        setup: Setup = NO_SETUP,
        ends: SimpleQueue[None] | None = None,
    ) -> None:
        self.endpoint, self.setup = endpoint, setup
        self.data, self.length = (b"", data) if isinstance(data, int) else (data, len(data))
        self.number = 0
        self._link = ref(link)  # so that a transfer that is under way does not keep the connection
        self._ends = ends or SimpleQueue[None]()
        self._result: tuple[int, int, bytes] | None = None  # as one value, which is there or not

    @property
    def ended(self) -> bool:
        """Whether it has ended, well or not."""
        return self._result is not None

    @property
    def _end(self) -> tuple[int, int, bytes]:
        return self._result or (TAKEN_BACK, 0, b"")

    @property
    def timed_out(self) -> bool:
        """Whether it was cancelled before its end."""
        return self._end[0] == TAKEN_BACK

    @property
    def actual(self) -> int:
        """How many bytes were carried."""
        return self._end[1]

    @property
    def left(self) -> int:
        """How many bytes were not carried."""
        return self.length - self.actual

    @property
    def received(self) -> bytes:
        """The data that came."""
        return self._end[2]

    def submit(self) -> None:
        """Begin it; raises `USBError` if the device is gone or the transfer too long."""
        self._result = None
        try:
            if (link := self._link()) is None:
                raise USBError("No such device (it was closed)", None, errno.ENODEV)
            link.submit(self)
        except USBError:
            self.end(GONE)
            raise

    def cancel(self) -> None:
        """Have it end soon, unless it does by itself before."""
        if link := self._link():
            link.unlink(self)

    def wait(self, seconds: float | None) -> bool:
        """Wait for its end, at most so long; whether it came."""
        end = None if seconds is None else time.monotonic() + seconds
        while not self.ended:
            left = None if end is None else max(end - time.monotonic(), 0)
            try:
                self._ends.get(timeout=left)
            except Empty:
                return self.ended
        return True

    def check(self) -> None:
        """Raise `USBError` if it did not end well."""
        if self.timed_out:
            raise USBTimeoutError("Operation timed out", None, errno.ETIMEDOUT)
        if status := self._end[0]:
            raise USBError(f"a transfer ended with status {status}", status, ERRNOS.get(status, errno.EIO))

    def free(self) -> None:
        """Do nothing: the link forgets a transfer when it ends."""

    def end(self, status: int, actual: int = 0, received: bytes = b"") -> None:
        """Note its end, if that is the first."""
        if self._result is None:
            self._result = status, actual, received
            self._ends.put(None)


class UsbIpLink:
    """The connection to one device of a server, until either leaves it; it is closed if it is no longer referred to.

    Parameters
    ----------
    line : socket.socket
        As `take` has returned it.
    device_id : int
        The number of the device in commands.

    Attributes
    ----------
    over : threading.Event
        Whether the connection has ended.
    close : callable
        Leaves the server.
    """

    def __init__(self, line: socket.socket, device_id: int) -> None:
        self._device_id = device_id
        self._numbers = count(1)
        self._turn = RLock()  # for numbers to be sent in their order
        self._under_way: dict[int, Urb] = {}  # by the numbers of both commands, Submit and Unlink
        self._outgoing = SimpleQueue[bytes | None]()
        self.over = Event()
        for work in ((_receive, line, self._under_way, self.over, self._outgoing), (_send, line, self._outgoing)):
            Thread(target=work[0], args=work[1:], name="phasewire usbip", daemon=True).start()
        self.close = finalize(self, _hang_up, line, os.getpid())

    def submit(self, urb: Urb) -> None:
        """Begin a transfer; raises `USBError` as `Urb.submit`."""
        if urb.length > MOST_URB_BYTES:
            raise USBError(f"{urb.length} bytes in a transfer; at most {MOST_URB_BYTES} are taken", None, errno.ENOMEM)
        with self._turn:
            urb.number = number = next(self._numbers)
            command = (number, self._device_id, urb.endpoint, False, False, urb.length, 0, 0, urb.setup, urb.data, 1)
            self._under_way[number] = urb
            self._outgoing.put(encode_command(Submit(*command)))
        if self.over.is_set():  # perhaps since a moment, in which all transfers were ended
            self._under_way.pop(number, None)
            raise USBError("No such device (it may have been disconnected)", None, errno.ENODEV)

    def unlink(self, urb: Urb) -> None:
        """Cancel a transfer, if it is under way."""
        with self._turn:
            if urb.ended:
                return
            number = next(self._numbers)
            self._under_way[number] = urb
            self._outgoing.put(encode_command(Unlink(number, self._device_id, urb.number)))

    def cancel(self, urbs: Iterable[Urb]) -> None:
        """Cancel transfers, and wait for their ends; a server that does not answer is disconnected."""
        pending = list(urbs)
        for urb in pending:
            urb.cancel()
        end = time.monotonic() + END_SECONDS
        for urb in pending:
            if not urb.wait(max(end - time.monotonic(), 0)):
                self.close()
                urb.end(GONE)

    def cancel_all(self) -> None:
        """Cancel all transfers that are under way."""
        self.cancel(sorted(set(self._under_way.copy().values()), key=lambda urb: -urb.number))

    def carry(self, urb: Urb, seconds: float | None) -> None:
        """Carry out a transfer, which is cancelled after a time.

        Raises
        ------
        USBError
            If it could not be begun; `Urb.check` tells of its end.
        """
        urb.submit()
        try:
            in_time = urb.wait(seconds)
        except BaseException:
            self.cancel([urb])
            raise
        if not in_time:
            self.cancel([urb])


def _send(line: socket.socket, outgoing: SimpleQueue[bytes | None]) -> None:
    """Send commands until there is None."""
    with suppress(OSError):  # the other thread notices, too
        while (data := outgoing.get()) is not None:
            line.sendall(data)


def _receive(line: socket.socket, under_way: dict[int, Urb], over: Event, outgoing: SimpleQueue[bytes | None]) -> None:
    """End transfers as the server answers, until the connection ends; then all others."""
    came = bytearray()
    try:
        while data := line.recv(CHUNK_BYTES):
            came += data
            while _end_one(came, under_way):
                pass
    except (OSError, ValueError, KeyError):  # a server that breaks the protocol is disconnected
        pass
    finally:
        over.set()
        outgoing.put(None)
        line.close()
        while under_way:
            under_way.popitem()[1].end(GONE)


def _end_one(came: bytearray, under_way: dict[int, Urb]) -> bool:
    """Take one whole answer from the bytes that came; whether there was one."""
    answer = read_answer(came)
    if answer is None:
        return False
    urb = under_way[answer.number]
    has_data = not answer.unlinked and urb.endpoint & DIRECTION_IN
    if answer.actual > urb.length:
        raise ValueError(f"{answer.actual} bytes where {urb.length} were requested")
    size = ANSWER_BYTES + (answer.actual if has_data else 0)
    if len(came) < size:
        return False
    received = bytes(came[ANSWER_BYTES:size])
    del came[:size], under_way[answer.number]
    if not answer.unlinked:
        urb.end(answer.status, answer.actual, received)
    elif answer.status and urb.number in under_way:  # otherwise its own answer has come, or comes
        del under_way[urb.number]
        urb.end(TAKEN_BACK)
    return True


def _hang_up(line: socket.socket, owner: int) -> None:
    if os.getpid() != owner:
        return  # a copy of this process by os.fork, which shares the connection
    with suppress(OSError):
        line.shutdown(socket.SHUT_RDWR)
