"""What bytes of the protocol mean, for people: what they are, what they say, and which clause they break.

Each function takes bytes and gives a `Description`; none of them refuses anything. What breaks the specification is in
the findings, beside what could be read all the same.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from construct import ConstructError

from ..errors import BlockError, ChainError, FrameError, ImageError, ReplyError
from . import chain, framing
from .blocks import (
    Body,
    Clock,
    Entries,
    Modulation,
    NoOp,
    Output,
    Samples,
    Sequence,
    Slot,
    Update,
    header_fields,
    unpack,
)
from .board import PROCESSORS
from .codes import (
    BLOCK_MAGIC,
    HEADER_BYTES,
    NOW,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    STATUS_MAGIC,
    DescriptorType,
    DfuRequest,
    DfuState,
    FrameKind,
    ImageReason,
    Kind,
    Reason,
    Request,
    StandardRequest,
)
from .descriptors import Descriptor, Device, Languages, String, descriptors, ms_os_descriptors
from .dfu import DfuReply
from .enumeration import CONSOLE_INTERFACE, MS_OS_INDEX, MS_OS_VENDOR_CODE
from .firmware import parse
from .plain import plain
from .pulses import Pulses
from .replies import (
    WIRING_BYTES,
    Ack,
    ClockReading,
    Info,
    ProcessorReport,
    ReadBack,
    Status,
    decode_reports,
    decode_wiring,
)
from .requests import DIRECTION_IN, VALUES, Setup
from .versions import Version
from .wiring import Wiring

__all__ = [
    "Description",
    "Finding",
    "describe_block",
    "describe_frame",
    "describe_image",
    "describe_message",
    "describe_record",
    "describe_request",
    "describe_text",
]


class Finding(NamedTuple):
    """Something that breaks the specification.

    Parameters
    ----------
    reason : str
        Name of the code that a device gives for it; empty where it has none.
    clause : str
        The clause that is broken.
    text : str
        What is wrong, for people.
    """

    reason: str
    clause: str
    text: str


@dataclass(frozen=True)
class Description:
    """What some bytes are.

    Parameters
    ----------
    kind : str
        The noun for it: ``block``, ``acknowledgement``, ``status``, ``request``, …
    summary : str
        What it says, in a line.
    fields : mapping
        What can be read of it: names to numbers, texts, and lists and mappings of these.
    findings : tuple of Finding
        What is wrong with it; empty if it is valid.
    pulses : Pulses or None
        The pulses that it carries.
    """

    kind: str
    summary: str
    fields: Mapping[str, Any] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    pulses: Pulses | None = None

    @property
    def valid(self) -> bool:
        """Whether nothing was found that breaks the specification."""
        return not self.findings


# ------------------------------------------------------------------------------------------------------------- blocks

_TOLD_ANYWAY = ("magic", "version", "kind", "sequence", "checksum")
_CHECKSUM_BYTES = 4


def describe_block(data: bytes) -> Description:
    """Describe what came on bulk OUT (chapter BLK)."""
    try:
        body, sequence, restart = unpack(data)
    except BlockError as error:
        reason = Reason(error.reason)
        return _refused_block(data, Finding(reason.name, reason.clause, str(error)))
    name = body.KIND.name
    return Description(
        "block",
        f"{name} {sequence}{', numbering anew' if restart else ''}: {_said(body)}",
        {"kind": name, "sequence": sequence, "restart": restart} | _plain(body),
        pulses=getattr(body, "pulses", None),
    )


def _refused_block(data: bytes, finding: Finding) -> Description:
    """What can be read all the same of a block that is refused: its header, if it is one."""
    if not data.startswith(BLOCK_MAGIC) or len(data) < HEADER_BYTES:
        return Description("block", _few(data), {}, (finding,))
    fields = header_fields(data)
    told = {name: value for name, value in fields.items() if value and name not in _TOLD_ANYWAY}
    name = _name(Kind, fields["kind"])
    summary = ", ".join([f"{name} {fields['sequence']}", *(f"{field} {value}" for field, value in told.items())])
    return Description("block", summary, fields | {"kind": name, "magic": BLOCK_MAGIC.decode()}, (finding,))


def _name(codes: type[Enum], value: object) -> str:
    """Name of a code; the number itself where it has none."""
    return next((code.name for code in codes if code.value == value), f"{value}?")


def _said(body: Body) -> str:
    """What a block's body asks for, in words."""
    match body:
        case Update():
            return f"{_sound(body.pulses)} {_when(body.period)}"
        case Slot():
            return f"{_sound(body.pulses)} into slot {body.number}"
        case Entries():
            return f"store entries {_range(body.first, len(body.entries))}"
        case Sequence():
            times = f"{body.repeats} times" if body.repeats else "until something else follows"
            alone = ", also without the host" if body.unattended else ""
            return f"play entries {_range(body.first, body.count)} {_when(body.period)}, {times}{alone}"
        case Samples():
            return f"store samples {_range(body.first, len(body.samples))}"
        case Modulation():
            held = f"{body.hold} periods each"
            return f"modulate with samples {_range(body.first, body.count)} {_when(body.period)}, {held}"
        case Output():
            return f"{body.action.name} {_when(body.period)}"
        case Clock():
            return "tell the time"
        case NoOp():
            return "a sign of life"


def _when(period: int) -> str:
    return "as soon as possible" if period == NOW else f"from period {period} on"


def _range(first: int, count: int) -> str:
    return f"{first} to {first + count - 1}"


def _sound(pulses: Pulses) -> str:
    """What pulses amount to, in words."""
    amount = _amount(pulses)
    if not amount["sounding"]:
        return "silence"
    return "{sounding} pulses of at most {widest_ticks} ticks, total drive {total_drive:.1f},".format_map(amount)


def _amount(pulses: Pulses) -> dict[str, Any]:
    """How many pulses are none of silence, the widest of them, and the power of all in fully driven transducers."""
    return {
        "sounding": int(np.count_nonzero(pulses.width)),
        "widest_ticks": int(pulses.width.max()),
        "total_drive": pulses.total_drive / 1000,
    }


# ------------------------------------------------------------------------------------------------------------ records


def describe_record(data: bytes) -> Description:
    """Describe a record that came on bulk IN: an acknowledgement or a status (chapters ACK and REQ)."""
    if data.startswith(STATUS_MAGIC):
        return _record("status", data, Status.decode, "REQ-003")
    return _record("acknowledgement", data, Ack.decode, "ACK-002")


def _record(kind: str, data: bytes, decode: Callable[[bytes], Ack | Status], clause: str) -> Description:
    try:
        record = decode(data)
    except ReplyError as error:
        finding = Finding("", clause, _shortly(error))
        body, end = data[:-_CHECKSUM_BYTES], data[-_CHECKSUM_BYTES:]
        if len(data) in (Ack.BYTES, Status.BYTES) and end != (computed := zlib.crc32(body).to_bytes(4, "little")):
            finding = Finding("CHECKSUM", clause, f"CRC-32 {end[::-1].hex()} should be {computed[::-1].hex()}")
        return Description(kind, _few(data), {}, (finding,))
    return Description(kind, _told(record), _plain(record))


def _few(data: bytes, most: int = 16) -> str:
    size = "1 byte" if len(data) == 1 else f"{len(data)} bytes"
    return size + (f": {data[:most].hex(' ')}" if data else "") + (" …" if len(data) > most else "")


def _shortly(error: ReplyError) -> str:
    """What is wrong with an answer, without its bytes."""
    cause = error.__cause__
    if isinstance(cause, ConstructError) and cause.path:
        return f"{cause.path.split(' -> ')[-1]}: {str(cause).splitlines()[-1]}"
    return str(error)


def _told(answer: Any) -> str:
    """What an answer of the device says, in a line."""
    match answer:
        case Ack():
            outcome = f"accepted, period {answer.commit_period}"
            if answer.reason != Reason.ACCEPTED:
                outcome = f"refused, {answer.reason.name}: {answer.reason.text}"
            flags = "".join(f", {flag}" for flag in _plain(answer.flags))
            return f"{answer.sequence} {outcome}{flags}; {answer.state.name}, room for {answer.free}"
        case Status():
            faults = ", ".join(_plain(answer.faults)) or "no faults"
            return (
                f"{answer.state.name} in period {answer.period}, {faults}; {answer.accepted} accepted, "
                f"{answer.refused} refused, {answer.late} late, {answer.lost} lost, "
                f"{answer.missed_commits} commits missed"
            )
        case Info():
            features = ", ".join(map(str, _plain(answer.features))) or "no features"
            version = Version(*answer.firmware)
            return f"firmware {version}, {answer.boards} boards, {answer.channels} transducers, {features}"
        case ClockReading():
            return f"tick {answer.now}, {answer.sync_pulses} sync pulses, the last in period {answer.sync_period}"
        case ReadBack():
            return f"{_sound(answer.pulses)} since period {answer.since_period}"
        case Wiring():
            return f"transducer 0 on channel {answer.channels[0]}, the last on channel {answer.channels[-1]}"
    return ", ".join("fault" if report.faults else "well" for report in answer)


_plain = partial(plain, pulses=_amount)
"""The same in values that JSON knows, with no more of pulses than they amount to."""


# ----------------------------------------------------------------------------------------------------------- requests


_TYPE_BITS = 0x60
_VENDOR_DEVICE_IN = 0xC0
_CLASS_INTERFACE = 0x21
_CONSOLE_REQUESTS = {
    0x20: "SET_LINE_CODING",
    0x21: "GET_LINE_CODING",
    0x22: "SET_CONTROL_LINE_STATE",
    0x23: "SEND_BREAK",
}

_VALUE_CLAUSES = {Request.WATCHDOG: "REQ-009", Request.LIMIT: "REQ-010", Request.IDENTIFY: "REQ-012"}

_ANSWERS: Mapping[Request, tuple[str, Callable[[bytes], Any], int]] = {
    Request.INFO: ("REQ-002", Info.decode, Info.BYTES),
    Request.STATUS: ("REQ-003", Status.decode, Status.BYTES),
    Request.WIRING: ("REQ-004", decode_wiring, WIRING_BYTES),
    Request.CLOCK: ("REQ-006", ClockReading.decode, ClockReading.BYTES),
    Request.PULSES: ("REQ-007", ReadBack.decode, ReadBack.BYTES),
    Request.PROCESSORS: ("REQ-008", decode_reports, PROCESSORS * ProcessorReport.BYTES),
}
"""Clause, reader and size of the answer to a request."""


def describe_request(setup: bytes, data: bytes | None = None, *, stalled: bool = False) -> Description:
    """Describe a control request (chapters REQ, USB and DFU).

    Parameters
    ----------
    setup : bytes
        Its setup stage.
    data : bytes or None
        Its data stage, in whichever direction; None where it is not known.
    stalled : bool
        Whether the device answered STALL.
    """
    try:
        fields = Setup.decode(setup)
    except ValueError as error:
        return Description("request", _few(setup), {}, (Finding("", "USB-004", str(error)),))
    description = _describer(fields)(fields, None if stalled else data)
    summary = description.summary + (", answered with STALL" if stalled else "")
    told = asdict(fields) | {"stalled": stalled} | dict(description.fields)
    return replace(description, summary=summary, fields=told)


def _describer(setup: Setup) -> Callable[[Setup, bytes | None], Description]:
    """Who knows a request, by its type and recipient."""
    if setup.request_type in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
        return _describe_vendor
    if (setup.request_type, setup.request, setup.index) == (_VENDOR_DEVICE_IN, MS_OS_VENDOR_CODE, MS_OS_INDEX):
        return _describe_ms_os
    if not setup.request_type & _TYPE_BITS and setup.request in set(StandardRequest):
        return _describe_standard
    if setup.request_type & ~DIRECTION_IN == _CLASS_INTERFACE and setup.index == CONSOLE_INTERFACE:
        return _describe_console
    if setup.request_type & ~DIRECTION_IN == _CLASS_INTERFACE and setup.request in set(DfuRequest):
        return _describe_dfu
    return _describe_other


def _describe_other(setup: Setup, data: bytes | None) -> Description:
    summary = f"{setup.request_type:02x} {setup.request:02x}, value {setup.value:04x}, index {setup.index:04x}"
    return Description("request", summary + (f", {_few(data)}" if data else ""))


def _describe_console(setup: Setup, data: bytes | None) -> Description:
    """A request to the function of the console (CDC 1.2, PSTN subclass, table 13)."""
    name = _CONSOLE_REQUESTS.get(setup.request, f"{setup.request}?")
    return Description("request", f"{name} {setup.value:#x}" + (f": {data.hex(' ')}" if data else ""), {"name": name})


def _describe_dfu(setup: Setup, data: bytes | None) -> Description:
    """A request to the DFU function (chapter DFU)."""
    request = DfuRequest(setup.request)
    fields = {"name": request.name}
    match request:
        case DfuRequest.DNLOAD | DfuRequest.UPLOAD:
            return Description("request", f"{request.name} block {setup.value}, {_few(data or b'', 4)}", fields)
        case DfuRequest.GETSTATUS if data:
            try:
                reply = DfuReply.decode(data)
            except ReplyError as error:
                finding = Finding("", "DFU-007", _shortly(error))
                return Description("request", f"{request.name}: {_few(data)}", fields, (finding,))
            wait = f", wait {reply.poll_ms} ms" if reply.poll_ms else ""
            told = f"{request.name}: {reply.state.name}, {reply.status.name}{wait}"
            return Description("request", told, fields | {"answer": _plain(reply)})
        case DfuRequest.GETSTATE if data:
            return Description("request", f"{request.name}: {_name(DfuState, data[0])}", fields)
    return Description("request", request.name, fields)


def _describe_standard(setup: Setup, data: bytes | None) -> Description:
    """A standard request (clause USB-014)."""
    name = StandardRequest(setup.request).name
    if setup.request != StandardRequest.GET_DESCRIPTOR:
        summary = f"{name} {setup.value:#x}" + (f" of {setup.index:#x}" if setup.index else "")
        return Description("request", summary + (f": {data.hex(' ')}" if data else ""), {"name": name})
    kind, index = divmod(setup.value, 256)
    asked = f"{name} {_name(DescriptorType, kind)}" + (f" {index}" if index else "")
    read = _languages if (kind, index) == (DescriptorType.STRING, 0) else descriptors
    return _describe_descriptors(name, asked, setup, data, read, "USB-006")


def _languages(data: bytes) -> tuple[Descriptor, ...]:
    return (Languages.decode(data),)


def _describe_ms_os(setup: Setup, data: bytes | None) -> Description:
    return _describe_descriptors("MS_OS", "MS_OS descriptor set", setup, data, ms_os_descriptors, "USB-012")


def _describe_descriptors(
    name: str,
    asked: str,
    setup: Setup,
    data: bytes | None,
    read: Callable[[bytes], tuple[Descriptor, ...]],
    clause: str,
) -> Description:
    if not data:
        return Description("request", asked, {"name": name})
    try:
        found = read(data)
    except ReplyError as error:
        # A host asks for a beginning first, to learn how long the whole is.
        findings = () if len(data) == setup.length else (Finding("", clause, _shortly(error)),)
        return Description("request", f"{asked}: {_few(data)}", {"name": name}, findings)
    told = [{"descriptor": type(each).__name__} | _plain(each) for each in found]
    return Description("request", f"{asked}: {_listed(found)}", {"name": name, "descriptors": told})


def _listed(found: tuple[Descriptor, ...]) -> str:
    """Descriptors in words: what a string says, which device it is, else the names of all of them."""
    match found:
        case (String() as string,):
            return repr(string.bString)
        case (Device() as device,):
            return f"{device.idVendor:04x}:{device.idProduct:04x}, release {device.bcdDevice:04x}"
        case (Languages() as languages,):
            return ", ".join(f"{language:04x}" for language in languages.wLANGID)
    return ", ".join(type(each).__name__ for each in found)


def _describe_vendor(setup: Setup, data: bytes | None) -> Description:
    """A request of this protocol (clause REQ-001)."""
    name = _name(Request, setup.request)
    if setup.request not in set(Request):
        return Description(
            "request", name, {"name": name}, (Finding("", "REQ-001", f"unknown request {setup.request}"),)
        )
    request = Request(setup.request)
    summary = f"{name} {setup.value}" if request in VALUES else name
    findings = list(_wrong_setup(request, setup))
    if findings or data is None or not request.answered:
        return Description("request", summary, {"name": name}, tuple(findings))
    clause, decode, size = _ANSWERS[request]
    if len(data) == setup.length < size:
        return Description("request", f"{name}: the first {len(data)} of {size} bytes", {"name": name})
    try:
        answer = decode(data)
    except ReplyError as error:
        return Description("request", f"{name}: {_few(data)}", {"name": name}, (Finding("", clause, _shortly(error)),))
    told = {"name": name, "answer": _plain(answer)}
    return Description("request", f"{name}: {_told(answer)}", told, pulses=getattr(answer, "pulses", None))


def _wrong_setup(request: Request, setup: Setup) -> Iterator[Finding]:
    """What is wrong with the setup stage of a request of this protocol."""
    values = VALUES.get(request, range(1))
    if setup.is_in != request.answered:
        right = REQUEST_TYPE_OUT if setup.is_in else REQUEST_TYPE_IN
        yield Finding(
            "", "REQ-001", f"type {setup.request_type:02x} should be {right:02x}: {request.name} goes that way"
        )
    if setup.index:
        yield Finding("", "REQ-001", f"index {setup.index} should be 0")
    if setup.value not in values:
        right_values = f"{values[0]} to {values[-1]}" if len(values) > 1 else f"{values[0]}"
        clause = _VALUE_CLAUSES.get(request, "REQ-001")
        yield Finding("", clause, f"value {setup.value} should be {right_values}")
    if not setup.is_in and setup.length:
        yield Finding("", "REQ-001", f"{setup.length} bytes are announced; {request.name} carries none")


# -------------------------------------------------------------------------------------------------------- serial lines


def describe_frame(data: bytes) -> Description:
    """Describe what stands before a zero on a serial line (chapter SER): the frame, or rather what it carries."""
    try:
        frame = framing.decode(data + framing.DELIMITER)
    except FrameError as error:
        return Description("frame", _few(data), {}, (Finding("", "SER-006", str(error)),))
    match frame.kind:
        case FrameKind.BLOCK:
            return describe_block(frame.body)
        case FrameKind.RECORD:
            return describe_record(frame.body)
        case FrameKind.REQUEST:
            request = framing.SerialRequest.decode(frame.body)
            described = describe_request(request.setup.encode(), request.data or None)
            return replace(described, fields={"tag": request.tag} | dict(described.fields))
        case FrameKind.REPLY:
            reply = framing.SerialReply.decode(frame.body)
            return Description(
                "reply", f"to request {reply.tag}: {reply.outcome.name}, {_few(reply.data)}", _plain(reply)
            )
        case FrameKind.CONSOLE:
            return Description("frame", "back to the console")


def describe_text(data: bytes) -> Description:
    """Describe text of the console (chapter CON)."""
    text = data.decode("latin-1")  # a character stands for one byte, as where it is typed
    return Description("text", ascii(text)[1:-1], {"text": text})


# -------------------------------------------------------------------------------------------------------------- chain


def describe_message(tokens: bytes) -> Description:
    """Describe a message between controller and processors, END as the byte of its code (chapter CHN)."""
    try:
        message = chain.decode(tokens)
    except ChainError as error:
        return Description("message", _few(tokens), {}, (Finding("", "CHN-010", str(error)),))
    name, fields = message.CHANNEL_END.name, _plain(message)
    told = [
        f"{field} {_few(value) if isinstance(value, bytes) else fields[field]}"
        for field, value in vars(message).items()
    ]
    return Description("message", f"{name}: {', '.join(told)}", {"name": name, "node": message.node} | fields)


# ----------------------------------------------------------------------------------------------------------- firmware


def describe_image(file: bytes) -> Description:
    """Describe the file of a firmware image (chapter FWU). Who signed it is not judged."""
    try:
        image = parse(file)
    except ImageError as error:
        reason = ImageReason(error.reason)
        finding = Finding(reason.name, reason.clause, str(error))
        return Description("firmware image", _few(file), {}, (finding,))
    segments = [{"target": target.name, "bytes": len(data)} for target, data in image.segments]
    signed = "not signed" if image.signature is None else f"signed with key {image.signature.key_id.hex()}"
    return Description(
        "firmware image",
        f"version {image.version} for {image.hardware.name}, {len(segments)} segments, {signed}",
        {
            "version": str(image.version),
            "hardware": image.hardware.name,
            "protocol": image.protocol,
            "segments": segments,
            "key_id": None if image.signature is None else image.signature.key_id.hex(),
        },
    )
