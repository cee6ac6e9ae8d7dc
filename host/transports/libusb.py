"""The real USB bus: libusb, from the libusb-package wheel, so that no system library is needed."""

from __future__ import annotations

import os
from ctypes import CDLL, byref, c_char_p, c_void_p
from pathlib import Path
from typing import Any

import libusb_package
from usb.backend import libusb1

from ...base.errors import DeviceNotFoundError
from .flight import LibusbFlight

__all__ = ["open_backend"]

BUS = Path("/dev/bus/usb")


def open_backend(url: str) -> Any:
    """The pyusb backend for a ``usb:`` URL.

    Raises
    ------
    DeviceNotFoundError
        If libusb cannot be loaded or started, or the URL carries options.
    """
    if "?" in url:
        raise DeviceNotFoundError(f"{url!r}: a usb: URL has no options; write usb: or usb:SERIAL")
    backend = libusb_package.get_libusb1_backend()
    if backend is None:
        raise DeviceNotFoundError(f"no device at {url!r}: {_why_not()}")
    if not hasattr(backend, "open_flight"):
        path = str(libusb_package.get_library_path())
        backend.open_flight = lambda handle: LibusbFlight(path, backend.ctx, handle.handle)
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=lambda: _disown(backend))
    return backend


def _why_not() -> str:
    """Why libusb is not there, and what to do; pyusb does not say."""
    try:
        library = CDLL(str(libusb_package.get_library_path()))
    except OSError as error:
        return f"libusb could not be loaded on this system: {error}"
    context = c_void_p()
    code = library.libusb_init(byref(context))
    if code >= 0:
        library.libusb_exit(context)
        return "libusb could not be loaded on this system"
    library.libusb_error_name.restype = c_char_p
    return f"libusb could not be started: {library.libusb_error_name(code).decode()} ({code}); {_cause()}"


def _cause() -> str:
    """The likely reason that libusb does not start."""
    if BUS.is_dir():
        return f"allow this program to read {BUS}; in a container, also its netlink sockets"
    return (
        f"there is no {BUS}, as in a container without USB: start that with `--device {BUS}`, or serve the device "
        "outside and open it by usbip: or socket:"
    )


def _disown(backend: Any) -> None:
    """In a copy of this process by os.fork: leave the device to the other, and let a new backend be made.

    The copy shares the file of the device. What it released would be released in the other, too.
    """
    backend.release_interface = backend.close_device = lambda *_: None
    backend.ctx = None  # libusb_exit would wait for a thread that was not copied
    libusb1._lib_object = None
    libusb_package.get_libusb1_backend.cache_clear()
