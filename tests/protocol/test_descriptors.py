"""Descriptors, against the standards: worked bytes, every length, and pyusb's own reading of them."""

from __future__ import annotations

import pytest
import usb.control
import usb.core
import usb.util
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import ReplyError
from phasewire.emulator import Emulator
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.protocol.codes import DescriptorType
from phasewire.protocol.descriptors import (
    CdcUnion,
    Configuration,
    Descriptor,
    DeviceDescriptor,
    DfuFunctional,
    Endpoint,
    Interface,
    Languages,
    OtherSpeedConfiguration,
    String,
    descriptors,
    encode,
)
from phasewire.protocol.enumeration import FULL_SPEED, Enumeration, dfu_mode, run_time
from phasewire.protocol.layout import usb as layout
from phasewire.protocol.versions import Version

from tests.specification import table

RUN_TIME = run_time((1, 2, 3), "array", "S-1")
FULL = run_time((1, 2, 3), "array", "S-1", FULL_SPEED)
DFU = dfu_mode((1, 2, 3), "array", "S-1")
CHAINS = [
    RUN_TIME.device.encode(),
    RUN_TIME.qualifier.encode(),
    RUN_TIME.configuration,
    RUN_TIME.other_speed,
    RUN_TIME.bos,
    DFU.device.encode(),
    DFU.configuration,
    DFU.other_speed,
    String("aµ𝄞").encode(),
]
SETS = [RUN_TIME.ms_os, DFU.ms_os]


# The specification and the standards.


Row = tuple[int, tuple[int, ...], int | None, str, int | None]


def endpoints_in(chain: bytes) -> list[Row]:
    """Interface, its class, endpoint, type and packet; one row without endpoint for an interface that has none."""
    rows: list[Row] = []
    number, triple = -1, (0, 0, 0)
    for each in descriptors(chain):
        if isinstance(each, Interface):
            number = each.bInterfaceNumber
            triple = (each.bInterfaceClass, each.bInterfaceSubClass, each.bInterfaceProtocol)
            if not each.bNumEndpoints:
                rows.append((number, triple, None, "", None))
        elif isinstance(each, Endpoint):
            kind = {2: "bulk", 3: "interrupt"}[each.bmAttributes]
            rows.append((number, triple, each.bEndpointAddress, kind, each.wMaxPacketSize))
    return rows


def endpoints_specified(column: int) -> list[Row]:
    """The same from the table of clause USB-005."""
    rows: list[Row] = []
    for row in table("endpoints: run time"):
        endpoint = None if row[2] == "none" else int(row[2].split()[0], 16)
        assert endpoint is None or row[2].endswith("IN" if endpoint & 0x80 else "OUT")
        packet = int(row[column]) if row[column] else None
        rows.append((int(row[0]), tuple(bytes.fromhex(row[1])), endpoint, row[3].split(",")[0], packet))
    return rows


def test_interfaces_and_endpoints_are_those_of_the_specification() -> None:
    assert endpoints_in(RUN_TIME.configuration) == endpoints_specified(4)
    assert endpoints_in(RUN_TIME.other_speed) == endpoints_specified(5)


@pytest.mark.parametrize("kind", [DeviceDescriptor, String, Languages])
def test_bytes_after_a_descriptor_are_no_part_of_it(kind: type[Descriptor]) -> None:
    """Found by fuzzing: bytes after the descriptor were lost."""
    data = {
        DeviceDescriptor: RUN_TIME.device.encode(),
        String: String("a").encode(),
        Languages: Languages((0x0409,)).encode(),
    }[kind]
    assert kind.decode(data).encode() == data
    with pytest.raises(ReplyError, match=f"no {kind.label()} descriptor"):
        kind.decode(data + bytes(1))


def test_strings_by_hand() -> None:
    assert RUN_TIME.find(DescriptorType.STRING, 0, 0) == bytes([4, 3, 0x09, 0x04])
    assert Languages.decode(bytes([6, 3, 9, 4, 7, 4])) == Languages((0x0409, 0x0407))
    assert String("aµ").encode() == bytes([6, 3, ord("a"), 0, 0xB5, 0])
    with pytest.raises(ReplyError, match="no Languages descriptor"):
        Languages.decode(bytes([5, 3, 9, 4, 7]))


def test_a_line_coding_by_hand() -> None:
    """PSTN 1.2, table 17: 9600 baud, 2 stop bits, even parity, 7 data bits."""
    coding = layout.LINE_CODING.parse(bytes([0x80, 0x25, 0, 0, 2, 2, 7]))
    assert (coding.dwDTERate, coding.bCharFormat, coding.bParityType, coding.bDataBits) == (9600, 2, 2, 7)


@pytest.mark.parametrize(
    ("release", "bcd"), [((0, 1, 0), 0x0010), ((1, 2, 3), 0x0123), ((12, 3, 4), 0x1234), ((99, 9, 9), 0x9999)]
)
def test_the_release_is_binary_coded_decimal(release: tuple[int, int, int], bcd: int) -> None:
    assert run_time(release, "", "S-1").device.bcdDevice == dfu_mode(release, "", "S-1").device.bcdDevice == bcd
    assert Version.from_bcd(bcd) == release


@pytest.mark.parametrize("release", [(1, 10, 0), (1, 0, 10), (100, 0, 0), (0, -1, 0)])
def test_a_release_that_does_not_fit_is_refused(release: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match=r"does not fit bcdDevice: at most 99\.9\.9"):
        run_time(release, "", "S-1")


# pyusb's reading.


def on_the_bus(enumeration: Enumeration) -> usb.core.Device:
    emulator = Emulator()
    emulator.usb.enumeration = enumeration
    return usb.core.find(backend=EmulatorBackend([emulator]))


def fields_of(thing: object, names: str) -> tuple[int, ...]:
    return tuple(getattr(thing, name) for name in names.split())


DEVICE_FIELDS = (
    "bLength bDescriptorType bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 "
    "idVendor idProduct bcdDevice iManufacturer iProduct iSerialNumber bNumConfigurations"
)
CONFIGURATION_FIELDS = (
    "bLength bDescriptorType wTotalLength bNumInterfaces bConfigurationValue iConfiguration bmAttributes bMaxPower"
)
INTERFACE_FIELDS = (
    "bLength bDescriptorType bInterfaceNumber bAlternateSetting bNumEndpoints "
    "bInterfaceClass bInterfaceSubClass bInterfaceProtocol iInterface"
)
ENDPOINT_FIELDS = "bLength bDescriptorType bEndpointAddress bmAttributes wMaxPacketSize bInterval"


@pytest.mark.parametrize(("enumeration", "bulk", "interval"), [(RUN_TIME, 512, 9), (FULL, 64, 32)])
def test_pyusb_reads_the_device_at_run_time(enumeration: Enumeration, bulk: int, interval: int) -> None:
    device = on_the_bus(enumeration)
    assert fields_of(device, DEVICE_FIELDS) == (*(18, 1, 0x0201, 0xEF, 2, 1, 64, 0x1209, 0x0001, 0x0123, 1, 2, 3, 1),)
    (configuration,) = device.configurations()
    assert fields_of(configuration, CONFIGURATION_FIELDS) == (9, 2, 116, 4, 1, 0, 0xC0, 50)
    array, control, data, dfu = configuration.interfaces()
    assert fields_of(array, INTERFACE_FIELDS) == (9, 4, 0, 0, 2, 0xFF, 0x50, 1, 4)
    assert fields_of(control, INTERFACE_FIELDS) == (9, 4, 1, 0, 1, 2, 2, 0, 5)
    assert fields_of(data, INTERFACE_FIELDS) == (9, 4, 2, 0, 2, 10, 0, 0, 0)
    assert fields_of(dfu, INTERFACE_FIELDS) == (9, 4, 3, 0, 0, 0xFE, 1, 1, 6)
    found = [fields_of(endpoint, ENDPOINT_FIELDS) for interface in configuration for endpoint in interface]
    assert found == [
        (7, 5, 0x01, 2, bulk, 1),
        (7, 5, 0x81, 2, bulk, 1),
        (7, 5, 0x82, 3, 16, interval),
        (7, 5, 0x03, 2, bulk, 1),
        (7, 5, 0x83, 2, bulk, 1),
    ]
    assert bytes(control.extra_descriptors).hex() == "05240020010524010002042402020524060102"
    assert bytes(array[1].extra_descriptors).hex() == "080b010202020005"  # what follows an endpoint, as libusb has it
    assert bytes(dfu.extra_descriptors).hex() == "09210fe80300081001"
    assert not [*configuration.extra_descriptors, *array.extra_descriptors, *data.extra_descriptors]


# Any bytes.


def test_kinds_are_told_apart() -> None:
    assert type(descriptors(RUN_TIME.configuration)[0]) is Configuration
    assert type(descriptors(RUN_TIME.other_speed)[0]) is OtherSpeedConfiguration
    assert descriptors(b"") == ()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("00", "at byte 0: its length 0 is less than 2"),
        ("00 05", "its length 0 is less than 2"),
        ("01 05", "its length 1 is less than 2"),
        ("07 05 81 02 00 02", "its length 7 is less than 2 or goes beyond the end, 6 bytes away"),
        ("07 05 81 02 00 02 00 07", "at byte 7: its length 7"),
        ("06 05 81 02 00 02", "no Endpoint descriptor"),
        ("08 05 81 02 00 02 00 00", "no Endpoint descriptor"),
        ("03 2a 00", "2a00 is of no kind"),
        ("05 24 03 00 00", "of no kind"),
        ("02 24", "of no kind"),
        ("0a 06 01 02 ef 02 01 40 01 07", "no DeviceQualifier descriptor"),
        ("05 03 41 00 42", "no String descriptor"),
        ("04 03 00 d8", "no String descriptor"),
        ("1c 10 05 00" + "00" * 24, "of no kind"),
    ],
)
def test_malformed_chains_are_refused(data: str, message: str) -> None:
    with pytest.raises(ReplyError, match=message):
        descriptors(bytes.fromhex(data))


U8, U16 = st.integers(0, 255), st.integers(0, 65535)
TEXTS = st.text(st.characters(codec="utf-16-le"), max_size=63)
ANY = st.one_of(
    st.builds(Endpoint, U8, U8, U16, U8),
    st.builds(Interface, U8, U8, U8, U8, U8, U8, U8),
    st.builds(Configuration, U16, U8, U8, U8, U8, U8),
    st.builds(DeviceDescriptor, U16, U8, U8, U8, U8, U16, U16, U16, U8, U8, U8, U8),
    st.builds(DfuFunctional, U8, U16, U16, U16),
    st.builds(CdcUnion, U8, U8),
    st.builds(String, TEXTS),
)


@given(st.lists(ANY, max_size=5))
def test_values_survive_encoding_and_decoding(chain: list[Descriptor]) -> None:
    data = encode(*chain)
    assert list(descriptors(data)) == chain
    assert sum(each.encode()[0] for each in chain) == len(data)
