"""What strangers do to a listening socket on loopback, bounded in number and time."""

from __future__ import annotations

import os
import resource
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

CROWD = 100
PATIENCE = 5.0


def _connect(port: int, crowd: ExitStack) -> socket.socket:
    return crowd.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE))


def idle(port: int, crowd: ExitStack) -> None:
    """Many connect and say nothing."""
    for _ in range(CROWD):
        _connect(port, crowd)


def half_open(port: int, crowd: ExitStack) -> None:
    """Many begin a greeting, as all doors have it, and say no more."""
    for number in range(CROWD):
        with suppress(OSError):  # it was turned away
            _connect(port, crowd).sendall((b"\x01", b"\0\0", b"GET /")[number % 3])


def garbage(port: int, crowd: ExitStack) -> None:
    for byte in (b"\0", b"\xff", b"\r\n", b"A"):
        with suppress(OSError):
            _connect(port, crowd).sendall(byte * 5000)


def resets(port: int, crowd: ExitStack) -> None:
    for _ in range(CROWD):
        with socket.create_connection(("127.0.0.1", port), PATIENCE) as line:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def no_files(place: int | str, crowd: ExitStack) -> None:
    """One connects with the last file that this process may open."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    crowd.callback(resource.setrlimit, resource.RLIMIT_NOFILE, limits)
    line = crowd.enter_context(socket.socket(socket.AF_UNIX if isinstance(place, str) else socket.AF_INET))
    resource.setrlimit(resource.RLIMIT_NOFILE, (line.fileno() + 40, limits[1]))
    with suppress(OSError):
        for _ in range(CROWD):
            crowd.callback(os.close, os.dup(line.fileno()))
    line.connect(place if isinstance(place, str) else ("127.0.0.1", place))


ATTACKS: list[Callable[[int, ExitStack], None]] = [idle, half_open, garbage, resets, no_files]


@contextmanager
def attacked(attack: Callable[[int, ExitStack], None], port: int) -> Iterator[ExitStack]:
    """Run an attack; its connections last until the stack is closed."""
    with ExitStack() as crowd:
        attack(port, crowd)
        yield crowd
