"""What control requests mean (SPEC.md, chapters REQ, USB and DFU)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from typing import Any

from ...base.errors import ReplyError
from ..codes import (
    CLASS_REQUEST_TYPE_OUT,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    DescriptorType,
    DfuRequest,
    DfuState,
    Request,
    StandardRequest,
)
from ..descriptors import Descriptor, DeviceDescriptor, Languages, String, descriptors, ms_os_descriptors
from ..dfu import DfuReply
from ..enumeration import CONSOLE_INTERFACE, MS_OS_INDEX, MS_OS_VENDOR_CODE
from ..replies import ANSWER_BYTES, ClockReading, Info, ReadBack, Status, decode_reports, decode_wiring
from ..requests import DIRECTION_IN, VALUES, ConsoleRequest, Setup
from .description import Description, Violation, few, name_of, plainly, shortly
from .replies import in_words

__all__ = ["describe_request"]

_TYPE_BITS = 0x60
_VENDOR_DEVICE_IN = 0xC0
_VALUE_CLAUSES = {Request.WATCHDOG: "REQ-009", Request.LIMIT: "REQ-010", Request.IDENTIFY: "REQ-012"}
_ANSWERS: Mapping[Request, tuple[str, Callable[[bytes], Any]]] = {
    Request.INFO: ("REQ-002", Info.decode),
    Request.STATUS: ("REQ-003", Status.decode),
    Request.WIRING: ("REQ-004", decode_wiring),
    Request.CLOCK: ("REQ-006", ClockReading.decode),
    Request.PULSES: ("REQ-007", ReadBack.decode),
    Request.PROCESSORS: ("REQ-008", decode_reports),
}
"""Clause and reader of the answer to a request."""


def describe_request(setup: bytes, data: bytes | None = None, *, stalled: bool = False) -> Description:
    """Describe a control request (chapters REQ, USB and DFU).

    Parameters
    ----------
    setup : bytes
        The setup stage.
    data : bytes or None
        The data stage, in whichever direction; None if it is not known.
    stalled : bool
        Whether the device answered STALL.
    """
    try:
        fields = Setup.decode(setup)
    except ValueError as error:
        return Description("request", few(setup), {}, (Violation("", "USB-004", str(error)),))
    description = _describer(fields)(fields, None if stalled else data)
    summary = description.summary + (", answered with STALL" if stalled else "")
    told = asdict(fields) | {"stalled": stalled} | dict(description.fields)
    return replace(description, summary=summary, fields=told)


def _describer(setup: Setup) -> Callable[[Setup, bytes | None], Description]:
    """The handler of a request, by its type and recipient."""
    if setup.request_type in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
        return _describe_vendor
    if (setup.request_type, setup.request, setup.index) == (_VENDOR_DEVICE_IN, MS_OS_VENDOR_CODE, MS_OS_INDEX):
        return _describe_ms_os
    if not setup.request_type & _TYPE_BITS and setup.request in set(StandardRequest):
        return _describe_standard
    if setup.request_type & ~DIRECTION_IN == CLASS_REQUEST_TYPE_OUT and setup.index == CONSOLE_INTERFACE:
        return _describe_console
    if setup.request_type & ~DIRECTION_IN == CLASS_REQUEST_TYPE_OUT and setup.request in set(DfuRequest):
        return _describe_dfu
    return _describe_other


def _describe_other(setup: Setup, data: bytes | None) -> Description:
    summary = f"{setup.request_type:02x} {setup.request:02x}, value {setup.value:04x}, index {setup.index:04x}"
    return Description("request", summary + (f", {few(data)}" if data else ""))


def _describe_console(setup: Setup, data: bytes | None) -> Description:
    """A request to the function of the console (clause USB-023)."""
    name = name_of(ConsoleRequest, setup.request)
    return Description("request", f"{name} {setup.value:#x}" + (f": {data.hex(' ')}" if data else ""), {"name": name})


def _describe_dfu(setup: Setup, data: bytes | None) -> Description:
    """A request to the DFU function (chapter DFU)."""
    request = DfuRequest(setup.request)
    fields = {"name": request.name}
    match request:
        case DfuRequest.DNLOAD | DfuRequest.UPLOAD:
            return Description("request", f"{request.name} block {setup.value}, {few(data or b'', 4)}", fields)
        case DfuRequest.GETSTATUS if data:
            try:
                reply = DfuReply.decode(data)
            except ReplyError as error:
                finding = Violation("", "DFU-007", shortly(error))
                return Description("request", f"{request.name}: {few(data)}", fields, (finding,))
            wait = f", wait {reply.poll_ms} ms" if reply.poll_ms else ""
            told = f"{request.name}: {reply.state.name}, {reply.status.name}{wait}"
            return Description("request", told, fields | {"answer": plainly(reply)})
        case DfuRequest.GETSTATE if data:
            return Description("request", f"{request.name}: {name_of(DfuState, data[0])}", fields)
    return Description("request", request.name, fields)


def _describe_standard(setup: Setup, data: bytes | None) -> Description:
    """A standard request (clause USB-014)."""
    name = StandardRequest(setup.request).name
    if setup.request != StandardRequest.GET_DESCRIPTOR:
        summary = f"{name} {setup.value:#x}" + (f" of {setup.index:#x}" if setup.index else "")
        return Description("request", summary + (f": {data.hex(' ')}" if data else ""), {"name": name})
    kind, index = divmod(setup.value, 256)
    asked = f"{name} {name_of(DescriptorType, kind)}" + (f" {index}" if index else "")
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
        findings = () if len(data) == setup.length else (Violation("", clause, shortly(error)),)
        return Description("request", f"{asked}: {few(data)}", {"name": name}, findings)
    told = [{"descriptor": each.label()} | plainly(each) for each in found]
    return Description("request", f"{asked}: {_listed(found)}", {"name": name, "descriptors": told})


def _listed(found: tuple[Descriptor, ...]) -> str:
    """Descriptors in words: what a string says, which device it is, else the names of all of them."""
    match found:
        case (String() as string,):
            return repr(string.bString)
        case (DeviceDescriptor() as device,):
            return f"{device.idVendor:04x}:{device.idProduct:04x}, release {device.bcdDevice:04x}"
        case (Languages() as languages,):
            return ", ".join(f"{language:04x}" for language in languages.wLANGID)
    return ", ".join(each.label() for each in found)


def _describe_vendor(setup: Setup, data: bytes | None) -> Description:
    """A request of this protocol (clause REQ-001)."""
    name = name_of(Request, setup.request)
    if setup.request not in set(Request):
        return Description(
            "request", name, {"name": name}, (Violation("", "REQ-001", f"unknown request {setup.request}"),)
        )
    request = Request(setup.request)
    summary = f"{name} {setup.value}" if request in VALUES else name
    findings = list(_wrong_setup(request, setup))
    if findings or data is None or request not in ANSWER_BYTES:
        return Description("request", summary, {"name": name}, tuple(findings))
    clause, decode = _ANSWERS[request]
    size = ANSWER_BYTES[request]
    if len(data) == setup.length < size:
        return Description("request", f"{name}: the first {len(data)} of {size} bytes", {"name": name})
    try:
        answer = decode(data)
    except ReplyError as error:
        return Description("request", f"{name}: {few(data)}", {"name": name}, (Violation("", clause, shortly(error)),))
    told = {"name": name, "answer": plainly(answer)}
    return Description("request", f"{name}: {in_words(answer)}", told, pulses=getattr(answer, "pulses", None))


def _wrong_setup(request: Request, setup: Setup) -> Iterator[Violation]:
    """What is wrong with the setup stage of a request of this protocol."""
    values = VALUES.get(request, range(1))
    if setup.is_in != (request in ANSWER_BYTES):
        right = REQUEST_TYPE_OUT if setup.is_in else REQUEST_TYPE_IN
        yield Violation(
            "", "REQ-001", f"type {setup.request_type:02x} should be {right:02x}: {request.name} goes that way"
        )
    if setup.index:
        yield Violation("", "REQ-001", f"index {setup.index} should be 0")
    if setup.value not in values:
        right_values = f"{values[0]} to {values[-1]}" if len(values) > 1 else f"{values[0]}"
        clause = _VALUE_CLAUSES.get(request, "REQ-001")
        yield Violation("", clause, f"value {setup.value} should be {right_values}")
    if not setup.is_in and setup.length:
        yield Violation("", "REQ-001", f"{setup.length} bytes are announced; {request.name} carries none")
