from __future__ import annotations

from importlib.metadata import entry_points

import pytest
from phasewire import Emulator, open_device
from phasewire.base.errors import DeviceNotFoundError
from phasewire.host.transports.opening import default_url


@pytest.mark.parametrize("url", ["nonsense:", "nonsense", "", ":", "emulator", "http://127.0.0.1/"])
def test_an_unknown_url_names_the_known_ones(url: str) -> None:
    with pytest.raises(
        DeviceNotFoundError,
        match="the URL of a device begins with one of emulator:, rfc2217:, serial:, socket:, usb:, usbip:",
    ):
        open_device(url)


def test_the_variable_names_the_default_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PHASEWIRE_DEVICE", raising=False)
    assert default_url() == "emulator:"
    monkeypatch.setenv("PHASEWIRE_DEVICE", "emulator:NAMED")
    assert default_url() == "emulator:NAMED"
    with Emulator(serial="NAMED"), open_device() as device:
        assert device.name.endswith("NAMED")


def test_transports_and_buses_are_found_by_entry_point() -> None:
    ports = {"serial", "socket", "rfc2217"}
    for group, schemes in (
        ("phasewire.transports", {"usb", "usbip", "emulator"} | ports),
        ("phasewire.usb_backends", {"usb", "usbip", "emulator"}),
        ("phasewire.serial_ports", {"emulator"} | ports),
    ):
        assert {entry.name for entry in entry_points(group=group)} >= schemes
