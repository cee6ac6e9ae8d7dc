"""The USB transport, by pyusb. Which bus it looks on, a real one or an emulated one, is the URL's scheme.

A bus is an entry point in the group ``phasewire.usb_backends``: a function ``(url) -> pyusb backend``.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

import usb.core
import usb.util

from ..errors import (
    DeviceAccessError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)
from ..protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Request
from ..protocol.enumeration import ARRAY_CLASS, ENDPOINT_IN, ENDPOINT_OUT, PRODUCT_ID, VENDOR_ID
from .transport import load_by_scheme

__all__ = ["UsbTransport", "open_usb"]

TIMEOUT_MS = 1000
INTERFACE = 0


@contextmanager
def _translated(doing: str) -> Iterator[None]:
    """Turn pyusb's errors into ours, by their errno."""
    try:
        yield
    except usb.core.USBError as error:
        if isinstance(error, usb.core.USBTimeoutError) or error.errno == errno.ETIMEDOUT:
            raise DeviceTimeoutError(f"{doing}: no answer within {TIMEOUT_MS} ms") from error
        if error.errno in (errno.ENODEV, errno.EIO, errno.ESHUTDOWN):
            raise DeviceLostError(f"{doing}: the device is gone; plug it in again") from error
        if error.errno in (errno.EACCES, errno.EPERM):
            raise DeviceAccessError(f"{doing}: permission denied; a udev rule must give you access") from error
        if error.errno == errno.EBUSY:
            raise DeviceAccessError(f"{doing}: another program is using the device") from error
        if error.errno == errno.EPIPE:
            raise DeviceError(
                f"{doing}: the device answers STALL: it does not know this request, or its endpoint is halted"
            ) from error
        raise DeviceError(f"{doing}: {error}") from error


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
    with _translated(f"looking for {url!r}"):
        candidates = usb.core.find(find_all=True, backend=backend, idVendor=VENDOR_ID, idProduct=PRODUCT_ID)
        found = [device for device in candidates if _is_ours(device)]
    serials = [_serial(device) for device in found]
    matching = [index for index, serial in enumerate(serials) if wanted in ("", serial)]
    if len(matching) > 1:
        choices = " or ".join(f"{url.partition(':')[0]}:{serial}" for serial in serials if serial)
        raise DeviceNotFoundError(f"{url!r} could be any of {len(matching)} devices; name one: {choices}")
    if matching and (serial := serials[matching[0]]) is not None:
        return UsbTransport(found[matching[0]], serial)
    if None in serials:
        raise DeviceAccessError(f"{url!r}: a device is there but may not be opened; a udev rule must give you access")
    there = f"there are {', '.join(map(repr, serials))}" if serials else "nothing is plugged in"
    raise DeviceNotFoundError(f"no device at {url!r}: {there}")


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
        Found, not yet configured.
    serial : str
        Its serial number.
    """

    def __init__(self, device: usb.core.Device, serial: str) -> None:
        self._device = device
        with _translated(f"opening device {serial}"):
            self.name = f"{device.product} {serial}"
            try:
                device.set_configuration()
                usb.util.claim_interface(device, INTERFACE)
            except BaseException:
                usb.util.dispose_resources(device)
                raise

    def write_block(self, block: bytes) -> None:
        """Send one 512-byte block."""
        with _translated("sending a block"):
            sent = self._device.write(ENDPOINT_OUT, block, TIMEOUT_MS)
        if sent != len(block):
            raise DeviceError(f"only {sent} of a block's {len(block)} bytes were sent")

    def read_records(self) -> bytes:
        """Wait for a packet of acknowledgements and statuses."""
        with _translated("waiting for an acknowledgement"):
            return bytes(self._device.read(ENDPOINT_IN, BLOCK_BYTES, TIMEOUT_MS))

    def ask(self, request: Request, size: int) -> bytes:
        """Make a control request with an answer."""
        with _translated(f"asking for {request.name}"):
            return bytes(self._device.ctrl_transfer(REQUEST_TYPE_IN, request, 0, INTERFACE, size, TIMEOUT_MS))

    def order(self, request: Request) -> None:
        """Make a control request without an answer."""
        with _translated(f"ordering {request.name}"):
            self._device.ctrl_transfer(REQUEST_TYPE_OUT, request, 0, INTERFACE, None, TIMEOUT_MS)

    def close(self) -> None:
        """Release the interface and the device."""
        usb.util.dispose_resources(self._device)
