"""Captures of a USB bus, written byte by byte from the documents that define them.

Containers: the pcapng draft (draft-ietf-opsawg-pcapng: section header, interface description, enhanced packet) and the
pcap draft (draft-ietf-opsawg-pcap). Packets: the kernel's Documentation/usb/usbmon.rst.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Any

SUBMIT, COMPLETE, ERROR = b"S", b"C", b"E"
CONTROL, BULK = 2, 3
IN_PROGRESS = -115
BEGAN = 1_700_000_000


def event(
    kind: bytes,
    urb: int,
    endpoint: int,
    *,
    data: bytes = b"",
    length: int | None = None,
    setup: bytes = b"",
    status: int = 0,
    transfer: int = BULK,
    device: int = 5,
    bus: int = 2,
    microseconds: int = 0,
    captured: int | None = None,
    link: int = 220,
    order: str = "<",
) -> bytes:
    """One event of usbmon: a header of 48 or 64 bytes, then the captured data."""
    kept = data if captured is None else data[:captured]
    header = struct.pack(
        order + "QcBBBHBBqiiII8s",
        urb,
        kind,
        transfer,
        endpoint,
        device,
        bus,
        0 if setup else ord("-"),
        0 if kept else ord("<" if endpoint & 0x80 else ">"),
        BEGAN,
        microseconds,
        status,
        len(data) if length is None else length,
        len(kept),
        setup,
    )
    if link == 220:
        header += struct.pack(order + "iiII", 0, 0, 0, 0)  # interval, start frame, flags, isochronous descriptors
    return header + kept


def bulk_out(urb: int, data: bytes, at: int = 0, **settings: Any) -> list[bytes]:
    """A bulk OUT transfer on endpoint 1 that succeeds after 40 µs."""
    common: dict[str, Any] = {"urb": urb, "endpoint": 0x01, **settings}
    return [
        event(SUBMIT, data=data, status=IN_PROGRESS, microseconds=at, **common),
        event(COMPLETE, length=len(data), microseconds=at + 40, **common),
    ]


def bulk_in(urb: int, data: bytes, at: int = 0, **settings: Any) -> list[bytes]:
    """A bulk IN transfer on endpoint 1 that was asked for 100 µs before the data came."""
    common: dict[str, Any] = {"urb": urb, "endpoint": 0x81, **settings}
    return [
        event(SUBMIT, length=4096, status=IN_PROGRESS, microseconds=at, **common),
        event(COMPLETE, data=data, microseconds=at + 100, **common),
    ]


def control(urb: int, setup: bytes, data: bytes = b"", status: int = 0, at: int = 0, **settings: Any) -> list[bytes]:
    """A control transfer that ends after 60 µs; its direction is that of its setup stage."""
    inward = setup[0] & 0x80
    common: dict[str, Any] = {"urb": urb, "endpoint": inward, "transfer": CONTROL, **settings}
    asked = int.from_bytes(setup[6:8], "little")
    sent, answered = (b"", data) if inward else (data, b"")
    return [
        event(SUBMIT, data=sent, length=asked, setup=setup, status=IN_PROGRESS, microseconds=at, **common),
        event(COMPLETE, data=answered, length=len(data), status=status, microseconds=at + 60, **common),
    ]


def pcapng(packets: Iterable[bytes], *, links: Iterable[int] = (220,), interface: int = 0, order: str = "<") -> bytes:
    """A pcapng section with an interface for each of the link types; the packets are of one of them."""

    def block(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        length = struct.pack(order + "I", 12 + len(body))
        return struct.pack(order + "I", kind) + length + body + length

    section = block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1))
    name = struct.pack(order + "HH8sHH", 2, 7, b"usbmon2", 0, 0)  # if_name, then the end of the options
    interfaces = [block(1, struct.pack(order + "HHI", link, 0, 262144) + name) for link in links]
    enhanced = [
        block(6, struct.pack(order + "IIIII", interface, 0, number, len(packet), len(packet)) + packet)
        for number, packet in enumerate(packets)
    ]
    return b"".join([section, *interfaces, *enhanced])


def pcap(packets: Iterable[bytes], *, link: int = 220, order: str = "<", magic: int = 0xA1B2C3D4) -> bytes:
    """A classic pcap file."""
    head = struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 262144, link)
    records = [struct.pack(order + "IIII", BEGAN, 0, len(packet), len(packet)) + packet for packet in packets]
    return b"".join([head, *records])
