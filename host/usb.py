"""The USB line, by pyusb. Which bus it looks on, a real one or an emulated one, is the URL's scheme.

A bus is an entry point in the group ``phasewire.usb_backends``: a function ``(url) -> pyusb backend``. A backend whose
devices do not live by the wall clock has a method ``time_of(address) -> Timekeeper``.
"""

from __future__ import annotations

import errno
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

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
from ..protocol.board import CORE_HZ
from ..protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Request
from ..protocol.enumeration import (
    ARRAY_CLASS,
    CONFIGURATION_VALUE,
    ENDPOINT_IN,
    ENDPOINT_OUT,
    FULL_SPEED,
    PRODUCT_ID,
    VENDOR_ID,
)
from ..protocol.timing import FULL_SPEED_PACKET_CYCLES, PACKET_CYCLES
from .transport import Found, Timekeeper, load_by_scheme

__all__ = ["EMULATED", "USB", "UsbTransport", "open_usb"]

REQUEST_MS = 1000
INTERFACE = 0
READ_BYTES = 32 * BLOCK_BYTES
LEFT_OVER_SECONDS = 0.001
MOST_LEFT_OVER = 64
"""Reads of records that wait from an earlier session; a device holds at most some thousands."""
LOOK_SECONDS = 0.05
"""How often a device that has left the bus is looked for."""


@contextmanager
def _translated(doing: str) -> Iterator[None]:
    """Turn pyusb's errors into ours, by their errno."""
    try:
        yield
    except usb.core.USBError as error:
        if _is_timeout(error):
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


def _is_timeout(error: usb.core.USBError) -> bool:
    return isinstance(error, usb.core.USBTimeoutError) or error.errno == errno.ETIMEDOUT


def open_usb(url: str) -> UsbTransport:
    """Open the device that ``scheme:`` or ``scheme:SERIAL`` names.

    Raises
    ------
    DeviceNotFoundError
        Where there is none, or several and no serial number to choose by.
    DeviceError
        Where it cannot be used.
    """
    wanted = url.partition(":")[2].partition("?")[0]
    backend = load_by_scheme("phasewire.usb_backends", url)(url)
    found = _ours(backend, url)
    serials = [_serial(device) for device in found]
    matching = [index for index, serial in enumerate(serials) if wanted in ("", serial)]
    if len(matching) > 1:
        choices = " or ".join(f"{url.partition(':')[0]}:{serial}" for serial in serials if serial)
        raise DeviceNotFoundError(f"{url!r} could be any of {len(matching)} devices; name one: {choices}")
    if matching and (serial := serials[matching[0]]) is not None:
        return UsbTransport(found[matching[0]], serial, backend)
    if None in serials:
        raise DeviceAccessError(
            f"{url!r}: a device is there but may not be opened; `phasewire doctor` says how to get access"
        )
    there = f"there are {', '.join(map(repr, serials))}" if serials else "nothing is plugged in"
    raise DeviceNotFoundError(f"no device at {url!r}: {there}")


def _ours(backend: Any, url: str) -> list[usb.core.Device]:
    with _translated(f"looking for {url!r}"):
        candidates = usb.core.find(find_all=True, backend=backend, idVendor=VENDOR_ID, idProduct=PRODUCT_ID)
        return [device for device in candidates if _is_ours(device)]


def _is_ours(device: usb.core.Device) -> bool:
    """Whether a device is one of ours, by the class of its interface: others may bear the same test numbers."""
    kind, subclass, version = ARRAY_CLASS
    interface = usb.util.find_descriptor(
        device[0],
        bInterfaceNumber=INTERFACE,
        bInterfaceClass=kind,
        bInterfaceSubClass=subclass,
        bInterfaceProtocol=version,
    )
    return interface is not None


def _serial(device: usb.core.Device) -> str | None:
    """The serial number, empty if there is none, None where the device may not be asked for it."""
    try:
        return str(device.serial_number or "")
    except (ValueError, usb.core.USBError):  # pyusb's ValueError "no langid": the strings could not be read at all
        return None


class UsbTransport:
    """A line to a device over pyusb.

    Parameters
    ----------
    device : usb.core.Device
        Found, perhaps not yet configured.
    serial : str
        Its serial number.
    backend : object
        The pyusb backend that found it.
    """

    lossy = False

    def __init__(self, device: usb.core.Device, serial: str, backend: Any) -> None:
        self.serial = serial
        self._backend = backend
        self.time: Timekeeper = backend.time_of(device.address) if hasattr(backend, "time_of") else time
        self._begin(device)

    @property
    def most_blocks_per_second(self) -> float:
        """As the speed of the bus allows (clauses USB-010 and BUD-004)."""
        cycles = PACKET_CYCLES
        if self._device.speed != usb.util.SPEED_HIGH:
            cycles = BLOCK_BYTES // FULL_SPEED.bulk_bytes * FULL_SPEED_PACKET_CYCLES
        return CORE_HZ / cycles

    def _begin(self, device: usb.core.Device) -> None:
        """Make a device ours, without what whoever used it before left behind, and without touching what it plays."""
        self._device = device
        with _translated(f"opening device {self.serial}"):
            try:
                self.name = f"{device.product} {self.serial}"
                if _configuration(device) != CONFIGURATION_VALUE:
                    device.set_configuration(CONFIGURATION_VALUE)
                usb.util.claim_interface(device, INTERFACE)
                for endpoint in (ENDPOINT_OUT, ENDPOINT_IN):
                    device.clear_halt(endpoint)  # and forget a part of a block (clause USB-015)
                for _ in range(MOST_LEFT_OVER):
                    if not self.read_records(LEFT_OVER_SECONDS):
                        break
            except BaseException:
                usb.util.dispose_resources(device)
                raise

    def window(self, free: int | None, records: int) -> int:  # NAK, not credit, holds the rest back
        """As many as the device can acknowledge (clause ACK-007)."""
        return records

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send blocks in one transfer."""
        with _translated("sending blocks"):
            sent = self._write(blocks, seconds)
            if part := sent % BLOCK_BYTES:  # at full speed; a block that has begun is finished (clause USB-017)
                rest = blocks[sent : sent + BLOCK_BYTES - part]
                if self._write(rest, REQUEST_MS / 1000) != len(rest):
                    raise DeviceTimeoutError(f"sending blocks: the device took only {part} bytes of one")
                sent += len(rest)
        return sent

    def _write(self, data: bytes, seconds: float) -> int:
        try:
            return int(self._device.write(ENDPOINT_OUT, data, _milliseconds(seconds)))
        except usb.core.USBError as error:
            if not _is_timeout(error):
                raise
            return 0

    def read_records(self, seconds: float) -> bytes:
        """Wait for packets of acknowledgements and statuses."""
        with _translated("waiting for an acknowledgement"):
            try:
                return bytes(self._device.read(ENDPOINT_IN, READ_BYTES, _milliseconds(seconds)))
            except usb.core.USBError as error:
                if not _is_timeout(error):
                    raise
                return b""

    def ask(self, request: Request, size: int) -> bytes:
        """Make a control request with an answer."""
        with _translated(f"asking for {request.name}"):
            return bytes(self._device.ctrl_transfer(REQUEST_TYPE_IN, request, 0, INTERFACE, size, REQUEST_MS))

    def order(self, request: Request, value: int = 0) -> None:
        """Make a control request without an answer."""
        with _translated(f"ordering {request.name}"):
            self._device.ctrl_transfer(REQUEST_TYPE_OUT, request, value, INTERFACE, None, REQUEST_MS)

    def reopen(self, seconds: float) -> None:
        """Look for the same serial number on the bus until it is there."""
        self.close()
        end = self.time.monotonic() + seconds
        while True:
            with suppress(DeviceLostError, DeviceStalledError):  # it may leave once more while it is looked at
                for device in _ours(self._backend, self.serial):
                    if _serial(device) == self.serial:
                        self._begin(device)
                        return
            if self.time.monotonic() >= end:
                raise DeviceLostError(f"{self.name} has not come back within {seconds:g} s; plug it in again")
            self.time.sleep(LOOK_SECONDS)

    def close(self) -> None:
        """Release the interface and the device."""
        usb.util.dispose_resources(self._device)


def _configuration(device: usb.core.Device) -> int:
    """The configuration that is chosen, 0 where none is."""
    try:
        return int(device.get_active_configuration().bConfigurationValue)
    except usb.core.USBError as error:
        if error.errno is not None:
            raise
        return 0  # as pyusb says that there is none


def _milliseconds(seconds: float) -> int:
    return max(1, round(seconds * 1000))  # 0 would be for ever


class UsbScheme:
    """The devices on one kind of bus."""

    def open(self, url: str) -> UsbTransport:
        """Open the device that a URL names."""
        return open_usb(url)

    def find(self) -> list[Found]:
        """The devices on the bus."""
        return []


USB = UsbScheme()
EMULATED = UsbScheme()
