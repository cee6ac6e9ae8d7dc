"""Emulated devices in this process, by USB or by their UART: the option ``door`` of an ``emulator:`` URL says which.

What is behind the doors is found by entry point, as for any bus and any port.
"""

from __future__ import annotations

from urllib.parse import parse_qs

from . import usb
from .serial_line import SerialTransport, open_serial_line
from .transport import Found

__all__ = ["EMULATED"]


class EmulatedScheme:
    """The devices that this process has plugged in, or a fresh one."""

    def open(self, url: str) -> SerialTransport | usb.UsbTransport:
        """Open the device that a URL names, by the door that it names."""
        doors = parse_qs(url.partition("?")[2]).get("door", ["usb"])
        return open_serial_line(url) if doors[-1] == "serial" else usb.open_usb(url)

    def find(self) -> list[Found]:
        """Those that are plugged in."""
        return usb.EMULATED.find()


EMULATED = EmulatedScheme()
