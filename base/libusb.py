"""What libusb on Linux does for a device of any bus, for pyusb's backends whose bus is not the computer's own.

A handle claims interfaces, each of which one handle holds at a time; an unclaimed one is claimed by its first use. A
device that left the bus and came back is another one, and all handles of the former fail. Errors have libusb's numbers.
How a transfer reaches a device is the backend's.
"""

from __future__ import annotations

import errno
from collections.abc import Sequence
from itertools import count
from types import SimpleNamespace
from typing import Any, Generic, Protocol, TypeVar

import usb.backend
import usb.legacy
from usb.core import USBError

__all__ = ["COMMAND_MS", "SET_CONFIGURATION", "Bus", "BusConfiguration", "BusDevice", "BusHandle"]

COMMAND_MS = 5000
"""For requests of the bus itself, as Linux has it."""
SET_CONFIGURATION = (0x00, usb.legacy.REQ_SET_CONFIGURATION)
_SET_INTERFACE = (0x01, usb.legacy.REQ_SET_INTERFACE)
_CLEAR_FEATURE = (0x02, usb.legacy.REQ_CLEAR_FEATURE)
_ENDPOINT_HALT = 0


class BusConfiguration(Protocol):
    """A configuration in pyusb's form: objects whose fields have the names of the USB standard."""

    @property
    def head(self) -> SimpleNamespace:
        """The configuration itself."""

    def settings(self, interface: int) -> list[SimpleNamespace]:
        """The settings of an interface."""

    def endpoint(self, interface: int, setting: int, index: int) -> SimpleNamespace:
        """An endpoint of an interface's setting; raises `IndexError` if there is none."""


class BusDevice(Protocol):
    """A device from its arrival on the bus until it leaves; pyusb calls this a device."""

    @property
    def there(self) -> bool:
        """Whether it is still on the bus."""

    @property
    def configuration(self) -> int:
        """The selected configuration, 0 for none."""

    @property
    def configurations(self) -> Sequence[BusConfiguration]:
        """All that it has, at least one."""

    @property
    def claims(self) -> dict[int, int]:
        """For each claimed interface, the number of the handle."""


Device = TypeVar("Device", bound=BusDevice)


class BusHandle(Generic[Device]):
    """An opened device, as held by one program; raises `USBError` (no such device) if it has left the bus."""

    _numbers = count(1)

    def __init__(self, device: Device) -> None:
        self.device = device
        self.number = next(self._numbers)
        self.check_there()

    def check_there(self) -> None:
        """Raise `USBError` (no such device) if the device has left the bus."""
        if not self.device.there:
            raise USBError("No such device (it may have been disconnected)", None, errno.ENODEV)

    def claim(self, interface: int) -> None:
        """Claim an interface; raises `USBError` if another handle holds it (busy), or it does not exist (not found)."""
        self.check_there()
        claims = self.device.claims
        if interface in claims:
            if claims[interface] != self.number:
                raise USBError("Resource busy", None, errno.EBUSY)
        elif not self.device.configuration or not self.device.configurations[0].settings(interface):
            raise USBError("Entity not found", None, errno.ENOENT)
        claims[interface] = self.number

    def release(self, interface: int) -> None:
        """Release an interface; raises `USBError` (not found) if it is not held."""
        self.check_there()
        if self.device.claims.get(interface) != self.number:
            raise USBError("Entity not found", None, errno.ENOENT)
        del self.device.claims[interface]

    def close(self) -> None:
        """Release all interfaces."""
        claims = self.device.claims
        for interface in [interface for interface, holder in claims.items() if holder == self.number]:
            del claims[interface]


Handle = TypeVar("Handle", bound=BusHandle[Any])


class Bus(usb.backend.IBackend, Generic[Handle]):
    """A pyusb backend, without its device descriptors and transfers."""

    def get_configuration_descriptor(self, dev: BusDevice, config: int) -> SimpleNamespace:
        """The configuration descriptor."""
        return dev.configurations[config].head

    def get_interface_descriptor(self, dev: BusDevice, intf: int, alt: int, config: int) -> SimpleNamespace:
        """The descriptor of an interface's setting."""
        return dev.configurations[config].settings(intf)[alt]

    def get_endpoint_descriptor(self, dev: BusDevice, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """The descriptor of an interface's endpoint."""
        return dev.configurations[config].endpoint(intf, alt, ep)

    def close_device(self, dev_handle: Handle) -> None:
        """Release the device, which stays on the bus."""
        dev_handle.close()

    def set_configuration(self, dev_handle: Handle, config_value: int) -> None:
        """Select a configuration, which Linux refuses while any program has claimed an interface."""
        dev_handle.check_there()
        if dev_handle.device.claims:
            raise USBError("Resource busy", None, errno.EBUSY)
        self.command(dev_handle, SET_CONFIGURATION, config_value, 0)

    def get_configuration(self, dev_handle: Handle) -> int:
        """The selected configuration, 0 for none."""
        dev_handle.check_there()
        return int(dev_handle.device.configuration)

    def set_interface_altsetting(self, dev_handle: Handle, intf: int, altsetting: int) -> None:
        """Select a setting of an interface."""
        dev_handle.claim(intf)
        self.command(dev_handle, _SET_INTERFACE, altsetting, intf)

    def claim_interface(self, dev_handle: Handle, intf: int) -> None:
        """Claim the interface for this handle alone."""
        dev_handle.claim(intf)

    def release_interface(self, dev_handle: Handle, intf: int) -> None:
        """Release the interface."""
        dev_handle.release(intf)

    def clear_halt(self, dev_handle: Handle, ep: int) -> None:
        """End the halt of an endpoint."""
        self.command(dev_handle, _CLEAR_FEATURE, _ENDPOINT_HALT, ep)

    def command(self, dev_handle: Handle, request: tuple[int, int], value: int, index: int) -> None:
        """Carry out a standard request without data."""
        self.ctrl_transfer(dev_handle, *request, value, index, b"", COMMAND_MS)
