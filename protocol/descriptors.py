"""USB descriptors of the device (SPEC.md, chapter USB)."""

from __future__ import annotations

import struct

from .codes import BLOCK_BYTES

__all__ = [
    "CONFIGURATION_VALUE",
    "ENDPOINT_IN",
    "ENDPOINT_OUT",
    "PRODUCT_ID",
    "VENDOR_ID",
    "configuration_descriptor",
    "device_descriptor",
    "string_descriptor",
]

VENDOR_ID = 0x1209
PRODUCT_ID = 0x0001
CONFIGURATION_VALUE = 1
ENDPOINT_OUT = 0x01
ENDPOINT_IN = 0x81

_DEVICE = struct.Struct("<BBHBBBBHHHBBBB")
_CONFIGURATION = struct.Struct("<BBHBBBBB")
_INTERFACE = struct.Struct("<BBBBBBBBB")
_ENDPOINT = struct.Struct("<BBBBHB")

_USB_2_0 = 0x0200
_RELEASE = 0x0010
_VENDOR_CLASS = 0xFF
_SELF_POWERED = 0xC0
_BULK = 0x02
_US_ENGLISH = 0x0409


def device_descriptor() -> bytes:
    """The device descriptor, 18 bytes; strings 1 to 3 are manufacturer, product and serial number."""
    return _DEVICE.pack(_DEVICE.size, 1, _USB_2_0, 0, 0, 0, 64, VENDOR_ID, PRODUCT_ID, _RELEASE, 1, 2, 3, 1)


def configuration_descriptor() -> bytes:
    """The one configuration with its vendor interface and two bulk endpoints."""
    body = _INTERFACE.pack(_INTERFACE.size, 4, 0, 0, 2, _VENDOR_CLASS, 0, 0, 2)
    for address in (ENDPOINT_OUT, ENDPOINT_IN):
        body += _ENDPOINT.pack(_ENDPOINT.size, 5, address, _BULK, BLOCK_BYTES, 0)
    length = _CONFIGURATION.size + len(body)
    return _CONFIGURATION.pack(_CONFIGURATION.size, 2, length, 1, CONFIGURATION_VALUE, 0, _SELF_POWERED, 50) + body


def string_descriptor(text: str | None) -> bytes:
    """A string descriptor, or the table of languages for None."""
    body = struct.pack("<H", _US_ENGLISH) if text is None else text.encode("utf-16-le")
    return bytes([2 + len(body), 3]) + body
