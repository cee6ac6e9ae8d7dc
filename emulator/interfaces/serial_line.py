"""One serial line of the device: a text console until a host asks for frames (SPEC.md, chapter SER).

Bytes from the host go in, bytes for the host wait to be taken; whether the line is a UART, a pair of USB endpoints or a
socket, and how fast it is, is its owner's business. What is typed goes to the `Console` as it is: no text is read or
worded here.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from ...base.errors import FrameError
from ...protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, FrameKind, Outcome, Request
from ...protocol.framing import (
    CONSOLE_FRAME,
    DELIMITER,
    LineEvent,
    LineMode,
    LineReader,
    SerialFrame,
    SerialReply,
    SerialRequest,
    encode,
)
from ...protocol.requests import Setup
from ..door import Door, Stall
from .console import Console, ConsoleController, Departure

__all__ = ["LineController", "SerialLine"]

FULL_BYTES = 4096
"""So much may wait for the host before the line would rather not be sent more."""

_RESTARTS = tuple(Setup(REQUEST_TYPE_OUT, request, 0, 0, 0) for request in (Request.RESET, Request.REVERT))


class LineController(ConsoleController, Protocol):
    """What a serial line needs of the controller."""

    @property
    def now_tick(self) -> int:
        """Ticks since period 0."""

    def attach(self, door: Door) -> None:
        """Notify a door from now on."""

    def accept(self, packet: bytes, door: Door, arrived: int | None = None) -> None:
        """Judge a block that had arrived at a tick, or arrives now, and acknowledge it to the door that it came by."""

    def await_room(self, waiter: Callable[[], None]) -> None:
        """Call somebody once the queue has room."""

    def drop_frames(self, count: int) -> None:
        """Count frames that were damaged and dropped."""

    def host_arrived(self) -> None:
        """Something was answered, so the firmware has proved itself (clause FWU-020)."""


class _Nobody(Door):
    """The door of a block whose host no longer waits for the answer."""

    def acknowledge(self, record: bytes) -> None:
        """Drop it."""

    def notify(self, record: bytes) -> None:
        """Drop it."""


@dataclass
class _WaitingBlock:
    block: bytes
    door: Door
    arrived: int


class _Outbox:
    """What waits for the host: bytes that can no longer be dropped, then frames, then an unsolicited record."""

    def __init__(self) -> None:
        self._under_way = bytearray()
        self._frames: deque[bytes] = deque()
        self._unasked = b""

    def __len__(self) -> int:
        return len(self._under_way) + sum(map(len, self._frames)) + len(self._unasked)

    def say(self, data: bytes) -> None:
        """Send bytes after what is under way; no frames may wait."""
        self._under_way += data

    def answer(self, frame: SerialFrame) -> None:
        """Send a frame after the others."""
        self._frames.append(encode(frame))

    def notify(self, frame: SerialFrame) -> None:
        """Send a frame when no other one waits, in the place of one that was to be sent like this."""
        self._unasked = encode(frame)

    def keep_answers(self) -> None:
        """Keep all waiting frames, except the unsolicited one."""
        self._under_way += b"".join(self._frames)
        self._frames.clear()

    def drop_frames(self) -> None:
        """Drop the frames of which nothing was sent; the rest of one that was begun still comes."""
        self._frames.clear()
        self._unasked = b""

    def take(self, room: int) -> bytes:
        """What is sent next, at most `room` bytes."""
        while len(self._under_way) < room and (frame := self._next_frame()):
            self._under_way += frame
        taken = bytes(self._under_way[:room])
        del self._under_way[:room]
        return taken

    def _next_frame(self) -> bytes:
        if self._frames:
            return self._frames.popleft()
        frame, self._unasked = self._unasked, b""
        return frame


class SerialLine(Door):
    """A serial line of the device: a UART, or its CDC-ACM function.

    Parameters
    ----------
    controller : LineController
        What stands behind the line; it notifies the line from now on.
    detach : callable
        What takes the device to DFU mode, as the request DETACH does, for a door; it may raise `Stall`.
    on_output : callable
        A function that is called whenever there are bytes to `take`.
    needs_dtr : bool
        Whether text is sent only between `open` and `hang_up`, as on CDC-ACM (clause USB-023).
    """

    def __init__(
        self,
        controller: LineController,
        *,
        detach: Callable[[Door], None],
        on_output: Callable[[], None] = lambda: None,
        needs_dtr: bool = False,
    ) -> None:
        self._controller = controller
        self._detach = detach
        self._on_output = on_output
        self._needs_dtr = needs_dtr
        self._waiting: _WaitingBlock | None = None
        self._begin()
        controller.attach(self)

    def _begin(self) -> None:
        """Everything as at first, besides a block that waits."""
        self._incoming = LineReader()
        self._console = Console(self._controller, self, partial(self._detach, self))
        self._outbox = _Outbox()
        self._among_frames = False
        self._sends_text = not self._needs_dtr
        self._departure: Departure | None = None
        self._owes = False  # an answer to a request or a command, until all is sent

    @property
    def pending(self) -> int:
        """Bytes that wait for the host."""
        return len(self._outbox)

    @property
    def can_receive(self) -> bool:
        """Whether the host reads its answers; if not, a line that can make it wait does so."""
        return self.pending < FULL_BYTES

    def open(self) -> None:
        """DTR went high: text may be sent."""
        self._sends_text = True

    def hang_up(self) -> None:
        """Return to the console at once: a break, DTR low or a bus reset (clause SER-010).

        What waits for the host is dropped, and what was to be carried out after it is carried out.
        """
        dropped = self._incoming.hang_up()
        self._controller.drop_frames(sum(isinstance(event, FrameError) for event in dropped))
        self._drop_answers()
        departure = self._departure
        self._begin()
        if departure:
            _depart(departure)

    def receive(self, data: bytes) -> None:
        """Take bytes that arrive from the host now."""
        for event in self._incoming.feed(data):
            if self._departure:
                break  # what comes after it is heard by nobody
            self._handle(event)
        if self.pending:
            self._on_output()
        else:
            self._all_sent()

    def take(self, room: int) -> bytes:
        """Bytes for the host, at most `room` of them; they are sent now."""
        data = self._outbox.take(room)
        if not self.pending:
            self._all_sent()
        return data

    def acknowledge(self, record: bytes) -> None:
        """Send the acknowledgement of a block that came by this line."""
        self._outbox.answer(SerialFrame(FrameKind.RECORD, record))
        self._on_output()

    def notify(self, record: bytes) -> None:
        """Send an unsolicited status record, if the line carries frames (clauses ACK-006 and SER-010)."""
        if self._among_frames:
            self._outbox.notify(SerialFrame(FrameKind.RECORD, record))
            self._on_output()

    def _handle(self, event: LineEvent) -> None:
        match event:
            case bytes(typed):
                text, self._departure, answers = self._console.feed(typed)
                self._say(text)
                self._owes |= answers and self._sends_text
            case LineMode.FRAMES:
                self._outbox.say(DELIMITER)
                self._among_frames = True
            case LineMode.CONSOLE:
                self._leave_frames()
                self._say(self._console.begin_line())
            case SerialFrame(FrameKind.BLOCK, block):
                self._admit(block)
            case SerialFrame(FrameKind.REQUEST, body):
                self._answer(SerialRequest.decode(body))
            case _:  # damaged, or going the other way
                self._controller.drop_frames(1)

    def _say(self, text: bytes) -> None:
        # Text without a terminal is not kept: it would stand before the frames of a host that needs no DTR.
        if self._sends_text:
            self._outbox.say(text)

    def _leave_frames(self) -> None:
        self._drop_answers()
        self._outbox.say(encode(CONSOLE_FRAME))
        self._among_frames = False

    def _drop_answers(self) -> None:
        """Drop what was not sent, and the later answer to a block that waits (clause SER-010)."""
        self._outbox.drop_frames()
        self._owes = False
        if self._waiting:
            self._waiting.door = _Nobody()

    def _answer(self, request: SerialRequest) -> None:
        """Carry out a request and answer it."""
        if request.setup in _RESTARTS:
            self._answer_restart(request)
            return
        try:
            reply = SerialReply(request.tag, Outcome.DONE, self._requested(request))
        except Stall:
            reply = SerialReply(request.tag, Outcome.STALL)
        self._reply(reply)

    def _requested(self, request: SerialRequest) -> bytes:
        if request.request_type not in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
            raise Stall(f"a serial line carries vendor requests, not those of type 0x{request.request_type:02x}")
        return self._controller.request(request.setup, request.data, self)[: request.length]

    def _answer_restart(self, request: SerialRequest) -> None:
        """Answer, go back to the console, and restart once that is sent (clause SER-010)."""
        self._reply(SerialReply(request.tag, Outcome.DONE))
        self._outbox.keep_answers()
        self._leave_frames()
        self._owes = True  # the REPLY was kept
        self._departure = partial(self._controller.request, request.setup, b"", self)

    def _reply(self, reply: SerialReply) -> None:
        self._outbox.answer(SerialFrame(FrameKind.REPLY, reply.encode()))
        self._owes = True

    def _admit(self, block: bytes) -> None:
        """Have a block judged, let it wait for room in the queue, or drop it (clause SER-011)."""
        if self._waiting:
            self._controller.drop_frames(1)
        elif self._controller.can_accept:
            self._controller.accept(block, self)
        else:
            self._waiting = _WaitingBlock(block, self, self._controller.now_tick)
            self._await_room(self._waiting)

    def _await_room(self, waiting: _WaitingBlock) -> None:
        self._controller.await_room(partial(self._try_again, waiting))

    def _try_again(self, waiting: _WaitingBlock) -> None:
        if not self._controller.can_accept:  # another door was faster
            self._await_room(waiting)
            return
        self._waiting = None
        self._controller.accept(waiting.block, waiting.door, waiting.arrived)

    def _all_sent(self) -> None:
        if self._owes:
            self._owes = False
            self._controller.host_arrived()
        if self._departure:
            departure, self._departure = self._departure, None
            self._incoming = LineReader()  # both directions are text, whatever came meanwhile
            _depart(departure)


def _depart(departure: Departure) -> None:
    with suppress(Stall):  # refused after all, in a state that came while the answer was sent
        departure()
