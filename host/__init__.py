"""How a program talks to a device.

This room finds a device by its URL, opens a transport to it and offers it as a `Device`. It knows the protocol and the
solver's drives; it reaches the emulator only as it reaches any other device, and never imports it.
"""

from __future__ import annotations

from .device import Device, open_device
from .transport import Transport

__all__ = ["Device", "Transport", "open_device"]
