"""The output of `lsusb -v` for a device, turned back into the bytes of its descriptors."""

from __future__ import annotations

import re
from uuid import UUID

CS_INTERFACE = 0x24
CDC = {"CDC Header": (5, 0), "CDC Call Management": (5, 1), "CDC ACM": (4, 2), "CDC Union": (5, 6)}
"""Length and subtype of functional descriptors, which lsusb does not print (USB CDC 1.2, 5.2.3; PSTN 1.2, 5.3)."""
FIELD = re.compile(r"\s+(MaxPower|PlatformCapabilityUUID|CapabilityData\[\d+\]|(?:bm|bcd|id|[biw])[A-Z]\w*)\s+(\S+)")
MILLIAMPERES = 2  # in one unit of bMaxPower (USB 2.0, table 9-10)
SECTIONS = ("Device Descriptor", "Binary Object Store Descriptor")


def descriptors(text: str) -> dict[str, bytes]:
    """The bytes of each of `SECTIONS`; the first has the configuration too."""
    found: dict[str, bytearray] = {}
    part = bytearray()
    for line in text.splitlines():
        heading = re.fullmatch(r"\s*([\w ]+):", line)
        field = re.match(
            r"\s+(MaxPower|PlatformCapabilityUUID|CapabilityData\[\d+\]|(?:bm|bcd|id|[biw])[A-Z]\w*)\s+(\S+)", line
        )
        if heading and heading[1] in SECTIONS:
            part = found.setdefault(heading[1], bytearray())
        elif heading and heading[1] in CDC:
            length, subtype = CDC[heading[1]]
            part += bytes((length, CS_INTERFACE, subtype))
        elif field:
            part += _bytes(*field.groups())
    return {name: bytes(data) for name, data in found.items()}


def _bytes(name: str, value: str) -> bytes:
    """A field as in its descriptor; the beginning of its name says its size (USB 2.0, 9.6)."""
    if name == "PlatformCapabilityUUID":
        return UUID(value).bytes_le
    if name == "MaxPower":
        return bytes((int(value.removesuffix("mA")) // MILLIAMPERES,))
    if name.startswith("bcd"):
        return bytes.fromhex(value.replace(".", "").zfill(4))[::-1]
    return int(value, 0).to_bytes(2 if name.startswith(("w", "id")) else 1, "little")
