"""Carries one connection of the guest to a server on this computer, without delay.

QEMU starts it for each connection, which is its standard input. TCP would hold back the last piece of a long command
until the one before it is confirmed, and its receiver confirms late: 40 ms for each transfer.
"""

from __future__ import annotations

import socket
import sys
import threading
from pathlib import Path

CHUNK_BYTES = 1 << 18


def main(port_file: str) -> None:
    """Carry bytes both ways until the server ends the connection."""
    guest = socket.socket(fileno=0)
    server = socket.create_connection(("127.0.0.1", int(Path(port_file).read_text())))
    for end in (guest, server):
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    threading.Thread(target=_carry, args=(guest, server), daemon=True).start()
    _carry(server, guest)


def _carry(source: socket.socket, target: socket.socket) -> None:
    try:
        while data := source.recv(CHUNK_BYTES):
            source.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
            target.sendall(data)
        target.shutdown(socket.SHUT_WR)
    except OSError:
        pass  # the connection is over


if __name__ == "__main__":
    main(sys.argv[1])
