"""What the device tells a host that enumerates it: its descriptors at run time and in DFU mode (SPEC.md, chapter USB).

`run_time` and `dfu_mode` are the only places where the content of the descriptors is decided; a device answers
GET_DESCRIPTOR with what `Enumeration.find` finds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from .codes import (
    BLOCK_BYTES,
    DFU_ATTRIBUTES,
    DFU_DETACH_TIMEOUT_MS,
    DFU_TRANSFER_BYTES,
    DFU_VERSION,
    DescriptorType,
    ImageReason,
)
from .descriptors import (
    Bos,
    CdcAbstractControl,
    CdcCallManagement,
    CdcHeader,
    CdcUnion,
    Configuration,
    Descriptor,
    DeviceDescriptor,
    DeviceQualifier,
    DfuFunctional,
    Endpoint,
    Interface,
    InterfaceAssociation,
    Languages,
    MsOsCompatibleId,
    MsOsConfigurationSubset,
    MsOsFunctionSubset,
    MsOsPlatform,
    MsOsRegistryProperty,
    MsOsSetHeader,
    OtherSpeedConfiguration,
    String,
    encode,
)
from .dfu import reason_string
from .versions import Version

__all__ = [
    "ARRAY_CLASS",
    "ARRAY_INTERFACE",
    "CONFIGURATION_VALUE",
    "CONSOLE_DATA_INTERFACE",
    "CONSOLE_ENDPOINT_IN",
    "CONSOLE_ENDPOINT_NOTIFICATION",
    "CONSOLE_ENDPOINT_OUT",
    "CONSOLE_INTERFACE",
    "DFU_FUNCTIONAL",
    "DFU_INTERFACE",
    "DFU_MODE_CLASS",
    "DFU_PRODUCT_ID",
    "ENDPOINT_IN",
    "ENDPOINT_OUT",
    "FULL_SPEED",
    "HIGH_SPEED",
    "LANGUAGE",
    "MS_OS_INDEX",
    "MS_OS_VENDOR_CODE",
    "PRODUCT_ID",
    "VENDOR_ID",
    "Enumeration",
    "Speed",
    "dfu_mode",
    "run_time",
]

VENDOR_ID = 0x1209
PRODUCT_ID = 0x0001
DFU_PRODUCT_ID = 0x0002
CONFIGURATION_VALUE = 1

ARRAY_INTERFACE = 0
CONSOLE_INTERFACE = 1
CONSOLE_DATA_INTERFACE = 2
DFU_INTERFACE = 3

ENDPOINT_OUT = 0x01
ENDPOINT_IN = 0x81
CONSOLE_ENDPOINT_NOTIFICATION = 0x82
CONSOLE_ENDPOINT_OUT = 0x03
CONSOLE_ENDPOINT_IN = 0x83

ARRAY_CLASS = (0xFF, 0x50, 0x01)  # class, subclass, protocol
DFU_MODE_CLASS = (0xFE, 0x01, 0x02)
_SERIAL_NUMBER = re.compile(r"[A-Za-z0-9._-]{1,64}")
LANGUAGE = 0x0409  # English (United States)

MS_OS_VENDOR_CODE = 0x20
MS_OS_INDEX = 7

_USB_2_0_WITH_BOS = 0x0201
_CONTROL_PACKET_BYTES = 64
_SELF_POWERED = 0xC0
_MAX_POWER = 50  # units of 2 mA
_BULK, _INTERRUPT = 2, 3
_NAK_RATE = 1  # 0 would promise that the endpoint never answers NAK (USB 2.0, table 9-13)
_NOTIFICATION_BYTES = 16

# Class, subclass, protocol.
_COMPOSITE = (0xEF, 0x02, 0x01)
_BY_INTERFACE = (0x00, 0x00, 0x00)
_CONSOLE = (0x02, 0x02, 0x00)
_CONSOLE_DATA = (0x0A, 0x00, 0x00)
_DFU_RUN_TIME = (0xFE, 0x01, 0x01)

_WINDOWS_8_1 = 0x0603_0000
_REG_MULTI_SZ = 7
_ARRAY_GUID = "{1C743641-BE8D-477D-86BE-36371610DF1E}"
_DFU_GUID = "{F04B38B6-DE10-4A02-853E-17F17AEB46C8}"


class Speed(NamedTuple):
    """What depends on the speed of the bus."""

    bulk_bytes: int
    """Largest packet of a bulk endpoint."""
    interval: int
    """bInterval of an interrupt endpoint that is asked every 32 ms."""


FULL_SPEED = Speed(bulk_bytes=64, interval=32)
HIGH_SPEED = Speed(bulk_bytes=BLOCK_BYTES, interval=9)


@dataclass(frozen=True)
class Enumeration:
    """All descriptors of a device in one of its modes, at the speed at which it runs.

    Parameters
    ----------
    device : DeviceDescriptor
        The device descriptor.
    configuration : bytes
        The only configuration.
    other_speed : bytes
        The same at the other speed.
    ms_os : bytes
        The Microsoft OS 2.0 descriptor set, which a vendor request asks for.
    strings : dict of int to str
        The strings by their index.
    """

    device: DeviceDescriptor
    configuration: bytes
    other_speed: bytes
    ms_os: bytes
    strings: Mapping[int, str]

    @property
    def qualifier(self) -> DeviceQualifier:
        """The device qualifier: nothing that it says depends on the speed."""
        device = self.device
        return DeviceQualifier(
            device.bcdUSB,
            device.bDeviceClass,
            device.bDeviceSubClass,
            device.bDeviceProtocol,
            device.bMaxPacketSize0,
            device.bNumConfigurations,
        )

    @property
    def bos(self) -> bytes:
        """The one capability: Microsoft's descriptor set."""
        capability = encode(MsOsPlatform(_WINDOWS_8_1, len(self.ms_os), MS_OS_VENDOR_CODE, bAltEnumCode=0))
        return encode(Bos(5 + len(capability), bNumDeviceCaps=1)) + capability

    def find(self, kind: int, index: int, language: int) -> bytes | None:
        """The answer to GET_DESCRIPTOR, or None if there is no such descriptor (clauses USB-006 and USB-007)."""
        match kind, index:
            case DescriptorType.DEVICE, 0:
                return self.device.encode()
            case DescriptorType.DEVICE_QUALIFIER, 0:
                return self.qualifier.encode()
            case DescriptorType.CONFIGURATION, 0:
                return self.configuration
            case DescriptorType.OTHER_SPEED_CONFIGURATION, 0:
                return self.other_speed
            case DescriptorType.BOS, 0:
                return self.bos
            case DescriptorType.STRING, 0:
                return Languages((LANGUAGE,)).encode()
            case DescriptorType.STRING, _ if index in self.strings and language == LANGUAGE:
                return String(self.strings[index]).encode()
        return None


def run_time(release: tuple[int, int, int], product: str, serial: str, speed: Speed = HIGH_SPEED) -> Enumeration:
    """What the device says of itself while it drives the array.

    Parameters
    ----------
    release : (int, int, int)
        Firmware version; minor and patch have one digit each in bcdDevice.
    product : str
        Name of the product, at most 126 UTF-16 code units.
    serial : str
        Serial number: 1 to 64 letters, digits, dots, hyphens and underscores (clause USB-001).
    speed : Speed
        Speed of the bus.

    Raises
    ------
    ValueError
        If one of these is otherwise.
    """
    return Enumeration(
        device=_device(_COMPOSITE, PRODUCT_ID, release),
        configuration=_run_time_configuration(Configuration, speed),
        other_speed=_run_time_configuration(OtherSpeedConfiguration, _other(speed)),
        ms_os=_run_time_ms_os(),
        strings=_strings(product, serial, "phasewire array", "phasewire console", "phasewire firmware update"),
    )


def dfu_mode(release: tuple[int, int, int], product: str, serial: str) -> Enumeration:
    """What the device says of itself while its firmware is replaced; parameters as `run_time`.

    No endpoint but the control endpoint is used, so that nothing depends on the speed.
    """
    interfaces = (_interface(0, DFU_MODE_CLASS, endpoints=0, name=4), DFU_FUNCTIONAL)
    return Enumeration(
        device=_device(_BY_INTERFACE, DFU_PRODUCT_ID, release),
        configuration=_configuration(Configuration, interfaces),
        other_speed=_configuration(OtherSpeedConfiguration, interfaces),
        ms_os=_ms_os_set(_winusb(_DFU_GUID)),
        strings=_strings(product, serial, "firmware") | _REFUSALS,
    )


def _strings(product: str, serial: str, *interfaces: str) -> dict[int, str]:
    """Strings by their index (clause USB-007)."""
    if not _SERIAL_NUMBER.fullmatch(serial):
        raise ValueError(f"serial number {serial!r} must be 1 to 64 letters, digits, dots, hyphens or underscores")
    return dict(enumerate(("phasewire", product, serial, *interfaces), start=1))


_REFUSALS = {reason_string(reason): reason.text for reason in ImageReason if reason}
"""Why an image was refused, as the DFU status points to it (clause DFU-012)."""

DFU_FUNCTIONAL = DfuFunctional(DFU_ATTRIBUTES, DFU_DETACH_TIMEOUT_MS, DFU_TRANSFER_BYTES, DFU_VERSION)


def _other(speed: Speed) -> Speed:
    return FULL_SPEED if speed == HIGH_SPEED else HIGH_SPEED


def _device(device_class: tuple[int, int, int], product: int, release: tuple[int, int, int]) -> DeviceDescriptor:
    version = Version(*release)
    if not version.valid:
        raise ValueError(f"firmware version {version} does not fit bcdDevice: at most 99.9.9")
    return DeviceDescriptor(
        _USB_2_0_WITH_BOS,
        *device_class,
        _CONTROL_PACKET_BYTES,
        VENDOR_ID,
        product,
        bcdDevice=version.bcd,
        iManufacturer=1,
        iProduct=2,
        iSerialNumber=3,
        bNumConfigurations=1,
    )


def _configuration(head: type[Configuration], chain: Sequence[Descriptor]) -> bytes:
    body = encode(*chain)
    interfaces = {each.bInterfaceNumber for each in chain if isinstance(each, Interface)}
    return (
        head(
            wTotalLength=9 + len(body),
            bNumInterfaces=len(interfaces),
            bConfigurationValue=CONFIGURATION_VALUE,
            iConfiguration=0,
            bmAttributes=_SELF_POWERED,
            bMaxPower=_MAX_POWER,
        ).encode()
        + body
    )


@cache
def _run_time_configuration(head: type[Configuration], speed: Speed) -> bytes:
    return _configuration(head, _run_time_interfaces(speed))


@cache
def _run_time_ms_os() -> bytes:
    return _ms_os_set(
        _ms_os_configuration(
            _ms_os_function(ARRAY_INTERFACE, _winusb(_ARRAY_GUID)),
            _ms_os_function(DFU_INTERFACE, _winusb(_DFU_GUID)),
        )
    )


def _run_time_interfaces(speed: Speed) -> tuple[Descriptor, ...]:
    return (
        _interface(ARRAY_INTERFACE, ARRAY_CLASS, endpoints=2, name=4),
        _bulk(ENDPOINT_OUT, speed),
        _bulk(ENDPOINT_IN, speed),
        InterfaceAssociation(CONSOLE_INTERFACE, 2, *_CONSOLE, iFunction=5),
        _interface(CONSOLE_INTERFACE, _CONSOLE, endpoints=1, name=5),
        CdcHeader(bcdCDC=0x0120),
        CdcCallManagement(bmCapabilities=0, bDataInterface=CONSOLE_DATA_INTERFACE),
        CdcAbstractControl(bmCapabilities=0x02),  # line coding, line state and its notification
        CdcUnion(CONSOLE_INTERFACE, CONSOLE_DATA_INTERFACE),
        Endpoint(CONSOLE_ENDPOINT_NOTIFICATION, _INTERRUPT, _NOTIFICATION_BYTES, speed.interval),
        _interface(CONSOLE_DATA_INTERFACE, _CONSOLE_DATA, endpoints=2, name=0),
        _bulk(CONSOLE_ENDPOINT_OUT, speed),
        _bulk(CONSOLE_ENDPOINT_IN, speed),
        _interface(DFU_INTERFACE, _DFU_RUN_TIME, endpoints=0, name=6),
        DFU_FUNCTIONAL,
    )


def _interface(number: int, interface_class: tuple[int, int, int], endpoints: int, name: int) -> Interface:
    return Interface(number, 0, endpoints, *interface_class, iInterface=name)


def _bulk(address: int, speed: Speed) -> Endpoint:
    return Endpoint(address, _BULK, speed.bulk_bytes, _NAK_RATE)


def _ms_os_set(body: bytes) -> bytes:
    return MsOsSetHeader(_WINDOWS_8_1, 10 + len(body)).encode() + body


def _ms_os_configuration(*functions: bytes) -> bytes:
    body = b"".join(functions)
    return MsOsConfigurationSubset(0, 8 + len(body)).encode() + body


def _ms_os_function(interface: int, features: bytes) -> bytes:
    return MsOsFunctionSubset(interface, 8 + len(features)).encode() + features


def _winusb(guid: str) -> bytes:
    """Have Windows use WinUSB, and let programs find the interface by a GUID."""
    return encode(
        MsOsCompatibleId(b"WINUSB\0\0"), MsOsRegistryProperty(_REG_MULTI_SZ, "DeviceInterfaceGUIDs\0", f"{guid}\0\0")
    )
