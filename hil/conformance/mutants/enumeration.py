"""Broken enumeration: descriptors, strings and standard requests (chapter USB)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ....emulator.door import Stall
from ....emulator.interfaces import usb_device
from ....emulator.interfaces.usb_device import UsbDevice
from ....protocol.codes import DescriptorType, StandardRequest
from ....protocol.enumeration import CONFIGURATION_VALUE, FULL_SPEED, HIGH_SPEED, LANGUAGE, Enumeration
from ....protocol.requests import DIRECTION_IN, Setup
from .patching import Patch, mutant

MOST_BYTES = 2**16 - 1
TYPE_AT = 1
"""Of a descriptor."""
FIRST_OUT = bytes.fromhex("07 05 01 02")
NOTIFICATIONS = bytes.fromhex("07 05 82 03")
INTERVAL_AT = 6
"""Offset in an endpoint descriptor."""
MS_OS_TOTAL_AT = 8
MS_OS_CONFIGURATION_AT = 14
"""Of the Microsoft OS 2.0 descriptor set: its length, and bConfigurationValue of the configuration subset."""


def _describe(patch: Patch, change: Any, mode: str = "run_time") -> None:
    """Change the device's descriptors in a mode: a function takes them and returns others."""
    patch.wrap(usb_device, mode, lambda original: lambda *given: change(original(*given)))


def _with_byte(data: bytes, at: int, value: int) -> bytes:
    return data[:at] + bytes([value]) + data[at + 1 :]


def _with_interval(configuration: bytes, endpoint: bytes, interval: int) -> bytes:
    """Change bInterval of the endpoint whose descriptor begins like this."""
    return _with_byte(configuration, configuration.index(endpoint) + INTERVAL_AT, interval)


# Descriptors


@mutant("USB-009", by=_describe)
def blocks_endpoint_has_interval_0(found: Enumeration) -> Enumeration:
    """BInterval of 01 OUT is 0, which promises that it never answers NAK: 0 was taken for "unused"."""
    return replace(
        found,
        configuration=_with_interval(found.configuration, FIRST_OUT, 0),
        other_speed=_with_interval(found.other_speed, FIRST_OUT, 0),
    )


@mutant("USB-010", by=_describe, url="emulator:?speed=full")
def notifications_have_the_interval_of_high_speed(found: Enumeration) -> Enumeration:
    """At full speed 82 IN is polled every 9 frames instead of 32: bInterval is taken for the exponent of high speed."""
    return replace(found, configuration=_with_interval(found.configuration, NOTIFICATIONS, HIGH_SPEED.interval))


@mutant("USB-010", by=_describe)
def other_speed_has_the_packets_of_this_one(found: Enumeration) -> Enumeration:
    """The other-speed configuration is this speed's with another type: at full speed it names packets of 512 bytes."""
    other = _with_byte(found.configuration, TYPE_AT, DescriptorType.OTHER_SPEED_CONFIGURATION)
    return replace(found, other_speed=other)


@mutant("USB-010", "USB-006", wraps=(UsbDevice, "_descriptor"))
def qualifier_names_another_class(original: Any, self: UsbDevice, setup: Setup) -> Any:
    """The device qualifier has class 0 instead of that of composite devices: it was copied from an older device."""
    found = original(self, setup)
    is_qualifier = setup.value >> 8 == DescriptorType.DEVICE_QUALIFIER
    return found[:4] + bytes(3) + found[7:] if is_qualifier else found


@mutant("USB-012", "USB-011", by=_describe)
def ms_os_set_says_another_length(found: Enumeration) -> Enumeration:
    """The header of the Microsoft OS 2.0 descriptor set is two bytes short in its length: a NUL was forgotten."""
    said = (len(found.ms_os) - 2).to_bytes(2, "little")
    return replace(found, ms_os=found.ms_os[:MS_OS_TOTAL_AT] + said + found.ms_os[MS_OS_TOTAL_AT + 2 :])


@mutant("USB-012")
def ms_os_set_names_the_value_of_the_configuration(patch: Patch) -> None:
    """The configuration subset holds the configuration's value, 1; Windows wants its index, 0."""
    _describe(patch, lambda found: replace(found, ms_os=_with_byte(found.ms_os, MS_OS_CONFIGURATION_AT, 1)))


@mutant("USB-012", "USB-013", wraps=(UsbDevice, "_ms_os_descriptors"))
def ms_os_set_is_missing_in_dfu_mode(original: Any, self: Any, setup: Setup) -> Any:
    """In DFU mode the vendor request of Windows is answered with STALL: only the composite device handles it."""
    if self._dfu is None:
        raise Stall("it is unknown in DFU mode")
    return original(self, setup)


@mutant("USB-007", wraps=(UsbDevice, "_descriptor"))
def strings_are_there_in_every_language(original: Any, self: UsbDevice, setup: Setup) -> Any:
    """A string is answered for any language in wIndex."""
    is_string = setup.value >> 8 == DescriptorType.STRING
    return original(self, replace(setup, index=LANGUAGE) if is_string else setup)


@mutant("USB-013", "USB-007")
def setting_has_another_name_in_dfu_mode(patch: Patch) -> None:
    """In DFU mode the alternate setting is not called "firmware", the name by which host software finds it."""
    _describe(patch, lambda found: replace(found, strings={**found.strings, 4: "@Firmware /0x0"}), "dfu_mode")


@mutant("USB-013", "USB-001")
def serial_number_is_another_in_dfu_mode(patch: Patch) -> None:
    """In DFU mode the serial number ends differently, so that host software loses the device."""
    _describe(patch, lambda found: replace(found, strings={**found.strings, 3: found.strings[3] + "-D"}), "dfu_mode")


@mutant("USB-001", wraps=(UsbDevice, "connect"))
def serial_number_changes_at_each_restart(original: Any, self: Any, *given: Any) -> None:
    """The device has another serial number after each restart: it is drawn at random."""
    if self.generation:
        self._serial = f"R{self.generation:04}"
    original(self, *given)


@mutant("USB-006", "USB-014", wraps=(UsbDevice, "control"))
def descriptors_are_not_cut_to_what_was_asked_for(
    original: Any, self: UsbDevice, setup: Setup, data: bytes = b""
) -> Any:
    """A descriptor is answered whole, even if fewer bytes were requested: wLength is ignored."""
    whole = setup.request_type == DIRECTION_IN and setup.request == StandardRequest.GET_DESCRIPTOR
    return original(self, replace(setup, length=MOST_BYTES) if whole else setup, data)


@mutant("USB-006", "USB-004", wraps=(UsbDevice, "_descriptor"))
def unknown_descriptors_are_empty(original: Any, self: UsbDevice, setup: Setup) -> Any:
    """A descriptor that does not exist is answered with no bytes instead of STALL."""
    try:
        return original(self, setup)
    except Stall:
        return b""


# Standard requests


@mutant("USB-014", "USB-003", wraps=(UsbDevice, "_set_configuration"))
def configuration_2_is_taken(original: Any, self: Any, setup: Any) -> Any:
    """SET_CONFIGURATION configures the device for any value except 0, even one that it does not have."""
    return original(self, replace(setup, value=min(setup.value, CONFIGURATION_VALUE)))


@mutant("USB-014", "USB-022", wraps=(UsbDevice, "_device_status"))
def device_says_that_the_bus_powers_it(original: Any, self: UsbDevice, setup: Setup) -> bytes:
    """GET_STATUS of the device does not report self-powered."""
    return bytes(len(original(self, setup)))


@mutant("USB-014", "REQ-001", wraps=(UsbDevice, "_function"))
def interfaces_answer_before_the_configuration(original: Any, self: UsbDevice, setup: Setup) -> Any:
    """Requests to interfaces are answered before the device is configured: the state is not checked."""
    before, self.configuration = self.configuration, CONFIGURATION_VALUE
    try:
        return original(self, setup)
    finally:
        self.configuration = before


@mutant("USB-004", "USB-021", wraps=(UsbDevice, "control"))
def remote_wake_up_can_be_set(original: Any, self: UsbDevice, setup: Setup, data: bytes = b"") -> Any:
    """SET_FEATURE of remote wake-up is acknowledged, although the device does not offer it."""
    if (setup.request_type, setup.request, setup.value) == (0, StandardRequest.SET_FEATURE, 1):
        return b""
    return original(self, setup, data)


@mutant("USB-010", wraps=(UsbDevice, "_descriptor"), url="emulator:?speed=full")
def full_speed_has_no_qualifier(original: Any, self: UsbDevice, setup: Setup) -> Any:
    """At full speed the device answers STALL to the qualifier, as a device without high speed does."""
    if setup.value >> 8 == DescriptorType.DEVICE_QUALIFIER and self.speed == FULL_SPEED:
        raise Stall("it is not there")
    return original(self, setup)
