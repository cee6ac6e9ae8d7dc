"""A page without a browser, for tests: it speaks with the server as one does, and decodes by its own code."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray
from websockets.sync.client import ClientConnection, connect

PATIENCE = 30.0
"""Seconds, for a busy computer."""
TYPES: dict[str, np.dtype[Any]] = {"u1": np.dtype("u1"), "u4": np.dtype("<u4"), "f4": np.dtype("<f4")}


class Message:
    """What came: its text, and its arrays."""

    def __init__(self, data: bytes) -> None:
        (length,) = struct.unpack_from("<I", data)
        assert (4 + length) % 8 == 0
        self.said: dict[str, Any] = json.loads(data[4 : 4 + length])
        self._payload = data[4 + length :]

    def __getitem__(self, name: str) -> Any:
        return self.said[name]

    def array(self, name: str) -> NDArray[Any]:
        table = self.said["arrays"][name]
        kind, count = TYPES[table["type"]], int(np.prod(table["shape"]))
        assert table["at"] % 4 == 0
        return np.asarray(np.frombuffer(self._payload, kind, count, table["at"]).reshape(table["shape"]))


class Page:
    """One page."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.kept: dict[str, Message] = {}
        self.notices: list[str] = []

    def receive(self) -> Message:
        """The next message; a frame is acknowledged."""
        data = self.socket.recv(timeout=PATIENCE)
        assert isinstance(data, bytes)
        message = Message(data)
        if message["kind"] == "frame":
            self.socket.send("ack")
        elif message["kind"] == "notice":
            self.notices.append(message["text"])
        else:
            self.kept[message["kind"]] = message
        return message

    def frame(self) -> Message:
        """The next frame."""
        while (message := self.receive())["kind"] != "frame":
            pass
        return message

    def until(self, found: Callable[[Message], Any]) -> Message:
        """The first frame for which something holds."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if found(frame := self.frame()):
                return frame
        raise AssertionError(f"no such frame; the last one says {frame.said}, notices {self.notices}")

    def notice(self) -> str:
        """The next notice."""
        seen = len(self.notices)
        while len(self.notices) == seen:
            self.receive()
        return self.notices[-1]

    def set(self, **values: Any) -> None:
        self.socket.send(json.dumps({"set": values}))

    def do(self, what: str, **more: Any) -> None:
        self.socket.send(json.dumps({"do": what} | more))


def address(url: str) -> tuple[str, str]:
    """Host with port, and token, of a page's URL."""
    split = urlsplit(url)
    return split.netloc, split.fragment


@contextmanager
def page_of(url: str, **options: Any) -> Iterator[Page]:
    """A page that is open."""
    host, token = address(url)
    given: dict[str, Any] = {"origin": f"http://{host}", "max_size": None, "proxy": None} | options
    with connect(f"ws://{host}/ws?token={token}", **given) as socket:
        yield Page(socket)
