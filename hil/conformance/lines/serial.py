"""The raw serial line: bytes, frames right or wrong, requests and the console, over a UART or the console's endpoints.

A `Wire` carries the bytes: a port of pyserial, or endpoints 03 and 83 of a device on USB.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from ....errors import DeviceTimeoutError, FrameError
from ....host.lines.serial_line import PORTS
from ....host.lines.transport import Timekeeper, load_by_scheme
from ....protocol.codes import BLOCK_BYTES, FrameKind, Outcome
from ....protocol.framing import CONSOLE_FRAME, DELIMITER, Frame, Line, LineEvent, Mode, SerialReply, encode
from ....protocol.requests import ConsoleRequest, Setup
from .usb import CONSOLE_IN, CONSOLE_OUT, UsbLine

__all__ = ["CdcWire", "PortWire", "SerialLine", "Wire"]

PATIENCE_SECONDS = 0.5
"""For any answer, besides the time that its bytes take; a device has 20 ms (clause SER-013)."""
READ_SECONDS = 0.002
CDC_BYTES_PER_SECOND = 1e6
PROMPT = b"> "


class Wire(Protocol):
    """Bytes both ways."""

    name: str
    time: Timekeeper
    bytes_per_second: float
    has_break: bool
    """Whether it is a UART, whose line can be held low."""

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self, seconds: float) -> bytes:
        """Wait until something comes, or the time is over."""

    def hang_up(self) -> None:
        """Hold the line low for longer than a byte, or lower DTR and raise it again."""

    def reopen(self, seconds: float) -> None:
        """Open it again, once the device has left."""

    def close(self) -> None:
        """Give it back."""


class PortWire:
    """A port of pyserial.

    Parameters
    ----------
    url : str
        By which the host finds ports.
    """

    has_break = True

    def __init__(self, url: str) -> None:
        self._port: Any = load_by_scheme(PORTS, url)(url)
        self.name: str = self._port.name
        self.time: Timekeeper = getattr(self._port, "time", time)
        self.bytes_per_second: float = getattr(self._port, "bytes_per_second", self._port.baudrate / 10)
        self._port.timeout = READ_SECONDS
        self._port.open()

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._port.write(data)

    def read(self, seconds: float) -> bytes:
        """Wait until something comes, or the time is over."""
        end = self.time.monotonic() + seconds
        while True:
            waiting = self._port.in_waiting
            data: bytes = self._port.read(max(waiting, 1))
            if data or self.time.monotonic() >= end:
                return data

    def hang_up(self) -> None:
        """Hold the line low for 20 ms."""
        self._port.send_break(0.02)

    def reopen(self, seconds: float) -> None:
        """Open the port anew."""
        end = self.time.monotonic() + seconds
        self._port.close()
        while True:
            try:
                self._port.open()
            except OSError:
                if self.time.monotonic() >= end:
                    raise
                self.time.sleep(0.05)
            else:
                return

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class CdcWire:
    """The console's endpoints of a device on USB, which begin with text; DTR is set.

    Parameters
    ----------
    usb : UsbLine
        The device.
    """

    has_break = False
    bytes_per_second = CDC_BYTES_PER_SECOND

    def __init__(self, usb: UsbLine) -> None:
        self._usb = usb
        self.name = f"console of {usb.name}"
        self.hang_up()

    @property
    def time(self) -> Timekeeper:
        """The time of the device."""
        return self._usb.time

    def write(self, data: bytes) -> None:
        """Send bytes."""
        if self._usb.write(CONSOLE_OUT, data, PATIENCE_SECONDS) < len(data):
            raise DeviceTimeoutError("the console's endpoint takes no bytes")

    def read(self, seconds: float) -> bytes:
        """Wait until something comes, or the time is over."""
        return self._usb.read(CONSOLE_IN, 16 * BLOCK_BYTES, seconds) or b""

    def set_dtr(self, on: bool) -> None:
        """Set the line state."""
        self._usb.request(Setup(0x21, ConsoleRequest.SET_CONTROL_LINE_STATE, int(on), 1, 0))

    def hang_up(self) -> None:
        """Lower DTR and raise it again."""
        self.set_dtr(False)
        self.set_dtr(True)

    def reopen(self, seconds: float) -> None:
        """The USB line finds the device; DTR is set anew."""
        self.set_dtr(True)

    def close(self) -> None:
        """Lower DTR."""
        self.set_dtr(False)


class SerialLine:
    """A line that frames and the console share; it starts with the console.

    Parameters
    ----------
    wire : Wire

    Attributes
    ----------
    events : list of LineEvent
        All that came since `forget`: text, frames, why others were damaged, modes that began.
    """

    kind = "serial"

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.name = wire.name
        self.events: list[LineEvent] = []
        self._incoming = Line()
        self._taken = 0
        self._tag = 0

    @property
    def time(self) -> Timekeeper:
        """The time of the device."""
        return self.wire.time

    @property
    def mode(self) -> Mode:
        """What the device sends: text or frames."""
        return self._incoming.mode

    def forget(self) -> None:
        """Forget what came."""
        self.events.clear()
        self._taken = 0

    # Bytes

    def write(self, data: bytes) -> None:
        """Send bytes as they are."""
        self.wire.write(data)

    def listen(self, seconds: float, enough: Callable[[], bool] = lambda: False) -> list[LineEvent]:
        """Take in what comes until there is enough, or the time is over; all events since `forget`."""
        end = self.time.monotonic() + seconds
        while not enough():
            left = end - self.time.monotonic()
            if left <= 0:
                break
            self.events += self._incoming.feed(self.wire.read(min(left, READ_SECONDS)))
        return self.events

    def read_bytes(self, seconds: float, until: bytes | None = None) -> bytes:
        """Take in bytes as they are, beside all modes, until some are seen or the time is over."""
        end, found = self.time.monotonic() + seconds, bytearray()
        while (left := end - self.time.monotonic()) > 0:
            data = self.wire.read(min(left, READ_SECONDS))
            found += data
            self.events += self._incoming.feed(data)
            if until is not None and until in found:
                break
        return bytes(found)

    def patience(self, size: int = 0) -> float:
        """How long to wait for an answer, where so many bytes are under way beside it, in seconds."""
        return PATIENCE_SECONDS + (size + 1400) / self.wire.bytes_per_second

    # Modes

    def enter_frames(self) -> None:
        """Go over to frames, whatever the line carries now (clause SER-010)."""
        self.forget()
        self.write(DELIMITER + encode(CONSOLE_FRAME) + DELIMITER)
        self.listen(self.patience(), lambda: self.events[-1:] == [Mode.FRAMES] and self.time_is_quiet())
        if self.mode is not Mode.FRAMES:
            raise DeviceTimeoutError(f"{self.name} does not go over to frames: {self.events!r}")
        self.forget()

    def time_is_quiet(self) -> bool:
        """Whether nothing follows within 3 ms and the time of a few bytes."""
        before = len(self.events)
        end = self.time.monotonic() + 0.003 + 40 / self.wire.bytes_per_second
        while self.time.monotonic() < end:
            self.events += self._incoming.feed(self.wire.read(READ_SECONDS))
        return len(self.events) == before

    def enter_console(self) -> None:
        """Go over to the console, whatever the line carries now, to its prompt (clause SER-010)."""
        self.enter_frames()
        self.write(encode(CONSOLE_FRAME))
        self.read_bytes(self.patience(), until=PROMPT)
        self.forget()

    # Frames

    def send_frame(self, kind: int, body: bytes) -> None:
        """Send a frame behind a zero."""
        self.write(DELIMITER + encode(Frame(FrameKind(kind), body)))

    def frames(self, kind: FrameKind) -> list[bytes]:
        """The bodies of the undamaged frames of a kind that came since `forget`."""
        return [event.body for event in self.events if isinstance(event, Frame) and event.kind is kind]

    @property
    def damaged(self) -> list[FrameError]:
        """Why frames that came were damaged."""
        return [event for event in self.events if isinstance(event, FrameError)]

    # What any line can do

    def send_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks in frames; a serial line cannot refuse them."""
        for at in range(0, len(blocks), BLOCK_BYTES):
            self.send_frame(FrameKind.BLOCK, blocks[at : at + BLOCK_BYTES])
        return len(blocks)

    def receive_records(self, seconds: float) -> bytes:
        """Wait for records in frames: those that have not been given yet."""
        self.listen(seconds, lambda: len(self.frames(FrameKind.RECORD)) > self._taken)
        found = self.frames(FrameKind.RECORD)[self._taken :]
        self._taken += len(found)
        return b"".join(found)

    def request(self, setup: Setup, data: bytes = b"") -> bytes | None:
        """Make a control request in a frame; what came back, None for STALL.

        Raises
        ------
        DeviceTimeoutError
            Where no reply with its tag comes.
        """
        self._tag = (self._tag + 1) % 256
        tag = self._tag
        self.send_frame(FrameKind.REQUEST, bytes([tag]) + setup.encode() + data)

        def reply() -> SerialReply | None:
            bodies = map(SerialReply.decode, self.frames(FrameKind.REPLY))
            return next((body for body in bodies if body.tag == tag), None)

        self.listen(self.patience(BLOCK_BYTES), lambda: reply() is not None)
        answer = reply()
        if answer is None:
            raise DeviceTimeoutError(f"{self.name} does not answer request {setup.request}")
        self.events[:] = [
            event for event in self.events if not (isinstance(event, Frame) and event.kind is FrameKind.REPLY)
        ]
        return answer.data if answer.outcome is Outcome.DONE else None

    def reopen(self, seconds: float) -> None:
        """Open the wire again and go over to frames."""
        self.wire.reopen(seconds)
        end = self.time.monotonic() + seconds
        while True:
            try:
                self.enter_frames()
            except DeviceTimeoutError:
                if self.time.monotonic() >= end:
                    raise
            else:
                return

    def close(self) -> None:
        """Leave the line to the console, and give it back."""
        self.write(DELIMITER + encode(CONSOLE_FRAME))
        self.wire.close()

    # Console

    def command(self, line: str) -> list[str]:
        """Type a line, with echo off; the lines of its answer, without the prompt.

        Raises
        ------
        DeviceTimeoutError
            Where no prompt comes.
        """
        self.write(line.encode("ascii") + b"\r")
        answer = self.read_bytes(self.patience(2000), until=PROMPT)
        if not answer.endswith(PROMPT):
            raise DeviceTimeoutError(f"{self.name} shows no prompt after {line!r}: {answer!r}")
        return [text.decode("ascii", "replace") for text in answer.removesuffix(PROMPT).split(b"\r\n") if text]
