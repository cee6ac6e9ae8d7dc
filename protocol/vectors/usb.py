"""Vectors of control requests and descriptors (SPEC.md, chapters REQ and USB)."""

from __future__ import annotations

from ..codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    DescriptorType,
    DfuRequest,
    Request,
    StandardRequest,
)
from ..enumeration import DFU_INTERFACE, FULL_SPEED, LANGUAGE, MS_OS_INDEX, MS_OS_VENDOR_CODE, dfu_mode, run_time
from ..replies import ANSWER_BYTES
from ..requests import Setup
from .cases import Section, Vector, section, vector

__all__ = ["descriptors", "refused_requests", "requests"]

VALUES = {Request.WATCHDOG: 5000, Request.LIMIT: 160, Request.IDENTIFY: 4}


def _request(name: str, shows: str, setup: tuple[int, int, int, int, int], **rest: object) -> Vector:
    encoded = Setup(*setup).encode()
    return vector(f"request-{name}", shows, hex=encoded, fields=Setup.decode(encoded), **rest)


def requests() -> Section:
    """Requests that a device carries out."""
    vendor = [
        _request(
            request.name,
            f"the request {request.name}",
            (
                REQUEST_TYPE_IN if request in ANSWER_BYTES else REQUEST_TYPE_OUT,
                request,
                VALUES.get(request, 0),
                0,
                size,
            ),
            answer=f"{size} bytes" if size else "nothing",
        )
        for request in Request
        for size in [ANSWER_BYTES.get(request, 0)]
    ]
    others = {
        "INFO-16": ("only the first bytes are asked for", (REQUEST_TYPE_IN, Request.INFO, 0, 0, 16), "16 bytes"),
        "INFO-255": ("more is asked for than there is", (REQUEST_TYPE_IN, Request.INFO, 0, 0, 255), "64 bytes"),
        "WATCHDOG-10": ("the shortest watchdog time", (REQUEST_TYPE_OUT, Request.WATCHDOG, 10, 0, 0), "nothing"),
        "WATCHDOG-60000": ("the longest", (REQUEST_TYPE_OUT, Request.WATCHDOG, 60000, 0, 0), "nothing"),
        "LIMIT-0": ("nothing may be driven", (REQUEST_TYPE_OUT, Request.LIMIT, 0, 0, 0), "nothing"),
        "SET-CONFIGURATION": ("configures", (0x00, StandardRequest.SET_CONFIGURATION, 1, 0, 0), "nothing"),
        "GET-STATUS": ("of the device", (0x80, StandardRequest.GET_STATUS, 0, 0, 2), "2 bytes"),
        "MS-OS": ("the Microsoft OS 2.0 set", (0xC0, MS_OS_VENDOR_CODE, 0, MS_OS_INDEX, 338), "338 bytes"),
        "DFU-DETACH": ("to DFU mode", (CLASS_REQUEST_TYPE_OUT, DfuRequest.DETACH, 1000, DFU_INTERFACE, 0), "nothing"),
        "DFU-GETSTATUS": (
            "of the DFU interface",
            (CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATUS, 0, DFU_INTERFACE, 6),
            "6 bytes",
        ),
    }
    return section(
        "Control requests as SETUP packets (REQ-001, USB-014) to a configured device in state OFF, and its answers.",
        [*vendor, *(_request(name, shows, setup, answer=answer) for name, (shows, setup, answer) in others.items())],
    )


def refused_requests() -> Section:
    """Requests that a device does not carry out."""
    vendor_in, vendor_out = REQUEST_TYPE_IN, REQUEST_TYPE_OUT
    refusals = {
        "0": ("request 0", "REQ-001", (vendor_in, 0, 0, 0, 64)),
        "15": ("request 15", "REQ-001", (vendor_out, 15, 0, 0, 0)),
        "direction": ("ENABLE in the wrong direction", "REQ-001", (vendor_in, Request.ENABLE, 0, 0, 0)),
        "index": ("INFO of interface 1", "REQ-001", (vendor_in, Request.INFO, 0, 1, 64)),
        "value": ("ENABLE with a value", "REQ-001", (vendor_out, Request.ENABLE, 1, 0, 0)),
        "watchdog-9": ("too short a time", "REQ-009", (vendor_out, Request.WATCHDOG, 9, 0, 0)),
        "watchdog-60001": ("too long a time", "REQ-009", (vendor_out, Request.WATCHDOG, 60001, 0, 0)),
        "limit-321": ("more transducers than there are", "REQ-010", (vendor_out, Request.LIMIT, 321, 0, 0)),
        "identify-5": ("more boards than there are", "REQ-012", (vendor_out, Request.IDENTIFY, 5, 0, 0)),
        "ms-os-index": ("not the index of the set", "USB-012", (0xC0, MS_OS_VENDOR_CODE, 0, 4, 338)),
        "configuration-2": (
            "there is one configuration",
            "USB-014",
            (0x00, StandardRequest.SET_CONFIGURATION, 2, 0, 0),
        ),
        "set-descriptor": ("SET_DESCRIPTOR", "USB-014", (0x00, 7, 0x0100, 0, 18)),
    }
    return section(
        "Control requests that the same device answers with STALL, and that have no effect.",
        (
            _request(f"refused-{name}", shows, setup, answer="STALL", clause=clause)
            for name, (shows, clause, setup) in refusals.items()
        ),
    )


def descriptors() -> Section:
    """What enumeration reads."""
    named = ((1, 2, 3), "phasewire vectors", "PW-0001")
    modes = {
        "run time, high speed": run_time(*named),
        "run time, full speed": run_time(*named, FULL_SPEED),
        "DFU mode": dfu_mode(*named),
    }
    asked = [
        *((kind, 0, 0) for kind in DescriptorType if kind is not DescriptorType.STRING),
        *((DescriptorType.STRING, index, LANGUAGE if index else 0) for index in (*range(8), 17, 30, 31)),
        (DescriptorType.STRING, 1, 0x0407),
        (DescriptorType.CONFIGURATION, 1, 0),
    ]
    found = [
        vector(
            f"descriptor-{mode.replace(', ', '-').replace(' ', '-')}-{kind.name}-{index}"
            + (f"-{language:04x}" if language else ""),
            f"{kind.name} {index}, {mode}",
            mode=mode,
            setup=Setup(0x80, StandardRequest.GET_DESCRIPTOR, kind << 8 | index, language, 0xFFFF).encode(),
            hex=answer,
            answer=f"{len(answer)} bytes" if answer is not None else "STALL",
        )
        for mode, enumeration in modes.items()
        for kind, index, language in asked
        for answer in [enumeration.find(kind, index, language)]
    ]
    sets = [
        vector(
            f"descriptor-{mode.replace(', ', '-').replace(' ', '-')}-MS-OS",
            f"the Microsoft OS 2.0 descriptor set, {mode}",
            mode=mode,
            setup=Setup(0xC0, MS_OS_VENDOR_CODE, 0, MS_OS_INDEX, 0xFFFF).encode(),
            hex=enumeration.ms_os,
            answer=f"{len(enumeration.ms_os)} bytes",
        )
        for mode, enumeration in modes.items()
    ]
    return section(
        "Descriptors of a device with firmware 1.2.3, product 'phasewire vectors' and serial number PW-0001, and the "
        "request that asks for each (USB-006, USB-012); hex is null if it answers STALL.",
        [*found, *sets],
    )
