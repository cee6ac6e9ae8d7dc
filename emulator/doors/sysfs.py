"""Linux's description of a USB device in sysfs and in uevents: names, files and contents, as text. It does no I/O.

Names and formats are those of the kernel's drivers/usb/core/sysfs.c. It contains what programs look for, without power
management, drivers or a host controller's counters.
"""

from __future__ import annotations

from collections.abc import Mapping

from ...protocol.descriptors import Interface
from ...protocol.enumeration import FULL_SPEED
from .usbfs import KernelDevice

__all__ = ["device_files", "device_properties", "interface_files", "interface_properties", "node_name"]

BUS = 1
USB_DEVICE_MAJOR = 189
ADDRESSES_PER_BUS = 128
MAX_POWER_UNIT_MA = 2


def node_name(device: KernelDevice) -> str:
    """The name of its node, below /dev."""
    return f"bus/usb/{BUS:03}/{device.address:03}"


def device_properties(device: KernelDevice) -> dict[str, str]:
    """The contents of a device's uevent."""
    descriptor = device.descriptor
    kind = (descriptor.bDeviceClass, descriptor.bDeviceSubClass, descriptor.bDeviceProtocol)
    return {
        "MAJOR": str(USB_DEVICE_MAJOR),
        "MINOR": str(_minor(device)),
        "DEVNAME": node_name(device),
        "DEVTYPE": "usb_device",
        "PRODUCT": _product(device),
        "TYPE": _numbers(*kind),
        "BUSNUM": f"{BUS:03}",
        "DEVNUM": f"{device.address:03}",
    }


def interface_properties(device: KernelDevice, interface: Interface) -> dict[str, str]:
    """The contents of an interface's uevent."""
    properties = device_properties(device)
    kind = (interface.bInterfaceClass, interface.bInterfaceSubClass, interface.bInterfaceProtocol)
    return {
        "DEVTYPE": "usb_interface",
        "PRODUCT": properties["PRODUCT"],
        "TYPE": properties["TYPE"],
        "INTERFACE": _numbers(*kind),
        "MODALIAS": _modalias(device, interface),
    }


def device_files(device: KernelDevice, port: int) -> dict[str, bytes]:
    """The files of a device's directory and their contents."""
    descriptor, head = device.descriptor, device.head
    named = {
        "manufacturer": descriptor.iManufacturer,
        "product": descriptor.iProduct,
        "serial": descriptor.iSerialNumber,
    }
    texts = {
        "uevent": _lines(device_properties(device)),
        "dev": f"{USB_DEVICE_MAJOR}:{_minor(device)}",
        "busnum": f"{BUS}",
        "devnum": f"{device.address}",
        "devpath": f"{port}",
        "speed": "12" if device.speed == FULL_SPEED else "480",
        "version": f"{descriptor.bcdUSB >> 8:2x}.{descriptor.bcdUSB & 0xFF:02x}",
        "idVendor": f"{descriptor.idVendor:04x}",
        "idProduct": f"{descriptor.idProduct:04x}",
        "bcdDevice": f"{descriptor.bcdDevice:04x}",
        "bDeviceClass": f"{descriptor.bDeviceClass:02x}",
        "bDeviceSubClass": f"{descriptor.bDeviceSubClass:02x}",
        "bDeviceProtocol": f"{descriptor.bDeviceProtocol:02x}",
        "bMaxPacketSize0": f"{descriptor.bMaxPacketSize0}",
        "bNumConfigurations": f"{descriptor.bNumConfigurations}",
        "bConfigurationValue": f"{device.chosen}" if device.chosen else "",
        "bNumInterfaces": f"{head.bNumInterfaces:2}",
        "bmAttributes": f"{head.bmAttributes:02x}",
        "bMaxPower": f"{head.bMaxPower * MAX_POWER_UNIT_MA}mA",
        "maxchild": "0",
    }
    texts |= {name: device.strings[index] for name, index in named.items() if index}
    return {"descriptors": descriptor.encode() + device.configuration} | _encoded(texts)


def interface_files(device: KernelDevice, interface: Interface) -> dict[str, bytes]:
    """The files of an interface's directory and their contents."""
    texts = {
        "uevent": _lines(interface_properties(device, interface)),
        "modalias": _modalias(device, interface),
        "bInterfaceNumber": f"{interface.bInterfaceNumber:02x}",
        "bAlternateSetting": f"{interface.bAlternateSetting:2}",
        "bNumEndpoints": f"{interface.bNumEndpoints:02x}",
        "bInterfaceClass": f"{interface.bInterfaceClass:02x}",
        "bInterfaceSubClass": f"{interface.bInterfaceSubClass:02x}",
        "bInterfaceProtocol": f"{interface.bInterfaceProtocol:02x}",
    }
    if interface.iInterface:
        texts["interface"] = device.strings[interface.iInterface]
    return _encoded(texts)


def _minor(device: KernelDevice) -> int:
    return (BUS - 1) * ADDRESSES_PER_BUS + device.address - 1


def _product(device: KernelDevice) -> str:
    descriptor = device.descriptor
    return f"{descriptor.idVendor:x}/{descriptor.idProduct:x}/{descriptor.bcdDevice:x}"


def _modalias(device: KernelDevice, interface: Interface) -> str:
    """The string by which drivers are found."""
    descriptor = device.descriptor
    return (
        f"usb:v{descriptor.idVendor:04X}p{descriptor.idProduct:04X}d{descriptor.bcdDevice:04X}"
        f"dc{descriptor.bDeviceClass:02X}dsc{descriptor.bDeviceSubClass:02X}dp{descriptor.bDeviceProtocol:02X}"
        f"ic{interface.bInterfaceClass:02X}isc{interface.bInterfaceSubClass:02X}ip{interface.bInterfaceProtocol:02X}"
        f"in{interface.bInterfaceNumber:02X}"
    )


def _numbers(*numbers: int) -> str:
    return "/".join(map(str, numbers))


def _lines(properties: Mapping[str, str]) -> str:
    return "\n".join(f"{name}={value}" for name, value in properties.items())


def _encoded(texts: Mapping[str, str]) -> dict[str, bytes]:
    return {name: f"{text}\n".encode() for name, text in texts.items()}
