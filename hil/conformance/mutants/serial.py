"""Broken serial lines: frames, modes, and credit (chapter SER)."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Any

from cobs import cobs

from ....base.errors import FrameError
from ....emulator.control.dispatch import Dispatch
from ....emulator.doors.uart import Uart
from ....emulator.interfaces import serial_line
from ....emulator.interfaces.console import Console
from ....emulator.interfaces.serial_line import FULL_BYTES, SerialLine
from ....emulator.interfaces.usb_functions import ConsoleFunction
from ....protocol import framing
from ....protocol.board import CYCLES_PER_MS, CYCLES_PER_TICK
from ....protocol.codes import BLOCK_BYTES, REQUEST_TYPE_OUT, SERIAL_DATA_BYTES, FrameKind, Kind, Outcome, Request
from ....protocol.console import PROMPT
from ....protocol.framing import DELIMITER, MAX_FRAME_BYTES, FrameReader, LineReader, SerialFrame, SerialReply
from ....protocol.requests import DIRECTION_IN
from ..tools.forge import forged
from .patching import Patch, mutant

OVER_UART = "emulator:?door=serial"
CHECKSUM_BYTES = 4
LENGTH_AT = slice(8, 10)
REQUEST_HEAD_BYTES = 10
"""The fields of a request after its kind."""


@mutant("SER-011", "ACK-006", wraps=(Dispatch, "announce_room"))
def a_block_that_waits_is_judged_after_the_event_is_told(original: Any, self: Any) -> Any:
    """A block that waits for room is judged a millisecond later, in another task: the record goes first."""
    return self.scheduler.at(self.now + CYCLES_PER_MS, lambda: original(self))


@mutant("SAF-003", "SER-011", wraps=(SerialLine, "_try_again"))
def a_block_that_waited_counts_from_its_arrival(original: Any, self: Any, waiting: Any) -> None:
    """A block that has waited for room feeds the watchdog with the time of its arrival: `now` of its answer."""
    watchdog = self._controller._machine.watchdog
    before = watchdog._fed
    original(self, waiting)
    if watchdog._fed != before:
        watchdog._fed = max(before, self._controller.time.origin + waiting.arrived * CYCLES_PER_TICK)


@mutant("SER-013", wraps=(SerialLine, "_say"))
def text_that_finds_no_room_is_dropped(original: Any, self: Any, text: bytes) -> None:
    """Text of the console for which the buffer has no room is lost, because nobody seems to read."""
    if len(text) <= FULL_BYTES - self.pending:
        original(self, text)


@mutant("TIM-002", "SER-010", url=OVER_UART, wraps=(Uart, "run"))
def what_arrives_during_a_start_is_kept(original: Any, self: Any) -> None:
    """The UART's driver keeps what arrives while the device starts, and hands it over afterwards."""
    waiting, line = bytes(self._to_device), self._line()
    kept = vars(self).setdefault("kept", bytearray())
    if line is not None and kept:
        line.receive(bytes(kept))
        kept.clear()
    original(self)
    if line is None:
        kept += waiting[: len(waiting) - len(self._to_device)]


# Frames


class _OtherLine(LineReader):
    """The parser of received bytes, replaced by another one."""

    def __init__(self, reader: type[FrameReader]) -> None:
        super().__init__()
        self._reader = reader()


def _read_by(patch: Patch, reader: type[FrameReader]) -> None:
    """Change how the device parses frames; hosts parse as before."""
    patch.replace(serial_line, "LineReader", lambda: _OtherLine(reader))


class _Forgiving(FrameReader):
    """A parser that accepts some damaged frames."""

    def pardon(self, data: bytes) -> bytes:
        """The frame to use for a damaged one, with its zero; raises `DecodeError` if there is none."""
        raise NotImplementedError

    def _finish(self) -> SerialFrame | FrameError:
        data = bytes(self._begun) + DELIMITER
        found = super()._finish()
        if isinstance(found, SerialFrame):
            return found
        try:
            return framing.decode(self.pardon(data))
        except (FrameError, cobs.DecodeError):
            return found


def _sealed(content: bytes) -> bytes:
    """A valid frame of a kind and a body."""
    checksum = zlib.crc32(content).to_bytes(CHECKSUM_BYTES, "little")
    return bytes(cobs.encode(content + checksum)) + DELIMITER


class _NoChecksum(_Forgiving):
    def pardon(self, data: bytes) -> bytes:
        return _sealed(bytes(cobs.decode(data[:-1]))[:-CHECKSUM_BYTES])


@mutant("SER-006", "SER-002")
def checksum_of_frames_is_ignored(patch: Patch) -> None:
    """A frame is accepted with any CRC-32: it is computed, and compared with itself."""
    _read_by(patch, _NoChecksum)


class _AnyForm(_Forgiving):
    def pardon(self, data: bytes) -> bytes:
        return bytes(cobs.encode(cobs.decode(data[:-1]))) + DELIMITER


@mutant("SER-003")
def empty_group_at_the_end_of_a_frame_is_taken(patch: Patch) -> None:
    """A frame is accepted if its COBS ends with an empty group after a full one, as many libraries decode it."""
    _read_by(patch, _AnyForm)


class _AnyLength(_Forgiving):
    def pardon(self, data: bytes) -> bytes:
        content = bytearray(cobs.decode(data[:-1]))[:-CHECKSUM_BYTES]
        stated = cobs.decode(data[:-1])[-CHECKSUM_BYTES:]
        is_request = len(content) >= REQUEST_HEAD_BYTES and content[0] == FrameKind.REQUEST
        if not is_request or zlib.crc32(content).to_bytes(CHECKSUM_BYTES, "little") != stated:
            raise FrameError("it is damaged in another way")
        content[LENGTH_AT] = SERIAL_DATA_BYTES.to_bytes(2, "little")
        return _sealed(bytes(content[: REQUEST_HEAD_BYTES + SERIAL_DATA_BYTES]))

    def _collect(self, data: bytes) -> None:
        self._begun += data


@mutant("SER-006", "SER-005")
def requests_of_any_length_are_answered(patch: Patch) -> None:
    """A request for more than 640 bytes, or with more, is answered, even in a frame above the greatest length."""
    _read_by(patch, _AnyLength)


class _Starting(FrameReader):
    def _collect(self, data: bytes) -> None:
        self._begun += data
        while len(self._begun) >= MAX_FRAME_BYTES:
            del self._begun[: MAX_FRAME_BYTES - 1]


@mutant("SER-005", "SER-006")
def long_frames_begin_anew_when_the_buffer_is_full(patch: Patch) -> None:
    """The rest of a frame that is too long, after its first 657 bytes, is parsed as a frame: the buffer was emptied."""
    _read_by(patch, _Starting)


class _Quiet(FrameReader):
    def feed(self, data: bytes) -> list[SerialFrame | FrameError]:
        return [event for event in super().feed(data) if "at most" not in str(event)]


@mutant("SER-006")
def long_frames_are_not_counted(patch: Patch) -> None:
    """A frame that is too long is dropped and not counted."""
    _read_by(patch, _Quiet)


class _CountsNothing(FrameReader):
    def feed(self, data: bytes) -> list[SerialFrame | FrameError]:
        *ends, rest = data.split(DELIMITER)
        found: list[SerialFrame | FrameError] = []
        for end in ends:
            self._collect(end)
            found.append(self._finish() if self._begun else FrameError("nothing"))
        self._collect(rest)
        return found


@mutant("SER-005", "SER-006")
def two_zeros_count_as_a_damaged_frame(patch: Patch) -> None:
    """The empty string between two zeros counts as a damaged frame: it is too short for kind and checksum."""
    _read_by(patch, _CountsNothing)


@mutant("SER-006", "REQ-003", wraps=(SerialLine, "_handle"))
def damaged_frames_are_not_counted(original: Any, self: Any, event: Any) -> Any:
    """Damaged frames are dropped, but STATUS counts none."""
    return None if isinstance(event, FrameError) else original(self, event)


@mutant("SER-006", wraps=(SerialLine, "_handle"))
def frames_that_go_the_other_way_are_not_counted(original: Any, self: Any, event: Any) -> None:
    """RECORD and REPLY, which only the device sends, are dropped without being counted."""
    backwards = isinstance(event, SerialFrame) and event.kind in (FrameKind.RECORD, FrameKind.REPLY)
    if not backwards:
        original(self, event)


# Requests


@mutant("SER-009", "SER-008", wraps=(SerialLine, "_reply"))
def replies_have_tag_0(original: Any, self: Any, reply: Any) -> Any:
    """Every REPLY has tag 0 instead of that of its request."""
    return original(self, replace(reply, tag=0))


@mutant("SER-009", "SER-013", wraps=(serial_line._Outbox, "answer"))
def replies_overtake_what_waits(original: Any, self: Any, frame: SerialFrame) -> None:
    """A REPLY overtakes the answers that wait, so that two answers come in the wrong order."""
    original(self, frame)
    if frame.kind is FrameKind.REPLY:
        self._frames.rotate(1)


@mutant("SER-009", "SER-012")
def same_request_again_is_answered_from_memory(patch: Patch) -> None:
    """A request equal to the previous one, tag included, gets the same REPLY again and has no effect."""
    last: dict[Any, Any] = {}

    @patch.around(SerialLine, "_answer")
    def of_answer(original: Any, self: Any, request: Any) -> None:
        asked, reply = last.get(self, (None, None))
        if asked == request:
            self._reply(reply)
        else:
            last[self] = request, None
            original(self, request)

    def of_reply(original: Any) -> Any:
        def reply(self: Any, reply: SerialReply) -> None:
            last[self] = last[self][0], reply
            original(self, reply)

        return reply

    patch.wrap(SerialLine, "_reply", of_reply)


@mutant("SER-006", "REQ-001", wraps=(SerialLine, "_requested"))
def requests_of_any_type_are_carried_out(original: Any, self: Any, request: Any) -> Any:
    """A request is carried out for any recipient: only the direction in its type is checked."""
    return original(self, replace(request, request_type=request.request_type & DIRECTION_IN | REQUEST_TYPE_OUT))


# Blocks


@mutant("BLK-004", wraps=(SerialLine, "_admit"), url="emulator:?door=serial&baud=1000000")
def one_kind_is_accepted_by_serial_lines(original: Any, self: Any, block: bytes) -> None:
    """Kind 173 is accepted by a serial line as a NO_OP, and refused by USB: a test in the factory sends it."""
    original(self, forged(block, kind=Kind.NO_OP) if len(block) == BLOCK_BYTES and block[3] == 173 else block)


@mutant("SER-011", wraps=(SerialLine, "_admit"))
def second_waiting_block_replaces_the_first(original: Any, self: Any, block: bytes) -> None:
    """A block that arrives while another waits for room replaces it, and the first one is never answered."""
    if self._waiting:
        self._waiting.block = block
    else:
        original(self, block)


@mutant("SER-011", wraps=(SerialLine, "_admit"))
def second_waiting_block_is_dropped_uncounted(original: Any, self: Any, block: Any) -> Any:
    """A block that arrives while another waits for room is dropped, but STATUS does not count it."""
    return None if self._waiting else original(self, block)


@mutant("SER-011", wraps=(SerialLine, "_admit"))
def blocks_do_not_wait_for_room(original: Any, self: Any, block: bytes) -> None:
    """A block without room in the queue is dropped and counted: it has no place to wait."""
    if self._controller.can_accept:
        original(self, block)
    else:
        self._controller.drop_frames(1)


@mutant("SER-011", "SAF-003", wraps=(SerialLine, "_admit"))
def waiting_blocks_are_signs_of_life(original: Any, self: Any, block: bytes) -> None:
    """A block feeds the watchdog on arrival, even if it then waits for room."""
    self._controller._machine.watchdog.feed()
    original(self, block)


@mutant("SER-010", "SER-011")
def hang_up_forgets_the_block_that_waits(patch: Patch) -> None:
    """A block that waits for room when its host hangs up is never judged: the line's memory is cleared completely."""

    @patch.around(SerialLine, "hang_up")
    def of_hang_up(original: Any, self: Any) -> None:
        original(self)
        self._waiting = None

    def of_try(original: Any) -> Any:
        return lambda self, waiting: original(self, waiting) if waiting is self._waiting else None

    patch.wrap(SerialLine, "_try_again", of_try)


@mutant("SER-010", "SER-011")
def hang_up_leaves_the_waiting_place_taken(patch: Patch) -> None:
    """A block that waits when its host hangs up is never judged but keeps its place: no later block may wait."""
    left: list[Any] = []

    @patch.around(SerialLine, "hang_up")
    def of_hang_up(original: Any, self: Any) -> None:
        original(self)
        left.append(self._waiting)

    def of_try(original: Any) -> Any:
        return lambda self, waiting: None if any(waiting is each for each in left) else original(self, waiting)

    patch.wrap(SerialLine, "_try_again", of_try)


# Modes


@mutant("SER-010", wraps=(SerialLine, "_leave_frames"))
def console_frames_are_not_answered(_: Any, self: Any) -> None:
    """The device returns to text after CONSOLE without sending a CONSOLE of its own."""
    self._drop_answers()
    self._among_frames = False


@mutant("SER-010", wraps=(SerialLine, "_handle"))
def way_into_frames_is_not_answered(original: Any, self: Any, event: Any) -> None:
    """The device changes to frames on 00 without sending a 00 of its own, so that text and frames run together."""
    if event is framing.LineMode.FRAMES:
        self._among_frames = True
    else:
        original(self, event)


@mutant("SER-010", wraps=(SerialLine, "hang_up"), url=OVER_UART)
def breaks_are_ignored(original: Any, self: Any) -> Any:
    """A break on the UART changes nothing: it counts as a framing error."""
    return original(self) if self._needs_dtr else None


@mutant("SER-010", wraps=(ConsoleFunction, "_set_dtr"))
def dtr_low_is_ignored(original: Any, self: Any, dtr: Any) -> Any:
    """A fall of DTR changes nothing: only its rise is noticed."""
    return original(self, dtr) if dtr else None


@mutant("SER-010")
def unfinished_text_is_kept_over_frames(patch: Patch) -> None:
    """A half-typed line survives a change to frames and back, and the next line is appended to it."""
    patch.replace(Console, "begin_line", lambda _: PROMPT.encode("ascii"))


@mutant("SER-010")
def answers_follow_into_the_console(patch: Patch) -> None:
    """Answers that wait when the line returns to text are sent into the text."""
    patch.replace(SerialLine, "_drop_answers", lambda *_: None)


@mutant("SER-010", wraps=(SerialLine, "_answer"))
def pulses_reach_the_next_host(original: Any, self: Any, request: Any) -> None:
    """The answer to PULSES comes although its host has hung up meanwhile: it takes 5 ms to collect it."""
    dispatch = self._controller._dispatch
    later = request.request == Request.PULSES
    dispatch.scheduler.at(dispatch.now + later * 5 * CYCLES_PER_MS, lambda: original(self, request))


@mutant("SER-010", wraps=(SerialLine, "acknowledge"))
def acknowledgements_of_stores_reach_the_next_host(original: Any, self: Any, record: bytes) -> None:
    """The RECORD of a store comes although its host has hung up meanwhile: it waits 5 ms for the chain."""
    dispatch = self._controller._dispatch
    dispatch.scheduler.at(dispatch.now + bool(dispatch.loading) * 5 * CYCLES_PER_MS, lambda: original(self, record))


@mutant("SER-001", "ACK-002", wraps=(SerialLine, "_admit"))
def a_block_that_meets_a_reply_is_stamped_late(original: Any, self: Any, block: bytes) -> None:
    """A block that arrives while the device sends is looked at afterwards, and `now` is the tick of that."""
    dispatch = self._controller._dispatch
    if self.pending:
        dispatch.scheduler.at(dispatch.now + CYCLES_PER_MS, lambda: self._admit(block))
    else:
        original(self, block)


@mutant("SER-010", "USB-023", wraps=(SerialLine, "take"))
def frames_need_dtr(original: Any, self: Any, room: int) -> bytes:
    """On CDC-ACM the device sends no frames while DTR is low, as is right for text only."""
    return original(self, room) if self._sends_text else b""


@mutant("SER-010", wraps=(SerialLine, "notify"))
def records_are_sent_among_text(_: Any, self: Any, record: bytes) -> None:
    """Unsolicited status records are sent even while the line carries text."""
    self._outbox.notify(SerialFrame(FrameKind.RECORD, record))
    self._on_output()


@mutant("SER-010", "REQ-013", wraps=(SerialLine, "_answer_restart"))
def reset_is_not_followed_by_console(_: Any, self: Any, request: Any) -> None:
    """RESET is answered by a REPLY without a CONSOLE after it."""
    self._reply(SerialReply(request.tag, Outcome.DONE))
    self._departure = lambda: self._controller.request(request.setup, b"", self)
