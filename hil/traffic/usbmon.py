"""Captures of a USB bus by Linux's usbmon, from a pcap or pcapng file, as pieces of traffic.

A capture is read in steps, each a generator over the previous one, so that its size does not matter: packets from the
container, events from packets, transfers from a submission and its completion, pieces from transfers.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import BinaryIO, NamedTuple

from construct import Bytes, Construct, FormatField, Int8ub, Struct

from ...base.errors import InputFileError
from ...protocol.codes import BLOCK_MAGIC, DescriptorType
from ...protocol.enumeration import (
    CONSOLE_ENDPOINT_IN,
    CONSOLE_ENDPOINT_OUT,
    DFU_PRODUCT_ID,
    ENDPOINT_IN,
    ENDPOINT_OUT,
    PRODUCT_ID,
    VENDOR_ID,
)
from ...protocol.requests import DIRECTION_IN
from .traffic import RECORD_SIZES, LineCutter, Piece, Traffic, TransferDirection, cut

__all__ = ["UsbAddress", "read_usbmon"]

MOST_PENDING = 4096
"""The greatest number of submissions without a completion; in a corrupt capture all might lack one."""

HEADER_BYTES = {189: 48, 220: 64}
"""Size of usbmon's header by link type: LINKTYPE_USB_LINUX and LINKTYPE_USB_LINUX_MMAPPED."""

CONTROL = 2
TRAFFIC = {
    ENDPOINT_OUT: Traffic.BLOCK,
    ENDPOINT_IN: Traffic.RECORD,
}
OUR_IDS = [struct.pack("<HH", VENDOR_ID, product) for product in (PRODUCT_ID, DFU_PRODUCT_ID)]
DEVICE_DESCRIPTOR = bytes([18, DescriptorType.DEVICE])

STALL = -32
SHORT_READ = -121
TAKEN_BACK = (-2, -19, -104, -108)
STATUSES = {
    -2: "cancelled by the host",
    -19: "the device is gone",
    -32: "the endpoint is halted",
    -62: "no answer",
    -71: "no answer, or a bit error on the bus",
    -75: "the device sent more than requested",
    -84: "no answer, or a CRC error on the bus",
    -104: "cancelled by the host",
    -108: "the device is gone",
    -110: "no answer in time",
}
"""The meaning of Linux's error numbers for a transfer."""


class UsbAddress(NamedTuple):
    """The address of a device: the number of its bus, and its own on that bus."""

    bus: int
    device: int

    @classmethod
    def parse(cls, text: str) -> UsbAddress:
        """Read an address such as ``1.5``; raises `ValueError` if it is none."""
        bus, _, device = text.partition(".")
        if not all(part.isascii() and part.isdigit() for part in (bus, device)):
            raise ValueError(f"USB address {text!r} should be the numbers of a bus and a device, such as 1.5")
        return cls(int(bus), int(device))

    def __str__(self) -> str:
        """In the notation for people."""
        return f"{self.bus}.{self.device}"


@cache
def _header(order: str) -> Construct:
    """Header of an event of usbmon, the part that every capture has (the kernel's Documentation/usb/usbmon.rst)."""
    return Struct(
        "urb" / FormatField(order, "Q"),
        "event" / Bytes(1),
        "transfer" / Int8ub,
        "endpoint" / Int8ub,
        "device" / Int8ub,
        "bus" / FormatField(order, "H"),
        "setup_flag" / Int8ub,
        "data_flag" / Int8ub,
        "seconds" / FormatField(order, "q"),
        "microseconds" / FormatField(order, "l"),
        "status" / FormatField(order, "l"),
        "length" / FormatField(order, "L"),
        "captured" / FormatField(order, "L"),
        "setup" / Bytes(8),
    ).compile()


class _Event(NamedTuple):
    """A submission ("S"), its completion ("C") or its refusal ("E")."""

    packet: int
    kind: bytes
    transfer: int
    endpoint: int
    address: UsbAddress
    urb: int
    microseconds: int
    status: int
    length: int
    setup: bytes
    data: bytes


def _events(stream: BinaryIO, name: str) -> Iterator[_Event]:
    """Every event of a capture; packets of other interfaces are skipped."""
    from .packets import packets  # dpkt takes a tenth of the command line's time to import

    stream.seek(0)
    for packet in packets(stream, name):
        if packet.link not in HEADER_BYTES:
            continue
        begin = HEADER_BYTES[packet.link]
        if len(packet.data) < begin:
            raise InputFileError(
                f"{name}, packet {packet.number}: it has {len(packet.data)} bytes, and usbmon's header alone {begin}"
            )
        header = _header(packet.order).parse(packet.data)
        has_setup = header["event"] == b"S" and header["transfer"] == CONTROL and header["setup_flag"] == 0
        yield _Event(
            packet.number,
            header["event"],
            header["transfer"],
            header["endpoint"],
            UsbAddress(header["bus"], header["device"]),
            header["urb"],
            header["seconds"] * 1_000_000 + header["microseconds"],
            header["status"],
            header["length"],
            header["setup"] if has_setup else b"",
            packet.data[begin : begin + header["captured"]],
        )


class _Transfer(NamedTuple):
    """A submission and its completion, as far as the capture holds both."""

    submitted: _Event | None
    completed: _Event | None
    lost: bool = False  # whether the completion is missing


@dataclass
class _Place:
    """A place in the queue of transfers; it has no outcome while the transfer is under way."""

    outcome: _Transfer | None = None
    left: bool = False  # whether the queue has become too long to wait for the outcome


def _transfers(events: Iterable[_Event]) -> Iterator[_Transfer]:
    """Pair submissions with completions, in causal order.

    The device may act on received data from the submission on, and its own data are complete at the completion; so an
    OUT transfer has the place of its submission, and an IN transfer that of its completion. The kernel often reports
    the completion of a block after that of its acknowledgement.
    """
    pending: dict[tuple[int, int], tuple[_Event, _Place]] = {}
    line: deque[_Place] = deque()

    def settled(place: _Place, outcome: _Transfer) -> Iterator[_Transfer]:
        place.outcome = outcome
        if place.left:
            yield outcome
        elif outcome.submitted is None or _direction(outcome.submitted.endpoint) == "in":
            line.append(place)
        while line and (line[0].outcome or len(line) > MOST_PENDING):
            first = line.popleft()
            first.left = True
            if first.outcome:
                yield first.outcome

    for event in events:
        key = event.address.bus, event.urb
        if event.kind == b"S":
            forgotten = key if key in pending else next(iter(pending)) if len(pending) == MOST_PENDING else None
            if forgotten:
                submitted, place = pending.pop(forgotten)
                yield from settled(place, _Transfer(submitted, None, lost=True))
            pending[key] = event, (place := _Place())
            if _direction(event.endpoint) == "out":
                line.append(place)
        elif event.kind in (b"C", b"E"):
            begun, place = pending.pop(key, (None, _Place()))
            yield from settled(place, _Transfer(begun, event))
    for submitted, place in pending.values():
        yield from settled(place, _Transfer(submitted, None))


class _Survey(NamedTuple):
    """The result of a first look at a capture: its start, its devices, and which of them to follow."""

    start: int
    seen: set[UsbAddress]
    followed: set[UsbAddress]


def _survey(events: Iterable[_Event], address: UsbAddress | None) -> _Survey:
    """Look through a capture, up to any damage."""
    start, seen, followed = 0, set[UsbAddress](), set[UsbAddress]()
    try:
        for event in events:
            start = start if seen else event.microseconds
            seen.add(event.address)
            if event.address == address or (address is None and event.address.device and _is_an_array(event)):
                followed.add(event.address)
    except InputFileError:
        if not followed:
            raise  # otherwise there is something to read before the damage
    return _Survey(start, seen, followed)


def _is_an_array(event: _Event) -> bool:
    if event.transfer == CONTROL:
        return event.data.startswith(DEVICE_DESCRIPTOR) and event.data[8:12] in OUR_IDS
    begin = event.data[:2]
    return (event.endpoint == ENDPOINT_OUT and begin == BLOCK_MAGIC) or (
        event.endpoint == ENDPOINT_IN and begin in RECORD_SIZES
    )


def read_usbmon(stream: BinaryIO, name: str, address: UsbAddress | None = None) -> Iterator[Piece]:
    """Read the traffic of an array from a capture, twice, so that it must be able to seek; the name is for errors.

    Pieces come in causal order, so that an acknowledgement follows its block: the host's data have the place and the
    time of their transfer's submission, the device's data those of the completion.

    Without an address every address is followed that has a device descriptor of ours, or blocks or records: a device
    has another address each time it returns. Raises `InputFileError` if the capture is corrupt, or has no such device.
    """
    start, seen, followed = _survey(_events(stream, name), address)
    if not seen:
        raise InputFileError(f"{name}: no packet in it is of Linux's usbmon (link type 189 or 220)")
    if not followed:
        who = "array" if address is None else f"device {address}"
        there = ", ".join(map(str, sorted(seen)[:20]))
        raise InputFileError(
            f"{name}: no {who} shows itself in it; it has traffic of {there}; choose one by its address"
        )
    lines = {CONSOLE_ENDPOINT_OUT: LineCutter(), CONSOLE_ENDPOINT_IN: LineCutter()}
    for transfer in _transfers(event for event in _events(stream, name) if event.address in followed):
        yield from _pieces(transfer, start, lines)
    for endpoint, line in lines.items():
        for _, traffic, part in line.rest():
            yield Piece("the end", traffic, _direction(endpoint), part)


def _pieces(transfer: _Transfer, start: int, lines: Mapping[int, LineCutter]) -> Iterator[Piece]:
    """The pieces of one transfer, and what went wrong with it."""
    submitted, completed, _ = transfer
    event = completed or submitted
    assert event is not None
    direction, problem = _direction(event.endpoint), _problem(transfer)
    carrier = completed if direction == "in" else submitted
    time = ((carrier or event).microseconds - start) / 1e6
    data = carrier.data[: event.length] if carrier else b""
    if event.transfer == CONTROL:
        if submitted and submitted.setup:
            missing = event.length - len(data) if completed else 0
            where, stalled = f"packet {submitted.packet}", event.status == STALL
            yield Piece(where, Traffic.REQUEST, direction, data, time, submitted.setup, missing, stalled, problem)
        return
    if carrier is None:
        return  # the capture began after its submission, or ended before its completion
    where, traffic = f"packet {carrier.packet}", TRAFFIC.get(event.endpoint, Traffic.OTHER)
    if event.endpoint in lines:
        for _, traffic, part in lines[event.endpoint].feed(data):
            yield Piece(where, traffic, direction, part, time)
    elif traffic is Traffic.OTHER:
        if event.length:
            yield Piece(where, traffic, direction, data, time, missing=event.length - len(data))
    else:
        for at, part, missing in cut(traffic, data, event.length):
            yield Piece(f"{where} +{at}" if at else where, traffic, direction, part, time, missing=missing)
    if problem:
        yield Piece(where, traffic, direction, b"", time, problem=problem)


def _direction(endpoint: int) -> TransferDirection:
    return "in" if endpoint & DIRECTION_IN else "out"


def _problem(transfer: _Transfer) -> str:
    """What went wrong with a transfer, in words; empty if all went well."""
    submitted, completed, lost = transfer
    if completed is None:
        return "its completion was not recorded" if lost else ""
    status, is_in = completed.status, _direction(completed.endpoint) == "in"
    harmless = (STALL,) if completed.transfer == CONTROL else (SHORT_READ, *TAKEN_BACK) if is_in else ()
    if status and status not in harmless:
        return STATUSES.get(status, f"the host reports error {-status}")
    if submitted and not is_in and completed.length < submitted.length and status != STALL:
        return f"only {completed.length} of {submitted.length} bytes were taken"
    return ""
