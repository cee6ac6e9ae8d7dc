"""The devices of a USB/IP server as a bus, without a kernel's help: a pyusb backend, which needs no rights.

===================================  ===============================================================
``usbip:``                           the only phasewire array of the server at 127.0.0.1:3240
``usbip:HOST:PORT``                  the only one of another; an IPv6 address in brackets
``usbip:HOST:PORT/1-1``              the device with this bus id
``usbip:HOST:PORT/SERIAL``           that with this serial number, or all else that may follow ``usb:``
===================================  ===============================================================

It behaves like libusb on Linux: errors have libusb's numbers, an interface is claimed by one handle at a time, and a
device that left the bus and came back is another one. A device that is found is attached to this process, as a kernel
does it, and to no other client, until its bus is closed or forgotten. The server's list tells only classes: devices
without an interface of ours are never attached. A reset is what Linux sends after one, from which a server infers it
(`usbip_session`); a server that does not leaves the device as it is. All requests to the device are let through.
"""

from __future__ import annotations

import errno
import os
import re
from array import array
from collections.abc import Iterator
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import RLock
from types import SimpleNamespace
from typing import Any
from weakref import WeakValueDictionary

from usb.core import USBError

from ...base.errors import DeviceNotFoundError, DeviceUrlError, ReplyError
from ...base.libusb import COMMAND_MS, SET_CONFIGURATION, Bus, BusHandle
from ...protocol.codes import DescriptorType, StandardRequest
from ...protocol.descriptors import DeviceDescriptor
from ...protocol.enumeration import ARRAY_CLASS, DFU_MODE_CLASS
from ...protocol.parsed_configuration import ParsedConfiguration, parsed
from ...protocol.requests import DIRECTION_IN, Setup
from ...protocol.usbip import PORT, Offer
from .flight import READ_BYTES, Flight, FlightTransfer
from .transport import Found
from .usb import UsbTransport, open_usb
from .usbip_link import Urb, UsbIpLink, offers, take

__all__ = ["USBIP", "UsbIpBackend", "open_backend"]

HOST = "127.0.0.1"
LIBUSB_SPEEDS = {5: 4, 6: 5}
"""Of Linux's numbers; the others are equal."""
HEAD_BYTES = 9  # of a configuration
_URL = re.compile(
    r"usbip:(?://)?(?P<host>\[[^\[\]]+\]|[^\[\]:/?]*)(?::(?P<port>\d{1,5}))?(?:/(?P<name>[^?]*))?", re.ASCII
)
_BUS_ID = re.compile(r"\d+-\d+(?:\.\d+)*", re.ASCII)


def open_backend(url: str) -> UsbIpBackend:
    """The bus for a ``usbip:`` URL; raises `DeviceUrlError` if that is wrong."""
    match = _URL.fullmatch(url)
    port = int((match and match["port"]) or PORT)
    if match is None or not 0 < port < 1 << 16:
        raise DeviceUrlError(
            f"{url!r}: write usbip:HOST:PORT or usbip:HOST:PORT/BUSID, such as usbip:{HOST}:{PORT}/1-1"
        )
    return UsbIpBackend(match["host"].strip("[]") or HOST, port, match["name"] or "")


class UsbIpDevice:
    """A device from its arrival on the bus until it leaves; pyusb calls this a device.

    Parameters
    ----------
    link : UsbIpLink
        The connection to it.
    offer : Offer
        The server's description of it.

    Raises
    ------
    USBError
        If the device does not describe itself.
    ReplyError
        If it describes itself wrongly.
    """

    def __init__(self, link: UsbIpLink, offer: Offer) -> None:
        self.link, self.offer = link, offer
        self.handles = 0
        self.claims: dict[int, int] = {}
        self.replaced = False
        self.seen = self.look()
        descriptor, configurations = self.seen
        self.descriptor = DeviceDescriptor.decode(descriptor)
        self.configurations = [ParsedConfiguration(each) for each in configurations]
        if not self.configurations:
            raise ReplyError("it has no configuration")
        self.configuration = int.from_bytes(self.query(DIRECTION_IN, StandardRequest.GET_CONFIGURATION, 0, 0, 1))

    @property
    def there(self) -> bool:
        """Whether the device is still on the bus."""
        return not (self.replaced or self.link.over.is_set())

    def look(self) -> tuple[bytes, list[bytes]]:
        """Read the descriptors as Linux does after a reset of the port, which a server infers from it."""
        self._descriptor(DescriptorType.DEVICE, 0, 64)
        device = self._descriptor(DescriptorType.DEVICE, 0, 18)
        configurations = []
        for index in range(device[-1] if device else 0):
            head = self._descriptor(DescriptorType.CONFIGURATION, index, HEAD_BYTES)
            total = int.from_bytes(head[2:4], "little")
            configurations.append(self._descriptor(DescriptorType.CONFIGURATION, index, total))
        return device, configurations

    def _descriptor(self, kind: int, index: int, size: int) -> bytes:
        return self.query(DIRECTION_IN, StandardRequest.GET_DESCRIPTOR, kind << 8 | index, 0, size)

    def query(self, kind: int, request: int, value: int, index: int, size: int = 0) -> bytes:
        """Make a control request of the bus itself; returns the answer."""
        return self.control(Setup(kind, request, value, index, size), b"", COMMAND_MS).received

    def control(self, setup: Setup, data: bytes, timeout_ms: int) -> Urb:
        """Carry out a control transfer; raises `USBError` if it fails or takes too long."""
        is_in = setup.is_in and setup.length
        urb = Urb(self.link, DIRECTION_IN if is_in else 0, setup.length if is_in else data, setup)
        self.link.carry(urb, timeout_ms / 1000 or None)
        urb.check()
        if (setup.request_type, setup.request) == SET_CONFIGURATION:
            self.configuration = setup.value
        return urb


class UsbIpHandle(BusHandle[UsbIpDevice]):
    """An opened device, as held by one program."""

    def __init__(self, device: UsbIpDevice) -> None:
        super().__init__(device)
        device.handles += 1

    def close(self) -> None:
        """Release all interfaces."""
        self.device.handles -= 1
        super().close()

    def transfer(self, interface: int, endpoint: int, data: bytes | int, timeout_ms: int) -> Urb:
        """Carry out a bulk or interrupt transfer, at least a part of it; raises `USBError` as libusb does."""
        self.claim(interface)
        urb = Urb(self.device.link, endpoint, data)
        self.device.link.carry(urb, timeout_ms / 1000 or None)
        if not (urb.timed_out and urb.actual):  # as pyusb does over libusb
            urb.check()
        return urb


_attached = WeakValueDictionary[tuple[str, int, str], UsbIpDevice]()
"""All that this process has attached, by host, port and bus id: the state of a kernel."""
_attaching = RLock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_attached.clear)  # its connections belong to the process that made them


class UsbIpBackend(Bus[UsbIpHandle]):
    """The bus of a server. What pyusb calls a device is a `UsbIpDevice`.

    Parameters
    ----------
    host : str
        The server.
    port : int
        Its TCP port.
    name : str
        A bus id, for that device alone, or else what `usb_find.UsbFinder` reads. A bus becomes that of one device as
        soon as that is claimed, and drops the others that it found.

    Attributes
    ----------
    prefix, wanted : str
        The parts of the URL before and after the last slash; the second is empty for a bus id.
    trouble : str
        Why a device could not be had when the bus was last looked at; empty if all could.
    """

    def __init__(self, host: str, port: int, name: str = "") -> None:
        super().__init__()
        self._host, self._port = host, port
        self._bus_id = name if _BUS_ID.fullmatch(name) else None
        self.prefix = f"usbip:{f'[{host}]' if ':' in host else host}:{port}/"
        self.wanted = "" if self._bus_id else name
        self.trouble = ""
        self._held: dict[str, UsbIpDevice] = {}

    def enumerate_devices(self) -> Iterator[UsbIpDevice]:
        """Every device of the server with an interface of ours, attached to this process."""
        self.trouble = ""
        if self._bus_id is None or not self._there(self._bus_id):
            self._attach_all()
        self._held = {bus_id: device for bus_id, device in self._held.items() if device.there}
        yield from self._held.values()

    def _there(self, bus_id: str) -> bool:
        """Whether a device is attached to this process."""
        device = _attached.get((self._host, self._port, bus_id))
        if device is None or not device.there:
            return False
        self._held[bus_id] = device
        return True

    def _attach_all(self) -> None:
        try:
            offered = offers(self._host, self._port)
        except DeviceNotFoundError as error:
            self.trouble = str(error)
            return
        ours = [each for each in offered if {ARRAY_CLASS, DFU_MODE_CLASS} & {*each.interfaces}]
        wanted = [each.bus_id for each in ours if self._bus_id in (None, each.bus_id)]
        if not wanted:
            there = ", ".join(f"{each.bus_id} ({each.vendor:04x}:{each.product:04x})" for each in offered)
            what = f"phasewire array {self._bus_id}" if self._bus_id else "phasewire array"
            self.trouble = f"{self._host}:{self._port} offers no {what}: there is {there or 'nothing'}"
        for bus_id in wanted:
            with _attaching:
                if not self._there(bus_id):
                    self._attach(bus_id)

    def _attach(self, bus_id: str) -> None:
        try:
            line, offer = take(self._host, self._port, bus_id)
            link = UsbIpLink(line, offer.device_id)
            try:
                self._add(UsbIpDevice(link, offer))
            except BaseException:
                link.close()
                raise
        except DeviceNotFoundError as error:
            self.trouble = str(error)
        except (USBError, ReplyError) as error:
            self.trouble = f"device {bus_id} at {self._host}:{self._port} cannot be enumerated: {error}"

    def _add(self, device: UsbIpDevice) -> None:
        bus_id = device.offer.bus_id
        _attached[self._host, self._port, bus_id] = self._held[bus_id] = device

    def close(self) -> None:
        """Leave the devices that no handle of this process has open; the next look attaches them again."""
        for device in self._held.values():
            if not device.handles:
                device.link.close()
        self._held.clear()

    def get_device_descriptor(self, dev: UsbIpDevice) -> SimpleNamespace:
        """The device descriptor, with its place on the bus."""
        offer = dev.offer
        ports = tuple(map(int, re.findall(r"\d+", offer.bus_id.partition("-")[2]))) or (offer.number,)
        place = {"bus": offer.bus, "address": offer.number, "port_number": ports[-1], "port_numbers": ports}
        speed = LIBUSB_SPEEDS.get(offer.speed, offer.speed)
        return SimpleNamespace(**vars(parsed(dev.descriptor)), **place, speed=speed)

    def open_device(self, dev: UsbIpDevice) -> UsbIpHandle:
        """A new handle."""
        return UsbIpHandle(dev)

    def claim_interface(self, dev_handle: UsbIpHandle, intf: int) -> None:
        """Claim the interface for this handle alone; the bus becomes that of its device."""
        super().claim_interface(dev_handle, intf)
        self._bus_id = dev_handle.device.offer.bus_id
        self._held = {self._bus_id: dev_handle.device}

    def bulk_write(self, dev_handle: UsbIpHandle, ep: int, intf: int, data: Any, timeout: int) -> int:
        """Send data, or an empty packet; returns the number of bytes that the device took in time."""
        return dev_handle.transfer(intf, ep, bytes(data), timeout).actual

    def bulk_read(self, dev_handle: UsbIpHandle, ep: int, intf: int, buff: Any, timeout: int) -> int:
        """Receive until the buffer is full or a packet is short; returns the number of bytes received."""
        return _fill(buff, dev_handle.transfer(intf, ep, len(buff) * buff.itemsize, timeout).received)

    intr_write, intr_read = bulk_write, bulk_read  # a server knows the kind of an endpoint

    def ctrl_transfer(
        self,
        dev_handle: UsbIpHandle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        timeout: int,
    ) -> int:
        """Carry out a control transfer; returns the number of bytes transferred."""
        dev_handle.check_there()
        setup = Setup(bmRequestType, bRequest, wValue, wIndex, len(data))
        urb = dev_handle.device.control(setup, b"" if setup.is_in else bytes(data), timeout)
        return _fill(data, urb.received) if setup.is_in else urb.actual

    def reset_device(self, dev_handle: UsbIpHandle) -> None:
        """Reset the port and configure the device as it was.

        Raises
        ------
        USBError
            Not found, if the device came back as another one: it must be found again.
        """
        dev_handle.check_there()
        device = dev_handle.device
        device.link.cancel_all()
        try:
            before, device.configuration = device.configuration, 0
            if device.look() == device.seen:
                if before:
                    self.command(dev_handle, SET_CONFIGURATION, before, 0)
                return
            device.replaced = True
            with _attaching, suppress(ReplyError):
                self._add(UsbIpDevice(device.link, device.offer))
        except USBError as error:
            if error.errno != errno.ENODEV:
                raise
        raise USBError("Entity not found", None, errno.ENOENT)

    def open_flight(self, handle: UsbIpHandle) -> UsbIpFlight:
        """The way for several bulk transfers at a time."""
        return UsbIpFlight(handle)


class UsbIpFlight(Flight):
    """The bulk transfers of one device, by USB/IP.

    Parameters
    ----------
    handle : UsbIpHandle
        The handle of the device, with its interface claimed.
    """

    def __init__(self, handle: UsbIpHandle) -> None:
        super().__init__()
        self._handle, self._ends = handle, SimpleQueue[None]()

    def _make(self, endpoint: int, data: bytes | None) -> FlightTransfer:
        return Urb(self._handle.device.link, endpoint, READ_BYTES if data is None else data, ends=self._ends)

    def _wait(self, seconds: float) -> None:
        with suppress(Empty):
            self._ends.get(timeout=max(seconds, 0))


class UsbIpScheme:
    """The devices of USB/IP servers."""

    def open(self, url: str) -> UsbTransport:
        """Open the device that a URL names."""
        return open_usb(url)

    def find(self) -> list[Found]:
        """None: a server is not looked for, because a device that is looked at is attached."""
        return []


USBIP = UsbIpScheme()


def _fill(buffer: Any, received: bytes) -> int:
    buffer[: len(received)] = array("B", received)
    return len(received)
