"""Devices on a USB bus: which are there, in which mode, and what pyusb's errors mean.

A bus is an entry point in the group ``phasewire.usb_backends``: a function ``(url) -> pyusb backend``. A backend whose
devices do not live by the wall clock has a method ``time_of(address) -> Timekeeper``. Nothing here asks a device for
more than its descriptors.
"""

from __future__ import annotations

import errno
import re
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Literal

import usb.core
import usb.util

from ..errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStalledError,
    DeviceTimeoutError,
)
from ..protocol.enumeration import ARRAY_CLASS, ARRAY_INTERFACE, DFU_FUNCTIONAL, DFU_MODE_CLASS, PRODUCT_ID, VENDOR_ID
from ..protocol.versions import Version
from .transport import Timekeeper, load_by_scheme

__all__ = [
    "ANY_MODE",
    "DFU_MODE",
    "REQUEST_MS",
    "RUN_TIME",
    "Mode",
    "Sighting",
    "UsbBus",
    "configure",
    "opened",
    "translated",
]

BACKENDS = "phasewire.usb_backends"
REQUEST_MS = 1000
LOOK_SECONDS = 0.05
"""How often a device that has left the bus is looked for."""
RIGHTS_SECONDS = 0.5
"""Passes at most, after a device has come, until udev has said who may use it."""

Mode = Literal["run time", "DFU"]
RUN_TIME: Mode = "run time"
DFU_MODE: Mode = "DFU"
ANY_MODE = (RUN_TIME, DFU_MODE)

_NUMBERS = re.compile(r"([0-9a-fA-F]{4}):([0-9a-fA-F]{4})")


@contextmanager
def translated(doing: str) -> Iterator[None]:
    """Turn pyusb's errors into ours, by their errno."""
    try:
        yield
    except usb.core.USBError as error:
        if isinstance(error, usb.core.USBTimeoutError) or error.errno == errno.ETIMEDOUT:
            raise DeviceTimeoutError(
                f"{doing}: no answer in time; if this happens again, unplug the device and plug it in"
            ) from error
        if error.errno in (errno.ENODEV, errno.EIO, errno.ESHUTDOWN, errno.ENOENT):
            raise DeviceLostError(f"{doing}: the device is gone; plug it in again") from error
        if error.errno in (errno.EACCES, errno.EPERM):
            raise DeviceAccessError(f"{doing}: permission denied; `phasewire doctor` says how to get it") from error
        if error.errno == errno.EBUSY:
            raise DeviceAccessError(f"{doing}: another program is using the device; close that first") from error
        if error.errno == errno.EPIPE:
            raise DeviceStalledError(
                f"{doing}: the device answers STALL: it does not know this request, or not now, or its endpoint is "
                "halted; `phasewire info` says what it is doing"
            ) from error
        raise DeviceError(f"{doing}: {error}") from error


def configure(device: usb.core.Device) -> None:
    """Have a device configured, which a kernel does as soon as it comes; one that is configured is not disturbed."""
    try:
        device.get_active_configuration()
    except usb.core.USBError as error:
        if error.errno is not None:
            raise
        device.set_configuration()  # pyusb's own word that there is no configuration


@dataclass(frozen=True)
class Sighting:
    """A device on the bus, from one time that it comes until it leaves.

    Parameters
    ----------
    device : usb.core.Device
        What pyusb calls so.
    vendor, product_id : int
        Its numbers in run-time mode (clause USB-001).
    mode : {"run time", "DFU"}
        Whether it plays, or waits for new firmware.
    product : str
        Its name, empty where it cannot be read.
    serial : str or None
        Its serial number, None where it cannot be read.
    time : Timekeeper
        The time by which it lives.
    """

    device: usb.core.Device
    vendor: int
    product_id: int
    mode: Mode
    product: str
    serial: str | None
    time: Timekeeper

    @property
    def name(self) -> str:
        """Product and serial number."""
        return f"{self.product} {self.serial}"

    @property
    def firmware(self) -> Version:
        """Of the firmware that runs, in DFU mode of that which ran (clauses FWU-004 and USB-008)."""
        return Version.from_bcd(self.device.bcdDevice)


@contextmanager
def opened(seen: Sighting, doing: str) -> Iterator[usb.core.Device]:
    """Open a device for a moment: configured, and with pyusb's errors translated."""
    try:
        with translated(doing):
            configure(seen.device)
            yield seen.device
    finally:
        usb.util.dispose_resources(seen.device)


class UsbBus:
    """A bus, and the device on it that a URL names.

    Parameters
    ----------
    url : str
        ``scheme:`` for the only device, ``scheme:SERIAL``, or ``scheme:VVVV:PPPP`` for the only one whose vendor and
        product have these hexadecimal numbers in run-time mode.

    Raises
    ------
    DeviceNotFoundError
        Where no bus has this scheme, or it does not know the URL's options.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._scheme, _, rest = url.partition(":")
        wanted = rest.partition("?")[0]
        numbers = _NUMBERS.fullmatch(wanted)
        self._vendor, self._product_id = (int(n, 16) for n in numbers.groups()) if numbers else (VENDOR_ID, PRODUCT_ID)
        self._serial = "" if numbers else wanted
        try:
            open_backend = load_by_scheme(BACKENDS, url)
        except DeviceNotFoundError as error:
            raise DeviceNotFoundError(
                f"{url!r} is no device on a USB bus, and firmware goes over USB only; name it as usb: or usb:SERIAL"
            ) from error
        self._backend = open_backend(url)

    def look(self) -> list[Sighting]:
        """Every device of ours that is there, in either mode; none of them is left open."""
        with translated(f"looking for {self._url!r}"):
            there = usb.core.find(find_all=True, backend=self._backend, idVendor=self._vendor)
            modes = [(device, self._mode(device)) for device in there]
        return [self._sighting(device, mode) for device, mode in modes if mode is not None]

    def _mode(self, device: usb.core.Device) -> Mode | None:
        """The mode of a device of ours, by its interface: others may bear the same test numbers."""
        if device.idProduct == self._product_id and _interface(device, ARRAY_CLASS) is not None:
            return RUN_TIME
        if device.idProduct == self._product_id + 1:  # clause USB-013
            interface = _interface(device, DFU_MODE_CLASS)
            if interface is not None and bytes(interface.extra_descriptors) == DFU_FUNCTIONAL.encode():
                return DFU_MODE
        return None

    def _sighting(self, device: usb.core.Device, mode: Mode) -> Sighting:
        clock: Timekeeper = self._backend.time_of(device.address) if hasattr(self._backend, "time_of") else time
        try:
            product, serial = str(device.product or ""), str(device.serial_number or "")
        except (ValueError, usb.core.USBError):  # pyusb's ValueError "no langid": the strings could not be read at all
            product, serial = "", None
        usb.util.dispose_resources(device)
        return Sighting(device, self._vendor, self._product_id, mode, product, serial, clock)

    def find(self) -> Sighting:
        """The device that the URL names, in whichever mode it is.

        Raises
        ------
        DeviceNotFoundError
            Where there is none, or several and no serial number to choose by.
        DeviceAccessError
            Where there is one that may not be opened.
        """
        there = self.look()
        if unreadable := [each for each in there if each.serial is None]:
            unreadable[0].time.sleep(RIGHTS_SECONDS)
            there = self.look()
        matching = [each for each in there if self._serial in ("", each.serial)]
        if len(matching) > 1:
            choices = " or ".join(self.url_of(each) for each in matching if each.serial)
            raise DeviceNotFoundError(f"{self._url!r} could be any of {len(matching)} devices; name one: {choices}")
        if matching and matching[0].serial is not None:
            return matching[0]
        if any(each.serial is None for each in there):
            raise DeviceAccessError(
                f"{self._url!r}: a device is there but may not be opened; `phasewire doctor` says how to get access"
            )
        serials = ", ".join(repr(each.serial) for each in there)
        raise DeviceNotFoundError(
            f"no device at {self._url!r}: {f'there are {serials}' if serials else 'nothing is plugged in'}"
        )

    def find_again(self, known: Sighting, modes: Collection[Mode], seconds: float) -> Sighting:
        """Wait until a device is there in one of these modes, and may be opened.

        Raises
        ------
        DeviceLostError
            Where it does not come in time.
        DeviceAccessError
            Where something came that may not be opened.
        """
        end = known.time.monotonic() + seconds
        while True:
            there: list[Sighting] = []
            with suppress(DeviceLostError, DeviceStalledError):  # it may leave while it is looked at
                there = self.look()
            for each in there:
                if each.serial == known.serial and each.mode in modes:
                    return each
            if known.time.monotonic() >= end:
                break
            known.time.sleep(LOOK_SECONDS)
        if any(each.serial is None for each in there):
            raise DeviceAccessError(
                f"{known.name} may have come back, but may not be opened: the udev rule must name both modes; "
                "`phasewire doctor` says how to get access"
            )
        raise DeviceLostError(
            f"{known.name} has not come back in {' or '.join(modes)} mode within {seconds:g} s; switch it off and on, "
            "and look at its cable"
        )

    def url_of(self, seen: Sighting) -> str:
        """The URL that names a device."""
        return f"{self._scheme}:{seen.serial}"


def _interface(device: usb.core.Device, wanted: tuple[int, int, int]) -> Any:
    """Interface 0 of a device, which is the array or DFU mode, where its class is the wanted one; else None."""
    kind, subclass, protocol = wanted
    return usb.util.find_descriptor(
        device[0],
        bInterfaceNumber=ARRAY_INTERFACE,
        bInterfaceClass=kind,
        bInterfaceSubClass=subclass,
        bInterfaceProtocol=protocol,
    )
