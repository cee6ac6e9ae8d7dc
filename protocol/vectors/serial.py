"""Vectors of the serial line: frames, the stream that they share with text, and the console (SPEC.md, SER and CON)."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from typing import Any

from cobs import cobs

from ...base.errors import CommandError, FrameError
from ..blocks import pack
from ..codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, SERIAL_DATA_BYTES, ConsoleCode, FrameKind, Outcome, Request
from ..console import (
    MAX_LINE_CHARACTERS,
    PROMPT,
    Command,
    LineEditor,
    answer_fields,
    format_fields,
    format_ok,
    help_fields,
    parse_command,
)
from ..framing import (
    CONSOLE_FRAME,
    DELIMITER,
    MAX_FRAME_BYTES,
    LineEvent,
    LineMode,
    LineReader,
    SerialFrame,
    SerialReply,
    SerialRequest,
    encode,
)
from ..replies import encode_reports, encode_wiring
from ..wiring import Wiring
from .blocks import BLOCKS
from .cases import Section, section, vector
from .replies import ACK, INFO, RECORDS, REPORTS, STATUS

__all__ = ["commands", "exchanges", "frames", "refused_frames", "streams", "typing"]

ONES = b"\x11"


def _block(name: str) -> SerialFrame:
    return SerialFrame(FrameKind.BLOCK, pack(BLOCKS[name][1]))


def _request(
    tag: int, request_type: int, request: int, value: int = 0, index: int = 0, data: bytes = b""
) -> SerialFrame:
    length = 64 if request_type & 0x80 else len(data)
    return SerialFrame(
        FrameKind.REQUEST, SerialRequest(tag, request_type, request, value, index, length, data).encode()
    )


def _reply(tag: int, outcome: Outcome, data: bytes = b"") -> SerialFrame:
    return SerialFrame(FrameKind.REPLY, SerialReply(tag, outcome, data).encode())


FRAMES: dict[str, tuple[str, SerialFrame]] = {
    "console": ("no body: what follows is text", CONSOLE_FRAME),
    "status-request": ("the first example of SER-016", _request(0x2A, REQUEST_TYPE_IN, Request.STATUS)),
    "stall-reply": ("the second example of SER-016", _reply(0x2A, Outcome.STALL)),
    "watchdog-request": ("a request with a value", _request(1, REQUEST_TYPE_OUT, Request.WATCHDOG, value=5000)),
    "done-reply": ("done, and nothing to say", _reply(1, Outcome.DONE)),
    "info-reply": ("a reply with data", _reply(0xFF, Outcome.DONE, INFO.encode())),
    "wiring-reply": (
        "a reply with as much data as any request answers",
        _reply(2, Outcome.DONE, encode_wiring(Wiring.strips())),
    ),
    "largest-request": (
        "a request with as much data as can be: no request of this version has any",
        _request(3, REQUEST_TYPE_OUT, 0x7F, 0x0101, 0x0101, data=ONES * SERIAL_DATA_BYTES),
    ),
    "ack": ("an acknowledgement", SerialFrame(FrameKind.RECORD, ACK.encode())),
    "status": ("a status record", SerialFrame(FrameKind.RECORD, STATUS.encode())),
    "block-zeros": ("a block of little but zeros", _block("no-op")),
    "block-pulses": ("a block without many zeros", _block("update-mixed")),
    "group-253": ("253 bytes without a zero after the outcome's: FE", _reply(5, Outcome.DONE, ONES * 249)),
    "group-254": ("254 bytes at the end: FF, and no group of nothing after it", _reply(5, Outcome.DONE, ONES * 250)),
    "group-255": ("255 bytes at the end: FF, then 02", _reply(5, Outcome.DONE, ONES * 251)),
    "group-before-zero": (
        "254 bytes and a zero: FF, then 01 for the zero",
        _reply(5, Outcome.DONE, ONES * 254 + bytes(1) + ONES),
    ),
}
TO_DEVICE, TO_HOST = "to the device", "to the host"
DIRECTIONS = {
    FrameKind.BLOCK: TO_DEVICE,
    FrameKind.RECORD: TO_HOST,
    FrameKind.REQUEST: TO_DEVICE,
    FrameKind.REPLY: TO_HOST,
    FrameKind.CONSOLE: "both ways",
}


def frames() -> Section:
    """Frames of all types."""
    return section(
        "Frames on a serial line as they travel, with the zero that ends them (SER-002). body is what stands between "
        "type and checksum.",
        (
            vector(
                f"frame-{name}",
                shows,
                hex=encode(frame),
                type=frame.kind,
                code=frame.kind.value,
                goes=DIRECTIONS[frame.kind],
                body=frame.body,
                **_fields(frame),
            )
            for name, (shows, frame) in FRAMES.items()
        ),
    )


def _fields(frame: SerialFrame) -> dict[str, Any]:
    if frame.kind is FrameKind.REQUEST:
        return {"fields": SerialRequest.decode(frame.body)}
    if frame.kind is FrameKind.REPLY:
        return {"fields": SerialReply.decode(frame.body)}
    return {}


def _sealed(kind: int, body: bytes = b"") -> bytes:
    """A frame whose type and body may be anything."""
    content = bytes([kind]) + body
    return bytes(cobs.encode(content + zlib.crc32(content).to_bytes(4, "little"))) + DELIMITER


def _broken_frames() -> Mapping[str, tuple[str, str, bytes]]:
    ack, group = encode(FRAMES["ack"][1]), encode(FRAMES["group-254"][1])
    head = bytes([1, REQUEST_TYPE_OUT, 0x7F, 0, 0, 0, 0])
    return {
        "beyond": ("a length byte that points past the end", "SER-003", bytes([5, 1, 2, 0])),
        "group-of-nothing": ("a group of nothing after a full one at the end", "SER-003", group[:-1] + b"\x01\0"),
        "cut": ("the first half of a frame", "SER-006", ack[:20] + DELIMITER),
        "lost": ("a byte in the middle was lost", "SER-006", ack[:20] + ack[21:]),
        "flipped": ("a bit was flipped", "SER-006", ack[:20] + bytes([ack[20] ^ 0x80]) + ack[21:]),
        "short": ("too short for type and checksum", "SER-006", bytes([5, 1, 2, 3, 4, 0])),
        "long": ("one byte more than the longest frame", "SER-006", _sealed(4, bytes(2) + b"\1" * 641)),
        "type-0": ("type 0", "SER-004", _sealed(0)),
        "type-6": ("type 6", "SER-004", _sealed(6)),
        "block-511": ("a block that is too short", "SER-006", _sealed(FrameKind.BLOCK, bytes(511))),
        "record-33": ("a record of no size that there is", "SER-006", _sealed(FrameKind.RECORD, bytes(33))),
        "console-body": ("CONSOLE has no body", "SER-004", _sealed(FrameKind.CONSOLE, bytes(1))),
        "request-short": ("less than tag and SETUP packet", "SER-007", _sealed(FrameKind.REQUEST, bytes(8))),
        "request-data": ("less data than announced", "SER-007", _sealed(FrameKind.REQUEST, head + bytes([2, 0, 1]))),
        "request-641": (
            "asks for more than a frame carries",
            "SER-007",
            _sealed(FrameKind.REQUEST, bytes([1, REQUEST_TYPE_IN, 3, 0, 0, 0, 0, 0x81, 2])),
        ),
        "request-in-data": (
            "data with a request that asks for some",
            "SER-007",
            _sealed(FrameKind.REQUEST, bytes([1, REQUEST_TYPE_IN, 2, 0, 0, 0, 0, 1, 0, 0])),
        ),
        "reply-short": ("no outcome", "SER-008", _sealed(FrameKind.REPLY, bytes([1]))),
        "reply-outcome": ("outcome 2", "SER-008", _sealed(FrameKind.REPLY, bytes([1, 2]))),
        "reply-stall-data": ("data after STALL", "SER-008", _sealed(FrameKind.REPLY, bytes([1, 1, 0]))),
    }


def refused_frames() -> Section:
    """Damaged frames."""
    return section(
        "Damaged frames (SER-006), with their ending zero: they are dropped and counted, and not answered.",
        (
            vector(f"refused-frame-{name}", shows, hex=data, clause=clause)
            for name, (shows, clause, data) in _broken_frames().items()
        ),
    )


def _event(event: LineEvent) -> dict[str, Any]:
    match event:
        case LineMode():
            return {"mode": event.name}
        case SerialFrame():
            return {"frame": event.kind, "body": event.body}
        case FrameError():
            return {"dropped": 1}
        case _:
            return {"text": event}


def streams() -> Section:
    """What both ends make of the bytes on a line."""
    ack, console = encode(FRAMES["ack"][1]), encode(CONSOLE_FRAME)
    cases = {
        "text": ("a line begins with the console", b"enable\r"),
        "enter": ("a zero begins frames, and unfinished text ends", b"ena\0" + ack),
        "zeros": ("zeros in a row hold no damaged frame", b"\0\0\0" + ack + b"\0\0" + ack),
        "leave": ("a CONSOLE frame ends frames", b"\0" + ack + console + b"> status\r\n"),
        "resynchronise": ("00, CONSOLE, 00: frames begin, whatever was before", b"?\0" + console + b"\0" + ack),
        "damaged": ("damage ends with the next zero", b"\0" + ack[:10] + b"\0" + ack),
        "too-long": (
            "of a frame that is too long, all is dropped up to its zero",
            b"\0" + b"\2" * (MAX_FRAME_BYTES + 9) + b"\0" + ack,
        ),
        "damaged-console": ("a damaged CONSOLE frame ends nothing", b"\0" + console[:3] + b"\xaa" + console[4:] + ack),
    }
    return section(
        "Bytes on a new line, and what they are (SER-010): text, the modes that begin, frames by type, and frames that "
        "were dropped. Text that stands together may be read in pieces.",
        (
            vector(f"stream-{name}", shows, hex=data, events=[_event(event) for event in LineReader().feed(data)])
            for name, (shows, data) in cases.items()
        ),
    )


def typing() -> Section:
    """What a terminal's keys do."""
    full = b"x" * MAX_LINE_CHARACTERS
    cases = {
        "cr": ("CR ends a line", b"status\r", True),
        "lf": ("so does LF", b"status\n", True),
        "crlf": ("CR LF ends one line, not two", b"status\r\nclock\r\n", True),
        "lfcr": ("LF CR ends two", b"status\n\r", True),
        "backspace": ("08 and 7F take back one character each", b"stut\x08\x7fatus\r", True),
        "backspace-empty": ("and nothing if there is none", b"\x08\x7fok\r", True),
        "cancel": ("03 and 15 take back the whole line", b"abc\x03de\x15clock\r", True),
        "unprintable": ("an unprintable character stays in the line and is shown as ?", b"st\xe4tus\t\r", True),
        "full": ("80 characters", full + b"\r", True),
        "too-long": ("the 81st rings, and so does the 82nd, which is forgotten", full + b"yz\r", True),
        "too-long-taken-back": ("the 81st can be taken back", full + b"yz\x08\r", True),
        "no-echo": ("after echo 0 nothing is sent back", b"stut\x08\r", False),
    }

    def made(typed: bytes, echo: bool) -> dict[str, Any]:
        lines, shown = LineEditor(echo=echo).feed(typed)
        return {"lines": lines, "shown": shown}

    return section(
        "Bytes typed at a console, the lines that they make and the bytes that are sent back for them (CON-003); "
        "answers and prompts are not shown. A character of a line stands for one byte.",
        (
            vector(f"typing-{name}", shows, typed=typed, echo=echo, **made(typed, echo))
            for name, (shows, typed, echo) in cases.items()
        ),
    )


def commands() -> Section:
    """What a line of the console is."""
    lines = {
        "plain": "status",
        "spaces": "   status  ",
        "nothing": "",
        "only-spaces": "   ",
        "argument": "watchdog 5000",
        "argument-zeros": "  identify   0004 ",
        "least": "watchdog 10",
        "most": "limit 320",
        "last-transducer": "test 319",
        "echo": "echo 0",
        **{name: name for name in ("help", "version", "info", "faults", "clock", "boards", "enable", "stop", "clear")},
        **{name: name for name in ("reset", "dfu", "frames")},
        "pulses": "pulses 17",
        "length": "x" * (MAX_LINE_CHARACTERS + 1),
        "length-before-character": "\t" * (MAX_LINE_CHARACTERS + 1),
        "character": "status\t",
        "character-latin": "st\xe4tus",
        "character-before-command": "halt\x7f",
        "command": "halt",
        "command-case": "Status",
        "command-before-arguments": "halt 1 2 3",
        "arguments-missing": "watchdog",
        "arguments-many": "watchdog 10 20",
        "arguments-none": "status 1",
        "arguments-sign": "limit -1",
        "arguments-plus": "limit +1",
        "arguments-hex": "limit 0x10",
        "arguments-point": "limit 1.0",
        "range-below": "watchdog 9",
        "range-above": "watchdog 60001",
        "range-limit": "limit 400",
        "range-transducer": "test 320",
        "range-board": "identify 5",
        "range-huge": "echo 99999999999999999999",
    }
    return section(
        "Lines of a console: the command and its argument, or the code of CON-006. A line without words is no command. "
        "REFUSED is not among them: it depends on the device's state.",
        (vector(f"command-{name}", _tells(line), line=line, **_judged(line)) for name, line in lines.items()),
    )


def _tells(line: str) -> str:
    outcome = _judged(line)
    if "error" in outcome:
        return f"refused: {outcome['error'].name}"
    return "a command" if outcome["command"] else "nothing to do but to prompt"


def _judged(line: str) -> dict[str, Any]:
    try:
        command = parse_command(line)
    except CommandError as error:
        return {"error": ConsoleCode(error.reason), "code": int(error.reason)}
    return (
        {"command": None, "argument": None}
        if command is None
        else {"command": command.name, "argument": command.argument}
    )


def exchanges() -> Section:
    """Lines and their answers."""
    cases: dict[str, tuple[str, list[tuple[str, object]]]] = {
        "help": ("each command as it is written, and its meaning", [*help_fields()]),
        "clock": ("as in 'clock-reading'", [("now", 20_000), ("sync_period", 0), ("sync_pulses", 1)]),
        "pulses 17": ("after test 17", [("phase", 0), ("width", 2)]),
        "enable": ("nothing to say", []),
    }
    told: list[tuple[str, str, str, bytes]] = [
        ("version", "no more than versions", "info", INFO.encode()),
        (
            "info",
            "every field but the last: a code by its name, bytes in small letters, bits lowest first",
            "info",
            INFO.encode(),
        ),
        *(
            (line, shows, name, RECORDS[name][1].encode())
            for line, shows, name in (
                ("status", "names of what is 0: no faults, no refusal, no flags", "status-at-rest"),
                ("status", "two flags and a refusal", "status-playing"),
                ("status", "every fault, and a negative number", "status-faults"),
                ("faults", "none is set", "status-at-rest"),
                ("faults", "every one is set", "status-faults"),
            )
        ),
        ("boards", "a line for each processor", "processors", encode_reports(REPORTS["processors"][1])),
        (
            "boards",
            "the last processor is not there",
            "processors-missing",
            encode_reports(REPORTS["processors-missing"][1]),
        ),
    ]
    return section(
        "Lines of a console and all that the device sends after them, the prompt included (CON-002, CON-007). What "
        "comes from a record or from an answer of REQ names that one in 'of'.",
        [
            *(
                vector(f"exchange-{line.split()[0]}", shows, line=line, answer=_answered(fields))
                for line, (shows, fields) in cases.items()
            ),
            *(
                vector(
                    f"exchange-{line}-{name.removeprefix(line)}".replace("--", "-").strip("-"),
                    shows,
                    line=line,
                    of=name,
                    answer=_answered(answer_fields(Command(line), data)),
                )
                for line, shows, name, data in told
            ),
        ],
    )


def _answered(fields: Iterable[tuple[str, object]]) -> str:
    return format_fields(fields) + format_ok() + PROMPT
