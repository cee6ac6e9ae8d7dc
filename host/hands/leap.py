"""The Leap: hands from the Leap or Ultraleap tracking service by WebSocket, or from recordings of its frames.

The service greets with its version, then sends a frame as often as its camera does. What it sends is not trusted: a
message that is no frame is counted and passed over, a flood is thinned, and sizes have bounds. This source does not
connect again by itself: if the service closes, the reader gets a `TrackerLostError`, and opens the source anew.
"""

from __future__ import annotations

import json
import logging
import math
import re
import socket
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.sync.client import ClientConnection, connect

from ...base.errors import TrackerError, TrackerLostError, TrackerNotFoundError
from ...solver.contact.hand import Hand
from ..transports.transport import Timekeeper
from .frames import HandFrame
from .leap_frames import hands_of, whole
from .leap_recording import PACKED_SUFFIX, SUFFIX, read_leap_recording
from .liveness import MOST_AGE_SECONDS, STEADY_SECONDS
from .recording import PLAYING, played
from .sources import HandSource, LiveHands, Readiness, read_options

__all__ = ["LEAP", "LeapHands", "ServiceClock"]

_websockets = logging.getLogger(f"{__name__}.websockets")
_websockets.addHandler(logging.NullHandler())  # else Python prints what strangers send, with tracebacks

HOST, PORT = "127.0.0.1", 6437
VERSION = 6
"""Of the protocol. Older ones know no joints of fingers."""
FORM = "leap:, leap:HOST:PORT, leap:FILE.json?speed=1&loop=0 or leap:FILE.json.lz?speed=1&loop=0"
POLICIES = ({"background": True}, {"focused": True}, {"optimizeHMD": False})
"""What a client asks for: frames also while its window has no focus, and of a tracker that lies on a table."""
PATIENCE, PROBE_PATIENCE, CLOSE_PATIENCE = 3.0, 0.3, 0.5
"""Seconds for connecting and the greeting; for the same if it is only tried; for taking leave."""
MOST_MESSAGE_BYTES = 2**18
"""A frame of two hands has some 10 kB."""
MOST_QUEUED = 16
"""Messages that wait before the service must."""
MOST_AT_ONCE = 4
"""Messages that were waiting together and are all read. If there are more, it is a flood, and the newest is read."""
MOST_GARBLED = 100
"""Messages in a row that are no frames, before the source gives up."""
MOST_STAMP = 2.0**63
USUAL_RATE, MOST_RATE = 110.0, 1000.0
NO_DEVICE = "no tracker is plugged in or sends pictures, says the service: plug it in, or into another port"
ADVICE = (
    "start the Ultraleap service, and for Gemini (5.0) and newer also UltraleapTrackingWebSocket, which gives its "
    f"frames at port {PORT}; in the control panel of older versions, allow web apps"
)


class Address(NamedTuple):
    """Where a service listens."""

    host: str = HOST
    port: int = PORT

    @classmethod
    def parse(cls, text: str) -> Address:
        """The address that HOST, HOST:PORT or nothing means; raises ValueError if it is none."""
        if not text:
            return cls()
        found = re.fullmatch(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[\w.-]*)(:(?P<port>\d{1,5}))?", text, re.ASCII)
        if found is None or not 0 < (port := int(found["port"] or PORT)) < 2**16:
            raise ValueError(f"{text!r} is no address of a service; such a URL has the form {FORM}")
        return cls(found["host"].strip("[]") or HOST, port)

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


class ServiceClock:
    """Tells by this computer's clock when the service saw a frame, of which it says the microsecond by its own.

    The frame that took the shortest way sets the offset between the clocks, as if it had taken no time at all: what
    all frames need at least, in the camera and the service, cannot be seen from here. A stamp that runs on, but late,
    is that of an old frame. One that jumps back or ahead is of a clock that was set anew, or is sick: the offset is set
    anew once such stamps have kept pace with their arrivals for `STEADY_SECONDS`, and time stands still until then.
    """

    DRIFT = 2e-4
    """By which the clocks may drift apart, in seconds for each second."""
    LONGEST_WAY = 1.0
    """In seconds; a frame that seems to have been longer on its way tells nothing of the offset. One that seems to be
    ahead by `MOST_AGE_SECONDS` does not fit."""
    PACE = 0.05
    """Seconds by which the ways of frames may differ while they keep pace."""

    def __init__(self) -> None:
        self._offset = self._trial = math.inf
        self._arrival = self._last = self._seconds = self._since = -math.inf

    def seen(self, stamp: float, arrival: float) -> float:
        """The time of a frame in seconds, never before that of the frame before it; by the same stamp it is the same.

        Parameters
        ----------
        stamp : float
            The service's time in µs.
        arrival : float
            The arrival in seconds of this computer's clock.
        """
        seconds = stamp * 1e-6
        on_way = arrival - seconds
        if -MOST_AGE_SECONDS < on_way - self._offset < self.LONGEST_WAY:
            self._trial = math.inf
            if seconds <= self._seconds:
                return self._last
            self._offset = min(on_way, self._offset + self.DRIFT * (arrival - self._arrival))
        elif self._offset == math.inf or (self._jumped(seconds, on_way) and self._keeps_pace(on_way, arrival)):
            self._offset = on_way
        elif self._jumped(seconds, on_way):
            return self._last
        self._arrival, self._seconds = arrival, seconds
        self._last = max(seconds + self._offset, self._last)
        return self._last

    def _jumped(self, seconds: float, on_way: float) -> bool:
        """Whether a stamp that does not fit is not just late by the known offset."""
        return seconds <= self._seconds or on_way < self._offset

    def _keeps_pace(self, on_way: float, arrival: float) -> bool:
        """Whether stamps that do not fit have kept pace with their arrivals for long enough."""
        if not abs(on_way - self._trial) <= self.PACE:
            self._trial, self._since = on_way, arrival
        return arrival - self._since >= STEADY_SECONDS


class LeapHands(LiveHands):
    """Hands from a service. The constructor connects.

    Attributes
    ----------
    garbled : int
        Messages that were no frames.
    devices : dict
        What the service has said of its devices, by their ids: whether each is there and sends pictures.

    Raises
    ------
    TrackerNotFoundError
        If nothing answers there.
    TrackerError
        If what answers speaks another protocol.
    """

    def __init__(self, address: Address, patience: float = PATIENCE) -> None:
        super().__init__(f"Leap service at {address}", USUAL_RATE)
        self.garbled = 0
        self.devices: dict[str, bool] = {}
        self._clock = ServiceClock()
        with ExitStack() as opened:
            self._connection = _connected(opened, address, patience)
            self.version = _greeting(self._connection, address, patience)
            self._closing = opened.pop_all()
        self._thread = Thread(target=self._receive, name="leap", daemon=True)

    def begin(self) -> LeapHands:
        """Ask for frames, and receive them from now on."""
        with suppress(ConnectionClosed):  # the thread meets it too, after the frames that came before
            for policy in POLICIES:
                self._connection.send(json.dumps(policy))
        self._thread.start()
        return self

    def close(self) -> None:
        """Take leave of the service."""
        super().close()
        self._closing.close()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_PATIENCE + 1)

    def _receive(self) -> None:
        """Take messages until the connection ends."""
        garbled = 0
        try:
            while garbled < MOST_GARBLED:
                for message in self._waiting():
                    garbled = 0 if self._take(message) else garbled + 1
        except ConnectionClosed as error:
            why = f"has closed the connection: {error}; see that it runs, and begin again"
            self.end(TrackerLostError(f"the {self.name} {why}"))
        else:
            self.end(TrackerLostError(f"the {self.name} sends messages that are no frames; {ADVICE}"))
        finally:
            self.end()

    def _waiting(self) -> list[str | bytes]:
        """The next message and those that wait with it; only the newest if there are too many to read them all."""
        messages = [self._connection.recv()]
        while len(messages) < MOST_QUEUED:
            try:
                messages.append(self._connection.recv(timeout=0))
            except (TimeoutError, ConnectionClosed):  # the latter comes again with the next call
                break
        if len(messages) > MOST_AT_ONCE:
            with self._changed:
                self.dropped += len(messages) - 1
            del messages[:-1]
        return messages

    def _take(self, message: str | bytes) -> bool:
        """Hand over a frame or remember an event; whether the message was one of them."""
        arrival = time.monotonic()
        try:
            said = _parsed(message)
            if "event" in said:
                self._hear(said["event"])
            elif "version" not in said:
                number, stamp = _mark(said)
                hands, notes = hands_of(said)
                rate = said.get("currentFrameRate")
                self.rate = float(rate) if isinstance(rate, (int, float)) and 1 <= rate <= MOST_RATE else self.rate
                self.put(HandFrame(self._clock.seen(stamp, arrival), hands, number, notes))
        except ValueError:
            self.garbled += 1
            return False
        return True

    def _hear(self, event: object) -> None:
        """Remember what an event says of a device."""
        state = event.get("state") if isinstance(event, dict) else None
        if isinstance(state, dict) and len(self.devices) < MOST_QUEUED:
            attached, streaming = state.get("attached"), state.get("streaming")
            self.devices[str(state.get("id"))[:40]] = attached is True and streaming is not False
            self.notes = () if any(self.devices.values()) else (NO_DEVICE,)


def _connected(opened: ExitStack, address: Address, patience: float) -> ClientConnection:
    """A WebSocket to a service, which is closed with the stack."""
    try:
        line = socket.create_connection(address, timeout=patience)
    except OSError as error:
        raise TrackerNotFoundError(f"no Leap service at {address}: {error.strerror or error}; {ADVICE}") from error
    try:
        return opened.enter_context(
            connect(
                f"ws://{address}/v{VERSION}.json",
                sock=line,  # and through no proxy
                compression=None,
                open_timeout=patience,
                close_timeout=CLOSE_PATIENCE,
                ping_interval=None,  # a service that answers no ping may still send frames
                max_size=MOST_MESSAGE_BYTES,
                max_queue=MOST_QUEUED,
                logger=_websockets,
            )
        )
    except (WebSocketException, OSError, EOFError, ValueError, AssertionError) as error:  # the last one by a flood
        why = str(error) or "it does not answer as a web server"
        raise TrackerNotFoundError(f"what listens at {address} is no Leap service: {why}; {ADVICE}") from error


def _greeting(connection: ClientConnection, address: Address, patience: float) -> str:
    """The version of the service, which its first message says."""
    try:
        said = _parsed(connection.recv(timeout=patience))
    except (TimeoutError, ValueError, ConnectionClosed) as error:
        raise TrackerNotFoundError(
            f"what listens at {address} does not greet as a Leap service: {error}; {ADVICE}"
        ) from error
    version = said.get("version")
    if version != VERSION:
        advice = "install the Leap software 2.3 or newer, or UltraleapTrackingWebSocket"
        if isinstance(version, int) and version > VERSION:
            advice = f"that is newer than phasewire knows: update phasewire, or run a service that speaks {VERSION}"
        raise TrackerError(
            f"the Leap service at {address} speaks version {str(version)[:20]} of its protocol, not {VERSION}; {advice}"
        )
    return str(said.get("serviceVersion", "unknown"))[:40]


def _parsed(message: str | bytes) -> dict[str, Any]:
    """An object of JSON; raises ValueError if it is none."""
    try:
        said = json.loads(message)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    if not isinstance(said, dict):
        raise ValueError("it is no object of JSON")
    return said


def _mark(said: Mapping[str, Any]) -> tuple[int, float]:
    """The id and the time stamp of a frame; without them a service that hangs would not be noticed."""
    number, stamp = whole(said.get("id")), said.get("timestamp")
    if number is None or not isinstance(stamp, (int, float)) or not abs(stamp) < MOST_STAMP:
        raise ValueError("a frame has a whole number as its id and a number as its timestamp, and this has not")
    return number, float(stamp)


class _Leap:
    form = FORM
    help = "Hands from a Leap or Ultraleap tracker by its service, or from a recording of its frames."

    def open(self, rest: str, clock: Timekeeper) -> HandSource:
        """Connect to a service, or read a file."""
        if rest.partition("?")[0].lower().endswith((SUFFIX, PACKED_SUFFIX)):
            where, options = read_options(rest, PLAYING, FORM)
            recording = read_leap_recording(Path(where))
            return played(f"the Leap's recording {where}", recording.frames, recording.rate, options, clock)
        address = Address.parse(rest)
        Hand.flat()  # loads what hands are computed with, which takes a second, before frames come
        return LeapHands(address).begin()

    def probe(self) -> Readiness:
        """Whether a service answers at the usual place."""
        try:
            source = LeapHands(Address(), PROBE_PATIENCE)
        except TrackerError as error:
            return Readiness(False, str(error))
        with source:
            return Readiness(True, f"{source.name}, version {source.version}, answers")


LEAP = _Leap()
"""What opens URLs that begin with ``leap:``."""
