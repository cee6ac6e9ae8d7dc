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
from serial.tools import list_ports
from serial.urlhandler import protocol_socket

from ..errors import DeviceNotFoundError
from ..protocol.codes import BLOCK_BYTES
from ..protocol.enumeration import PRODUCT_ID, VENDOR_ID
from ..protocol.framing import BAUD, MAX_FRAME_BYTES, UART_BITS_PER_BYTE
from ..protocol.timing import MICROFRAMES_PER_SECOND, PACKETS_PER_MICROFRAME
from .serial_line import SerialTransport, open_serial_line
from .transport import Found

__all__ = ["RFC2217", "SERIAL", "SOCKET", "port_for_url"]

USB_BYTES_PER_SECOND = PACKETS_PER_MICROFRAME * MICROFRAMES_PER_SECOND * BLOCK_BYTES
"""What USB carries, whatever the baud rate of a port is there (clause SER-014)."""
PEEK_BYTES = 1 << 16
WRITE_SECONDS = 1.0
"""How long a port may take no bytes, beside the time that they need on the line."""

EXAMPLES = {
    "serial": "serial:///dev/ttyACM0 or, on Windows, serial:COM3",
    "socket": "socket://HOST:PORT, such as socket://127.0.0.1:7000",
    "rfc2217": "rfc2217://HOST:PORT, such as rfc2217://127.0.0.1:2217",
}


def port_for_url(url: str) -> Any:
    """The pyserial port that a URL names, not yet opened; nobody else can have it open meanwhile, where that is known.

    Raises
    ------
    DeviceNotFoundError
        Where the URL is wrong.
    """
    scheme, _, rest = url.partition(":")
    where, _, query = rest.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    baud = _baud(url, options.pop("baud", str(BAUD)))
    if scheme == "serial":
        return _local(url, unquote(where.removeprefix("//")), options, baud)
    _check_address(url, scheme)
    address = f"{scheme}:{where}" + (f"?{urlencode(options)}" if options else "")
    if scheme == "socket":
        port = SocketPort(baudrate=baud, write_timeout=_write_timeout(baud))
        port.port = address
        return port
    return serial.serial_for_url(address, do_not_open=True, baudrate=baud)  # it cannot have a time-out for writes


def _local(url: str, path: str, options: dict[str, str], baud: int) -> Any:
    if not path:
        raise DeviceNotFoundError(f"{url!r} names no port; write {EXAMPLES['serial']}")
    for option in options:
        raise DeviceNotFoundError(f"{url!r}: a serial port has no option {option!r}; it has baud=RATE")
    port = serial.Serial(baudrate=baud, exclusive=True, write_timeout=_write_timeout(baud))
    port.port = path
    for known in _ours():
        if Path(known.device).resolve() == Path(path).resolve():
            port.product, port.serial_number = known.product, known.serial_number
            port.bytes_per_second = USB_BYTES_PER_SECOND
    return port


def _write_timeout(baud: int) -> float:
    return WRITE_SECONDS + 2 * MAX_FRAME_BYTES * UART_BITS_PER_BYTE / baud


def _baud(url: str, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text)):
        raise DeviceNotFoundError(f"{url!r}: baud {text!r} is no rate; write bits per second, such as baud={BAUD}")
    return int(text)


def _check_address(url: str, scheme: str) -> None:
    try:
        parts = urlsplit(url)
        complete = bool(parts.hostname and parts.port is not None)
    except ValueError:  # a port that is no number, or too large
        complete = False
    if not complete:
        raise DeviceNotFoundError(f"{url!r} names no host and port; write {EXAMPLES[scheme]}")


class SocketPort(protocol_socket.Serial):
    """pyserial's port over TCP, without what makes it slow: it waited to send, and told of one byte at a time."""

    def open(self) -> None:
        """Connect."""
        super().open()
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def close(self) -> None:
        """Disconnect, also where the other end has done so before."""
        if self.is_open:
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)
            self._socket.close()
        super().close()

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
