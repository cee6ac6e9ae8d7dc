"""Transports: how blocks and requests reach a device, found by the scheme of its URL.

A scheme is an entry point in the group ``phasewire.transports`` that names a function ``(url) -> Transport``. Other
packages may add their own.
"""

from __future__ import annotations

import os
from importlib.metadata import entry_points
from typing import Any, Protocol

from ..errors import DeviceNotFoundError
from ..protocol.codes import Request

__all__ = ["DEFAULT_URL", "Transport", "default_url", "load_by_scheme", "open_transport"]

DEFAULT_URL = "emulator:"
URL_VARIABLE = "PHASEWIRE_DEVICE"


class Transport(Protocol):
    """A line to one device. Every method raises a `DeviceError` where the line or the device fails."""

    name: str
    """What is at the other end, for people."""

    def write_block(self, block: bytes) -> None:
        """Send one 512-byte block."""

    def read_records(self) -> bytes:
        """Wait for what the device sends by itself: one or more whole records."""

    def ask(self, request: Request, size: int) -> bytes:
        """Make a control request that is answered with up to ``size`` bytes."""

    def order(self, request: Request) -> None:
        """Make a control request that is only carried out."""

    def close(self) -> None:
        """Give the line back."""


def default_url() -> str:
    """The device to use where none is named: ``$PHASEWIRE_DEVICE``, else the emulator."""
    return os.environ.get(URL_VARIABLE) or DEFAULT_URL


def load_by_scheme(group: str, url: str) -> Any:
    """Load the entry point of a group that is named as the URL's scheme.

    Raises
    ------
    DeviceNotFoundError
        Where there is none; the known ones are named.
    """
    scheme, colon, _ = url.partition(":")
    found = {entry.name: entry for entry in entry_points(group=group)}
    if not colon or scheme not in found:
        known = ", ".join(f"{name}:" for name in sorted(found))
        raise DeviceNotFoundError(f"no device at {url!r}: the URL of a device begins with one of {known}")
    return found[scheme].load()


def open_transport(url: str) -> Transport:
    """Open the line that a URL names.

    Raises
    ------
    DeviceError
        Where the scheme is unknown, nothing answers, or it may not be used.
    """
    transport: Transport = load_by_scheme("phasewire.transports", url)(url)
    return transport
