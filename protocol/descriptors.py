"""USB descriptors as typed values, and the reading of chains of them (SPEC.md, chapter USB).

Values and fields have the names of the standards. A descriptor's own length and type are not fields: `encode` writes
them. What this device's descriptors say stands in `enumeration`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import takewhile
from typing import Any, ClassVar, Self

from construct import Const, Construct, ConstructError, Sequence, Terminated

from ..base.errors import ReplyError
from .layout import build
from .layout import usb as layout

__all__ = [
    "Bos",
    "CdcAbstractControl",
    "CdcCallManagement",
    "CdcHeader",
    "CdcUnion",
    "Configuration",
    "Descriptor",
    "DeviceDescriptor",
    "DeviceQualifier",
    "DfuFunctional",
    "Endpoint",
    "Interface",
    "InterfaceAssociation",
    "Languages",
    "MsOsCompatibleId",
    "MsOsConfigurationSubset",
    "MsOsFunctionSubset",
    "MsOsPlatform",
    "MsOsRegistryProperty",
    "MsOsSetHeader",
    "OtherSpeedConfiguration",
    "String",
    "descriptors",
    "encode",
    "ms_os_descriptors",
]


@dataclass(frozen=True)
class Descriptor:
    """What all descriptors have in common.

    Raises
    ------
    ValueError
        If a field does not fit its place in the layout.
    """

    LAYOUT: ClassVar[Construct]

    def __post_init__(self) -> None:
        """Check that it can be encoded."""
        self.encode()

    @classmethod
    def label(cls) -> str:
        """Its kind, as reports name it."""
        return cls.__name__.removesuffix("Descriptor")

    def encode(self) -> bytes:
        """Encode with its length and type."""
        return build(self.LAYOUT, vars(self), self)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode exactly one descriptor of this kind; raise `ReplyError` if the bytes break its layout."""
        parsed = cls._parse(data)
        return cls(**{field.name: parsed[field.name] for field in fields(cls)})

    @classmethod
    def _parse(cls, data: bytes) -> Any:
        """What the layout reads; nothing may stand after it."""
        try:
            return Sequence(cls.LAYOUT, Terminated).parse(data)[0]
        except ConstructError as error:
            raise ReplyError(f"{data.hex()} is no {cls.label()} descriptor: {error}") from error


@dataclass(frozen=True)
class DeviceDescriptor(Descriptor):
    """What the device is (USB 2.0, 9.6.1)."""

    LAYOUT = layout.DEVICE

    bcdUSB: int
    bDeviceClass: int
    bDeviceSubClass: int
    bDeviceProtocol: int
    bMaxPacketSize0: int
    idVendor: int
    idProduct: int
    bcdDevice: int
    iManufacturer: int
    iProduct: int
    iSerialNumber: int
    bNumConfigurations: int


@dataclass(frozen=True)
class DeviceQualifier(Descriptor):
    """What the device would be at the other speed (USB 2.0, 9.6.2)."""

    LAYOUT = layout.DEVICE_QUALIFIER

    bcdUSB: int
    bDeviceClass: int
    bDeviceSubClass: int
    bDeviceProtocol: int
    bMaxPacketSize0: int
    bNumConfigurations: int


@dataclass(frozen=True)
class Configuration(Descriptor):
    """Head of a configuration; `wTotalLength` is the length of the chain that it begins (USB 2.0, 9.6.3)."""

    LAYOUT = layout.CONFIGURATION

    wTotalLength: int
    bNumInterfaces: int
    bConfigurationValue: int
    iConfiguration: int
    bmAttributes: int
    bMaxPower: int


@dataclass(frozen=True)
class OtherSpeedConfiguration(Configuration):
    """Head of the configuration at the other speed (USB 2.0, 9.6.4)."""

    LAYOUT = layout.OTHER_SPEED_CONFIGURATION


@dataclass(frozen=True)
class InterfaceAssociation(Descriptor):
    """Interfaces that are one function."""

    LAYOUT = layout.INTERFACE_ASSOCIATION

    bFirstInterface: int
    bInterfaceCount: int
    bFunctionClass: int
    bFunctionSubClass: int
    bFunctionProtocol: int
    iFunction: int


@dataclass(frozen=True)
class Interface(Descriptor):
    """One setting of an interface (USB 2.0, 9.6.5)."""

    LAYOUT = layout.INTERFACE

    bInterfaceNumber: int
    bAlternateSetting: int
    bNumEndpoints: int
    bInterfaceClass: int
    bInterfaceSubClass: int
    bInterfaceProtocol: int
    iInterface: int


@dataclass(frozen=True)
class Endpoint(Descriptor):
    """An endpoint of the interface before it (USB 2.0, 9.6.6)."""

    LAYOUT = layout.ENDPOINT

    bEndpointAddress: int
    bmAttributes: int
    wMaxPacketSize: int
    bInterval: int


@dataclass(frozen=True)
class Languages(Descriptor):
    """The string descriptor with index 0: languages in which there are strings (USB 2.0, 9.6.7)."""

    LAYOUT = layout.LANGUAGES

    wLANGID: tuple[int, ...]

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode; `descriptors` cannot, because only the index tells languages from a string."""
        return cls(tuple(cls._parse(data).wLANGID))


@dataclass(frozen=True)
class String(Descriptor):
    """A text of at most 126 UTF-16 code units (USB 2.0, 9.6.7)."""

    LAYOUT = layout.STRING

    bString: str


@dataclass(frozen=True)
class Bos(Descriptor):
    """Head of the device's capabilities; `wTotalLength` is the length of the chain that it begins."""

    LAYOUT = layout.BOS

    wTotalLength: int
    bNumDeviceCaps: int


@dataclass(frozen=True)
class MsOsPlatform(Descriptor):
    """Where to ask for Microsoft's descriptor set, and how long it is."""

    LAYOUT = layout.MS_OS_PLATFORM

    dwWindowsVersion: int
    wMSOSDescriptorSetTotalLength: int
    bMS_VendorCode: int
    bAltEnumCode: int


@dataclass(frozen=True)
class CdcHeader(Descriptor):
    """Version of the communications class (CDC 1.2, 5.2.3.1)."""

    LAYOUT = layout.CDC_HEADER

    bcdCDC: int


@dataclass(frozen=True)
class CdcCallManagement(Descriptor):
    """Whether the device handles calls (PSTN 1.2, 5.3.1)."""

    LAYOUT = layout.CDC_CALL_MANAGEMENT

    bmCapabilities: int
    bDataInterface: int


@dataclass(frozen=True)
class CdcAbstractControl(Descriptor):
    """Requests that the control interface supports (PSTN 1.2, 5.3.2)."""

    LAYOUT = layout.CDC_ABSTRACT_CONTROL

    bmCapabilities: int


@dataclass(frozen=True)
class CdcUnion(Descriptor):
    """The control interface and the data interface that belongs to it (CDC 1.2, 5.2.3.2)."""

    LAYOUT = layout.CDC_UNION

    bControlInterface: int
    bSubordinateInterface0: int


@dataclass(frozen=True)
class DfuFunctional(Descriptor):
    """What the device can do about firmware, in blocks of how many bytes (DFU 1.1, 4.1.3)."""

    LAYOUT = layout.DFU_FUNCTIONAL

    bmAttributes: int
    wDetachTimeOut: int
    wTransferSize: int
    bcdDFUVersion: int


@dataclass(frozen=True)
class MsOsSetHeader(Descriptor):
    """Head of Microsoft's descriptor set; `wTotalLength` is that of the whole set."""

    LAYOUT = layout.MS_OS_SET_HEADER

    dwWindowsVersion: int
    wTotalLength: int


@dataclass(frozen=True)
class MsOsConfigurationSubset(Descriptor):
    """Head of what belongs to one configuration, given by its index, which begins at 0, whatever the name says."""

    LAYOUT = layout.MS_OS_CONFIGURATION_SUBSET

    bConfigurationValue: int
    wTotalLength: int


@dataclass(frozen=True)
class MsOsFunctionSubset(Descriptor):
    """Head of what belongs to one function of a composite device."""

    LAYOUT = layout.MS_OS_FUNCTION_SUBSET

    bFirstInterface: int
    wSubsetLength: int


@dataclass(frozen=True)
class MsOsCompatibleId(Descriptor):
    """Which of its own drivers Windows is to use, eight bytes filled up with NULs."""

    LAYOUT = layout.MS_OS_COMPATIBLE_ID

    CompatibleID: bytes
    SubCompatibleID: bytes = bytes(8)


@dataclass(frozen=True)
class MsOsRegistryProperty(Descriptor):
    """What Windows is to enter into the registry; texts with their NULs."""

    LAYOUT = layout.MS_OS_REGISTRY_PROPERTY

    wPropertyDataType: int
    PropertyName: str
    PropertyData: str


def encode(*chain: Descriptor) -> bytes:
    """Encode descriptors one after the other."""
    return b"".join(descriptor.encode() for descriptor in chain)


@lru_cache(maxsize=64)  # programs look at the same few devices again and again
def descriptors(data: bytes) -> tuple[Descriptor, ...]:
    """Read a chain of descriptors, such as a configuration or a BOS.

    Type 0x21 is read as DFU's, the only class here that uses it. Total lengths are read, not checked, so that the
    beginning of a chain can be read as well.

    Raises
    ------
    ReplyError
        If a descriptor is shorter than its own head, goes beyond the end, is of a kind that this protocol does not
        have, or breaks its layout.
    """
    return _walk(data, 1, _STANDARD)


def ms_os_descriptors(data: bytes) -> tuple[Descriptor, ...]:
    """Read a Microsoft OS 2.0 descriptor set, whose lengths and types have 16 bits.

    Raises
    ------
    ReplyError
        As `descriptors`.
    """
    return _walk(data, 2, _MS_OS)


def _signature(kind: type[Descriptor]) -> bytes:
    """The constants after the length by which a kind is known: type, subtype, perhaps a UUID."""
    constants = takewhile(lambda field: isinstance(field.subcon, Const), kind.LAYOUT.subcon.subcons)
    return b"".join(field.build(None) for field in constants)


def _walk(data: bytes, head: int, kinds: Mapping[bytes, type[Descriptor]]) -> tuple[Descriptor, ...]:
    found, at = [], 0
    while at < len(data):
        size = int.from_bytes(data[at : at + head], "little")
        if not 2 * head <= size <= len(data) - at:
            raise ReplyError(
                f"descriptor at byte {at}: its length {size} is less than {2 * head} or goes beyond the end, "
                f"{len(data) - at} bytes away"
            )
        piece = data[at : at + size]
        kind = next((kind for signature, kind in kinds.items() if piece.startswith(signature, head)), None)
        if kind is None:
            raise ReplyError(f"descriptor at byte {at}: {piece.hex()} is of no kind that this protocol has")
        found.append(kind.decode(piece))
        at += size
    return tuple(found)


_STANDARD = {
    _signature(kind): kind
    for kind in (
        DeviceDescriptor,
        Configuration,
        String,
        Interface,
        Endpoint,
        DeviceQualifier,
        OtherSpeedConfiguration,
        InterfaceAssociation,
        Bos,
        MsOsPlatform,
        DfuFunctional,
        CdcHeader,
        CdcCallManagement,
        CdcAbstractControl,
        CdcUnion,
    )
}

_MS_OS = {
    _signature(kind): kind
    for kind in (MsOsSetHeader, MsOsConfigurationSubset, MsOsFunctionSubset, MsOsCompatibleId, MsOsRegistryProperty)
}
