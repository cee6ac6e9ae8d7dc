"""The program that carries a guest's connection to a server."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from pathlib import Path

from phasewire.hil.conformance import guest

RELAY = Path(guest.__file__).with_name("relay.py")
MANY = bytes(range(256)) * (1 << 14)  # 4 MiB, more than sockets hold
SECONDS = 30.0


def test_both_ends_may_send_much_before_they_read(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as far, socket.create_server(("127.0.0.1", 0)) as near:
        (tmp_path / "port").write_text(str(far.getsockname()[1]))
        client = socket.create_connection(near.getsockname(), SECONDS)
        theirs, _ = near.accept()
        command = [sys.executable, "-I", "-S", str(RELAY), str(tmp_path / "port")]
        with theirs, client, subprocess.Popen(command, stdin=theirs.fileno()) as relay:
            theirs.close()
            far.settimeout(SECONDS)
            server, _ = far.accept()
            server.settimeout(SECONDS)
            with server:
                senders = [threading.Thread(target=end.sendall, args=(MANY,)) for end in (client, server)]
                for sender in senders:
                    sender.start()
                assert receive(server, len(MANY)) == MANY
                assert receive(client, len(MANY)) == MANY
                for sender in senders:
                    sender.join(SECONDS)
            assert client.recv(1) == b""  # the server has gone
            assert relay.wait(SECONDS) == 0


def receive(end: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count and (part := end.recv(1 << 20)):
        data += part
    return data
