"""The raw serial line: bytes, any frames, requests and the console, over a UART or the console's endpoints.

A `Wire` carries the bytes: a port of pyserial, or endpoints 03 and 83 of a device on USB.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from ....base.errors import DeviceError, DeviceStalledError, DeviceTimeoutError, FrameError
from ....host.transports.opening import load_by_scheme
from ....host.transports.serial_line import OPENING_ERRORS, PORTS, refused, translated
from ....host.transports.transport import Timekeeper
from ....protocol.codes import BLOCK_BYTES, CLASS_REQUEST_TYPE_OUT, REQUEST_TYPE_IN, FrameKind, Outcome, Request
from ....protocol.enumeration import CONSOLE_INTERFACE
from ....protocol.framing import (
    CONSOLE_FRAME,
    DELIMITER,
    MAX_FRAME_BYTES,
    UART_BITS_PER_BYTE,
    LineEvent,
    LineMode,
    LineReader,
    SerialFrame,
    SerialReply,
    encode,
)
from ....protocol.replies import ClockReading
from ....protocol.requests import ConsoleRequest, Setup
from ..cases import Inconclusive, LineKind
from .usb import CONSOLE_IN, CONSOLE_OUT, RawUsbLine
from .watch import ClockWatch

__all__ = ["QUIET_SECONDS", "CdcWire", "PortWire", "RawSerialLine", "Wire"]

PATIENCE_SECONDS = 10.0
"""Time for any answer, besides that of its bytes, with margin for a busy computer."""
QUIET_SECONDS = 0.05
"""After so long without data, besides the time of bytes under way, none are expected."""
SLOWER = 0.9
"""Share of the longest recent answer time that is expected of the next answer."""
READ_SECONDS = 0.002
"""How long a port waits for bytes at a time; some ports are slow to change that."""
LOOK_SECONDS = 0.05
BREAK_SECONDS = 0.02
CDC_BYTES_PER_SECOND = 1e6
FAR_LATENCY_SECONDS = 0.03
"""The delay that a real line and the programs at its end may add to an answer, with the timers of adapters."""
PSEUDO_TERMINALS = ("/dev/pts/", "/dev/ttys")
"""Their place on Linux and macOS."""
PROMPT = b"> "
TAGS = 256


class Wire(Protocol):
    """Bytes both ways."""

    @property
    def name(self) -> str:
        """A name of its other end, for people."""

    @property
    def time(self) -> Timekeeper:
        """The time of the device."""

    @property
    def bytes_per_second(self) -> float:
        """What it carries in one direction."""

    @property
    def has_break(self) -> bool:
        """Whether it is a UART, whose line can be held low; otherwise DTR can be lowered instead."""

    @property
    def is_connection(self) -> bool:
        """Whether it is a connection, such as a TCP socket, whose end is a hang-up."""

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self, seconds: float) -> bytes:
        """Wait until something comes, or the time is over."""

    def set_dtr(self, on: bool) -> None:
        """Raise or lower DTR, if the line has one."""

    def hang_up(self) -> None:
        """Hold the line low for longer than a byte, or lower DTR and raise it again."""

    def reopen(self, seconds: float) -> None:
        """Open it again, after the device has left."""

    def close(self) -> None:
        """Close it."""


class PortWire:
    """A port of pyserial, by the URL by which the host finds ports.

    Raises `DeviceError` if there is no such port, or it may not be used.
    """

    def __init__(self, url: str) -> None:
        self._port: Any = load_by_scheme(PORTS, url)(url)
        self.name: str = self._port.name
        self.time: Timekeeper = getattr(self._port, "time", time)
        # A port without a baud rate leads to the device by USB; a pseudo-terminal carries bytes alone.
        self._has_dtr = hasattr(self._port, "bytes_per_second")
        self.is_connection: bool = getattr(self._port, "is_connection", False)
        bare = self._has_dtr or os.path.realpath(self.name).startswith(PSEUDO_TERMINALS)
        self.has_break: bool = getattr(self._port, "has_break", not bare)
        self.bytes_per_second: float = getattr(self._port, "bytes_per_second", self._port.baudrate / UART_BITS_PER_BYTE)
        self._port.timeout = READ_SECONDS
        if self._port.write_timeout is not None:  # RFC 2217 has none
            self._port.write_timeout += PATIENCE_SECONDS
        self._open()

    def _open(self) -> None:
        try:
            self._port.open()
        except OPENING_ERRORS as error:
            raise refused(self.name, error) from error

    def write(self, data: bytes) -> None:
        """Send bytes."""
        with translated(f"sending to {self.name}"):
            self._port.write(data)

    def read(self, seconds: float) -> bytes:
        """Wait until something comes, or the time is over."""
        end = self.time.monotonic() + seconds
        with translated(f"receiving from {self.name}"):
            while True:
                data: bytes = self._port.read(max(self._port.in_waiting, 1))
                if data or self.time.monotonic() >= end:
                    return data

    def set_dtr(self, on: bool) -> None:
        """Raise or lower DTR of a port that leads to the device by USB; a UART has three wires."""
        if self._has_dtr:
            self._port.dtr = on

    def hang_up(self) -> None:
        """Hold the line low for 20 ms, or lower DTR and raise it again; inconclusive if neither is possible."""
        if self.has_break:
            self._port.break_condition = True
            self._port.reset_input_buffer()  # it came before: a fast device may have answered what was just asked
            self.time.sleep(BREAK_SECONDS)
            self._port.break_condition = False
        elif self._has_dtr:
            self.set_dtr(False)
            self.set_dtr(True)
        else:
            raise Inconclusive(f"{self.name} carries bytes alone: it has neither a break nor DTR to hang up with")

    def reopen(self, seconds: float) -> None:
        """Open the port again."""
        end = self.time.monotonic() + seconds
        self._port.close()
        while True:
            try:
                self._open()
            except DeviceError:
                if self.time.monotonic() >= end:
                    raise
                self.time.sleep(LOOK_SECONDS)
            else:
                return

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class CdcWire:
    """The console's endpoints of a device on USB; DTR has its initial state, low."""

    has_break = False
    is_connection = False
    bytes_per_second = CDC_BYTES_PER_SECOND

    def __init__(self, usb: RawUsbLine) -> None:
        self._usb = usb
        self.name = f"console of {usb.name}"
        self._packet_bytes = usb.bulk_bytes

    @property
    def time(self) -> Timekeeper:
        """The time of the device."""
        return self._usb.time

    def write(self, data: bytes) -> None:
        """Send bytes; raises `DeviceTimeoutError` if they are not taken."""
        taken = self._usb.write(CONSOLE_OUT, data, PATIENCE_SECONDS)
        if taken < len(data):
            raise DeviceTimeoutError(f"{self.name} takes {taken} of {len(data)} bytes in {PATIENCE_SECONDS:g} s")

    def read(self, seconds: float) -> bytes:
        """Wait until a packet comes, or the time is over; a device need not end a stream of bytes with a short one."""
        end = self.time.monotonic() + seconds
        while True:
            data = self._usb.read(CONSOLE_IN, self._packet_bytes, max(end - self.time.monotonic(), 0))
            if data or self.time.monotonic() >= end:
                return data or b""

    def set_dtr(self, on: bool) -> None:
        """Raise or lower DTR."""
        setup = Setup(CLASS_REQUEST_TYPE_OUT, ConsoleRequest.SET_CONTROL_LINE_STATE, int(on), CONSOLE_INTERFACE, 0)
        if self._usb.request(setup) is None:
            raise DeviceStalledError(f"{self.name} answers SET_CONTROL_LINE_STATE with STALL")

    def hang_up(self) -> None:
        """Lower DTR and raise it again."""
        self.set_dtr(False)
        self.set_dtr(True)

    def reopen(self, _seconds: float) -> None:
        """Continue with the device that the USB line has found."""
        self._packet_bytes = self._usb.bulk_bytes

    def close(self) -> None:
        """Lower DTR."""
        self.set_dtr(False)


class RawSerialLine:
    """A line that frames and the console share; it starts with the console.

    Parameters
    ----------
    wire : Wire

    Attributes
    ----------
    wire : Wire
    events : list of LineEvent
        Everything since `forget`: text, frames, defects of other frames, modes that began.
    watch : ClockWatch
    damaged : list of FrameError
        Defects of frames since `enter_frames`; a frame for devices counts as one.
    noted : callable or None
        Receives, with a label for each direction, the bytes that are sent and received, and the mode.
    """

    kind: LineKind = "serial"

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.watch = ClockWatch()
        self.events: list[LineEvent] = []
        self.damaged: list[FrameError] = []
        self.noted: Callable[[str, bytes, LineMode], None] | None = None
        self._incoming = LineReader()
        self._given = 0
        self._tag = 0
        self._slow = 0.0

    @property
    def name(self) -> str:
        """A name of its other end, for people."""
        return self.wire.name

    @property
    def time(self) -> Timekeeper:
        """The time of the device."""
        return self.wire.time

    @property
    def mode(self) -> LineMode:
        """What the device sends: text or frames."""
        return self._incoming.mode

    @property
    def latency(self) -> float:
        """The delay that this line may add to an answer, in seconds: 0 if the device is in this process."""
        return FAR_LATENCY_SECONDS if self.time is time else 0.0

    def patience(self, size: int = 0) -> float:
        """How long to wait for an answer after so many bytes under way, in seconds."""
        return PATIENCE_SECONDS + self.transit(size + 2 * MAX_FRAME_BYTES)

    def transit(self, size: int) -> float:
        """How long so many bytes are under way, in seconds."""
        return size / self.wire.bytes_per_second

    def forget(self) -> None:
        """Forget the received data."""
        self.events.clear()
        self._given = 0

    # Bytes

    def write(self, data: bytes) -> None:
        """Send bytes unchanged."""
        if self.noted is not None:
            self.noted("to the serial line", data, self.mode)
        self.wire.write(data)

    def _hear(self, seconds: float) -> bytes:
        """Take the next data, as bytes and as events."""
        data = self.wire.read(seconds)
        if data and self.noted is not None:
            self.noted("from the serial line", data, self.mode)
        came = self._incoming.feed(data)
        self.events += came
        for event in came:
            match event:
                case SerialFrame(FrameKind.RECORD, body):
                    self.watch.came(self, body)
                case FrameError():
                    self.damaged.append(event)
                case SerialFrame(FrameKind.BLOCK | FrameKind.REQUEST as kind):
                    self.damaged.append(FrameError(f"a frame of kind {kind.name} goes to devices"))
        return data

    def listen(self, seconds: float, enough: Callable[[], bool] = lambda: False) -> list[LineEvent]:
        """Take data until there is enough, or the time is over; returns all events since `forget`."""
        end = self.time.monotonic() + seconds + self.latency
        while not enough() and (left := end - self.time.monotonic()) > 0:
            self._hear(left)
        return self.events

    def read(self, seconds: float, enough: Callable[[bytes], bool] = lambda _: False) -> bytes:
        """Take bytes until there are enough, or the time is over; they show as events too."""
        end, found = self.time.monotonic() + seconds, b""
        while not enough(found) and (left := end - self.time.monotonic()) > 0:
            found += self._hear(left)
        return found

    def rest(self, size: int = 0) -> bytes:
        """Take bytes until no more come, if so many may still be under way."""
        found = b""
        quiet = QUIET_SECONDS + max(self.latency, self._slow)  # the recent answer times on a busy computer
        while data := self.read(quiet + self.transit(size + MAX_FRAME_BYTES), bool):
            found += data
        return found

    def answer(self, size: int = 0) -> bytes:
        """Wait for bytes, of which so many may come, and take them until no more come."""
        return self.read(self.patience(size), bool) + self.rest(size)

    # Modes

    def enter_frames(self) -> None:
        """Switch to frames from any mode (clause SER-010), and forget earlier data.

        Raises `DeviceTimeoutError` if no request is answered afterwards.
        """
        self.write(DELIMITER + encode(CONSOLE_FRAME) + DELIMITER)
        self.request(Setup(REQUEST_TYPE_IN, Request.CLOCK, 0, 0, ClockReading.BYTES))
        self.forget()
        self.damaged.clear()

    def enter_console(self) -> None:
        """Switch to the console from any mode, to its prompt, without echo (clause SER-010)."""
        self.wire.set_dtr(True)
        self.enter_frames()
        self.write(encode(CONSOLE_FRAME))
        self._await_prompt("CONSOLE")
        self.write(b"echo 0\r")
        self._await_prompt("echo 0")
        self.forget()

    def hang_up(self) -> None:
        """Return both directions to the console at once (clause SER-010)."""
        self.wire.hang_up()
        self.assume_console()

    def assume_console(self) -> None:
        """Note that the device has returned to the console by itself, as on SET_CONFIGURATION."""
        self._incoming.hang_up()
        self.forget()

    # Methods of any line

    def send_frame(self, kind: FrameKind, body: bytes = b"") -> None:
        """Send a frame, preceded by a zero."""
        self.write(DELIMITER + encode(SerialFrame(kind, body)))

    def frames(self, kind: FrameKind) -> list[bytes]:
        """The bodies of the undamaged frames of a kind since `forget`."""
        return [event.body for event in self.events if isinstance(event, SerialFrame) and event.kind is kind]

    def send_blocks(self, blocks: bytes, _seconds: float) -> int:
        """Send blocks in frames; a serial line cannot refuse them."""
        for at in range(0, len(blocks), BLOCK_BYTES):
            self.send_frame(FrameKind.BLOCK, blocks[at : at + BLOCK_BYTES])
        return len(blocks)

    def receive_records(self, seconds: float) -> bytes:
        """Wait for records in frames: those that were not returned yet."""
        self.listen(seconds, lambda: len(self.frames(FrameKind.RECORD)) > self._given)
        found = self.frames(FrameKind.RECORD)[self._given :]
        self._given += len(found)
        return b"".join(found)

    def request(self, setup: Setup, data: bytes = b"") -> bytes | None:
        """Make a control request in a frame; returns the answer, or None for STALL.

        Raises `DeviceTimeoutError` if no reply with its tag comes.
        """
        self._tag = (self._tag + 1) % TAGS
        before = len(self.events)  # which may include replies to others with this tag
        asked, told = self.time.monotonic(), self.watch.told
        self.send_frame(FrameKind.REQUEST, bytes([self._tag]) + setup.encode() + data)
        self.listen(self.patience(BLOCK_BYTES), lambda: self._answered(before) is not None)
        place = self._answered(before)
        if place is None:
            raise DeviceTimeoutError(f"{self.name} does not answer {setup.name}")
        if self.latency:
            self._slow = max(self.time.monotonic() - asked, SLOWER * self._slow)
        event = self.events.pop(place)
        assert isinstance(event, SerialFrame)
        reply = SerialReply.decode(event.body)
        answer = reply.data if reply.outcome is Outcome.DONE else None
        self.watch.answered(setup, answer, told)
        return answer

    def _answered(self, first: int) -> int | None:
        """The place of the reply with the newest tag among the events, ignoring those before the first."""
        for place, event in enumerate(self.events[first:], first):
            match event:
                case SerialFrame(FrameKind.REPLY, body) if SerialReply.decode(body).tag == self._tag:
                    return place
        return None

    def reopen(self, seconds: float) -> None:
        """Open the wire again and switch to frames."""
        self.wire.reopen(seconds)
        self.watch.restarted()
        self.assume_console()
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
        """Leave the line to the console, with echo, and close it, even if its other end is gone."""
        with suppress(DeviceError):
            self.write(DELIMITER + encode(CONSOLE_FRAME) + b"echo 1\r")
        self.wire.close()

    # Console

    def command(self, line: str) -> str:
        """Give a command, with echo off; returns its answer, without the prompt.

        Raises `DeviceTimeoutError` if no prompt comes.
        """
        self.write(line.encode("ascii") + b"\r")
        return self._await_prompt(line).removesuffix(PROMPT).decode("latin-1")

    def _await_prompt(self, what: str) -> bytes:
        answer = self.read(self.patience(MAX_FRAME_BYTES), ends_with_prompt)
        if not ends_with_prompt(answer):
            raise DeviceTimeoutError(f"{self.name} shows no prompt after {what!r}, but {answer!r}")
        return answer


def ends_with_prompt(text: bytes) -> bool:
    """Whether text ends with the prompt, at the beginning of a line or after the end of frames."""
    return text == PROMPT or text.endswith((b"\n" + PROMPT, DELIMITER + PROMPT))
