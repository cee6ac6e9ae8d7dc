"""Enumeration: descriptors, strings and standard requests, compared with the bytes in SPEC.md (chapter USB)."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import usb.util
from phasewire.base.errors import DeviceLostError
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, case, expect
from phasewire.hil.conformance.tools.dfu import dfu_mode
from phasewire.hil.conformance.tools.examples import example
from phasewire.hil.conformance.tools.steps import enable, expect_all
from phasewire.protocol.codes import Feature, Request, State
from phasewire.protocol.requests import Setup

VENDOR, PRODUCT = 0x1209, 0x0001
"""Clause USB-001, unless a profile says that the device was configured differently."""
DEVICE, CONFIGURATION, STRING, INTERFACE, ENDPOINT, QUALIFIER, OTHER_SPEED, BOS = 1, 2, 3, 4, 5, 6, 7, 15
WHOLE = 1024
"""More than any descriptor has."""
ENGLISH = 0x0409
INTERFACES = (0, 1, 2, 3)
ENDPOINTS = (0x01, 0x81, 0x82, 0x03, 0x83)
CONTROL_ENDPOINT = (0x00, 0x80)
BULK, INTERRUPT = 2, 3
SERIAL_NUMBER = re.compile(r"[A-Za-z0-9._-]{1,64}", re.ASCII)


def descriptor(bench: Bench, kind: int, index: int = 0, language: int = 0, length: int = WHOLE) -> bytes | None:
    """GET_DESCRIPTOR; None for STALL."""
    return bench.request(Setup(0x80, 6, kind << 8 | index, language, length))


def ms_os_set(bench: Bench, length: int = WHOLE) -> bytes | None:
    """The Microsoft OS 2.0 descriptor set, as Windows asks for it."""
    return bench.request(Setup(0xC0, 0x20, 0, 7, length))


def string(bench: Bench, index: int) -> str:
    """A string in English; fails if it is missing or malformed."""
    data = descriptor(bench, STRING, index, ENGLISH, 255)
    assert data is not None, f"string {index} is answered with STALL"
    assert len(data) >= 2, f"string {index} is {data.hex(' ')}, should have a length and a type"
    expect(f"the length and the type of string {index}", data[:2], bytes([len(data), STRING]))
    return data[2:].decode("utf-16-le")


def stalls(bench: Bench, setup: Setup, data: bytes = b"") -> None:
    """Fail unless a request is answered with STALL; inconclusive if this computer does not send it.

    Linux checks whether the interface of a request exists, and refuses by itself if it does not.
    """
    try:
        answer = bench.request(setup, data)
    except DeviceLostError as error:
        if getattr(error.__cause__, "errno", None) == errno.ENOENT:
            raise Inconclusive(f"this computer does not send {setup}") from error
        raise
    assert answer is None, f"{setup} is answered with {answer.hex(' ') or 'success'}, should be with STALL"


def is_full_speed(bench: Bench) -> bool:
    """Whether the bus runs at full speed, as the host's controller says."""
    return bool(bench.usb.device.speed == usb.util.SPEED_FULL)


def configuration(full_speed: bool, kind: int = CONFIGURATION) -> bytes:
    """The configuration of clause USB-009 at one speed; clause USB-010 gives the differences of the other."""
    data, parts = example("USB_CONFIGURATION"), []
    while data:
        part, data = bytearray(data[: data[0]]), data[data[0] :]
        if full_speed and part[1] == ENDPOINT and part[3] == BULK:
            part[4:6] = (64).to_bytes(2, "little")
        elif full_speed and part[1] == ENDPOINT and part[3] == INTERRUPT:
            part[6] = 0x20
        elif part[1] == CONFIGURATION:
            part[1] = kind
        parts.append(bytes(part))
    return b"".join(parts)


def device_descriptor(bench: Bench) -> bytes:
    """The example of clause USB-008 with the device's own numbers."""
    data = bytearray(example("USB_DEVICE"))
    major, minor, patch = bench.info.firmware
    vendor, product = bench.profile.vendor, bench.profile.product
    data[8:10] = (VENDOR if vendor is None else vendor).to_bytes(2, "little")
    data[10:12] = (PRODUCT if product is None else product).to_bytes(2, "little")
    data[12:14] = bytes([minor << 4 | patch, major // 10 << 4 | major % 10])
    return bytes(data)


def fixed_descriptors(bench: Bench) -> dict[int, bytes]:
    """What GET_DESCRIPTOR must answer at run time, by type."""
    full = is_full_speed(bench)
    return {
        DEVICE: device_descriptor(bench),
        CONFIGURATION: configuration(full),
        QUALIFIER: example("USB_QUALIFIER"),
        OTHER_SPEED: configuration(not full, OTHER_SPEED),
        BOS: example("USB_BOS"),
    }


@contextmanager
def unconfigured(bench: Bench) -> Iterator[None]:
    """Unconfigure the device for a while without the computer's knowledge."""
    for interface in INTERFACES:  # so that the computer has cached them all
        bench.request(Setup(0x81, 10, 0, interface, 1))
    bench.request(Setup(0x00, 9, 0, 0, 0))
    try:
        yield
    finally:
        bench.usb.set_configuration()


# Descriptors


@case("USB-006", "USB-008", "USB-001", "FWU-004", line="usb")
def test_the_device_descriptor_is_as_printed(bench: Bench) -> None:
    """The device descriptor is that of USB-008 with the firmware's version: hosts choose their drivers by it."""
    expect("the device descriptor", descriptor(bench, DEVICE), device_descriptor(bench))


@case("USB-006", "USB-009", "USB-002", "USB-010", "USB-013", "USB-021", line="usb")
def test_the_configuration_is_as_printed(bench: Bench) -> None:
    """The configuration is that of USB-009, with smaller packets at full speed: class, endpoints, no remote wake-up."""
    expect("the configuration", descriptor(bench, CONFIGURATION), configuration(is_full_speed(bench)))


@case("USB-006", "USB-010", line="usb")
def test_the_configuration_at_the_other_speed_differs_by_packets_alone(bench: Bench) -> None:
    """The other speed's configuration is that of USB-009 except for its packets and an interval."""
    wanted = configuration(not is_full_speed(bench), OTHER_SPEED)
    expect("the configuration at the other speed", descriptor(bench, OTHER_SPEED), wanted)


@case("USB-006", "USB-010", line="usb")
def test_the_device_qualifier_is_as_printed(bench: Bench) -> None:
    """The device qualifier is that of USB-010, from which a host learns what another speed would bring."""
    expect("the device qualifier", descriptor(bench, QUALIFIER), example("USB_QUALIFIER"))


@case("USB-006", "USB-011", line="usb")
def test_the_bos_is_as_printed(bench: Bench) -> None:
    """The BOS is that of USB-011, in which Windows finds its own descriptors."""
    expect("the BOS", descriptor(bench, BOS), example("USB_BOS"))


@case("USB-012", line="usb")
def test_the_descriptors_of_windows_are_as_printed(bench: Bench) -> None:
    """The Microsoft OS 2.0 set is that of USB-012 with all 338 bytes; otherwise Windows asks people for a driver."""
    found = ms_os_set(bench)
    expect("the length of the set", None if found is None else len(found), 338)
    expect("the set", found, example("USB_MS_OS"))


@case("USB-006", line="usb")
@pytest.mark.parametrize("kind", [DEVICE, CONFIGURATION, QUALIFIER, OTHER_SPEED, BOS], ids=lambda kind: f"type-{kind}")
def test_as_much_of_a_descriptor_comes_as_was_asked_for(bench: Bench, kind: int) -> None:
    """Each descriptor is cut to wLength bytes and never longer than it is, because hosts ask for heads first."""
    whole = fixed_descriptors(bench)[kind]
    for length in sorted({1, 2, 8, 9, 63, 64, 65, len(whole) - 1, len(whole), len(whole) + 1, 255}):
        expect(f"the first {length} bytes of it", descriptor(bench, kind, length=length), whole[:length])


@case("USB-006", "USB-007", "USB-012", line="usb")
def test_as_much_of_strings_and_of_the_set_comes_as_was_asked_for(bench: Bench) -> None:
    """Strings and the set of Windows are cut to wLength too: Windows first asks for ten bytes of the set."""
    for length in (2, 3, 10, 64, 255):
        whole = descriptor(bench, STRING, 1, ENGLISH, 255)
        assert whole is not None, "string 1 is answered with STALL"
        expect(f"the first {length} bytes of string 1", descriptor(bench, STRING, 1, ENGLISH, length), whole[:length])
    for length in (1, 10, 64, 128, 337, 338):
        expect(f"the first {length} bytes of the set", ms_os_set(bench, length), example("USB_MS_OS")[:length])


@case("USB-006", "USB-004", line="usb")
@pytest.mark.parametrize(
    "kind", [0, 4, 5, 8, 9, 10, 11, 0x10, 0x21, 0x22, 0x24, 0x30, 0xFF], ids=lambda kind: f"{kind:02x}"
)
def test_other_types_of_descriptors_stall(bench: Bench, kind: int) -> None:
    """A type that USB-006 does not offer, or that is part of another descriptor, is answered with STALL."""
    stalls(bench, Setup(0x80, 6, kind << 8, 0, WHOLE))


@case("USB-006", "USB-004", line="usb")
def test_other_indices_of_descriptors_stall(bench: Bench) -> None:
    """Each descriptor has only index 0: other answers would show a host configurations that do not exist."""
    for kind in (DEVICE, CONFIGURATION, QUALIFIER, OTHER_SPEED, BOS):
        for index in (1, 2, 255):
            stalls(bench, Setup(0x80, 6, kind << 8 | index, 0, WHOLE))


@case("USB-004", "USB-012", line="usb")
@pytest.mark.parametrize(
    "setup",
    [
        Setup(0xC0, 0x20, 0, 4, WHOLE),
        Setup(0xC0, 0x20, 0, 8, WHOLE),
        Setup(0xC0, 0x20, 1, 7, WHOLE),
        Setup(0xC0, 0x21, 0, 7, WHOLE),
        Setup(0x40, 0x20, 0, 7, 0),
        Setup(0xC1, 0x20, 0, 0, WHOLE),
    ],
    ids=["index-4", "index-8", "value-1", "request-33", "out", "interface-0"],
)
def test_requests_beside_that_of_windows_stall(bench: Bench, setup: Setup) -> None:
    """Only the exact request that the BOS names is answered with the set; similar ones are answered with STALL."""
    stalls(bench, setup)


# Strings


@case("USB-007", line="usb")
def test_the_strings_are_in_english_alone(bench: Bench) -> None:
    """String 0 lists only language 0409, in which hosts ask for all other strings."""
    expect("string 0", descriptor(bench, STRING, 0, 0, 255), bytes([4, 3, 0x09, 0x04]))


@case("USB-007", "USB-001", line="usb")
def test_every_string_that_a_descriptor_names_is_there(bench: Bench) -> None:
    """Manufacturer, product, serial number and the interfaces' names are readable, so that people see what it is."""
    for index in range(1, 7):
        text = string(bench, index)
        assert text.strip(), f"string {index} is empty"
        assert text.isprintable(), f"string {index} is {text!r}, should be printable"


@case("USB-006", "USB-007", "USB-004", line="usb")
def test_other_strings_and_languages_stall(bench: Bench) -> None:
    """An index that is not in USB-007, or a language that string 0 does not list, is answered with STALL."""
    for index in (7, 8, 16, 17, 40, 0xEE, 255):
        stalls(bench, Setup(0x80, 6, STRING << 8 | index, ENGLISH, 255))
    for language in (0, 0x0407, 0x0809, 0x0904, 0xFFFF):
        for index in (1, 3, 6):
            stalls(bench, Setup(0x80, 6, STRING << 8 | index, language, 255))


@case("USB-001", "USB-007", line="usb")
def test_the_serial_number_is_made_of_safe_characters(bench: Bench) -> None:
    """The serial number has 1 to 64 letters, digits, dots, hyphens and underscores: URLs and paths contain it."""
    serial = string(bench, 3)
    assert SERIAL_NUMBER.fullmatch(serial), (
        f"the serial number is {serial!r}, should be 1 to 64 letters, digits, dots, hyphens and underscores"
    )


@case("USB-001", "REQ-013", allow=(Risk.RESET,), line="usb")
def test_the_serial_number_is_kept_over_a_reset(bench: Bench) -> None:
    """The serial number is the same after RESET: hosts find a device again by it."""
    before = string(bench, 3)
    bench.restart(lambda: bench.order(Request.RESET))
    expect("the serial number", string(bench, 3), before)


@case("USB-001", needs=(Need.POWER,), allow=(Risk.RESET,), line="usb")
def test_the_serial_number_is_kept_over_a_loss_of_power(bench: Bench) -> None:
    """The serial number is the same after power was lost: it is not drawn at each start."""
    before = string(bench, 3)
    bench.power_cycle()
    expect("the serial number", string(bench, 3), before)


# DFU mode


@case(
    *("USB-013", "USB-001", "USB-006", "USB-007", "USB-010", "USB-011", "USB-012"),
    allow=(Risk.RESET,),
    line="usb",
    features=Feature.DFU,
)
def test_the_descriptors_in_dfu_mode_are_as_printed(bench: Bench) -> None:
    """In DFU mode the device has the next product number, one interface and the same serial number, for tools."""
    serial, run_time = string(bench, 3), device_descriptor(bench)
    with dfu_mode(bench):
        check_dfu_mode(bench, serial, run_time)
    expect("the device descriptor, back at run time", descriptor(bench, DEVICE), run_time)


def check_dfu_mode(bench: Bench, serial: str, run_time: bytes) -> None:
    """The answers to GET_DESCRIPTOR in DFU mode, and STALL for the descriptors that are missing there."""
    product = (int.from_bytes(run_time[10:12], "little") + 1).to_bytes(2, "little")
    wanted = run_time[:4] + bytes(3) + run_time[7:10] + product + run_time[12:]
    expect("the device descriptor", descriptor(bench, DEVICE), wanted)
    same = example("USB_DFU_CONFIGURATION")
    expect("the configuration", descriptor(bench, CONFIGURATION), same)
    expect("the configuration at the other speed", descriptor(bench, OTHER_SPEED), bytes([9, OTHER_SPEED]) + same[2:])
    qualifier = example("USB_QUALIFIER")
    expect("the device qualifier", descriptor(bench, QUALIFIER), qualifier[:4] + bytes(3) + qualifier[7:])
    printed, size = example("USB_MS_OS"), (162).to_bytes(2, "little")
    bos = example("USB_BOS")
    expect("the BOS", descriptor(bench, BOS), bos[:-4] + size + bos[-2:])
    expect("the set of Windows", ms_os_set(bench), printed[:8] + size + printed[-152:])
    expect("string 0", descriptor(bench, STRING, 0, 0, 255), bytes([4, 3, 0x09, 0x04]))
    expect("the serial number", string(bench, 3), serial)
    expect("the name of the alternate setting", string(bench, 4), "firmware")
    assert string(bench, 1).strip(), "the manufacturer is empty"
    assert string(bench, 2).strip(), "the product is empty"
    for index in (5, 6):
        stalls(bench, Setup(0x80, 6, STRING << 8 | index, ENGLISH, 255))


# Standard requests


@case("USB-014", "USB-021", line="usb")
def test_get_status_of_the_device(bench: Bench) -> None:
    """GET_STATUS of the device answers 01 00: it is self-powered and does not wake its host."""
    expect("the status of the device", bench.request(Setup(0x80, 0, 0, 0, 2)), b"\x01\x00")


@case("USB-014", line="usb")
def test_get_status_of_interfaces_and_endpoints(bench: Bench) -> None:
    """GET_STATUS answers 00 00 for each interface and each endpoint, the control endpoint included: none is halted."""
    for interface in INTERFACES:
        expect(f"the status of interface {interface}", bench.request(Setup(0x81, 0, 0, interface, 2)), bytes(2))
    for endpoint in (*CONTROL_ENDPOINT, *ENDPOINTS):
        expect(f"the status of endpoint {endpoint:02X}", bench.request(Setup(0x82, 0, 0, endpoint, 2)), bytes(2))


@case("USB-014", "USB-005", line="usb")
def test_configuration_and_settings_can_be_read(bench: Bench) -> None:
    """GET_CONFIGURATION answers 1 and GET_INTERFACE 0: there is one configuration, and one setting of each."""
    expect("the configuration", bench.request(Setup(0x80, 8, 0, 0, 1)), b"\x01")
    for interface in INTERFACES:
        expect(f"the setting of interface {interface}", bench.request(Setup(0x81, 10, 0, interface, 1)), b"\x00")


UNKNOWN = {
    "set-descriptor": Setup(0x00, 7, DEVICE << 8, 0, 0),
    "synch-frame": Setup(0x82, 12, 0, 0x81, 2),
    "set-remote-wakeup": Setup(0x00, 3, 1, 0, 0),
    "clear-remote-wakeup": Setup(0x00, 1, 1, 0, 0),
    "clear-test-mode": Setup(0x00, 1, 2, 0, 0),
    "request-2": Setup(0x80, 2, 0, 0, 2),
    "request-4": Setup(0x80, 4, 0, 0, 2),
    "request-48": Setup(0x00, 48, 0, 0, 0),
    "get-status-of-something-else": Setup(0x83, 0, 0, 0, 2),
    "get-status-with-a-value": Setup(0x80, 0, 1, 0, 2),
    "get-descriptor-of-an-interface": Setup(0x81, 6, 0x2100, 3, 9),
    "set-configuration-2": Setup(0x00, 9, 2, 0, 0),
    "set-configuration-255": Setup(0x00, 9, 255, 0, 0),
    "set-feature-of-an-interface": Setup(0x01, 3, 0, 0, 0),
    "set-another-feature-of-an-endpoint": Setup(0x02, 3, 1, 0x81, 0),
    "clear-another-feature-of-an-endpoint": Setup(0x02, 1, 1, 0x81, 0),
    "halt-of-no-endpoint": Setup(0x02, 3, 0, 0x02, 0),
    "status-of-no-endpoint": Setup(0x82, 0, 0, 0x02, 2),
    "status-of-endpoint-84": Setup(0x82, 0, 0, 0x84, 2),
    "setting-1-of-interface-0": Setup(0x01, 11, 1, 0, 0),
    "setting-1-of-interface-2": Setup(0x01, 11, 1, 2, 0),
    "setting-1-of-interface-3": Setup(0x01, 11, 1, 3, 0),
    "test-mode-0": Setup(0x00, 3, 2, 0x0000, 0),
    "test-mode-127": Setup(0x00, 3, 2, 0x7F00, 0),
    "vendor-request-to-the-device": Setup(0xC0, Request.INFO, 0, 0, 64),
    "vendor-request-to-an-endpoint": Setup(0xC2, Request.INFO, 0, 0x81, 64),
    "info-of-interface-1": Setup(0xC1, Request.INFO, 0, 1, 64),
    "info-of-interface-3": Setup(0xC1, Request.INFO, 0, 3, 64),
    "info-of-interface-4": Setup(0xC1, Request.INFO, 0, 4, 64),
    "class-request-to-interface-0": Setup(0xA1, 0x21, 0, 0, 7),
    "reserved-type": Setup(0xE0, 0, 0, 0, 2),
}


@case("USB-014", "USB-004", "USB-021", line="usb")
@pytest.mark.parametrize("setup", UNKNOWN.values(), ids=UNKNOWN)
def test_unknown_requests_stall_and_change_nothing(bench: Bench, setup: Setup) -> None:
    """A request that is unknown, or has an unknown value, is answered with STALL and has no effect."""
    enable(bench)
    before = bench.status()
    stalls(bench, setup)
    expect_all(bench.status(), state=State.READY, faults=before.faults)
    expect("the configuration", bench.request(Setup(0x80, 8, 0, 0, 1)), b"\x01")
    expect("the status of the device", bench.request(Setup(0x80, 0, 0, 0, 2)), b"\x01\x00")
    expect("the status of endpoint 81", bench.request(Setup(0x82, 0, 0, 0x81, 2)), bytes(2))


@case("USB-014", "USB-004", needs=(Need.POWER,), allow=(Risk.RESET,), line="usb")
def test_test_mode_is_of_high_speed(bench: Bench) -> None:
    """SET_FEATURE of TEST_MODE works at high speed, until power is lost, and is unknown at full speed."""
    setup = Setup(0x00, 3, 2, 0x0300, 0)
    if is_full_speed(bench):
        stalls(bench, setup)
        return
    answer = bench.request(setup)
    bench.power_cycle()
    assert answer is not None, "TEST_MODE with Test_SE0_NAK is answered with STALL at high speed"


# Not configured


@case("USB-014", "REQ-001", "USB-004", line="usb")
@pytest.mark.parametrize(
    "setup",
    [
        *(Setup(0x81, 0, 0, interface, 2) for interface in INTERFACES),
        *(Setup(0x81, 10, 0, interface, 1) for interface in INTERFACES),
        Setup(0x01, 11, 0, 0, 0),
        *(Setup(0x82, 0, 0, endpoint, 2) for endpoint in ENDPOINTS),
        Setup(0x02, 1, 0, 0x81, 0),
        Setup(0x02, 3, 0, 0x01, 0),
        *(Setup(0xC1, request, 0, 0, 64) for request in (Request.INFO, Request.STATUS, Request.WIRING, Request.CLOCK)),
        *(Setup(0x41, request, 0, 0, 0) for request in (Request.ENABLE, Request.DISABLE, Request.CLEAR_FAULTS)),
        Setup(0x41, Request.WATCHDOG, 500, 0, 0),
        Setup(0xA1, 0x21, 0, 1, 7),
        Setup(0x21, 0x22, 1, 1, 0),
        Setup(0xA1, 3, 0, 3, 6),
        Setup(0xA1, 5, 0, 3, 1),
    ],
    ids=lambda setup: f"{setup.request_type:02x}-{setup.request}-{setup.index:02x}",
)
def test_interfaces_are_not_there_before_configuration(bench: Bench, setup: Setup) -> None:
    """While the device is not configured requests to an interface or an endpoint are answered with STALL."""
    with unconfigured(bench):
        stalls(bench, setup)
    expect_all(bench.status(), state=State.OFF, watchdog_ms=bench.info.watchdog_ms)


@case("USB-006", "USB-012", "USB-014", line="usb")
def test_descriptors_do_not_depend_on_a_configuration(bench: Bench) -> None:
    """While not configured the device says so, and still answers all descriptors and its control endpoint's status."""
    serial = string(bench, 3)
    with unconfigured(bench):
        expect("the configuration", bench.request(Setup(0x80, 8, 0, 0, 1)), b"\x00")
        expect("the status of the device", bench.request(Setup(0x80, 0, 0, 0, 2)), b"\x01\x00")
        for endpoint in CONTROL_ENDPOINT:
            expect(f"the status of endpoint {endpoint:02X}", bench.request(Setup(0x82, 0, 0, endpoint, 2)), bytes(2))
        for kind, wanted in fixed_descriptors(bench).items():
            expect(f"the descriptor of type {kind}", descriptor(bench, kind), wanted)
        expect("the serial number", string(bench, 3), serial)
        expect("the set of Windows", ms_os_set(bench), example("USB_MS_OS"))
    expect("the configuration afterwards", bench.request(Setup(0x80, 8, 0, 0, 1)), b"\x01")
