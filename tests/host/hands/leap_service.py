"""A Leap service that says what a test wants, and frames as the service writes them."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import Server, ServerConnection, serve

PATIENCE = 20.0  # seconds

Attempted = TypeVar("Attempted")


def outcome(attempt: Callable[[], Attempted]) -> Attempted | ValueError:
    """The result of an attempt, or the ValueError that it raises."""
    try:
        return attempt()
    except ValueError as error:
        return error


GREETING = json.dumps({"serviceVersion": "2.3.1+33747", "version": 6})
KNUCKLES = 66.0
"""Between the outer ones, in mm."""
_ACROSS = np.linspace(-KNUCKLES / 2, KNUCKLES / 2, 4)
FLAT = {
    0: [[-25, 0, 55], [-55, 0, 20], [-70, 0, -5], [-80, 0, -25]],
    **{kind: [[x, 0, z] for z in (-20, -60, -85, -105)] for kind, x in enumerate(_ACROSS.tolist(), start=1)},
}
"""Joints of a right hand around its palm, whose fingers point away from the user: mm by the Leap's axes."""
NAMES = ("mcpPosition", "pipPosition", "dipPosition", "tipPosition")


def leap_frame(
    number: int = 7, stamp: float = 5e6, hands: Mapping[int, str] | None = None, palm: Iterable[float] = (10, 170, -30)
) -> dict[str, Any]:
    """A frame with the names that the public recordings have; hands by their ids."""
    centre = np.array([*palm])
    said: dict[str, Any] = {"id": number, "timestamp": stamp, "currentFrameRate": 110.5, "hands": [], "pointables": []}
    for hand, side in ({4: "right"} if hands is None else hands).items():
        mirror = np.array([1 if side == "right" else -1, 1, 1])
        said["hands"].append(
            {
                "id": hand,
                "type": side,
                "confidence": 1,
                "direction": [0, 0, -1],
                "palmNormal": [0, -1, 0],
                "palmPosition": centre.tolist(),
                "palmVelocity": [0, 0, 0],
            }
        )
        for kind, joints in FLAT.items():
            places = dict(zip(NAMES, (np.array(joints) * mirror + centre).tolist(), strict=True))
            finger = {"id": hand * 10 + kind, "handId": hand, "type": kind, "tool": False, "width": 18.0}
            said["pointables"].append(finger | places)
    return said


class LeapService:
    """A service at a port of loopback, for one connection after another.

    Parameters
    ----------
    script : callable
        What it does once it has greeted: it gets the connection, and the service closes it when this returns.
    greeting : str, optional
        Its first message; none if this is None.
    """

    def __init__(self, script: Callable[[ServerConnection], object], greeting: str | bytes | None = GREETING) -> None:
        self._script, self._greeting = script, greeting
        self.paths: list[str] = []
        self.over = threading.Event()
        self._server: Server = serve(self._serve, "127.0.0.1", 0, compression=None, close_timeout=1)
        self.port: int = self._server.socket.getsockname()[1]
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.over.set()
        self._server.shutdown()
        self._thread.join(PATIENCE)

    @property
    def url(self) -> str:
        return f"leap:127.0.0.1:{self.port}"

    def _serve(self, connection: ServerConnection) -> None:
        assert connection.request is not None
        self.paths.append(connection.request.path)
        try:
            if self._greeting is not None:
                connection.send(self._greeting)
            self._script(connection)
        except ConnectionClosed:
            pass  # by the client

    def stall(self, _connection: ServerConnection) -> None:
        """Say nothing until the test ends."""
        self.over.wait(PATIENCE)


def sending(*messages: str | bytes | dict[str, Any]) -> Callable[[ServerConnection], None]:
    """A script: messages, then nothing until the client leaves."""

    def script(connection: ServerConnection) -> None:
        for message in messages:
            connection.send(json.dumps(message) if isinstance(message, dict) else message)
        for _ in connection:
            pass

    return script
