"""The real USB bus: libusb, from the libusb-package wheel, so that no system library is needed."""

from __future__ import annotations

from typing import Any

import libusb_package

from ...errors import DeviceNotFoundError
from .flight import LibusbFlight

__all__ = ["open_backend"]


def open_backend(url: str) -> Any:
    """The pyusb backend for a ``usb:`` URL.

    Raises
    ------
    DeviceNotFoundError
        If libusb cannot be loaded, or the URL carries options.
    """
    if "?" in url:
        raise DeviceNotFoundError(f"{url!r}: a usb: URL has no options; write usb: or usb:SERIAL")
    backend = libusb_package.get_libusb1_backend()
    if backend is None:
        raise DeviceNotFoundError(f"no device at {url!r}: libusb could not be loaded on this system")
    path = str(libusb_package.get_library_path())
    backend.open_flight = lambda handle: LibusbFlight(path, backend.ctx, handle.handle)
    return backend
