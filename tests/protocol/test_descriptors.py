from __future__ import annotations

import usb.core
import usb.util
from phasewire.emulator import Emulator
from phasewire.emulator.backend import EmulatorBackend
from phasewire.protocol.descriptors import configuration_descriptor, device_descriptor, string_descriptor


def test_pyusb_reads_the_descriptors() -> None:
    """Enumeration as any pyusb program would do it, in the words of USB 2.0, chapter 9."""
    device = usb.core.find(backend=EmulatorBackend([Emulator(serial="S-1")]), idVendor=0x1209, idProduct=0x0001)
    assert (device.manufacturer, device.serial_number) == ("phasewire", "S-1")
    assert device.bcdUSB == 0x0200
    assert device.speed == usb.util.SPEED_HIGH
    (configuration,) = device.configurations()
    assert configuration.bmAttributes == 0xC0  # self-powered
    (interface,) = configuration.interfaces()
    assert interface.bInterfaceClass == 0xFF
    endpoints = {endpoint.bEndpointAddress: endpoint for endpoint in interface}
    assert set(endpoints) == {0x01, 0x81}
    for endpoint in endpoints.values():
        assert usb.util.endpoint_type(endpoint.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK
        assert endpoint.wMaxPacketSize == 512


def test_lengths_are_what_the_descriptors_say() -> None:
    device = device_descriptor((1, 2, 3))
    assert device[0] == len(device) == 18
    assert device[12:14] == bytes([0x23, 0x01])
    configuration = configuration_descriptor()
    assert int.from_bytes(configuration[2:4], "little") == len(configuration)
    lengths, at = [], 0
    while at < len(configuration):
        lengths.append(configuration[at])
        at += configuration[at]
    assert lengths == [9, 9, 7, 7]


def test_strings_are_utf_16() -> None:
    assert string_descriptor(None) == bytes([4, 3, 0x09, 0x04])
    assert string_descriptor("aµ") == bytes([6, 3, ord("a"), 0, 0xB5, 0])
