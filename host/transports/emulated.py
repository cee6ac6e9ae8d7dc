"""Emulated devices in this process, by USB or by their UART: the option ``door`` of an ``emulator:`` URL says which.

What is behind the doors is found by entry point, as for any bus and any port.
"""

from __future__ import annotations

from urllib.parse import parse_qs

from .serial_line import SerialTransport, open_serial_line
from .transport import Found
from .usb import UsbTransport, open_usb
from .usb_find import find_on

__all__ = ["EMULATED"]


class EmulatedScheme:
    """The devices that this process has plugged in, or a fresh one."""

    def open(self, url: str) -> SerialTransport | UsbTransport:
        """Open the device that a URL names, by the door that it names."""
        doors = parse_qs(url.partition("?")[2]).get("door", ["usb"])
        return open_serial_line(url) if doors[-1] == "serial" else open_usb(url)

    def find(self) -> list[Found]:
        """Those that are plugged in."""
        return find_on("emulator")


EMULATED = EmulatedScheme()
