"""USB descriptors of the device (SPEC.md, chapter USB)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from .codes import BLOCK_BYTES

__all__ = [
    "CONFIGURATION",
    "CONFIGURATION_VALUE",
    "DEVICE",
    "ENDPOINT",
    "ENDPOINT_IN",
    "ENDPOINT_OUT",
    "INTERFACE",
    "PRODUCT_ID",
    "STRING_TYPE",
    "VENDOR_CLASS",
    "VENDOR_ID",
    "DescriptorLayout",
    "configuration_descriptor",
    "device_descriptor",
    "string_descriptor",
]

VENDOR_ID = 0x1209
PRODUCT_ID = 0x0001
CONFIGURATION_VALUE = 1
ENDPOINT_OUT = 0x01
ENDPOINT_IN = 0x81
VENDOR_CLASS = 0xFF
STRING_TYPE = 3

_USB_2_0 = 0x0200
_SELF_POWERED = 0xC0
_BULK = 0x02
_US_ENGLISH = 0x0409


@dataclass(frozen=True)
class DescriptorLayout:
    """A kind of descriptor: its type code and its fields after length and type, as in USB 2.0, chapter 9.6."""

    kind: int
    layout: str
    names: tuple[str, ...]

    def pack(self, **fields: int) -> bytes:
        """Build a descriptor from its fields, named as in the USB specification."""
        body = struct.pack("<" + self.layout, *(fields[name] for name in self.names))
        return bytes([2 + len(body), self.kind]) + body

    def unpack(self, data: bytes) -> dict[str, int]:
        """Read the fields of a descriptor, length and type among them."""
        values = struct.unpack_from("<BB" + self.layout, data)
        return dict(zip(("bLength", "bDescriptorType", *self.names), values, strict=True))

    def find_all(self, data: bytes) -> list[dict[str, int]]:
        """Read every descriptor of this kind in a chain of descriptors."""
        found, at = [], 0
        while at < len(data):
            if data[at + 1] == self.kind:
                found.append(self.unpack(data[at:]))
            at += data[at]
        return found


DEVICE = DescriptorLayout(
    1,
    "HBBBBHHHBBBB",
    (
        "bcdUSB",
        "bDeviceClass",
        "bDeviceSubClass",
        "bDeviceProtocol",
        "bMaxPacketSize0",
        "idVendor",
        "idProduct",
        "bcdDevice",
        "iManufacturer",
        "iProduct",
        "iSerialNumber",
        "bNumConfigurations",
    ),
)
CONFIGURATION = DescriptorLayout(
    2,
    "HBBBBB",
    ("wTotalLength", "bNumInterfaces", "bConfigurationValue", "iConfiguration", "bmAttributes", "bMaxPower"),
)
INTERFACE = DescriptorLayout(
    4,
    "BBBBBBB",
    (
        "bInterfaceNumber",
        "bAlternateSetting",
        "bNumEndpoints",
        "bInterfaceClass",
        "bInterfaceSubClass",
        "bInterfaceProtocol",
        "iInterface",
    ),
)
ENDPOINT = DescriptorLayout(5, "BBHB", ("bEndpointAddress", "bmAttributes", "wMaxPacketSize", "bInterval"))


def device_descriptor(release: tuple[int, int, int]) -> bytes:
    """The device descriptor, 18 bytes; strings 1 to 3 are manufacturer, product and serial number.

    Parameters
    ----------
    release : (int, int, int)
        Firmware version, given as binary-coded decimal with one digit each for minor and patch.
    """
    major, minor, patch = release
    return DEVICE.pack(
        bcdUSB=_USB_2_0,
        bDeviceClass=0,
        bDeviceSubClass=0,
        bDeviceProtocol=0,
        bMaxPacketSize0=64,
        idVendor=VENDOR_ID,
        idProduct=PRODUCT_ID,
        bcdDevice=major << 8 | minor << 4 | patch,
        iManufacturer=1,
        iProduct=2,
        iSerialNumber=3,
        bNumConfigurations=1,
    )


def configuration_descriptor() -> bytes:
    """The one configuration with its vendor interface and two bulk endpoints."""
    body = INTERFACE.pack(
        bInterfaceNumber=0,
        bAlternateSetting=0,
        bNumEndpoints=2,
        bInterfaceClass=VENDOR_CLASS,
        bInterfaceSubClass=0,
        bInterfaceProtocol=0,
        iInterface=2,
    )
    for address in (ENDPOINT_OUT, ENDPOINT_IN):
        body += ENDPOINT.pack(bEndpointAddress=address, bmAttributes=_BULK, wMaxPacketSize=BLOCK_BYTES, bInterval=0)
    head = CONFIGURATION.pack(
        wTotalLength=9 + len(body),
        bNumInterfaces=1,
        bConfigurationValue=CONFIGURATION_VALUE,
        iConfiguration=0,
        bmAttributes=_SELF_POWERED,
        bMaxPower=50,
    )
    return head + body


def string_descriptor(text: str | None) -> bytes:
    """A string descriptor, or the table of languages for None."""
    body = struct.pack("<H", _US_ENGLISH) if text is None else text.encode("utf-16-le")
    return bytes([2 + len(body), STRING_TYPE]) + body
