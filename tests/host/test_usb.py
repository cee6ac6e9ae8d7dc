from __future__ import annotations

import dataclasses
import errno
from collections.abc import Callable
from typing import Any

import pytest
import usb.core
from phasewire import Emulator, Pulses, open_device
from phasewire.emulator.doors.backend import EmulatorBackend, Port
from phasewire.errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)
from phasewire.protocol import Info


def test_a_device_is_chosen_by_its_serial_number() -> None:
    with Emulator(serial="A"), Emulator(serial="B") as b, open_device("emulator:B") as device:
        assert device.name.endswith(" B")
        device.show(Pulses.silent(320))
        assert any("planned for period" in event.what for event in b.events)


def test_a_missing_serial_number_names_those_that_are_there() -> None:
    with Emulator(serial="A"), pytest.raises(DeviceNotFoundError, match=r"no device at 'emulator:Z': there are 'A'"):
        open_device("emulator:Z")
    with pytest.raises(DeviceNotFoundError, match="nothing is plugged in"):
        open_device("emulator:Z")


def test_several_devices_and_no_choice_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    two = [Emulator(serial="A"), Emulator(serial="B")]
    monkeypatch.setattr("phasewire.emulator.doors.backend.open_backend", lambda url: EmulatorBackend(two))
    with pytest.raises(DeviceNotFoundError, match="could be any of 2 devices; name one: emulator:A or emulator:B"):
        open_device("emulator:")


def test_the_real_bus_is_empty_here_and_says_so() -> None:
    """On a machine with a device on its bus this would find it; what must not happen is anything but a clear answer."""
    with pytest.raises(DeviceNotFoundError, match=r"no device at 'usb:no-such-serial'"):
        open_device("usb:no-such-serial")


def test_a_usb_url_has_no_options() -> None:
    with pytest.raises(DeviceNotFoundError, match="a usb: URL has no options"):
        open_device("usb:?link=5wire")


def test_libusb_that_cannot_be_loaded_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("libusb_package.get_libusb1_backend", lambda: None)
    with pytest.raises(DeviceNotFoundError, match="libusb could not be loaded"):
        open_device("usb:")


def raising(number: int | None) -> Callable[..., Any]:
    def transfer(*arguments: object) -> None:
        raise usb.core.USBError("as it happens", None, number)

    return transfer


@pytest.mark.parametrize(
    ("number", "expected", "message"),
    [
        (errno.ETIMEDOUT, DeviceTimeoutError, "sending a block: no answer within 1000 ms"),
        (errno.ENODEV, DeviceLostError, "sending a block: the device is gone"),
        (errno.EIO, DeviceLostError, "the device is gone"),
        (errno.EACCES, DeviceAccessError, "permission denied"),
        (errno.EBUSY, DeviceAccessError, "another program is using the device"),
        (errno.EPIPE, DeviceError, "the device answers STALL"),
        (None, DeviceError, "as it happens"),
    ],
)
def test_errors_of_the_bus_become_ours(
    monkeypatch: pytest.MonkeyPatch, number: int | None, expected: type[DeviceError], message: str
) -> None:
    device = open_device("emulator:")
    with monkeypatch.context() as patch:
        patch.setattr(EmulatorBackend, "bulk_write", raising(number))
        with pytest.raises(expected, match=message) as raised:
            device.show(Pulses.silent(320))
    assert type(raised.value) is expected
    device.stop()


def test_a_device_that_may_not_be_opened_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without permission pyusb finds the device but fails to read any string: ValueError, "no langid"."""
    monkeypatch.setattr(EmulatorBackend, "ctrl_transfer", raising(errno.EACCES))
    with pytest.raises(DeviceAccessError, match="udev rule"):
        open_device("emulator:")


def test_a_device_that_is_open_elsewhere_is_not_disturbed(emulator: Emulator) -> None:
    with open_device(emulator.url) as first:
        first.show(Pulses.silent(320))
        with pytest.raises(DeviceAccessError, match="another program is using the device"):
            open_device(emulator.url)
        assert first.status().enabled
    with open_device(emulator.url) as second:
        assert not second.status().enabled


def test_a_device_that_cannot_be_opened_whole_is_let_go(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = Info.encode
    with monkeypatch.context() as patch:
        patch.setattr(Info, "encode", lambda self: genuine(dataclasses.replace(self, oldest_version=9)))
        with pytest.raises(DeviceError, match="versions 9 to 1") as raised:
            open_device(emulator.url)
    assert not Port.of(emulator.usb).claims, raised  # while the error, and with it every frame, is still alive


def test_others_with_the_same_test_numbers_are_left_alone(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """1209:0001 is anybody's test pair: a device without our interface is not ours (clause USB-005)."""
    genuine = emulator.usb.enumeration
    foreign = genuine.configuration.replace(bytes([0xFF, 0x50, 0x01]), bytes([0xFF, 0x50, 0x02]))
    assert foreign != genuine.configuration
    monkeypatch.setattr(emulator.usb, "enumeration", dataclasses.replace(genuine, configuration=foreign))
    with pytest.raises(DeviceNotFoundError, match="nothing is plugged in"):
        open_device(emulator.url)
    assert emulator.usb.configuration == 0


def test_a_half_sent_block_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    device = open_device("emulator:")
    monkeypatch.setattr(EmulatorBackend, "bulk_write", lambda *arguments: 100)
    with pytest.raises(DeviceError, match="only 100 of a block's 512 bytes were sent"):
        device.show(Pulses.silent(320))
