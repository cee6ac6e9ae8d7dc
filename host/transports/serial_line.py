"""The serial line: blocks, records and requests in frames, over any port of pyserial (SPEC.md, chapter SER).

Which port, a real one or an emulated one, is the URL's scheme: an entry point in the group ``phasewire.serial_ports``,
a function ``(url) -> port`` that is not yet open and bounds its writes. What pyserial does not know, a port may have as
attributes: `time`, a `Timekeeper`, if its device does not live by the wall clock; `bytes_per_second`, if its baud
rate means nothing; `is_connection`, if its end is told to the device, and `has_break`, false if it cannot hold the line
low; `product` and `serial_number` of the device at its other end; `refusal`, what it means if the line
ends before a byte has come.
"""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from serial import PortNotOpenError, SerialTimeoutException

from ...base.errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStalledError,
    DeviceTimeoutError,
    FrameError,
)
from ...protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, FrameKind, Outcome, Request
from ...protocol.framing import (
    CONSOLE_FRAME,
    DELIMITER,
    MAX_FRAME_BYTES,
    UART_BITS_PER_BYTE,
    LineEvent,
    LineMode,
    LineReader,
    SerialFrame,
    SerialReply,
    SerialRequest,
    encode,
    frame_bytes,
)
from ...protocol.replies import Ack, Info, Status
from .opening import load_by_scheme
from .transport import Timekeeper, understood

__all__ = ["OPENING_ERRORS", "PORTS", "SerialTransport", "open_serial_line", "refused", "translated"]

Answer = TypeVar("Answer")

PORTS = "phasewire.serial_ports"
PRODUCT = "phasewire array"

ANSWER_SECONDS = 0.1
"""After what frames under way need, an answer is given up (clause SER-013) …"""
ATTEMPTS = 4
"""… and asked for again, with twice the patience each time, for a network or this program may be slow. A line that has
fallen silent is noticed within 2 s, if its baud rate is 115 200 or more."""
UNDER_WAY_BYTES = 2 * MAX_FRAME_BYTES
"""At most stands before an answer, and is the answer: what the device was sending, the answer, and a status record."""
BUSY_SECONDS = 0.1
MOST_NOTED, LEAST_NOTED = 256, 12
"""How many of the first bytes of a line are kept, and how many can show how it garbles."""
LEAST_BLOCKS = 2
"""How many blocks keep a line busy while the first is answered."""
READ_SECONDS = 0.001
"""How long a port waits for bytes at a time; some ports take long to change that."""
LOOK_SECONDS = 0.05
"""How often a port that went away is looked for."""

NEVER_REPEATED = (Request.RESET, Request.REVERT)
"""Both restart the device, so that nothing answers (clause SER-009)."""
TAGS = 256
BLOCK_FRAME_BYTES = len(DELIMITER) + frame_bytes(BLOCK_BYTES)
ENTER_FRAMES = DELIMITER + encode(CONSOLE_FRAME) + DELIMITER


def _port_errors() -> tuple[type[Exception], ...]:
    """What pyserial lets through of the system's errors."""
    try:
        from termios import error  # not on Windows
    except ImportError:
        return (OSError,)
    return (OSError, error)


PORT_ERRORS = _port_errors()
OPENING_ERRORS: tuple[type[Exception], ...] = (*PORT_ERRORS, ValueError)  # a baud rate that the port cannot have


def open_serial_line(url: str) -> SerialTransport:
    """Open the serial line that a URL names.

    Raises
    ------
    DeviceError
        If there is no such port, it may not be used, or no device answers.
    """
    return SerialTransport(load_by_scheme(PORTS, url)(url))


@contextmanager
def translated(doing: str) -> Iterator[None]:
    """Turn what an open port raises into our errors."""
    try:
        yield
    except SerialTimeoutException as error:
        raise DeviceTimeoutError(
            f"{doing}: the port takes no bytes; is something connected to it that reads?"
        ) from error
    except PORT_ERRORS as error:
        raise DeviceLostError(f"{doing}: the port is gone ({error}); plug it in again, or open it anew") from error


def refused(name: str, error: Exception) -> DeviceError:
    """Our error for a port that could not be opened, by its errno; pyserial hides some of these in what it says."""
    cause = error.__context__
    number = getattr(error, "errno", None) or getattr(cause, "errno", None)
    if number in (errno.EACCES, errno.EPERM) or "PermissionError" in str(error):
        return DeviceAccessError(
            f"{name} may not be opened: it is in use, or you lack permission; `phasewire doctor` says how to get it"
        )
    if number in (errno.EBUSY, errno.EAGAIN):
        return DeviceAccessError(f"{name} is in use: another program has it open; close that first")
    return DeviceNotFoundError(f"no device at {name}: {error}")


def garbling(sent: bytes | bytearray, came: bytes | bytearray) -> str:
    """How a line garbles, as its first bytes show it; empty if they do not."""
    came = came.lstrip(DELIMITER)
    if len(came) >= LEAST_NOTED and came[:LEAST_NOTED] in sent:
        return "the line sends back what is sent to it: it is a loop, or the other end echoes"
    pairs = len(came) // 2
    if len(came) >= LEAST_NOTED and came[: 2 * pairs : 2] == came[1 : 2 * pairs : 2]:
        return "each byte comes twice"
    return ""


class SerialTransport:
    """A line to a device over a serial port.

    A line does not tell who is at its other end, so it goes by the unique number in INFO, unless the port knows better.

    Parameters
    ----------
    port : pyserial port
        Not yet opened. Its baud rate says how long an answer may take and how much fits on the line; of one that is
        reached by a network it must be given.

    Attributes
    ----------
    damaged : int
        Frames of the device that were damaged, since it first answered.

    Raises
    ------
    DeviceNotFoundError
        If there is no such port.
    DeviceAccessError
        If it is in use, or there is no permission.
    DeviceTimeoutError
        If nothing answers that speaks in frames.
    DeviceError
        If what answers breaks the protocol.
    """

    lossy = True
    posts = False

    def __init__(self, port: Any) -> None:
        self._port = port
        self._bytes_per_second: float = getattr(port, "bytes_per_second", port.baudrate / UART_BITS_PER_BYTE)
        self.most_blocks_per_second = self._bytes_per_second / BLOCK_FRAME_BYTES
        self.time: Timekeeper = getattr(port, "time", time)
        self.serial: str = getattr(port, "serial_number", None) or ""
        self.name: str = port.name
        self._tag = 0
        self._forget()
        self._open()
        try:
            self._enter()
            self._unique_id = self._ask_who()
        except BaseException:
            self.close()
            raise
        product = getattr(port, "product", None) or PRODUCT
        self.name = f"{product} {self.serial or self._unique_id.hex()}"

    # The line

    def window(self, free: int | None, records: int) -> int:
        """How many blocks may be unanswered: one more than the queue has room for (clause SER-011).

        Fewer if they would keep the line busy for long, for a request to stop waits behind them.
        """
        in_time = int(self.most_blocks_per_second * BUSY_SECONDS)
        return 1 if free is None else min(free + 1, max(in_time, LEAST_BLOCKS))

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        """Hand blocks to the port; a serial line sends them in its own time, and cannot refuse them."""
        deadline = self.time.monotonic() + seconds
        for at in range(0, len(blocks), BLOCK_BYTES):
            if at and self.time.monotonic() >= deadline:
                return at
            self._send("sending a block", SerialFrame(FrameKind.BLOCK, blocks[at : at + BLOCK_BYTES]))
        return len(blocks)

    def read_records(self, seconds: float) -> bytes:
        """Wait for records, and give all that have come."""
        self._wait("waiting for an acknowledgement", seconds, lambda: bool(self._records))
        records = bytes(self._records)
        self._records.clear()
        return records

    def take_back(self) -> int:
        """A serial line has nothing that it could give back."""
        return 0

    def query(self, request: Request, size: int) -> bytes:
        """Make a control request with an answer; it is repeated if none comes."""
        return self._request(f"asking for {request.name}", request, REQUEST_TYPE_IN, 0, size)

    def command(self, request: Request, value: int = 0) -> None:
        """Make a control request without an answer; it is repeated if nothing says that it was done.

        RESET and REVERT never are, ENABLE and CLEAR_FAULTS only if STATUS says that they were not carried out.
        """
        self._request(f"ordering {request.name}", request, REQUEST_TYPE_OUT, value, 0)

    def reopen(self, seconds: float) -> None:
        """Open the port again until it is there, and the same device answers."""
        self._close_port()
        end = self.time.monotonic() + seconds
        while True:
            try:
                self._open()
                if self._try_to_enter(0) and self._ask_who() == self._unique_id:
                    return
            except DeviceError:  # it may go once more, and who may open it is settled a little after it comes
                pass
            self._close_port()
            if self.time.monotonic() >= end:
                raise DeviceLostError(f"{self.name} has not come back within {seconds:g} s; is its power on?")
            self.time.sleep(LOOK_SECONDS)

    def close(self) -> None:
        """Leave the line to the console, for a person, and close the port."""
        with suppress(DeviceError):
            self._write("leaving frames", DELIMITER + encode(CONSOLE_FRAME))
        self._close_port()

    # Opening

    def _forget(self) -> None:
        """What is known of the bytes on the line: nothing."""
        self._incoming = LineReader()
        self._incoming.feed(DELIMITER)  # among frames, for text that still comes is then a damaged frame at worst
        self._records = bytearray()
        self._reply: SerialReply | None = None
        self._awaited: int | None = None
        self._settled = False
        self._heard = False
        self._unanswered = 0
        self._sent, self._came = bytearray(), bytearray()  # the first of each, to tell how a line garbles
        self.damaged = 0

    def _open(self) -> None:
        self._forget()
        self._port.timeout = READ_SECONDS
        try:
            self._port.open()
        except OPENING_ERRORS as error:
            raise refused(self.name, error) from error

    def _close_port(self) -> None:
        with suppress(*PORT_ERRORS):
            self._port.close()

    def _enter(self) -> None:
        """Go over to frames, whatever the line carries now (clause SER-010)."""
        try:
            answers = any(self._try_to_enter(attempt) for attempt in range(ATTEMPTS))
        except DeviceLostError as error:
            if self._heard or not (refusal := getattr(self._port, "refusal", "")):
                raise
            raise DeviceAccessError(f"{self.name} {refusal}") from error
        if not answers:
            what = "nothing comes from there"
            if self._heard:
                what = "what comes from there makes no sense: "
                what += garbling(self._sent, self._came) or "the line may lose, double or change bytes"
            raise DeviceTimeoutError(
                f"no device answers at {self.name}: {what}. Is a device of phasewire connected and switched on, and is "
                f"{self._port.baudrate} its baud rate?"
            )
        self.damaged = 0

    def _try_to_enter(self, attempt: int) -> bool:
        self._write("opening the line", ENTER_FRAMES)
        return self._wait("opening the line", self._patience(attempt), lambda: self._settled)

    def _ask_who(self) -> bytes:
        """Eight bytes that no other device has."""
        return self._decoded(Info.decode, self.query(Request.INFO, Info.BYTES)).unique_id

    def _decoded(self, decode: Callable[[bytes], Answer], data: bytes) -> Answer:
        with understood(self.name):
            return decode(data)

    # Requests

    def _request(self, doing: str, request: Request, request_type: int, value: int, size: int) -> bytes:
        for attempt in range(1 if request in NEVER_REPEATED else ATTEMPTS):
            if attempt and self._was_carried_out(request):
                return b""
            self._tag = (self._tag + 1) % TAGS
            reply = self._exchange(doing, SerialRequest(self._tag, request_type, request, value, 0, size), attempt)
            if reply and reply.outcome is Outcome.STALL:
                raise DeviceStalledError(
                    f"{doing}: the device answers STALL: it does not know this request, or not now; `phasewire info` "
                    "says what it is doing"
                )
            if reply:
                return reply.data
        garbled = garbling(self._sent, self._came)
        raise DeviceTimeoutError(
            f"{doing}: {self.name} does not answer. Is it still connected and switched on? {self.damaged} of its "
            f"frames came damaged{garbled and f'; {garbled}'}"
        )

    def _exchange(self, doing: str, request: SerialRequest, attempt: int) -> SerialReply | None:
        """Send a request and wait for its reply; None if none came in time."""
        self._reply, self._awaited = None, request.tag
        self._send(doing, SerialFrame(FrameKind.REQUEST, request.encode()))
        self._wait(doing, self._patience(attempt), lambda: self._reply is not None)
        self._awaited = None
        return self._reply

    def _was_carried_out(self, request: Request) -> bool:
        """Whether a request need not be repeated; of some STATUS tells, which must be asked first (clause SER-009)."""
        if request is Request.ENABLE:
            return self._status().enabled
        return request is Request.CLEAR_FAULTS and not self._status().faults

    def _status(self) -> Status:
        return self._decoded(Status.decode, self.query(Request.STATUS, Status.BYTES))

    # Bytes

    def _patience(self, attempt: int) -> float:
        """How long to wait for an answer, in seconds (clause SER-013)."""
        under_way = self._unanswered + UNDER_WAY_BYTES
        return ANSWER_SECONDS * 2.0**attempt + under_way / self._bytes_per_second

    def _send(self, doing: str, frame: SerialFrame) -> None:
        """Send a frame after a zero, which ends what may be left of another, and the console (SER-005, SER-010)."""
        data = DELIMITER + encode(frame)
        self._unanswered += len(data)
        self._write(doing, data)

    def _write(self, doing: str, data: bytes) -> None:
        self._sent += data[: MOST_NOTED - len(self._sent)]
        with translated(doing):
            self._port.write(data)

    def _wait(self, doing: str, seconds: float, done: Callable[[], bool]) -> bool:
        """Take in what comes until something is done, or the time is over; whether it was done."""
        deadline = self.time.monotonic() + seconds
        while not done():
            late = self.time.monotonic() >= deadline
            with translated(doing):
                if not self._port.is_open:
                    raise PortNotOpenError
                waiting = self._port.in_waiting
                data = self._port.read(max(waiting, 1)) if waiting or not late else b""
            self._heard = self._heard or bool(data)
            self._came += data[: MOST_NOTED - len(self._came)]
            for event in self._incoming.feed(data):
                self._take(event)
            if late:
                break
        return done()

    def _take(self, event: LineEvent) -> None:
        """Take what the device said; text is nothing to us."""
        match event:
            case SerialFrame(FrameKind.RECORD, record):
                self._records += record
                if len(record) == Ack.BYTES:
                    self._unanswered = max(0, self._unanswered - BLOCK_FRAME_BYTES)
            case SerialFrame(FrameKind.REPLY, body):
                reply = SerialReply.decode(body)
                if reply.tag == self._awaited:
                    self._reply, self._unanswered = reply, 0
            case LineMode.FRAMES:
                self._settled = True
            case SerialFrame() | FrameError():  # what goes to a device is damaged too (clause SER-006)
                self.damaged += 1
