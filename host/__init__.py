"""How a program talks to a device.

This room finds a device by its URL, opens a line to it and offers it as a `Device`: playing, streaming, asking, and
flashing. It knows the protocol and the solver's drives; it reaches the emulator only as it reaches any other device,
and never imports it.
"""

from __future__ import annotations

from .asynchronous import AsyncDevice, open_device_async
from .calibration import Calibration
from .device import Device, open_device
from .envelopes import Envelope, sine
from .frames import Frame, Frames, FrameSource, solved
from .recording import Recording, record
from .streaming import StreamReport
from .transport import Found, Scheme, Timekeeper, Transport

__all__ = [
    "AsyncDevice",
    "Calibration",
    "Device",
    "Envelope",
    "Found",
    "Frame",
    "FrameSource",
    "Frames",
    "Recording",
    "Scheme",
    "StreamReport",
    "Timekeeper",
    "Transport",
    "open_device",
    "open_device_async",
    "record",
    "sine",
    "solved",
]
