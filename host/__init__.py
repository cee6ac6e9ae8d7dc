"""How a program talks to a device.

This room finds a device by its URL, opens a line to it and offers it as a `Device`: playing, streaming, asking, and
flashing. It finds hands by their URL, too, and gives them as they come. It knows the protocol and the solver's drives
and hands; it reaches the emulator only as it reaches any other device, and never imports it.
"""

from __future__ import annotations

from .hands import HandFrame, HandSource, PlacedHands, Pose, TrackedHand, open_hands
from .streaming.asynchronous import AsyncDevice, open_device_async
from .streaming.calibration import Calibration
from .streaming.device import Device, open_device
from .streaming.envelopes import Envelope, parse_envelope, read_envelope, sine
from .streaming.frames import Frame, Frames, FrameSource, solved
from .streaming.group import DeviceGroup, open_devices
from .streaming.recording import Recording, record
from .streaming.rig import RigDevice, read_rig
from .streaming.streaming import StreamReport
from .transports.transport import Found, Scheme, Timekeeper, Transport

__all__ = [
    "AsyncDevice",
    "Calibration",
    "Device",
    "DeviceGroup",
    "Envelope",
    "Found",
    "Frame",
    "FrameSource",
    "Frames",
    "HandFrame",
    "HandSource",
    "PlacedHands",
    "Pose",
    "Recording",
    "RigDevice",
    "Scheme",
    "StreamReport",
    "Timekeeper",
    "TrackedHand",
    "Transport",
    "open_device",
    "open_device_async",
    "open_devices",
    "open_hands",
    "parse_envelope",
    "read_envelope",
    "read_rig",
    "record",
    "sine",
    "solved",
]


def __dir__() -> list[str]:
    return __all__
