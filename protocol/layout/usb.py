"""Layout of the USB descriptors (SPEC.md, chapter USB; the names are those of the standards).

USB 2.0, chapter 9.6, with its interface association and BOS supplements; USB CDC 1.2, chapter 5.2.3, and PSTN 1.2,
chapter 5.3; DFU 1.1, chapter 4.1.3; Microsoft OS 2.0 descriptors. Every descriptor begins with its own length, which
the construct writes and checks.
"""

from __future__ import annotations

from uuid import UUID

from construct import (
    Bytes,
    Const,
    Construct,
    GreedyRange,
    GreedyString,
    Int8ul,
    Int16ul,
    Int32ul,
    Prefixed,
    Struct,
    Terminated,
)

from ..codes import DescriptorType

__all__ = [
    "BOS",
    "CDC_ABSTRACT_CONTROL",
    "CDC_CALL_MANAGEMENT",
    "CDC_HEADER",
    "CDC_UNION",
    "CONFIGURATION",
    "DEVICE",
    "DEVICE_QUALIFIER",
    "DFU_FUNCTIONAL",
    "ENDPOINT",
    "INTERFACE",
    "INTERFACE_ASSOCIATION",
    "LANGUAGES",
    "LINE_CODING",
    "MS_OS_COMPATIBLE_ID",
    "MS_OS_CONFIGURATION_SUBSET",
    "MS_OS_FUNCTION_SUBSET",
    "MS_OS_PLATFORM",
    "MS_OS_REGISTRY_PROPERTY",
    "MS_OS_SET_HEADER",
    "OTHER_SPEED_CONFIGURATION",
    "STRING",
]

_MS_OS_PLATFORM_UUID = UUID("d8dd60df-4589-4cc7-9cd2-659d9e648a9f")


def _descriptor(kind: DescriptorType, *fields: Construct) -> Construct:
    """A descriptor of USB: bLength, bDescriptorType and the rest."""
    body = Struct("bDescriptorType" / Const(kind, Int8ul), *fields, Terminated)
    return Prefixed(Int8ul, body, includelength=True)


def _capability(kind: int, *fields: Construct) -> Construct:
    return _descriptor(DescriptorType.DEVICE_CAPABILITY, "bDevCapabilityType" / Const(kind, Int8ul), *fields)


def _cdc_functional(subtype: int, *fields: Construct) -> Construct:
    return _descriptor(DescriptorType.CS_INTERFACE, "bDescriptorSubtype" / Const(subtype, Int8ul), *fields)


def _ms_os(kind: int, *fields: Construct) -> Construct:
    """A descriptor of Microsoft's set, where length and type have 16 bits."""
    body = Struct("wDescriptorType" / Const(kind, Int16ul), *fields, Terminated)
    return Prefixed(Int16ul, body, includelength=True)


_CLASS = ("bDeviceClass" / Int8ul, "bDeviceSubClass" / Int8ul, "bDeviceProtocol" / Int8ul, "bMaxPacketSize0" / Int8ul)

DEVICE = _descriptor(
    DescriptorType.DEVICE,
    "bcdUSB" / Int16ul,
    *_CLASS,
    "idVendor" / Int16ul,
    "idProduct" / Int16ul,
    "bcdDevice" / Int16ul,
    "iManufacturer" / Int8ul,
    "iProduct" / Int8ul,
    "iSerialNumber" / Int8ul,
    "bNumConfigurations" / Int8ul,
)

DEVICE_QUALIFIER = _descriptor(
    DescriptorType.DEVICE_QUALIFIER,
    "bcdUSB" / Int16ul,
    *_CLASS,
    "bNumConfigurations" / Int8ul,
    "bReserved" / Const(0, Int8ul),
)

_CONFIGURATION = (
    "wTotalLength" / Int16ul,
    "bNumInterfaces" / Int8ul,
    "bConfigurationValue" / Int8ul,
    "iConfiguration" / Int8ul,
    "bmAttributes" / Int8ul,
    "bMaxPower" / Int8ul,
)

CONFIGURATION = _descriptor(DescriptorType.CONFIGURATION, *_CONFIGURATION)
OTHER_SPEED_CONFIGURATION = _descriptor(DescriptorType.OTHER_SPEED_CONFIGURATION, *_CONFIGURATION)

INTERFACE_ASSOCIATION = _descriptor(
    DescriptorType.INTERFACE_ASSOCIATION,
    "bFirstInterface" / Int8ul,
    "bInterfaceCount" / Int8ul,
    "bFunctionClass" / Int8ul,
    "bFunctionSubClass" / Int8ul,
    "bFunctionProtocol" / Int8ul,
    "iFunction" / Int8ul,
)

INTERFACE = _descriptor(
    DescriptorType.INTERFACE,
    "bInterfaceNumber" / Int8ul,
    "bAlternateSetting" / Int8ul,
    "bNumEndpoints" / Int8ul,
    "bInterfaceClass" / Int8ul,
    "bInterfaceSubClass" / Int8ul,
    "bInterfaceProtocol" / Int8ul,
    "iInterface" / Int8ul,
)

ENDPOINT = _descriptor(
    DescriptorType.ENDPOINT,
    "bEndpointAddress" / Int8ul,
    "bmAttributes" / Int8ul,
    "wMaxPacketSize" / Int16ul,
    "bInterval" / Int8ul,
)

LANGUAGES = _descriptor(DescriptorType.STRING, "wLANGID" / GreedyRange(Int16ul))
"""The string descriptor with index 0."""

STRING = _descriptor(DescriptorType.STRING, "bString" / GreedyString("utf-16-le"))
"""Every other string descriptor."""

BOS = _descriptor(DescriptorType.BOS, "wTotalLength" / Int16ul, "bNumDeviceCaps" / Int8ul)

MS_OS_PLATFORM = _capability(
    0x05,
    "bReserved" / Const(0, Int8ul),
    "PlatformCapabilityUUID" / Const(_MS_OS_PLATFORM_UUID.bytes_le),
    "dwWindowsVersion" / Int32ul,
    "wMSOSDescriptorSetTotalLength" / Int16ul,
    "bMS_VendorCode" / Int8ul,
    "bAltEnumCode" / Int8ul,
)

CDC_HEADER = _cdc_functional(0x00, "bcdCDC" / Int16ul)
CDC_CALL_MANAGEMENT = _cdc_functional(0x01, "bmCapabilities" / Int8ul, "bDataInterface" / Int8ul)
CDC_ABSTRACT_CONTROL = _cdc_functional(0x02, "bmCapabilities" / Int8ul)
CDC_UNION = _cdc_functional(0x06, "bControlInterface" / Int8ul, "bSubordinateInterface0" / Int8ul)

DFU_FUNCTIONAL = _descriptor(
    DescriptorType.DFU_FUNCTIONAL,
    "bmAttributes" / Int8ul,
    "wDetachTimeOut" / Int16ul,
    "wTransferSize" / Int16ul,
    "bcdDFUVersion" / Int16ul,
)

MS_OS_SET_HEADER = _ms_os(0x00, "dwWindowsVersion" / Int32ul, "wTotalLength" / Int16ul)

MS_OS_CONFIGURATION_SUBSET = _ms_os(
    0x01, "bConfigurationValue" / Int8ul, "bReserved" / Const(0, Int8ul), "wTotalLength" / Int16ul
)

MS_OS_FUNCTION_SUBSET = _ms_os(
    0x02, "bFirstInterface" / Int8ul, "bReserved" / Const(0, Int8ul), "wSubsetLength" / Int16ul
)

MS_OS_COMPATIBLE_ID = _ms_os(0x03, "CompatibleID" / Bytes(8), "SubCompatibleID" / Bytes(8))

_COUNTED_STRING = Prefixed(Int16ul, GreedyString("utf-16-le"))

MS_OS_REGISTRY_PROPERTY = _ms_os(
    0x04, "wPropertyDataType" / Int16ul, "PropertyName" / _COUNTED_STRING, "PropertyData" / _COUNTED_STRING
)
"""Name and data are preceded by their lengths in bytes, and end with the NULs that Windows wants."""

LINE_CODING = Struct(
    "dwDTERate" / Int32ul, "bCharFormat" / Int8ul, "bParityType" / Int8ul, "bDataBits" / Int8ul, Terminated
)
"""Data of SET_LINE_CODING and GET_LINE_CODING, 7 bytes (PSTN 1.2, chapter 6.3.11)."""
