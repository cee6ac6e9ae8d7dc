"""Serial ports by URL, by pyserial: ports of this computer, and ports that are reached over a network.

==================================  =============================================================
``serial:///dev/ttyACM0``           a port of this computer; on Windows ``serial:COM3``
``socket://HOST:PORT``              a port's bytes over TCP
``rfc2217://HOST:PORT``             the same with the port's set-up (RFC 2217)
==================================  =============================================================

All have the option ``?baud=RATE``, which also says how long an answer may take; the two on a network have pyserial's
own options beside it.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, unquote, urlencode, urlsplit

import serial
from serial import rfc2217
from serial.tools import list_ports
from serial.urlhandler import protocol_socket

from ...base.errors import DeviceUrlError
from ...protocol.codes import BLOCK_BYTES
from ...protocol.enumeration import PRODUCT_ID, VENDOR_ID
from ...protocol.framing import BAUD, MAX_FRAME_BYTES, UART_BITS_PER_BYTE
from ...protocol.timing import MICROFRAMES_PER_SECOND, PACKETS_PER_MICROFRAME
from .serial_line import SerialTransport, open_serial_line
from .transport import Found

__all__ = ["RFC2217", "SERIAL", "SOCKET", "port_for_url"]

USB_BYTES_PER_SECOND = PACKETS_PER_MICROFRAME * MICROFRAMES_PER_SECOND * BLOCK_BYTES
"""What USB carries, whatever the baud rate of a port is there (clause SER-014)."""
PEEK_BYTES = 1 << 16
WRITE_SECONDS = 1.0
"""How long a port may take no bytes, beside the time that they need on the line."""
HELD = (
    "ends the connection at once: another client probably holds this line, which serves one at a time; close that one "
    "first"
)

EXAMPLES = {
    "serial": "serial:///dev/ttyACM0 or, on Windows, serial:COM3",
    "socket": "socket://HOST:PORT, such as socket://127.0.0.1:7000",
    "rfc2217": "rfc2217://HOST:PORT, such as rfc2217://127.0.0.1:2217",
}
OPTIONS = {
    "serial": (),
    "socket": ("logging",),
    "rfc2217": ("logging", "ign_set_control", "poll_modem", "timeout"),
}
"""Of pyserial, beside ours."""


def port_for_url(url: str) -> Any:
    """The pyserial port that a URL names, not yet opened; nobody else can have it open meanwhile, if that is known.

    Raises
    ------
    DeviceUrlError
        If the URL is wrong.
    """
    scheme, _, rest = url.partition(":")
    where, _, query = rest.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    baud = _baud(url, options.pop("baud", str(BAUD)))
    for option in options:
        if option not in OPTIONS[scheme]:
            known = ", ".join(("baud", *OPTIONS[scheme]))
            raise DeviceUrlError(f"{url!r}: {scheme}: has no option {option!r}; it has {known}")
    if scheme == "serial":
        return _local(url, unquote(where.removeprefix("//")), baud)
    _check_address(url, scheme)
    # pyserial cannot bound the writes of RFC 2217; the socket does, in 5 s.
    port = Rfc2217Port(baudrate=baud) if scheme == "rfc2217" else _bounded(SocketPort, baud)
    port.port = f"{scheme}:{where}" + (f"?{urlencode(options)}" if options else "")
    return port


def _local(url: str, path: str, baud: int) -> Any:
    if not path:
        raise DeviceUrlError(f"{url!r} names no port; write {EXAMPLES['serial']}")
    port = _bounded(serial.Serial, baud, exclusive=True)
    port.port = path
    for known in _ours():
        if os.path.realpath(known.device) == os.path.realpath(path):
            port.product, port.serial_number = known.product, known.serial_number
            port.bytes_per_second = USB_BYTES_PER_SECOND
    return port


def _bounded(kind: Any, baud: int, **settings: Any) -> Any:
    """A closed port of some kind, with a time-out for writes: as long as two of the longest frames take, and more."""
    seconds = WRITE_SECONDS + 2 * MAX_FRAME_BYTES * UART_BITS_PER_BYTE / baud
    return kind(baudrate=baud, write_timeout=seconds, **settings)


def _baud(url: str, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text)):
        raise DeviceUrlError(f"{url!r}: baud {text!r} is no rate; write bits per second, such as baud={BAUD}")
    return int(text)


def _check_address(url: str, scheme: str) -> None:
    try:
        parts = urlsplit(url)
        complete = bool(parts.hostname and parts.port is not None)
    except ValueError:  # a port that is no number, or too large
        complete = False
    if not complete:
        raise DeviceUrlError(f"{url!r} names no host and port; write {EXAMPLES[scheme]}")


def _disconnect(port: Any) -> None:
    """Let go of a port's connection; pyserial forgets to where the other end has done so before.

    A copy of the process that connected, by os.fork, closes its copy of the socket alone.
    """
    if port.is_open:
        if port.owner == os.getpid():
            with suppress(OSError):
                port._socket.shutdown(socket.SHUT_RDWR)
        port._socket.close()


class Rfc2217Port(rfc2217.Serial):
    """pyserial's port by RFC 2217."""

    refusal = HELD

    def open(self) -> None:
        """Connect."""
        self.owner = os.getpid()
        super().open()

    def close(self) -> None:
        """Disconnect."""
        _disconnect(self)
        if self.owner == os.getpid():
            super().close()
        self.is_open = False


class SocketPort(protocol_socket.Serial):
    """pyserial's port over TCP, without what makes it slow: it waited to send, and told of one byte at a time."""

    refusal, is_connection, has_break = HELD, True, False

    def open(self) -> None:
        """Connect."""
        self.owner = os.getpid()
        super().open()
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Disconnect."""
        _disconnect(self)
        if self.owner == os.getpid():
            super().close()
        self.is_open = False

    @property
    def in_waiting(self) -> int:
        """How many bytes have come."""
        try:
            return len(self._socket.recv(PEEK_BYTES, socket.MSG_PEEK))
        except BlockingIOError:
            return 0


def _ours() -> list[Any]:
    """The ports of this computer that bear our numbers on USB; of others nobody can tell what is connected to them."""
    return [port for port in list_ports.comports() if (port.vid, port.pid) == (VENDOR_ID, PRODUCT_ID)]


def _find_local() -> list[Found]:
    return [
        Found(
            url=f"serial://{port.device}" if port.device.startswith("/") else f"serial:{port.device}",
            product=port.product or "",
            serial=port.serial_number,
            mode="run time",
            firmware="",
            location=port.device,
            problem=_problem(port.device),
        )
        for port in _ours()
    ]


def _problem(path: str) -> str | None:
    if Path(path).exists() and not os.access(path, os.R_OK | os.W_OK):
        return "permission denied; `phasewire doctor` says how to get it"
    return None


def _find_none() -> list[Found]:
    """Nobody can look at a whole network."""
    return []


class PortScheme:
    """Lines over ports of one kind.

    Parameters
    ----------
    find : callable
        Gives those that may lead to a device.
    """

    def __init__(self, find: Callable[[], list[Found]]) -> None:
        self._find = find

    def open(self, url: str) -> SerialTransport:
        """Open the line that a URL names."""
        return open_serial_line(url)

    def find(self) -> list[Found]:
        """The ports that may lead to a device."""
        return self._find()


SERIAL = PortScheme(_find_local)
SOCKET = PortScheme(_find_none)
RFC2217 = PortScheme(_find_none)
