"""Devices on a USB bus: which are there, in which mode, which one a URL means, and what pyusb's errors mean.

A bus is an entry point in the group ``phasewire.usb_backends``: a function ``(url) -> pyusb backend``. A backend whose
devices do not live by the wall clock has a method ``time_of(address) -> Timekeeper``; one that carries transfers by
itself has ``open_flight(handle)``, which gives something with the methods of `flight.Flight`. One whose URLs name more
than the device has that part as ``prefix`` and the rest as ``wanted``; one that may fail to reach devices says why in
``trouble``, and in ``hint`` what else may be the cause if it has none; one that holds devices gives them back by
``close()``. Nothing here asks a device for more than its descriptors. One of ours is known by the classes of its
interfaces besides vendor and product (clauses USB-005 and USB-013), for these are a test pair that others use too.
"""

from __future__ import annotations

import errno
import re
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import usb.core
import usb.util

from ...base.errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStalledError,
    DeviceTimeoutError,
)
from ...protocol.enumeration import (
    ARRAY_CLASS,
    ARRAY_INTERFACE,
    DFU_FUNCTIONAL,
    DFU_MODE_CLASS,
    LANGUAGE,
    PRODUCT_ID,
    VENDOR_ID,
)
from ...protocol.requests import Setup
from ...protocol.versions import Version
from .opening import load_by_scheme
from .tracing import log_request
from .transport import DeviceMode, Found, Timekeeper

__all__ = [
    "ANY_MODE",
    "BACKENDS",
    "DFU_MODE",
    "INSTALL_RULE",
    "REQUEST_MS",
    "RUN_TIME",
    "DeviceMode",
    "Sighting",
    "UsbFinder",
    "configure",
    "control",
    "find_on",
    "opened",
    "select",
    "translated",
    "translation",
]

BACKENDS = "phasewire.usb_backends"
REQUEST_MS = 1000
LOOK_SECONDS = 0.05
"""How often a device that has left the bus is looked for."""
RIGHTS_SECONDS = 0.5
"""Passes at most, after a device has come, until udev has said who may use it."""

INSTALL_RULE = (
    "phasewire doctor --udev-rule | sudo tee /etc/udev/rules.d/60-phasewire.rules; sudo udevadm control --reload"
)
"""What gives the users of a Linux computer access."""

RUN_TIME: DeviceMode = "run time"
DFU_MODE: DeviceMode = "DFU"
ANY_MODE = (RUN_TIME, DFU_MODE)

_WANTED = re.compile(r"(?:(?P<vendor>[0-9a-fA-F]{4}):(?P<product>[0-9a-fA-F]{4})(?::|$))?(?P<serial>.*)")


def control(device: usb.core.Device, setup: Setup, data: bytes = b"") -> bytes:
    """Make a control transfer, and log it.

    Parameters
    ----------
    device : usb.core.Device
        Opened.
    setup : Setup
        What is asked.
    data : bytes
        What goes out with it.

    Returns
    -------
    bytes
        What came in.
    """
    what = setup.length if setup.is_in else data or None
    try:
        answer = device.ctrl_transfer(setup.request_type, setup.request, setup.value, setup.index, what, REQUEST_MS)
    except usb.core.USBError as error:
        log_request(setup, None, stalled=error.errno == errno.EPIPE)
        raise
    came = bytes(answer) if setup.is_in else b""
    log_request(setup, came if setup.is_in else data)
    return came


def is_timeout(error: usb.core.USBError) -> bool:
    """Whether an error of pyusb says that there was no answer in time."""
    return isinstance(error, usb.core.USBTimeoutError) or error.errno == errno.ETIMEDOUT


def translation(doing: str, error: usb.core.USBError) -> DeviceError:
    """One of our errors for one of pyusb's, by its errno."""
    if is_timeout(error):
        return DeviceTimeoutError(
            f"{doing}: no answer in time; if this happens again, unplug the device and plug it in"
        )
    if error.errno in (errno.ENODEV, errno.EIO, errno.ESHUTDOWN, errno.ENOENT):
        return DeviceLostError(f"{doing}: the device is gone; plug it in again")
    if error.errno in (errno.EACCES, errno.EPERM):
        return DeviceAccessError(f"{doing}: permission denied; `phasewire doctor` says how to get it")
    if error.errno == errno.EBUSY:
        return DeviceAccessError(f"{doing}: another program is using the device; close that first")
    if error.errno == errno.EPIPE:
        return DeviceStalledError(
            f"{doing}: the device answers STALL: it does not know this request, or not now, or its endpoint is "
            "halted; `phasewire info` says what it is doing"
        )
    return DeviceError(f"{doing}: {error}")


@contextmanager
def translated(doing: str) -> Iterator[None]:
    """Turn pyusb's errors into ours."""
    try:
        yield
    except usb.core.USBError as error:
        raise translation(doing, error) from error


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
    found : Found
        What can be told of it.
    time : Timekeeper
        The time by which it lives.
    """

    device: usb.core.Device
    vendor: int
    product_id: int
    found: Found
    time: Timekeeper

    @property
    def mode(self) -> DeviceMode:
        """Whether it plays, or waits for new firmware."""
        return self.found.mode

    @property
    def product(self) -> str:
        """Its name, empty if it cannot be read."""
        return self.found.product

    @property
    def serial(self) -> str | None:
        """Its serial number, None if it cannot be read."""
        return self.found.serial

    @property
    def name(self) -> str:
        """Product and serial number."""
        return f"{self.product} {self.serial}"

    @property
    def firmware(self) -> Version:
        """Of the firmware that runs, in DFU mode of that which ran (clauses FWU-004 and USB-008)."""
        return Version.from_bcd(self.device.bcdDevice)

    @property
    def full_speed(self) -> bool:
        """Whether the bus runs at full speed, which carries fewer blocks (clause USB-010)."""
        return bool(self.device.speed == usb.util.SPEED_FULL)


@contextmanager
def opened(seen: Sighting, doing: str) -> Iterator[usb.core.Device]:
    """Open a device for a moment: configured, and with pyusb's errors translated."""
    try:
        with translated(doing):
            configure(seen.device)
            yield seen.device
    finally:
        usb.util.dispose_resources(seen.device)


class UsbFinder:
    """A bus, and the device on it that a URL names.

    Parameters
    ----------
    url : str
        ``scheme:`` for the only device, ``scheme:SERIAL``, or ``scheme:VVVV:PPPP`` for the only one whose vendor and
        product have these hexadecimal numbers in run-time mode; ``scheme:VVVV:PPPP:SERIAL`` for one of several.

    Raises
    ------
    DeviceNotFoundError
        If no bus has this scheme, or it does not know the URL's options.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        try:
            open_backend = load_by_scheme(BACKENDS, url)
        except DeviceNotFoundError as error:
            raise DeviceNotFoundError(
                f"{url!r} is no device on a USB bus, and firmware goes over USB only; name it as usb: or usb:SERIAL"
            ) from error
        self._backend = open_backend(url)
        scheme, _, rest = url.partition(":")
        self._prefix: str = getattr(self._backend, "prefix", f"{scheme}:")
        match = _WANTED.fullmatch(getattr(self._backend, "wanted", rest.partition("?")[0]))
        assert match is not None  # for anything is a serial number
        vendor, product, self._serial = match.group("vendor", "product", "serial")
        self._vendor, self._product_id = (int(vendor, 16), int(product, 16)) if vendor else (VENDOR_ID, PRODUCT_ID)

    def look(self) -> list[Sighting]:
        """Every device of ours that is there, in either mode; none of them is left open.

        Raises
        ------
        DeviceNotFoundError
            If there is none, and the bus can say why.
        """
        with translated(f"looking for {self._url!r}"):
            there = usb.core.find(find_all=True, backend=self._backend, idVendor=self._vendor)
            modes = [(device, self._mode(device)) for device in there]
        seen = [self._sighting(device, mode) for device, mode in modes if mode is not None]
        if not seen and (trouble := getattr(self._backend, "trouble", "")):
            raise DeviceNotFoundError(f"no device at {self._url!r}: {trouble}")
        return seen

    def close(self) -> None:
        """Give devices back that the bus holds and no handle has open; the next look takes them again."""
        if hasattr(self._backend, "close"):
            self._backend.close()

    def _mode(self, device: usb.core.Device) -> DeviceMode | None:
        """The mode of a device of ours, by its interface: others may bear the same test numbers."""
        with suppress(usb.core.USBError, NotImplementedError):  # what cannot be looked at cannot be known
            if device.idProduct == self._product_id and _interface(device, ARRAY_CLASS) is not None:
                return RUN_TIME
            if device.idProduct == self._product_id + 1:  # clause USB-013
                interface = _interface(device, DFU_MODE_CLASS)
                if interface is not None and bytes(interface.extra_descriptors) == DFU_FUNCTIONAL.encode():
                    return DFU_MODE
        return None

    def _sighting(self, device: usb.core.Device, mode: DeviceMode) -> Sighting:
        clock: Timekeeper = self._backend.time_of(device.address) if hasattr(self._backend, "time_of") else time
        serial: str | None = None
        product, problem = "", None
        try:
            serial, product = _string(device, device.iSerialNumber), _string(device, device.iProduct)
        except (usb.core.USBError, NotImplementedError, ValueError) as error:
            problem = _problem(error)
        finally:
            usb.util.dispose_resources(device)
        found = Found(
            self._url_of(serial),
            product,
            serial,
            mode,
            str(Version.from_bcd(device.bcdDevice)),
            _location(device),
            problem,
        )
        return Sighting(device, self._vendor, self._product_id, found, clock)

    def _url_of(self, serial: str | None) -> str:
        """The URL that names a device."""
        usual = (self._vendor, self._product_id) == (VENDOR_ID, PRODUCT_ID)
        numbers = "" if usual and serial else f"{self._vendor:04x}:{self._product_id:04x}"
        return self._prefix + ":".join(filter(None, (numbers, serial)))

    def sight(self, modes: Collection[DeviceMode] = ANY_MODE) -> Sighting:
        """The device that the URL names; it may have a problem.

        Raises
        ------
        DeviceNotFoundError
            If there is none in one of these modes, or several and no serial number to choose by.
        """
        there = self.look()
        hint = getattr(self._backend, "hint", "")
        chosen = select(self._url, self._serial, [each.found for each in there], modes, hint)
        return next(each for each in there if each.found is chosen)

    def find(self, modes: Collection[DeviceMode] = ANY_MODE) -> Sighting:
        """The device that the URL names, which may be opened.

        Raises
        ------
        DeviceNotFoundError
            If there is none in one of these modes, or several and no serial number to choose by.
        DeviceAccessError
            If there is one that may not be opened.
        """
        seen = self.sight(modes)
        if seen.found.problem is not None:
            seen.time.sleep(RIGHTS_SECONDS)
            seen = self.sight(modes)
        if seen.found.problem is not None:
            raise DeviceAccessError(
                f"{self._url!r}: the device at {seen.found.location} cannot be opened: {seen.found.problem}"
            )
        return seen

    def find_again(self, known: Sighting, modes: Collection[DeviceMode], seconds: float) -> Sighting:
        """Wait until a device is there in one of these modes, and may be opened.

        Raises
        ------
        DeviceLostError
            If it does not come in time.
        DeviceAccessError
            If something came that may not be opened.
        """
        end = known.time.monotonic() + seconds
        while True:
            there: list[Sighting] = []
            with suppress(DeviceLostError, DeviceStalledError, DeviceNotFoundError):  # it may leave meanwhile
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


def find_on(scheme: str) -> list[Found]:
    """The devices on the bus of a scheme, in both modes; errors as `UsbFinder`."""
    anyone = f"{scheme}:*"  # without a serial number an emulated bus would make a fresh device
    return [seen.found for seen in UsbFinder(anyone).look()]


def _interface(device: usb.core.Device, wanted: tuple[int, int, int]) -> Any:
    """Interface 0 of a device, which is the array or DFU mode, if its class is the wanted one; else None."""
    kind, subclass, protocol = wanted
    return usb.util.find_descriptor(
        device[0],
        bInterfaceNumber=ARRAY_INTERFACE,
        bInterfaceClass=kind,
        bInterfaceSubClass=subclass,
        bInterfaceProtocol=protocol,
    )


def _string(device: usb.core.Device, index: int) -> str:
    # Not by the properties of pyusb's device, which hide why a string cannot be read.
    return str(usb.util.get_string(device, index, LANGUAGE)) if index else ""


def _location(device: usb.core.Device) -> str:
    """Bus and ports as Linux writes them, such as 1-2.4."""
    ports = ".".join(map(str, device.port_numbers or ()))
    return f"{device.bus}-{ports}" if ports else f"bus {device.bus}, address {device.address}"


def _problem(error: Exception) -> str:
    """Why a device cannot be opened, and what to do."""
    if isinstance(error, NotImplementedError):  # as libusb says it on Windows
        return (
            "it has no driver that lets programs use it: unplug it and plug it in again, so that Windows gives it "
            "WinUSB, or choose WinUSB for it with Zadig"
        )
    if not isinstance(error, usb.core.USBError):
        return f"its name cannot be read ({error}): unplug it and plug it in again"
    if error.errno in (errno.EACCES, errno.EPERM):
        on_linux = f"install the udev rule with `{INSTALL_RULE}`, then plug it in again"
        return f"permission denied: {on_linux if sys.platform == 'linux' else 'close what uses it'}"
    if error.errno == errno.EBUSY:
        return "another program is using it: close that first"
    return f"it does not answer ({error.strerror}): unplug it and plug it in again"


def select(
    url: str, serial: str, found: Sequence[Found], modes: Collection[DeviceMode] = ANY_MODE, hint: str = ""
) -> Found:
    """The one device that is meant.

    A serial number may be cut short: the whole one is preferred, then those that begin so, then those that hold it.

    Parameters
    ----------
    url : str
        The URL for the error.
    serial : str
        All of the serial number or a part of it; empty for any.
    found : list of Found
        What is there.
    modes : collection of {"run time", "DFU"}
        The modes in one of which it must be.
    hint : str
        The end of the error if there is none.

    Returns
    -------
    Found
        It may have a `problem`: if no serial number fits, a device whose number cannot be read may be the one.

    Raises
    ------
    DeviceNotFoundError
        If none is meant, or more than one; it names those that are there.
    """
    there = [each for each in found if each.mode in modes]
    meant = _matching(serial, there) or [each for each in there if each.serial is None][:1]
    if len(meant) > 1:
        choices = " or ".join(_named(each, meant) for each in meant)
        raise DeviceNotFoundError(f"{url!r} could be any of {len(meant)} devices; name one: {choices}")
    if meant:
        return meant[0]
    if others := _matching(serial, [each for each in found if each.mode not in modes]):
        raise DeviceNotFoundError(
            f"no device at {url!r} in {' or '.join(modes)} mode: {others[0].url} is in {others[0].mode} mode; "
            "`phasewire flash` gives it firmware and starts it"
        )
    names = ", ".join(repr(each.serial) for each in there)
    found_names = f"there are {names}" if names else "nothing is plugged in"
    raise DeviceNotFoundError(f"no device at {url!r}: {found_names}{hint}")


def _matching(serial: str, found: Sequence[Found]) -> list[Found]:
    """All for an empty serial number, else those that match it best."""
    if not serial:
        return list(found)
    degrees: tuple[Callable[[str], bool], ...] = (
        lambda whole: whole == serial,
        lambda whole: whole.startswith(serial),
        lambda whole: serial in whole,
    )
    known = [each for each in found if each.serial]
    ranked = ([each for each in known if matches(each.serial or "")] for matches in degrees)
    return next(filter(None, ranked), [])


def _named(one: Found, choices: Sequence[Found]) -> str:
    """A URL that tells a device from the others, or its place if none does."""
    alike = sum(each.url == one.url for each in choices) > 1
    return f"the one at {one.location} ({one.problem})" if alike or one.problem else one.url
