from __future__ import annotations

import pytest
from phasewire import Emulator
from phasewire.emulator.doors.sysfs import device_files
from phasewire.emulator.doors.usbfs import KernelDevice


@pytest.fixture
def device() -> KernelDevice:
    machine = Emulator(serial="S-1")
    return KernelDevice(machine.usb, machine.scheduler, address=11)


def test_files_of_a_device_read_as_the_kernel_writes_them(device: KernelDevice) -> None:
    """Compare with any device on a Linux machine: ``grep . /sys/bus/usb/devices/1-1/*``."""
    files = device_files(device, port=3)
    assert files.pop("descriptors") == device.descriptor.encode() + device.configuration
    assert files.pop("uevent").decode().splitlines() == [
        "MAJOR=189",
        "MINOR=10",
        "DEVNAME=bus/usb/001/011",
        "DEVTYPE=usb_device",
        "PRODUCT=1209/1/10",
        "TYPE=239/2/1",
        "BUSNUM=001",
        "DEVNUM=011",
    ]
    assert {name: content.decode() for name, content in files.items()} == {
        "dev": "189:10\n",
        "busnum": "1\n",
        "devnum": "11\n",
        "devpath": "3\n",
        "speed": "480\n",
        "version": " 2.01\n",
        "idVendor": "1209\n",
        "idProduct": "0001\n",
        "bcdDevice": "0010\n",
        "bDeviceClass": "ef\n",
        "bDeviceSubClass": "02\n",
        "bDeviceProtocol": "01\n",
        "bMaxPacketSize0": "64\n",
        "bNumConfigurations": "1\n",
        "bConfigurationValue": "1\n",
        "bNumInterfaces": " 4\n",
        "bmAttributes": "c0\n",
        "bMaxPower": "100mA\n",
        "maxchild": "0\n",
        "manufacturer": "phasewire\n",
        "product": "phasewire five-board array (emulated)\n",
        "serial": "S-1\n",
    }
