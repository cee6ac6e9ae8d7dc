"""Devices on a bus, distinguished from each other and from foreign ones."""

from __future__ import annotations

import dataclasses
import errno
from collections.abc import Callable
from typing import Any

import pytest
import usb.core
import usb.util
from phasewire import Emulator
from phasewire.base.errors import (
    DeviceAccessError,
    DeviceLostError,
    DeviceNotFoundError,
)
from phasewire.emulator.doors.backend import EmulatorBackend, Port
from phasewire.host.firmware.dfu import DfuLine, detach
from phasewire.host.transports.transport import Found
from phasewire.host.transports.usb_find import ANY_MODE, DFU_MODE, RUN_TIME, Sighting, UsbFinder, select
from phasewire.protocol.descriptors import DfuFunctional

from tests.host.upgrades import FACTORY

from .buses import in_dfu_mode, raising


def sightings(*emulators: Emulator, url: str = "emulator:") -> list[Sighting]:
    """The sightings on a bus with these devices."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("phasewire.emulator.doors.backend.open_backend", lambda url: EmulatorBackend(emulators))
        return UsbFinder(url).look()


def seen_on(*emulators: Emulator, url: str = "emulator:") -> list[Found]:
    return [seen.found for seen in sightings(*emulators, url=url)]


def found(serial: str | None, mode: Any = RUN_TIME, problem: str | None = None) -> Found:
    url = f"usb:{serial}" if serial else "usb:1209:0001"
    return Found(url, "array", serial, mode, "0.1.0", "1-2", problem)


# On the bus


def test_a_device_is_listed_with_all_its_details() -> None:
    assert seen_on(Emulator(serial="X-1")) == [
        Found("emulator:X-1", "phasewire five-board array (emulated)", "X-1", "run time", "0.1.0", "0-1")
    ]


def test_looking_neither_configures_nor_claims(emulator: Emulator) -> None:
    seen_on(emulator)
    assert emulator.usb.configuration == 0
    assert not Port.of(emulator.usb).claims


@pytest.mark.parametrize(
    "foreign",
    [
        lambda bytes_: bytes_.replace(bytes([0xFF, 0x50, 0x01]), bytes([0xFF, 0x50, 0x02])),
        lambda bytes_: bytes_.replace(bytes([0xFF, 0x50, 0x01]), bytes([0x03, 0x00, 0x00])),
    ],
)
def test_others_with_the_same_numbers_are_left_alone(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, foreign: Callable[[bytes], bytes]
) -> None:
    genuine = emulator.usb.enumeration
    changed = dataclasses.replace(genuine, configuration=foreign(genuine.configuration))
    assert changed != genuine
    monkeypatch.setattr(emulator.usb, "enumeration", changed)
    asked: list[object] = []
    monkeypatch.setattr(EmulatorBackend, "open_device", lambda self, device: asked.append(device))
    assert seen_on(emulator) == []
    assert asked == []


def test_another_s_boot_loader_with_the_numbers_of_dfu_mode_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its functional descriptor says something else than USB-013."""
    waiting = in_dfu_mode("D-2")
    genuine = waiting.usb.enumeration
    ours, other = DfuFunctional(0x0F, 1000, 2048, 0x0110).encode(), DfuFunctional(0x0B, 255, 1024, 0x011A).encode()
    assert ours in genuine.configuration
    changed = dataclasses.replace(genuine, configuration=genuine.configuration.replace(ours, other))
    monkeypatch.setattr(waiting.usb, "enumeration", changed)
    assert seen_on(waiting) == []


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (
            usb.core.USBError("denied", None, errno.EACCES),
            "permission denied: install the udev rule with `phasewire doctor --udev-rule | sudo tee",
        ),
        (usb.core.USBError("busy", None, errno.EBUSY), "another program is using it: close that first"),
        (usb.core.USBError("i/o", None, errno.EIO), "it does not answer"),
        (NotImplementedError("not supported on this platform"), "WinUSB"),  # pyusb's for LIBUSB_ERROR_NOT_SUPPORTED
    ],
)
def test_a_device_with_unreadable_strings_is_listed_with_the_reason(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, error: Exception, told: str
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(EmulatorBackend, "ctrl_transfer", raising(error))
    [locked] = seen_on(emulator)
    assert (locked.url, locked.serial, locked.product) == ("emulator:1209:0001", None, "")
    assert locked.problem is not None
    assert told in locked.problem


def test_a_device_whose_descriptors_cannot_be_read_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(EmulatorBackend, "get_configuration_descriptor", raising(usb.core.USBError("gone")))
    assert seen_on(Emulator()) == []


# Choice


@pytest.mark.parametrize(
    ("url", "chosen"),
    [
        ("usb:PW-1", "PW-1"),  # the whole number before a beginning
        ("usb:PW-12", "PW-12"),
        ("usb:PW-2", "PW-20"),  # the only beginning
        ("usb:20", "PW-20"),  # the only part
        ("usb:OLD", "OLD-PW-2"),
        ("usb:12", "PW-12"),
    ],
)
def test_a_serial_number_may_be_cut_short(url: str, chosen: str) -> None:
    there = [found("PW-1"), found("PW-12"), found("PW-20"), found("OLD-PW-2")]
    assert select(url, url.removeprefix("usb:"), there).serial == chosen


def test_a_device_without_a_name_is_described_by_its_place() -> None:
    with pytest.raises(DeviceNotFoundError, match=r"usb:A or the one at 1-2 \(permission denied\)"):
        select("usb:", "", [found("A"), found(None, problem="permission denied")])


def test_the_error_names_a_device_in_another_mode() -> None:
    with pytest.raises(DeviceNotFoundError, match="no device at 'usb:A' in run time mode: usb:A is in DFU mode"):
        select("usb:A", "A", [found("A", DFU_MODE)], (RUN_TIME,))
    assert select("usb:A", "A", [found("A", DFU_MODE)], ANY_MODE).serial == "A"


def test_a_device_that_cannot_be_read_may_be_the_one() -> None:
    locked = found(None, problem="permission denied")
    assert select("usb:A", "A", [locked]) is locked
    assert select("usb:A", "A", [locked, found("A")]).serial == "A"


# From one mode to the other, and back


def test_a_device_is_seen_in_both_modes(emulator: Emulator) -> None:
    bus = UsbFinder(emulator.url)
    seen = bus.find()
    assert (seen.mode, seen.serial, seen.firmware) == (RUN_TIME, emulator.serial, FACTORY)
    assert seen.name == f"phasewire five-board array (emulated) {emulator.serial}"
    assert seen.found.url == emulator.url
    detach(seen)
    seen = bus.find_again(seen, (DFU_MODE,), 2)
    assert (seen.mode, seen.serial, seen.firmware) == (DFU_MODE, emulator.serial, FACTORY)
    assert UsbFinder(emulator.url).find().mode == DFU_MODE
    with DfuLine(seen) as line:
        line.boot()
    assert bus.find_again(seen, ANY_MODE, 2).mode == RUN_TIME


def number(monkeypatch: pytest.MonkeyPatch, emulator: Emulator, product: int) -> None:
    """Let a device have another product number, in the mode in which it is."""
    told = emulator.usb.enumeration
    changed = dataclasses.replace(told, device=dataclasses.replace(told.device, idProduct=product))
    monkeypatch.setattr(emulator.usb, "enumeration", changed)


def test_numbers_are_those_of_run_time_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clause USB-013: another product has the next higher number in DFU mode."""
    with Emulator() as emulator:
        bus = UsbFinder("emulator:1209:0ABC")
        assert bus.look() == []
        number(monkeypatch, emulator, 0x0ABC)
        assert bus.find().mode == RUN_TIME
        assert UsbFinder(emulator.url).look() == []
        detach(bus.find())
        emulator.scheduler.run_until(emulator.scheduler.now + 400_000 * 200)
        assert bus.look() == []
        number(monkeypatch, emulator, 0x0ABD)
        assert bus.find().mode == DFU_MODE
        assert UsbFinder(emulator.url).look() == []


def test_rights_may_come_a_moment_after_the_device(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """udev gives access some time after the kernel has shown the device; until then its strings cannot be read."""
    genuine, until = EmulatorBackend.open_device, emulator.scheduler.now + 400_000 * 200

    def open_device(bus: EmulatorBackend, device: Any) -> Any:
        if emulator.scheduler.now < until:
            raise usb.core.USBError("Access denied", None, errno.EACCES)
        return genuine(bus, device)

    monkeypatch.setattr(EmulatorBackend, "open_device", open_device)
    assert UsbFinder(emulator.url).find().serial == emulator.serial
    until = emulator.scheduler.now + 400_000 * 5000
    with pytest.raises(DeviceAccessError, match="cannot be opened: permission denied"):
        UsbFinder(emulator.url).find()


def test_another_device_is_no_answer() -> None:
    with Emulator(serial="A") as gone:
        bus = UsbFinder("emulator:A")
        seen = bus.find()
        with Emulator(serial="B"):
            bus = UsbFinder("emulator:B")
            gone.usb.unplug()
            with pytest.raises(DeviceLostError):
                bus.find_again(seen, ANY_MODE, 0.2)


@pytest.mark.parametrize("url", ["serial:///dev/ttyACM0", "nothing:", "plain"])
def test_firmware_goes_over_usb(url: str) -> None:
    with pytest.raises(DeviceNotFoundError, match=r"no device on a USB bus.*name it as usb: or usb:SERIAL"):
        UsbFinder(url)
